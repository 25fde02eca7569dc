"""glTF 2.0: a JSON scene whose arrays lie in binary buffers; GLB holds both in one file.

All triangles of the scene are read, with the transforms of nodes and skins. They get the first base colour texture or,
without a texture, the colours of vertices and materials. Axes stay glTF's: y up, z towards the viewer.
"""

from __future__ import annotations

import base64
import json
import math
import struct
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, cast
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import checked_size, positive
from pyibr.core.conventions import CV_FROM_GL
from pyibr.core.errors import FileFormatError
from pyibr.core.files import check_unpacked, read_bytes, reading
from pyibr.images.srgb import in_bytes, linear_from_srgb, srgb_from_linear
from pyibr.io import image
from pyibr.io.mesh_arrays import MeshArrays, beside, texture_beside, texture_from

SUFFIXES = (".gltf", ".glb")

_MAGIC, _JSON, _BINARY = b"glTF", b"JSON", b"BIN\0"
_KINDS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_FLOAT, _UINT32 = 5126, 5125
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_WHITE = 1.0, 1.0, 1.0
_TIMES, _LITTLE = 50, 1 << 16
"""Limits for an accessor without a buffer: a multiple of the file's size, and a number of bytes."""
_KNOWN = ("KHR_materials_", "KHR_lights_", "KHR_mesh_quantization", "KHR_texture_transform", "EXT_texture_webp")
"""Prefixes of required extensions that are accepted: they are supported here, or do not affect triangles."""


def read_mesh(data: bytes, folder: Path) -> MeshArrays:
    """Return the mesh in a file's bytes."""
    scene, binary = _chunks_of(data)
    required = [name for name in scene.get("extensionsRequired", []) if not name.startswith(_KNOWN)]
    if required or not str(scene["asset"]["version"]).startswith("2."):
        raise ValueError(f"expected glTF 2.0 without {required[0] if required else 'other versions'}")
    return _Scene(scene, binary, folder, max(_TIMES * len(data), _LITTLE)).mesh()


def read_cameras(path: Path, size: tuple[int, int] | None) -> dict[str, Camera]:
    """The scene's cameras by node name, or node number, for pictures of this size; pixels are square."""
    width, height = checked_size(size)
    with reading(path, "glTF") as source:
        scene, _ = _chunks_of(read_bytes(source))
        if not str(scene["asset"]["version"]).startswith("2."):
            raise ValueError("expected glTF 2.0")
        found: dict[str, Camera] = {}
        for number, matrix in _node_matrices(scene).items():
            node = _item_of(scene, "nodes", number)
            if "camera" in node:
                camera = _item_of(scene, "cameras", node["camera"])
                fx, fy, projection = _scales(camera, width, height)
                K = [[fx, 0, (width - 1) / 2], [0, fy, (height - 1) / 2], [0, 0, 1]]
                matrix[:3, :3] /= np.linalg.norm(matrix[:3, :3], axis=0)  # without the node's scale
                made = Camera(K, (width, height), matrix @ CV_FROM_GL, projection=projection)
                found[str(node.get("name", number))] = made
    if not found:
        raise FileFormatError(f"{path}: no camera in its scene")
    return found


def _scales(camera: dict[str, Any], width: int, height: int) -> tuple[float, float, Any]:
    if camera["type"] == "perspective":
        focal = height / 2 / np.tan(positive("yfov", camera["perspective"]["yfov"]) / 2)
        return focal, focal, "perspective"
    half = [positive(name, camera["orthographic"][name]) for name in ("xmag", "ymag")]
    return width / 2 / half[0], height / 2 / half[1], "orthographic"


def mesh_bytes(mesh: MeshArrays, double_sided: bool) -> bytes:
    """Return a GLB file of one mesh."""
    writer = _Writer()
    attributes = {"POSITION": writer.add(mesh.vertices.astype("<f4"), _FLOAT, "VEC3", bounds=True)}
    if mesh.normals is not None:
        attributes["NORMAL"] = writer.add(mesh.normals.astype("<f4"), _FLOAT, "VEC3")
    if mesh.uv is not None:
        attributes["TEXCOORD_0"] = writer.add(mesh.uv.astype("<f4"), _FLOAT, "VEC2")
    if mesh.colors is not None:
        attributes["COLOR_0"] = writer.add(linear_from_srgb(mesh.colors / 255.0).astype("<f4"), _FLOAT, "VEC3")
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
    """The arrays of a file that is being written."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self._length = 0

    def view(self, data: bytes) -> int:
        """Append bytes; return the index of their view."""
        self.views.append({"buffer": 0, "byteOffset": self._length, "byteLength": len(data)})
        self.parts.append(data + bytes(-len(data) % 4))
        self._length += len(self.parts[-1])
        return len(self.views) - 1

    def add(self, array: NDArray[Any], kind: int, form: str, bounds: bool = False) -> int:
        """Append an array; return the index of its accessor."""
        accessor = {"bufferView": self.view(array.tobytes()), "componentType": kind, "count": len(array), "type": form}
        if bounds:
            accessor |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1


class _Scene:
    """Contents of a file."""

    def __init__(self, scene: dict[str, Any], binary: bytes | None, folder: Path, zeros_max: int) -> None:
        self._scene, self._folder, self._zeros_max = scene, folder, zeros_max
        self._buffers: list[bytes] = [self._buffer(buffer, binary) for buffer in scene.get("buffers", [])]
        self._arrays: dict[int, NDArray[Any]] = {}

    def mesh(self) -> MeshArrays:
        """All triangles of the scene as one mesh."""
        matrices, lost = _node_matrices(self._scene), dict[str, None]()
        drawn = list(self._drawn(matrices, lost))
        if not drawn:
            raise ValueError("no triangles in the scene")
        surfaces = [self._surface(primitive) for _, primitive in drawn]
        textures = list(dict.fromkeys(used["index"] for one in surfaces if (used := one.get("baseColorTexture"))))
        if textures[1:]:
            lost["all textures except the first"] = None
        if textures and any(_factor(one) != _WHITE for one in surfaces):
            lost["colours of materials"] = None
        if any(self._material(primitive).get("alphaMode", "OPAQUE") != "OPAQUE" for _, primitive in drawn):
            lost["transparency"] = None
        parts, first, size = list[MeshArrays](), 0, 0
        for (number, primitive), surface in zip(drawn, surfaces, strict=True):
            placing = self._placing(number, primitive, matrices)
            part = self._part(primitive, placing, first, _WHITE if textures else _factor(surface))
            first += len(part.vertices)
            size += 3 * part.vertices.nbytes + part.faces.nbytes  # nodes may repeat a mesh
            check_unpacked(size)
            parts.append(part)
        colors = _joined(parts, [part.colors for part in parts], 1)
        bare = any(part.normals is None for part in parts)
        return MeshArrays(
            np.concatenate([part.vertices for part in parts]),
            np.concatenate([part.faces for part in parts]),
            _joined(parts, [part.uv for part in parts], 0),
            None if bare else _joined(parts, [part.normals for part in parts], 0),
            None if colors is None else in_bytes(srgb_from_linear(colors.astype(np.float64))),
            self._texture(textures[0]) if textures else None,
            tuple(lost),
        )

    def _drawn(self, numbers: Iterable[int], lost: dict[str, None]) -> Iterator[tuple[int, dict[str, Any]]]:
        """Primitives of triangles, with their nodes' indices; `lost` collects other primitives and morph targets."""
        for number in numbers:
            node = _item_of(self._scene, "nodes", number)
            if "mesh" not in node:
                continue
            mesh = _item_of(self._scene, "meshes", node["mesh"])
            if any(node.get("weights", mesh.get("weights", []))):
                lost["morph targets"] = None
            for primitive in mesh["primitives"]:
                if primitive.get("mode", _TRIANGLES) in (_TRIANGLES, _STRIP, _FAN):
                    yield number, primitive
                else:
                    lost["points and lines"] = None

    def _placing(
        self, number: int, primitive: dict[str, Any], matrices: dict[int, NDArray[np.float64]]
    ) -> NDArray[np.float64]:
        """(4, 4) transform from a node's primitive to the scene; (N, 4, 4), one for each vertex, with a skin."""
        node, attributes = _item_of(self._scene, "nodes", number), primitive["attributes"]
        if "skin" not in node or "JOINTS_0" not in attributes:
            return matrices[number]
        skin = _item_of(self._scene, "skins", node["skin"])
        joints = np.stack([matrices[joint] for joint in skin["joints"]])
        if "inverseBindMatrices" in skin:
            joints = joints @ self._array(skin["inverseBindMatrices"], 16).reshape(-1, 4, 4).swapaxes(1, 2)
        sets = [one for one in range(len(attributes)) if f"JOINTS_{one}" in attributes]
        used = np.hstack([self._array(attributes[f"JOINTS_{one}"], 4) for one in sets])
        weights = np.hstack([self._array(attributes[f"WEIGHTS_{one}"], 4) for one in sets]).astype(np.float64)
        weights /= np.maximum(weights.sum(axis=1, keepdims=True), np.finfo(np.float64).tiny)
        placing = np.zeros((len(used), 4, 4))
        for joint, weight in zip(used.T, weights.T, strict=True):
            placing += weight[:, None, None] * joints[joint]
        return placing

    def _part(
        self, primitive: dict[str, Any], placing: NDArray[np.float64], first: int, factor: tuple[float, ...]
    ) -> MeshArrays:
        """A primitive's triangles, with vertices numbered from `first`; colours are linear floats."""
        attributes = primitive["attributes"]
        points = self._array(attributes["POSITION"], 3)
        normals = self._array(attributes["NORMAL"], 3) if "NORMAL" in attributes else None
        colors: Any = self._array(attributes["COLOR_0"], None)[:, :3] if "COLOR_0" in attributes else None
        if factor != _WHITE:
            colors = np.broadcast_to(factor, (len(points), 3)) * (1 if colors is None else colors)
        uv = self._uv(primitive)
        of_vertices = (uv, normals, colors, *([placing] if placing.ndim == 3 else []))
        if any(values is not None and len(values) != len(points) for values in of_vertices):
            raise ValueError("a primitive's attributes differ in length")
        indices = self._array(primitive["indices"], 1)[:, 0] if "indices" in primitive else np.arange(len(points))
        faces = _triangles(indices.astype(np.int64), primitive.get("mode", _TRIANGLES))
        if faces.size and faces.max() >= len(points):
            raise ValueError(f"a triangle with vertex {faces.max()}, of only {len(points)} vertices")
        if placing.ndim == 3 or (placing != np.eye(4)).any():
            points, normals, mirrored = _moved(points, normals, placing)
            faces = faces[:, ::-1] if mirrored else faces
        return MeshArrays(points, faces + first, uv, normals, colors)

    def _uv(self, primitive: dict[str, Any]) -> NDArray[Any] | None:
        """uv of the vertices in the base colour texture, with KHR_texture_transform."""
        used = self._surface(primitive).get("baseColorTexture", {})
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

    def _surface(self, primitive: dict[str, Any]) -> dict[str, Any]:
        """Description of a primitive's base colour."""
        return self._material(primitive).get("pbrMetallicRoughness", {})

    def _material(self, primitive: dict[str, Any]) -> dict[str, Any]:
        return _item_of(self._scene, "materials", primitive["material"]) if "material" in primitive else {}

    def _texture(self, number: Any) -> NDArray[np.uint8] | None:
        texture = _item_of(self._scene, "textures", number)
        webp = texture.get("extensions", {}).get("EXT_texture_webp", {})
        return self._image(_item_of(self._scene, "images", webp.get("source", texture.get("source"))))

    def _image(self, described: dict[str, Any]) -> NDArray[np.uint8] | None:
        if "bufferView" in described:
            return texture_from(self._view(described["bufferView"])[0])
        data = _inline(described) or texture_beside(self._folder, unquote(described["uri"]))
        return None if data is None else texture_from(data)

    def _array(self, number: int, width: int | None) -> NDArray[Any]:
        """An accessor's (N, width) numbers; normalised integers become floats."""
        if number not in self._arrays:
            self._arrays[number] = self._accessor(_item_of(self._scene, "accessors", number))
        array = self._arrays[number]
        if width is not None and array.shape[1] != width:
            raise ValueError(f"expected an accessor of width {width}, got {array.shape[1]}")
        return array

    def _accessor(self, accessor: dict[str, Any]) -> NDArray[Any]:
        kind, count = np.dtype(_KINDS[accessor["componentType"]]), accessor["count"]
        shape = (count, _WIDTHS[accessor["type"]])
        if "bufferView" in accessor:
            array = self._strided(accessor, kind, shape)
        else:
            if count * shape[1] * kind.itemsize > self._zeros_max:
                raise ValueError(f"an accessor of {count} entries without a buffer")
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
        """Numbers of a view; ValueError if the view is too short."""
        data, stride = self._view(place["bufferView"])
        row = kind.itemsize * shape[1]
        stride, start = stride or row, place.get("byteOffset", 0)
        if min(shape[0], start, stride - row) < 0 or start + (shape[0] - 1) * stride + row > len(data):
            raise ValueError(f"an accessor of {shape[0]} entries, more than its buffer holds")
        return np.ndarray(shape, kind, data, start, (stride, kind.itemsize))

    def _view(self, number: int) -> tuple[bytes, int]:
        """A view's bytes, and its stride, 0 for tightly packed entries."""
        view = _item_of(self._scene, "bufferViews", number)
        buffer = self._buffers[int(view["buffer"])]
        start, length = view.get("byteOffset", 0), view["byteLength"]
        if min(start, length) < 0 or start + length > len(buffer):
            raise ValueError("a view reaches beyond its buffer")
        return buffer[start : start + length], view.get("byteStride", 0)

    def _buffer(self, described: dict[str, Any], binary: bytes | None) -> bytes:
        data = binary
        if "uri" in described:
            data = _inline(described) or beside(self._folder, unquote(described["uri"]), "buffer")
        if data is None:
            raise ValueError(f"{described.get('uri', 'its buffer')[:100]} is missing, which holds its numbers")
        if len(data) < described["byteLength"]:
            raise ValueError(f"expected a buffer of {described['byteLength']} bytes, got {len(data)}")
        return data


def _node_matrices(scene: dict[str, Any]) -> dict[int, NDArray[np.float64]]:
    """Transforms from the nodes of the default scene to the scene, by node index."""
    nodes = scene.get("nodes", [])
    if "scenes" in scene:
        roots = _item_of(scene, "scenes", scene.get("scene", 0)).get("nodes", [])
    else:
        below = {child for node in nodes for child in node.get("children", [])}
        roots = [number for number in range(len(nodes)) if number not in below]
    waiting, found = [(number, np.eye(4)) for number in reversed(roots)], dict[int, NDArray[np.float64]]()
    while waiting:
        number, above = waiting.pop()
        if number in found:
            raise ValueError(f"node {number} occurs twice in the scene")
        node = _item_of(scene, "nodes", number)
        found[number] = above @ _matrix_of(node)
        waiting += [(child, found[number]) for child in reversed(node.get("children", []))]
    return found


def _item_of(scene: dict[str, Any], kind: str, number: Any) -> dict[str, Any]:
    """Return the entry of a list of the scene, by index."""
    if not isinstance(number, int) or not 0 <= number < len(scene.get(kind, [])):
        raise ValueError(f"{kind}[{number!r}] is missing")
    return scene[kind][number]


def _chunks_of(data: bytes) -> tuple[dict[str, Any], bytes | None]:
    """The JSON object, and the binary chunk of a GLB file."""
    if data[:4] != _MAGIC:
        return cast("dict[str, Any]", json.loads(data.decode("utf-8"))), None
    _, version, length = struct.unpack_from("<4sII", data)
    if version != 2 or length != len(data):
        raise ValueError(f"expected GLB version 2 of {len(data)} bytes, got version {version} of {length}")
    found, at = dict[bytes, bytes](), 12
    while at < length:
        size, kind = struct.unpack_from("<I4s", data, at)
        if at + 8 + size > length:
            raise ValueError("a chunk beyond the end of the file")
        found.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    return json.loads(found[_JSON].decode("utf-8")), found.get(_BINARY)


def _inline(described: dict[str, Any]) -> bytes | None:
    """The bytes in a data URI, or None if the URI is a file's name."""
    uri: str = described["uri"]
    return base64.b64decode(uri.partition(",")[2], validate=True) if uri.startswith("data:") else None


def _factor(surface: dict[str, Any]) -> tuple[float, ...]:
    """A material's base colour, which multiplies its texture or its vertices' colours; linear in light."""
    return tuple(float(value) for value in surface.get("baseColorFactor", _WHITE)[:3])


def _matrix_of(node: dict[str, Any]) -> NDArray[np.float64]:
    """Transform from a node to its parent."""
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


def _moved(
    points: NDArray[Any], normals: NDArray[Any] | None, placing: NDArray[np.float64]
) -> tuple[NDArray[Any], NDArray[Any] | None, bool]:
    """Transformed points and normals, and whether all are mirrored; placing: one matrix, or one for each point."""
    turn = placing[..., :3, :3]
    mirrored = np.linalg.det(turn) < 0
    points = (turn @ points[..., None])[..., 0] + placing[..., :3, 3]
    if normals is not None:
        across = np.cross(
            turn[..., (1, 2, 0), :], turn[..., (2, 0, 1), :]
        )  # the transposed inverse, times the determinant
        normals = (across @ normals[..., None])[..., 0] * np.where(mirrored, -1, 1)[..., None]
    return points, normals, bool(mirrored.all())


def _triangles(indices: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """Triangles (M, 3) of a list, a strip or a fan of vertices."""
    if mode == _TRIANGLES:
        return indices.reshape(-1, 3)
    if mode == _FAN:
        return np.column_stack([np.broadcast_to(indices[:1], len(indices[2:])), indices[1:-1], indices[2:]])
    strip = np.column_stack([indices[:-2], indices[1:-1], indices[2:]])
    strip[1::2, :2] = strip[1::2, 1::-1]  # every second triangle has the opposite direction
    return strip


def _joined(parts: list[MeshArrays], values: list[NDArray[Any] | None], otherwise: float) -> NDArray[Any] | None:
    """An attribute of all parts, filled with `otherwise` for parts without it; None if no part has it."""
    width = next((value.shape[1] for value in values if value is not None), 0)
    filled = [
        np.full((len(part.vertices), width), otherwise) if value is None else value
        for part, value in zip(parts, values, strict=True)
    ]
    return np.concatenate(filled) if width else None
