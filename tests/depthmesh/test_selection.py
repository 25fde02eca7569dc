"""Reuse of a selection of vertices while the camera moves: it is reused as long as it suffices, and no longer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from pyibr.depthmesh import triangulation
from pyibr.depthmesh.selection import Selection, select_for
from pyibr.opencl.watch import LaunchTimes, watching
from tests import scenes
from tests.depthmesh.views import rough, some_camera, some_mesh


def nudged(rng: np.random.Generator, camera: Camera, by: float) -> Camera:
    """The camera, moved at random by up to `by` scene units and turned by up to `by` radians."""
    aside, turn = rng.uniform(-by, by, 3), rng.uniform(-by, by, 2)
    way = scenes.pose(yaw=np.degrees(turn[0]), pitch=np.degrees(turn[1]), center=tuple(aside))
    return Camera(camera.K, camera.size, camera.world_from_camera @ way, projection=camera.projection)


def moved_by(camera: Camera, way: np.ndarray) -> Camera:
    """The camera, moved by `way` in the world and not turned."""
    there = camera.world_from_camera.copy()
    there[:3, 3] += way
    return Camera(camera.K, camera.size, there, projection=camera.projection)


def needs_more(thing: ibr.DepthMesh, kept: Selection, camera: Camera) -> bool:
    needed = select_for([thing.tree], camera, kept.tolerance).active[0].to_host()
    width = thing.tree.side + 1
    return bool(((needed > 0) & (kept.active[0].to_host() == 0))[:, :width].any())


def test_held_selections_are_enough(lanes):
    """A selection is reused for small moves only, and then contains all vertices that are needed."""
    rng = np.random.default_rng(5)
    held = {by: [] for by in (0.0, 0.01, 0.1, 1.0)}
    for number in range(40 if lanes == 16 else 8):
        thing = some_mesh(rng, number)
        camera = some_camera(rng, thing.view)
        for tolerance, reuse in ((1.0, 0.1), (4.0, 0.4)):
            kept = select_for([thing.tree], camera, tolerance, reuse)
            for by, held_there in held.items():
                other = nudged(rng, camera, by)
                held_there.append(kept.holds_for(other))
                assert not (held_there[-1] and needs_more(thing, kept, other)), (number, by, tolerance)
    assert all(held[0.0])
    assert np.mean(held[0.01]) > 0.3 and np.mean(held[1.0]) < np.mean(held[0.1]) < np.mean(held[0.01])


def test_they_hold_no_longer_than_they_are_enough():
    """At 0.95 of the allowed motion no vertex is missing in any direction; at 1.3, some are, in some directions."""
    view = rough(np.random.default_rng(6), (90, 70), "perspective")
    thing, wide = ibr.DepthMesh(view), view.camera.moved(0, 0, -4.0)
    kept = select_for([thing.tree], wide, 1.0, 0.1)  # the whole surface is in view
    room, nearest = kept.motion_limit
    assert 0.1 < room < 0.9 * 0.1 * nearest  # the distances decide, not the angles
    ways = view.points[:: len(view.points) // 40] - wide.center
    for share, enough in ((0.95, True), (1.3, False)):
        moved = [moved_by(wide, share * room * way / np.linalg.norm(way)) for way in ways]
        assert all(kept.holds_for(camera) == enough for camera in moved)
        assert any(needs_more(thing, kept, camera) for camera in moved) != enough

    narrow = Camera(wide.K * [[4, 1, 1], [1, 4, 1], [1, 1, 1]], wide.size, wide.world_from_camera)
    kept = select_for([thing.tree], narrow, 0.0, 0.05)  # all vertices in view are active
    for share, enough in ((0.95, True), (1.3, False)):
        angle = np.degrees(2 * np.arcsin(share * kept.reuse / 2))
        turns = [scenes.pose(yaw=yaw * angle, pitch=pitch * angle) for yaw, pitch in ((-1, 0), (1, 0), (0, -1), (0, 1))]
        turned = [Camera(narrow.K, narrow.size, narrow.world_from_camera @ turn) for turn in turns]
        assert all(kept.holds_for(camera) == enough for camera in turned)
        assert any(needs_more(thing, kept, camera) for camera in turned) != enough


def test_other_pictures_and_other_lenses_are_chosen_for_anew():
    view = scenes.smooth((65, 65))
    thing, camera = ibr.DepthMesh(view), view.camera
    kept = select_for([thing.tree], camera, 1.0, 0.2)
    assert kept.holds_for(camera)
    closer = Camera(camera.K * [[1.01], [1.01], [1]], camera.size, camera.world_from_camera)
    flat = Camera(camera.K, camera.size, camera.world_from_camera, projection="orthographic")
    assert not any(kept.holds_for(other) for other in (closer, flat, camera.resized((130, 130))))


def chosen_anew(draw: Callable[[], object]) -> bool:
    with watching(LaunchTimes()) as times:
        draw()
    return "activate" in times.of


def same(a: ibr.Frame, b: ibr.Frame) -> bool:
    fields = (a.color, b.color), (a.depth, b.depth), (a.valid, b.valid)
    return all(np.array_equal(one, other, equal_nan=one.dtype.kind == "f") for one, other in fields)


@pytest.mark.parametrize("blended", [False, True])
def test_triangles_are_drawn_again_while_the_tolerance_holds(blended):
    """With `reuse`, the selection is made for a finer tolerance, again when the camera has left its range."""
    view = rough(np.random.default_rng(4), (90, 70), "perspective")
    views = [view, ibr.DepthImage(view.color, view.depth, view.camera.moved(0.1, 0, 0))]
    camera = view.camera.moved(0, 0, -4.0)  # the whole surface is in view

    def made(tolerance: float, reuse: float = 0.0) -> ibr.DepthMesh | ibr.DepthMeshObject:
        if blended:
            return ibr.DepthMeshObject(views, tolerance=2 * tolerance, reuse=reuse)
        return ibr.DepthMesh(view, tolerance=tolerance, reuse=reuse)

    def off(thing: ibr.DepthMesh | ibr.DepthMeshObject) -> float:
        frame, full = ibr.render(thing, camera), ibr.render(made(0.0), camera)
        return float(np.abs(frame.depth - full.depth)[frame.valid & full.valid].mean())

    kept = made(1.0, 0.25)
    assert chosen_anew(lambda: ibr.render(kept, camera))
    assert off(kept) <= off(made(0.75)) < off(made(1.0))
    near, far = camera.moved(0.2, 0.1, 0.1), camera.moved(0, 0, 3.5)
    assert not chosen_anew(lambda: ibr.render(kept, near))
    there = ibr.render(kept, near)
    full = ibr.render(made(0.0), near)
    both = there.valid & full.valid
    assert both.mean() > 0.1 and (there.valid ^ full.valid).mean() < 0.01
    # At a distance of 8, a pixel is 0.1 wide; slopes are below 3, so that depth may be off by 0.3.
    assert (np.abs(there.depth - full.depth)[both] < 0.3).mean() > 0.99
    assert chosen_anew(lambda: ibr.render(kept, far))
    back = near.moved(0, 0, -0.02)
    assert same(ibr.render(kept, back), ibr.render(made(1.0, 0.25), back))


def test_lights_do_not_choose_for_viewers():
    """For its shadow map, a light selects other triangles; the selection for the viewer stays in the cache."""
    view = rough(np.random.default_rng(4), (90, 70), "perspective")
    kept = ibr.DepthMesh(view, reuse=0.25)
    camera = view.camera.moved(0, 0, -4.0)
    light = ibr.Light(direction=camera.forward + 2 * camera.world_from_camera[:3, 0])
    lit = ibr.render(kept, camera, light=light)
    assert not chosen_anew(lambda: ibr.render(kept, camera))
    assert same(lit, ibr.render(kept, camera, light=light))
    assert not same(lit, ibr.render(kept, camera))


def test_another_threads_turn_amid_a_choice_does_no_harm(monkeypatch):
    """While a launch runs, another thread may draw the same object: the cache never mixes their two selections."""
    view = rough(np.random.default_rng(4), (90, 70), "perspective")
    here, there = view.camera.moved(0, 0, -4.0), view.camera.moved(1.5, 0, 1.0)
    kept = ibr.DepthMesh(view, reuse=0.1)
    expected = {camera: ibr.render(ibr.DepthMesh(view, reuse=0.1), camera) for camera in (here, there)}
    assert not same(*(expected[camera] for camera in (here, there)))
    list_triangles, others = triangulation.list_triangles, [there]

    def interrupted(*arguments: Any, **more: Any) -> Any:
        if others:
            assert same(ibr.render(kept, others.pop()), expected[there])
        return list_triangles(*arguments, **more)

    monkeypatch.setattr(triangulation, "list_triangles", interrupted)
    for camera in (here, there, here):
        assert same(ibr.render(kept, camera), expected[camera])
