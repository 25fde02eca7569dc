"""Views without colours: they give the same depth as views with colours, and pictures show them in white."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import pyibr as ibr
from tests import scenes


@pytest.fixture(scope="module")
def colored() -> ibr.DepthImage:
    return scenes.holed((61, 37))


@pytest.fixture(scope="module")
def alone(colored: ibr.DepthImage) -> ibr.DepthImage:
    return ibr.DepthImage(None, colored.depth, colored.camera, far=colored.far)


@pytest.mark.parametrize("method", ["epipolar", "search", "forward"])
@pytest.mark.parametrize("fill", [None, "background", "smooth", "inpaint", "exemplar"])
@pytest.mark.parametrize("several", [False, True])
@pytest.mark.filterwarnings("ignore:warp. the target camera sees nothing")
def test_depth_is_the_same_with_and_without_colours(colored, alone, method, fill, several, lanes):
    for pose in scenes.special_cameras(colored, (53, 30))[::3]:
        views = [([view] * (1 + several)) for view in (colored, alone)]
        with_color, without = (ibr.warp(some, pose.camera, method=method, fill=fill) for some in views)
        np.testing.assert_array_equal(with_color.depth, without.depth)
        np.testing.assert_array_equal(with_color.valid, without.valid)
        assert without.color.shape == (30, 53, 0)


def test_it_says_what_it_is(alone):
    assert "depth alone" in repr(alone) and not alone.has_color
    again = pickle.loads(pickle.dumps(alone))
    assert not again.has_color
    np.testing.assert_array_equal(again.depth, alone.depth)
    assert "depth alone" in repr(ibr.warp(alone, alone.camera))


def test_frames_to_write_into_have_no_colours(alone):
    camera = alone.camera.moved(0.1, 0, 0)
    expected = ibr.warp(alone, camera)
    shape = expected.depth.shape
    frame = ibr.Frame(np.empty((*shape, 0), np.uint8), np.empty(shape, np.float32), np.empty(shape, bool), camera)
    ibr.warp(alone, camera, out=frame)
    np.testing.assert_array_equal(frame.depth, expected.depth)


def test_colours_and_depth_alone_do_not_mix(colored, alone):
    with pytest.raises(ibr.ArgumentError, match="views: expected views that all have colours, or none"):
        ibr.warp([colored, alone], colored.camera)


def test_pictures_show_it_white(alone):
    camera = alone.camera.moved(0.05, 0, 0)
    views = [alone.in_color]
    for things in (alone, ibr.DepthMesh(alone), ibr.DepthMeshObject([alone]), [alone, *views]):
        frame = ibr.render(things, camera)
        assert frame.valid.any() and (frame.color[frame.valid] == 255).all()
    in_float = ibr.DepthImage(np.zeros((*alone.depth.shape, 3), np.float32), alone.depth, alone.camera, far=alone.far)
    frame = ibr.render([alone, in_float], camera)
    assert frame.color.dtype == np.float32 and frame.color[frame.valid].min() == pytest.approx(1.0)  # the first is kept
