"""Torn samples, and the ring of samples beyond an image's border, compared with a reference and in pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.core.camera import Projection
from pyibr.opencl import launch
from pyibr.opencl.device import one_call
from pyibr.opencl.headers import constant
from pyibr.opencl.in_flight import KernelCost
from pyibr.opencl.memory import DeviceArray, empty
from pyibr.picture import samples, surface
from pyibr.picture.samples import samples_of
from pyibr.picture.surface import make_surface, straightness_test, surface_of
from tests import scenes
from tests.data import shared
from tests.exact import KEPT_ULP
from tests.reference.edges import edges_of, with_ring

Array = NDArray[Any]
PROJECTIONS: tuple[Projection, ...] = ("perspective", "orthographic")
F = 525.0
CAMERA = ibr.Camera([[F, 0, 319.5], [0, F, 239.5], [0, 0, 1]], (640, 480))
DOWN = np.arange(480)[:, None] - CAMERA.K[1, 2] + np.zeros(640)
F_B = 40.0  # focal length times baseline of a depth camera, in pixels times metres


def image(depth: Array, camera: ibr.Camera = CAMERA, **options: Any) -> ibr.DepthImage:
    return ibr.DepthImage(np.full((*depth.shape, 3), 128, np.uint8), depth.astype(np.float32), camera, **options)


def floor(height: float, turned: float = 0.0) -> Array:
    """Depth of a floor `height` below the camera, up to 200 m away; `turned`: the horizon's slope."""
    below = DOWN + turned * (np.arange(640) - 320)
    with np.errstate(divide="ignore"):
        depth = np.where(below > 0, height * F / np.maximum(below, 1e-9), np.nan)
    return np.where(depth < 200, depth, np.nan)


def rough(size: tuple[int, int], projection: Projection) -> ibr.DepthImage:
    """A view with slopes, bends, steps, noise and holes."""
    rng = np.random.default_rng(3)
    view = scenes.stepped(size, projection)
    depth = view.depth * (1 + 0.004 * rng.standard_normal(view.depth.shape))
    depth += 0.8 * (rng.random(depth.shape) < 0.05)
    depth[rng.random(depth.shape) < 0.08] = np.nan
    return image(depth, view.camera)


def surface_on_host(view: ibr.DepthImage, cut_ratio: float | None, connected: bool) -> tuple[Array, Array]:
    """(H + 2, W + 2) nearness (1/depth) with the ring, and the samples' bits for torn edges."""
    width, height = view.camera.size
    with one_call():
        made = surface_of(view, cut_ratio, connected).nearness.to_host()[: height + 2, : width + 2].copy()
    return made, made.view(np.int32) & 7


@pytest.mark.usefixtures("lanes")
@pytest.mark.parametrize("size", [(1, 1), (1, 5), (6, 1), (2, 2), (7, 13), (61, 37)], ids=str)
@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize(("edges", "cut_ratio"), [("cut", None), ("cut", 1.05), ("connect", None)])
def test_edges_and_ring_are_the_references(size, projection, edges, cut_ratio):
    view = rough(size, projection)
    if not view.valid.any():
        view = scenes.flat(size, projection)
    near, bits = surface_on_host(view, cut_ratio, edges == "connect")
    expected, torn = with_ring(view, edges_of(view, edges, cut_ratio))
    there = np.isfinite(expected)
    np.testing.assert_array_equal(near > -1e37, there)
    np.testing.assert_allclose(near[there], expected[there], rtol=KEPT_ULP * 2**-24)
    # Bits of the ring's last column and row say nothing: no cell is to the right of them or below.
    for bit, found in ((1, torn.right), (2, torn.below), (4, torn.diagonal)):
        inside = there.copy()
        inside[-1, :] &= bit == 1
        inside[:, -1] &= bit == 2
        np.testing.assert_array_equal((bits & bit != 0)[inside], found[inside], err_msg=str(bit))


@pytest.mark.usefixtures("lanes")
@pytest.mark.parametrize("size", [(1, 1), (1, 5), (8, 7), (7, 13), (61, 37), (143, 96)], ids=str)
@pytest.mark.parametrize("projection", PROJECTIONS)
def test_bounds_are_those_of_the_samples_around_each_cell(size, projection):
    view = rough(size, projection)
    if not view.valid.any():
        view = scenes.flat(size, projection)
    near, _ = surface_on_host(view, None, False)
    with one_call():
        bounds = surface_of(view, None).bounds.to_host().copy()
    step = int(constant("lib/bounds.h", "BOUNDS_STEP"))
    width, height = size
    assert bounds.shape == (height // step + 1, width // step + 1, 2)
    for y, x in np.ndindex(bounds.shape[:2]):
        samples = near[y * step : (y + 2) * step + 1, x * step : (x + 2) * step + 1]
        there, (low, high) = samples[samples > -1e37], bounds[y, x]
        if there.size:  # 1.2e-6 allows for rounding of interpolated nearness
            assert there.min() * 1.0 - 1.2e-6 * np.abs(there).max() <= low <= there.min() <= there.max() <= high
            assert high <= there.max() + 1.2e-6 * np.abs(there).max()
        else:
            assert low > 1e38 and high < -1e38


@pytest.mark.parametrize("method", ["epipolar", "search", "forward"])
@pytest.mark.parametrize("zoom", [1, 2, 3])
@pytest.mark.parametrize("projection", PROJECTIONS)
def test_a_picture_covers_its_own_cameras_whatever_their_resolution(method, zoom, projection):
    view = scenes.flat((61, 37), projection)
    splat = float(zoom + 1) if method == "forward" else 1.0
    frame = ibr.warp(view, view.camera.resized((61 * zoom, 37 * zoom)), method=method, splat=splat)
    assert frame.valid.all()


def test_several_samples_a_pixel_leave_the_rim_as_bright():
    view = image(np.full((48, 64), 2.0), ibr.Camera([[60, 0, 31.5], [0, 60, 23.5], [0, 0, 1]], (64, 48)))
    frame = ibr.warp(view, view.camera, samples=4)
    assert (frame.color == 128).all()
    assert frame.alpha is not None
    assert (frame.alpha == 1).all()


@pytest.mark.parametrize("method", ["epipolar", "search"])
def test_tiles_of_one_picture_meet(method):
    """A picture is cut into tiles with their own cameras; warped together, they meet without gaps or bends."""
    view = image(
        1 / (0.3 + 0.002 * np.arange(60) + 0.001 * np.arange(48)[:, None]), ibr.Camera(np.diag([60.0, 60, 1]), (60, 48))
    )
    parts = [(slice(0, 24), slice(0, 31)), (slice(0, 24), slice(31, 60)), (slice(24, 48), slice(0, 60))]
    tiles = [
        image(
            view.depth[part],
            ibr.Camera(
                view.camera.K - [[0, 0, x.start], [0, 0, y.start], [0, 0, 0]], (x.stop - x.start, y.stop - y.start)
            ),
        )
        for part in parts
        for y, x in [part]
    ]
    there = view.camera.moved(0.07, -0.04, 0.05)
    whole, joined = (ibr.warp(views, there, method=method, blend="nearest") for views in (view, tiles))
    np.testing.assert_array_equal(joined.valid, whole.valid)
    # Each tile is extended beyond its border from its own samples, which are float32.
    np.testing.assert_allclose(joined.depth[whole.valid], whole.depth[whole.valid], rtol=1e-5)


@pytest.mark.parametrize("method", ["epipolar", "search"])
def test_six_images_of_a_cube_map_leave_no_line_between_them(method):
    n, radius = 96, 3.0
    K = np.array([[n / 2, 0, (n - 1) / 2], [0, n / 2, (n - 1) / 2], [0, 0, 1]])
    y, x = np.mgrid[:n, :n]
    depth = radius / np.sqrt(((x - K[0, 2]) / K[0, 0]) ** 2 + ((y - K[1, 2]) / K[1, 1]) ** 2 + 1)
    turns = [scenes.pose(yaw=90 * i) for i in range(4)] + [scenes.pose(pitch=90), scenes.pose(pitch=-90)]
    views = [image(depth, ibr.Camera(K, (n, n), turn)) for turn in turns]
    K_eye = [[150, 0, 127.5], [0, 150, 127.5], [0, 0, 1]]
    for turn in (scenes.pose(yaw=45, pitch=35, center=(0.2, 0.1, -0.1)), scenes.pose(yaw=200, pitch=-40, roll=20)):
        assert ibr.warp(views, ibr.Camera(K_eye, (256, 256), turn), method=method).valid.all()


# --- depth edges -------------------------------------------------------------------------------------


def share_empty(view: ibr.DepthImage, truth: Array, far: float) -> float:
    """Fraction of the floor's pixels that are empty in the picture of a camera a little ahead."""
    frame = ibr.warp(view, CAMERA.moved(0.1, 0, 0.3))
    inside = truth < far
    inside[:, :60] = inside[:, -60:] = inside[-60:] = False
    assert inside.sum() > 40_000
    return float((~frame.valid)[inside].mean())


@pytest.mark.parametrize("turned", [0.0, 0.1])
@pytest.mark.parametrize("height", [0.3, 1.5])
def test_a_floor_that_recedes_is_one_surface(height, turned):
    truth = floor(height, turned)
    # A tilted floor's samples end in a jagged line; it is outside the counted pixels by a row or two.
    assert share_empty(image(truth), truth, 100.0) < 1e-3


@pytest.mark.parametrize("pixels", [0.1, 0.3])
@pytest.mark.parametrize(("given", "height", "turned"), [(True, 1.5, 0.1), (False, 1.5, 0.1), (False, 0.3, 0.0)])
def test_noise_tears_no_floor(pixels, given, height, turned):
    """Noise of up to an eighth of the disparity tears no floor. In the sky, disparities below 0 have no depth."""
    truth = floor(height, turned)
    deviation = ibr.disparity_noise(pixels, F, F_B / F)
    near = np.nan_to_num(1 / truth) + np.random.default_rng(0).normal(0, deviation, truth.shape)
    with np.errstate(divide="ignore"):
        depth = np.where(near > 0, 1 / near, np.nan)
    view = image(depth, noise=deviation) if given else image(depth)
    # The test predicts depths from noisy samples: a few edges in ten thousand differ by over four deviations.
    assert share_empty(view, truth, F_B / (8 * pixels)) < 1e-3


@pytest.mark.parametrize("per_pixel", [4, 8, 16])
@pytest.mark.parametrize(
    ("height", "turned"), [(0.3, 0.0), (0.8, 0.0), (0.8, 0.3), (1.5, 0.1), (1.5, 0.3), (3.0, 0.0), (3.0, 0.3)]
)
def test_steps_of_a_scale_tear_no_floor(per_pixel, height, turned):
    truth = floor(height, turned)
    steps = np.rint(F_B / truth * per_pixel)
    with np.errstate(divide="ignore"):
        depth = np.where(steps > 0, per_pixel * F_B / steps, np.nan)
    view = image(depth)
    if any(view.steps):  # else steps count as noise, since most neighbours differ by a step
        assert view.steps == pytest.approx((1 / (per_pixel * F_B), 0, 0), rel=1e-3)
    assert share_empty(view, truth, 40.0 * 8 / max(per_pixel, 8)) == 0


def before_wall(distance: float, step: float) -> Array:
    depth = np.full((480, 640), float(distance))
    depth[160:320, 240:400] -= step
    return depth


@pytest.mark.parametrize(("distance", "step"), [(2, 0.1), (5, 0.3), (10, 0.3), (20, 0.5)])
def test_a_box_before_a_wall_is_torn_off(distance, step):
    frame = ibr.warp(image(before_wall(distance, step)), CAMERA.moved(0.2 * distance, 0, 0))
    moved = 0.2 * distance * F / (distance - step) - 0.2 * F  # pixels by which the box moves against the wall
    empty = ~frame.valid[200:280, 60:380]
    np.testing.assert_allclose(empty.sum(axis=1), moved, atol=1)  # in whole pixels


@pytest.mark.parametrize("height", [0.3, 1.5])
def test_a_level_cameras_floor_is_no_coarse_scale(height):
    """Each row of the floor has one depth, as with coarse steps; still, the box is torn off the wall behind it."""
    depth = np.minimum(np.nan_to_num(floor(height), nan=np.inf), 10.0)
    depth[60:220, 240:400] = 9.7
    view = image(depth)
    assert view.noise == (0, 0, 0)
    assert edges_of(view).right[60:220, [239, 399]].all()


@pytest.mark.parametrize("pixels", [0.1, 0.3])
def test_steps_larger_than_noise_explains_are_torn(pixels):
    """The step is eight deviations of a difference of neighbours, twice the limit, so noise joins only a few pairs."""
    deviation = pixels / F_B
    distance = 3.0
    step = distance - 1 / (1 / distance + 2 * 4 * np.sqrt(2) * deviation)
    near = 1 / before_wall(distance, step) + np.random.default_rng(1).normal(0, deviation, (480, 640))
    view = image(1 / near)
    torn = edges_of(view)
    sides = np.concatenate([torn.right[160:320, [239, 399]].ravel(), torn.below[[159, 319], 240:400].ravel()])
    assert sides.mean() > 0.98


def test_one_sample_between_two_surfaces_joins_at_most_one_of_them():
    """A pixel that saw both surfaces has a depth between theirs; it must be torn off on at least one side."""
    for part in np.linspace(0.05, 0.95, 19):
        depth = np.where(np.arange(40) < 20, 2.0, 4.0) * np.ones((30, 1))
        depth[:, 20] = 1 / (0.5 + part * (0.25 - 0.5))
        right = edges_of(image(depth, ibr.Camera([[F, 0, 20], [0, F, 15], [0, 0, 1]], (40, 30)))).right
        assert (right[:, 19] | right[:, 20]).all(), part


@pytest.mark.parametrize("radius", [40, 90])
def test_a_ball_ends_where_it_does(radius):
    """A ball becomes ever steeper towards its outline, but only its outermost samples are torn."""
    size = (2 * radius + 41, 2 * radius + 21)
    x, y = (np.arange(n) - (n - 1) / 2 for n in size)
    inside = radius**2 - x**2 - y[:, None] ** 2
    depth = np.where(inside > 0, 5 - np.sqrt(np.maximum(inside, 0)) / 200, np.nan)
    view = image(depth, ibr.Camera(np.array([[200.0, 0, 0], [0, 200, 0], [0, 0, 1]]), size, projection="orthographic"))
    torn = edges_of(view)
    apart = view.valid & (torn.right | torn.below)
    outermost = view.valid & (np.sqrt(x**2 + y[:, None] ** 2) > radius - 2)
    assert not (apart & ~outermost).any()


@pytest.mark.thorough
def test_real_rooms_are_torn_at_their_depth_edges_alone():
    """In clean and noisy frames of a room, only some samples per row are torn, as depth edges are lines."""
    from PIL import Image

    folder = shared("rgbd_livingroom1")
    for kind in ("depth", "depth_noisy"):
        for file in sorted((folder / kind).glob("*.png"))[:3]:
            stored = np.asarray(Image.open(file)).astype(np.float32) / 1000
            view = image(np.where(stored > 0, stored, np.nan))
            torn = edges_of(view)
            valid = view.valid[:, :-1] & view.valid[:, 1:]
            share = float((torn.right[:, :-1] & valid).sum() / valid.sum())
            # At most 2 % of the pairs, and not none.
            assert 5e-4 < share < 0.02, (kind, file.name, share)


@pytest.mark.usefixtures("lanes")
def test_all_margins_are_found_where_every_sample_is_torn_off():
    """The margins outgrow their first buffer: each quarter of each pixel is one, except at the border."""
    height, width = 40, 50
    depth = 3.0 + np.indices((height, width)).sum(axis=0) % 3
    camera = ibr.Camera([[F, 0, 24.5], [0, F, 19.5], [0, 0, 1]], (width, height))
    with one_call():
        margins = surface_of(image(depth, camera), 1.05).margins
        quarters = margins.quarters.to_host()[:, : margins.count]
    x, y, bits = (quarters[int(constant("lib/margins.h", f"MARGIN_{name}"))] for name in ("X", "Y", "BITS"))
    found = {*zip(x.tolist(), y.tolist(), (np.ascontiguousarray(bits).view(np.int32) & 3).tolist(), strict=True)}
    within = {(x, y, bits) for x in range(1, width - 1) for y in range(1, height - 1) for bits in range(4)}
    assert margins.count == len(found) and found >= within


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("size", [(1, 1), (5, 3), (17, 33), (16, 100), (70, 131)])
def test_bands_make_the_surface_that_its_steps_make_one_by_one(size, projection, monkeypatch: pytest.MonkeyPatch):
    """The surface is computed in bands of 32 rows. Their borders do not show, and no band needs another's results."""

    def unset(shape: tuple[int, ...], dtype: Any) -> DeviceArray:
        array = empty(shape, dtype)
        if array.host is not None:
            array.host.view(np.uint8)[...] = 0xFF  # NaN
        return array

    monkeypatch.setattr(surface, "empty", unset)
    monkeypatch.setattr(samples, "empty", unset)
    monkeypatch.setattr(launch, "UNSPLIT_SECONDS", -1.0)
    monkeypatch.setattr(KernelCost, "piece_after", lambda *rest: 1)  # one band after the other
    noisy = rough(size, projection)
    view = ibr.DepthImage(noisy.color, noisy.depth, noisy.camera, noise=0.0)  # every pair is tested
    with one_call():
        at_once = surface_of(view, None)
        in_steps = make_surface(samples_of(view), size, straightness_test(view.camera), tear=lambda nearness: None)
        assert (at_once.low, at_once.high) == (in_steps.low, in_steps.high)
        made, expected = (
            [one.nearness.to_host()[:, : size[0] + 2], one.prominence.to_host(), _sorted_margins(one)]
            for one in (at_once, in_steps)
        )
    for one, other in zip(made, expected, strict=True):
        np.testing.assert_array_equal(one.view(np.int32), other.view(np.int32))


def _sorted_margins(made: Any) -> Array:
    """Sort the margins, because kernels find them in any order."""
    rows = made.margins.quarters.to_host()[:, : made.margins.count].view(np.int32)
    return np.ascontiguousarray(rows[:, np.lexsort(rows)])
