"""Merging triangles down to a given number: no cracks or folds appear, and the mesh stays close to the samples."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from pyibr.depthmesh import merging
from tests.data import shared
from tests.depthmesh.test_bad_input import refused
from tests.depthmesh.test_noise import corner_of_a_room, view_of


def pixels_of(mesh: ibr.Mesh, camera: Camera) -> np.ndarray:
    assert mesh.uv is not None
    return (mesh.uv.astype(np.float64) * camera.size - 0.5)[mesh.faces]


def check_sound(mesh: ibr.Mesh, camera: Camera) -> None:
    """Assert that no triangle is turned over, and that none overlap: their areas add up to the mesh's picture."""
    a, b, c = np.moveaxis(pixels_of(mesh, camera), 1, 0)
    u, v = b - a, c - a
    areas = -0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    assert (areas > 0).all()
    edges = np.concatenate([mesh.faces[:, k] for k in ([0, 1], [1, 2], [2, 0])])
    assert len(np.unique(edges, axis=0)) == len(edges)  # two triangles run along a common edge in opposite directions
    # A pixel counts if its centre is inside, so that the errors along an outline cancel.
    shown = ibr.render(mesh, camera).valid.sum()
    assert abs(areas.sum() - shown) < 0.01 * shown


@cache
def corner() -> tuple[np.ndarray, ibr.DepthMesh]:
    clean = corner_of_a_room()
    thing = ibr.DepthMesh(view_of(clean))
    assert len(thing.simplify(0.5).faces) > 2500  # at depth edges and borders, the quadtree keeps more
    return clean, thing


@pytest.mark.parametrize("count", [4000, 200, pytest.param(1000, marks=pytest.mark.thorough)])
def test_as_many_as_are_asked_for(count):
    clean, thing = corner()
    view = thing.view
    mesh = thing.simplify(count=count)
    assert 0.9 * count < len(mesh.faces) <= count
    check_sound(mesh, view.camera)
    frame = ibr.render(mesh, view.camera)
    off = np.abs(frame.depth - clean)[frame.valid]
    # If a quarter of the triangles are on the half ball of radius r = 0.6, their sides e have e^2 = 9 / count. Such
    # triangles lie e^2 / (8 r) = 2 / count below the ball; along oblique lines of sight this is several times as far.
    assert np.quantile(off, 0.95) < 20 / count
    whole = ibr.render(thing, view.camera).valid
    assert (frame.valid == whole).mean() > {4000: 0.999, 1000: 0.995, 200: 0.98}[count]


def test_the_error_holds_whatever_the_count():
    """If `count` triangles would exceed the allowed error, more remain."""
    clean, thing = corner()
    view = thing.view
    bound = 0.01
    mesh = thing.simplify(bound, count=1)
    assert 10 < len(mesh.faces) < 0.8 * len(thing.simplify(bound).faces)
    check_sound(mesh, view.camera)
    frame = ibr.render(mesh, view.camera)
    # The mesh is off the planes by at most `bound`, perpendicular to them. Lines of sight meet the floor at 15 degrees
    # or more, so that depth is off by up to four times as much.
    assert np.quantile(np.abs(frame.depth - clean)[frame.valid], 0.99) < 6 * bound


def test_merging_stops_when_all_that_is_allowed_is_refused(monkeypatch):
    """The bound stops it after a few rounds, and it passes over no edge that might still collapse."""
    rng = np.random.default_rng(0)
    height = np.cumsum(np.cumsum(rng.normal(size=(49, 65)), 0), 1)
    camera = Camera([[1, 0, 32], [0, 1, 24], [0, 0, 1]], (65, 49), projection="orthographic")
    depth = (40 - 12 * (height - height.min()) / np.ptp(height)).astype(np.float32)
    thing = ibr.DepthMesh(ibr.DepthImage(np.zeros((49, 65, 3), np.uint8), depth, camera, noise=0.0))
    bound, whole = 0.1, thing.simplify(0.1)
    points, pixels = whole.vertices.astype(np.float64), camera.project(whole.vertices.astype(np.float64))[0]
    given = points, pixels, whole.faces.astype(np.int64), 1, bound
    left, rounds, edges = merging.merged(*given), [], merging._edges

    def all_edges(points, quadrics, faces, live, refused):
        rounds.append(len(faces))
        return edges(points, quadrics, faces, np.ones_like(live), refused)

    monkeypatch.setattr(merging, "_edges", all_edges)
    np.testing.assert_array_equal(merging.merged(*given), left)
    assert len(left) < 0.98 * len(whole.faces) and len(rounds) < 60  # of 400


def test_one_triangle_is_the_least():
    view = view_of(np.full((250, 331), 2.0))
    assert len(ibr.DepthMesh(view).simplify(count=2).faces) == 2
    assert len(ibr.DepthMesh(view).simplify(count=1).faces) <= 2


@pytest.mark.thorough
def test_a_room_for_the_web():
    """Even with a large error, the quadtree alone leaves 8,000 triangles, along depth edges."""
    depth = cv2.imread(str(shared("rgbd_livingroom1") / "depth" / "00000.png"), cv2.IMREAD_UNCHANGED) / 1000
    depth = depth[::2, ::2].copy()
    camera = Camera([[262.5, 0, 159.75], [0, 262.5, 119.75], [0, 0, 1]], (320, 240))
    thing = ibr.DepthMesh(ibr.DepthImage(np.zeros((240, 320, 3), np.uint8), depth.astype(np.float32), camera))
    mesh = thing.simplify(count=1500)
    frame, whole = (ibr.render(each, thing.view.camera) for each in (mesh, thing))
    assert 1450 < len(mesh.faces) <= 1500
    assert len(thing.simplify(0.5).faces) > 8000
    assert (frame.valid == whole.valid).mean() > 0.99
    both = frame.valid & whole.valid
    assert np.quantile(np.abs(frame.depth - depth)[both], 0.9) < 0.005


def test_bad_arguments():
    thing = ibr.DepthMesh(view_of(np.full((250, 331), 2.0)))
    for count in (0, -3, 1.5, "many"):
        assert refused("count", thing.simplify, count=count)
    assert "neither" in refused("max_error", thing.simplify)
