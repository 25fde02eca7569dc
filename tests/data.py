"""Real inputs, which are not part of the project: in a folder beside the checkout, or in $PYIBR_DATA."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

DATA = Path(os.environ.get("PYIBR_DATA") or Path(__file__).parents[2] / "shared" / "data")


def shared(name: str) -> Path:
    """Return a file or folder of the data; without it, the test is skipped."""
    path = DATA / name
    if not path.exists():
        pytest.skip(f"needs {name}")
    return path
