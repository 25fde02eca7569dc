"""Calls of all systems, which together launch every kernel, for tests and measurements of launches."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.capture import capture, models, object_views
from pyibr.images import Frame
from pyibr.picture.drawable import as_drawable
from pyibr.picture.surface import surface_of
from pyibr.picture.unseen import MarkedUnseen
from pyibr.warp import blending
from pyibr.warp.warp import warp_transposed
from tools import scenes

Call = Callable[[], list[NDArray[Any]]]
SIZE = (61, 37)
LENS = ibr.Lens("brown_conrady", [-0.2, 0.02, 0.01, 0.0])
CAMERA = ibr.Camera.look_at((1, 2, 5), (0, 0, 0), (0, 1, 0), SIZE, fov_y=45)


def arrays_of(frame: Frame) -> list[NDArray[Any]]:
    """All arrays that a frame has."""
    more = (frame.source, frame.view, frame.classes, frame.alpha, frame.guessed)
    return [frame.color, frame.depth, frame.valid, *(values for values in more if values is not None)]


def view_of(scene: Callable[[tuple[int, int]], ibr.DepthImage]) -> ibr.DepthImage:
    """A new view with the same arrays, and no data on the device yet."""
    known = scene(SIZE)
    return ibr.DepthImage(known.color, known.depth, known.camera)


def warped(move: tuple[float, float, float] = (0.2, 0.1, 0.3), **how: Any) -> Call:
    def call() -> list[NDArray[Any]]:
        view = view_of(scenes.stepped)
        return arrays_of(ibr.warp(view, view.camera.moved(*move), **how))

    return call


def drawn(make: Callable[[], Any], lit: bool = True, relight: bool = False, anisotropy: int = 1) -> Call:
    def call() -> list[NDArray[Any]]:
        light = ibr.Light(direction=(-1, -1, -1), shadow_size=64, relight=relight) if lit else None
        return arrays_of(ibr.render(make(), CAMERA, light, anisotropy=anisotropy))

    return call


def _blended() -> list[NDArray[Any]]:
    view = view_of(scenes.stepped)
    aside = ibr.warp(view, view.camera.moved(0.2, 0, 0.1))
    views = [view, ibr.DepthImage(aside.color, aside.depth, aside.camera)]
    return arrays_of(ibr.warp(views, view.camera.moved(0.1, 0.05, 0)))


def _blended_in_turns() -> list[NDArray[Any]]:
    """Blend with memory for only one view's layer, so that the other views are drawn twice."""
    with patch.multiple(blending, _HELD_BYTES=1, _HELD_MIN=1):
        return _blended()


def _with_background() -> list[NDArray[Any]]:
    view = view_of(scenes.stepped)
    camera = view.camera.moved(0.2, 0.1, 0.3)
    layer = ibr.background_layer(view, camera)
    return [layer.color, layer.depth, *arrays_of(ibr.warp([view, layer], camera))]


def _looked_through() -> list[NDArray[Any]]:
    views = scenes.ramp_and_empty(SIZE)
    return arrays_of(ibr.warp(views, views[0].camera.moved(0.1, 0.05, 0)))


def _through_a_lens() -> list[NDArray[Any]]:
    view = view_of(scenes.holed)
    aside = view.camera.moved(0.2, 0.1, 0.3)
    camera = ibr.Camera(aside.K, aside.size, aside.world_from_camera, lens=LENS)
    bent = ibr.DepthImage(view.color, view.depth, ibr.Camera(view.camera.K, SIZE, lens=LENS), far=view.far)
    straight = ibr.undistorted(bent)
    bends, straightens = ibr.warp(view, camera), ibr.warp(view, aside, fill="background")
    return [*arrays_of(bends), *arrays_of(straightens), straight.color, straight.depth]


def _registered() -> list[NDArray[Any]]:
    view = view_of(scenes.holed)
    there = ibr.Camera(view.camera.K, SIZE, view.camera.moved(0.2, 0.1, 0.1).world_from_camera, lens=LENS)
    depth, color = np.where(view.valid, view.depth, np.float32(np.nan)), view.color
    seen = ibr.register_color(depth, view.camera, there, color)
    tall = ibr.Camera(view.camera.K, (SIZE[0], 4 * SIZE[1]))  # more rows than one work-item takes
    counts = np.tile(ibr.uint16_from_depth(depth, 100), (4, 1))
    in_counts = ibr.register(counts, tall, tall.moved(0.2, 0.1, 0.1), depth_scale=100)
    return [ibr.register(depth, view.camera, there), in_counts, seen.color, seen.seen]


def _cleaned() -> list[NDArray[Any]]:
    view = view_of(scenes.holed)
    color = view.color.astype(np.float32) / np.float32(255)
    first = ibr.clean_depth(np.where(view.valid, view.depth, np.float32(np.nan)), view.color)
    return [*first, *ibr.clean_depth(view.depth, color, before=first.depth), ibr.sharpen_depth(view.depth)]


def _from_within() -> list[NDArray[Any]]:
    base, even = models.donut(12), np.full((4, 4), 0.5, np.float32)
    corner = base.vertices[base.faces[0]].astype(np.float64)
    across = np.cross(corner[1] - corner[0], corner[2] - corner[0])
    eye = corner.mean(axis=0) - 0.02 * across / np.linalg.norm(across)
    camera = ibr.Camera.look_at(eye, eye + corner[1] - corner[0], across, SIZE, fov_y=60)
    relief = ibr.ReliefSurface(base, even, np.full((2, 2, 3), 200, np.uint8), 0.1)
    assert relief.interior_point(camera) is not None
    return arrays_of(ibr.render(relief, camera))


def _simplified() -> list[NDArray[Any]]:
    mesh = ibr.DepthMesh(view_of(scenes.smooth))
    simple = mesh.simplify(0.01)
    return [simple.vertices, simple.faces, mesh.normals]


def _from_noisy_depth() -> list[NDArray[Any]]:
    view = view_of(scenes.smooth)
    noisy = ibr.DepthImage(view.color, view.depth, view.camera, noise=(0, 0, 0.01))
    return arrays_of(ibr.render(ibr.DepthMesh(noisy), view.camera.moved(0.2, 0, 0)))


def _gaussians() -> list[NDArray[Any]]:
    rng, count = np.random.default_rng(0), 3000
    shape = rng.uniform(0.01, 0.2, (count, 3)), rng.normal(size=(count, 4)), rng.random(count)
    cloud = ibr.Gaussians(rng.normal(0, 0.7, (count, 3)), *shape, sh=rng.normal(0, 0.3, (count, 16, 3)))
    bent = ibr.Camera(CAMERA.K, SIZE, CAMERA.world_from_camera, lens=LENS)
    frames = (
        ibr.render([cloud, models.donut(12)], CAMERA, background=(9, 90, 200)),
        ibr.render(cloud, CAMERA, samples=4),
        ibr.render(cloud, bent),
    )
    return [array for frame in frames for array in arrays_of(frame)]


def _with_features() -> list[NDArray[Any]]:
    known, rng = scenes.stepped(SIZE), np.random.default_rng(3)
    features = rng.random((*known.depth.shape, 19), np.float32)
    view = ibr.DepthImage(known.color, known.depth, known.camera, features=features)
    camera = known.camera.moved(0.2, 0.1, 0.3)
    frame = ibr.warp(view, camera)
    assert frame.features is not None
    return [*arrays_of(frame), frame.features, warp_transposed(view, camera, np.asarray(frame.features, np.float32))]


def calls() -> dict[str, Call]:
    """Return the calls by name. Each call makes new things, and returns the arrays of all its results."""
    views, base = object_views(models.donut(20), 32), models.donut(12)
    heights = np.random.default_rng(1).random((16, 16), dtype=np.float32)
    colors = np.random.default_rng(2).integers(0, 255, (16, 16, 3)).astype(np.uint8)
    warnings.simplefilter("ignore")
    return {
        "sweep": warped(),
        "connected": warped(edges="connect", fill="background", classes=True),
        "search": warped(method="search"),
        "forward": warped(method="forward", splat=3.0),
        "aside": warped((0.2, 0, 0), fill="background"),
        "blended": _blended,
        "looked through": _looked_through,
        "blended in turns": _blended_in_turns,
        "smooth": warped(fill="smooth"),
        "exemplar": warped(fill="exemplar"),
        "background": _with_background,
        "thin": warped(thin=True, cut_ratio=1.001, classes=True),
        "features": _with_features,
        "lens": _through_a_lens,
        "samples": warped(samples=4),
        "seen": drawn(lambda: MarkedUnseen(as_drawable(base), views)),
        "bounds": lambda: [surface_of(view_of(scenes.stepped), None).bounds.to_host()],  # only used on GPUs
        "noise": lambda: [np.array(view_of(scenes.stepped).noise)],
        "registered": _registered,
        "cleaned": _cleaned,
        "mesh": drawn(lambda: ibr.Mesh(base.vertices, base.faces)),
        "depth image": drawn(lambda: [view_of(scenes.stepped), ibr.Mesh(base.vertices, base.faces)]),
        "sliced": drawn(lambda: ibr.SlicedSurface(base, heights, colors, 0.2, slices=16)),
        "sliced by view": drawn(lambda: ibr.SlicedSurface(base, heights, colors, 0.2, slices="view")),
        "relief": drawn(lambda: ibr.ReliefSurface(base, heights, colors, 0.2)),
        "relief from within": _from_within,
        "filtered": drawn(lambda: ibr.ReliefSurface(base, heights, colors, 0.2), anisotropy=8),
        "object": drawn(lambda: ibr.DepthObject(views, slices=16)),
        "thin object": drawn(
            lambda: ibr.DepthObject(object_views(models.donut(20), 32), slices=16, thin=True), lit=False
        ),
        "hull": drawn(lambda: ibr.VisualHull(views, slices=16), lit=False),
        "relit": drawn(lambda: [view_of(scenes.stepped), ibr.DepthObject(views, slices=16)], relight=True),
        "relit hull": drawn(lambda: ibr.VisualHull(views, slices=16), relight=True),
        "relit depth mesh object": drawn(lambda: ibr.DepthMeshObject(views), relight=True),
        "depth mesh": drawn(lambda: ibr.DepthMesh(views[4]), lit=False),
        "depth mesh object": drawn(lambda: ibr.DepthMeshObject(views)),
        "depth mesh of noise": _from_noisy_depth,
        "simplified": _simplified,
        "gaussians": _gaussians,
        "captured": lambda: [capture(base, ibr.Camera(CAMERA.K, SIZE, CAMERA.world_from_camera, lens=LENS)).depth],
        "meshed": lambda: [ibr.DepthObject(views).to_mesh(16).vertices],
    }


def same(found: list[NDArray[Any]], expected: list[NDArray[Any]]) -> bool:
    """Tell whether arrays have the same bits."""
    pairs = zip(found, expected, strict=True)
    return all(a.shape == b.shape and a.tobytes() == b.tobytes() for a, b in pairs)
