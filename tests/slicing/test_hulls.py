"""Visual hulls of real silhouettes: photographs of a dinosaur, renderings of a clock."""

from __future__ import annotations

import json
from functools import cache

import cv2
import imageio.v3 as iio
import numpy as np
import pytest

import pyibr as ibr
from pyibr.camera import Camera
from tests.data import shared

SLICES = 256
GIVEN, LEFT_OUT = 0.975, 0.95  # intersection over union of the hull's outline and the silhouette, on the mean


@cache
def clock() -> list[ibr.Silhouette]:
    folder = shared("multiview/kaolin_clock")
    views = []
    for file in sorted(folder.glob("*_metadata.json")):
        number = file.name.split("_")[0]
        told = json.loads(file.read_text())["camera_properties"]
        mask = iio.imread(folder / f"{number}_mask.png")
        mask = (mask[..., :3].max(axis=2) if mask.ndim == 3 else mask) > 127
        color = iio.imread(folder / f"{number}_rgb.png")[..., :3]
        size = mask.shape[1], mask.shape[0]
        focal = told["focal_length"] / told["horizontal_aperture"] * size[0]
        # World to camera for row vectors; the camera looks along -z, y up.
        pose = np.linalg.inv(np.array(told["tf_mat"]).T) @ np.diag([1, -1, -1, 1])
        K = [[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]]
        views.append(ibr.Silhouette(np.ascontiguousarray(color), mask, Camera(K, size, pose)))
    return views


@cache
def dino() -> list[ibr.Silhouette]:
    folder = shared("multiview/middlebury_dino")
    views = []
    for line in next(folder.glob("*par.txt")).read_text().splitlines()[1:]:
        name, *values = line.split()
        K, R, t = np.split(np.array(values, float), [9, 18])
        color = iio.imread(folder / name)
        # Their makers' recipe
        mask = (color.max(axis=2) > 0.19 * 255).astype(np.uint8)
        mask = cv2.erode(cv2.dilate(mask, disk(10)), disk(7)).astype(bool)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = R.reshape(3, 3).T, -R.reshape(3, 3).T @ t
        views.append(ibr.Silhouette(color, mask, Camera(K.reshape(3, 3), (color.shape[1], color.shape[0]), pose)))
    return views


def disk(radius: int) -> np.ndarray:
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    return (x * x + y * y <= radius * radius).astype(np.uint8)


def overlap(hull: ibr.VisualHull, view: ibr.Silhouette) -> float:
    seen = ibr.render(hull, view.camera).valid
    return float((seen & view.valid).sum() / (seen | view.valid).sum())


@pytest.mark.parametrize("views", [clock, dino], ids=["clock", "dino"])
def test_the_outline_of_the_hull_is_the_silhouette(views):
    hull = ibr.VisualHull(views(), SLICES)
    assert np.mean([overlap(hull, view) for view in views()]) >= GIVEN


@pytest.mark.parametrize("views", [clock, dino], ids=["clock", "dino"])
def test_a_view_left_out(views):
    every = views()
    scores = []
    for out in range(0, len(every), 4):
        hull = ibr.VisualHull(every[:out] + every[out + 1 :], SLICES)
        scores.append(overlap(hull, every[out]))
    assert np.mean(scores) >= LEFT_OUT


def test_bad_input():
    camera = Camera([[50, 0, 10], [0, 50, 10], [0, 0, 1]], (21, 21))
    color, mask = np.zeros((21, 21, 3), np.uint8), np.zeros((21, 21), bool)
    with pytest.raises(ibr.ArgumentError, match=r"^mask: "):
        ibr.Silhouette(color, mask, camera)
    mask[5:15, 5:15] = True
    for changes, argument in (
        ({"mask": mask.astype(np.uint8)}, "mask"),
        ({"mask": mask[:5]}, "mask"),
        ({"color": color[:5]}, "color"),
        ({"color": mask}, "color"),
        ({"camera": 3}, "camera"),
    ):
        with pytest.raises(ibr.ArgumentError, match=f"^{argument}: "):
            ibr.Silhouette(**{"color": color, "mask": mask, "camera": camera, **changes})
    one = ibr.Silhouette(color, mask, camera)
    away = ibr.Silhouette(color, mask, Camera.look_at((50, 0, 0), (100, 0, 0), (0, 1, 0), (21, 21), fov_y=30))
    for bad in ([], one, [3], [one, away]):
        with pytest.raises(ibr.ArgumentError, match=r"^views: "):
            ibr.VisualHull(bad)
