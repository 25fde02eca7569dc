"""Height maps on meshes: the two systems that draw them accept the same maps."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.errors import ArgumentError
from pyibr.meshes.heights import HeightMapped
from tests.displaced import square

HEIGHT, COLOR = np.full((4, 3), 0.5, np.float32), np.zeros((2, 2, 3), np.uint8)
WRONG = {
    "base": None,
    "height": np.full((4, 3), 2, np.float32),
    "color": COLOR[..., :2],
    "scale": -1.0,
    "tiles": (0, 1),
    "normal_map": -np.ones((2, 2, 3), np.float32),
    "wrap": "mirror",
}


@pytest.mark.parametrize("name", WRONG)
def test_both_systems_refuse_the_same_maps_in_the_same_words(name):
    arguments, said = {"base": square(), "height": HEIGHT, "color": COLOR, "scale": 0.1, name: WRONG[name]}, []
    for kind in (ibr.SlicedSurface, ibr.ReliefSurface):
        assert issubclass(kind, HeightMapped)
        with pytest.raises(ArgumentError) as error:
            kind(**arguments)
        assert error.value.argument == name
        said.append(str(error.value))
    assert said[0] == said[1]


def test_heights_stay_as_they_are():
    for kind in (ibr.SlicedSurface, ibr.ReliefSurface):
        surface = kind(square(), HEIGHT, COLOR, 0.1)
        np.testing.assert_array_equal(pickle.loads(pickle.dumps(surface)).height, HEIGHT)
        with pytest.raises(AttributeError, match="cannot be changed"):
            surface.height = HEIGHT
