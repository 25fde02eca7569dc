"""Samples cover their whole pixels: objects reach up to the outlines in their images, and up to the images' borders."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture.raycast import spread_directions
from pyibr.core.camera import Camera
from tests.slicing.solids import ball

PROJECTIONS = ("perspective", "orthographic")


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("count", [6, 12])
def test_a_ball_is_as_large_as_it_is(count, projection):
    scene = ball()
    how = {"fov_y": 22.0} if projection == "perspective" else {"projection": projection, "height": 2.3}
    ways = spread_directions(count)
    aside = [np.eye(3)[np.abs(way).argmin()] for way in ways]
    cameras = [
        Camera.look_at(-6 * np.array(d), (0, 0, 0), up, (64, 64), **how) for d, up in zip(ways, aside, strict=True)
    ]
    thing = ibr.DepthObject([scene.capture(camera) for camera in cameras], slices=256)
    eye = Camera.look_at((3, 2, 5), (0, 0, 0), (0, 0, 1), (400, 400), fov_y=24)
    truth, frame = scene.capture(eye), ibr.render(thing, eye)
    # Images show outlines to half a sample. The ball is 55 samples wide, so that a tenth of that is 0.4 % of its area.
    share = frame.valid.sum() / truth.valid.sum()
    assert 0.998 <= share <= 1.001, share
    assert (frame.valid & ~truth.valid).sum() <= 1e-3 * truth.valid.sum()
    # The middle is right to half a sample, which is 1/28 wide.
    assert abs(frame.depth[200, 200] - truth.depth[200, 200]) <= 0.5 / 28


@pytest.mark.usefixtures("lanes")
@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("size", [(1, 1), (1, 9), (2, 2), (7, 13)])
def test_a_wall_fills_its_image(size, projection):
    """The wall is drawn up to the image's border, and no farther."""
    width, height = size
    camera = Camera([[20, 0, (width - 1) / 2], [0, 20, (height - 1) / 2], [0, 0, 1]], size, projection=projection)
    view = ibr.DepthImage(np.full((height, width, 3), 90, np.uint8), np.full((height, width), 4, np.float32), camera)
    thing = ibr.DepthObject([view], slices=64)
    assert ibr.render(thing, camera).valid.all()
    assert ibr.render(thing, camera.resized((2 * width, 2 * height))).valid.all()
    # The picture sees twice the width, with four times the resolution: the wall covers 4 width x 4 height pixels, give
    # or take one.
    K = np.array([[80, 0, 4 * width - 0.5], [0, 80, 4 * height - 0.5], [0, 0, 1]])
    frame = ibr.render(thing, Camera(K, (8 * width, 8 * height), projection=projection))
    columns, rows = (np.flatnonzero(frame.valid.any(axis=axis)) for axis in (0, 1))
    for found, count in ((columns, width), (rows, height)):
        assert abs(found[0] - 2 * count) <= 1 and abs(found[-1] - (6 * count - 1)) <= 1
