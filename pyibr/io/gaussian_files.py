"""Names of files of 3D Gaussians."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from pyibr.core.errors import FileFormatError
from pyibr.core.files import checked_path
from pyibr.io import ply

GAUSSIAN_SUFFIXES = (".compressed.ply", ".ply", ".splat", ".spz", ".ksplat", ".sog")


def gaussian_suffix(file: Path) -> str:
    """The suffix of a file that may hold Gaussians, or ""; PLY files may also be packed by gzip."""
    name = file.name.lower()
    name = name.removesuffix(".gz") if name.endswith(".ply.gz") else name
    return next((suffix for suffix in GAUSSIAN_SUFFIXES if name.endswith(suffix)), "")


def is_gaussian_file(path: str | PathLike[str]) -> bool:
    """Tell whether a file holds 3D Gaussians, by its suffix; a PLY file by its header. False if there is no file."""
    file = checked_path(path)
    suffix = gaussian_suffix(file)
    return ply.holds_gaussians(file) if suffix.endswith(".ply") else bool(suffix) and file.is_file()


def refuse_gaussians(path: str | PathLike[str], expected: str) -> None:
    """Raise FileFormatError if a file holds 3D Gaussians instead of something else."""
    if is_gaussian_file(path):
        uses = "pyibr.Gaussians.load reads them, `pyibr orbit` draws them, `pyibr capture` makes depth images of them"
        raise FileFormatError(f"{path}: expected {expected}, got 3D Gaussians: {uses}")
