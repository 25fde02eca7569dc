"""Turntables: the positions of the cameras, and the cameras' pictures."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture.turntable import turntable_cameras
from tests.boxes import cuboid
from tests.capture.test_stereo import planes


@pytest.fixture
def box() -> ibr.Mesh:
    return ibr.Mesh(*cuboid((0, 0, 4), (2, 1, 5)))


def test_a_turn_goes_round_the_middle_in_equal_steps(box: ibr.Mesh):
    cameras = turntable_cameras(box, 8, up=(0, 1, 0))
    middle = np.array([1, 0.5, 4.5])
    ways = np.array([camera.center - middle for camera in cameras])
    np.testing.assert_allclose(np.linalg.norm(ways, axis=1), np.linalg.norm(ways[0]), rtol=1e-9)
    np.testing.assert_allclose(ways[:, 1], ways[0, 1], rtol=1e-9)  # at constant height
    angles = np.unwrap(np.arctan2(ways[:, 0], ways[:, 2]))
    np.testing.assert_allclose(np.diff(angles), np.radians(45), rtol=1e-9)
    for camera in cameras:
        np.testing.assert_allclose(camera.project(middle[None])[0], [[319.5, 239.5]], atol=1e-6)


def test_a_swing_begins_at_the_picture_and_closes():
    view = planes()
    cameras = turntable_cameras(view, 8, swing=10)
    assert cameras[0] == view.camera
    turned = np.degrees([np.arctan2(camera.forward[0], camera.forward[2]) for camera in cameras])
    np.testing.assert_allclose(turned, -10 * np.sin(np.arange(8) * np.pi / 4), atol=1e-9)
    other = turntable_cameras(ibr.WarpedView(view), 8, swing=10)
    assert other == cameras


def test_frames_are_those_of_the_cameras(box: ibr.Mesh):
    camera = ibr.Camera.look_at((1, 0.5, 0), (1, 0.5, 4.5), (0, -1, 0), (24, 18))
    made = list(ibr.turntable(box, 3, camera, background=(9, 9, 9)))
    for frame, one in zip(made, turntable_cameras(box, 3, camera), strict=True):
        np.testing.assert_array_equal(frame.color, ibr.render(box, one, background=(9, 9, 9)).color)


def test_mistakes_are_told(box: ibr.Mesh):
    point = ibr.Mesh([[1, 1, 1]] * 3, [[0, 1, 2]])
    for thing, how, word in ((box, {"frames": 0}, "frames"), (box, {"up": (0, 0, 0)}, "up"), (point, {}, "extent")):
        with pytest.raises(ibr.ArgumentError, match=word):
            ibr.turntable(thing, **how)
