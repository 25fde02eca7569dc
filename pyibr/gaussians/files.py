"""Files of 3D Gaussians, most of them by way of PLY, whose scales are logarithms, and whose opacities are logits."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import check_writable, checked_path, decoding, read_bytes, reading, write_atomically
from pyibr.gaussians import ksplat
from pyibr.gaussians.conversion import converted
from pyibr.gaussians.ksplat import Arrays
from pyibr.gaussians.packed import packed, unpacked
from pyibr.io import ply
from pyibr.io.gaussian_files import GAUSSIAN_SUFFIXES, gaussian_suffix

LARGEST = 1e9
"""Limit of means, scales and harmonics: products of a few lengths still fit into single precision."""

_SHAPE = ("x", "y", "z", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3", "opacity")
_NORMALS, _DIRECT = ("nx", "ny", "nz"), ("f_dc_0", "f_dc_1", "f_dc_2")
_RESTS = (0, 9, 24, 45)  # numbers of the harmonics of degrees 1 to 3, by the degree
_STEEPEST = 20.0  # of the logarithms and logits in formats other than uncompressed PLY
_FARTHEST = {".spz": 2047.0, ".sog": 1e8}
"""Greatest coordinates of means that a format holds."""
_PALETTE = 1 << 16  # Gaussians whose harmonics need no palette in .sog files
_TURN = {  # half a turn about x, from y up in SPZ to y down: signs
    "means": np.array([1, -1, -1], np.float32),
    "rotations": np.array([1, 1, -1, -1], np.float32),
    "sh": np.array([1, -1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1], np.float32)[:, None],
}


def read_gaussians(path: str | PathLike[str]) -> Arrays:
    """Read Gaussians; those out of the limits of `pyibr.Gaussians` are left out, with a warning."""
    file = checked_path(path)
    kind = gaussian_suffix(file)
    if not kind:
        raise FileFormatError(f"{file}: a file of Gaussians ends in one of {', '.join(GAUSSIAN_SUFFIXES)}, .ply.gz")
    with reading(file, f"{kind[1:].upper()} (3D Gaussians)") as source:
        found = _arrays_in(source, kind)
        kept = np.array(found["rotations"].any(axis=1)) & (found["scales"] >= 0).all(axis=1)
        for array in found.values():
            kept &= (np.abs(array) <= LARGEST).reshape(len(array), -1).all(axis=1)  # false for NaN
        left_out = np.count_nonzero(~kept)
        bad = "values that are not finite or exceed 1e9, scales below 0, or quaternions of length 0"
        if left_out == len(kept):
            raise FileFormatError(f"{file}: none of its {len(kept)} Gaussians are usable; others have {bad}")
        if left_out:
            warnings.warn(f"{file}: left out: {left_out} Gaussians with {bad}", UserWarning, stacklevel=3)
            found = {name: array[kept] for name, array in found.items()}
        return _turned(found) if kind == ".spz" else found


def write_gaussians(path: str | PathLike[str], arrays: Arrays, order: Callable[[], NDArray[np.int64]]) -> None:
    """Write Gaussians, or leave the old file. `order`: returns an order in which neighbours lie together."""
    file = check_gaussian_file(path)
    kind, count, is_colored = gaussian_suffix(file), len(arrays["means"]), arrays["sh"].shape[1] > 1
    if kind == ".sog" and is_colored and count > _PALETTE:
        expected = f"a format other than .sog for over {_PALETTE} Gaussians with harmonics beyond degree 0"
        raise ArgumentError("path", f"{expected}, whose palette takes too long", f"{file} for {count}")
    farthest, most = float(np.abs(arrays["means"]).max()), _FARTHEST.get(kind, LARGEST)
    if farthest > most:
        raise ArgumentError(
            "path", f"a format other than {kind}, which holds means up to {most:g}", f"{file} for {farthest:g}"
        )
    if kind == ".splat" and is_colored:
        warnings.warn(f"{file}: harmonics beyond degree 0 are left out; .splat cannot hold them", stacklevel=3)
    with decoding(file, f"writable {kind[1:]}"):
        write_atomically(file, _bytes_of(arrays, kind, order))


def check_gaussian_file(path: str | PathLike[str]) -> Path:
    """Return the path, or raise the errors of `write_gaussians` for this name; nothing is written."""
    file = checked_path(path)
    if not gaussian_suffix(file) or file.suffix.lower() == ".gz":
        raise ArgumentError("path", f"a file that ends in one of {', '.join(GAUSSIAN_SUFFIXES)}", str(file))
    check_writable(file)
    return file


def _bytes_of(arrays: Arrays, kind: str, order: Callable[[], NDArray[np.int64]]) -> bytes:
    if kind == ".ply":
        return ply.column_bytes({"vertex": _columns_of(arrays)})
    if kind == ".ksplat":
        return ksplat.bytes_of(arrays)
    if kind == ".compressed.ply":
        chosen = order()
        arrays = {name: array[chosen] for name, array in arrays.items()}
    elif kind == ".spz":
        arrays = _turned(arrays)
    columns = _columns_of(arrays)
    columns |= {name: np.maximum(columns[name], -_STEEPEST) for name in _SHAPE[3:6]}
    columns["opacity"] = np.clip(columns["opacity"], -_STEEPEST, _STEEPEST)
    if kind == ".compressed.ply":
        return ply.column_bytes(packed(columns))
    return converted(ply.column_bytes({"vertex": columns}), "ply", kind[1:])


def _arrays_in(source: Path, kind: str) -> Arrays:
    if kind.endswith(".ply"):
        return _arrays_of(ply.read_columns(read_bytes(source)))
    if kind == ".ksplat":
        return ksplat.arrays_of(source.read_bytes())
    return _arrays_of(ply.read_columns(converted(source.read_bytes(), kind[1:], "ply")))


def _turned(arrays: Arrays) -> Arrays:
    """Turn Gaussians by half a turn about x."""
    signs = _TURN | {"sh": _TURN["sh"][: arrays["sh"].shape[1]]}
    return {name: array * signs[name] if name in signs else array for name, array in arrays.items()}


def _columns_of(arrays: Arrays) -> dict[str, NDArray[Any]]:
    """The columns of an uncompressed file, in the order that some programs expect."""
    sh = arrays["sh"]
    rests = [sh[:, harmonic, channel] for channel in range(3) for harmonic in range(1, sh.shape[1])]
    with np.errstate(divide="ignore"):
        scales, opacities = np.log(arrays["scales"].astype(np.float64)), arrays["opacities"].astype(np.float64)
        logits = np.log(opacities) - np.log1p(-opacities)
    return (
        dict(zip(_SHAPE[:3], arrays["means"].T, strict=True))
        | dict.fromkeys(_NORMALS, np.zeros(len(sh)))
        | dict(zip(_DIRECT, sh[:, 0].T, strict=True))
        | {f"f_rest_{number}": rest for number, rest in enumerate(rests)}
        | {"opacity": logits}
        | dict(zip(_SHAPE[3:6], scales.T, strict=True))
        | dict(zip(_SHAPE[6:10], arrays["rotations"].T, strict=True))
    )


def _arrays_of(tables: Mapping[str, dict[str, NDArray[Any]]]) -> Arrays:
    if "vertex" not in tables:
        raise ValueError("no vertices in the header")
    try:
        columns = unpacked(tables) if "packed_position" in tables["vertex"] else tables["vertex"]
    except KeyError as error:
        raise ValueError(f"no {error.args[0]} in the header") from None
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
