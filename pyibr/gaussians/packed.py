"""Compressed PLY files: 16 bytes a Gaussian within the bounds of its chunk, and a byte for each further harmonic.

The format is PlayCanvas's. A chunk holds 256 Gaussians, which should be neighbours.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Columns = Mapping[str, NDArray[Any]]
Float32 = NDArray[np.float32]

SH0 = 0.28209479177387814
"""The harmonic of degree 0."""

_CHUNK = 256
_BITS = {"position": (11, 10, 11), "scale": (11, 10, 11), "color": (8, 8, 8, 8)}
_BOUNDS = {"position": ("x", "y", "z"), "scale": ("scale_x", "scale_y", "scale_z"), "color": ("r", "g", "b")}
_STORED = {  # the columns of uncompressed files
    "position": ("x", "y", "z"),
    "scale": ("scale_0", "scale_1", "scale_2"),
    "color": ("f_dc_0", "f_dc_1", "f_dc_2", "opacity"),
}
_ROTATION = ("rot_0", "rot_1", "rot_2", "rot_3")
_TURNED = (2, 10, 10, 10)  # bits: which component is the largest, and the others
_RANGE = 8  # of the further harmonics, around 0


@np.errstate(all="ignore")  # values of damaged files
def unpacked(tables: Mapping[str, Columns]) -> dict[str, NDArray[Any]]:
    """Return the columns of an uncompressed file for the tables of a compressed one."""
    vertex, chunk, rests = tables["vertex"], dict(tables.get("chunk", {})), tables.get("sh", {})
    chunks, count = len(next(iter(chunk.values()), ())), len(vertex["packed_position"])
    if "min_r" not in chunk:  # as older programs write it
        chunk |= {f"{end}_{name}": np.full(chunks, at) for at, end in enumerate(("min", "max")) for name in "rgb"}
    if count > _CHUNK * chunks or any(len(column) != count for column in rests.values()):
        raise ValueError(f"{chunks} chunks for {count} Gaussians, or another number of harmonics")
    found, of = dict[str, NDArray[Any]](), np.arange(count) // _CHUNK
    for kind, bits in _BITS.items():
        found |= dict(zip(_STORED[kind], _fields(vertex[f"packed_{kind}"], bits), strict=True))
        for name, bound in zip(_STORED[kind], _BOUNDS[kind], strict=False):
            low, high = (chunk[f"{end}_{bound}"].astype(np.float32) for end in ("min", "max"))
            found[name] = low[of] + found[name] * (high - low)[of]
    found |= {name: (found[name] - 0.5) / SH0 for name in _STORED["color"][:3]}
    found["opacity"] = np.log(found["opacity"] / (1 - found["opacity"]))
    largest, *fields = _fields(vertex["packed_rotation"], _TURNED)
    others: list[Float32] = [(field - 0.5) * np.sqrt(np.float32(2)) for field in fields]
    rest: Float32 = np.sqrt(np.maximum(1 - np.sum(np.square(others), axis=0), 0))
    for at, name in enumerate(_ROTATION):
        places = np.rint(3 * largest)
        found[name] = np.where(places == at, rest, np.where(places < at, others[max(at - 1, 0)], others[min(at, 2)]))
    for name, levels in rests.items():
        shares = np.where(levels == 0, 0, np.where(levels == 255, 1, (levels + np.float32(0.5)) / 256))
        found[name] = (shares - 0.5) * _RANGE
    return found


def packed(columns: Columns) -> dict[str, dict[str, NDArray[Any]]]:
    """Return the tables of a compressed file for the columns of an uncompressed one, whose Gaussians lie in order."""
    count = len(columns["x"])
    first, of = np.arange(0, count, _CHUNK), np.arange(count) // _CHUNK
    chunk, vertex = dict[str, NDArray[Any]](), dict[str, NDArray[Any]]()
    shown = {**columns, "opacity": 1 / (1 + np.exp(-columns["opacity"]))}
    shown |= {name: columns[name] * SH0 + 0.5 for name in _STORED["color"][:3]}
    for kind, bits in _BITS.items():
        fields = [shown[name] for name in _STORED[kind]]
        for at, bound in enumerate(_BOUNDS[kind]):
            low, high = np.minimum.reduceat(fields[at], first), np.maximum.reduceat(fields[at], first)
            chunk |= {f"min_{bound}": low, f"max_{bound}": high}
            fields[at] = (fields[at] - low[of]) / np.where(high > low, high - low, 1)[of]
        vertex[f"packed_{kind}"] = _word(fields, bits)
    turned: Float32 = np.stack([columns[name] for name in _ROTATION])
    largest = np.abs(turned).argmax(axis=0)
    turned = turned * np.where(np.take_along_axis(turned, largest[None], axis=0) < 0, -1, 1)
    others: list[NDArray[Any]] = [
        np.where(at < largest, turned[at], turned[at + 1]) / np.sqrt(2) + 0.5 for at in range(3)
    ]
    vertex["packed_rotation"] = _word([largest / 3, *others], _TURNED)
    ends = ("min", "max")
    bounds = [f"{end}_{bound}" for kind in _BITS for end in ends for bound in _BOUNDS[kind]]  # the usual order
    rests = {name: (column / _RANGE + 0.5) * 256 for name, column in columns.items() if name.startswith("f_rest_")}
    sh = {name: np.clip(level, 0, 255).astype(np.uint8) for name, level in rests.items()}
    names = [f"packed_{kind}" for kind in ("position", "rotation", "scale", "color")]
    tables = {"chunk": {name: chunk[name] for name in bounds}, "vertex": {name: vertex[name] for name in names}}
    return tables | ({"sh": sh} if sh else {})


def _fields(words: NDArray[Any], bits: tuple[int, ...]) -> list[Float32]:
    """The fields of packed words as shares of their largest values, the highest bits first."""
    ends = np.cumsum(bits[::-1])[::-1]
    whole = words.astype(np.uint32)
    return [
        ((whole >> np.uint32(end - size)) & np.uint32((1 << size) - 1)).astype(np.float32) / np.float32((1 << size) - 1)
        for end, size in zip(ends, bits, strict=True)
    ]


def _word(shares: list[NDArray[Any]], bits: tuple[int, ...]) -> NDArray[np.uint32]:
    """The inverse of `_fields`."""
    word = np.zeros(len(shares[0]), np.uint32)
    for share, size in zip(shares, bits, strict=True):
        largest = (1 << size) - 1
        word = word << np.uint32(size) | np.rint(np.clip(share, 0, 1) * largest).astype(np.uint32)
    return word
