"""PLY files of 3D Gaussian Splatting: logarithms of scales, logits of opacities, and harmonics channel by channel."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import check_writable, checked_path, read_bytes, reading, write_atomically
from pyibr.io import ply

LARGEST = 1e9
"""Limit of means, scales and harmonics: products of a few lengths still fit into single precision."""

_SHAPE = ("x", "y", "z", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3", "opacity")
_NORMALS, _DIRECT = ("nx", "ny", "nz"), ("f_dc_0", "f_dc_1", "f_dc_2")
_RESTS = (0, 9, 24, 45)  # numbers of the harmonics of degrees 1 to 3, by the degree


def is_gaussian_file(path: str | PathLike[str]) -> bool:
    """Tell whether a file holds 3D Gaussians, by its suffix; a PLY file by its header."""
    file = checked_path(path)
    return _suffix(file) == ".ply" and ply.holds_gaussians(file)


def read_gaussians(path: str | PathLike[str]) -> dict[str, NDArray[np.float32]]:
    """Read the arrays of a `pyibr.Gaussians`; Gaussians out of its limits are left out, with a warning."""
    file = checked_path(path)
    if _suffix(file) != ".ply":
        raise FileFormatError(f"{file}: a file of Gaussians ends in .ply (or .ply.gz)")
    with reading(file, "PLY of 3D Gaussians") as source:
        found = _arrays_of(ply.read_columns(read_bytes(source)))
        kept = np.array(found["rotations"].any(axis=1))
        for array in found.values():
            kept &= (np.abs(array) <= LARGEST).reshape(len(array), -1).all(axis=1)  # false for NaN
        left_out = np.count_nonzero(~kept)
        bad = "values that are not finite or exceed 1e9, or quaternions of length 0"
        if left_out == len(kept):
            raise FileFormatError(f"{file}: none of its {len(kept)} Gaussians are usable; others have {bad}")
        if left_out:
            warnings.warn(f"{file}: left out: {left_out} Gaussians with {bad}", UserWarning, stacklevel=3)
            found = {name: array[kept] for name, array in found.items()}
        return found


def write_gaussians(path: str | PathLike[str], columns: Sequence[NDArray[np.float32]]) -> None:
    """Write Gaussians, or leave the old file.

    columns: mean, scales, rotation, opacity, and for each harmonic red, green and blue.
    """
    file = checked_path(path)
    if file.suffix.lower() != ".ply":
        raise ArgumentError("path", "a file that ends in .ply", str(file))
    check_writable(file)
    by_channel = [*columns[11:14], *(column for first in (14, 15, 16) for column in columns[first::3])]
    stored = dict(zip(_SHAPE, columns, strict=False))
    stored |= {f"f_dc_{at}" if at < 3 else f"f_rest_{at - 3}": column for at, column in enumerate(by_channel)}
    with np.errstate(divide="ignore"):
        stored |= {name: np.log(stored[name].astype(np.float64)) for name in _SHAPE[3:6]}
        opacities = stored["opacity"].astype(np.float64)
        stored["opacity"] = np.log(opacities) - np.log1p(-opacities)
    stored |= dict.fromkeys(_NORMALS, np.zeros(len(columns[0])))
    names = (*_SHAPE[:3], *_NORMALS, *(name for name in stored if name[0] == "f"), "opacity", *_SHAPE[3:10])
    write_atomically(file, ply.column_bytes({name: stored[name] for name in names}))  # some programs expect this order


def _suffix(file: Path) -> str:
    return (Path(file.stem) if file.suffix.lower() == ".gz" else file).suffix.lower()


def _arrays_of(columns: dict[str, NDArray[Any]]) -> dict[str, NDArray[np.float32]]:
    if "packed_position" in columns:
        raise ValueError("its Gaussians are compressed; uncompressed ones are read")
    count = sum(name.startswith("f_rest_") for name in columns)
    rests = [f"f_rest_{number}" for number in range(count)]
    missing = [name for name in (*_SHAPE, *_DIRECT, *rests) if name not in columns]
    if missing:
        raise ValueError(f"it holds no 3D Gaussians: no {', '.join(missing)} in the header")
    if count not in _RESTS:
        raise ValueError(f"{count} properties f_rest; {', '.join(map(str, _RESTS))} are known")
    with np.errstate(over="ignore", invalid="ignore"):
        shape = [columns[name].astype(np.float32) for name in _SHAPE]
        opacities = (1 / (1 + np.exp(-shape[10].astype(np.float64)))).astype(np.float32)
        scales = np.exp(np.stack(shape[3:6], axis=1))
        sh = np.empty((len(opacities), 1 + count // 3, 3), np.float32)
        for number, name in enumerate((*_DIRECT, *rests)):
            channel, harmonic = divmod(number - 3, count // 3) if number > 2 else (number, -1)
            sh[:, harmonic + 1, channel] = columns[name]
    means, rotations = np.stack(shape[:3], axis=1), np.stack(shape[6:10], axis=1)
    return {"means": means, "scales": scales, "rotations": rotations, "opacities": opacities, "sh": sh}
