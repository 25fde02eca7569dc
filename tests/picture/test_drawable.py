"""All systems and a user's class follow the protocol `Drawable`."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import models, object_views
from pyibr.core.camera import Camera
from pyibr.opencl.device import one_call
from pyibr.opencl.memory import copy, to_host, upload
from pyibr.picture.drawable import as_drawable
from pyibr.picture.target import Target
from tests import scenes
from tests.exact import same_bits
from tests.one_lane import check_bounds, one_lane
from tests.test_docs import ROOT, blocks_of

PAGE = ROOT / "docs/howto/own-system.md"


def base() -> ibr.Mesh:
    """A bent square around the origin, with normals along z and a different colour at each corner."""
    colors = np.array([(250, 20, 90), (10, 200, 30), (60, 80, 240), (220, 210, 40)], np.uint8)
    corners = [[-1, -1, 0.3], [1, -1, -0.2], [1, 1, 0.4], [-1, 1, -0.3]]
    return ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3]], uv=np.array([[0, 0], [1, 0], [1, 1], [0, 1]]), colors=colors)


@cache
def systems() -> dict[str, object]:
    """A thing of each system, within a distance of 1.5 of the origin."""
    views, rng = object_views(models.donut(16), 48), np.random.default_rng(0)
    height, color = rng.random((16, 8)).astype(np.float32), rng.integers(0, 256, (5, 6, 3)).astype(np.uint8)
    return {
        "DepthImage": views[5],
        "Mesh": base(),
        "SlicedSurface": ibr.SlicedSurface(base(), height, color, 0.3),
        "ReliefSurface": ibr.ReliefSurface(base(), height, color, 0.3),
        "DepthObject": ibr.DepthObject(views, slices=32),
        "VisualHull": ibr.VisualHull(views, slices=32),
        "DepthMesh": ibr.DepthMesh(views[5]),
        "DepthMeshObject": ibr.DepthMeshObject(views),
    }


NAMES = ["DepthImage", "Mesh", "SlicedSurface", "ReliefSurface", "DepthObject", "VisualHull", "DepthMesh"]
NAMES += ["DepthMeshObject"]
SIDES = {"front": 4.0, "back": -4.0}


def camera(projection: str, side: str = "front", middle: tuple[float, ...] = (0, 0, 0)) -> Camera:
    how = {"fov_y": 43} if projection == "perspective" else {"projection": projection, "height": 3.1}
    return Camera.look_at((0.5, 0.4, SIDES[side]), middle, (0, 1, 0), (83, 61), **how)


def drawn(things: list[object], camera: Camera, dtype: type = np.uint8, poison: bool = False) -> ibr.Frame:
    """Draw things into one target; with `poison`, the target's buffers start with unusual values."""
    with one_call():
        target = Target(camera, np.dtype(dtype))
        if poison:
            target.color.fill(77)
            target.depth.fill(0.5)
            target.valid.fill(9)
        for thing in things:
            as_drawable(thing).draw(target, None)
            assert not target.blank
        color, depth, valid = (values.copy() for values in to_host([target.color, target.depth, target.valid]))
    return ibr.Frame(color, depth, valid, camera)


def wall(z: float, half: float = 9, slope: float = 0) -> ibr.Mesh:
    """A wall across the z axis; with a slope, it rises along x."""
    low, high = z - slope * half, z + slope * half
    corners = [[-half, -half, low], [half, -half, high], [half, half, high], [-half, half, low]]
    return ibr.Mesh(corners, [[0, 2, 1], [0, 3, 2]], colors=np.tile(np.uint8([9, 8, 7]), (4, 1)))


@pytest.mark.parametrize("name", NAMES)
def test_every_system_is_drawable(name):
    drawable = as_drawable(systems()[name])
    assert isinstance(drawable, ibr.Drawable)
    low, high = drawable.bounds
    assert low.shape == high.shape == (3,)
    assert (np.abs([low, high]) < 1.5).all() and (low < high).any()


@pytest.mark.parametrize("dtype", [np.uint8, pytest.param(np.float32, marks=pytest.mark.thorough)])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("name", NAMES)
def test_who_draws_first_writes_every_pixel(name, projection, dtype):
    thing = systems()[name]
    frame, plain = (drawn([thing], camera(projection), dtype, poison) for poison in (True, False))
    there = frame.valid == 1
    assert 500 < there.sum() < 0.8 * there.size
    assert np.isfinite(frame.depth[there]).all()
    assert np.isnan(frame.depth[~there]).all()
    assert (frame.valid[~there] == 0).all()
    assert (frame.color[~there] == 0).all()
    assert frame.color.max() <= (255 if dtype == np.uint8 else 1)
    same_bits(frame, plain)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("name", NAMES)
def test_who_draws_nothing_first_writes_every_pixel(name, projection):
    for away in (camera(projection, middle=(0, 0, 9)), camera(projection).moved(70, 0, 0)):
        frame = drawn([systems()[name]], away, poison=True)
        assert not frame.valid.any()
        assert not frame.color.any()
        assert np.isnan(frame.depth).all()


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("name", NAMES)
def test_who_draws_later_keeps_what_is_nearer(name, projection):
    thing, view = systems()[name], camera(projection)
    sheet = wall(0.3, 2.5, slope=1.2)  # cuts the thing near its middle
    a, b = drawn([thing], view), drawn([sheet], view)
    of_a, of_b = (np.where(frame.valid == 1, frame.depth, np.inf) for frame in (a, b))
    nearer, farther = of_a < of_b * (1 - 1e-6), of_b < of_a * (1 - 1e-6)
    assert min((nearer & (b.valid == 1)).sum(), (farther & (a.valid == 1)).sum()) > 100
    for order in ([sheet, thing], [thing, sheet]):
        both = drawn(order, view)
        np.testing.assert_allclose(both.depth, np.fmin(a.depth, b.depth), rtol=1e-6)
        np.testing.assert_array_equal(both.color[nearer], a.color[nearer])
        np.testing.assert_array_equal(both.color[farther], b.color[farther])
        np.testing.assert_array_equal(both.valid, a.valid | b.valid)


@pytest.mark.usefixtures("lanes")
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("name", NAMES)
def test_what_is_equally_far_stays(name, projection):
    """Depths are compared; by rounded nearness (1/depth), 6 % of a slanted surface's pixels would be replaced."""
    drawable = as_drawable(systems()[name])
    with one_call():
        target = Target(camera(projection), np.dtype(np.uint8))
        drawable.draw(target, None)
        before = target.depth.to_host().copy()
        target.color.fill(1)
        drawable.draw(target, None)
        after, color = target.depth.to_host().copy(), target.color.to_host().copy()
    assert np.isfinite(before).sum() > 500
    np.testing.assert_array_equal(after, before)
    assert (color == 1).all()


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("name", NAMES)
def test_lights_see_both_sides(name, side):
    maps = []
    for eye in ("front", side):
        with one_call():
            target = Target(camera("orthographic", eye), np.dtype(np.uint8), from_light=True)
            as_drawable(systems()[name]).draw(target, None)
            assert not target.blank
            maps.append(np.isfinite(target.depth.to_host()).sum())
    assert maps[1] > 0.8 * maps[0] > 400


class Square:
    """A user's class in NumPy: a square that faces the camera at one depth, in the left half of the picture."""

    def __init__(self, z: float, color: tuple[int, int, int]) -> None:
        self.z, self.color = z, color
        self.bounds = np.array([-1, -1, z]), np.array([0, 1, z])

    def draw(self, target, lighting) -> None:
        target.clear()
        buffers = [target.depth, target.color, target.valid]
        depth, color, valid = (values.copy() for values in to_host(buffers))
        height, width = depth.shape
        pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2)
        eye, far = (target.camera.unproject(pixels, np.full(len(pixels), z)) for z in (1e-3, 1.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            steps = (self.z - eye[:, 2]) / (far - eye)[:, 2]  # along each pixel's ray to the square
            point = eye + steps[:, None] * (far - eye)
            mine = (np.abs(point[:, :2] - (-0.5, 0)) <= (0.5, 1)).all(axis=1)
            z = np.where(mine, 1e-3 + steps * (1 - 1e-3), np.nan).astype(np.float32).reshape(depth.shape)
            mine = (z > 0) & ~(z >= depth)
        depth[mine], color[mine], valid[mine] = z[mine], self.color, 1
        for buffer, values in zip(buffers, (depth, color, valid), strict=True):
            copy(upload(values), buffer)


FACING = Camera([[40, 0, 41], [0, 40, 30], [0, 0, 1]], (83, 61))


def test_a_class_of_a_users_own_is_drawn_among_others():
    red, nearer = Square(3, (255, 0, 0)), Square(2, (0, 0, 255))
    assert isinstance(red, ibr.Drawable)
    assert as_drawable(red) is red
    alone = ibr.render(red, FACING, background=(1, 2, 3))
    y, x = np.mgrid[:61, :83]
    expected = (x <= 41) & (x >= 41 - 40 / 3) & (np.abs(y - 30) <= 40 / 3)
    np.testing.assert_array_equal(alone.valid, expected)
    np.testing.assert_allclose(alone.depth[expected], 3, rtol=1e-6)
    assert (alone.color[expected] == (255, 0, 0)).all()
    assert (alone.color[~expected] == (1, 2, 3)).all()
    for things in ([red, wall(2.5, 0.5), nearer], [nearer, red, wall(2.5, 0.5)]):
        frame = ibr.render(things, FACING)
        assert tuple(frame.color[30, 30]) == (0, 0, 255)
        assert tuple(frame.color[30, 45]) == (9, 8, 7)
        np.testing.assert_allclose(frame.depth[30, [30, 45]], [2, 2.5], rtol=1e-6)


def test_of_equally_far_things_the_first_stays_a_users_too():
    """A user's square and a mesh have the same rounded depth; the first in the list is shown."""
    red, mesh = Square(3, (255, 0, 0)), wall(3, 0.9)
    shared = ibr.render(red, FACING).valid & ibr.render(mesh, FACING).valid
    assert shared.sum() > 200
    assert (ibr.render([red, mesh], FACING).color[shared] == (255, 0, 0)).all()
    assert (ibr.render([mesh, red], FACING).color[shared] == (9, 8, 7)).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_users_class_shadows_every_system(name):
    """The light is behind the camera; the square stands before the thing's left half, and shadows it."""
    light, view = ibr.Light(direction=(0, 0, -1), ambient=0.25, shadow_size=256), camera("orthographic")
    square, thing = Square(2.0, (0, 255, 0)), systems()[name]
    without, lit = ibr.render(thing, view, light), ibr.render([thing, square], view, light)
    on_thing = without.valid & (lit.depth == without.depth)
    pixels = np.argwhere(on_thing)[:, ::-1]
    point = view.unproject(pixels, without.depth[on_thing])
    hidden = (point[:, 0] < -0.05) & (point[:, 0] > -0.95) & (np.abs(point[:, 1]) < 0.95)
    # Edges of a sliced surface are left out: the square shifts the shadow map's texels, in which the surface ends, too.
    open_ = (point[:, 0] > 0.05) & ((np.abs(point[:, 0] - 1) > 0.01) | (name != "SlicedSurface"))
    before, after = without.color[on_thing].astype(float), lit.color[on_thing]
    assert min(hidden.sum(), open_.sum()) > 60
    np.testing.assert_array_equal(after[open_], before[open_])
    bright = before.sum(axis=1) > 300  # not in its own shadow
    assert (after[hidden & bright].sum(axis=1) < 0.7 * before[hidden & bright].sum(axis=1)).mean() > 0.9


def test_a_users_class_that_writes_nothing_leaves_an_empty_picture():
    class Nothing(Square):
        def draw(self, target, lighting) -> None:
            pass

    nothing = Nothing(3, (0, 0, 0))
    for _ in range(3):  # memory of the previous picture is reused
        ibr.render(wall(3), FACING)
        frame = ibr.render(nothing, FACING)
        assert not frame.valid.any() and not frame.color.any() and np.isnan(frame.depth).all()
    np.testing.assert_array_equal(ibr.render([nothing, wall(3)], FACING).color, ibr.render(wall(3), FACING).color)


class Undrawn:
    """A class with bounds only."""

    bounds = np.zeros(3), np.ones(3)


@pytest.mark.parametrize("thing", [Undrawn(), 3, None, Square, ibr.ReliefSurface])
def test_what_is_not_drawable_is_named_in_one_sentence(thing):
    expected = r"^things: expected things that draw themselves \(`pyibr\.Drawable`\), or DepthImage, Mesh, got "
    with pytest.raises(ibr.ArgumentError, match=expected):
        ibr.render([wall(3), thing], FACING)


BOXES = [np.zeros(3), (np.zeros(3), np.full(3, np.inf)), (np.ones(3), np.zeros(3)), ("low", "high"), None]


@pytest.mark.parametrize("bounds", BOXES, ids=str)
def test_a_box_that_is_none_is_named_in_one_sentence(bounds):
    square = Square(3, (0, 0, 0))
    square.bounds = bounds
    with pytest.raises(ibr.ArgumentError, match=r"^Square\.bounds: expected .*, got "):
        ibr.render(square, FACING, ibr.Light(direction=(0, 0, 1)))


def test_holes_are_filled_and_the_background_is_not_painted_over_them():
    view = scenes.stepped((96, 72))
    eye = view.camera.moved(0.4, 0.1, 0)
    warped, plain = ibr.warp(view, eye, fill="background"), ibr.render(view, eye, background=(0, 0, 255))
    frame = ibr.render(ibr.WarpedView(view, fill="background"), eye, background=(0, 0, 255))
    holes = ~frame.valid
    made_up, empty = holes & ~np.isnan(frame.depth), np.isnan(frame.depth)
    np.testing.assert_array_equal(frame.valid, plain.valid)
    assert made_up.sum() > 100
    assert (plain.color[holes] == (0, 0, 255)).all()
    assert (frame.color[empty] == (0, 0, 255)).all()
    np.testing.assert_array_equal(frame.color[~empty], warped.color[~empty])
    np.testing.assert_array_equal(frame.depth, warped.depth)


def test_what_is_filled_hides_nothing_that_comes_later():
    view = scenes.stepped((96, 72))
    eye = view.camera.moved(0.4, 0.1, 0)
    filled = ibr.render(ibr.WarpedView(view, fill="background"), eye)
    holes = ~filled.valid & ~np.isnan(filled.depth)
    corners = [[-9, -9], [110, -9], [110, 90], [-9, 90]]
    for z in (1.0, 50.0):
        points = eye.unproject(corners, np.full(4, z))
        sheet = ibr.Mesh(points, [[0, 1, 2], [0, 2, 3]], colors=np.full((4, 3), 255, np.uint8))
        frame = ibr.render([ibr.WarpedView(view, fill="background"), sheet], eye)
        assert (frame.color[holes] == 255).all()
        assert frame.valid[holes].all()


def test_what_is_made_up_hides_nothing_that_another_image_sees():
    a = scenes.stepped((96, 72))
    b = ibr.DepthImage(a.color, a.depth, a.camera.moved(0.7, 0, 0))
    eye = a.camera.moved(0.5, 0.1, 0.1)
    for views in ([a, b], [b, a]):
        filled = ibr.render([ibr.WarpedView(view, fill="background") for view in views], eye)
        plain = ibr.render(views, eye)
        np.testing.assert_array_equal(filled.valid, plain.valid)
        np.testing.assert_array_equal(filled.color[plain.valid], plain.color[plain.valid])
        together = ibr.warp(views, eye, fill="background").valid
        assert not (together & ~filled.valid).any()
        assert (filled.valid & ~together).mean() < 0.002  # margins through which rays of the other view pass


USE = """
camera = ibr.Camera([[9, 0, 8], [0, 9, 6], [0, 0, 1]], (17, 13))
things = [Splats([[0, 0, 2], [0.3, 0, 2]], [[0, 1, -1], [0, 0, 1]], [[255, 0, 0], [0, 255, 0]], radius=0.5)]
things.append(ibr.Mesh([[-1, -1, 2], [1, -1, 2], [1, 1, 3]], [[0, 2, 1]]))
for order in (things, things[::-1]):
    frame = ibr.render(order, camera, ibr.Light(direction=(0, 0.2, 1), shadow_size=16))
    assert 20 < frame.valid.sum() < 200
"""
"""A system of the manual's page, drawn with a mesh."""


@pytest.mark.thorough
def test_the_pages_own_system_runs_in_the_form_for_gpus(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with one_lane():
        exec("\n".join([*(source for _, source in blocks_of(PAGE)[:2]), USE]), {"__name__": "__main__"})


@pytest.mark.thorough
def test_the_pages_own_system_stays_within_its_arrays(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_bounds("\n".join([*(source for _, source in blocks_of(PAGE)[:2]), USE]))
