"""COLMAP's dense folders and ETH3D's: pictures, their depth maps, and a sparse model, also with rigs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pyibr.core.errors import FileFormatError
from pyibr.core.files import reading
from pyibr.io.folders import in_order
from pyibr.io.layouts.parts import joined
from pyibr.io.recordings import COLOR_SUFFIXES, Depth, Recording, Stored, size_of

_KINDS = ("geometric", "photometric")
_MODELS = ("dslr_calibration_jpg", "rig_calibration")


def find_dense(folder: Path) -> Recording | None:
    """Find folders images, sparse and stereo/depth_maps."""
    maps, pictures = folder / "stereo" / "depth_maps", folder / "images"
    if not (maps.is_dir() and pictures.is_dir()):
        return None
    images = _files(pictures)
    of_image = {image: [maps / f"{image.relative_to(pictures)}.{kind}.bin" for kind in _KINDS] for image in images}
    there = {image: file for image, files in of_image.items() for file in files[::-1] if file.is_file()}
    if not there:
        name = next((f"{image.name}.{_KINDS[0]}.bin" for image in images), "image.geometric.bin")
        raise FileFormatError(f"{maps}: expected a depth map for an image, such as {name}")
    cameras = (folder / "sparse",) if (folder / "sparse").is_dir() else ()
    _, found = joined(maps, {image: image for image in images}, there)
    return found._replace(cameras=cameras)


def find_eth3d(folder: Path) -> Recording | None:
    """Find ETH3D's multi-view sets: images beside ground_truth_depth, raw floats with the pictures' names."""
    pictures, truth = folder / "images", folder / "ground_truth_depth"
    model = next((folder / name for name in _MODELS if (folder / name).is_dir()), None)
    if not (pictures.is_dir() and truth.is_dir()) or model is None:
        return None
    depths = {pictures / file.relative_to(truth): file for file in _files(truth)}
    _, found = joined(truth, {image: image for image in _files(pictures)}, depths)

    def depth(path: Path) -> Depth:
        with reading(path, "depth") as source:
            width, height = size_of(pictures / path.relative_to(truth))
            return np.fromfile(source, "<f4").reshape(height, width)

    return found._replace(cameras=(model,), stored=[Stored(depth=depth)] * len(found.colors))


def _files(folder: Path) -> list[Path]:
    """Pictures in the folder and its subfolders, sorted by folder and number."""
    files = [file for file in folder.rglob("*") if file.suffix.lower() in COLOR_SUFFIXES and file.is_file()]
    return sorted(files, key=lambda file: [str(file.parent), in_order(file)])
