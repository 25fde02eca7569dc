"""Depth images of a triangle mesh, by ray casting.

A ray through each pixel centre hits the mesh, and the plane of the triangle gives the depth in float64. Depth images
are therefore as exact as float32 samples can be.
"""

from __future__ import annotations

import itertools
from functools import cached_property
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyibr.capture.clouds import CloudScene
from pyibr.core.camera import Camera, Projection
from pyibr.core.checks import (
    Float64,
    byte_color,
    checked_bool,
    checked_colors,
    describe,
    instance_of,
    integer_from,
    locked,
    numbers,
    one_of,
    plain_array,
)
from pyibr.core.errors import ArgumentError
from pyibr.core.rotations import upright_axes
from pyibr.gaussians import Gaussians
from pyibr.images import DepthImage
from pyibr.meshes.mesh import Mesh, checked_faces
from pyibr.meshes.normals import areas, summed_at_corners
from pyibr.raster.rays import triangles_met

Layer = Literal["first", "last"]
Int32 = NDArray[np.int32]

_SUN: Float64 = np.array([1.0, 0.98, 0.92])
_SHADOW: Float64 = np.array([0.30, 0.28, 0.34])
_UP = (0.0, -1.0, 0.0)
_LIGHT: Float64 = np.array([-0.45, 0.8, 0.4]) / np.linalg.norm([0.45, 0.8, 0.4])  # y is up


class MeshScene:
    """A triangle mesh ready to be captured from many cameras.

    Parameters
    ----------
    vertices : array_like (N, 3)
        In scene units, in the world.
    faces : array_like (M, 3), integers
    colors : array_like (N, 3), optional
        Colours of the vertices: uint8, or floats in [0, 1].
    uv : array_like (N, 2) or (M, 3, 2), optional
        Texture coordinates of the vertices, or of each face's corners. u runs along the texture's rows, v down its
        columns; texel centres are at (i + 0.5) / n. The texture repeats beyond 0 to 1.
    texture : (h, w, 3) uint8, optional
        Read bilinearly. Without a texture and colours, the surface is shaded by its smooth normals.
    base_color : (r, g, b), 0 to 255
        Colour of a shaded surface.
    normals : array_like (N, 3), optional
        Vertex normals, for images with normals; smooth normals by default.

    Attributes
    ----------
    up : (3,), or None
        Up direction of the world, along an axis: for the light on shaded surfaces (None: -y) and `object_cameras`.

    Raises
    ------
    ArgumentError
        If the arrays do not fit together.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> from pyibr.capture.raycast import MeshScene
    >>> square = MeshScene([[-1, -1, 3], [1, -1, 3], [-1, 1, 3], [1, 1, 3]], [[0, 1, 2], [3, 2, 1]])
    >>> view = square.capture(ibr.Camera([[20, 0, 5], [0, 20, 5], [0, 0, 1]], (11, 11)))
    >>> float(view.depth[5, 5])
    3.0
    """

    def __init__(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        *,
        colors: ArrayLike | None = None,
        uv: ArrayLike | None = None,
        texture: NDArray[np.uint8] | None = None,
        base_color: tuple[float, float, float] = (235, 190, 130),
        normals: ArrayLike | None = None,
    ) -> None:
        self.up: ArrayLike | None = None
        self.vertices: Float64 = numbers("vertices", vertices, (None, 3))
        self.faces = locked(checked_faces(faces, len(self.vertices)))
        self._texture = None if texture is None else _checked_texture(texture)
        self._colors = None if colors is None else _checked_colors(colors, len(self.vertices))
        self._uv = None if uv is None else _checked_uv(uv, self.faces, len(self.vertices))
        if (self._texture is None) != (self._uv is None):
            raise ArgumentError("uv", "uv and texture together, or neither", "only one of them")
        self._base_color = numbers("base_color", base_color, (3,))
        self._own_normals = None if normals is None else numbers("normals", normals, (len(self.vertices), 3))

    @classmethod
    def from_open3d(cls, mesh: Any, *, base_color: tuple[float, float, float] = (235, 190, 130)) -> MeshScene:
        """Take over an `open3d.geometry.TriangleMesh` or `open3d.t.geometry.TriangleMesh`.

        Only the first of several textures is used.
        """
        return cls.from_mesh(Mesh.from_open3d(mesh), base_color=base_color)

    @classmethod
    def from_mesh(cls, mesh: Mesh, *, base_color: tuple[float, float, float] = (235, 190, 130)) -> MeshScene:
        """Take over a `pyibr.Mesh`, with its texture or its colours."""
        texture = mesh.texture
        if texture is not None and texture.dtype != np.uint8:
            texture = np.rint(texture * np.float32(255)).astype(np.uint8)
        uv = mesh.uv if texture is not None else None
        return cls(
            mesh.vertices,
            mesh.faces,
            colors=mesh.colors,
            uv=uv,
            texture=texture,
            base_color=base_color,
            normals=mesh.normals,
        )

    @cached_property
    def _smooth(self) -> Float64:
        """Unit vertex normals (N, 3): sums of the faces' normals, weighted by area."""
        total = summed_at_corners(self.faces, areas(self.vertices, self.faces), len(self.vertices))
        return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), np.finfo(np.float64).tiny)

    @property
    def bounds(self) -> tuple[Float64, Float64]:
        """(low, high), each (3,), in the world: a box around the faces."""
        used = self.vertices[self.faces.ravel()]
        return used.min(axis=0), used.max(axis=0)

    def capture(
        self,
        camera: Camera,
        *,
        layer: Layer = "first",
        background: tuple[int, int, int] = (0, 0, 0),
        normals: bool = False,
    ) -> DepthImage:
        """Take a depth image.

        Parameters
        ----------
        camera : Camera
            Perspective or orthographic. Only surfaces in front of it (depth > 0) are seen.
        layer : "first" or "last"
            The nearest hit of each ray, or the farthest. Seen from inside a solid, the farthest hits form the wall
            that is visible from outside.
        background : (r, g, b), 0 to 255
            Colour where no surface is hit; depth is infinite there.
        normals : bool
            Whether the image also has normals, of the side that is seen.

        Returns
        -------
        DepthImage
            With uint8 colour.

        Raises
        ------
        ArgumentError
            If no ray hits the mesh.
        DeviceError
            No OpenCL device works.
        """
        instance_of("camera", camera, Camera, "a pyibr.Camera")
        one_of("layer", layer, Layer)
        checked_bool("normals", normals)
        around = byte_color("background", background)
        met = triangles_met(camera, self.vertices, self.faces, last=layer == "last")
        hit = np.flatnonzero(met >= 0)
        triangle = met[hit]
        origin, direction = _rays(camera, np.stack(np.unravel_index(hit, (camera.height, camera.width))[::-1], -1))
        corner = self.vertices[self.faces[triangle]]
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        with np.errstate(divide="ignore", invalid="ignore"):
            z = np.sum((corner[:, 0] - origin) * normal, 1) / np.sum(direction * normal, 1)
        # Where a triangle is seen edge-on or narrowly missed, the ray may meet its plane outside the triangle.
        corner_z = np.sum((corner - camera.center) * camera.forward, axis=2)
        z = np.clip(np.nan_to_num(z, nan=np.inf), corner_z.min(axis=1), corner_z.max(axis=1))
        seen = z > 0
        hit, triangle, z = hit[seen], triangle[seen], z[seen]
        if not len(hit):
            raise ArgumentError("camera", "a camera that sees the mesh", "one whose rays all miss it")
        weight = _barycentric(corner[seen], normal[seen], origin[seen] + z[:, None] * direction[seen])

        shape = camera.height, camera.width
        depth = np.full(shape, np.inf, np.float32)
        color = np.empty((*shape, 3), np.uint8)
        color[:] = around
        depth.reshape(-1)[hit] = z
        color.reshape(-1, 3)[hit] = np.clip(np.floor(self._color(triangle, weight) + 0.5), 0, 255)
        if not normals:
            return DepthImage(color, depth, camera)
        facing = np.full((*shape, 3), np.nan, np.float32)
        towards = -np.sign(np.sum(direction[seen] * normal[seen], 1, keepdims=True)) * normal[seen]
        facing.reshape(-1, 3)[hit] = self._normal(triangle, weight, towards) @ camera.world_from_camera[:3, :3]
        return DepthImage(color, depth, camera, normals=facing)

    def _normal(self, triangle: Int32, weight: Float64, towards: Float64) -> Float64:
        """Interpolate normals (n, 3) with weights (n, 3) in triangles (n,), on the side that faces `towards`."""
        corner = (self._smooth if self._own_normals is None else self._own_normals)[self.faces[triangle]]
        side = np.where(np.sum(corner.sum(axis=1) * towards, 1, keepdims=True) < 0, -1.0, 1.0)
        return side * np.einsum("nk,nkc->nc", weight, corner)

    def _color(self, triangle: Int32, weight: Float64) -> Float64:
        """Interpolate colours (n, 3), 0 to 255, with weights (n, 3) in triangles (n,)."""
        corner = self.faces[triangle]
        if self._texture is not None and self._uv is not None:
            return _bilinear(self._texture, np.einsum("nk,nkc->nc", weight, self._uv[triangle]))
        if self._colors is not None:
            return np.einsum("nk,nkc->nc", weight, self._colors[corner])
        normal = np.einsum("nk,nkc->nc", weight, self._smooth[corner])
        normal /= np.maximum(np.sqrt(np.einsum("nc,nc->n", normal, normal)), 1e-12)[:, None]
        return self._base_color * _light_on(normal @ upright_axes(self.up or _UP) @ _LIGHT)


def capture(
    mesh: Any,
    camera: Camera,
    *,
    layer: Layer = "first",
    background: tuple[int, int, int] = (0, 0, 0),
    normals: bool = False,
) -> DepthImage:
    """Take one depth image of a `Mesh`, a `MeshScene`, an Open3D triangle mesh or `Gaussians`.

    See `MeshScene.capture`. The surface of Gaussians is where they stop half of the light. For several cameras, make
    one `MeshScene` and call its `capture`.

    Examples
    --------
    >>> import pyibr as ibr
    >>> from pyibr.capture import capture, models
    >>> camera = ibr.Camera.look_at((0, 0, 4), (0, 0, 0), (0, 1, 0), (41, 41), fov_y=45)
    >>> view = capture(models.donut(), camera)
    >>> bool(view.valid[20, 32]), bool(view.valid[20, 20])  # the ring, and the hole in it
    (True, False)
    """
    return as_scene(mesh).capture(camera, layer=layer, background=background, normals=normals)


def as_scene(mesh: Any) -> MeshScene | CloudScene:
    """Return a scene to capture, from the argument `mesh` of `capture`."""
    if isinstance(mesh, (MeshScene, CloudScene)):
        return mesh
    if isinstance(mesh, Gaussians):
        return CloudScene(mesh)
    if isinstance(mesh, Mesh):
        return MeshScene.from_mesh(mesh)
    if not hasattr(mesh, "triangle_uvs") and not hasattr(mesh, "to_legacy"):
        raise ArgumentError("mesh", "a Mesh, a MeshScene, an Open3D TriangleMesh or Gaussians", describe(mesh))
    return MeshScene.from_open3d(mesh)


def _check_size(size: object, least: int) -> None:
    integer_from("size", cast("int", size), least, 1 << 31, f"at least {least} pixel{'s' * (least > 1)}")


def cube_cameras(center: ArrayLike, size: int) -> list[Camera]:
    """Make six cameras of 90 degrees with one centre, which look along +x, -x, +y, -y, +z and -z.

    The outermost pixel centres (0 and size - 1) lie exactly on the cube's edges, where neighbouring images share them,
    so that their triangulated grids meet without a gap.

    Parameters
    ----------
    center : array_like (3,)
        Position in the world.
    size : int
        Width and height of each image in pixels, at least 2.

    Examples
    --------
    >>> from pyibr.capture.raycast import cube_cameras
    >>> [camera.forward.round().astype(int).tolist() for camera in cube_cameras([0, 0, 0], 64)][:2]
    [[1, 0, 0], [-1, 0, 0]]
    """
    _check_size(size, 2)
    half = (size - 1) / 2
    x, y, z = np.eye(3)
    axes = [(-z, y, x), (z, y, -x), (x, -z, y), (x, z, -y), (x, y, z), (-x, y, -z)]  # right, down, forward
    cameras: list[Camera] = []
    for right, down, forward in axes:
        pose = np.eye(4)
        pose[:3] = np.column_stack([right, down, forward, numbers("center", center, (3,))])
        cameras.append(Camera([[half, 0, half], [0, half, half], [0, 0, 1]], (size, size), pose))
    return cameras


def spread_directions(count: int) -> Float64:
    """Unit vectors, (count, 3), spread evenly over the sphere."""
    integer_from("count", count, 1, 1 << 24)
    number = np.arange(count) + 0.5
    y = 1 - 2 * number / count
    angle = number * np.pi * (3 - np.sqrt(5))
    return np.column_stack([np.cos(angle) * np.sqrt(1 - y * y), y, np.sin(angle) * np.sqrt(1 - y * y)])


def object_views(
    mesh: Any, size: int, *, projection: Projection = "orthographic", margin: float = 0.02, normals: bool = False
) -> list[DepthImage]:
    """Take six depth images of an object from all sides, as if on the faces of a cube that look inwards.

    Parameters
    ----------
    mesh : Mesh, MeshScene, an Open3D triangle mesh or Gaussians
    size : int
        Width and height of each image in pixels.
    projection : "orthographic" or "perspective"
        Perspective cameras stand 2.5 cube edges from the middle.
    margin : float
        Free margin on all sides, as a share of the mesh's largest extent, >= 0.
    normals : bool
        Whether the images also have normals.

    Returns
    -------
    list of 6 DepthImage
        Images that look along x, -x, y, -y, z, -z. The background is infinitely far.

    Raises
    ------
    ArgumentError
        If an argument is out of range, or a view does not see the object, such as a plate seen edge-on.

    Examples
    --------
    >>> from pyibr.capture import models
    >>> from pyibr.capture.raycast import object_views
    >>> [view.camera.size for view in object_views(models.donut(), 32)]
    [(32, 32), (32, 32), (32, 32), (32, 32), (32, 32), (32, 32)]
    """
    scene, views = as_scene(mesh), list[DepthImage]()
    for number, camera in enumerate(object_cameras(scene, size, projection=projection, margin=margin)):
        try:
            views.append(scene.capture(camera, normals=normals))
        except ArgumentError as error:
            if error.argument != "camera":
                raise
            extents = np.subtract(*scene.bounds[::-1])
            pixel, listed = extents.max() * (1 + 2 * margin) / size, ", ".join(f"{extent:g}" for extent in extents)
            expected = f"an object that all six views see, thicker than a pixel of {pixel:.3g} (raise `size`)"
            got = f"extents of {listed}, unseen along {'xyz'[number // 2]}"
            raise ArgumentError("mesh", expected, got) from None
    return views


def object_cameras(
    mesh: Any, size: int, *, projection: Projection = "orthographic", margin: float = 0.02
) -> list[Camera]:
    """Make the cameras of `object_views`, from the same arguments."""
    scene = as_scene(mesh)
    one_of("projection", projection, Projection)
    if not float(numbers("margin", margin, ())) >= 0:
        raise ArgumentError("margin", "a number >= 0", describe(margin))
    _check_size(size, 1)
    low, high = scene.bounds
    edge = float((high - low).max()) * (1 + 2 * margin)
    if not edge > 0:
        raise ArgumentError("mesh", "a mesh of some extent", "vertices that are all at one point")
    away = 2.5 * edge if projection == "perspective" else 0.501 * edge
    # Perspective cameras see the whole front face of the cube, which is half an edge nearer than its middle.
    focal = size / edge * (1.0 if projection == "orthographic" else away - 0.5 * edge)
    K = [[focal, 0, (size - 1) / 2], [0, focal, (size - 1) / 2], [0, 0, 1]]
    middle, cameras = 0.5 * (low + high), list[Camera]()
    for axis, sign in itertools.product(range(3), (1, -1)):
        forward = np.zeros(3)
        forward[axis] = sign
        down = np.eye(3)[(axis + 1) % 3]
        if scene.up is not None:  # from above and below, opposite directions, which cancel in the set's up direction
            down = -np.asarray(scene.up) if np.dot(scene.up, forward) == 0 else sign * down
        pose = np.eye(4)
        pose[:3, :3] = np.column_stack([np.cross(down, forward), down, forward])
        pose[:3, 3] = middle - away * forward
        cameras.append(Camera(K, (size, size), pose, projection=projection))
    return cameras


def _rays(camera: Camera, pixel: NDArray[Any]) -> tuple[Float64, Float64]:
    """Return origins and directions (n, 3) of rays in the world; a step of 1 along a direction is 1 in planar z."""
    one = camera.unproject(pixel, np.ones(len(pixel)))
    if camera.projection == "perspective":
        return np.broadcast_to(camera.center, one.shape), one - camera.center
    return one - camera.forward, np.broadcast_to(camera.forward, one.shape)


def _checked_texture(texture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    array = plain_array("texture", texture, "uint8 of shape (h, w, 3)")
    if array.dtype != np.uint8 or array.ndim != 3 or array.shape[2] != 3 or not array.size:
        raise ArgumentError("texture", "uint8 of shape (h, w, 3)", describe(array))
    return array


def _checked_colors(colors: ArrayLike, count: int) -> Float64:
    array = checked_colors("colors", colors, (count, 3))
    return array.astype(np.float64) * (1 if array.dtype == np.uint8 else 255)


def _checked_uv(uv: ArrayLike, faces: Int32, count: int) -> Float64:
    array = plain_array("uv", uv, f"numbers of shape ({count}, 2) or ({len(faces)}, 3, 2)")
    if array.shape == (count, 2):
        return numbers("uv", array, (None, 2))[faces]
    if array.shape == (len(faces), 3, 2):
        return numbers("uv", array, (None, 3, 2))
    raise ArgumentError("uv", f"shape ({count}, 2) or ({len(faces)}, 3, 2)", describe(array))


def _light_on(lambert: Float64) -> Float64:
    """Return the colours (n, 3) of sunlight on surfaces, from the cosines (n,) of its angle to their normals."""
    light = 0.15 + 0.85 * np.maximum(lambert, 0) + 0.15 * np.minimum(lambert, 0)
    return _SHADOW + (_SUN - _SHADOW) * light[:, None]


def _barycentric(corner: Float64, normal: Float64, point: Float64) -> Float64:
    """Barycentric weights (n, 3) of points on triangles (n, 3, 3), clamped to the triangles."""
    squared = np.maximum(np.sum(normal * normal, 1), np.finfo(np.float64).tiny)
    following, last = np.roll(corner, -1, axis=1), np.roll(corner, -2, axis=1)
    opposite = np.cross(last - following, point[:, None] - following)
    weight = np.clip(np.einsum("nkc,nc->nk", opposite, normal) / squared[:, None], 0, 1)
    total = weight.sum(axis=1, keepdims=True)
    return np.where(total > 0, weight / np.maximum(total, 1e-12), 1 / 3)


def _bilinear(image: NDArray[np.uint8], uv: Float64) -> Float64:
    """Bilinear colours (n, 3) of a repeating image at uv (n, 2)."""
    size = np.array([image.shape[1], image.shape[0]])
    at = (uv - np.floor(uv)) * size - 0.5
    low = np.floor(at)
    (fx, fy), (x, y) = (at - low).T[..., None], low.astype(np.int64).T % size[:, None]
    right, down = (x + 1) % size[0], (y + 1) % size[1]
    top = (1 - fx) * image[y, x] + fx * image[y, right]
    return (1 - fy) * top + fy * ((1 - fx) * image[down, x] + fx * image[down, right])
