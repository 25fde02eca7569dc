"""Paths of cameras pass smoothly through all given cameras, and files store them exactly."""

from __future__ import annotations

import json

import numpy as np
import pytest

import pyibr as ibr
from pyibr.app.view.paths import CameraPath


def cameras(count: int = 4) -> list[ibr.Camera]:
    rng = np.random.default_rng(3)
    return [
        ibr.Camera.look_at(3 * rng.normal(size=3), rng.normal(size=3), (0, -1, 0), (61, 37), fov_y=rng.uniform(20, 80))
        for _ in range(count)
    ]


def test_it_passes_through_its_cameras():
    path = CameraPath(cameras(), 6.0)
    for number, camera in enumerate(path.cameras):
        found = path.at(2.0 * number)
        np.testing.assert_allclose(found.world_from_camera, camera.world_from_camera, atol=1e-12)
        np.testing.assert_allclose(found.K[1, 1], camera.K[1, 1], rtol=1e-12)
        assert found.size == (61, 37)
    assert path.at(-1.0) == path.at(0.0) and path.at(7.0) == path.at(6.0)


def test_it_has_no_corners_in_its_way():
    path = CameraPath(cameras(), 6.0)
    for time in (2.0, 4.0):
        before, at, after = (path.at(time + step).center for step in (-1e-5, 0, 1e-5))
        speed = np.linalg.norm(after - before) / 2e-5
        assert np.linalg.norm((after - at) - (at - before)) < 1e-3 * speed * 1e-5


def test_it_turns_along_the_shortest_arc():
    start = ibr.Camera([[50, 0, 30], [0, 50, 18], [0, 0, 1]], (61, 37))
    path = CameraPath([start.orbited(-100, (0, 0, 0)), start.orbited(100, (0, 0, 0))], 1.0)
    np.testing.assert_allclose(path.at(0.5).forward, (0, 0, -1), atol=1e-12)  # by 160 degrees, not by 200
    one = CameraPath([start], 1.0)
    assert one.at(0.3) == start


def test_files_hold_it_to_the_bit():
    path = CameraPath(cameras(), 2.5)
    again = CameraPath.from_json(json.loads(json.dumps(path.to_json())), "path.json")
    assert list(again.cameras) == path.cameras and again.seconds == 2.5


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ([], "expected a JSON object with cameras"),
        ({"cameras": 3}, "expected a list of cameras, got int"),
        ({"cameras": []}, "cameras: expected at least one camera, got none"),
        ({"cameras": [{"width": 3}]}, "has no height"),
        ({"cameras": [], "speed": 1}, "expected a JSON object with cameras and seconds"),
    ],
)
def test_other_files_are_refused_by_name(data, said):
    with pytest.raises(ibr.FileFormatError, match=r"other\.json: ") as raised:
        CameraPath.from_json(data, "other.json")
    assert said in str(raised.value)


def test_seconds_and_cameras_are_checked():
    with pytest.raises(ibr.ArgumentError, match="seconds"):
        CameraPath(cameras(), 0.0)
    flat = ibr.Camera([[50, 0, 30], [0, 50, 18], [0, 0, 1]], (61, 37), projection="orthographic")
    with pytest.raises(ibr.ArgumentError, match="an orthographic one"):
        CameraPath([flat], 1.0)
