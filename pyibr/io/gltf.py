"""glTF 2.0: JSON that describes a scene and where in binary buffers its arrays lie; GLB holds both in one file.

Of a scene all triangles are read, at their places in it, with the first texture that shows their base colour.
Its axes are left as they are: y up, z towards the viewer.
"""

from __future__ import annotations

import base64
import json
import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from pyibr.core.files import check_unpacked
from pyibr.io import image
from pyibr.io.mesh_arrays import MeshArrays, beside, color_bytes, texture_beside, texture_from

_MAGIC, _JSON, _BINARY = b"glTF", b"JSON", b"BIN\0"
_KINDS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_FLOAT, _UINT32 = 5126, 5125
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_KNOWN = ("KHR_materials_", "KHR_lights_", "KHR_mesh_quantization", "KHR_texture_transform", "EXT_texture_webp")
"""How the extensions open that a file may require: what they add is read here, or is no matter of triangles."""


def read_mesh(data: bytes, folder: Path) -> MeshArrays:
    """Return the mesh that a file's bytes hold."""
    scene, binary = _chunks(data)
    required = [name for name in scene.get("extensionsRequired", []) if not name.startswith(_KNOWN)]
    if required or not str(scene["asset"]["version"]).startswith("2."):
        raise ValueError(f"expected glTF 2.0 without {required[0] if required else 'other versions'}")
    return _Scene(scene, binary, folder).mesh()


def mesh_bytes(mesh: MeshArrays, double_sided: bool) -> bytes:
    """Return a GLB file of one mesh."""
    writer = _Writer()
    attributes = {"POSITION": writer.add(mesh.vertices.astype("<f4"), _FLOAT, "VEC3", bounds=True)}
    if mesh.normals is not None:
        attributes["NORMAL"] = writer.add(mesh.normals.astype("<f4"), _FLOAT, "VEC3")
    if mesh.uv is not None:
        attributes["TEXCOORD_0"] = writer.add(mesh.uv.astype("<f4"), _FLOAT, "VEC2")
    if mesh.colors is not None:
        attributes["COLOR_0"] = writer.add(_linear(mesh.colors).astype("<f4"), _FLOAT, "VEC3")
    indices = writer.add(mesh.faces.astype("<u4").ravel(), _UINT32, "SCALAR")
    surface: dict[str, Any] = {"metallicFactor": 0, "roughnessFactor": 1}
    scene: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "pyibr"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": indices, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": surface, "doubleSided": double_sided}],
        "accessors": writer.accessors,
        "bufferViews": writer.views,
    }
    if mesh.texture is not None:
        scene["images"] = [{"bufferView": writer.view(image.encoded(mesh.texture, ".png")), "mimeType": "image/png"}]
        scene["textures"] = [{"source": 0}]
        surface["baseColorTexture"] = {"index": 0}
    binary = b"".join(writer.parts)
    scene["buffers"] = [{"byteLength": len(binary)}]
    text = json.dumps(scene).encode("ascii")
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), _JSON) + text + struct.pack("<I4s", len(binary), _BINARY) + binary
    return struct.pack("<4sII", _MAGIC, 2, 12 + len(chunks)) + chunks


class _Writer:
    """The arrays of a file in the making."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self._length = 0

    def view(self, data: bytes) -> int:
        """Append bytes; return the number of their view."""
        self.views.append({"buffer": 0, "byteOffset": self._length, "byteLength": len(data)})
        self.parts.append(data + bytes(-len(data) % 4))
        self._length += len(self.parts[-1])
        return len(self.views) - 1

    def add(self, array: NDArray[Any], kind: int, form: str, bounds: bool = False) -> int:
        """Append an array; return the number of its accessor."""
        accessor = {"bufferView": self.view(array.tobytes()), "componentType": kind, "count": len(array), "type": form}
        if bounds:
            accessor |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1


class _Scene:
    """Contents of a file."""

    def __init__(self, scene: dict[str, Any], binary: bytes | None, folder: Path) -> None:
        self._scene, self._folder = scene, folder
        self._buffers: list[bytes] = [self._buffer(buffer, binary) for buffer in scene.get("buffers", [])]
        self._arrays: dict[int, NDArray[Any]] = {}

    def mesh(self) -> MeshArrays:
        """All triangles of the scene, in one."""
        parts, first, size = list[MeshArrays](), 0, 0
        for matrix, number in self._placed():
            for primitive in self._item("meshes", number)["primitives"]:
                if primitive.get("mode", _TRIANGLES) in (_TRIANGLES, _STRIP, _FAN):
                    part = self._part(primitive, matrix, first)
                    first += len(part.vertices)
                    size += 3 * part.vertices.nbytes + part.faces.nbytes  # a mesh may stand in many places
                    check_unpacked(size)
                    parts.append(part)
        if not parts:
            raise ValueError("no triangles in it")
        return MeshArrays(
            np.concatenate([part.vertices for part in parts]),
            np.concatenate([part.faces for part in parts]),
            _joined(parts, [part.uv for part in parts], 0),
            None
            if any(part.normals is None for part in parts)
            else _joined(parts, [part.normals for part in parts], 0),
            _shown(_joined(parts, [part.colors for part in parts], 1)),
            self._texture(),
        )

    def _placed(self) -> Iterator[tuple[NDArray[np.float64], int]]:
        """The meshes' numbers, and the matrices from each to the scene."""
        nodes = self._scene.get("nodes", [])
        if "scenes" in self._scene:
            roots = self._item("scenes", self._scene.get("scene", 0)).get("nodes", [])
        else:
            below = {child for node in nodes for child in node.get("children", [])}
            roots = [number for number in range(len(nodes)) if number not in below]
        waiting, seen = [(number, np.eye(4)) for number in reversed(roots)], set[int]()
        while waiting:
            number, above = waiting.pop()
            if number in seen:
                raise ValueError(f"node {number} has two places in the scene")
            seen.add(number)
            node = self._item("nodes", number)
            matrix = above @ _matrix_of(node)
            if "mesh" in node:
                yield matrix, node["mesh"]
            waiting += [(child, matrix) for child in reversed(node.get("children", []))]

    def _part(self, primitive: dict[str, Any], matrix: NDArray[np.float64], first: int) -> MeshArrays:
        """A primitive's triangles, whose vertices' numbers begin with `first`; colours are linear floats."""
        attributes = primitive["attributes"]
        points = self._array(attributes["POSITION"], 3)
        normals = self._array(attributes["NORMAL"], 3) if "NORMAL" in attributes else None
        colors = self._array(attributes["COLOR_0"], None)[:, :3] if "COLOR_0" in attributes else None
        uv = self._uv(primitive)
        if any(values is not None and len(values) != len(points) for values in (uv, normals, colors)):
            raise ValueError("a primitive's attributes differ in length")
        indices = self._array(primitive["indices"], 1)[:, 0] if "indices" in primitive else np.arange(len(points))
        faces = _triangles(indices.astype(np.int64), primitive.get("mode", _TRIANGLES))
        if faces.size and faces.max() >= len(points):
            raise ValueError(f"a triangle of vertex {faces.max()}, of {len(points)}")
        turn = matrix[:3, :3]
        if (matrix != np.eye(4)).any():
            points = points @ turn.T + matrix[:3, 3]
            normals = None if normals is None else normals @ np.linalg.inv(turn)
            faces = faces[:, ::-1] if np.linalg.det(turn) < 0 else faces
        return MeshArrays(points, faces + first, uv, normals, colors)

    def _uv(self, primitive: dict[str, Any]) -> NDArray[Any] | None:
        """Positions of the vertices in the base colour's texture (KHR_texture_transform)."""
        used = self._base_texture(primitive)
        moved = used.get("extensions", {}).get("KHR_texture_transform", {})
        name = f"TEXCOORD_{moved.get('texCoord', used.get('texCoord', 0))}"
        if name not in primitive["attributes"]:
            return None
        uv = self._array(primitive["attributes"][name], 2)
        if not moved:
            return uv
        angle = moved.get("rotation", 0.0)
        turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
        return (uv * np.array(moved.get("scale", (1, 1)))) @ turn.T + np.array(moved.get("offset", (0, 0)))

    def _base_texture(self, primitive: dict[str, Any]) -> dict[str, Any]:
        if "material" not in primitive:
            return {}
        material = self._item("materials", primitive["material"])
        return material.get("pbrMetallicRoughness", {}).get("baseColorTexture", {})

    def _texture(self) -> NDArray[np.uint8] | None:
        """The first texture of the scene's triangles."""
        for _, number in self._placed():
            for primitive in self._item("meshes", number)["primitives"]:
                used = self._base_texture(primitive)
                if used:
                    texture = self._item("textures", used["index"])
                    webp = texture.get("extensions", {}).get("EXT_texture_webp", {})
                    return self._image(self._item("images", webp.get("source", texture.get("source"))))
        return None

    def _image(self, described: dict[str, Any]) -> NDArray[np.uint8] | None:
        if "bufferView" in described:
            return texture_from(self._view(described["bufferView"])[0])
        inline = _inline(described)
        return texture_from(inline) if inline else texture_beside(self._folder, unquote(described["uri"]))

    def _array(self, number: int, width: int | None) -> NDArray[Any]:
        """An accessor's (N, width) numbers, which normalised integers tell as floats."""
        if number not in self._arrays:
            self._arrays[number] = self._accessor(self._item("accessors", number))
        array = self._arrays[number]
        if width is not None and array.shape[1] != width:
            raise ValueError(f"an accessor of width {array.shape[1]} where {width} belongs")
        return array

    def _accessor(self, accessor: dict[str, Any]) -> NDArray[Any]:
        kind, count = np.dtype(_KINDS[accessor["componentType"]]), accessor["count"]
        shape = (count, _WIDTHS[accessor["type"]])
        if "bufferView" in accessor:
            array = self._strided(accessor, kind, shape)
        else:
            check_unpacked(count * shape[1] * kind.itemsize)
            array = np.zeros(shape, kind)
        if "sparse" in accessor:
            sparse, array = accessor["sparse"], array.copy()
            places = self._strided(
                sparse["indices"], np.dtype(_KINDS[sparse["indices"]["componentType"]]), (sparse["count"], 1)
            )
            array[places[:, 0]] = self._strided(sparse["values"], kind, (sparse["count"], shape[1]))
        if accessor.get("normalized") and kind.kind in "iu":
            return np.maximum(array / np.float64(np.iinfo(kind).max), -1)
        return array

    def _strided(self, place: dict[str, Any], kind: np.dtype[Any], shape: tuple[int, int]) -> NDArray[Any]:
        """Numbers of a view; ValueError if it does not hold so many."""
        data, stride = self._view(place["bufferView"])
        row = kind.itemsize * shape[1]
        stride, start = stride or row, place.get("byteOffset", 0)
        if min(shape[0], start, stride - row) < 0 or start + (shape[0] - 1) * stride + row > len(data):
            raise ValueError(f"an accessor of {shape[0]} entries, which is more than its buffer holds")
        return np.ndarray(shape, kind, data, start, (stride, kind.itemsize))

    def _view(self, number: int) -> tuple[bytes, int]:
        """A view's bytes, and the step from entry to entry, 0 if there is nothing between them."""
        view = self._item("bufferViews", number)
        buffer = self._buffers[int(view["buffer"])]
        start, length = view.get("byteOffset", 0), view["byteLength"]
        if min(start, length) < 0 or start + length > len(buffer):
            raise ValueError("a view beyond its buffer")
        return buffer[start : start + length], view.get("byteStride", 0)

    def _buffer(self, described: dict[str, Any], binary: bytes | None) -> bytes:
        data = binary
        if "uri" in described:
            data = _inline(described) or beside(self._folder, unquote(described["uri"]), "buffer")
        if data is None or len(data) < described["byteLength"]:
            raise ValueError(f"a buffer of {0 if data is None else len(data)} bytes, of {described['byteLength']}")
        return data

    def _item(self, kind: str, number: Any) -> dict[str, Any]:
        if not isinstance(number, int) or not 0 <= number < len(self._scene.get(kind, [])):
            raise ValueError(f"{kind}[{number!r}], which is not there")
        return self._scene[kind][number]


def _chunks(data: bytes) -> tuple[dict[str, Any], bytes | None]:
    """The JSON, and the binary chunk of a GLB file."""
    if data[:4] != _MAGIC:
        return cast("dict[str, Any]", json.loads(data.decode("utf-8"))), None
    _, version, length = struct.unpack_from("<4sII", data)
    if version != 2 or length != len(data):
        raise ValueError(f"GLB version {version} of {length} bytes, where {len(data)} are")
    found, at = dict[bytes, bytes](), 12
    while at < length:
        size, kind = struct.unpack_from("<I4s", data, at)
        if at + 8 + size > length:
            raise ValueError("a chunk beyond the end of the file")
        found.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    return json.loads(found[_JSON].decode("utf-8")), found.get(_BINARY)


def _inline(described: dict[str, Any]) -> bytes | None:
    """The bytes that an address holds itself, or None if it is the name of a file."""
    uri: str = described["uri"]
    return base64.b64decode(uri.partition(",")[2], validate=True) if uri.startswith("data:") else None


def _matrix_of(node: dict[str, Any]) -> NDArray[np.float64]:
    """From a node to the one above."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = (float(value) for value in node.get("rotation", (0, 0, 0, 1)))
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.array(node.get("scale", (1, 1, 1)), np.float64)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


def _triangles(indices: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """(M, 3): the triangles of a list, a strip or a fan of vertices."""
    if mode == _TRIANGLES:
        return indices.reshape(-1, 3)
    if mode == _FAN:
        return np.column_stack([np.broadcast_to(indices[:1], len(indices[2:])), indices[1:-1], indices[2:]])
    strip = np.column_stack([indices[:-2], indices[1:-1], indices[2:]])
    strip[1::2, :2] = strip[1::2, 1::-1]  # every second runs the other way
    return strip


def _joined(parts: list[MeshArrays], values: list[NDArray[Any] | None], otherwise: float) -> NDArray[Any] | None:
    """An attribute of all parts, with `otherwise` for those that lack it; None if all do."""
    width = next((value.shape[1] for value in values if value is not None), 0)
    filled = [
        np.full((len(part.vertices), width), otherwise) if value is None else value
        for part, value in zip(parts, values, strict=True)
    ]
    return np.concatenate(filled) if width else None


def _linear(colors: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Colours as screens show them, as glTF's vertices have them: linear in light (sRGB, IEC 61966-2-1)."""
    shown = colors / 255.0
    return np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)


def _shown(linear: NDArray[Any] | None) -> NDArray[np.uint8] | None:
    """The way back."""
    if linear is None:
        return None
    light = np.clip(np.nan_to_num(linear.astype(np.float64)), 0, 1)
    return color_bytes(np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055))
