"""COLMAP's dense workspaces: pictures, a sparse model (with rigs, too) and depth maps named after the pictures."""

from __future__ import annotations

from pathlib import Path

from pyibr.core.errors import FileFormatError
from pyibr.io.folders import in_order
from pyibr.io.recordings import COLOR_SUFFIXES, Recording

_KINDS = ("geometric", "photometric")


def find_dense(folder: Path) -> Recording | None:
    """Folders images, sparse and stereo/depth_maps."""
    maps, pictures = folder / "stereo" / "depth_maps", folder / "images"
    if not (maps.is_dir() and pictures.is_dir()):
        return None
    files = [file for file in pictures.rglob("*") if file.suffix.lower() in COLOR_SUFFIXES and file.is_file()]
    images = sorted(files, key=lambda file: [str(file.parent), in_order(file)])
    of_image = {image: [maps / f"{image.relative_to(pictures)}.{kind}.bin" for kind in _KINDS] for image in images}
    there = {image: file for image, files in of_image.items() for file in files[::-1] if file.is_file()}
    if not there:
        name = next((f"{image.name}.{_KINDS[0]}.bin" for image in images), "of anything")
        raise FileFormatError(f"{maps}: no depth map of an image, as {name}")
    cameras = (folder / "sparse",) if (folder / "sparse").is_dir() else ()
    left_out = [image for image in images if image not in there]
    kept = [image in there for image in images]
    return Recording(list(there), list(there.values()), cameras, None, left_out, kept=kept)
