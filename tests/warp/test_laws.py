"""Laws that hold for any warp of any scene, so that the right result is known without a second renderer."""

from __future__ import annotations

from itertools import permutations

import cv2
import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from pyibr.opencl.watch import watching
from pyibr.warp.view import WarpOptions
from tests import scenes
from tests.builds import Builds
from tests.exact import KEPT_ULP, same_bits

PROJECTIONS = ("perspective", "orthographic")
METHODS = ("epipolar", "search", "forward")
SIZE = (96, 64)


def pinhole(size: scenes.Size, focal: float = 60.0) -> Camera:
    return Camera([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]], size)


def image(depth: np.ndarray, camera: Camera, **options: float) -> ibr.DepthImage:
    """Depth image of ``depth`` with the scenes' texture."""
    return ibr.DepthImage(
        scenes.texture(*scenes.image_coordinates(camera.size)), depth.astype(np.float32), camera, **options
    )


# --- standing still ----------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (5, 1), (7, 13), (61, 37), (64, 64)], ids=str)
@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("sample", ["linear", "nearest"])
@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_the_same_camera_copies(size, projection, sample, dtype):
    view = scenes.stepped(size, projection)
    color = view.color if dtype == np.uint8 else (view.color / np.float32(255)).astype(np.float32)
    view = ibr.DepthImage(color, view.depth, view.camera)
    frame = ibr.warp(view, view.camera, interpolation=sample)
    assert frame.valid.all()
    np.testing.assert_array_max_ulp(frame.depth, view.depth, KEPT_ULP)
    # Float colours are weighted sums, with 4 roundings.
    np.testing.assert_allclose(frame.color, color, rtol=0, atol=0 if dtype == np.uint8 else 4 * 2**-24)


@pytest.mark.parametrize("bad", [np.nan, 0.0, -1.0, np.inf, -np.inf, 100.0, 1e30])
def test_every_kind_of_no_surface_is_the_same_hole(bad):
    camera = pinhole(SIZE)
    depth = np.full(SIZE[::-1], 2.0, np.float32)
    depth[20:40, 30:60] = bad
    frame = ibr.warp(image(depth, camera, far=100.0), camera.moved(0.1, 0, 0))  # a shift of 3 pixels
    hole = np.zeros(SIZE[::-1], bool)
    hole[20:40, 27:57] = True
    hole[:, -3:] = True
    grown = cv2.dilate(hole.astype(np.uint8), np.ones((3, 3))).astype(bool)
    assert not frame.valid[hole].any()
    assert frame.valid[~grown].all()
    np.testing.assert_allclose(frame.depth[frame.valid], 2, rtol=1e-6)  # float32, after a dozen operations


def test_a_far_background_is_no_surface():
    camera = pinhole(SIZE)
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    disc = (x - 47) ** 2 + (y - 31) ** 2 < 400
    view = image(np.where(disc, 2.0, 50.0), camera, far=50.0)
    np.testing.assert_array_equal(ibr.warp(view, camera).valid, disc)  # each ray passes through a sample
    # The disc's surface fills its samples' pixels. Moved by 0.3 and 0.6 pixels, it covers the same number of pixels.
    assert ibr.warp(view, camera.moved(0.01, 0.02, 0)).valid.sum() == disc.sum()
    everything = image(np.where(disc, 2.0, 50.0), camera)
    assert ibr.warp(everything, camera).valid.all()


# --- planes ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("pixels", [(5, 0), (-7, 0), (0, 4), (0, -6), (9, -11)], ids=str)
def test_a_wall_shifts_by_focal_times_baseline_over_depth(method, pixels):
    camera, z = pinhole(SIZE), 3.0
    view = image(np.full(SIZE[::-1], z), camera)
    dx, dy = pixels
    frame = ibr.warp(view, camera.moved(dx * z / 60, dy * z / 60, 0), method=method)
    expected = np.zeros_like(view.color)
    there = np.zeros(SIZE[::-1], bool)
    source = np.s_[max(dy, 0) : SIZE[1] + min(dy, 0), max(dx, 0) : SIZE[0] + min(dx, 0)]
    target = np.s_[max(-dy, 0) : SIZE[1] + min(-dy, 0), max(-dx, 0) : SIZE[0] + min(-dx, 0)]
    expected[target], there[target] = view.color[source], True
    # Rounding decides whether rays through the outermost samples meet the surface's border.
    inner = cv2.erode(there.astype(np.uint8), np.ones((3, 3))).astype(bool)
    assert not frame.valid[~there].any()
    assert frame.valid[inner].all()
    np.testing.assert_array_equal(frame.color[frame.valid], expected[frame.valid])
    np.testing.assert_allclose(frame.depth[frame.valid], z, rtol=1e-6)


@pytest.mark.parametrize("move", [(0.3, 0, 0), (0.1, -0.2, 0.4), (0, 0, -0.7)], ids=str)
def test_a_plane_is_its_homography(move):
    """A slanted plane n . X = d seen by a turned camera, which cv2 draws by H = K (R - t n^T / d) K^-1."""
    camera = pinhole(SIZE)
    normal, d = np.array([0.15, -0.1, 1.0]), 3.0
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    ray = np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(camera.K).T
    view = image(d / (ray @ normal), camera)
    target = Camera(camera.K, SIZE, scenes.pose(yaw=4, pitch=-3, roll=7, center=move))
    target_from_source = target.camera_from_world
    H = (
        camera.K
        @ (target_from_source[:3, :3] + np.outer(target_from_source[:3, 3], normal) / d)
        @ np.linalg.inv(camera.K)
    )
    frame = ibr.warp(view, target)
    drawn = cv2.warpPerspective(view.color.astype(np.float32), H, SIZE, flags=cv2.INTER_LINEAR)
    inside = cv2.warpPerspective(np.ones(SIZE[::-1], np.float32), H, SIZE, flags=cv2.INTER_LINEAR) > 1 - 1e-6
    inner = cv2.erode(inside.astype(np.uint8), np.ones((3, 3))).astype(bool)
    assert inner.mean() > 0.5
    assert frame.valid[inner].all()
    # 3 of 255: cv2 interpolates four samples, the warp three (a triangle), and cv2 rounds positions to 1/32 of a pixel.
    off = np.abs(frame.color.astype(np.float64) - drawn)[inner]
    assert off.max() <= 3
    assert off.mean() < 0.5
    # Depth has a closed form: the target's ray intersected with the plane.
    rotation, center = target.world_from_camera[:3, :3], target.center
    expected = (d - center @ normal) / (ray @ rotation.T @ normal)
    np.testing.assert_allclose(frame.depth[inner], expected[inner], rtol=2e-6)


# --- scale and order ---------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("scale", [2.0**-6, 2.0**10])
def test_scaling_depth_and_baseline_together_changes_nothing(method, scale):
    """A scale that is a power of two changes only exponents, so that depths scale exactly and colours stay the same."""
    view = scenes.stepped(SIZE)

    def scaled(camera: Camera) -> Camera:
        pose = camera.world_from_camera.copy()
        pose[:3, 3] *= scale
        return Camera(camera.K, camera.size, pose)

    larger = ibr.DepthImage(view.color, view.depth * np.float32(scale), scaled(view.camera))
    for region in "AEF":
        for pose in scenes.target_cameras(view, region):
            one, other = (
                ibr.warp(view, pose.camera, method=method),
                ibr.warp(larger, scaled(pose.camera), method=method),
            )
            same_bits(one, ibr.Frame(other.color, other.depth / np.float32(scale), other.valid, pose.camera))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("sample", ["linear", "nearest"])
def test_the_same_bits_every_time(method, sample):
    view = scenes.stepped(SIZE)
    for pose in scenes.target_cameras(view, "E") + scenes.special_cameras(view):
        first = ibr.warp(view, pose.camera, method=method, interpolation=sample, fill="background")
        for _ in range(3):
            same_bits(first, ibr.warp(view, pose.camera, method=method, interpolation=sample, fill="background"))
        fresh = ibr.DepthImage(view.color, view.depth, view.camera)  # no buffer is kept on the device
        same_bits(first, ibr.warp(fresh, pose.camera, method=method, interpolation=sample, fill="background"))


def three_views() -> list[ibr.DepthImage]:
    """Views from three places, of three different surfaces, so that no depths are equal."""
    first = scenes.stepped(SIZE)
    turned = [
        scenes.pose(yaw=8, center=(-0.5, 0.1, 0.2)),
        scenes.pose(yaw=-9, pitch=4, center=(0.6, 0, -0.1)),
    ]
    cameras = [Camera(first.camera.K, SIZE, first.camera.world_from_camera @ pose) for pose in turned]
    smooth, holed = scenes.smooth(SIZE), scenes.holed(SIZE)
    return [
        first,
        ibr.DepthImage(255 - smooth.color, smooth.depth * np.float32(1.07), cameras[0]),
        ibr.DepthImage(holed.color // 2, holed.depth * np.float32(0.93), cameras[1], far=holed.far * 0.93),
    ]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("sample", ["linear", "nearest"])
@pytest.mark.parametrize("edges", ["connect", "cut"])
def test_several_views_are_their_frames_merged_by_depth_in_any_order(method, sample, edges):
    views = three_views()
    targets = [p.camera for place in "AE" for p in scenes.target_cameras(views[0], place)]
    for target in [*targets, views[0].camera, views[2].camera]:
        alone = [ibr.warp(view, target, method=method, interpolation=sample, edges=edges) for view in views]
        depths = np.stack([np.where(frame.valid, frame.depth, np.inf) for frame in alone])
        nearest = depths.argmin(axis=0)
        valid = np.isfinite(depths.min(axis=0))
        color = np.take_along_axis(np.stack([f.color for f in alone]), nearest[None, ..., None], 0)[0]
        expected = ibr.Frame(color, np.where(valid, depths.min(axis=0), np.nan).astype(np.float32), valid, target)
        options: WarpOptions = {"method": method, "interpolation": sample, "edges": edges, "blend": "nearest"}
        if edges == "cut" and method != "forward":
            # The margin, half a sample wide along edges, is removed where other views have looked through it.
            merged = ibr.warp(views, target, **options)
            assert not (merged.valid & ~expected.valid).any()
            is_same = (merged.valid == expected.valid) & (~merged.valid | (merged.depth == expected.depth))
            assert is_same.mean() > 0.9  # the views have holes and contradict each other
            expected = merged
        for order in permutations(views):
            merged = ibr.warp(order, target, **options)
            np.testing.assert_array_equal(merged.valid, expected.valid)
            np.testing.assert_array_equal(merged.depth, expected.depth)
            np.testing.assert_array_equal(merged.color, expected.color)


@pytest.mark.parametrize("method", METHODS)
def test_a_view_that_sees_nothing_changes_nothing(method):
    view = scenes.stepped(SIZE)
    away = Camera(view.camera.K, SIZE, view.camera.world_from_camera @ scenes.pose(yaw=180, center=(0, 0, -20)))
    elsewhere = ibr.DepthImage(view.color, view.depth, away)
    target = view.camera.moved(0.2, 0.1, 0)
    alone = ibr.warp(view, target, method=method)
    same_bits(alone, ibr.warp([view, elsewhere], target, method=method))
    same_bits(alone, ibr.warp([elsewhere, view], target, method=method))


# --- edges -------------------------------------------------------------------------------------------


def two_walls() -> tuple[ibr.DepthImage, Camera]:
    """A near wall left of column 48 and a far wall right of it; a camera farther right sees a gap between them."""
    camera = pinhole(SIZE)
    x = np.mgrid[: SIZE[1], : SIZE[0]][1]
    color = np.where(x[..., None] < 48, (200, 30, 30), (30, 30, 200)).astype(np.uint8)
    depth = np.where(x < 48, 2.0, 4.0).astype(np.float32)
    # The shift is 20 pixels at depth 2, and 10 pixels at depth 4.
    return ibr.DepthImage(color, depth, camera), camera.moved(20 * 2 / 60, 0, 0)


@pytest.mark.parametrize("method", ["epipolar", "search"])
def test_cut_opens_what_connect_stretches(method):
    view, target = two_walls()
    connected, cut = (ibr.warp(view, target, method=method, edges=edges) for edges in ("connect", "cut"))
    # The near wall ends at column 47 - 20 = 27, the far wall begins at 48 - 10 = 38. There, rounding may decide.
    gap = np.s_[:, 28:38]
    assert connected.valid[:, :84].all()
    assert not cut.valid[gap].any()
    assert cut.valid[:, :27].all()
    assert cut.valid[:, 39:84].all()
    stretched = connected.depth[gap]
    assert (np.diff(stretched, axis=1) > 0).all()
    assert ((stretched > 2) & (stretched < 4)).all()
    for frame in (connected, cut):
        np.testing.assert_allclose(frame.depth[:, :27], 2, rtol=1e-6)
        np.testing.assert_allclose(frame.depth[:, 39:84], 4, rtol=1e-6)
        assert (frame.color[:, :27] == (200, 30, 30)).all()
        assert (frame.color[:, 39:84] == (30, 30, 200)).all()


def test_the_cut_ratio_is_the_ratio_that_is_cut():
    view, target = two_walls()
    assert ibr.warp(view, target, edges="cut", cut_ratio=2.001).valid[:, 28:38].all()
    assert not ibr.warp(view, target, edges="cut", cut_ratio=1.999).valid[:, 28:38].any()


@pytest.mark.parametrize("method", METHODS)
def test_edges_are_cut_unless_they_are_to_be_connected(method):
    view, target = two_walls()
    same_bits(ibr.warp(view, target, method=method), ibr.warp(view, target, method=method, edges="cut", cut_ratio=1.05))
    assert not ibr.warp(view, target, method=method).valid[:, 28:38].any()


# --- filling -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("fill", ["background", "smooth", "inpaint", "exemplar"])
@pytest.mark.parametrize("place", [*scenes.REGIONS, "special"])
def test_everything_is_filled_within_the_range_of_what_is_seen(place, fill):
    view = scenes.stepped((61, 37))
    poses = scenes.special_cameras(view) if place == "special" else scenes.target_cameras(view, place)
    for pose in poses:
        for method in METHODS:
            bare = ibr.warp(view, pose.camera, method=method, edges="cut")
            filled = ibr.warp(view, pose.camera, method=method, edges="cut", fill=fill)
            np.testing.assert_array_equal(filled.valid, bare.valid)
            if not bare.valid.any():
                assert np.isnan(filled.depth).all()
                continue
            low, high = np.nanmin(bare.depth), np.nanmax(bare.depth)
            assert filled.depth.min() >= low * (1 - 1e-5), pose.name
            assert filled.depth.max() <= high * (1 + 1e-5), pose.name


# --- colours -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("sample", ["linear", "nearest"])
@pytest.mark.parametrize("fill", [None, "background"])
def test_bytes_and_floats_agree(method, sample, fill):
    view = scenes.stepped(SIZE)
    floats = ibr.DepthImage(view.color.astype(np.float32) / np.float32(255), view.depth, view.camera)
    for pose in scenes.target_cameras(view, "E") + scenes.special_cameras(view)[2:5]:
        one = ibr.warp(view, pose.camera, method=method, interpolation=sample, edges="cut", fill=fill)
        other = ibr.warp(floats, pose.camera, method=method, interpolation=sample, edges="cut", fill=fill)
        np.testing.assert_array_equal(one.depth, other.depth)
        np.testing.assert_array_equal(one.valid, other.valid)
        assert other.color.dtype == np.float32
        # Levels of 255: half for rounding to bytes; one in filled pixels, which are means of rounded values.
        limit = 1.01 if fill else 0.501
        assert np.abs(one.color - other.color.astype(np.float64) * 255).max() <= limit, pose.name


@pytest.mark.parametrize("method", ["epipolar", "search", "forward"])
@pytest.mark.parametrize("source", ["perspective", "orthographic"])
@pytest.mark.parametrize("target", ["perspective", "orthographic"])
def test_only_what_is_before_the_camera_is_seen(method, source, target):
    view = scenes.stepped(SIZE, source)
    for forward in (0.0, 2.0, 4.5, 6.0):  # into the scene
        camera = Camera(scenes.target_intrinsics(SIZE, target), SIZE, projection=target).moved(0.1, 0.2, forward)
        frame = ibr.warp(view, camera, method=method, side="both")
        assert (frame.depth[frame.valid] > 0).all()


def test_one_program_resolves_whatever_is_zoomed():
    view, builds = scenes.stepped((41, 31)), Builds()
    with watching(builds):
        for scale in (1, 4):  # target pixels per sample
            camera = view.camera.moved(0.2, 0.1, 0.1).resized((41 * scale, 31 * scale))
            ibr.warp(view, camera)
    assert len([of for of in builds.of if of[0] == "resolve"]) == 1
