"""Lights: their arguments, the structs that kernels get, and highlights."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from tests.embree import points_of


def test_a_direction_is_kept_and_kernels_get_the_way_back():
    light = ibr.Light(direction=(0, 3, 4))
    assert light.position is None
    np.testing.assert_array_equal(light.direction, (0, 3, 4))
    np.testing.assert_allclose(light.struct(np.zeros(3))["vector"], (0, -0.6, -0.8, 0), atol=1e-7)
    np.testing.assert_array_equal(light.struct(np.zeros(3))["color"], (1, 1, 1))
    assert light.struct(np.zeros(3))["ambient"] == 0.25


def test_a_position():
    light = ibr.Light(position=[1, 2, -3], color=np.array([2, 1, 0.5]), ambient=1)
    assert light.direction is None
    np.testing.assert_array_equal(light.struct(np.zeros(3))["vector"], (1, 2, -3, 1))
    np.testing.assert_array_equal(light.struct(np.zeros(3))["color"], (2, 1, 0.5))
    assert light.struct(np.zeros(3))["ambient"] == 1


def test_a_spot_has_a_cone():
    spot = ibr.Light(position=(0, 0, 2), direction=(0, 0, -3), angle=60)
    np.testing.assert_allclose(spot.struct(np.zeros(3))["axis"], (0, 0, -1, np.cos(np.radians(30))), atol=1e-7)
    assert repr(spot) == "<Light position (0, 0, 2) direction (0, 0, -3)>"


def test_repr():
    assert repr(ibr.Light(direction=(0, 0, 1))) == "<Light direction (0, 0, 1)>"
    assert repr(ibr.Light(position=(1, -2.5, 0))) == "<Light position (1, -2.5, 0)>"


@pytest.mark.parametrize("length", [1e-320, 1e-300, 1e200, 1e308])
def test_directions_of_any_length(length):
    """Directions may be so long or short that the square of their length overflows or underflows."""
    one, other = (ibr.Light(direction=np.array([0, 0.6, 0.8]) * k, shadow_size=64) for k in (1.0, length))
    axes = [light.struct(np.zeros(3))["vector"] for light in (one, other)]
    np.testing.assert_allclose(axes[0], axes[1], atol=1e-3)
    frames = [ibr.render(FLOOR, floor_seen()[0], ibr.Light(direction=d)) for d in ((0, 0, -1), (0, 0, -length))]
    np.testing.assert_allclose(frames[0].color, frames[1].color, atol=1)


def test_the_brightest_light_is_white():
    frame = ibr.render(FLOOR, floor_seen()[0], ibr.Light(direction=(0, 0, -1), color=(1e6, 1e6, 1e6), specular=1e6))
    assert (frame.color == 255).all()


FLOOR = ibr.Mesh([[-4, -4, 0], [4, -4, 0], [4, 4, 0], [-4, 4, 0]], [[0, 1, 2], [0, 2, 3]])


def floor_seen(projection: str = "perspective") -> tuple[ibr.Camera, np.ndarray]:
    """A camera above the floor, and the point of the floor at each of its pixels."""
    how = {"height": 3.0, "projection": projection} if projection == "orthographic" else {}
    camera = ibr.Camera.look_at((0.3, -1, 2.5), (0, 0, 0), (0, 1, 0), (64, 48), fov_y=50, **how)
    frame = ibr.render(FLOOR, camera)
    assert frame.valid.all()
    return camera, points_of(frame).reshape(48, 64, 3)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_highlights(projection):
    """Blinn's highlights: a power of the cosine between the normal and the halfway vector of light and viewer."""
    camera, points = floor_seen(projection)
    for shape in ({"position": (-0.5, 0.8, 1.5)}, {"direction": (0.2, -0.4, -1)}, {"position": (0, 0, -1)}):
        light = ibr.Light(**shape, color=(1, 0.5, 0.2), ambient=0.2, specular=0.7, shininess=20, shadow_size=0)
        ones = np.ones_like(points)
        to_light = np.subtract(light.position, points) if light.direction is None else ones * -light.direction
        to_light /= np.linalg.norm(to_light, axis=-1, keepdims=True)
        to_eye = camera.center - points if projection == "perspective" else ones * -camera.forward
        to_eye /= np.linalg.norm(to_eye, axis=-1, keepdims=True)
        halfway = to_light + to_eye
        cosine = np.maximum(to_light[..., 2], 0)
        highlight = np.where(cosine > 0, (halfway[..., 2] / np.linalg.norm(halfway, axis=-1)) ** 20, 0)
        part = 0.2 + 0.8 * cosine[..., None] * light.color
        expected = 255 * np.minimum(0.8 * part + 0.8 * 0.7 * highlight[..., None] * light.color, 1)
        assert np.abs(ibr.render(FLOOR, camera, light).color - expected).max() <= 0.6  # rounding to bytes


def test_a_spot_light_lights_its_cone_alone():
    camera, points = floor_seen()
    light = ibr.Light(direction=(0, 0.2, -1), position=(0, 0, 2), angle=35, ambient=0.1, shadow_size=0)
    alone = ibr.Light(position=(0, 0, 2), ambient=0.1, shadow_size=0)
    spot, point = (ibr.render(FLOOR, camera, one).color for one in (light, alone))
    off_axis = points - (0, 0, 2)
    cosine = off_axis @ [0, 0.2, -1] / np.linalg.norm(off_axis, axis=-1) / np.hypot(0.2, 1)
    angle = np.degrees(np.arccos(cosine))
    outside, full = angle > 17.5 + 1e-3, angle < 0.98 * 17.5 - 1e-3
    assert min(outside.sum(), full.sum()) > 300
    assert np.abs(spot[outside] - 0.1 * 0.8 * 255).max() <= 0.6
    np.testing.assert_array_equal(spot[full], point[full])


BAD = [
    ({}, "direction", "got none"),
    ({"position": (1, 0, 0), "direction": (0, 1, 0), "angle": 0}, "angle", "degrees"),
    ({"position": (1, 0, 0), "direction": (0, 1, 0), "angle": 180}, "angle", "degrees"),
    ({"direction": (1, 0, 0), "specular": -1}, "specular", "from 0 to 1e"),
    ({"direction": (1, 0, 0), "shininess": 0}, "shininess", "> 0"),
    ({"direction": (1, 0, 0), "shadow_size": 1}, "shadow_size", "from 2"),
    ({"direction": (1, 0, 0), "shadow_size": 0.5}, "shadow_size", "whole"),
    ({"direction": (0, 0, 0)}, "direction", "not zero"),
    ({"direction": (1, 0)}, "direction", r"shape \(3,\)"),
    ({"direction": "down"}, "direction", "numbers"),
    ({"position": (np.nan, 0, 0)}, "position", "finite"),
    ({"position": [[0, 0, 0]]}, "position", r"shape \(3,\)"),
    ({"direction": (1, 0, 0), "color": (-1, 0, 0)}, "color", "from 0 to 1e"),
    ({"direction": (1, 0, 0), "color": 1.0}, "color", r"shape \(3,\)"),
    ({"direction": (1, 0, 0), "ambient": 1.5}, "ambient", "0 to 1"),
    ({"direction": (1, 0, 0), "ambient": -0.1}, "ambient", "0 to 1"),
    ({"direction": (1, 0, 0), "ambient": np.nan}, "ambient", "finite"),
    ({"direction": (1, 0, 0), "ambient": "half"}, "ambient", "numbers"),
    # numbers that single precision does not hold
    ({"direction": (1, 0, 0), "color": (1e39, 0, 0)}, "color", "from 0 to 1e"),
    ({"direction": (1, 0, 0), "color": (255, 0, 1e7)}, "color", "from 0 to 1e"),
    ({"direction": (1, 0, 0), "specular": 1e39}, "specular", "from 0 to 1e"),
    ({"direction": (1, 0, 0), "shininess": 1e39}, "shininess", "> 0"),
    ({"position": (1, 0, 0), "direction": (0, 1, 0), "angle": 1e-9}, "angle", "degrees"),
    ({"position": (0, 0, 1e30)}, "position", "up to"),
]


@pytest.mark.parametrize(("arguments", "argument", "said"), BAD)
def test_bad_arguments(arguments, argument, said):
    with pytest.raises(ibr.ArgumentError, match=f"^{argument}: .*{said}"):
        ibr.Light(**arguments)
