"""Pictures of a room for two eyes, and as a quilt: `docs/images/stereo.jpg` and `docs/images/quilt.jpg`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from room import photograph

import pyibr as ibr

IMAGES = Path(__file__).resolve().parents[1] / "images"


def main() -> None:
    """Write both pictures."""
    view = photograph()
    pictures = [ibr.stereo(view, layout=layout, divergence=3) for layout in ("half-sbs", "dubois")]
    ibr.write_color(IMAGES / "stereo.jpg", np.hstack(pictures))
    ibr.write_color(IMAGES / "quilt.jpg", ibr.quilt(view, grid=(5, 2), size=(240, 320)))


if __name__ == "__main__":
    main()
