"""A light keeps its shadow maps while the scene is unchanged; pictures are the same as with new maps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import models
from pyibr.picture import shadow

GROUND = ibr.Mesh([[-3, -3, -1], [3, -3, -1], [3, 3, -1], [-3, 3, -1]], [[0, 1, 2], [0, 2, 3]])
RING = models.donut(24)
CAMERAS = [ibr.Camera.look_at(eye, (0, 0, -0.5), (0, 0, 1), (83, 59)) for eye in ((2, -4, 3), (-3, -3, 2), (0, 1, 5))]


def sun(**more: object) -> ibr.Light:
    return ibr.Light(direction=(0.4, 0.3, -1), **({"shadow_size": 96} | more))


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> list[None]:
    """A list with one entry for each time that shadow maps are drawn."""
    seen: list[None] = []
    cameras = shadow.light_cameras

    def counted(*given: object) -> object:
        seen.append(None)
        return cameras(*given)

    monkeypatch.setattr(shadow, "light_cameras", counted)
    return seen


def test_a_scene_that_stays_is_looked_at_once(looks):
    light = sun()
    for camera in CAMERAS:
        kept, fresh = (ibr.render([GROUND, RING], camera, one) for one in (light, sun()))
        assert (kept.color == fresh.color).all()
    assert len(looks) == 1 + len(CAMERAS)


def test_what_changes_is_looked_at_again(looks):
    light, (camera, *_) = sun(), CAMERAS
    moved = ibr.Mesh(RING.vertices + np.float32(0.4), RING.faces)
    depth = np.full((30, 40), 2, np.float32)
    depth[10:20, 15:25] = 1.5  # an edge, which is cut or not
    view = ibr.DepthImage(None, depth, ibr.Camera([[40, 0, 19.5], [0, 40, 14.5], [0, 0, 1]], (40, 30)))
    scenes: list[list[Any]] = [[GROUND, RING], [GROUND, moved], [GROUND], [GROUND, RING]]
    scenes += [[view], [ibr.WarpedView(view, edges="connect")], [view, view]]
    for number, things in enumerate(scenes):
        frame = ibr.render(things, camera, light)
        assert len(looks) == 2 * number + 1
        assert (frame.color == ibr.render(things, camera, sun()).color).all()


def test_things_of_ones_own_may_change(looks):
    class Moving:
        offset = 0.0

        @property
        def bounds(self):
            return RING.bounds[0] + self.offset, RING.bounds[1] + self.offset

        def draw(self, target, lighting):
            from pyibr.picture.drawable import as_drawable

            moved = ibr.Mesh(RING.vertices + np.float32(self.offset), RING.faces)
            as_drawable(moved).draw(target, lighting)

    light, thing = sun(), Moving()
    before = ibr.render([GROUND, thing], CAMERAS[0], light).color
    thing.offset = 0.5
    after = ibr.render([GROUND, thing], CAMERAS[0], light).color
    assert len(looks) == 2
    assert (after != before).any()
    assert (after == ibr.render([GROUND, thing], CAMERAS[0], sun()).color).all()


def test_a_light_holds_no_thing(looks):
    light = sun()
    for height in (0.0, 0.2, 0.4):  # each mesh may reuse the memory of the previous one
        ring = ibr.Mesh(RING.vertices + np.float32(height), RING.faces)
        assert (ibr.render([GROUND, ring], CAMERAS[0], light).color == lit_anew(ring)).all()
        del ring
    assert len(looks) == 6


def lit_anew(ring: ibr.Mesh) -> np.ndarray:
    return ibr.render([GROUND, ring], CAMERAS[0], sun()).color


def test_a_light_cannot_be_changed():
    light = sun()
    with pytest.raises(AttributeError, match="make a new one"):
        light.ambient = 0.5
    with pytest.raises(ValueError, match="read-only"):
        light.direction[0] = 1
