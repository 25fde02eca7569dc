"""Many views in one picture: cost is linear in the number of views, and results do not depend on their order."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise, permutations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.images import exposure
from pyibr.opencl import memory
from pyibr.opencl.device import current
from pyibr.opencl.headers import constant
from pyibr.opencl.watch import Traffic, watching
from pyibr.picture.surface import surface_of
from pyibr.warp import blending
from tests import scenes
from tests.exact import same_bits

SIZE = (61, 37)
FEATHER = int(constant("warp/view_edges.cl", "FEATHER"))
STEPS = int(constant("warp/view_edges.cl", "STEPS"))


def several(count: int, size=SIZE, apart: float = 0.02) -> list[ibr.DepthImage]:
    """Neighbouring views of one surface, with different exposures."""
    first = scenes.stepped(size)
    made = [first]
    for number in range(1, count):
        camera = first.camera.moved(apart * number, 0.3 * apart * number, 0)
        frame = ibr.warp(first, camera)
        gain = 0.6 + 0.4 * (number * 0.618 % 1)
        made.append(ibr.DepthImage((frame.color * gain).astype(np.uint8), frame.depth, camera))
    return made


def hold(monkeypatch: pytest.MonkeyPatch, layers: int) -> None:
    """Limit the number of layers, one for each view, that stay in memory; others are drawn twice."""
    monkeypatch.setattr(blending, "_HELD_BYTES", 1)
    monkeypatch.setattr(blending, "_HELD_MIN", layers)


@pytest.mark.usefixtures("lanes")
def test_the_order_of_views_changes_no_bit():
    """It changes none even if the views have one camera, and differ only in depth and colours."""
    views = several(4)
    views.append(ibr.DepthImage(views[0].color // 2, views[0].depth * np.float32(1.018), views[0].camera))
    target = views[0].camera.moved(0.05, 0.02, 0.1)
    rng = np.random.default_rng(1)
    first = ibr.warp(views, target, classes=True)
    for _ in range(2):
        order = rng.permutation(len(views))
        other = ibr.warp([views[k] for k in order], target, classes=True)
        same_bits(first, other)
        assert first.view is not None and first.source is not None
        assert other.view is not None and other.source is not None
        np.testing.assert_array_equal(first.view[first.valid], order[other.view[other.valid]])
        np.testing.assert_array_equal(first.source[first.valid], other.source[other.valid])


def cross_of_views() -> tuple[list[ibr.DepthImage], ibr.Camera]:
    """Four views around a target camera, all equally far from it; random samples have colour but no depth."""
    middle = scenes.source_camera(SIZE)
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    rng = np.random.default_rng(3)
    views = list[ibr.DepthImage]()
    for aside, down in ((-0.25, 0), (0.25, 0), (0, 0.25), (0, -0.25)):
        depth = np.where(np.hypot(x - 30, y - 18) < 9, np.float32(2), np.float32(4))
        depth[rng.random(depth.shape) < 0.1] = np.nan
        color = rng.integers(1, 256, (*depth.shape, 3), np.uint8)
        views.append(ibr.DepthImage(color, depth, middle.moved(aside, down, 0)))
    return views, middle


@pytest.mark.parametrize("method", ["epipolar", "forward"])
@pytest.mark.parametrize("blend", ["quality", "nearest"])
@pytest.mark.parametrize("fill", ["background", None])
def test_the_order_of_views_that_are_equally_near_changes_no_bit(method, blend, fill):
    """The views also see surfaces at equal depths, and their colours without depth compete for the same holes."""
    views, camera = cross_of_views()
    told = method != "forward"
    first = ibr.warp(views, camera, method=method, blend=blend, fill=fill, classes=told)
    assert not first.valid.all()
    for order in list(permutations(range(len(views))))[5::9]:
        frame = ibr.warp([views[k] for k in order], camera, method=method, blend=blend, fill=fill, classes=told)
        same_bits(first, frame)
        if told:
            np.testing.assert_array_equal(first.classes, frame.classes)
            np.testing.assert_array_equal(first.source, frame.source)
            np.testing.assert_array_equal(first.view[first.valid], np.array(order)[frame.view[frame.valid]])


def test_two_views_as_far_apart_as_one_surface_may_be_are_so_in_either_order():
    """The tolerance is 2 % of a view's depth: the farther view might accept the nearer one, but not vice versa."""
    camera = scenes.source_camera(SIZE)
    texture = scenes.texture(*scenes.image_coordinates(SIZE)) // 2 + 40

    def view(exposure: float, depth: float) -> ibr.DepthImage:
        return ibr.DepthImage((texture * exposure).astype(np.uint8), np.full(SIZE[::-1], depth, np.float32), camera)

    for apart in (1.019, 1.02, 1.0202, 1.0204, 1.021):
        pair = [view(1, 3.0), view(1.5, 3.0 * apart)]
        same_bits(*(ibr.warp(views, camera.moved(0.01, 0, 0)) for views in (pair, pair[::-1])))


@pytest.mark.usefixtures("lanes")
@pytest.mark.parametrize(
    ("how", "lanes"),
    [
        *((how, 16) for how in ({}, {"thin": True}, {"method": "forward"}, {"classes": True}, {"alone": True})),
        pytest.param({}, 1, marks=pytest.mark.thorough),
    ],
    indirect=["lanes"],
)
def test_layers_that_are_drawn_twice_give_the_bits_of_those_that_are_held(monkeypatch, how):
    views = several(5)
    how = dict(how)
    if how.pop("alone", False):
        views = [ibr.DepthImage(None, view.depth, view.camera) for view in views]
    target = views[0].camera.moved(0.05, 0.02, 0.1)
    held = ibr.warp(views, target, **how)
    for layers in (1, 3):
        hold(monkeypatch, layers)
        same_bits(held, ibr.warp(views, target, **how))
        if "classes" in how:
            twice = ibr.warp(views, target, **how)
            np.testing.assert_array_equal(held.view, twice.view)
            np.testing.assert_array_equal(held.source, twice.source)


@pytest.mark.thorough
def test_relit_layers_that_are_drawn_twice_give_the_bits_of_those_that_are_held(monkeypatch):
    thing = ibr.WarpedView(several(4))
    camera = thing.views[0].camera.moved(0.05, 0.02, 0.1)
    light = ibr.Light(position=camera.center + 1, relight=True, shadow_size=64)
    held = ibr.render([thing], camera, light)
    hold(monkeypatch, 2)
    same_bits(held, ibr.render([thing], camera, light))


def test_work_is_linear_in_the_views(monkeypatch):
    """Each view is drawn at most twice, and compared with at most nine others to match exposures."""
    hold(monkeypatch, 2)
    compared = 0
    compare = exposure._Sampled.compared_with

    def counting(sampled, other):
        nonlocal compared
        compared += 1
        return compare(sampled, other)

    monkeypatch.setattr(exposure._Sampled, "compared_with", counting)
    target = scenes.source_camera(SIZE).moved(0.05, 0.02, 0.1)
    for count in (5, 20):
        views, compared = several(count, apart=0.005), 0
        with watching(Traffic()) as seen:
            ibr.warp(views, target)
        assert compared <= 9 * count
        launches = Counter(name for _, name, _ in seen.of)
        for name in ("epipolar_sweep", "resolve", "weigh_layer"):
            assert launches[name] == 2 * count - 2, "each view is drawn twice, except the two whose layers are kept"
        assert launches["blend_layers"] == -(-count // 2)


def test_memory_does_not_grow_with_the_views(monkeypatch):
    """Memory for drawing; the views' surfaces, which are kept on the device, do not count."""
    hold(monkeypatch, 2)
    live = peak = 0
    take, give = memory._take, memory._give_back

    def taking(session, size):
        nonlocal live, peak
        block = take(session, size)
        live += block.size
        peak = max(peak, live)
        return block

    def giving(session, block):
        nonlocal live
        live -= block.size
        give(session, block)

    things = [ibr.WarpedView(several(count, apart=0.005)) for count in (4, 16)]
    target = scenes.source_camera(SIZE).moved(0.05, 0.02, 0.1)
    for thing in things:
        ibr.warp(thing, target)
    monkeypatch.setattr(memory, "_take", taking)
    monkeypatch.setattr(memory, "_give_back", giving)
    peaks = []
    for thing in things:
        live = peak = 0
        ibr.warp(thing, target)
        peaks.append(peak)
    uploaded = 0 if current().profile.in_place else 3 * 12 * 4096  # 12 views' pages, kept until the call ends
    assert peaks[1] - peaks[0] <= uploaded


def test_views_that_cannot_show_are_not_drawn():
    """Such views lie far to the side or look away from what the target sees; they are tested alone and together."""
    here = scenes.flat(SIZE)
    camera = here.camera
    aside = ibr.DepthImage(here.color, here.depth, camera.moved(50, 0, 0))
    turned = camera.world_from_camera @ scenes.pose(yaw=180)
    behind = ibr.DepthImage(here.color, here.depth, ibr.Camera(camera.K, SIZE, turned))
    left = camera.world_from_camera @ scenes.pose(yaw=-120)
    beside = ibr.DepthImage(here.color, here.depth, ibr.Camera(camera.K, SIZE, left))
    for others in ([aside], [behind], [beside], [aside, behind, beside]):
        with watching(Traffic()) as seen:
            frame = ibr.warp([here, *others], camera.moved(0.1, 0.05, 0.1))
        assert [name for _, name, _ in seen.of].count("weigh_layer") == 1
        alone = ibr.warp(here, camera.moved(0.1, 0.05, 0.1))
        np.testing.assert_array_equal(frame.valid, alone.valid)
    with pytest.warns(UserWarning, match="sees nothing"):
        nothing = ibr.warp([aside, behind], camera, classes=True)
    assert not nothing.valid.any() and np.isnan(nothing.depth).all() and (nothing.color == 0).all()


@pytest.mark.usefixtures("lanes")
def test_tiles_of_a_target_are_parts_of_the_whole():
    """If tile and whole agree at a pixel for each view alone, they agree when blended.

    A few pixels differ for a view alone, since the sweep's lines lie elsewhere in a tile.
    """
    views = several(3, (97, 61), 0.1)
    whole = views[0].camera.moved(0.1, 0.05, 0.2)
    frames = {"blended": ibr.warp(views, whole)} | {k: ibr.warp(view, whole) for k, view in enumerate(views)}
    for x, y in ((0, 0), (48, 30), (20, 17)):
        K = np.array(whole.K)
        K[:2, 2] -= x, y
        tile = ibr.Camera(K, (49, 31), whole.world_from_camera)
        part = np.s_[y : y + 31, x : x + 49]
        parts = {"blended": ibr.warp(views, tile)} | {k: ibr.warp(view, tile) for k, view in enumerate(views)}
        off = {
            name: (np.abs(frames[name].color[part].astype(int) - frame.color).max(axis=2) > 1)
            | (frames[name].valid[part] != frame.valid)
            for name, frame in parts.items()
        }
        assert not (off["blended"] & ~off[0] & ~off[1] & ~off[2]).any()
        assert off["blended"].mean() < 0.002


def test_a_wall_has_one_colour_along_a_path():
    wall = np.full((45, 60), 4, np.float32)
    camera = ibr.Camera([[60, 0, 29.5], [0, 60, 22], [0, 0, 1]], (60, 45))
    views = [
        ibr.DepthImage(np.full((45, 60, 3), 90 * gain, np.uint8), wall, camera.moved(at, 0, 0))
        for gain, at in ((1, 0), (1.5, 2.0), (1.2, 3.5))
    ]
    seen: list[int] = []
    for step in range(40):
        frame = ibr.warp(views, camera.moved(0.15 * step - 0.5, 0.01 * step, 0))
        assert np.ptp(frame.color[frame.valid]) <= 1  # one colour within each picture
        seen += [int(np.median(frame.color[frame.valid]))]
    assert max(abs(a - b) for a, b in pairwise(seen)) <= 1


@pytest.mark.usefixtures("lanes")
@pytest.mark.parametrize("how", [{"cut_ratio": 1.5}, {"edges": "connect"}])
def test_rubber_sheets_do_not_hide_what_another_view_saw(how):
    """A box and a wall, joined by a stretched surface (rubber sheet); a second view sees the wall behind it."""
    size = (97, 61)
    camera = scenes.source_camera(size)
    depth = np.full(size[::-1], 4.0, np.float32)
    depth[:, 50:70] = 3.0
    color = np.full((*depth.shape, 3), 60, np.uint8)
    color[:, 50:70] = 200
    view = ibr.DepthImage(color, depth, camera)
    behind = ibr.DepthImage(np.full_like(color, 60), np.full_like(depth, 4.0), camera.moved(3.0, 0, 0))
    target = camera.moved(1.2, 0, 0)
    alone, both, other = (ibr.warp(views, target, **how) for views in (view, [view, behind], behind))
    sheet = alone.valid & (alone.depth > 3.1) & (alone.depth < 3.9) & other.valid
    assert sheet.any(axis=0).sum() >= 4
    assert (both.color[sheet] == 60).all() and np.abs(both.depth[sheet] - 4.0).max() < 1e-3
    box = alone.valid & (alone.depth < 3.001)
    assert (both.color[box] == 200).mean() > 0.95, "the box, without a tenth of a sample at its edge"


@pytest.mark.usefixtures("lanes")
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("size", [(7, 13), (61, 37), (1, 1), (33, 1)])
@pytest.mark.parametrize("cut_ratio", [None, 1.05])
def test_distances_to_edges_are_those_of_numpy(size, projection, cut_ratio):
    """Distances to edges are 0 beside a depth step if nothing is cut; if steps are cut, the surface ends there."""
    width, height = size
    rng = np.random.default_rng(3)
    depth = np.full((height, width), 4.0, np.float32)
    depth[:, width // 2 :] = 90.0
    depth[rng.random(depth.shape) < 0.02] = np.nan
    depth[0, 0] = 4.0
    view = ibr.DepthImage(None, depth, scenes.source_camera(size, projection))
    found = (
        blending.edges_of(view, surface_of(view, cut_ratio, cut_ratio is None))
        .to_host()[: width * height]
        .reshape(height, width)
    )
    around = np.pad(depth, 1, constant_values=np.inf)
    beside = [around[1:-1, :-2], around[1:-1, 2:], around[:-2, 1:-1], around[2:, 1:-1]]
    step = np.any([np.isfinite(other) & (np.abs(other - depth) > 0.5) for other in beside], axis=0)
    hole = np.isnan(depth) | np.any([np.isnan(other) for other in beside], axis=0)
    edges = np.pad(step | hole, 1, constant_values=True)
    y, x = np.nonzero(edges)
    at = np.mgrid[1 : height + 1, 1 : width + 1].transpose(1, 2, 0)[:, :, None]
    distance = np.abs(at - np.column_stack([y, x])).max(axis=3).min(axis=2)
    expected = np.where(step & (cut_ratio is None), 0, 1 + STEPS * np.minimum(distance, FEATHER))
    known = np.isfinite(depth)
    np.testing.assert_array_equal((found & 63)[known], expected[known])
    np.testing.assert_array_equal((found >> 8)[:-1], (found & 63)[1:])
