"""NumPy's NPY, and NPZ with one array or one named "color" or "depth"."""

from __future__ import annotations

from os import PathLike
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from pyibr.core.errors import FileFormatError
from pyibr.core.files import atomic_path, reading


def read_color(path: str | PathLike[str]) -> NDArray[Any]:
    """Return the array as stored."""
    return _read(path, "color")


def read_depth(path: str | PathLike[str]) -> NDArray[Any]:
    """Return the array as stored."""
    return _read(path, "depth")


def write_color(path: str | PathLike[str], color: NDArray[Any]) -> None:
    """Write the array as it is."""
    _write(path, "color", color)


def write_depth(path: str | PathLike[str], depth: NDArray[Any]) -> None:
    """Write the array as it is."""
    _write(path, "depth", depth)


def _read(path: str | PathLike[str], name: str) -> NDArray[Any]:
    with reading(path, "NumPy") as source, source.open("rb") as stream:
        content: Any = np.load(stream, allow_pickle=False)
        if isinstance(content, np.ndarray):
            return cast("NDArray[Any]", content)
        if name not in content.files and len(content.files) != 1:
            raise FileFormatError(f"{path}: no array {name!r} among {', '.join(content.files) or 'none'}")
        return np.asarray(content[name if name in content.files else content.files[0]])


def _write(path: str | PathLike[str], name: str, array: NDArray[Any]) -> None:
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        if temporary.suffix.lower() == ".npz":
            np.savez_compressed(stream, allow_pickle=False, **{name: array})
        else:
            np.save(stream, array, allow_pickle=False)
