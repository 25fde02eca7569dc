"""Normals of depth images: as given, and as estimated from depths."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera, Projection
from pyibr.picture.normals import _radius, normals_of
from tests.reference.normals import fitted_normals

PROJECTIONS: tuple[Projection, ...] = ("perspective", "orthographic")


def camera_of(size: tuple[int, int], projection: Projection) -> Camera:
    f = 1.1 * size[0] if projection == "perspective" else size[0] / 3
    K = [[f, 0.3, size[0] / 2 - 0.3], [0, 1.2 * f, size[1] / 2 + 0.4], [0, 0, 1]]
    return Camera(K, size, projection=projection)


def plane_depth(camera: Camera, normal: np.ndarray, offset: float) -> np.ndarray:
    """(H, W) float32 depth of the plane of points p with normal.p = offset, in the camera's frame."""
    y, x = np.mgrid[: camera.height, : camera.width]
    ray = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(camera.K).T
    if camera.projection == "perspective":
        return (offset / (ray @ normal)).astype(np.float32)
    return ((offset - ray[..., :2] @ normal[:2]) / normal[2]).astype(np.float32)


def degrees(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    across = np.linalg.norm(np.cross(one, other), axis=-1)
    return np.degrees(np.arctan2(across, (one * other).sum(axis=-1)))


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("size", [(1, 1), (1, 5), (7, 1), (2, 2), (13, 7), (37, 29)])
@pytest.mark.usefixtures("lanes")
def test_they_are_those_of_the_reference(size, projection):
    """Estimates equal the reference for rough depths with holes and steps."""
    rng, camera = np.random.default_rng(3), camera_of(size, projection)
    y, x = np.mgrid[: size[1], : size[0]]
    depth = 3 + 0.3 * np.sin(x / 3) + 0.002 * x * y + np.where(x > size[0] // 2, 1.5, 0) + rng.normal(0, 2e-3, x.shape)
    depth[rng.random(depth.shape) < 0.2] = np.nan
    depth.flat[0] = 3
    view = ibr.DepthImage(None, depth.astype(np.float32), camera)
    found = normals_of(view)
    expected = fitted_normals(view, _radius(view))
    assert np.isfinite(found).all()
    # REGULARIZATION reduces slopes by 1e-4 (1 + k), where k is the ratio of the spreads of samples along two axes: for
    # k = 30, by 0.1 degrees.
    assert degrees(found, expected)[view.valid].max() < 0.1


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_of_planes_they_are_exact_up_to_their_edges(projection):
    """A slanted board stands before a slanted wall; no normal is estimated from samples of both."""
    camera = camera_of((61, 47), projection)
    front, back = np.array([0.3, -0.2, -0.9]), np.array([-0.4, 0.1, -0.8])
    front, back = front / np.linalg.norm(front), back / np.linalg.norm(back)
    y, x = np.mgrid[:47, :61]
    on_board = (abs(x - 30) < 12) & (abs(y - 20) < 9)
    depth = np.where(on_board, plane_depth(camera, front, -2.0), plane_depth(camera, back, -4.0))
    found = normals_of(ibr.DepthImage(None, depth, camera))
    expected = np.where(on_board[..., None], front, back)
    # REGULARIZATION reduces slopes by 1e-4 (1 + k), and k is 3 in a corner; an angle changes by at most half of the
    # slope's change, 4e-4. float32 adds 1e-5.
    assert degrees(found, expected).max() < np.degrees(2.2e-4)


@pytest.mark.parametrize("noise", [3e-4, 1e-3, 5e-3])
def test_noise_is_fitted_away(noise):
    """The radius of the fit is chosen so that noise gives slopes a standard deviation of at most 0.1."""
    rng, camera = np.random.default_rng(0), Camera([[300, 0, 80], [0, 300, 60], [0, 0, 1]], (161, 121))
    clean = plane_depth(camera, np.array([0.0, 0.0, -1.0]), -2.0)
    view = ibr.DepthImage(None, (clean * (1 + noise * rng.normal(size=clean.shape))).astype(np.float32), camera)
    off = degrees(normals_of(view), np.array([0, 0, -1.0]))[8:-8, 8:-8]
    # sqrt(2): slopes along x and y; 0.74: at constant depth, only 0.74 of the noise is found (`DepthImage.noise`)
    assert np.sqrt((off**2).mean()) < np.degrees(0.1 * np.sqrt(2)) / 0.74


def test_given_ones_stay_and_unknown_ones_come_from_the_depths():
    camera = camera_of((13, 9), "perspective")
    slanted, straight = np.array([0.6, 0, -0.8], np.float32), np.array([0, 0, -1.0])
    normals = np.broadcast_to(slanted, (9, 13, 3)).copy()
    normals[2:4] *= 7  # lengths are ignored
    normals[5, 5], normals[6, 6], normals[7, 7] = np.nan, 0, np.inf
    view = ibr.DepthImage(None, np.full((9, 13), 2, np.float32), camera, normals=normals)
    unknown = np.zeros((9, 13), bool)
    unknown[[5, 6, 7], [5, 6, 7]] = True
    np.testing.assert_array_equal(np.isnan(view.normals).all(axis=-1), unknown)
    found = normals_of(view)
    np.testing.assert_allclose(found[~unknown], np.broadcast_to(slanted, (114, 3)), atol=1e-6)
    np.testing.assert_allclose(found[unknown], np.broadcast_to(straight, (3, 3)), atol=1e-5)
    again = pickle.loads(pickle.dumps(view))
    assert again.normals.tobytes() == view.normals.tobytes()
    assert view.in_color.normals is not None
    assert view.in_float.normals is not None


def test_a_lens_bends_normals_as_it_bends_colours():
    """Normals vary across the image; undistorting it moves each normal with its point."""
    lens = ibr.Lens("brown_conrady", [-0.3, 0.05, 0, 0])
    camera = Camera([[50, 0, 30], [0, 50, 18], [0, 0, 1]], (61, 37), lens=lens)
    y, x = np.mgrid[:37, :61]
    ray = camera.unproject(np.stack([x, y], -1).reshape(-1, 2), np.ones(x.size)).reshape(37, 61, 3)
    normals = np.stack([0.5 * ray[..., 0], 0.5 * ray[..., 1], -np.ones((37, 61))], axis=-1).astype(np.float32)
    view = ibr.undistorted(ibr.DepthImage(None, np.full((37, 61), 2, np.float32), camera, normals=normals))
    y, x = np.mgrid[: view.camera.height, : view.camera.width]
    ray = view.camera.unproject(np.stack([x, y], -1).reshape(-1, 2), np.ones(x.size)).reshape(*x.shape, 3)
    expected = np.stack([0.5 * ray[..., 0], 0.5 * ray[..., 1], -np.ones(x.shape)], axis=-1)
    place = camera.project(ray.reshape(-1, 3) + camera.center)[0].reshape(*x.shape, 2)
    amid = (place >= 0).all(axis=-1) & (place <= (60, 36)).all(axis=-1)  # outside, nothing is interpolated
    assert amid.sum() > 2000
    unit = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    bend = sum(np.linalg.norm(np.diff(unit, 2, axis=axis), axis=-1).max() for axis in (0, 1))
    assert np.radians(degrees(view.normals, expected)[amid].max()) < bend / 2  # error of linear interpolation


@pytest.mark.parametrize(
    ("normals", "words"),
    [
        (np.zeros((9, 13), np.float32), "float32 of shape"),
        (np.zeros((9, 13, 3), np.uint8), "float32 of shape"),
        (np.broadcast_to(np.float32([0, 0, 1]), (9, 13, 3)), "point away"),
        ("up", "float32 of shape"),
    ],
)
def test_what_are_no_normals(normals, words):
    camera = camera_of((13, 9), "perspective")
    with pytest.raises(ibr.ArgumentError, match=words):
        ibr.DepthImage(None, np.full((9, 13), 2, np.float32), camera, normals=normals)
