"""Lenses of sources and targets, compared with rays cast at the samples' surface; OpenCV computes the lenses."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import pyibr as ibr
from tests import scenes, truth
from tests.embree import pixels_of
from tests.exact import same_bits
from tests.one_lane import both_forms

pytest.importorskip("open3d")

DEPTH = 1e-3  # relative
RIGHT = 0.998  # fraction of the interior pixels that must be right; `interior` leaves in some that lie at thin parts
COLOR = 6.0  # greatest error, in levels of 255; colours are interpolated two or three times
SOURCE, TARGET = (200, 150), (180, 140)

LENSES = {
    "none": None,
    "barrel": ibr.Lens("brown_conrady", [-0.22, 0.05, 0.002, -0.001, 0.002]),
    "pincushion": ibr.Lens("brown_conrady", [0.18, 0.03, 0, 0, 0]),
    "rational": ibr.Lens("rational", [0.548, -0.021, 2e-05, -7e-05, -0.0027, 0.89, 0.086, -0.0139]),
    "modified": ibr.Lens("modified_brown_conrady", [-0.2, 0.05, 0, 0, 0]),
    "fisheye": ibr.Lens("kannala_brandt", [0.02, -0.01, 0.002, 0]),
}
POSES = {
    "identity": scenes.pose(),
    "aside": scenes.pose(center=(0.4, 0, 0)),
    "ahead": scenes.pose(center=(0.1, -0.1, 0.8)),
    "turned": scenes.pose(12, -8, 5, (-0.5, 0.3, 0.2)),
}


def with_lens(view: ibr.DepthImage, name: str) -> ibr.DepthImage:
    """The same arrays of colours and depth, as the picture of a camera with a lens."""
    camera = view.camera
    seen = ibr.Camera(camera.K, camera.size, camera.world_from_camera, lens=LENSES[name])
    return ibr.DepthImage(view.color, view.depth, seen, far=view.far)


@cache
def surface(scene: str, lens: str, edges: str = "cut") -> truth.Surface:
    return truth.Surface(with_lens(getattr(scenes, scene)(SOURCE), lens), edges)


def target(view: ibr.DepthImage, lens: str, pose: np.ndarray, size=TARGET) -> ibr.Camera:
    K = scenes.target_intrinsics(size)
    return ibr.Camera(K, size, view.camera.world_from_camera @ pose, lens=LENSES[lens])


def check(seen: truth.Truth, frame: ibr.Frame, name: str) -> None:
    interior = seen.interior(4)
    assert interior.sum() > 1000, f"{name}: the truth consists of edges"
    right = frame.valid & np.isclose(frame.depth, seen.depth, rtol=DEPTH, atol=0)
    assert right[interior].mean() >= RIGHT, f"{name}: {right[interior].mean()}"
    # Two pixels or more from silhouettes, no pixel may be lost or made up.
    lost, made_up = ~frame.valid & seen.interior(2), frame.valid & ~truth.dilate(seen.valid, 2)
    lost = lost[2:-2, 2:-2]  # silhouettes outside of the image are not in the truth
    assert not lost.any(), f"{name}: {lost.sum()} lost"
    assert not made_up.any(), f"{name}: {made_up.sum()} made up"
    off = np.abs(frame.color.astype(np.float64) - seen.color).max(axis=-1)
    assert np.percentile(off[interior & right], 99.9) <= COLOR, name


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("scene", ["smooth", "stepped"])
@pytest.mark.parametrize("lens", LENSES)
def test_sources_with_lenses_are_the_surfaces_of_their_samples(lens, scene, pose):
    here = surface(scene, lens)
    camera = target(here.view, "none", POSES[pose])
    check(here.cast(camera), ibr.warp(here.view, camera), pose)


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("scene", ["smooth", "stepped"])
@pytest.mark.parametrize("lens", LENSES)
def test_targets_with_lenses_see_along_their_pixels_rays(lens, scene, pose):
    here = surface(scene, "none")
    camera = target(here.view, lens, POSES[pose])
    seen = here.cast(camera)
    check(seen, ibr.warp(here.view, camera), pose)
    rendered = ibr.render(here.view, camera)
    check(seen, rendered, pose)


@pytest.mark.parametrize(
    ("source", "target_lens"), [("barrel", "fisheye"), ("fisheye", "rational"), ("rational", "barrel")]
)
@pytest.mark.parametrize("edges", ["cut", "connect"])
def test_lenses_on_both(source, target_lens, edges):
    here = surface("stepped", source, edges)
    camera = target(here.view, target_lens, POSES["turned"])
    check(here.cast(camera), ibr.warp(here.view, camera, edges=edges), f"{source}, {target_lens}")


WIDE = ibr.Lens("kannala_brandt", [-0.003269, 0.054053, -0.051594, 0.010749])  # a tracking camera that sees 170 degrees


def test_a_target_that_sees_nearly_half_of_the_world():
    """No pinhole picture holds this view: it is drawn as the faces of a cube, and must show no seam."""
    view = scenes.smooth((120, 90))
    here = truth.Surface(view, "cut")
    pose = view.camera.world_from_camera @ scenes.pose(8, -5, 3, (0.3, -0.2, 2.6))
    camera = ibr.Camera([[65, 0, 99], [0, 65, 89.5], [0, 0, 1]], (200, 180), pose, lens=WIDE)
    frame = ibr.warp(view, camera)
    seen = here.cast(camera)
    angle = np.degrees(np.arctan(np.hypot(*np.moveaxis(truth.straight(camera, rays_at(camera)), 2, 0)[:2])))
    assert (frame.valid & (angle > 60)).sum() > 500
    within = angle < 85
    right = np.isclose(frame.depth, seen.depth, rtol=DEPTH, atol=0)
    assert right[seen.interior(4) & within].mean() >= RIGHT
    assert not (~frame.valid & seen.interior(2) & within)[2:-2, 2:-2].any()
    assert not frame.valid[np.isnan(camera.ideal_positions(pixels_of(camera))[:, 0]).reshape(180, 200)].any()


def rays_at(camera: ibr.Camera) -> np.ndarray:
    pixels = np.column_stack([pixels_of(camera), np.ones(camera.width * camera.height)])
    return (pixels @ np.linalg.inv(camera.K).T).reshape(camera.height, camera.width, 3)


def test_a_source_that_sees_too_far_is_refused():
    camera = ibr.Camera([[65, 0, 99], [0, 65, 89.5], [0, 0, 1]], (200, 180), lens=WIDE)
    color, depth = np.zeros((180, 200, 3), np.uint8), np.full((180, 200), 2, np.float32)
    view = ibr.DepthImage(color, depth, camera)
    for draw in (lambda: ibr.warp(view, camera), lambda: ibr.render(view, camera), lambda: ibr.DepthMesh(view)):
        with pytest.raises(ibr.ArgumentError, match="depth: expected samples of a lens up to 75 degrees from its axis"):
            draw()
    depth[np.hypot(*np.moveaxis(pixels_of(camera).reshape(180, 200, 2) - [99, 89.5], 2, 0)) > 60] = np.nan
    frame = ibr.warp(ibr.DepthImage(color, depth, camera), camera)  # the pixels with depth lie in the permitted part
    assert frame.valid.mean() > 0.2


@pytest.mark.parametrize("lens", ["barrel", "pincushion", "fisheye"])
def test_from_its_own_camera_a_view_is_itself(lens):
    view = with_lens(scenes.holed(SOURCE), lens)
    frame = ibr.warp(view, view.camera)
    inside = truth.dilate(~view.valid, 2)
    step = np.zeros_like(inside)
    for axis in (0, 1):
        ratio = np.abs(np.diff(np.log(np.where(view.valid, view.depth, 1)), axis=axis)) > 0.002
        step |= np.pad(ratio, [(0, 1) if a == axis else (0, 0) for a in (0, 1)])
    smooth = ~(inside | truth.dilate(step, 2))
    assert smooth.mean() > 0.2
    assert frame.valid[smooth].all()
    np.testing.assert_allclose(frame.depth[smooth], view.depth[smooth], rtol=DEPTH)
    assert (frame.valid != view.valid).mean() < 0.01


def test_nearest_samples_are_never_mixed():
    view = with_lens(scenes.stepped(SOURCE), "barrel")
    labels = (np.indices(view.depth.shape).sum(axis=0) % 5 * 50).astype(np.uint8)
    marked = ibr.DepthImage(np.repeat(labels[..., None], 3, 2), view.depth, view.camera)
    for camera in (view.camera.moved(0.2, 0, 0), target(view, "none", POSES["turned"])):
        for frame in (
            ibr.warp(marked, camera, interpolation="nearest"),
            ibr.render(ibr.WarpedView(marked, interpolation="nearest"), camera),
        ):
            assert set(np.unique(frame.color[frame.valid])) <= set(range(0, 201, 50))
    assert len(np.unique(ibr.warp(marked, view.camera).color)) > 50


def test_origins_are_pixels_of_the_lens():
    here = surface("stepped", "barrel")
    camera = target(here.view, "fisheye", POSES["turned"])
    frame, seen = ibr.warp(here.view, camera, classes=True), here.cast(camera)
    interior = seen.interior(4) & frame.valid
    assert np.abs(frame.source - seen.source)[interior].max() < 0.15
    assert (frame.view == np.where(frame.valid, 0, -1)).all()
    assert (frame.classes == ibr.PixelClass.SEEN)[frame.valid].all()
    assert (frame.classes[~frame.valid] > 0).all()
    alone = ibr.warp(here.view, camera, origins=True)
    assert alone.classes is None
    np.testing.assert_array_equal(alone.source, frame.source)
    np.testing.assert_array_equal(alone.view, frame.view)


def test_several_views_and_targets_and_given_frames():
    views = [with_lens(scenes.stepped(SOURCE), "barrel"), scenes.smooth(SOURCE)]
    cameras = [target(views[0], lens, POSES["aside"]) for lens in ("fisheye", "none")]
    together = ibr.warp(views, cameras, fill="background")
    alone = [ibr.warp(views, camera, fill="background") for camera in cameras]
    for camera, frame, one in zip(cameras, together, alone, strict=True):
        same_bits(frame, one)
        assert frame.camera == camera
    again = ibr.warp(views, cameras, fill="background", out=together)
    assert again[0].color is together[0].color
    np.testing.assert_array_equal(again[0].color, alone[0].color)


@pytest.mark.parametrize(
    ("samples", "lens", "fill"), [(1, "barrel", "background"), (4, "fisheye", "background"), (1, "fisheye", "inpaint")]
)
def test_what_was_seen_stays_as_it_was_seen_where_holes_are_filled(samples, lens, fill):
    view = scenes.stepped(SOURCE)
    camera = target(view, lens, POSES["aside"])
    bare, frame = (ibr.warp(view, camera, fill=way, samples=samples) for way in (None, fill))
    seen = bare.valid
    np.testing.assert_array_equal(frame.valid, seen)
    np.testing.assert_array_equal(frame.depth[seen], bare.depth[seen])
    whole = seen if bare.alpha is None else bare.alpha == 1
    np.testing.assert_array_equal(frame.color[whole], bare.color[whole])
    filled = ~seen & np.isfinite(frame.depth)
    assert filled.mean() > 0.01


@pytest.mark.parametrize("seen_by", ["source", "target"])
def test_lenses_whose_rays_find_no_memory_say_so(monkeypatch, seen_by):
    def refuse(*_: object, **__: object) -> None:
        raise MemoryError("Unable to allocate 488 MiB")

    view = scenes.smooth((23, 17))
    lens = ibr.Camera(view.camera.K, (23, 17), lens=LENSES["fisheye"])
    monkeypatch.setattr("pyibr.core.undistortion._rays", refuse)
    with pytest.raises(ibr.OutOfMemoryError, match=r"not enough memory on .*488 MiB"):
        if seen_by == "source":
            ibr.warp(ibr.DepthImage(view.color, view.depth, lens), view.camera)
        else:
            ibr.warp(view, lens)


@pytest.mark.thorough
def test_depth_alone_through_lenses():
    view = with_lens(scenes.stepped(SOURCE), "barrel")
    camera = target(view, "fisheye", POSES["turned"])
    expected = ibr.warp(view, camera)
    frame = ibr.warp(ibr.DepthImage(None, view.depth, view.camera), camera)
    assert frame.color.shape == (*TARGET[::-1], 0)
    np.testing.assert_array_equal(frame.depth, expected.depth)
    np.testing.assert_array_equal(frame.valid, expected.valid)
    white = ibr.render(ibr.DepthImage(None, view.depth, view.camera), camera)
    assert (white.color[white.valid] == 255).all()


@pytest.mark.thorough
def test_one_lane_sees_the_same():
    view = with_lens(scenes.stepped((61, 37)), "barrel")
    camera = target(view, "fisheye", POSES["turned"], (53, 41))
    color, depth = view.color, view.depth
    wide, narrow = both_forms(lambda: ibr.warp(ibr.DepthImage(color, depth, view.camera), camera, classes=True))
    np.testing.assert_array_equal(wide.valid, narrow.valid)
    np.testing.assert_allclose(wide.depth, narrow.depth, rtol=1e-5)
    assert np.abs(wide.color.astype(int) - narrow.color).max() <= 1
    np.testing.assert_array_equal(wide.classes, narrow.classes)


@pytest.mark.parametrize("size", [(1, 1), (7, 13), (17, 2), (16, 16)])
def test_small_images(size):
    camera = ibr.Camera(
        [[20, 0, (size[0] - 1) / 2], [0, 20, (size[1] - 1) / 2], [0, 0, 1]], size, lens=LENSES["barrel"]
    )
    color, depth = np.full((*size[::-1], 3), 77, np.uint8), np.full(size[::-1], 2, np.float32)
    for target_size in ((1, 1), (7, 13)):
        frame = ibr.warp(ibr.DepthImage(color, depth, camera), camera.resized(target_size))
        assert frame.valid.any()
        np.testing.assert_allclose(frame.depth[frame.valid], 2, rtol=1e-5)
        assert (frame.color[frame.valid] == 77).all()


@pytest.mark.parametrize("pose", ["identity", "aside", "turned"])
@pytest.mark.parametrize(("source", "target_lens"), [("barrel", "none"), ("none", "barrel"), ("pincushion", "fisheye")])
def test_between_an_object_and_what_is_behind_it_there_is_nothing(source, target_lens, pose):
    """Each depth and colour is the disk's or the wall's, even at silhouettes, never a mixture."""
    camera = with_lens(scenes.flat(SOURCE), source).camera
    y, x = np.indices(SOURCE[::-1])
    disk = np.hypot(x - 90, y - 70) < 40
    color = np.where(disk[..., None], np.uint8([250, 0, 0]), np.uint8([0, 0, 250]))
    view = ibr.DepthImage(color, np.where(disk, 2, 4).astype(np.float32), camera)
    new = target(view, target_lens, POSES[pose])
    for frame in (ibr.warp(view, new), ibr.render(view, new)):
        pixels = pixels_of(new)
        points = new.unproject(pixels, frame.depth.ravel()) @ camera.camera_from_world[:3, :3].T
        z = (points + camera.camera_from_world[:3, 3])[:, 2].reshape(frame.depth.shape)
        near, far = np.isclose(z, 2, rtol=0.01), np.isclose(z, 4, rtol=0.01)  # 1 %: edges are half a pixel off
        assert (near | far)[frame.valid].all()
        assert near.sum() > 500
        assert far.sum() > 500
        assert (frame.color[near, 0] > 248).all()
        assert (frame.color[far, 2] > 248).all()
