"""Scenes far from the world's origin, and cameras far from their scenes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import ArrayLike

pytest.importorskip("open3d")

import pyibr as ibr
from pyibr.capture import models
from pyibr.core.camera import Camera
from pyibr.images.metrics import silhouette_iou
from tests.displaced import square
from tests.slicing.solids import looking, torus, views_of_torus

PROJECTIONS = ["perspective", "orthographic"]
AWAY = np.array([100_000.0, -70_000, 50_000])  # there, float32's steps are 1/128
STEP = 1 / 128


def moved(camera: Camera, off: ArrayLike = AWAY) -> Camera:
    """The camera, and so the scene, moved by `off` in the world."""
    pose = camera.world_from_camera.copy()
    pose[:3, 3] += off
    return Camera(camera.K, camera.size, pose, projection=camera.projection)


def moved_view(view: ibr.DepthImage, off: ArrayLike = AWAY) -> ibr.DepthImage:
    return ibr.DepthImage(view.color, view.depth, moved(view.camera, off))


def over_donut(projection: str) -> Camera:
    how = {"fov_y": 45.0} if projection == "perspective" else {"projection": projection, "height": 3.2}
    return Camera.look_at((1.5, -2, 2.5), (0, 0, 0), (0, 0, 1), (160, 120), **how)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_the_warp_is_the_same_anywhere(projection):
    view = views_of_torus(projection)[0]
    target = view.camera.moved(0.2, 0.1, 0)
    here, there = ibr.warp(view, target), ibr.warp(moved_view(view), moved(target))
    np.testing.assert_array_equal(here.valid, there.valid)
    np.testing.assert_allclose(here.depth, there.depth, rtol=1e-6)  # the matrices are rounded


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
@pytest.mark.parametrize("make", [ibr.DepthObject, ibr.VisualHull])
def test_objects_are_the_same_anywhere(make, slicing, projection):
    views, camera = views_of_torus("nine, anywhere"), looking(torus(), (0.5, 0.4, 1), (100, 80), projection)
    here = ibr.render(make(views, slices=96, slicing=slicing), camera)
    there = ibr.render(make([moved_view(view) for view in views], slices=96, slicing=slicing), moved(camera))
    # The box differs by 1e-11, so a slice that barely passes in one picture may not in the other.
    assert (here.valid != there.valid).mean() <= 1e-3
    both = here.valid & there.valid
    assert np.isclose(here.depth, there.depth, rtol=1e-6)[both].mean() >= 0.999


def donuts(off: np.ndarray) -> tuple[ibr.Mesh, ibr.Mesh]:
    """A donut near the origin and one at `off`, both with vertices that float32 represents exactly."""
    base = models.donut()
    corners = np.rint(base.vertices.astype(np.float64) / STEP) * STEP
    here, there = (ibr.Mesh(corners + by, base.faces, uv=base.uv, normals=base.normals) for by in (0, off))
    np.testing.assert_array_equal(there.vertices.astype(np.float64) - off, corners)
    return here, there


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_a_mesh_is_where_its_vertices_are(projection):
    """A mesh is drawn far away as near the origin, if float32 represents its vertices exactly at both places."""
    camera, (mesh, far_mesh) = over_donut(projection), donuts(AWAY)
    here, there = ibr.render(mesh, camera), ibr.render(far_mesh, moved(camera))
    assert (here.valid != there.valid).mean() <= 1e-4
    both = here.valid & there.valid
    np.testing.assert_allclose(here.depth[both], there.depth[both], rtol=1e-5)


def test_the_rounding_of_vertices_is_as_stated():
    """The error is the one in docs/conventions.md: along each axis, a 16 millionth of the distance to the origin."""
    slope = ibr.Mesh([[-2, -2, 2.3], [2.1, -2, 2.9], [2, 2.2, 3.1], [-2, 2, 2.7]], [[0, 2, 1], [0, 3, 2]])
    there = ibr.Mesh(slope.vertices + AWAY, slope.faces)
    camera = Camera([[40, 0, 40], [0, 40, 30], [0, 0, 1]], (81, 61))
    off = np.abs(ibr.render(there, moved(camera)).depth - ibr.render(slope, camera).depth)
    rounding = np.abs(AWAY) / 2**24
    assert 0.1 * rounding[2] < np.nanmax(off)  # and it is not much less
    # Slopes of up to 1/4 turn sideways errors into depth errors; rays are at most 45 degrees off the axis.
    assert np.nanmax(off) <= 2 * (rounding[2] + 0.25 * (rounding[0] + rounding[1]))


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("slicing", ["surface", "orthogonal", "screen"])
def test_slices_of_a_surface_far_away(slicing, projection):
    """With constant heights, only the displaced vertices are rounded, not the slices."""
    height, color = np.full((4, 4), 0.999, np.float32), np.full((1, 1, 3), 200, np.uint8)
    camera = over_donut(projection)
    here, there = (
        ibr.render(ibr.SlicedSurface(mesh, height, color, 0.2, tiles=(8, 4), slices=40, slicing=slicing), seen)
        for mesh, seen in zip(donuts(AWAY), (camera, moved(camera)), strict=True)
    )
    assert silhouette_iou(here.valid, there.valid) >= 0.98  # STEP is half a pixel here
    both = here.valid & there.valid
    # Vertices are off by half a step; where rays meet the donut obliquely, depths by up to a slice.
    assert np.median(np.abs(here.depth - there.depth)[both]) <= max(STEP, 0.2 / 40)


def from_afar(camera: Camera, away: float) -> Camera:
    """A perspective camera at distance `away`, so far that its picture equals the orthographic `camera`'s."""
    K = camera.K * [[away, 0, 1], [0, away, 1], [0, 0, 1]]
    pose = camera.world_from_camera.copy()
    pose[:3, 3] -= away * camera.forward
    return Camera(K, camera.size, pose)


@pytest.mark.parametrize("slicing", ["surface", "orthogonal", "screen"])
def test_a_surface_from_afar(slicing):
    """From afar, float32 gives neighbouring slices the same depth."""
    height = np.random.default_rng(0).random((8, 8), np.float32)
    thing = ibr.SlicedSurface(square(), height, np.zeros((2, 2, 3), np.uint8), 0.05, slices=256, slicing=slicing)
    how = {"projection": "orthographic", "height": 1.3}
    flat = Camera.look_at((0.9, 0.2, 1), (0.5, 0.5, 0), (0, 0, 1), (80, 60), **how)
    near, far, farthest = (ibr.render(thing, cam) for cam in (flat, from_afar(flat, 1e4), from_afar(flat, 1e6)))
    assert near.valid.sum() > 500
    assert silhouette_iou(near.valid, far.valid) >= 0.95  # depths of 10,000 have steps of 1/1024, a 50th of the height
    assert np.isfinite(farthest.depth[farthest.valid]).all()  # steps of 1/16 exceed the surface's height


@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_an_object_from_afar(slicing):
    thing = ibr.DepthObject(views_of_torus("orthographic"), slices=1024, slicing=slicing)
    flat = looking(torus(), (0.5, 0.4, 1), (80, 60), "orthographic")
    near, far = ibr.render(thing, flat), ibr.render(thing, from_afar(flat, 1e5))
    assert silhouette_iou(near.valid, far.valid) >= 0.98


@pytest.mark.thorough
@pytest.mark.parametrize("light", ["sun", "lamp"])
@pytest.mark.parametrize("make", [ibr.DepthObject, ibr.DepthMeshObject])
def test_shadows_on_images_are_the_same_anywhere(make, light):
    """Things made of images have no vertices, so float32 rounds none."""
    views = views_of_torus("perspective")
    camera = looking(torus(), (0.5, 0.4, 1), (100, 80), "perspective")
    position = np.array([4.0, 3, 2])
    frames: list[ibr.Frame] = []
    for off in (np.zeros(3), AWAY, 10 * AWAY):
        there = [moved_view(view, off) for view in views]
        lamp = ibr.Light(position=position + off) if light == "lamp" else ibr.Light(direction=-position)
        frames.append(ibr.render(make(there), moved(camera, off), lamp))
    plain = ibr.render(make(views), camera)
    dark = (plain.color.astype(int) - frames[0].color).max(axis=-1) > 20
    assert 0.02 < dark[plain.valid].mean() < 0.95
    for frame in frames[1:]:
        both = frame.valid & frames[0].valid
        assert (frame.valid != frames[0].valid).mean() <= 1e-3
        differs = np.abs(frame.color.astype(int) - frames[0].color).max(axis=-1)[both]
        # On the shadow's edge, rounding decides whether a pixel is lit.
        assert (differs > 2).mean() <= 0.01
