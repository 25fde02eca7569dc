"""Parts of depth objects that are one sample thin, compared with true pictures of their models."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import MeshScene, object_views
from pyibr.core.camera import Camera
from tests.boxes import cuboid
from tests.one_lane import one_lane
from tests.slicing.solids import revolved

cv2 = pytest.importorskip("cv2")

SIZE = 96
SAMPLE = 2.08 / SIZE  # width of a sample in views of a scene of size 2
ON = 0.5 * SAMPLE  # coordinate of the sample centres beside the views' axes


def rod(start, end, width: float = SAMPLE) -> tuple[np.ndarray, np.ndarray]:
    """A round rod between two points."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    length = np.linalg.norm(end - start)
    vertices, faces = revolved([(0, 0), (width / 2, 0), (width / 2, length), (0, length)], closed=False, sides=24)
    along = (end - start) / length
    across = np.cross(along, np.eye(3)[np.abs(along).argmin()])
    across /= np.linalg.norm(across)
    return start + vertices @ np.stack([across, along, np.cross(across, along)]), faces


def block(low, high, turn: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    corners, faces = cuboid(low, high)
    return corners if turn is None else corners @ turn.T, faces


def scene_of(part: tuple[np.ndarray, np.ndarray]) -> MeshScene:
    """The part in orange, and two grey blocks that give all scenes the size 2."""
    parts = (part, block((-1, -1, -1), (-0.8, -0.8, -0.8)), block((0.8, 0.8, 0.8), (1, 1, 1)))
    vertices, faces, count = [], [], 0
    for points, triangles in parts:
        vertices.append(points)
        faces.append(triangles + count)
        count += len(points)
    colors = np.full((count, 3), 120, np.uint8)
    colors[: count - 16] = 230, 120, 20
    return MeshScene(np.concatenate(vertices), np.concatenate(faces), colors=colors)


ASKEW, _ = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))
CASES = {  # a part, and the least fraction of it that is covered, with `thin` and without
    "along x": (rod((-0.7, ON, ON), (0.7, ON, ON)), 0.98, 0.8),
    "along y": (rod((ON, -0.7, 5 * ON), (ON, 0.7, 5 * ON)), 0.98, 0.8),
    "diagonal": (rod((-0.5, -0.5, ON), (0.5, 0.5, ON)), 0.98, 0.9),
    # Each image shows outlines to half a sample, so that the intersection of all images is narrower than the part.
    "slanted": (rod((-0.6, -0.2, 0.1), (0.6, 0.25, -0.12)), 0.85, 0.6),
    "slanted more": (rod((-0.5, 0.3, 0.45), (0.5, -0.35, -0.4)), 0.9, 0.6),
    "a leaf": (block((-0.5, -0.4, 0), (0.5, 0.4, SAMPLE)), 0.93, 0.9),
    "a leaf askew": (block((-0.5, -0.4, 0), (0.5, 0.4, SAMPLE), ASKEW), 0.94, 0.94),
}
DIRECTIONS = ((1, 0.3, 0.2), (0.3, 1, 0.4), (0.5, 0.6, 1))


def near(direction, zoom: float) -> Camera:
    """A camera with `zoom` pixels per sample in the scene's middle."""
    eye = 2.2 * np.array(direction, float) / np.linalg.norm(direction)
    fov = 2 * np.degrees(np.arctan(0.5 * 120 * SAMPLE / zoom / 2.2))
    return Camera.look_at(eye, (0, 0, 0), (0.1, 0.2, 1), (160, 120), fov_y=fov)


def compared(frame: ibr.Frame, truth: ibr.DepthImage, zoom: float) -> tuple[float, float]:
    """Fraction of the part's pixels with a depth right to two samples, and how far pixels are drawn outside the scene.

    That distance is the largest one, in samples.
    """
    thing = truth.color[..., 0] > 180
    right = frame.valid & (np.abs(np.where(frame.valid, frame.depth, 0) - np.where(thing, truth.depth, 9)) < 2 * SAMPLE)
    away = cv2.distanceTransform((~(truth.depth < 1e9)).astype(np.uint8), cv2.DIST_L2, 5)
    return right[thing].mean(), max((away[frame.valid].max(initial=0) - 1) / zoom, 0)


FEW = [
    pytest.param(name, ("orthogonal", "screen")[number // 2 % 2], marks=pytest.mark.thorough if number % 2 else ())
    for number, name in enumerate(CASES)
]


@pytest.mark.parametrize(("name", "slicing"), FEW)
def test_wires_and_leaves_are_covered_and_little_more(name, slicing):
    part, least, plain_least = CASES[name]
    scene = scene_of(part)
    views = object_views(scene, SIZE)
    thick, plain = (ibr.DepthObject(views, slices=512, slicing=slicing, thin=thin) for thin in (True, False))
    for zoom in (2, 6):
        covered = []
        for direction in DIRECTIONS:
            camera = near(direction, zoom)
            truth = scene.capture(camera)
            share, beyond = compared(ibr.render(thick, camera), truth, zoom)
            assert beyond <= 0.5, (zoom, direction)
            covered.append((share, compared(ibr.render(plain, camera), truth, zoom)[0]))
        assert np.mean(covered, axis=0)[0] >= least, covered
        assert np.mean(covered, axis=0)[1] >= plain_least, covered
        # `thin` adds ribbons as wide as samples. They may reduce the covered share by rounding errors only.
        assert np.mean(covered, axis=0)[0] >= np.mean(covered, axis=0)[1] - 1e-3, covered


def test_images_of_perspective_cameras():
    """The rod is as wide as a perspective view's samples at its middle: 5/4 of an orthographic view's samples."""
    scene = scene_of(rod((-0.5, 0.3, 0.45), (0.5, -0.35, -0.4), 1.25 * SAMPLE))
    thing = ibr.DepthObject(object_views(scene, SIZE, projection="perspective"), slices=512, thin=True)
    for direction in DIRECTIONS:
        camera = near(direction, 4)
        share, beyond = compared(ibr.render(thing, camera), scene.capture(camera), 4 * 1.25)
        assert share >= 0.88
        assert beyond <= 0.5


@pytest.mark.thorough
def test_other_views_and_one_lane_draw_the_same():
    first, second = (object_views(scene_of(CASES[name][0]), SIZE) for name in ("slanted", "diagonal"))
    camera = near(DIRECTIONS[0], 4)
    new = ibr.render(ibr.DepthObject(second, slices=256, thin=True), camera)
    old = ibr.DepthObject(first, slices=256, thin=True)
    ibr.render(old, camera)
    other = ibr.render(old.with_views(second), camera)
    np.testing.assert_array_equal(new.depth, other.depth)
    np.testing.assert_array_equal(new.color, other.color)
    with one_lane():
        again = [ibr.DepthImage(view.color, view.depth, view.camera) for view in second]
        one = ibr.render(ibr.DepthObject(again, slices=256, thin=True), camera)
    assert new.valid.sum() > 500
    assert (one.valid != new.valid).mean() <= 2e-3  # rounding decides at borders
    both = one.valid & new.valid
    assert (np.abs(one.depth - new.depth)[both] < 0.1 * SAMPLE).mean() > 0.99


@pytest.mark.parametrize("wrong", [1, "yes", None])
def test_thin_is_true_or_false(wrong):
    views = object_views(scene_of(CASES["along x"][0]), SIZE)
    with pytest.raises(ibr.ArgumentError, match="thin: expected True or False"):
        ibr.DepthObject(views, thin=wrong)
