"""Lights: what they take, and what kernels get of them."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr


def test_a_direction_is_kept_and_kernels_get_the_way_back():
    light = ibr.Light(direction=(0, 3, 4))
    assert light.position is None
    np.testing.assert_array_equal(light.direction, (0, 3, 4))
    np.testing.assert_allclose(light.struct["vector"], (0, -0.6, -0.8, 0), atol=1e-7)
    np.testing.assert_array_equal(light.struct["color"], (1, 1, 1))
    assert light.struct["ambient"] == 0.25


def test_a_position():
    light = ibr.Light(position=[1, 2, -3], color=np.array([2, 1, 0.5]), ambient=1)
    assert light.direction is None
    np.testing.assert_array_equal(light.struct["vector"], (1, 2, -3, 1))
    np.testing.assert_array_equal(light.struct["color"], (2, 1, 0.5))
    assert light.struct["ambient"] == 1


def test_a_spot_has_a_cone():
    spot = ibr.Light(position=(0, 0, 2), direction=(0, 0, -3), angle=60)
    np.testing.assert_allclose(spot.struct["axis"], (0, 0, -1, np.cos(np.radians(30))), atol=1e-7)
    assert repr(spot) == "<Light position (0, 0, 2) direction (0, 0, -3)>"


def test_repr():
    assert repr(ibr.Light(direction=(0, 0, 1))) == "<Light direction (0, 0, 1)>"
    assert repr(ibr.Light(position=(1, -2.5, 0))) == "<Light position (1, -2.5, 0)>"


BAD = [
    ({}, "direction", "got none"),
    ({"position": (1, 0, 0), "direction": (0, 1, 0), "angle": 0}, "angle", "degrees"),
    ({"position": (1, 0, 0), "direction": (0, 1, 0), "angle": 180}, "angle", "degrees"),
    ({"direction": (1, 0, 0), "specular": -1}, "specular", ">= 0"),
    ({"direction": (1, 0, 0), "shininess": 0}, "shininess", "> 0"),
    ({"direction": (1, 0, 0), "shadow_size": 1}, "shadow_size", "from 2"),
    ({"direction": (1, 0, 0), "shadow_size": 0.5}, "shadow_size", "whole"),
    ({"direction": (0, 0, 0)}, "direction", "not zero"),
    ({"direction": (1, 0)}, "direction", r"shape \(3,\)"),
    ({"direction": "down"}, "direction", "numbers"),
    ({"position": (np.nan, 0, 0)}, "position", "finite"),
    ({"position": [[0, 0, 0]]}, "position", r"shape \(3,\)"),
    ({"direction": (1, 0, 0), "color": (-1, 0, 0)}, "color", ">= 0"),
    ({"direction": (1, 0, 0), "color": 1.0}, "color", r"shape \(3,\)"),
    ({"direction": (1, 0, 0), "ambient": 1.5}, "ambient", "0 to 1"),
    ({"direction": (1, 0, 0), "ambient": -0.1}, "ambient", "0 to 1"),
    ({"direction": (1, 0, 0), "ambient": np.nan}, "ambient", "finite"),
    ({"direction": (1, 0, 0), "ambient": "half"}, "ambient", "numbers"),
]


@pytest.mark.parametrize(("arguments", "argument", "said"), BAD)
def test_bad_arguments(arguments, argument, said):
    with pytest.raises(ibr.ArgumentError, match=f"^{argument}: .*{said}"):
        ibr.Light(**arguments)
