"""Writes mesh files as other programs do: with materials, uv of corners, concave polygons, skins."""

from __future__ import annotations

import base64
import json
from pathlib import Path

import numpy as np

SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
TRIANGLE = np.array(SQUARE[:3], np.float32)


def accessor(view: int, array: np.ndarray, form: str, **more: object) -> dict[str, object]:
    kinds = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123, "uint32": 5125, "float32": 5126}
    return {"bufferView": view, "componentType": kinds[array.dtype.name], "count": len(array), "type": form, **more}


def write_gltf(path: Path, arrays: list[np.ndarray], inline: bool = False, stride: int = 0, **scene: object) -> None:
    """Write a scene with the arrays as buffer views; a stride is the first one's."""
    views, data = [], b""
    for array in arrays:
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        data += array.tobytes() + bytes(-array.nbytes % 4)
    views[0] |= {"byteStride": stride} if stride else {}
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode() if inline else "the%20data.bin"
    path.with_name("the data.bin").write_bytes(data)
    whole = {"asset": {"version": "2.0"}, "buffers": [{"byteLength": len(data), "uri": uri}], "bufferViews": views}
    path.write_text(json.dumps(whole | scene))


def write_skinned(path: Path, **changes: object) -> None:
    """A triangle with two joints: one moves it by 5 along x, one turns x to y. The mesh's own node is elsewhere."""
    used, weights = np.array([[0, 1, 0, 0]] * 3, np.uint8), np.zeros((3, 4), np.float32)
    weights[:, :2] = [[1, 0], [0, 2], [0.5, 0.5]]  # the second vertex's weights add up to 2
    inverse, normals = np.array([np.eye(4), np.eye(4)], np.float32), np.float32([[1, 0, 0]] * 3)
    inverse[0, 3, 1] = 2  # in column order: y grows by 2 before the joint moves it
    turn = [0, 0, np.sqrt(0.5), np.sqrt(0.5)]
    arrays = [TRIANGLE, used, weights, inverse.reshape(2, 16), normals]
    forms = ("VEC3", "VEC4", "VEC4", "MAT4", "VEC3")
    scene = {
        "accessors": [accessor(i, a, form) for i, (a, form) in enumerate(zip(arrays, forms, strict=True))],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "JOINTS_0": 1, "WEIGHTS_0": 2, "NORMAL": 4}}]}],
        "nodes": [{"mesh": 0, "skin": 0, "translation": [0, 0, 90]}, {"translation": [5, 0, 0]}, {"rotation": turn}],
        "skins": [{"joints": [1, 2], "inverseBindMatrices": 3}],
    }
    write_gltf(path, arrays, **(scene | changes))


def write_painted_obj(path: Path) -> None:
    """A square of two materials, which a file beside it describes."""
    path.with_suffix(".mtl").write_text("newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 0.5 0\n")
    corners = "".join(f"v {x} {y} {z}\n" for x, y, z in SQUARE)
    path.write_text(f"mtllib {path.stem}.mtl\n{corners}usemtl a\nf 1 2 3 # red\nusemtl b\nf 1 3 4\n")


def write_wedges_ply(path: Path) -> None:
    """A binary file with uv for each face's corners, as MeshLab writes it."""
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 4\n"
    head += "property float x\nproperty float y\nproperty float z\nelement face 1\n"
    head += "property list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n"
    body = np.array(SQUARE, "<f4").tobytes() + b"\4" + np.arange(4, dtype="<i4").tobytes()
    path.write_bytes(head.encode() + body + b"\x08" + np.linspace(0, 1, 8, dtype="<f4").tobytes())


def write_concave_off(path: Path) -> None:
    """A U-shaped polygon; the counts follow the keyword OFF without a space."""
    corners = [(0, 0), (4, 0), (4, 3), (3, 3), (3, 1), (1, 1), (1, 3), (0, 3)]
    path.write_text("OFF8 1 0\n" + "".join(f"{x} {y} 0\n" for x, y in corners) + "8 0 1 2 3 4 5 6 7 # all\n")
