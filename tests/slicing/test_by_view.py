"""Numbers of slices chosen for each view, slices="view", compared with cast rays, many slices, and 256 slices."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("open3d")

import pyibr as ibr
from pyibr.core.camera import Camera
from pyibr.core.pixelspace import pixel_size
from pyibr.images.metrics import silhouette_iou
from pyibr.slicing import alpha_tests
from pyibr.slicing.drawing import spacing_in
from pyibr.slicing.spacing import nearest_pixel
from tests.displaced import interior, square
from tests.one_lane import one_lane
from tests.relief.solids import grid
from tests.relief.solids import torus as ring
from tests.slicing.solids import dragon, looking, torus, views_of_torus
from tests.slicing.test_surfaces import SCALE, camera, heights, solid

MIDDLE = np.array([0.5, 0.5, 0.5 * SCALE])
FRONT = (0.5, 0.4, 1)


def noise() -> Any:
    """A fine texture, on which shifts by a fraction of a pixel are visible."""
    values = np.random.default_rng(1).normal(0, 1, (256, 256, 3))
    values = cv2.GaussianBlur(values, (0, 0), 1.5)
    return np.clip(127.5 + 60 * values / values.std(), 0, 255).astype(np.uint8)


def noisy_surface(slices: Any, slicing: str, texels: int = 32, **more: Any) -> ibr.SlicedSurface:
    return ibr.SlicedSurface(square(), heights(texels), noise(), SCALE, slices=slices, slicing=slicing, **more)


def flicker(frames: Sequence[ibr.Frame], truth: Sequence[ibr.Frame]) -> float:
    """Mean change of colour errors from frame to frame, per pixel of the surface; true motion is no error."""
    off = [a.color.astype(float) - b.color for a, b in zip(frames, truth, strict=True)]
    return float(np.abs(np.diff(off, axis=0)).mean() / np.mean([b.valid for b in truth]))


def flicker_of_ring(height: Any, slicing: str, size: tuple[int, int], steps: int) -> tuple[float, float]:
    """Flicker with slices="view" and with 256 slices, while a camera takes `steps` of 120 steps around a ring."""
    turns = np.arange(steps) * 2 * np.pi / 120
    eyes = [(4 * np.cos(turn), 4 * np.sin(turn), 1.8) for turn in turns]
    cams = [Camera.look_at(eye, (0, 0, 0), (0, 0, 1), size, fov_y=40) for eye in eyes]

    def frames(slices: Any, halvings: int = 0) -> list[ibr.Frame]:
        thing = ibr.SlicedSurface(
            grid(ring, 48, 24), height, noise(), 0.12, tiles=(6, 3), slices=slices, slicing=slicing, halvings=halvings
        )
        return [ibr.render(thing, cam) for cam in cams]

    truth = frames(4096, 2)
    return flicker(frames("view"), truth), flicker(frames(256), truth)


@cache
def true_view(elevation: float, direction: float, size: tuple[int, int], projection: str) -> tuple[Camera, np.ndarray]:
    """A camera, and the depth it sees of the true surface."""
    cam = camera(elevation, direction, size, projection)
    return cam, solid().depth(cam)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_surfaces_show_no_slice_at_any_size(slicing, projection):
    for size in ((61, 47), (120, 90), (400, 300)):
        for elevation, direction in ((70, 10), (35, 100), (8, 190)):
            cam, truth = true_view(elevation, direction, size, projection)
            seen = np.isfinite(truth)
            frame = ibr.render(noisy_surface("view", slicing), cam)
            assert frame.valid[interior(truth)].all()
            # Points are off by up to an eighth of a pixel or, on oblique slices, sqrt(3) eighths. Pixels at the surface
            # and at its middle differ in size by up to a third. At outlines, rounding decides what rays hit.
            off = np.abs(frame.depth - truth)[seen & frame.valid] / pixel_size(cam, MIDDLE)
            assert np.quantile(off, 0.9) < 0.3
            off = np.abs(frame.depth - truth)[interior(truth) & frame.valid] / pixel_size(cam, MIDDLE)
            assert off.size == 0 or off.mean() < 0.15
            assert silhouette_iou(frame.valid, seen) >= 1 - 8 / size[0]


@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_surfaces_take_as_many_as_the_picture_needs(slicing):
    """Twelve slices per pixel of displacement, until a test in each texel that the ray passes takes no longer."""
    made = cache(lambda texels: noisy_surface("view", slicing, texels))

    @cache
    def tests(width: int, texels: int = 1024) -> float:
        whole = camera(40, 20, (width, width * 3 // 4))
        size = min(width, 80), min(width, 80) * 3 // 4  # at most the middle of the picture
        K = whole.K - np.pad((np.subtract(whole.size, size) / 2)[:, None], ((0, 1), (2, 0)))
        cam, thing = Camera(K, size, whole.world_from_camera), made(texels)
        return float(alpha_tests(thing, cam).sum() / ibr.render(thing, cam).valid.sum())

    assert 1.5 * tests(20) < tests(40) < 2.2 * tests(20)
    # The pictures show parts of different sizes, above which rays are 10 to 25 % longer.
    for width in (80, 640, 2560):
        assert 0.7 * tests(320) < tests(width) < 1.3 * tests(320)
        assert 0.2 * tests(width) < tests(width, 256) - 1 < 0.3 * tests(width)  # 1: at the ray's ends


def steep(kind: str, shape: tuple[int, int]) -> np.ndarray:
    """Pegs one texel wide, or steep random hills."""
    rng = np.random.default_rng(shape[0])
    hills = rng.uniform(0.05, 0.95, shape)
    return np.where(hills > 0.8, 0.9, 0.05).astype(np.float32) if kind == "pegs" else hills.astype(np.float32)


def check_seen_large(base: ibr.Mesh, height: np.ndarray, cam: Camera, scale: float, **more: Any) -> None:
    """Assert that "view" shows all that 4,096 slices show, with at most half of the tests of 64 slices."""

    def made(slices: Any, halvings: int = 0) -> ibr.SlicedSurface:
        color = np.full((2, 2, 3), 200, np.uint8)
        return ibr.SlicedSurface(base, height, color, scale, slices=slices, halvings=halvings, **more)

    many, frame = ibr.render(made(4096, 4), cam), ibr.render(made("view"), cam)
    count = many.valid.sum()
    assert count > 0.05 * many.valid.size
    behind = (frame.depth - many.depth)[frame.valid & many.valid] > 0.1 * scale
    # 5e-4: on curved bases outlines may be off by an eighth of a pixel. Flat ones differ by rounding alone.
    most = 1 + 5e-4 * count
    assert behind.sum() <= most and (many.valid & ~frame.valid).sum() <= most
    # 4,096 slices, too, miss tips.
    differs = np.abs(frame.depth - many.depth)[frame.valid & many.valid] > 0.1 * scale
    assert differs.sum() + (frame.valid != many.valid).sum() <= 2 + 5e-3 * count
    if more.get("slicing") != "surface":  # few of whose slices meet a grazing ray
        assert alpha_tests(made("view"), cam).sum() <= 0.5 * alpha_tests(made(64), cam).sum()


@pytest.mark.parametrize("slicing", ["surface", "orthogonal", "screen"])
@pytest.mark.parametrize(
    ("kind", "shape", "more"),
    [
        ("pegs", (8, 8), {}),
        ("pegs", (13, 9), {"test": "at_least", "tiles": (2, 1)}),
        ("hills", (24, 32), {"wrap": "clamp"}),
        ("hills", (1, 11), {}),
        ("pegs", (17, 12), {"clipped": False, "wrap": ("repeat", "clamp")}),
    ],
)
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_no_tip_is_lost_where_texels_are_large(kind, shape, more, slicing, projection):
    for elevation in (12, 40):
        check_seen_large(
            square(), steep(kind, shape), camera(elevation, 25, (151, 113), projection), SCALE, slicing=slicing, **more
        )


def test_pixels_are_measured_at_the_nearest_corner():
    K, corners = [[50, 0, 40], [0, 100, 30], [0, 0, 1]], np.array([[0, 0, 4.0], [1, 2, 3]])
    assert nearest_pixel(Camera(K, (80, 60)), corners) == pytest.approx(3 / 50)
    assert nearest_pixel(Camera(K, (80, 60)), corners - [0, 0, 3]) == 0
    assert nearest_pixel(Camera(K, (80, 60), projection="orthographic"), corners) == pytest.approx(1 / 50)


@pytest.mark.parametrize("sides", [(12, 6), (48, 24)])
def test_no_tip_is_lost_on_curved_bases(sides):
    cam = Camera.look_at((2.5, 1, 1.2), (0.7, 0.3, 0), (0, 0, 1), (201, 151), fov_y=30)
    check_seen_large(grid(ring, *sides), steep("pegs", (19, 26)), cam, 0.2, tiles=(3, 1))


@pytest.mark.thorough
def test_no_tip_is_lost_in_one_lane():
    with one_lane():
        check_seen_large(square(), steep("pegs", (8, 11)), camera(20, 25, (61, 47)), SCALE)
        check_seen_large(grid(ring, 12, 6), steep("hills", (9, 16)), camera(20, 25, (61, 47)), 0.2)


def test_far_tiles_are_as_exact_as_the_first():
    """With a thousand tiles, u and v are rounded to a fifteenth of a texel."""
    corners, uv = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    faces, height, color = [[0, 1, 2], [0, 2, 3]], steep("hills", (16, 16)), np.full((2, 2, 3), 200, np.uint8)
    near, far = (
        ibr.render(
            ibr.SlicedSurface(ibr.Mesh(corners, faces, uv=uv + away), height, color, SCALE, slices="view"),
            camera(30, 25, (151, 113)),
        )
        for away in (0, 1000)
    )
    assert (near.valid != far.valid).mean() < 2e-3
    both = near.valid & far.valid
    assert (np.abs(near.depth - far.depth)[both] > 0.01 * SCALE).mean() < 0.02


@pytest.mark.thorough
@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_surfaces_flicker_less_than_with_256_slices(slicing):
    cams = [camera(30, angle, (160, 120)) for angle in np.arange(6) * 3]
    truth = [ibr.render(noisy_surface(4096, slicing), cam) for cam in cams]
    by_view, fixed = (
        flicker([ibr.render(noisy_surface(n, slicing), cam) for cam in cams], truth) for n in ("view", 256)
    )
    assert by_view <= fixed


@pytest.mark.thorough
@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_curved_surfaces_flicker_no_more_where_pixels_are_wide(slicing):
    """A pixel is as wide as 45 of the 256 slices. Errors of an eighth of a pixel would quadruple the flicker."""
    by_view, fixed = flicker_of_ring(heights(32), slicing, (160, 120), 4)
    assert by_view <= fixed


@pytest.mark.thorough
@pytest.mark.parametrize(("slicing", "size", "steps"), [("orthogonal", (241, 181), 5), ("screen", (121, 91), 8)])
def test_cliffs_flicker_no_more_than_with_256_slices(slicing, size, steps):
    """Some rays pass through the edge of a terrace for less than the width of a pixel."""
    y, x = np.mgrid[:128, :128] * (2 * np.pi / 128)
    terraces = 0.5 + 0.25 * np.sin(2 * x) * np.cos(y) + 0.25 * np.sin(x + 2 * y)
    terraces = (np.rint(5 * terraces) / 5).astype(np.float32)
    by_view, fixed = flicker_of_ring(terraces, slicing, size, steps)
    assert by_view <= fixed


@pytest.mark.thorough
@pytest.mark.parametrize(("slicing", "size"), [("orthogonal", (320, 240)), ("screen", (240, 180))])
def test_objects_flicker_no_more_than_with_256_slices(slicing, size):
    """If a pixel is wider than the distance between 256 slices, fewer slices are drawn: errors grow as the distance."""
    scene, views = dragon()
    turns = np.arange(4) * 2 * np.pi / 120
    cams = [looking(scene, (np.cos(turn), 0.3, np.sin(turn)), size) for turn in turns]
    truth = [ibr.render(ibr.DepthObject(views, slices=2048, slicing=slicing, halvings=8), cam) for cam in cams]
    thing = ibr.DepthObject(views, slices="view", slicing=slicing)
    frames = [ibr.render(thing, cam) for cam in cams]
    fixed = ibr.DepthObject(views, slices=256, slicing=slicing)
    apart = max(spacing_in(thing, cam)[0] / spacing_in(fixed, cam)[0] for cam in cams)
    assert flicker(frames, truth) <= max(apart, 1) * flicker([ibr.render(fixed, cam) for cam in cams], truth)
    for frame, true in zip(frames, truth, strict=True):
        both = frame.valid & true.valid
        off = np.abs(frame.depth - true.depth)[both] / pixel_size(frame.camera, thing.box.center)
        assert off.mean() < 0.25  # in pixels: an eighth, but more where slices miss thin parts
        assert silhouette_iou(frame.valid, true.valid) >= 0.99


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("kind", [ibr.DepthObject, ibr.VisualHull])
@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_objects_show_no_slice_at_any_size(kind, slicing, projection):
    views = views_of_torus("orthographic")
    for size in ((24, 18), (110, 90), (300, 240)):
        cam = looking(torus(), FRONT, size, projection)
        many = ibr.render(kind(views, slices=2048, slicing=slicing, halvings=8), cam)
        frame = ibr.render(kind(views, slices="view", slicing=slicing), cam)
        both = frame.valid & many.valid
        off = np.abs(frame.depth - many.depth)[both] / pixel_size(cam, kind(views).box.center)
        assert np.quantile(off, 0.95) < 0.25
        assert off.mean() < 0.5
        # In the smallest picture, slices miss some of a hull's sharp edges; their position decides which.
        few = [ibr.render(kind(views, slices=n, slicing=slicing), cam).valid for n in (24, 32, 40)]
        missed = (frame.valid != many.valid).sum()
        assert missed <= max(max((one != many.valid).sum() for one in few) + 1, 0.02 * many.valid.sum())


def test_spacing_changes_as_slowly_as_the_camera_moves():
    """The distance between slices does not jump, and does not depend on pictures drawn before."""
    thing = ibr.DepthObject(views_of_torus("orthographic"), slices="view")
    turns = np.linspace(0, 2 * np.pi, 481)
    cams = [looking(torus(), (np.cos(turn), 0.6 * np.sin(2 * turn), np.sin(turn)), (160, 120)) for turn in turns]
    spacings = np.array([spacing_in(thing, cam)[0] for cam in cams])
    assert spacings.max() > 1.3 * spacings.min()
    # Each step is 0.75 degrees. It changes only a little the cosine, of at least 1 / sqrt(3), between view and slices,
    # and the distance of the box's nearest corner.
    assert np.abs(np.diff(np.log(spacings))).max() < 0.04
    again = np.array([spacing_in(thing, cam)[0] for cam in cams[::-1]])
    np.testing.assert_array_equal(again[::-1], spacings)


@pytest.mark.parametrize("slicing", ["orthogonal", "screen", "surface"])
def test_from_within_and_from_afar(slicing):
    thing = noisy_surface("view", slicing, test="at_least")
    for eye in (MIDDLE, MIDDLE + 1e-6, (0.5, 0.5, SCALE), (0.1, 0.2, 0.3 * SCALE)):
        frame = ibr.render(thing, Camera.look_at(eye, (2, 0.6, 0.1), (0, 0, 1), (41, 33), fov_y=80))
        np.testing.assert_array_equal(np.isfinite(frame.depth), frame.valid)
    # From these distances, the displacement is 9 pixels high and less than one pixel.
    for away in (40, 500):
        cam = Camera.look_at(MIDDLE + away * np.array([0.4, 0.3, 1]), MIDDLE, (0, 0, 1), (41, 33), fov_y=20)
        many, frame = ibr.render(noisy_surface(256, slicing, test="at_least"), cam), ibr.render(thing, cam)
        assert many.valid.any()
        assert (many.valid != frame.valid).sum() <= 0.1 * many.valid.sum()


@pytest.mark.parametrize("kind", [ibr.DepthObject, ibr.VisualHull])
@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_objects_from_within_and_from_afar(kind, slicing):
    thing = kind(views_of_torus("orthographic"), slices="view", slicing=slicing)
    middle = thing.box.center
    for eye in (middle, middle + 1e-6, middle + 0.9):
        frame = ibr.render(thing, Camera.look_at(eye, middle + np.array([0.3, 2, 0.1]), (0, 0, 1), (41, 33), fov_y=80))
        np.testing.assert_array_equal(np.isfinite(frame.depth), frame.valid)
    far = Camera.look_at(middle + np.array([120, 0, 90]), middle, (0, 0, 1), (41, 33), fov_y=5)
    many = ibr.render(kind(views_of_torus("orthographic"), slices=512, slicing=slicing), far)
    assert 10 < many.valid.sum() < 100
    assert (ibr.render(thing, far).valid != many.valid).sum() <= 0.1 * many.valid.sum()


def test_shadows_on_surfaces_and_objects_are_those_of_many_slices():
    light = ibr.Light(direction=(-0.6, -0.3, -1), shadow_size=512)
    cam = camera(50, 30)
    frames = [ibr.render(noisy_surface(n, "orthogonal"), cam, light) for n in ("view", 512)]
    off = np.abs(frames[0].color.astype(int) - frames[1].color).max(axis=-1)
    assert (off[frames[1].valid] > 40).mean() < 0.03  # pixels at the outline and at shadows' edges
    cam = looking(torus(), FRONT, (160, 120))
    frames = [ibr.render(ibr.DepthObject(views_of_torus("orthographic"), slices=n), cam, light) for n in ("view", 512)]
    off = np.abs(frames[0].color.astype(int) - frames[1].color).max(axis=-1)
    assert (off[frames[1].valid] > 40).mean() < 0.03


def test_surfaces_halvings_bring_points_closer():
    cam = camera(35, 100)
    truth = solid().depth(cam)
    off = []
    for halvings in (0, 1, 2, 3):
        frame = ibr.render(noisy_surface(64, "orthogonal", halvings=halvings), cam)
        off.append(np.abs(frame.depth - truth)[interior(truth) & frame.valid].mean())
    ratios = np.divide(off[:-1], off[1:])
    assert ((ratios > 1.85) & (ratios < 2.15)).all(), off


@pytest.mark.parametrize("halvings", [0, 3])
def test_halved_surfaces_in_one_depth_buffer_with_other_things(halvings):
    cam = camera(35, 100)
    color = np.zeros((4, 3), np.uint8)
    wall = ibr.Mesh([[-1, 0.3, -1], [2, 0.5, -1], [2, 0.6, 1], [-1, 0.4, 1]], [[0, 1, 2], [0, 2, 3]], colors=color)
    things = [noisy_surface(16, "orthogonal", halvings=halvings), wall, noisy_surface("view", "screen")]
    alone = [ibr.render(one, cam) for one in things]
    nearest = np.min([np.where(one.valid, one.depth, np.inf) for one in alone], axis=0)
    for order in (things, things[::-1]):
        frame = ibr.render(order, cam)
        np.testing.assert_array_equal(np.where(frame.valid, frame.depth, np.inf), nearest)


@pytest.mark.parametrize("slices", ["many", "64", None, 0, 1.5])
def test_wrong_numbers(slices):
    for make in (lambda n: noisy_surface(n, "screen"), lambda n: ibr.DepthObject(views_of_torus("four"), slices=n)):
        with pytest.raises(ibr.ArgumentError, match=r'^slices: expected .*"view"'):
            make(slices)
