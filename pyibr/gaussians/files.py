"""PLY files of 3D Gaussian Splatting: logarithms of scales, logits of opacities, and harmonics channel by channel."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import check_writable, checked_path, read_bytes, reading, write_atomically
from pyibr.io import ply

_MEANS, _NORMALS, _DIRECT = ("x", "y", "z"), ("nx", "ny", "nz"), ("f_dc_0", "f_dc_1", "f_dc_2")
_SCALES, _ROTATIONS = ("scale_0", "scale_1", "scale_2"), ("rot_0", "rot_1", "rot_2", "rot_3")
_RESTS = (0, 9, 24, 45)  # numbers of the harmonics of degrees 1 to 3, by the degree


@dataclass(frozen=True)
class GaussianArrays:
    """Gaussians as in a `pyibr.Gaussians`, unchecked."""

    means: NDArray[np.float32]
    scales: NDArray[np.float32]
    rotations: NDArray[np.float32]
    opacities: NDArray[np.float32]
    sh: NDArray[np.float32]  # (N, K, 3)


def read_gaussians(path: str | PathLike[str]) -> GaussianArrays:
    """Read Gaussians; those with values that are not finite are left out, with a warning."""
    file = checked_path(path)
    if _suffix(file) != ".ply":
        raise FileFormatError(f"{file}: a file of Gaussians ends in .ply (or .ply.gz)")
    with reading(file, "PLY of 3D Gaussians") as source:
        found = _arrays_of(ply.read_columns(read_bytes(source)))
        parts = (found.means, found.scales, found.rotations, found.sh.reshape(len(found.sh), -1))
        kept = ~np.isnan(found.opacities) & found.rotations.any(axis=1)
        for part in parts:
            kept &= np.isfinite(part).all(axis=1)
        if not kept.any():
            raise FileFormatError(f"{file}: no Gaussians with finite values in it")
        if kept.all():
            return found
        count = np.count_nonzero(~kept)
        warnings.warn(f"{file}: left out: {count} Gaussians with values that are not finite", UserWarning, stacklevel=3)
        return GaussianArrays(
            found.means[kept], found.scales[kept], found.rotations[kept], found.opacities[kept], found.sh[kept]
        )


def write_gaussians(path: str | PathLike[str], arrays: GaussianArrays) -> None:
    """Write Gaussians, or leave the old file."""
    file = checked_path(path)
    if file.suffix.lower() != ".ply":
        raise ArgumentError("path", "a file that ends in .ply", str(file))
    check_writable(file)
    count, harmonics = arrays.sh.shape[:2]
    with np.errstate(divide="ignore"):
        logits = np.log(arrays.opacities.astype(np.float64)) - np.log1p(-arrays.opacities.astype(np.float64))
        scales = np.log(arrays.scales.astype(np.float64))
    rest = arrays.sh[:, 1:].transpose(0, 2, 1).reshape(count, -1)
    columns = (arrays.means, np.zeros((count, 3)), arrays.sh[:, 0], rest, logits[:, None], scales, arrays.rotations)
    rest_names = [f"f_rest_{number}" for number in range(3 * (harmonics - 1))]
    names = [*_MEANS, *_NORMALS, *_DIRECT, *rest_names, "opacity", *_SCALES, *_ROTATIONS]
    write_atomically(
        file, ply.column_bytes(names, np.concatenate(columns, axis=1, dtype=np.float32, casting="same_kind"))
    )


def _suffix(file: Path) -> str:
    packed = file.suffix.lower() == ".gz"
    return (Path(file.stem) if packed else file).suffix.lower()


def _arrays_of(columns: dict[str, NDArray[Any]]) -> GaussianArrays:
    if "packed_position" in columns:
        raise ValueError("its Gaussians are compressed; uncompressed ones are read")
    names = (*_MEANS, *_DIRECT, "opacity", *_SCALES, *_ROTATIONS)
    missing = [name for name in names if name not in columns]
    if missing:
        raise ValueError(f"it holds no 3D Gaussians: no {', '.join(missing)} in the header")
    count = sum(name.startswith("f_rest_") for name in columns)
    if count not in _RESTS:
        raise ValueError(f"{count} properties f_rest; {', '.join(map(str, _RESTS))} are known")

    def stacked(*chosen: str) -> NDArray[np.float32]:
        with np.errstate(over="ignore", invalid="ignore"):
            return np.stack([columns[name].astype(np.float32) for name in chosen], axis=1)

    means, rotations, logits = stacked(*_MEANS), stacked(*_ROTATIONS), stacked("opacity")[:, 0]
    harmonics = 1 + count // 3
    sh = np.empty((len(means), harmonics, 3), np.float32)
    sh[:, 0] = stacked(*_DIRECT)
    for channel in range(3 if harmonics > 1 else 0):
        first = channel * (harmonics - 1)
        sh[:, 1:, channel] = stacked(*(f"f_rest_{first + number}" for number in range(harmonics - 1)))
    with np.errstate(over="ignore"):
        scales = np.exp(stacked(*_SCALES))
    return GaussianArrays(means, scales, rotations, _sigmoid(logits).astype(np.float32), sh)


def _sigmoid(logits: NDArray[np.float32]) -> Float64:
    with np.errstate(over="ignore"):
        return 1 / (1 + np.exp(-logits.astype(np.float64)))
