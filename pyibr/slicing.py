"""Displacement mapping by slices, and objects from images (Kautz & Seidel 2001): what is drawn, and how it is prepared.

`SlicedSurface` displaces a mesh by a height map. `DepthObject` is what six (or more, or fewer) depth images leave of
space, `VisualHull` what silhouettes leave. `pyibr.render` draws them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, cast, get_args
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyibr._check import checked_image, describe, numbers, one_of, positive
from pyibr.boxes import Box, box_of_samples, box_of_silhouettes, nearness_map
from pyibr.camera import Camera
from pyibr.errors import ArgumentError
from pyibr.images import DepthImage
from pyibr.light import Light
from pyibr.mesh import Mesh
from pyibr.prisms import Volume, extruded
from pyibr.raster import BIN, bin_primitives, project, rgba_words
from pyibr.silhouette import Silhouette, is_opposite
from pyibr.target import Target

Slicing = Literal["surface", "orthogonal", "screen"]
ObjectSlicing = Literal["orthogonal", "screen"]
AlphaTest = Literal["inside", "at_least", "band"]
Texture = Literal["visible", "naive"]
Float32 = NDArray[np.float32]

if TYPE_CHECKING:
    from pyibr.opencl.memory import DeviceArray

_SLICES_MOST = 65536
_HALVINGS_MOST = 24  # float32 holds no more
_SLICINGS = {name: number for number, name in enumerate(get_args(Slicing))}  # SURFACE ... of kernels/slicing/
_TESTS = {"at_least": 0, "band": 1, "inside": 2}  # kernels/slicing/heights.h
_TO_SCREEN = 3  # the axis of slices parallel to the screen, kernels/slicing/object.cl
_BEFORE = 2.0  # slices and samples by which a view's surface may lie before a point that it still shows
_BOX = np.dtype([("from_world", np.float32, 12), ("edges", np.float32, 3), ("spacing", np.float32)])


class SlicedSurface:
    """A mesh displaced along its normals by a height map, drawn by slices.

    Parameters
    ----------
    base : Mesh
        With uv; a single polygon or any surface. It is displaced along its normals, or its smooth ones.
    height : (h, w) float32 in [0, 1], or uint8, uint16
        0 is the base, 1 is `scale` above it. Bilinear between texel centres, repeated beyond 0 to 1; kept in 16 bits.
    color : (h', w', 3) uint8, or float32 in [0, 1]
        Over the same uv.
    scale : float
        The displacement of height 1, in scene units.
    tiles : (int, int)
        How often height and colour repeat along u and v.
    slices : int
        Over the displacement volume's height. Slices across the surface and parallel to the screen have the same
        spacing, `scale / slices` (section 3.4).
    slicing : {"orthogonal", "surface", "screen"}
        "surface": parallel to the base only (section 3.1), which one sees through from the side; "orthogonal":
        along the normal or one of two directions in the surface, whichever faces the viewer most, polygon by polygon
        (section 3.2); "screen": parallel to the view plane (section 3.3).
    test : {"inside", "at_least", "band"}
        A slice at height h is drawn where the map's height is more than h, so that 0 masks the surface out; at least
        h (Dietrich), which draws the base, too; or at most a slice spacing more than h (Schaufler), so that one may
        see through between neighbours of very different heights.
    normal_map : (h'', w'', 3) float32, optional
        Unit normals in tangent space, for lights: x along u, y along v, z along the normal. Without it the heights'
        slopes give them.

    Raises
    ------
    ArgumentError
        If an argument has a wrong shape, type or range, or the mesh has no uv.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> corners, uv = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 0], [1, 0], [1, 1], [0, 1]]
    >>> square = ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3]], uv=uv)
    >>> height, color = np.full((4, 4), 0.48, np.float32), np.full((4, 4, 3), 200, np.uint8)
    >>> surface = ibr.SlicedSurface(square, height, color, scale=0.2, slices=20, slicing="surface")
    >>> camera = ibr.Camera.look_at((0.5, 0.5, 2), (0.5, 0.5, 0), (0, 1, 0), (9, 9), fov_y=20)
    >>> round(float(ibr.render(surface, camera).depth[4, 4]), 3)  # the highest slice below 0.096 is at 0.09
    1.91
    """

    def __init__(
        self,
        base: Mesh,
        height: NDArray[Any],
        color: NDArray[Any],
        scale: float,
        tiles: tuple[int, int] = (1, 1),
        slices: int = 64,
        slicing: Slicing = "orthogonal",
        test: AlphaTest = "inside",
        normal_map: NDArray[Any] | None = None,
    ) -> None:
        if not isinstance(base, Mesh):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ArgumentError("base", "a pyibr.Mesh", describe(base))
        if base.uv is None:
            raise ArgumentError("base", "a mesh with uv", f"{base!r} without")
        self.base = base
        self.height = checked_height(height)
        self.color = checked_image("color", color)
        self.scale = positive("scale", scale)
        self.tiles = _checked_tiles(tiles)
        self.slices = _checked_slices(slices)
        one_of("slicing", slicing, Slicing)
        one_of("test", test, AlphaTest)
        self.slicing: Slicing = slicing
        self.test: AlphaTest = test
        self.normal_map = None if normal_map is None else _checked_normals(normal_map)
        self.device_cache: WeakKeyDictionary[Any, Any] = WeakKeyDictionary()

    def __repr__(self) -> str:
        h, w = self.height.shape
        return f"<SlicedSurface {len(self.base.faces)} triangles, heights {w}x{h}, {self.slices} slices>"

    def with_height(self, height: NDArray[Any]) -> SlicedSurface:
        """The same surface with other heights, for animations: everything else, on the device too, is shared."""
        made = object.__new__(SlicedSurface)
        made.__dict__.update({name: value for name, value in self.__dict__.items() if name != "height_words"})
        made.height = checked_height(height)
        return made

    @cached_property
    def height_words(self) -> NDArray[np.uint32]:
        """(h, w) words of two heights, 16 bits each: a texel's, and above it its right neighbour's."""
        fixed = np.rint(self.height * np.float32(65535)).astype(np.uint32)
        return fixed | np.roll(fixed, -1, axis=1) << np.uint32(16)

    @cached_property
    def volume(self) -> Volume:
        """The displacement volume."""
        return extruded(self.base, self.scale, self.tiles)


class DepthObject:
    """What depth images all round leave of space: a solid with their colours.

    A point is part of it if it lies behind every image's surface. Where an image saw background it leaves nothing.

    Parameters
    ----------
    views : sequence of DepthImage
        Orthographic or perspective, at any poses: six arranged as a cube in the paper
        (`pyibr.capture.object_views`).
    slices : int
        Along the longest edge of the object's box; other directions have the same spacing.
    slicing : {"orthogonal", "screen"}
        Along the edge of the box (its axes are the first view's) that faces the viewer most, or parallel to the view
        plane.
    halvings : int
        How often the way from a slice that passes back to the one before is halved to meet the surface; 0 leaves the
        slices as they are, as in the paper.
    texture : {"visible", "naive"}
        Up to three images colour a point, weighted by how close their directions are to the target's: "visible"
        takes those that saw the point (if any did), "naive" the closest ones as in the paper.

    Raises
    ------
    ArgumentError
        If there are no views, one has no valid depth, or their volumes have nothing in common.
    """

    def __init__(
        self,
        views: Sequence[DepthImage],
        slices: int = 128,
        slicing: ObjectSlicing = "orthogonal",
        texture: Texture = "visible",
        halvings: int = 2,
    ) -> None:
        self.views = _checked_views(views, DepthImage)
        self.halvings = _checked_halvings(halvings)
        for number, view in enumerate(self.views):
            if not view.valid.any():
                raise ArgumentError("views", "views with valid depth", f"none in view {number}")
        self.slices = _checked_slices(slices)
        one_of("slicing", slicing, ObjectSlicing)
        one_of("texture", texture, Texture)
        self.slicing: ObjectSlicing = slicing
        self.texture: Texture = texture
        self.device_cache: WeakKeyDictionary[Any, Any] = WeakKeyDictionary()
        self.box = box_of_samples(self.views)

    def __repr__(self) -> str:
        return f"<DepthObject {len(self.views)} views, {self.slices} slices>"

    @cached_property
    def maps(self) -> list[Float32]:
        """Nearness images of the views, background as far as the box reaches."""
        return [nearness_map(view, self.box) for view in self.views]


class VisualHull:
    """What silhouettes leave of space: the largest solid that fits into all of them.

    Parameters
    ----------
    views : sequence of Silhouette or DepthImage
        Any number, at any calibrated poses; of depth images only `valid` and the colours are used.
    slices : int
        Along the longest edge of the hull's box; other directions have the same spacing.
    slicing : {"orthogonal", "screen"}
        As for `DepthObject`; the box's axes are the world's.
    halvings : int
        As for `DepthObject`.

    Raises
    ------
    ArgumentError
        If there are no views, or nothing lies within all silhouettes.
    """

    texture: Texture = "naive"  # silhouettes do not tell what they see

    def __init__(
        self,
        views: Sequence[Silhouette | DepthImage],
        slices: int = 128,
        slicing: ObjectSlicing = "orthogonal",
        halvings: int = 2,
    ) -> None:
        self.views = _checked_views(views, (Silhouette, DepthImage))
        self.halvings = _checked_halvings(halvings)
        self.slices = _checked_slices(slices)
        one_of("slicing", slicing, ObjectSlicing)
        self.slicing: ObjectSlicing = slicing
        self.device_cache: WeakKeyDictionary[Any, Any] = WeakKeyDictionary()
        self.box = box_of_silhouettes(self.views)

    def __repr__(self) -> str:
        return f"<VisualHull {len(self.views)} views, {self.slices} slices>"

    @cached_property
    def outlines(self) -> list[int]:
        """For each view the number of the first with its silhouette: opposite orthographic views share one."""
        firsts: list[int] = []
        for number, view in enumerate(self.views):
            same = (other for other in sorted(set(firsts)) if is_opposite(view, self.views[other]))
            firsts.append(next(same, number))
        return firsts

    @property
    def tested(self) -> list[int]:
        """Numbers of the views with silhouettes of their own; each is tested once."""
        return sorted(set(self.outlines))

    @cached_property
    def maps(self) -> list[Float32]:
        """Masks of the views, 0 or 1."""
        return [np.ascontiguousarray(view.valid, np.float32) for view in self.views]


def checked_height(height: NDArray[Any]) -> Float32:
    """Heights as float32 in [0, 1]; integers are divided by their greatest value."""
    if not isinstance(height, np.ndarray) or height.ndim != 2 or 0 in height.shape:  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ArgumentError("height", "heights in [0, 1] of shape (h, w), or uint8 or uint16", describe(height))
    if height.dtype.name in ("uint8", "uint16"):
        return np.ascontiguousarray(height / np.float32(np.iinfo(height.dtype).max), np.float32)
    if height.dtype.kind != "f":
        raise ArgumentError("height", "float32 in [0, 1], uint8 or uint16", describe(height))
    if not (np.isfinite(height).all() and height.min() >= 0 and height.max() <= 1):
        with np.errstate(invalid="ignore"):
            raise ArgumentError("height", "heights in [0, 1]", f"{np.min(height):g} to {np.max(height):g}")
    return np.ascontiguousarray(height, np.float32)


def _checked_normals(normal_map: NDArray[Any]) -> Float32:
    expected = "float normals in tangent space of shape (h, w, 3), z > 0"
    if not isinstance(normal_map, np.ndarray) or normal_map.ndim != 3 or normal_map.shape[2] != 3:  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ArgumentError("normal_map", expected, describe(normal_map))
    if normal_map.dtype.kind != "f" or not np.isfinite(normal_map).all() or (normal_map[..., 2] <= 0).any():
        raise ArgumentError("normal_map", expected, describe(normal_map))
    return np.ascontiguousarray(normal_map, np.float32)


def _checked_tiles(tiles: tuple[int, int]) -> tuple[int, int]:
    pair = numbers("tiles", cast("ArrayLike", tiles), (2,))
    if (pair < 1).any() or (pair != np.rint(pair)).any():
        raise ArgumentError("tiles", "two whole numbers >= 1", describe(tiles))
    return int(pair[0]), int(pair[1])


def _checked_slices(slices: int) -> int:
    if isinstance(slices, bool) or not isinstance(slices, (int, np.integer)) or not 1 <= slices <= _SLICES_MOST:  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ArgumentError("slices", f"a whole number from 1 to {_SLICES_MOST}", describe(slices))
    return int(slices)


def _checked_halvings(halvings: int) -> int:
    if isinstance(halvings, bool) or not isinstance(halvings, (int, np.integer)) or not 0 <= halvings <= _HALVINGS_MOST:  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ArgumentError("halvings", f"a whole number from 0 to {_HALVINGS_MOST}", describe(halvings))
    return int(halvings)


def _checked_views(views: object, kinds: Any) -> list[Any]:
    if not isinstance(views, Sequence) or not views:
        raise ArgumentError("views", "a sequence of at least one view", describe(cast("object", views)))
    several = list(cast("Sequence[object]", views))
    for view in several:
        if not isinstance(view, kinds):
            raise ArgumentError("views", "views of the right kind", describe(view))
    return several


def draw_surface(
    target: Target, surface: SlicedSurface, light: Light | None, counts: DeviceArray | None = None
) -> None:
    """Draw a sliced surface into the target; `counts`, (H, W) int32, gains the alpha tests of each pixel."""
    from pyibr.opencl.device import current
    from pyibr.opencl.launch import Struct, launch
    from pyibr.opencl.program import kernel

    buffers = _surface_buffers(surface)
    near = target.near(surface.volume.bounds)
    projected = project(target, buffers["points"], near)
    bins = bin_primitives(target, buffers["corners"], projected, near, sort=True)
    defines: dict[str, int] = {}
    more: dict[str, Any] = {}
    if light is not None:
        defines["LIT"] = 1
        height, width = (0, 0) if surface.normal_map is None else surface.normal_map.shape[:2]
        more |= {"normal_width": width, "normal_height": height, "light": Struct("Light", light.struct)}
        more |= {"gradients": buffers["gradients"], "normal_map": buffers.get("normal_map", buffers["gradients"])}
    if counts is not None:
        defines["COUNTED"] = 1
        more["counts"] = counts
    launch(
        kernel("slicing/surface.cl", "draw_surface", BIN=BIN, COLOR_BYTES=target.channel_bytes, **defines),
        (bins.columns, bins.rows) if current().is_cpu else target.camera.size,
        **{name: buffers[name] for name in ("corners", "points", "places", "frames", "heights", "colors")},
        projected=projected,
        list=bins.list,
        starts=bins.starts,
        bins_x=bins.columns,
        screen=Struct("Screen", target.screen(near)),
        nearest_w=near,
        spacing=surface.scale / surface.slices,
        slices=surface.slices,
        slicing=_SLICINGS[surface.slicing],
        test=_TESTS[surface.test],
        map_width=surface.height.shape[1],
        map_height=surface.height.shape[0],
        color_width=surface.color.shape[1],
        color_height=surface.color.shape[0],
        blank=target.blank,
        **target.outputs(),
        **more,
    )
    target.blank = False


def _surface_buffers(surface: SlicedSurface) -> dict[str, DeviceArray]:
    """The surface on the current device: made once but for the heights, which an animation replaces."""
    from pyibr.opencl.device import current
    from pyibr.opencl.memory import upload

    session = current()
    kept = surface.device_cache.get(session)
    if not isinstance(kept, dict):
        volume = surface.volume
        kept = {name: upload(getattr(volume, name)) for name in ("points", "places", "corners", "frames", "gradients")}
        kept["colors"] = upload(rgba_words(surface.color))
        if surface.normal_map is not None:
            kept["normal_map"] = upload(surface.normal_map)
        surface.device_cache[session] = kept
    return {**cast("dict[str, DeviceArray]", kept), "heights": upload(surface.height_words)}


def draw_object(target: Target, thing: DepthObject | VisualHull, counts: DeviceArray | None = None) -> None:
    """Draw an object into the target; `counts`, (H, W) int32, gains the view tests of each pixel."""
    from pyibr.opencl.launch import Struct, launch
    from pyibr.opencl.memory import upload
    from pyibr.opencl.program import kernel

    hull = isinstance(thing, VisualHull)
    buffers = _object_buffers(thing)
    box, camera = thing.box, target.camera
    directions = np.array([_direction(view.camera, box) for view in thing.views])
    towards = _direction(camera, box)
    cosines = directions @ towards
    order = np.argsort(-cosines, kind="stable")
    if hull:  # of the views with one silhouette, the closest to the target's is tested, and colours
        _, closest = np.unique(np.array(thing.outlines)[order], return_index=True)
        order = order[np.sort(closest)]
    axis = _TO_SCREEN if thing.slicing == "screen" else int(np.argmax(np.abs(box.axes @ towards)))
    spacing = float(box.edges.max()) / thing.slices
    sample = max(_sample_size(view.camera, box) for view in thing.views)
    record = np.zeros((), _BOX)
    record["from_world"], record["edges"], record["spacing"] = box.from_world.ravel(), box.edges, spacing
    corners = np.asarray(box.corners, np.float32)
    near = target.near((corners.min(axis=0), corners.max(axis=0)))
    low_x, low_y, across, down = _blocks(target, box, near)
    defines = {"VIEWS": len(order), "SILHOUETTES": int(hull), "COLOR_BYTES": target.channel_bytes}
    more: dict[str, Any] = {}
    if counts is not None:
        defines["COUNTED"] = 1
        more["counts"] = counts
    if across > 0 and down > 0:
        launch(
            kernel("slicing/object.cl", "draw_object", **defines),
            (across, down),
            **buffers,
            order=upload(order.astype(np.int32)),
            closeness=upload(np.maximum(cosines, 1e-3).astype(np.float32)),
            screen=Struct("Screen", target.screen(near)),
            box=Struct("Box", record),
            slices_axis=axis,
            halvings=thing.halvings,
            visible=thing.texture == "visible",
            tolerance=_BEFORE * (spacing + sample),
            low_x=low_x,
            low_y=low_y,
            blank=target.blank,
            **target.outputs(),
            **more,
        )
        target.blank = False


def _direction(camera: Camera, box: Box) -> NDArray[np.float64]:
    """Unit vector in which a camera sees the box."""
    forward = camera.world_from_camera[:3, 2]
    if camera.projection == "perspective":
        forward = box.center - camera.world_from_camera[:3, 3]
    return forward / max(float(np.linalg.norm(forward)), 1e-30)


def _sample_size(camera: Camera, box: Box) -> float:
    """A pixel's size on the object, in scene units."""
    z = float(camera.camera_from_world[2, :3] @ box.center + camera.camera_from_world[2, 3])
    return (abs(z) if camera.projection == "perspective" else 1.0) / float(min(camera.K[0, 0], camera.K[1, 1]))


def _blocks(target: Target, box: Box, near: float) -> tuple[int, int, int, int]:
    """First pixel and blocks across and down: all of a blank picture, else where the box may be seen."""
    from pyibr.opencl.device import current

    block = 4 if current().is_cpu else 1  # kernels/raster/region.h
    width, height = target.camera.size
    low_x = low_y = 0
    if not target.blank:
        u, v, w, _ = target.from_world @ np.column_stack([box.corners, np.ones(8)]).T
        if (w < near).all():
            return 0, 0, 0, 0
        if (w >= near).all():
            low_x, width = max(int(np.floor((u / w).min())), 0), min(int(np.ceil((u / w).max())) + 1, width)
            low_y, height = max(int(np.floor((v / w).min())), 0), min(int(np.ceil((v / w).max())) + 1, height)
    return low_x, low_y, -(-(width - low_x) // block), -(-(height - low_y) // block)


def _object_buffers(thing: DepthObject | VisualHull) -> dict[str, DeviceArray]:
    """The object on the current device, made once."""
    from pyibr.opencl.device import current
    from pyibr.opencl.memory import upload

    session = current()
    kept = thing.device_cache.get(session)
    if isinstance(kept, dict):
        return cast("dict[str, DeviceArray]", kept)
    sizes: list[tuple[int, int, int]] = []
    start = 0
    words: list[NDArray[np.uint32]] = []
    for view in thing.views:
        sizes.append((*view.camera.size, start))
        start += view.valid.size
        words.append(rgba_words(view.color, view.valid))
    matrices = np.array([view.camera.pixel_matrix @ view.camera.camera_from_world for view in thing.views])
    made = {
        "matrices": upload(matrices.reshape(-1, 16).astype(np.float32)),
        "sizes": upload(np.array(sizes, np.int32)),
        "maps": upload(np.concatenate([values.ravel() for values in thing.maps])),
        "colors": upload(np.concatenate(words)),
    }
    thing.device_cache[session] = made
    return made
