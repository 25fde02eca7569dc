"""With more images, a depth object is closer to the model, whose true pictures are made by ray casting."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import MeshScene, models
from pyibr.capture.raycast import spread_directions
from pyibr.core.camera import Camera
from pyibr.images.metrics import silhouette_iou
from tests.boxes import cuboid
from tests.slicing.solids import ball, knot, torus

cv2 = pytest.importorskip("cv2")

EYES = ((3, 2, 5), (4.5, -5.5, 6.5), (-1, 0.3, 0.2))
ASKEW, _ = np.linalg.qr(np.random.default_rng(7).normal(size=(3, 3)))


def block(thick: float) -> MeshScene:
    corners, faces = cuboid((-0.5, -0.5, -thick / 2), (0.5, 0.5, thick / 2))
    return MeshScene(corners @ ASKEW, faces)


def donut(sides: int, tube: float) -> MeshScene:
    mesh = models.donut(sides, tube=tube)
    return MeshScene(mesh.vertices, mesh.faces)


SCENES = {
    "ball": ball,
    "knot": knot,
    "torus": torus,
    "box": lambda: block(0.6),
    "plate": lambda: block(0.1),
    "facets": lambda: donut(25, 0.2),  # one and a half samples of 96 wide
    "donut": lambda: donut(25, 0.4),
    "smooth": lambda: donut(96, 0.2),
}
# Least overlap with 12 or 30 images. 256 slices miss small parts at sharp edges.
CLOSE = {"ball": 0.999, "knot": 0.994, "torus": 0.998, "box": 0.995, "plate": 0.99}


@cache
def scene_of(name: str) -> MeshScene:
    return SCENES[name]()


def around(scene: MeshScene) -> tuple[np.ndarray, float]:
    """Middle of a scene, and the largest distance of a vertex from the middle."""
    middle = 0.5 * (scene.vertices.min(axis=0) + scene.vertices.max(axis=0))
    return middle, float(np.linalg.norm(scene.vertices - middle, axis=1).max())


def views_of(name: str, count: int, size: tuple[int, int], projection: str = "perspective") -> list[ibr.DepthImage]:
    scene = scene_of(name)
    middle, radius = around(scene)
    how = {"fov_y": 21.0} if projection == "perspective" else {"projection": projection, "height": 2.1 * radius}
    cameras = (
        Camera.look_at(middle - 5.7 * radius * way, middle, np.eye(3)[np.abs(way).argmin()], size, **how)
        for way in spread_directions(count)
    )
    return [scene.capture(camera) for camera in cameras]


def pictures(name: str, thing: ibr.DepthObject, pixels: int = 200) -> Iterator[tuple[ibr.DepthImage, ibr.Frame]]:
    """The true picture and the object's, from three sides."""
    scene = scene_of(name)
    middle, radius = around(scene)
    for eye in EYES:
        eye = middle + 6 * radius * np.array(eye) / np.linalg.norm(eye)
        camera = Camera.look_at(eye, middle, (0, 0, 1), (pixels, pixels), fov_y=20)
        yield scene.capture(camera), ibr.render(thing, camera)


def compared(name: str, thing: ibr.DepthObject, size: int) -> tuple[float, float, int]:
    """Least IoU of silhouettes, mean error of depth in samples, and number of holes inside the true silhouette."""
    radius, overlaps, off, holes = around(scene_of(name))[1], [], [], 0
    for truth, frame in pictures(name, thing):
        overlaps.append(silhouette_iou(frame.valid, truth.valid))
        both = frame.valid & truth.valid
        off.append(np.abs(frame.depth - truth.depth)[both].mean() / (2 * radius / size))
        # Outlines may be off by a sample. The mask of pixels that must be covered is eroded by more than that.
        inner = cv2.erode(truth.valid.astype(np.uint8), np.ones((3, 3)), iterations=int(np.ceil(200 / size)))
        holes += int((inner.astype(bool) & ~frame.valid).sum())
    return min(overlaps), float(np.mean(off)), holes


RARE = [
    pytest.param(name, how, marks=pytest.mark.thorough)
    for name, how in [*((name, "perspective") for name in CLOSE if name != "box"), ("knot", "orthographic")]
]


@pytest.mark.parametrize(("name", "projection"), [("box", "perspective"), *RARE])
def test_more_images_are_closer(name, projection):
    found = {}
    for count in (6, 12, 30):
        thing = ibr.DepthObject(views_of(name, count, (128, 128), projection), slices=256)
        found[count] = compared(name, thing, 128)
        assert found[count][2] <= (1 if count == 6 else 0), found
    overlaps = [found[count][0] for count in found]
    # From 6 to 12 images, the overlap may fall by as much as slices are off.
    assert overlaps[1] > overlaps[0] - 5e-4 and overlaps[2] > overlaps[0], overlaps
    assert min(overlaps[1:]) >= CLOSE[name], overlaps
    assert found[30][1] <= 0.2, found  # samples: slices are 0.5 apart; points are up to a quarter of that behind


MANY = [pytest.param(name, marks=() if name == "facets" else pytest.mark.thorough) for name in SCENES]


@pytest.mark.parametrize("name", MANY)
def test_a_hundred_images_are_as_close_as_fewer(name):
    """No image cuts off creases between its samples, not even creases that are a sample and a half apart."""
    overlap = {}
    for count in (26, 50, 100):
        both = pictures(name, ibr.DepthObject(views_of(name, count, (96, 96))), 400)
        overlap[count] = np.mean([silhouette_iou(frame.valid, truth.valid) for truth, frame in both])
    # In the pictures an object is 190 to 380 pixels wide: 5e-4 of its area are some 20 pixels.
    assert overlap[100] >= max(overlap.values()) - 5e-4, overlap


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "size"), [("ball", (131, 97)), ("knot", (64, 64)), ("box", (64, 64))])
def test_a_hundred_images(name, size):
    """However many images there are, none cuts off details between its samples; the knot is eight samples thick."""
    few, many = (compared(name, ibr.DepthObject(views_of(name, n, size), slices=256), min(size)) for n in (6, 120))
    assert many[0] >= 0.99 and many[0] > few[0], (few, many)
    assert many[2] == 0


def test_planes_are_as_they_were_sampled():
    """The rule for creases changes no plane, in any orientation: the samples define it exactly."""
    camera = Camera([[60, 0, 20], [0, 60, 15], [0, 0, 1]], (41, 31))
    y, x = np.mgrid[:31, :41]
    for slope in ((0.0, 0.0), (0.3, -0.2), (-0.6, 0.4)):
        ray = (x - 20) / 60 * slope[0] + (y - 15) / 60 * slope[1]
        depth = (4 / (1 - ray)).astype(np.float32)
        thing = ibr.DepthObject(
            [ibr.DepthImage(np.full((31, 41, 3), 90, np.uint8), depth, camera)], slices=64, halvings=12
        )
        target = camera.resized((82, 62))
        v, u = np.mgrid[:62, :82]
        exact = 4 / (1 - ((u - 40.5) / 120 * slope[0] + (v - 30.5) / 120 * slope[1]))
        inner = (slice(3, -3), slice(3, -3))
        np.testing.assert_allclose(ibr.render(thing, target).depth[inner], exact[inner], rtol=2e-5)
