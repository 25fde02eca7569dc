"""Triangle meshes, and their files through Open3D."""

from __future__ import annotations

import gzip
import tempfile
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyibr.core.checks import Fixed, check_tiled, describe, locked, numbers, one_of
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import checked_path, folder_for, reading
from pyibr.core.optional import open3d

Float32 = NDArray[np.float32]
Sides = Literal["both", "front", "back"]

_READ = (".glb", ".gltf", ".obj", ".off", ".ply", ".stl")
_WRITTEN = (".glb", ".obj", ".off", ".ply", ".stl")
_HEADER_MOST = 1 << 16  # bytes of a PLY file that its header ends in
_TEXTURED = (".glb", ".obj")
_COLORED = (".off", ".ply")
_OWN_PLACES = ("positions", "normals", "colors")  # of Open3D's vertex attributes: not in `attributes`


class Mesh(Fixed):
    """Triangles with what is known at their corners.

    Parameters
    ----------
    vertices : array_like (N, 3)
        In scene units, in the world. Kept as float32: see "far from the origin" in the manual's conventions.
    faces : array_like (M, 3), integers
        Corners of each triangle, counter-clockwise as seen from its front. Degenerate ones draw nothing.
    uv : array_like (N, 2) or (M, 3, 2), optional
        Of the vertices, or of each triangle's corners. v runs down the texture's rows, texel centres are at
        (i + 0.5) / n, and beyond 0 to 1 the texture repeats.
    normals : array_like (N, 3), optional
        Of the vertices, not zero; kept at unit length. The side they point to is lit as they say, the other as if
        they were turned round, whichever way the corners run.
    texture : (h, w, 3) uint8, or float32 in [0, 1], optional
        Drawn with 8 bits a channel. Needs uv.
    colors : (N, 3) uint8, or float32 in [0, 1], optional
        Of the vertices; not shown where there is a texture.
    sides : {"both", "front", "back"}
        Which sides of the triangles are drawn; the corners tell which is the front, not the normals.
    attributes : mapping of str to (N,) or (N, k) arrays, optional
        More numbers of the vertices, kept as float32 for other programs: `to_open3d` takes them along. Files
        do not hold them.

    Attributes
    ----------
    vertices, faces, uv, normals, texture, colors
        float32 and int32 arrays, a row per vertex; with uv per corner, vertices are split where it differs. Locked
        against writing through the mesh: buffers on the device are kept as well, so do not change the originals either.

    Raises
    ------
    ArgumentError
        If the arrays do not fit together.

    Examples
    --------
    >>> import pyibr as ibr
    >>> ibr.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    <Mesh 3 vertices, 1 triangle>
    """

    def __init__(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        uv: ArrayLike | None = None,
        normals: ArrayLike | None = None,
        texture: NDArray[Any] | None = None,
        colors: NDArray[Any] | None = None,
        sides: Sides = "both",
        attributes: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        one_of("sides", sides, Sides)
        self.sides: Sides = sides
        points = _in_float32("vertices", numbers("vertices", vertices, (None, 3)))
        corners = checked_faces(faces, len(points))
        along = None if normals is None else _checked_normals(normals, len(points))
        tints = None if colors is None else _checked_colors("colors", colors, (len(points), 3))
        places = None if uv is None else _checked_uv(uv, len(points), len(corners))
        others = {name: _checked_attribute(name, values, len(points)) for name, values in (attributes or {}).items()}
        if places is not None and places.ndim == 3:
            corners, kept, places = _split(corners, places)
            others = {name: values[kept] for name, values in others.items()}
            points = points[kept]
            along = None if along is None else along[kept]
            tints = None if tints is None else tints[kept]
        self.vertices: Float32 = locked(points)
        self.faces: NDArray[np.int32] = locked(corners)
        self.uv: Float32 | None = None if places is None else locked(places)
        self.normals: Float32 | None = None if along is None else locked(along)
        self.colors: NDArray[Any] | None = None if tints is None else locked(tints)
        self.attributes: dict[str, Float32] = {name: locked(values) for name, values in others.items()}
        if texture is not None and self.uv is None:
            raise ArgumentError("uv", "uv for the texture", "none")
        shown = None if texture is None else locked(_checked_colors("texture", texture, (None, None, 3)))
        if self.uv is not None:
            check_tiled(self.uv, (1, 1), shown)
        self.texture: NDArray[Any] | None = shown

    def __repr__(self) -> str:
        count = len(self.faces)
        texture = "" if self.texture is None else f", texture {self.texture.shape[1]}x{self.texture.shape[0]}"
        return f"<Mesh {len(self.vertices)} vertices, {count} triangle{'s' * (count != 1)}{texture}>"

    @cached_property
    def bounds(self) -> tuple[Float32, Float32]:
        """(low, high), each (3,): the box around the vertices that triangles use."""
        used = self.vertices[self.faces.ravel()]
        return used.min(axis=0), used.max(axis=0)

    @cached_property
    def smooth_normals(self) -> Float32:
        """(N, 3) unit normals: means of the triangles' by area, over all vertices at one place; (0, 0, 1) if none."""
        places, number = np.unique(self.vertices, axis=0, return_inverse=True)
        number = number.reshape(-1)
        corner = self.vertices.astype(np.float64)[self.faces]
        across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        sums = np.zeros((len(places), 3))
        for axis in range(3):
            weights = np.repeat(across[:, axis], 3)
            sums[:, axis] = np.bincount(number[self.faces].ravel(), weights, len(places))
        length = np.linalg.norm(sums, axis=1, keepdims=True)
        unit = np.where(length > 0, sums / np.where(length > 0, length, 1), (0.0, 0.0, 1.0))
        return locked(unit[number].astype(np.float32))

    @classmethod
    def load(cls, path: str | PathLike[str], texture: NDArray[Any] | None = None) -> Mesh:
        """Read a mesh: PLY, OBJ, GLB, GLTF, STL or OFF, also packed by gzip (``.ply.gz``).

        Parameters
        ----------
        path : path
        texture : (h, w, 3) uint8 or float32, optional
            Instead of the file's own.

        Raises
        ------
        FileFormatError
            If the file cannot be read as its suffix says, or holds no triangles.
        MissingPackageError
            If Open3D is not installed.
        """
        file = checked_path(path)
        packed = file.suffix.lower() == ".gz"
        kind = Path(file.stem).suffix.lower() if packed else file.suffix.lower()
        if kind not in _READ:
            raise FileFormatError(f"{file}: a mesh file ends in one of {', '.join(_READ)} (or .gz after it)")
        with reading(file, f"{kind[1:].upper()} mesh"), tempfile.TemporaryDirectory() as folder:
            source = file
            if packed:
                source = Path(folder) / f"mesh{kind}"
                source.write_bytes(gzip.decompress(file.read_bytes()))
            with _silent():
                found = _read(source)
            if not _has_triangles(found):
                raise FileFormatError(f"{file}: no triangles in it, or truncated")
            return cls.from_open3d(found, texture)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the mesh: OBJ and GLB with uv and texture, PLY, STL and OFF without. A missing folder is made.

        Raises
        ------
        ArgumentError
            If the suffix is another, or the format cannot hold the mesh's texture.
        FileFormatError
            If the file cannot be written.
        """
        file = checked_path(path)
        kind = file.suffix.lower()
        if kind not in _WRITTEN:
            raise ArgumentError("path", f"a file that ends in one of {', '.join(_WRITTEN)}", str(file))
        written_as = self
        if self.texture is not None and kind not in _TEXTURED:
            if self.colors is None or kind not in _COLORED:
                raise ArgumentError("path", f"a file that can hold the texture: {' or '.join(_TEXTURED)}", str(file))
            written_as = Mesh(self.vertices, self.faces, normals=self.normals, colors=self.colors)
        mesh = written_as.to_open3d()
        if kind == ".stl":
            mesh.compute_triangle_normals()
        folder_for(file)
        with _silent():
            written = open3d().t.io.write_triangle_mesh(str(file), mesh)
        if not written:
            raise FileFormatError(f"{file}: could not be written")

    def to_open3d(self) -> Any:
        """Return it as an `open3d.t.geometry.TriangleMesh`, whose v runs up."""
        o3d = open3d()
        mesh = o3d.t.geometry.TriangleMesh(np.array(self.vertices), np.array(self.faces))
        if self.normals is not None:
            mesh.vertex.normals = np.array(self.normals)
        if self.colors is not None and self.texture is None:  # others would multiply the two
            scale = np.float32(1 / 255 if self.colors.dtype == np.uint8 else 1)
            mesh.vertex.colors = (self.colors * scale).astype(np.float32)
        for name, values in self.attributes.items():
            mesh.vertex[name] = np.array(values).reshape(len(values), -1)
        if self.uv is not None:
            mesh.triangle.texture_uvs = np.ascontiguousarray(_turned(self.uv)[self.faces])
        if self.texture is not None:
            mesh.material.set_default_properties()
            mesh.material.material_name = "defaultLit"
            texture = self.texture
            if texture.dtype != np.uint8:
                texture = np.rint(texture * np.float32(255)).astype(np.uint8)
            mesh.material.texture_maps["albedo"] = o3d.t.geometry.Image(o3d.core.Tensor(np.ascontiguousarray(texture)))
        return mesh

    @classmethod
    def from_open3d(cls, mesh: Any, texture: NDArray[Any] | None = None) -> Mesh:
        """Take over an `open3d.t.geometry.TriangleMesh` or an `open3d.geometry.TriangleMesh`.

        Of several textures only the first is used.

        Parameters
        ----------
        mesh : TriangleMesh
        texture : (h, w, 3) uint8 or float32, optional
            Instead of its own.
        """
        if not hasattr(mesh, "to_legacy"):
            if not hasattr(mesh, "triangle_uvs"):
                raise ArgumentError("mesh", "an Open3D TriangleMesh", describe(mesh))
            mesh = open3d().t.geometry.TriangleMesh.from_legacy(mesh)
        if not _has_triangles(mesh):
            raise ArgumentError("mesh", "a mesh with triangles", describe(mesh))
        uv = _turned(mesh.triangle["texture_uvs"].numpy()) if "texture_uvs" in mesh.triangle else None
        if texture is None and uv is not None and mesh.has_valid_material():
            texture = _texture_of(mesh.material.texture_maps)
        normals = _usable_normals(mesh.vertex["normals"].numpy()) if "normals" in mesh.vertex else None
        colors = mesh.vertex["colors"].numpy() if "colors" in mesh.vertex else None
        if colors is not None and colors.dtype != np.uint8:  # of bytes, in most files
            colors = np.rint(np.clip(colors, 0, 1) * 255).astype(np.uint8)
        points, faces = mesh.vertex["positions"].numpy(), mesh.triangle["indices"].numpy()
        others = {name: mesh.vertex[name].numpy() for name in mesh.vertex if name not in _OWN_PLACES}
        others = {name: values for name, values in others.items() if np.isfinite(values).all()}
        return cls(points, faces, uv, normals, texture, colors, attributes=others)


def _read(source: Path) -> Any:
    o3d = open3d()
    # Open3D dies of bytes 0 in OBJ files and of PLY files without the end of their header.
    if source.suffix.lower() == ".obj" and b"\0" in source.read_bytes():
        raise ValueError("not text")
    if source.suffix.lower() == ".ply" and b"end_header" not in source.read_bytes()[:_HEADER_MOST]:
        raise ValueError("no end of the header")
    if source.suffix.lower() in _TEXTURED or source.suffix.lower() == ".gltf":
        return o3d.t.io.read_triangle_mesh(str(source))
    # The tensor reader takes bytes of colours for floats.
    mesh = o3d.io.read_triangle_mesh(str(source))
    return o3d.t.geometry.TriangleMesh.from_legacy(mesh) if mesh.has_triangles() else mesh


def _has_triangles(mesh: Any) -> bool:
    if not hasattr(mesh, "to_legacy"):
        return bool(mesh.has_triangles())
    return "positions" in mesh.vertex and "indices" in mesh.triangle and len(mesh.triangle["indices"]) > 0


def _texture_of(maps: Any) -> NDArray[Any] | None:
    if "albedo" not in maps:
        return None
    image = maps["albedo"].as_tensor().numpy()
    if not image.size:
        return None
    image = np.repeat(image, 3, axis=2) if image.shape[2] == 1 else image[..., :3]
    if image.dtype == np.uint16:
        return (image >> 8).astype(np.uint8)
    return image if image.dtype == np.uint8 else np.clip(image, 0, 1).astype(np.float32)


def _turned(uv: NDArray[Any]) -> Float32:
    """Open3D's uv of ours, and ours of Open3D's: v runs the other way."""
    return np.stack([uv[..., 0], 1 - uv[..., 1]], axis=-1).astype(np.float32)


def _usable_normals(normals: NDArray[Any]) -> NDArray[Any] | None:
    """A file's normals, if all of them point somewhere."""
    return normals if np.isfinite(normals).all() and (np.linalg.norm(normals, axis=1) > 0).all() else None


@contextmanager
def _silent() -> Generator[None, None, None]:
    """Open3D prints what it thinks of files."""
    utility = open3d().utility
    with utility.VerbosityContextManager(utility.VerbosityLevel.Error):
        yield


def _split(faces: NDArray[np.int32], uv: Float32) -> tuple[NDArray[np.int32], NDArray[np.intp], Float32]:
    """A vertex for each pair of vertex and uv: new faces, the old vertex of each new one, uv per vertex."""
    corners = np.column_stack([faces.ravel(), uv.reshape(-1, 2).view(np.int32)])
    found, number = np.unique(corners, axis=0, return_inverse=True)
    places = np.ascontiguousarray(found[:, 1:]).view(np.float32)
    return number.reshape(-1, 3).astype(np.int32), found[:, 0].astype(np.intp), places


def checked_faces(faces: ArrayLike, count: int) -> NDArray[np.int32]:
    """Return `faces` as (M, 3) numbers of `count` vertices, or raise ArgumentError."""
    expected = "integers of shape (M, 3), M >= 1"
    array = np.asarray(faces)
    if array.ndim != 2 or array.shape[1:] != (3,) or not len(array) or array.dtype.kind not in "iu":
        raise ArgumentError("faces", expected, describe(cast("object", array)))
    if array.min() < 0 or array.max() >= count:
        raise ArgumentError("faces", f"numbers of vertices, 0 to {count - 1}", f"{array.min()} to {array.max()}")
    return array.astype(np.int32)


def _checked_uv(uv: ArrayLike, vertices: int, faces: int) -> Float32:
    array = np.asarray(uv)
    shape = (faces, 3, 2) if array.ndim == 3 else (vertices, 2)
    return _in_float32("uv", numbers("uv", array, shape))


def _checked_attribute(name: str, values: ArrayLike, count: int) -> Float32:
    argument, array = f"attributes[{name!r}]", np.asarray(values)
    return _in_float32(argument, numbers(argument, array, (count, None)[: max(array.ndim, 1)]))


def _in_float32(argument: str, array: NDArray[np.float64]) -> Float32:
    most = float(np.finfo(np.float32).max)
    if array.size and np.abs(array).max() > most:
        raise ArgumentError(argument, f"numbers up to {most:g}, as float32 holds", f"{np.abs(array).max():g}")
    return array.astype(np.float32)


def _checked_normals(normals: ArrayLike, count: int) -> Float32:
    array = numbers("normals", normals, (count, 3))
    length = np.linalg.norm(array, axis=1, keepdims=True)
    if (length == 0).any():
        raise ArgumentError("normals", "normals that are not zero", f"{np.count_nonzero(length == 0)} that are")
    return (array / length).astype(np.float32)


def _checked_colors(argument: str, colors: NDArray[Any], shape: tuple[int | None, ...]) -> NDArray[Any]:
    expected = f"uint8, or float32 in [0, 1], of shape ({', '.join('n' if n is None else str(n) for n in shape)})"
    array = np.asarray(colors)
    if array.dtype == np.float64:
        array = array.astype(np.float32)
    fits = array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))
    if not fits or 0 in array.shape or array.dtype.name not in ("uint8", "float32"):
        raise ArgumentError(argument, expected, describe(cast("object", array)))
    if array.dtype == np.float32 and not (np.isfinite(array).all() and array.min() >= 0 and array.max() <= 1):
        raise ArgumentError(argument, expected, "values beyond [0, 1]")
    return array
