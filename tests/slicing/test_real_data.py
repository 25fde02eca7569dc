"""Sliced surfaces of real height maps, and depth objects of real scans and of scanned or modelled meshes."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import cv2
import numpy as np
import pytest
from PIL import Image

import pyibr as ibr
from pyibr.capture import MeshScene, object_views
from pyibr.capture.scans import scan_view
from pyibr.core.camera import Camera
from pyibr.images.metrics import silhouette_iou
from pyibr.io import read_range_grid
from tests.data import shared
from tests.displaced import Solid, looking, square

pytestmark = pytest.mark.thorough

SCALE = 0.06
SIDE = 256  # texels to which the height maps of 1024 x 1024 are reduced


@cache
def ogre(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Colour and height of a real material, at a quarter of its resolution."""
    folder = shared("heightfields/ogre_terrain_cc0")
    color = Image.open(folder / f"{name}_diffspec.dds").convert("RGB").resize((SIDE, SIDE), Image.Resampling.BOX)
    height = Image.open(folder / f"{name}_normheight.dds").getchannel("A").resize((SIDE, SIDE), Image.Resampling.BOX)
    return np.asarray(color), np.asarray(height)


@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
@pytest.mark.parametrize("elevation", [60, 15])
@pytest.mark.parametrize("name", ["Bricks076C", "Rock20"])
def test_real_height_maps(name, elevation, slicing):
    color, height = ogre(name)
    camera = looking(elevation, 30, SCALE, (200, 150))
    truth = Solid(height / np.float32(255), SCALE, 2).depth(camera)
    frame = ibr.render(ibr.SlicedSurface(square(), height, color, SCALE, slices=128, slicing=slicing), camera)
    solid = np.isfinite(truth)
    assert silhouette_iou(frame.valid, solid) >= 0.99
    assert frame.valid[cv2.erode(solid.astype(np.uint8), np.ones((7, 7))) > 0].all()
    off = np.abs(frame.depth - truth)[frame.valid & solid]
    assert np.median(off) <= SCALE / 128
    # At the many edges of bricks and pebbles, a pixel may show what the neighbouring ray should hit.
    assert np.quantile(off, 0.9) <= 2 * SCALE / 128


def scans() -> list[ibr.DepthImage]:
    """The six scans that show the bunny from its six sides; others show parts of it."""
    folder = shared("range_scans_bunny")
    views = []
    for line in (folder / "bun.conf").read_text().splitlines():
        words = line.split()
        if words[:1] != ["bmesh"] or not words[1].startswith("bun"):
            continue
        x, y, z, w = np.array(words[5:9], float) / np.linalg.norm(np.array(words[5:9], float))
        rotation = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation.T, np.array(words[2:5], float)
        views.append(scan_view(read_range_grid(folder / f"{words[1]}.gz"), pose))
    return views


def bunnies() -> Iterator[ibr.DepthImage]:
    """Yield true pictures of the mesh that was made of the bunny's scans, from three directions."""
    scene = MeshScene.from_mesh(ibr.Mesh.load(shared("meshes/bun_zipper.ply.gz")))
    middle = 0.5 * (scene.vertices.min(axis=0) + scene.vertices.max(axis=0))
    for direction in ((0.3, 0.4, 1), (1, 0.3, -0.3), (-0.6, 0.2, -1)):
        away = 0.45 * np.array(direction) / np.linalg.norm(direction)
        yield scene.capture(Camera.look_at(middle + away, middle, (0, 1, 0), (300, 260), fov_y=26))


def test_the_bunny_from_six_real_scans():
    views = scans()
    assert len(views) == 6
    unknown, background = (ibr.DepthObject(views, slices=256, missing=missing) for missing in ("unknown", "empty"))
    errors = {}
    for truth in bunnies():
        for thing in (unknown, background):
            frame = ibr.render(thing, truth.camera)
            # 0.93: no scan saw some parts around the ears and below.
            assert silhouette_iou(frame.valid, truth.valid) >= 0.93
            both = frame.valid & truth.valid
            errors.setdefault(thing.missing, []).append(np.median(np.abs(frame.depth - truth.depth)[both]))
    # Slices are 0.6 mm apart, and the scans themselves are 0.2 mm off the mesh.
    assert max(errors["unknown"]) <= 0.4e-3
    assert all(a < b for a, b in zip(errors["unknown"], errors["empty"], strict=True))


@pytest.mark.parametrize("name", ["bun_zipper.ply.gz", "human_male_makehuman.obj.gz", "spot/spot_triangulated.obj"])
def test_meshes_as_six_depth_images(name):
    mesh = ibr.Mesh.load(shared(f"meshes/{name}"))
    scene = MeshScene.from_mesh(mesh)
    thing = ibr.DepthObject(object_views(scene, 256), slices=256)
    low, high = mesh.bounds
    middle, extent = 0.5 * (low + high), np.linalg.norm(high - low)
    camera = Camera.look_at(middle + extent * np.array([0.5, 0.4, 1.0]), middle, (0, 1, 0), (200, 240), fov_y=50)
    truth, frame = scene.capture(camera), ibr.render(thing, camera)
    # Outlines are half a sample off, and a sample of the images is 1.3 pixels wide here.
    assert silhouette_iou(frame.valid, truth.valid) >= 0.95
    both = frame.valid & truth.valid
    assert np.median(np.abs(frame.depth - truth.depth)[both]) <= float(thing.box.edges.max()) / 256
