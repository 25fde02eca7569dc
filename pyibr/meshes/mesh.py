"""Triangle meshes, from arrays, files, trimesh and Open3D."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from os import PathLike
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyibr.core.checks import (
    Immutable,
    check_tiled,
    checked_colors,
    describe,
    instance_of,
    locked,
    numbers,
    one_of,
    plain_array,
)
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.optional import open3d
from pyibr.core.shown import Shown
from pyibr.images.srgb import in_bytes
from pyibr.io.image import without_alpha
from pyibr.io.mesh_arrays import MeshArrays
from pyibr.meshes.files import Axes, read_mesh, write_mesh
from pyibr.meshes.normals import areas, place_of, summed_at_corners, summed_at_places, unit_or_up

Float32 = NDArray[np.float32]
Sides = Literal["both", "front", "back"]

_OWN_PLACES = ("positions", "normals", "colors")  # Open3D's vertex attributes that `attributes` leaves out


class Mesh(Immutable, Shown):
    """Triangles with normals, colours, uv and further values at their vertices.

    Parameters
    ----------
    vertices : array_like (N, 3)
        Positions in the world, in scene units. Kept as float32: see "far from the origin" in the manual's conventions.
    faces : array_like (M, 3), integers
        Vertices of each triangle, counter-clockwise as seen from its front. Degenerate triangles draw nothing.
    uv : array_like (N, 2) or (M, 3, 2), optional
        uv of the vertices, or of each triangle's corners. v runs down the texture's rows, texel centres are at
        (i + 0.5) / n, and outside 0 to 1 the texture repeats.
    normals : array_like (N, 3), optional
        Normals of the vertices, not zero; kept at unit length. The side they point to is lit with them, the other side
        with the opposite normals, whichever way the corners run. Without normals, triangles are smooth across shared
        vertices and across vertices at one place, unless they face more than 60 degrees apart. A box whose sides have
        their own vertices therefore has sharp edges, and a box of eight vertices is shaded round.
    texture : (h, w, 3) uint8, or float32 in [0, 1], optional
        Drawn with 8 bits a channel. Needs uv.
    colors : (N, 3) uint8, or float32 in [0, 1], optional
        Colours of the vertices; not shown where there is a texture.
    sides : {"both", "front", "back"}
        Sides of the triangles to draw. The order of the corners decides which is the front, not the normals.
    attributes : mapping of str to (N,) or (N, k) arrays, optional
        Further values at the vertices, kept as float32 for other programs: `to_open3d` passes them on. Files do not
        store them.

    Attributes
    ----------
    vertices, faces, uv, normals, texture, colors
        float32 and int32 arrays, a row per vertex; with uv per corner, vertices are split where uv differs. The arrays
        are read-only, and buffers on the device are cached, so do not change the originals either.

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
        *,
        uv: ArrayLike | None = None,
        normals: ArrayLike | None = None,
        texture: NDArray[Any] | None = None,
        colors: NDArray[Any] | None = None,
        sides: Sides = "both",
        attributes: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        self.sides: Sides = one_of("sides", sides, Sides)
        points = _in_float32("vertices", numbers("vertices", vertices, (None, 3)))
        corners = checked_faces(faces, len(points))
        along = None if normals is None else _checked_normals(normals, len(points))
        tints = None if colors is None else checked_colors("colors", colors, (len(points), 3))
        places = None if uv is None else _checked_uv(uv, len(points), len(corners))
        named: Mapping[str, ArrayLike] = {} if attributes is None else attributes
        instance_of("attributes", named, Mapping, "arrays by name")
        others = {name: _checked_attribute(name, values, len(points)) for name, values in named.items()}
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
        shown = None if texture is None else locked(checked_colors("texture", texture, (None, None, 3)))
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
        is_used = np.zeros(len(self.vertices), np.bool_)
        is_used[self.faces.ravel()] = True
        used = self.vertices[is_used]
        return used.min(axis=0), used.max(axis=0)

    @cached_property
    def smooth_normals(self) -> Float32:
        """(N, 3) unit normals: area-weighted means over adjacent triangles; (0, 0, 1) at vertices without any.

        The mean is over all vertices at one place, as along seams of uv. Where their normals are more than 60 degrees
        apart, as along the edges of a box whose sides have their own vertices, each side keeps its own.
        """
        of_vertices = summed_at_corners(self.faces, areas(self.vertices, self.faces), len(self.vertices))
        sums, _ = summed_at_places(place_of(self.vertices), of_vertices)
        return locked(unit_or_up(sums).astype(np.float32))

    @classmethod
    def load(cls, path: str | PathLike[str], *, texture: NDArray[Any] | None = None, axes: Axes = "opencv") -> Mesh:
        """Read a mesh: PLY, OBJ, GLB, GLTF, STL or OFF, also packed by gzip (``.ply.gz``).

        Only the first of several textures is used. Without a texture, colours of materials become colours of
        vertices. Skins are applied in the pose of the scene's joints. Polygons are cut into triangles, concave ones by
        ear clipping. A UserWarning lists contents of the file that the mesh cannot hold.

        Parameters
        ----------
        path : path
        texture : (h, w, 3) uint8 or float32, optional
            Replaces the file's own.
        axes : {"opencv", "gltf"}
            Axes of the resulting mesh. As in `save`, they matter only for GLB and GLTF.

        Raises
        ------
        FileFormatError
            If the file is not readable in its suffix's format, holds no triangles, or holds a concave polygon of more
            than 2000 corners.

        Examples
        --------
        >>> import pyibr as ibr
        >>> ibr.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).save("triangle.glb")
        >>> ibr.Mesh.load("triangle.glb").vertices.tolist()
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
        >>> ibr.Mesh.load("triangle.glb", axes="gltf").vertices[2].tolist()  # what is down in OpenCV's world
        [0.0, -1.0, 0.0]
        """
        found = read_mesh(path, axes)
        own = found.texture if found.uv is not None else None
        try:
            return cls(
                found.vertices,
                found.faces,
                uv=found.uv,
                normals=found.normals,
                texture=own if texture is None else texture,
                colors=found.colors,
            )
        except ArgumentError as error:
            if texture is not None and error.argument in ("texture", "uv"):
                raise
            raise FileFormatError(f"{path}: {error}") from error

    def save(self, path: str | PathLike[str], *, axes: Axes = "opencv") -> None:
        """Write the whole mesh, or leave the old file. A missing folder is made.

        GLB stores everything except `attributes`. OBJ also lacks `sides`, PLY also lacks uv, OFF also lacks normals,
        and STL stores only triangles; without colours in their place, a UserWarning lists the arrays left out. If there
        is a texture, GLB and OBJ leave `colors` out. An OBJ file's texture and
        material are two more files. Their names begin with the OBJ's own and contain a checksum of the texture, so that
        they overwrite no other OBJ's files.

        Parameters
        ----------
        path : path
        axes : {"opencv", "gltf"}
            Axes of this mesh: "opencv" for x right, y down, z forward, as for pyibr's cameras and `DepthMesh`; "gltf"
            for a mesh in a world with y up and z towards the viewer. A GLB file always has glTF's axes, so that
            other programs show it upright. The other formats fix no axes: they store the mesh's numbers unchanged.

        Raises
        ------
        ArgumentError
            If the suffix is unknown.
        FileFormatError
            If the file cannot be written.
        """
        texture, colors = (None if image is None else in_bytes(image) for image in (self.texture, self.colors))
        arrays = MeshArrays(self.vertices, self.faces, self.uv, self.normals, colors, texture)
        write_mesh(path, arrays, axes, double_sided=self.sides == "both")

    def replaced(self, **arrays: Any) -> Mesh:
        """Return the mesh with other values for some of its attributes.

        Examples
        --------
        >>> import pyibr as ibr
        >>> mesh = ibr.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        >>> mesh.replaced(vertices=2 * mesh.vertices).vertices[1].tolist()
        [2.0, 0.0, 0.0]
        """
        names = "vertices", "faces", "uv", "normals", "texture", "colors", "sides", "attributes"
        return Mesh(**({name: getattr(self, name) for name in names} | arrays))

    def to_open3d(self) -> Any:
        """Return the mesh as an `open3d.t.geometry.TriangleMesh`, with v upwards."""
        o3d = open3d()
        mesh = o3d.t.geometry.TriangleMesh(np.array(self.vertices), np.array(self.faces))
        if self.normals is not None:
            mesh.vertex.normals = np.array(self.normals)
        if self.colors is not None and self.texture is None:  # other programs would multiply the two
            scale = np.float32(1 / 255 if self.colors.dtype == np.uint8 else 1)
            mesh.vertex.colors = (self.colors * scale).astype(np.float32)
        for name, values in self.attributes.items():
            mesh.vertex[name] = np.array(values).reshape(len(values), -1)
        if self.uv is not None:
            mesh.triangle.texture_uvs = np.ascontiguousarray(_turned(self.uv)[self.faces])
        if self.texture is not None:
            mesh.material.set_default_properties()
            mesh.material.material_name = "defaultLit"
            texture = np.ascontiguousarray(in_bytes(self.texture))
            mesh.material.texture_maps["albedo"] = o3d.t.geometry.Image(o3d.core.Tensor(texture))
        return mesh

    @classmethod
    def from_open3d(cls, mesh: Any, *, texture: NDArray[Any] | None = None) -> Mesh:
        """Take over an `open3d.t.geometry.TriangleMesh` or an `open3d.geometry.TriangleMesh`.

        Only the first of several textures is used.

        Parameters
        ----------
        mesh : TriangleMesh
        texture : (h, w, 3) uint8 or float32, optional
            Replaces the mesh's own.
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
        colors = None if colors is None else in_bytes(colors)  # most files hold 8-bit colours
        points, faces = mesh.vertex["positions"].numpy(), mesh.triangle["indices"].numpy()
        others = {name: mesh.vertex[name].numpy() for name in mesh.vertex if name not in _OWN_PLACES}
        others = {name: values for name, values in others.items() if np.isfinite(values).all()}
        return cls(points, faces, uv=uv, normals=normals, texture=texture, colors=colors, attributes=others)

    @classmethod
    def from_trimesh(cls, mesh: Any, *, texture: NDArray[Any] | None = None) -> Mesh:
        """Make a mesh from a `trimesh.Trimesh`, and so from all formats that trimesh reads.

        Any object with `vertices`, `faces` and, if it has colours, a `visual` like trimesh's is accepted. Normals are
        computed as for other meshes without normals. Transparent parts become opaque, with a UserWarning.

        Parameters
        ----------
        mesh : Trimesh
            For a scene, pass its `to_mesh()`. Colours come from vertices or faces, the texture, or the material.
        texture : (h, w, 3) uint8 or float32, optional
            Replaces the mesh's own.

        Raises
        ------
        ArgumentError
            If the mesh has no vertices or faces, or no uv for the texture.

        Examples
        --------
        >>> from types import SimpleNamespace
        >>> import pyibr as ibr
        >>> like_trimesh = SimpleNamespace(vertices=[[0, 0, 0], [1, 0, 0], [0, 1, 0]], faces=[[0, 1, 2]])
        >>> ibr.Mesh.from_trimesh(like_trimesh)
        <Mesh 3 vertices, 1 triangle>
        """
        arrays = _arrays_of_trimesh(mesh)
        if texture is not None:
            arrays["texture"] = texture
        return cls(arrays.pop("vertices"), arrays.pop("faces"), **arrays)


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
    image = without_alpha(image, "the texture")
    image = np.repeat(image, 3, axis=2) if image.shape[2] == 1 else image
    if image.dtype == np.uint16:
        return (image >> 8).astype(np.uint8)
    return image if image.dtype == np.uint8 else np.clip(image, 0, 1).astype(np.float32)


def _arrays_of_trimesh(mesh: Any) -> dict[str, Any]:
    """Arguments of `Mesh`; the `visual` of a `trimesh.Trimesh` provides texture and uv, or colours."""
    if not hasattr(mesh, "vertices") or not hasattr(mesh, "faces"):
        raise ArgumentError(
            "mesh", "a mesh with vertices and faces (for a trimesh.Scene, pass its to_mesh())", describe(mesh)
        )
    vertices = plain_array("mesh.vertices", mesh.vertices, "numbers of shape (N, 3)")
    faces = plain_array("mesh.faces", mesh.faces, "integers of shape (M, 3)")
    made = {"vertices": vertices, "faces": faces}
    visual = cast("Any", getattr(mesh, "visual", None))
    kind = getattr(visual, "kind", None)
    if kind == "texture":
        return made | _textured(visual, len(vertices))
    if kind == "vertex":
        return made | {"colors": _opaque(visual.vertex_colors)}
    if kind == "face":  # each face gets its own corners
        corners = np.arange(3 * len(faces)).reshape(-1, 3)
        colors = np.repeat(_opaque(visual.face_colors), 3, axis=0)
        return {"vertices": vertices[faces.ravel()], "faces": corners, "colors": colors}
    return made


def _textured(visual: Any, count: int) -> dict[str, Any]:
    """Arguments of `Mesh`: the texture, and uv with v turned down (in trimesh, v runs up).

    Without a picture or uv, the material's colour for each of `count` vertices, if it has one.
    """
    material = getattr(visual, "material", None)
    picture = getattr(material, "image", None)
    if picture is None:
        picture = getattr(material, "baseColorTexture", None)
    if picture is not None and visual.uv is not None:
        uv = np.array(visual.uv, np.float64)
        uv[:, 1] = 1 - uv[:, 1]
        return {"uv": uv, "texture": without_alpha(np.array(picture.convert("RGBA")), "the texture")}
    color = getattr(material, "main_color", None)
    return {} if color is None else {"colors": _opaque(np.tile(color, (count, 1)))}


def _opaque(values: Any) -> NDArray[Any]:
    """Colours without alpha, with a warning unless all is opaque."""
    return without_alpha(np.array(values), "the mesh")


def _turned(uv: NDArray[Any]) -> Float32:
    """Open3D's uv from pyibr's, or back: v runs the other way."""
    return np.stack([uv[..., 0], 1 - uv[..., 1]], axis=-1).astype(np.float32)


def _usable_normals(normals: NDArray[Any]) -> NDArray[Any] | None:
    """A file's normals, or None if any is zero or not finite."""
    return normals if np.isfinite(normals).all() and (np.linalg.norm(normals, axis=1) > 0).all() else None


def _split(faces: NDArray[np.int32], uv: Float32) -> tuple[NDArray[np.int32], NDArray[np.intp], Float32]:
    """Split vertices by uv: new faces, the old vertex of each new one, and uv per vertex."""
    corners = np.column_stack([faces.ravel(), uv.reshape(-1, 2).view(np.int32)])
    found, number = np.unique(corners, axis=0, return_inverse=True)
    places = np.ascontiguousarray(found[:, 1:]).view(np.float32)
    return number.reshape(-1, 3).astype(np.int32), found[:, 0].astype(np.intp), places


def checked_faces(faces: ArrayLike, count: int) -> NDArray[np.int32]:
    """Return `faces` as (M, 3) indices of `count` vertices, or raise ArgumentError."""
    expected = "integers of shape (M, 3), M >= 1"
    array = plain_array("faces", faces, expected)
    if array.ndim != 2 or array.shape[1:] != (3,) or not len(array) or array.dtype.kind not in "iu":
        raise ArgumentError("faces", expected, describe(array))
    if array.min() < 0 or array.max() >= count:
        raise ArgumentError("faces", f"numbers of vertices, 0 to {count - 1}", f"{array.min()} to {array.max()}")
    return array.astype(np.int32)


def _checked_uv(uv: ArrayLike, vertices: int, faces: int) -> Float32:
    array = plain_array("uv", uv, f"numbers of shape ({vertices}, 2) or ({faces}, 3, 2)")
    shape = (faces, 3, 2) if array.ndim == 3 else (vertices, 2)
    return _in_float32("uv", numbers("uv", array, shape))


def _checked_attribute(name: str, values: ArrayLike, count: int) -> Float32:
    argument = f"attributes[{name!r}]"
    array = plain_array(argument, values, f"numbers of shape ({count},) or ({count}, N)")
    return _in_float32(argument, numbers(argument, array, (count, None)[: max(array.ndim, 1)]))


def _in_float32(argument: str, array: NDArray[np.float64]) -> Float32:
    largest = float(np.finfo(np.float32).max)
    if array.size and np.abs(array).max() > largest:
        raise ArgumentError(argument, f"numbers up to {largest:g}, as float32 holds", f"{np.abs(array).max():g}")
    return array.astype(np.float32)


def _checked_normals(normals: ArrayLike, count: int) -> Float32:
    array = numbers("normals", normals, (count, 3))
    _in_float32("normals", array)
    length = np.linalg.norm(array, axis=1, keepdims=True)
    if (length == 0).any():
        raise ArgumentError("normals", "normals that are not zero", f"{np.count_nonzero(length == 0)} that are")
    return (array / length).astype(np.float32)
