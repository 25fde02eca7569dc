"""The rasteriser's kernels in their form for GPUs, and how often the host waits for them."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from pyibr.opencl import memory
from pyibr.raster import bins
from tests.exact import same_bits
from tests.one_lane import both_forms, one_lane, unlike
from tests.scenes import pose

LIGHT = ibr.Light(position=(0, -2, 0), shadow_size=128)


def globe(projection: str) -> tuple[ibr.Mesh, Camera]:
    """A textured sphere of radius 1, 4 in front of the camera, in a picture that bins do not divide evenly."""
    across, down = np.meshgrid(np.linspace(0, 1, 41), np.linspace(0, 1, 21))
    a, b = 2 * np.pi * across.ravel(), np.pi * down.ravel()
    points = np.stack([np.sin(b) * np.cos(a), -np.cos(b), np.sin(b) * np.sin(a)], axis=-1)
    i = (np.arange(20)[:, None] * 41 + np.arange(40)).ravel()
    faces = np.concatenate([np.stack([i, i + 1, i + 41], 1), np.stack([i + 1, i + 42, i + 41], 1)])
    texture = np.random.default_rng(0).integers(0, 256, (20, 30, 3)).astype(np.uint8)
    mesh = ibr.Mesh(
        np.add(points, (0, 0, 4)),
        faces,
        uv=np.stack([across, down], -1).reshape(-1, 2),
        normals=points,
        texture=texture,
    )
    f = 250 if projection == "perspective" else 70
    return mesh, Camera([[f, 0, 70], [0, f, 90], [0, 0, 1]], (150, 170), projection=projection)


def soup(projection: str) -> tuple[ibr.Mesh, Camera]:
    """Coloured triangles that intersect, in front of the camera and behind it."""
    rng = np.random.default_rng(1)
    points = rng.uniform((-4, -3, -2), (4, 3, 6), (200, 1, 3)) + rng.normal(size=(200, 3, 3))
    mesh = ibr.Mesh(points.reshape(-1, 3), np.arange(600).reshape(-1, 3), colors=rng.random((600, 3), np.float32))
    f = 100 if projection == "perspective" else 20
    return mesh, Camera([[f, 0, 70], [0, f, 50], [0, 0, 1]], (161, 121), pose(roll=20), projection=projection)


@pytest.mark.thorough
@pytest.mark.parametrize(("scene", "projection"), [(globe, "orthographic"), (soup, "perspective")])
def test_one_lane_is_as_good_as_sixteen(scene, projection):
    mesh, camera = scene(projection)
    wide, one = both_forms(lambda: ibr.render(mesh, camera, LIGHT))
    assert wide.valid.sum() > 5000
    # Corners are rounded to 1/256 of a pixel relative to the region that a work-item draws. Pixels at outlines and on
    # edges between triangles may differ.
    outlines, depths, colors = unlike(one, wide, rtol=1e-5)
    assert outlines <= 1e-4 and depths <= 5e-4 and colors <= 5e-4


@pytest.mark.thorough
def test_one_lane_draws_into_what_is_there():
    near, camera = globe("perspective")
    wall = ibr.Mesh([[-2, -2, 4], [2, -2, 4], [2, 2, 4], [-2, 2, 4]], [[0, 2, 1], [0, 3, 2]])
    with one_lane():
        one, other = ibr.render([near, wall], camera), ibr.render([wall, near], camera)
    wide = ibr.render([near, wall], camera)
    same_bits(one, other)
    np.testing.assert_allclose(one.depth, wide.depth, rtol=1e-5)


def test_nobody_asks_how_long_lists_are_that_there_is_room_for(monkeypatch):
    """Pictures are the same whether or not the host reads the lists' lengths, with full and with empty lists."""
    (first, camera), (second, _) = globe("perspective"), soup("perspective")
    behind = ibr.Mesh(first.vertices - (0, 0, 9), first.faces)
    frames, asked, read = [], [], memory.to_host
    monkeypatch.setattr(memory, "to_host", lambda arrays: asked.append(arrays) or read(arrays))
    for longest in (bins._UNSYNCHRONIZED, 0):
        monkeypatch.setattr(bins, "_UNSYNCHRONIZED", longest)
        frames.append(ibr.render([first, behind, second], camera, ibr.Light(position=(0, -2, 0), shadow_size=0)))
        assert len(asked) == (0 if longest else 3)
    same_bits(*frames)
    assert frames[0].valid.sum() > 5000


def test_lists_that_are_too_long_to_be_numbered_are_told(monkeypatch):
    """A million triangles that each cover the whole picture would be listed in every bin."""
    mesh, camera = globe("perspective")
    monkeypatch.setattr(bins, "_UNSYNCHRONIZED", 0)
    monkeypatch.setattr(bins, "_NUMBERED_MAX", 100)
    with pytest.raises(ibr.OutOfMemoryError, match=r"list \d{4} primitives in all, more than 100"):
        ibr.render(mesh, camera)
