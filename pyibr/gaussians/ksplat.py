"""KSPLAT files, of three levels of compression: float32; float16; float16 with harmonics in bytes.

The format is Mark Kellogg's. Compressed positions are offsets from the centres of buckets.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from pyibr.gaussians.packed import SH0

Arrays = dict[str, NDArray[np.float32]]
"""The arrays of a `pyibr.Gaussians`, by the names of its arguments."""

_HEADER, _SECTION, _BUCKET = 4096, 1024, 12  # bytes
_ABOUT = "<IIIIfHxxIIIIH"  # a section's header
_KINDS = (("<f4", "<f4", "<f4"), ("<u2", "<f2", "<f2"), ("<u2", "<f2", "u1"))  # positions, shapes, harmonics


@np.errstate(all="ignore")  # values of damaged files
def arrays_of(data: bytes) -> Arrays:
    """Return the Gaussians in a file's bytes; ValueError if they are damaged."""
    if len(data) < _HEADER or data[0] or not data[1]:
        raise ValueError("no header of version 0.1")
    (sections,), (level,) = struct.unpack_from("<I", data, 4), struct.unpack_from("<H", data, 20)
    if not sections or level >= len(_KINDS) or len(data) < _HEADER + sections * _SECTION:
        raise ValueError(f"{sections} sections of compression {level}")
    low, high = struct.unpack_from("<ff", data, 36)
    low, high = low or -1.5, high or 1.5
    start, parts = _HEADER + sections * _SECTION, list[Arrays]()
    for number in range(sections):
        about = struct.unpack_from(_ABOUT, data, _HEADER + number * _SECTION)
        count, room, capacity, buckets, block, size, span, _, full, partial, degree = about
        row = _row(level, degree)
        if count > room or (level and size < _BUCKET):
            raise ValueError(f"{count} Gaussians in room for {room}, or buckets of {size} bytes")
        first = start + 4 * partial + size * buckets
        rows: NDArray[np.void] = np.frombuffer(data, row, count, first) if count else np.empty(0, row)
        means, shares = rows["means"].astype(np.float32), rows["sh"].astype(np.float32)
        if level and count:
            sizes = np.frombuffer(data, "<u4", partial, start)
            centers = np.frombuffer(data, "<f4", 3 * buckets, start + 4 * partial).reshape(-1, 3)
            if full > buckets:
                raise ValueError(f"{full} full buckets of {buckets}")
            ends = np.cumsum(np.append(np.full(full, capacity), sizes).astype(np.int64))
            of = np.searchsorted(ends, np.arange(count), side="right")
            if of[-1] >= min(buckets, len(ends)):
                raise ValueError(f"{buckets} buckets for {count} Gaussians")
            means = (means - span) * np.float32(block / 2 / (span or 1)) + centers[of]
        if level == 2:
            shares = low + shares / 255 * (high - low)
        colors, direct = rows["colors"].astype(np.float32) / 255, np.empty((count, (degree + 1) ** 2, 3), np.float32)
        direct[:, 0] = (colors[:, :3] - 0.5) / SH0
        for one in range(1, degree + 1):
            direct[:, one**2 : (one + 1) ** 2] = shares[:, _part(one)].reshape(count, 3, -1).transpose(0, 2, 1)
        shapes = {name: rows[name].astype(np.float32) for name in ("scales", "rotations")}
        parts.append({"means": means, **shapes, "opacities": colors[:, 3], "sh": direct})
        start = first + room * row.itemsize
    most = max(part["sh"].shape[1] for part in parts)
    padded = [{**part, "sh": np.pad(part["sh"], ((0, 0), (0, most - part["sh"].shape[1]), (0, 0)))} for part in parts]
    return {name: np.concatenate([part[name] for part in padded]) for name in padded[0]}


def bytes_of(arrays: Arrays) -> bytes:
    """Return an uncompressed file's bytes."""
    sh = arrays["sh"]
    count, degree = len(sh), {1: 0, 4: 1, 9: 2, 16: 3}[sh.shape[1]]
    rows = np.zeros(count, _row(0, degree))
    for name in ("means", "scales", "rotations"):
        rows[name] = arrays[name]
    colors = np.column_stack([sh[:, 0] * SH0 + 0.5, arrays["opacities"]])
    rows["colors"] = np.rint(colors.clip(0, 1) * 255)
    for one in range(1, degree + 1):
        rows["sh"][:, _part(one)] = sh[:, one**2 : (one + 1) ** 2].transpose(0, 2, 1).reshape(count, -1)
    header, section = bytearray(_HEADER), bytearray(_SECTION)
    struct.pack_into("<BBxxIIIIH", header, 0, 0, 1, 1, 1, count, count, 0)
    struct.pack_into(_ABOUT, section, 0, count, count, 0, 0, 0, 0, 0, rows.nbytes, 0, 0, degree)
    return b"".join([header, section, rows.data])


def _part(degree: int) -> slice:
    """Place of a degree's harmonics, channel by channel."""
    return slice(3 * (degree**2 - 1), 3 * ((degree + 1) ** 2 - 1))


def _row(level: int, degree: int) -> np.dtype[np.void]:
    if degree > 3:
        raise ValueError(f"harmonics of degree {degree}")
    place, shape, harmonic = _KINDS[level]
    names = [("means", place, 3), ("scales", shape, 3), ("rotations", shape, 4), ("colors", "u1", 4)]
    return np.dtype([*names, ("sh", harmonic, (3 * (degree + 1) ** 2 - 3,))])
