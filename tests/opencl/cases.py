"""Calls that run every kernel on small images, maps and pictures, to test accesses at their borders.

`fences` and the test with Oclgrind use them. Run as a program with the name of a group of folders, this module prints
each case before it starts, and a last line after all cases.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import nullcontext, suppress
from functools import partial
from itertools import product
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.core.camera import Projection
from pyibr.depthmesh import Segmentation
from pyibr.images import DepthImage
from pyibr.opencl.device import current
from pyibr.opencl.watch import watching
from pyibr.picture.drawable import as_drawable
from pyibr.picture.surface import surface_of
from pyibr.picture.unseen import MarkedUnseen
from pyibr.raster.rays import triangles_met
from pyibr.warp import blending, exemplar
from pyibr.warp.warp import warp_transposed
from tests import scenes
from tests.opencl.setting import KINDS, Launches, Poisoned, Ran, Setting, kernels_of
from tests.scenes import Size

PROJECTIONS: tuple[Projection, ...] = ("perspective", "orthographic")
Cases = Iterator[tuple[str, Callable[[], object]]]
WAYS: tuple[dict[str, Any], ...] = (
    {},
    {"edges": "connect", "classes": True},
    {"method": "search", "side": "both", "origins": True},
    {"fill": "background", "interpolation": "nearest", "classes": True},
    {"method": "forward", "splat": 2},
    {"fill": "smooth", "edges": "connect"},
    {"samples": 9},
    {"thin": True, "classes": True},
    {"thin": True, "edges": "connect", "side": "both", "interpolation": "nearest"},
)


def _warps(setting: Setting) -> Cases:
    all_sizes = (13, 7), (1, 1), (2, 2), (1, 7), (7, 1), (17, 33)
    all_targets = (5, 7), (1, 1), (2, 3), (1, 37), (37, 1), (19, 17)
    seen = list(product((scenes.smooth, scenes.holed), PROJECTIONS))
    many, of_both = setting.choose(1, 2, 6), setting.choose(seen[:1], seen[::3], seen)
    for (make, projection), size, target in product(of_both, all_sizes[:many], all_targets[:many]):
        view, beside = setting.view(make, size, projection), setting.view(scenes.smooth, (2, 1), projection)
        if not view.valid.any():
            continue
        for number, (pose, camera) in enumerate(_targets(view, target)):
            name = f"warp {make.__name__} {projection} {size} to {camera.size} {pose}"
            for way in (WAYS[0], WAYS[1 + number % (len(WAYS) - 1)]):
                yield f"{name} {way}", partial(ibr.warp, view, camera, **way, out=setting.frame(camera))
            if pose == "ahead":
                yield f"{name} searched", partial(ibr.warp, view, camera, method="search", edges="connect")
                yield f"{name} of two", partial(ibr.warp, [view, beside], camera, classes=True)
                yield f"{name}, two views, one held", partial(_warp_holding_one, [view, beside], camera)
    view = setting.view(scenes.holed, (13, 9), "perspective")
    yield "texture", partial(_warp_with_texture, view, view.camera.moved(0.2, 0, 0))


def _layers(setting: Setting) -> Cases:
    """A layer of background, drawn in the holes of its view's pictures."""
    sizes = ((13, 7), (5, 7)), ((1, 1), (33, 2)), ((17, 33), (37, 5))
    for (size, target), projection in product(sizes[: setting.choose(1, 2, 3)], PROJECTIONS):
        view = setting.view(scenes.holed, size, projection)
        if view.valid.any():
            path = [view.camera.moved(0.4 * k, 0.1, 0.1 * k).resized(target) for k in range(3)]
            yield f"layer {size} {projection}", partial(_warp_with_background, view, path)


def _warp_with_background(view: DepthImage, path: list[ibr.Camera]) -> list[ibr.Frame]:
    return ibr.warp([view, ibr.background_layer(view, path)], path, fill="background")


def _bridges(setting: Setting) -> Cases:
    """A warp of steep surface through which rays of another view pass."""
    size = (33, 17)
    colored = setting.view(scenes.smooth, size, "perspective").has_color
    views = [
        DepthImage(view.color if colored else None, view.depth, view.camera) for view in scenes.ramp_and_empty(size)
    ]
    yield f"bridges {size}", partial(ibr.warp, views, views[0].camera)


def _warp_with_texture(view: DepthImage, camera: ibr.Camera) -> ibr.Frame:
    """Fill holes with texture in several resolutions, though the picture is small."""
    with patch.object(exemplar, "_SIDE_MIN", 4):
        return ibr.warp(view, camera, fill="exemplar")


def _warp_back(view: DepthImage, camera: ibr.Camera, channels: int) -> NDArray[np.float32]:
    return warp_transposed(view, camera, np.ones((camera.height, camera.width, channels), np.float32))


def _features(setting: Setting) -> Cases:
    """Features of one and of more than sixteen channels, on surfaces of all sizes, and back."""
    for size, target in (((13, 7), (5, 7)), ((1, 1), (1, 1)), ((17, 33), (37, 5)))[: setting.choose(1, 2, 3)]:
        known = setting.view(scenes.holed, size, "perspective")
        camera = known.camera.moved(0.05, 0.02, 0.1).resized(target)
        if not known.valid.any():
            continue
        for channels, dtype in ((1, np.uint8), (3, np.float16), (19, np.float32), (17, np.uint8), (33, np.float16)):
            values = np.full((size[1], size[0], channels), 3, dtype)
            view = DepthImage(None, known.depth, known.camera, far=known.far, features=values)
            yield f"{channels} features {size} to {target}", partial(ibr.warp, view, camera)
            yield f"{channels} features {size} back", partial(_warp_back, view, camera, channels)


def _warp_holding_one(views: list[DepthImage], camera: ibr.Camera) -> ibr.Frame:
    """Warp with memory for only one view's layer, so that the other views are drawn twice."""
    with patch.multiple(blending, _HELD_BYTES=1, _HELD_MIN=1):
        return ibr.warp(views, camera)


def _lenses(setting: Setting) -> Cases:
    lens = ibr.Lens("brown_conrady", [-0.2, 0.02, 0.01, 0.0])
    for size, target in (((13, 7), (5, 7)), ((2, 2), (1, 1)), ((17, 33), (37, 5)))[: setting.choose(1, 2, 3)]:
        view = setting.view(scenes.holed, size, "perspective")
        color = view.color if view.has_color else None
        here = ibr.Camera(view.camera.K, size, view.camera.world_from_camera, lens=lens)
        yield f"lens {size} undistorted", partial(ibr.undistorted, DepthImage(color, view.depth, here, far=view.far))
        targets = view.camera.moved(0.05, 0.02, 0.1).resized(target), view.camera.moved(0.2, 0, 0)
        for camera, other in zip(targets, (lens, ibr.Lens("kannala_brandt", [0, 0, 0, 0])), strict=True):
            bent = ibr.Camera(camera.K, camera.size, camera.world_from_camera, lens=other)
            ways: tuple[dict[str, Any], ...] = ({}, {"classes": True, "fill": "smooth"}, {"samples": 4})
            for way in (*ways, {"interpolation": "nearest", "fill": "background"}):
                yield f"lens {size} to {camera.size} {way}", partial(ibr.warp, view, bent, **way)


def _bounds(setting: Setting) -> Cases:
    """Bounds of nearness in windows of a surface, which only GPUs use."""
    for size in ((1, 1), (17, 33))[: setting.choose(1, 2, 2)]:
        view = setting.view(scenes.smooth, size, "perspective")
        yield f"bounds {size}", lambda view=view: surface_of(view, None).bounds.to_host()


def _registrations(setting: Setting) -> Cases:
    lenses: list[ibr.Lens | None] = [None, ibr.Lens("brown_conrady", [-0.2, 0.02, 0.01, 0.0])]
    lenses += [ibr.Lens("kannala_brandt", [0.02, 0, 0, 0]), ibr.Lens("modified_brown_conrady", [-0.2, 0.02, 0, 0])]
    sizes = ((13, 7), (5, 7)), ((1, 1), (1, 1)), ((17, 33), (37, 5)), ((2, 1), (1, 37))
    for (size, target), lens in product(sizes[: setting.choose(2, 2, 4)], lenses[: setting.choose(2, 2, 4)]):
        view = setting.view(scenes.holed, size, "perspective")
        if not view.valid.any():
            continue
        here = ibr.Camera(view.camera.K, size, view.camera.world_from_camera, lens=lens)
        for aside in (0.05, 2.5):
            moved = here.moved(aside, 0.02, 0.1).resized(target)
            there = ibr.Camera(moved.K, target, moved.world_from_camera, lens=lens)
            name = f"register {size} to {target} {aside} {lens}"
            if setting.kind == "depth alone":
                yield name, partial(ibr.register, view.depth, here, there)
                if view.valid.all() or lens is None:  # kernels for counts have no holes or lenses
                    counts = ibr.uint16_from_depth(np.where(view.valid, view.depth, np.float32(np.nan)), 1000)
                    yield f"{name} counts", partial(ibr.register, counts, here, there, depth_scale=1000)
            else:
                yield name, partial(ibr.register_color, view.depth, here, there, setting.noise(*target))


def _targets(view: DepthImage, size: Size) -> Iterator[tuple[str, ibr.Camera]]:
    """Cameras with epipolar lines in all directions; some have more rows and columns than the view."""
    for pose in scenes.special_cameras(view, size):
        if pose.name not in ("left", "up"):
            yield pose.name, pose.camera
    yield "ahead", view.camera.moved(0.05, 0.02, 0.4).resized(size)
    if size == (1, 1):  # the targets below do not depend on the size
        width, height = view.camera.size
        larger = view.camera.K + np.array([[0, 0, 21], [0, 0, 23], [0, 0, 0]])
        for name, step in (("beyond rows", (0.3, 0, 0)), ("beyond columns", (0, -0.3, 0))):
            pose, projection = view.camera.moved(*step).world_from_camera, view.camera.projection
            yield name, ibr.Camera(larger, (width + 45, height + 47), pose, projection=projection)


def _draw(
    setting: Setting, things: list[Any], camera: ibr.Camera, light: ibr.Light | None = None, anisotropy: int = 1
) -> object:
    """Render things and a depth image, whose colours decide the kind of the picture's colours."""
    view = setting.view(scenes.smooth, (2, 1), "perspective")
    return ibr.render([*things, view], camera, light, anisotropy=anisotropy)


def _square() -> tuple[list[list[float]], list[list[int]], list[list[float]]]:
    """Corners, faces and uv. The first face, which idle lanes read, has no area; another extends behind the camera."""
    corners = [[-1.0, -1, 2], [1, -1, 4], [1, 1, 4], [-1, 1, -2]]
    return corners, [[1, 1, 2], [0, 2, 1], [0, 3, 2]], [[-1.0, 0], [1, 0], [1, 2], [0, 3]]


def _lights(setting: Setting) -> list[ibr.Light | None]:
    lit = [ibr.Light(position=(0, 0, 0), shadow_size=7, specular=0.5)]
    lit.append(ibr.Light(direction=(0.1, 0.2, 1), shadow_size=0, relight=True))  # also lights the depth image
    return lit if not setting.amount else [None, ibr.Light(direction=(0.1, 0.2, 1), shadow_size=0), *lit]


def _screens(setting: Setting) -> list[ibr.Camera]:
    sizes = ((5, 7), (1, 1), (2, 2), (37, 5), (67, 33))[: setting.choose(1, 2, 5)]
    return [ibr.Camera([[size[0], 0, size[0] / 2], [0, size[0], size[1] / 2], [0, 0, 1]], size) for size in sizes]


def _meshes(setting: Setting) -> Cases:
    corners, faces, uv = _square()
    for number, texture_size in enumerate(((5, 3), (1, 1), (1, 5), (5, 1))[: setting.choose(1, 4, 4)]):
        texture = setting.noise(*texture_size)
        lights = _lights(setting)[: 1 if number else None]  # lights do not affect texture reads
        first = ibr.Mesh(corners, faces, uv=uv, texture=texture)
        second = ibr.Mesh(corners, faces, colors=np.asarray(setting.noise(4, 1)[0]))
        plain = ibr.Mesh([[-9, -9, 5], [9, -9, 5], [0, 9, 5]], [[0, 1, 2]])
        for camera in _screens(setting):
            for light in lights:
                name = f"meshes, texture {texture_size}, {camera.size}, {light}"
                yield name, partial(_draw, setting, [first, second, plain], camera, light)
                yield f"{name}, filtered", partial(_draw, setting, [first], camera, light, 3)


def _rays(setting: Setting) -> Cases:
    """First and last triangles on rays, of pinholes and of a lens."""
    corners, faces = np.float64(_square()[0]), np.int32(_square()[1])
    lens = ibr.Lens("brown_conrady", [-0.2, 0.02, 0.01, 0.0])
    for screen, last, bent in product(_screens(setting), (False, True), (None, lens)):
        camera = ibr.Camera(screen.K, screen.size, lens=bent)
        yield f"rays {camera.size} {last} {bent}", partial(triangles_met, camera, corners, faces, last=last)


def _marked(setting: Setting) -> Cases:
    """Two triangles behind one another, with marks on the parts that no image has seen."""
    near, plain = (ibr.Mesh([[-s, -s, z], [s, -s, z], [0, s, z]], [[0, 1, 2]]) for s, z in ((1, 4), (9, 5)))
    for sizes in (((1, 1), (2, 2), (1, 5), (7, 1)), ((9, 7),) * 4)[: setting.choose(1, 2, 2)]:
        views = _views_around(setting, sizes)
        for side, camera in product(("front", "both"), _screens(setting)):
            part = np.array([[-1.0, -2.0, 4.0], [2.0, 1.0, 6.0]]) if side == "both" else None
            thing = MarkedUnseen(as_drawable(plain), views, side, within=part)
            yield f"seen by {sizes} from {side}, {camera.size}", partial(_draw, setting, [near, thing], camera)


def _height_maps(setting: Setting) -> Iterator[tuple[NDArray[Any], NDArray[Any], NDArray[Any] | None]]:
    """Maps of heights, colours and normals, of all sizes at which borders may fail."""
    rng = np.random.default_rng(0)
    for size in ((5, 3), (1, 1), (1, 5), (5, 1), (4, 8))[: setting.choose(1, 2, 5)]:
        height = rng.random(size[::-1], np.float32)
        normals = np.dstack([rng.random((*size, 2), np.float32) - 0.5, np.ones(size, np.float32)])
        yield height, setting.noise(*size), normals
        yield (255 * height).astype(np.uint8), setting.noise(*size[::-1]), None


def _tiled_square() -> ibr.Mesh:
    uv = [[-1, 0], [1, 0], [1, 3], [0, 1]]
    return ibr.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0]], [[1, 1, 2], [0, 1, 2], [0, 2, 3]], uv=uv)


def _above(setting: Setting) -> list[ibr.Camera]:
    """Cameras above the square, beside it and inside its relief."""
    eyes, sizes = ((0.5, 0.5, 0.6), (1, 2, 1), (0.5, 0.5, 0.05)), ((13, 7), (1, 1), (37, 5))
    looks = list(zip(eyes, sizes, strict=True))[: setting.choose(1, 2, 3)]
    return [ibr.Camera.look_at(eye, (0.5, 0.5, 0), (0, 1, 0.1), size, fov_y=60) for eye, size in looks]


def _within() -> ibr.Camera:
    """A camera a little below the square, inside its relief."""
    return ibr.Camera.look_at((0.5, 0.3, 0.02), (1, 0.5, 0), (0, 0, 1), (13, 7), fov_y=60)


def _surfaces(setting: Setting) -> Cases:
    light = ibr.Light(direction=(0, 0, -1), shadow_size=7)
    screen: dict[str, Any] = {"slicing": "screen", "clipped": False, "test": "band"}
    ways: tuple[dict[str, Any], ...] = (
        {"slicing": "surface", "tiles": (2, 1)},
        {"test": "at_least", "wrap": "clamp", "halvings": 2},
        {**screen, "tiles": (2, 1)},
        {"slices": "view", "test": "band", "band": 0.3, "tiles": (2, 1)},
    )
    for height, color, normals in _height_maps(setting):
        for way in ways:
            given = {"slices": 3} | way
            made = ibr.SlicedSurface(_tiled_square(), height, color, 0.3, normal_map=normals, **given)
            for camera in _above(setting):
                name = f"slices {height.shape} {way} {camera.size}"
                yield name, partial(_draw, setting, [made], camera, light)
                if way == ways[0]:
                    yield f"{name}, filtered", partial(_draw, setting, [made], camera, light, 3)


def _sorted(setting: Setting) -> Cases:
    """Draw triangles from front to back."""
    made = ibr.SlicedSurface(_tiled_square(), np.eye(4, dtype=np.float32), setting.noise(2, 2), 0.3, slices=3)
    for camera in _above(setting):
        yield f"sorted {camera.size}", partial(_draw, setting, [made], camera)


def _reliefs(setting: Setting) -> Cases:
    light = ibr.Light(direction=(0, 0, -1), shadow_size=7)
    ways: tuple[dict[str, Any], ...] = (
        {"tiles": (2, 1)},
        {"wrap": "clamp"},
        {"search": "linear", "steps": 4},
        {"shadow": "search", "distance": "exact", "wrap": ("repeat", "clamp")},
        {"silhouette": "none"},
        {"shadow": "search", "distance": "perpendicular", "search": "linear", "steps": 4},
    )
    for number, (height, color, normals) in enumerate(_height_maps(setting)):
        # Each combination of options is a program that takes seconds to build. So all combinations run on heights in
        # floats and in bytes, but only two on the other maps, and one with colours in floats.
        first, second = (setting.kind == "uint8" and number == n for n in (0, 1))
        others = (ways[0], ways[1 + number % (len(ways) - 1)]) if setting.kind == "uint8" else ways[:1]
        for way in ways if first or second else others:
            made = ibr.ReliefSurface(_tiled_square(), height, color, 0.3, normal_map=normals, **way)
            is_plain = way == ways[0] and (first or second)
            is_close = is_plain or (first and setting.amount)
            for camera in [*_above(setting), *([_within()] if is_close else [])]:
                name = f"relief {height.shape} {way} {camera.size}"
                yield name, partial(_draw, setting, [made], camera, light)
                if is_plain:
                    yield f"{name}, filtered", partial(_draw, setting, [made], camera, light, 3)
                if is_close and setting.amount:
                    yield f"places {height.shape} {way} {camera.size}", partial(made.tile_coordinates, camera)


def _views_around(setting: Setting, sizes: tuple[Size, ...]) -> list[DepthImage]:
    """Views of a block in front of a background, a third of the image wide; every second view has normals."""
    views = list[DepthImage]()
    for eye, size in zip(((3, 0, 0), (0, 3, 0), (0, 0, 3), (-2, -2, 2)), sizes, strict=True):
        camera = ibr.Camera.look_at(eye, (0, 0, 0), (0.1, 0.2, 1), size, fov_y=40)
        depth = np.full(size[::-1], np.inf, np.float32)
        depth[size[1] // 3 : size[1] // 3 + 2, size[0] // 3 : size[0] // 2 + 2] = 2.5
        normals = np.broadcast_to(np.float32([0.3, 0, -1]), (*depth.shape, 3)) if len(views) % 2 else None
        views.append(DepthImage(setting.noise(*size), depth, camera, normals=normals))
    return views


def _objects(setting: Setting) -> Cases:
    looks = zip(((2, 1, 2), (2, 1, 0), (0.05, 0, 0)), ((13, 7), (1, 1), (37, 5)), strict=True)
    cameras = [ibr.Camera.look_at(eye, (0, 0, 0), (0, 1, 0.1), size, fov_y=40) for eye, size in looks]
    of_sizes: list[tuple[Size, ...]] = [((1, 1), (2, 2), (1, 5), (7, 1)), ((9, 7),) * 4]
    for sizes in of_sizes:
        views = _views_around(setting, sizes)
        for slicing in ("orthogonal", "screen"):
            whole = ibr.DepthObject(views, slices=5, slicing=slicing, missing="unknown")
            things: list[Any] = [whole, ibr.DepthObject(views, slices=5, slicing=slicing, only=2)]
            things.append(ibr.DepthObject(views, slices=9, slicing=slicing, thin=True))
            if sizes[0] != (1, 1):
                things.append(ibr.VisualHull(views, slices="view", slicing=slicing))
            for camera in cameras[: 3 if setting.amount else 2]:
                yield f"objects of {sizes} {slicing} {camera.size}", partial(_draw, setting, things, camera)
                light = ibr.Light(direction=(-1, -1, -2), shadow_size=7, relight=True)
                name = f"objects of {sizes} {slicing} {camera.size}, relit"
                yield name, partial(_draw, setting, things, camera, light)
            yield f"a mesh of objects of {sizes} {slicing}", partial(_meshed, things[:1] + things[3:])


def _meshed(things: list[Any]) -> None:
    for thing in things:
        with suppress(ibr.ArgumentError):  # an empty object
            thing.to_mesh(7)


def _rough(setting: Setting, size: Size, projection: Projection, holes: float) -> DepthImage:
    rng = np.random.default_rng(0)
    width, height = size
    f = 1.2 * width if projection == "perspective" else width / 3
    depth = (3 + 0.2 * rng.random((height, width))).astype(np.float32)
    depth[rng.random((height, width)) < holes] = np.nan
    camera = ibr.Camera([[f, 0, width / 2], [0, f, height / 2], [0, 0, 1]], size, projection=projection)
    return DepthImage(setting.noise(*size), depth, camera)


def _depth_meshes(setting: Setting) -> Cases:
    target = ibr.Camera([[9, 0, 6], [0, 9, 3], [0, 0, 1]], (13, 7))
    tests = (("orthogonality", (2, 2)), ("connectedness", (7, 13)), ("disparity", (17, 9)), ("none", (37, 3)))
    sizes: tuple[Size, ...] = ((2, 2), (2, 17), (17, 2), (3, 2), (31, 33))[: setting.choose(0, 0, 5)]
    for test, own in tests:
        for size in (own, *sizes):
            for projection, errors in zip(PROJECTIONS, ("sum", "largest"), strict=True):
                view = _rough(setting, size, projection, 0 if min(size) == 2 else 0.1)
                thing = ibr.DepthMesh(view, tolerance=0.5, segmentation=Segmentation(test, 60, 0.1, 0.1), errors=errors)
                name = f"depth mesh {test} {size} {projection}"
                yield f"{name}, simplified", partial(thing.simplify, 0.05)
                yield name, partial(_draw, setting, [thing], target)
    light, relit = (ibr.Light(direction=(0, 0, 1), shadow_size=7, relight=on) for on in (False, True))
    views = [_rough(setting, (9, 7), "perspective", 0.1), _rough(setting, (5, 8), "orthographic", 0.1)]
    background = np.where(views[1].valid, views[1].depth, np.float32(np.inf))
    open_views = [views[0], DepthImage(views[1].color, background, views[1].camera)]
    for size in ((13, 7), (1, 1), (2, 2), (37, 5))[: setting.choose(1, 2, 4)]:
        camera = ibr.Camera([[9, 0, 6], [0, 9, 3], [0, 0, 1]], size)
        for blend in ("quality", "position", "nearest"):
            thing = ibr.DepthMeshObject(open_views if blend == "nearest" else views, tolerance=0.5, blend=blend)
            yield f"depth meshes {blend} {size}", partial(_draw, setting, [thing], camera, light)
            yield f"depth meshes {blend} {size}, relit", partial(_draw, setting, [thing], camera, relit)
            yield f"occupancy {blend} {size}", partial(thing.occupancy, camera)


class _Clear:
    """A thing that is not opaque, and that nobody sees."""

    bounds = np.zeros((2, 3))

    def draw(self, target: Any, lighting: Any) -> None:
        pass

    @staticmethod
    def blend_together(things: Any, target: Any, lighting: Any) -> None:
        pass


def _gaussians(setting: Setting) -> Cases:
    """Clouds before and behind a triangle, with Gaussians behind the camera and beside the picture."""
    rng = np.random.default_rng(0)
    behind = ibr.Mesh([[-9, -9, 5], [9, -9, 5], [0, 9, 5]], [[0, 1, 2]])
    for count, degree in ((17, 3), (1, 0), (600, 1))[: setting.choose(1, 2, 3)]:
        shape = (rng.random((count, 3)), rng.normal(size=(count, 4)), rng.random(count))
        sh = rng.normal(0, 0.3, (count, (degree + 1) ** 2, 3))
        cloud = ibr.Gaussians(rng.uniform((-3, -3, -1), (3, 3, 7), (count, 3)), *shape, sh=sh)
        for camera in _screens(setting):
            yield f"gaussians {count} {degree} {camera.size}", partial(_draw, setting, [cloud, behind, cloud], camera)
            bent = ibr.Camera(camera.K, camera.size, lens=ibr.Lens("brown_conrady", [-0.2, 0.02, 0.01, 0.0]))
            for other, samples in ((camera, 4), (bent, 1)):
                name = f"gaussians {count} {degree} {camera.size} {samples} {other.lens}"
                view = setting.view(scenes.smooth, (2, 1), "perspective")
                yield name, partial(ibr.render, [cloud, view], other, samples=samples)


def _relit(setting: Setting) -> Cases:
    """A lit depth image, with a background colour, and with opacities for things that are not opaque."""
    shade = 0.5 if setting.kind == "float32" else 100
    for camera, light in product(_screens(setting), _lights(setting)):
        view = setting.view(scenes.smooth, (2, 1), "perspective")
        drawn = partial(ibr.render, [view, _Clear()], camera, light, background=(shade,) * 3)
        yield f"relit {camera.size}, {light}", drawn


def _splats(setting: Setting) -> Cases:
    view = _rough(setting, (13, 7), "perspective", 0.1)
    yield "splats", partial(ibr.warp, view, view.camera.moved(0.1, 0, 0), method="forward")


def _ribbons(setting: Setting) -> Cases:
    for size in ((13, 7), (37, 5), (2, 17))[: setting.choose(1, 2, 3)]:
        view = _rough(setting, size, "perspective", 0.5)
        yield f"ribbons {size}", partial(ibr.warp, view, view.camera.moved(0.1, 0.05, 0.1), thin=True)


def _cleanings(setting: Setting) -> Cases:
    sizes = ((13, 7), (1, 1), (37, 5), (1, 37), (67, 33), (16, 17))[: setting.choose(2, 3, 6)]
    ways: tuple[dict[str, Any], ...] = ({}, {"holes": 40}, {"strength": 0, "holes": 0})
    for (width, height), way in product(sizes, ways):
        rng = np.random.default_rng(width)
        depth = (2 + 0.02 * rng.random((height, width))).astype(np.float32)
        depth[rng.random(depth.shape) < 0.2], depth[height // 2, width // 2] = np.nan, 0.5
        color = None if setting.kind == "depth alone" else setting.noise(width, height)
        before = np.where(rng.random(depth.shape) < 0.1, np.float32(np.nan), np.float32(2.01)) if way else None
        yield f"clean {width} x {height} {way}", partial(ibr.clean_depth, depth, color, before=before, **way)
        yield f"sharpen {width} x {height}", partial(ibr.sharpen_depth, depth)


GROUPS: dict[str, tuple[tuple[str, ...], tuple[Callable[[Setting], Cases], ...]]] = {
    "images": (
        ("lib", "picture", "cleaning", "warp"),
        (
            _registrations,
            _splats,
            _lenses,
            _bridges,
            _bounds,
            _relit,
            _marked,
            _ribbons,
            _cleanings,
            _layers,
            _warps,
            _features,
        ),
    ),
    "slices": (("raster", "slicing"), (_meshes, _rays, _sorted, _surfaces, _objects)),
    "reliefs": (("relief",), (_reliefs,)),
    "depth meshes": (("depthmesh",), (_depth_meshes,)),
    "gaussians": (("gaussians",), (_gaussians,)),
}
"""Folders of `kernels/`, and cases that together run every kernel in them."""
_WITHOUT_COLORS = (_lenses, _layers, _warps, _bridges, _registrations, _cleanings)


def run_all(setting: Setting, launches: Launches, group: str) -> Ran:
    """Print and run each case of a group; return the kernels that ran."""
    warnings.simplefilter("ignore")  # some targets see nothing
    # Poisoned launches return values that later calls refuse.
    refused = suppress(ibr.ArgumentError) if isinstance(launches, Poisoned) else nullcontext()
    with watching(launches):
        for cases in GROUPS[group][1]:
            if setting.kind != "depth alone" or cases in _WITHOUT_COLORS:
                for name, call in cases(setting):
                    print(setting.kind, name, flush=True)
                    with refused:
                        call()
    return launches.ran


def check_all_ran(ran: Ran, group: str) -> None:
    """End the process with an error unless every kernel of the group has run."""
    of_cpus = set[tuple[str, str]]() if current().profile.band else {("prepare", "")}
    missing = sorted(set().union(*map(kernels_of, GROUPS[group][0])) - of_cpus - ran)
    assert not missing, f"never ran: {missing}"


if __name__ == "__main__":
    group = sys.argv[1]
    check_all_ran({one for kind in KINDS for one in run_all(Setting(kind, 0), Launches(), group)}, group)
    print("through on", current().device.platform)
