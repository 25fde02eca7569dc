"""STL: triangles that share no vertices; binary, or text."""

from __future__ import annotations

from itertools import chain
from pathlib import Path

import numpy as np

from pyibr.io.mesh_arrays import MeshArrays

_HEAD = 80  # arbitrary bytes before the count
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_mesh(data: bytes, folder: Path) -> MeshArrays:
    """Return the mesh in a file's bytes."""
    start = _HEAD + 4
    count = int.from_bytes(data[_HEAD:start], "little")
    if len(data) >= start and len(data) == start + count * _TRIANGLE.itemsize:
        points = np.frombuffer(data, _TRIANGLE, count, start)["corners"].reshape(-1, 3)
    elif data[:_HEAD].lstrip()[:5].lower() == b"solid":
        points = _text(data)
    else:
        raise ValueError(f"expected the size of {count} triangles, got {len(data)} bytes")
    return MeshArrays(points, np.arange(len(points)).reshape(-1, 3))


def mesh_bytes(mesh: MeshArrays) -> bytes:
    """Return a binary file with the triangles' corners and normals."""
    triangles = np.zeros(len(mesh.faces), _TRIANGLE)
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(across, axis=1, keepdims=True)
    triangles["normal"], triangles["corners"] = across / np.where(length > 0, length, 1), corners
    return bytes(_HEAD) + len(triangles).to_bytes(4, "little") + triangles.tobytes()


def _text(data: bytes) -> np.ndarray:
    lines = [words for line in data.decode("latin-1").lower().splitlines() if (words := line.split())]
    opened, closed = (sum(line[0] == word for line in lines) for word in ("facet", "endfacet"))
    corners = [line[1:] for line in lines if line[0] == "vertex"]
    if lines[-1][0] != "endsolid" or opened != closed or len(corners) != 3 * opened:
        raise ValueError(f"{opened} triangles begin, {closed} end, with {len(corners)} corners in all")
    if any(len(words) != 3 for words in corners):
        raise ValueError("a corner that is not three numbers")
    return np.array([float(word) for word in chain.from_iterable(corners)]).reshape(-1, 3)
