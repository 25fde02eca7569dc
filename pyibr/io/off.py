"""OFF: text with counts, then vertices (with colours after the keyword COFF), then faces."""

from __future__ import annotations

import re
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.images.srgb import in_bytes
from pyibr.io.mesh_arrays import MeshArrays, count_of
from pyibr.io.polygons import triangles

_KEYWORD = re.compile(r"\s*(ST)?(C)?(N)?OFF(?![^\s\d])")


def read_mesh(data: bytes, folder: Path) -> MeshArrays:
    """Return the mesh in a file's bytes."""
    text = re.sub(r"#[^\n]*", "", data.decode("ascii"))
    keyword = _KEYWORD.match(text)
    if keyword is None:
        raise ValueError("it does not open with OFF")
    lines = [words for line in text[keyword.end() :].splitlines() if (words := line.split())]
    vertices, faces = (count_of(word, len(lines)) for word in lines[0][:2])
    if len(lines) != 1 + vertices + faces:
        raise ValueError(f"expected {vertices} vertices and {faces} faces, got {len(lines) - 1} lines")
    mapped, colored, directed = keyword.groups()
    rows = _numbers(lines[1 : 1 + vertices])
    before_color = 6 if directed else 3
    colors = None
    if colored and rows.shape[1] >= before_color + 3:
        stored = rows[:, before_color : before_color + 3]
        words = chain.from_iterable(line[before_color : before_color + 3] for line in lines[1 : 1 + vertices])
        colors = in_bytes(stored / 255 if all(word.isdigit() for word in words) else stored)
    counts = np.array([int(line[0]) for line in lines[1 + vertices :]], np.int64)
    is_painted = any(len(line) > 1 + count for line, count in zip(lines[1 + vertices :], counts.tolist(), strict=True))
    lost = ("uv",) * bool(mapped) + ("colours of faces",) * is_painted
    corners = [line[1 : 1 + count] for line, count in zip(lines[1 + vertices :], counts.tolist(), strict=True)]
    if any(len(line) != count for line, count in zip(corners, counts.tolist(), strict=True)):
        raise ValueError("a face with fewer corners than its count")
    numbers = np.array([int(word) for word in chain.from_iterable(corners)], np.int64)
    faces = numbers[triangles(counts, rows[numbers, :3])]
    return MeshArrays(rows[:, :3], faces, None, rows[:, 3:6] if directed else None, colors, left_out=lost)


def mesh_bytes(mesh: MeshArrays) -> bytes:
    """Return a file with vertices, their colours, and faces."""
    row, values = "%.9g %.9g %.9g\n", mesh.vertices
    if mesh.colors is not None:
        row, values = "%.9g %.9g %.9g %d %d %d 255\n", np.hstack([mesh.vertices, mesh.colors])
    head = f"{'OFF' if mesh.colors is None else 'COFF'}\n{len(mesh.vertices)} {len(mesh.faces)} 0\n"
    body = row * len(values) % tuple(values.ravel().tolist())
    return (head + body + "3 %d %d %d\n" * len(mesh.faces) % tuple(mesh.faces.ravel().tolist())).encode("ascii")


def _numbers(lines: list[list[str]]) -> NDArray[Any]:
    width = len(lines[0]) if lines else 3
    if width < 3 or any(len(line) != width for line in lines):
        raise ValueError("vertices of different lengths")
    return np.array([float(word) for word in chain.from_iterable(lines)]).reshape(-1, width)
