"""Noisy depth meshes: noise splits few triangles, and surfaces stay in place."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import models, object_views
from pyibr.core.camera import Camera
from tests.data import shared

SIZE = (331, 250)
CAMERA = Camera([[300, 0, 165], [0, 300, 125], [0, 0, 1]], SIZE)
NOISE = {"stereo": (0.0008, 0, 0), "time of flight": (0, 0.002, 0.003), "slight": (0.0003, 0, 0)}


def corner_of_a_room() -> np.ndarray:
    """(H, W) depth of two walls and a floor, with a ball in front of them."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    ray = np.stack([(x - 165) / 300, (y - 125) / 300, np.ones(x.shape)], -1)
    planes = [((0, 0, 1), 4.0), ((0, 1, 0), 1.1), ((1, 0, 0.5), 2.6)]
    with np.errstate(divide="ignore"):
        far = [np.where(ray @ n > 0, d / (ray @ n), np.inf) for n, d in planes]
    depth = np.min(far, axis=0)
    center, radius = np.array([-0.4, 0.4, 2.6]), 0.6
    along, squared = ray @ center, (ray**2).sum(-1)
    inside = along**2 - squared * (center @ center - radius**2)
    ball = (along - np.sqrt(np.maximum(inside, 0))) / squared
    return np.where(inside > 0, np.minimum(ball, depth), depth)


def view_of(depth: np.ndarray, **options: object) -> ibr.DepthImage:
    color = np.zeros((*depth.shape, 3), np.uint8)
    camera = CAMERA if depth.shape == SIZE[::-1] else Camera([[525, 0, 319.5], [0, 525, 239.5], [0, 0, 1]], (640, 480))
    return ibr.DepthImage(color, depth.astype(np.float32), camera, **options)


def off_by(thing: ibr.DepthMesh, clean: np.ndarray, deviation: np.ndarray) -> tuple[int, np.ndarray]:
    """Number of triangles for a tolerance of 1 pixel, and each pixel's depth error as a fraction of the allowed one.

    Allowed are 1 pixel and two standard deviations of the noise.
    """
    camera = thing.view.camera
    mesh = thing.triangulate(camera, tolerance=1)
    frame = ibr.render(mesh, camera)
    seen = frame.valid & (clean > 0)
    allowed = clean / camera.K[0, 0] + 2 * deviation
    return len(mesh.faces), (np.abs(frame.depth - clean) / allowed)[seen]


@pytest.mark.parametrize("kind", NOISE)
@pytest.mark.parametrize("known", [False, True])
def test_noise_takes_few_triangles(kind, known):
    clean = corner_of_a_room()
    deviation = np.polyval(NOISE[kind], clean)
    noisy = clean + np.random.default_rng(3).normal(0, 1, clean.shape) * deviation
    count, _ = off_by(ibr.DepthMesh(view_of(clean)), clean, deviation)
    options = {"noise": NOISE[kind]} if known else {}
    found, off = off_by(ibr.DepthMesh(view_of(noisy, **options)), clean, deviation)
    unknowing, _ = off_by(ibr.DepthMesh(view_of(noisy, noise=0)), clean, deviation)
    assert found < 1.7 * count
    assert found < 0.2 * unknowing or kind == "slight"
    # 95 % of normal noise is within two deviations; the tolerance of 1 pixel allows more.
    assert (off < 1).mean() > 0.98
    assert (off < 2).mean() > 0.998


def test_a_noisy_room():
    """A simulated RGB-D camera; for comparison, clean depth takes 37,000 triangles, and noise=0 takes 260,000."""
    folder = shared("rgbd_livingroom1")
    clean, noisy = (
        cv2.imread(str(folder / name / "00000.png"), cv2.IMREAD_UNCHANGED) / 1000 for name in ("depth", "depth_noisy")
    )
    view = view_of(noisy)
    mesh = ibr.DepthMesh(view)
    # The true noise is larger than the estimate, so that the allowed error holds for only 77 % of the samples. It holds
    # for more of the mesh.
    found = np.polyval(view.noise, clean)
    _, off = off_by(mesh, clean, found)
    samples = (np.abs(view.depth - clean) / (clean / 525 + 2 * found))[view.valid & (clean > 0)]
    assert (off < 1).mean() > (samples < 1).mean() > 0.77  # the estimate is half a step of the depth's scale
    # Neighbouring samples share most of this noise, so that differences show half of it. The true deviation at each
    # depth is the error that 68 % of the samples stay below.
    wrong, known, shell = np.abs(view.depth - clean), view.valid & (clean > 0), (clean / 0.5).astype(int)
    deviation = np.ones_like(clean)
    for number in np.unique(shell[known]):
        deviation[shell == number] = np.quantile(wrong[known & (shell == number)], 0.68)
    count, off = off_by(mesh, clean, deviation)
    assert count < 60_000
    assert (off < 1).mean() > 0.95  # like normal noise within two deviations


def test_shapes_are_no_noise():
    """Curved surfaces are not taken for noise, since their second differences grow with the distance of samples."""
    for depth in (corner_of_a_room(), 4 + 0.3 * np.sin(np.arange(SIZE[0]) / 3) + np.zeros(SIZE[::-1])):
        view, sure = view_of(depth), view_of(depth, noise=0)
        assert not any(view.noise)
        for tolerance in (0.3, 1):
            counts = [
                len(ibr.DepthMesh(each).triangulate(view.camera, tolerance=tolerance).faces) for each in (view, sure)
            ]
            assert counts[0] == counts[1]
    for view in object_views(models.donut(), 128):
        assert not any(view.noise)


def test_all_samples_are_vertices_of_noisy_views_too():
    """Vertices lie on the samples as given, not denoised, and at tolerance 0 all samples are vertices."""
    noisy = corner_of_a_room()
    noisy += np.random.default_rng(3).normal(0, 0.01, noisy.shape)
    view = view_of(noisy)
    mesh = ibr.DepthMesh(view).triangulate(view.camera, tolerance=0)
    within = (np.abs(mesh.uv - 0.5) < 0.49).all(axis=1)
    x, y = np.rint(mesh.uv[within] * SIZE - 0.5).astype(int).T
    np.testing.assert_allclose(mesh.vertices[within, 2], view.depth[y, x], rtol=2**-22)
    assert len(mesh.faces) > 0.9 * 2 * noisy.size
