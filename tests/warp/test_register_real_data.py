"""Registration of frames of a real camera, an Asus Xtion, compared with librealsense's `align` on the same frames."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest

import pyibr as ibr
from tests import matlab
from tests.data import shared
from tests.reference.align import aligned

pytestmark = pytest.mark.thorough

FRAMES = (1, 4, 10)
ASIDE = ((4, 1), (4.5, 1.5), (5, 2))  # x and y of the depth image's corner in the infrared image: three guesses
ONE = 1.05  # ratio of depths up to which neighbours are one surface


def cameras(aside: tuple[float, float]) -> tuple[ibr.Camera, ibr.Camera]:
    """The depth camera and the colour camera, without lenses, as `align` takes them."""
    given = matlab.load(shared("formats") / "asus_xtion_unregistered" / "calib_asus.mat")
    color_from_depth = np.eye(4)
    color_from_depth[:3, :3], color_from_depth[:3, 3:] = given["R_d_to_rgb"], given["T_d_to_rgb"]
    K = given["Depth_cam"]["K"].copy()
    K[:2, 2] -= aside
    pose = np.linalg.inv(color_from_depth)
    return ibr.Camera(K, (640, 480)), ibr.Camera(given["RGB_cam"]["K"], (640, 480), pose)


def depth_of(name: str) -> np.ndarray:
    return cv2.imread(str(shared("formats") / "asus_xtion_unregistered" / name), cv2.IMREAD_UNCHANGED)


@cache
def frame(number: int, aside: tuple[float, float] = ASIDE[1]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The photograph's gradient magnitude, and the depth by `align` and by `register`, in millimetres."""
    folder, depth = shared("formats") / "asus_xtion_unregistered", depth_of(f"depth1_{number:02d}.png")
    picture = cv2.imread(str(next(folder.glob(f"rgb_image1_{number:02d}.*"))), cv2.IMREAD_GRAYSCALE)
    slopes = np.hypot(*np.gradient(cv2.GaussianBlur(picture.astype(np.float64), (0, 0), 1)))
    both = cameras(aside)
    return slopes, aligned(depth, 1000, *both), ibr.register(depth, *both, depth_scale=1000)


def steps(depth: np.ndarray) -> np.ndarray:
    """Logarithm of the largest depth around each pixel divided by the smallest, at most 0.3, blurred."""
    z = depth.astype(np.float32)
    far = np.maximum(cv2.dilate(z, np.ones((3, 3))), 1)  # 1: no depth
    near = np.minimum(cv2.erode(np.where(z > 0, z, np.float32(np.inf)), np.ones((3, 3))), far)
    return cv2.GaussianBlur(np.minimum(np.log(far / near), 0.3), (0, 0), 1)


def edges_agree(depth: np.ndarray, slopes: np.ndarray, where: np.ndarray) -> float:
    return float(np.corrcoef(steps(depth)[where], slopes[where])[0, 1])


def slivers(depth: np.ndarray) -> int:
    """Count pixels without depth, or on another surface, between two neighbours that lie on one surface."""
    found = np.zeros(depth.shape, bool)
    z = depth.astype(np.float64)
    for part, (before, at, after) in (
        (found[:, 1:-1], (z[:, :-2], z[:, 1:-1], z[:, 2:])),
        (found[1:-1], (z[:-2], z[1:-1], z[2:])),
    ):
        near, far = np.minimum(before, after), np.maximum(before, after)
        part |= (near > 0) & (far < ONE * near) & ((at * ONE < near) | (at > ONE * far))
    return int(found.sum())


def test_the_reference_is_the_vendors_tool():
    """`aligned` agrees with the output of librealsense's tool, except where float32 rounds positions in the tool."""
    theirs = depth_of("rs2_align_depth_to_color_01.png")
    ours = aligned(depth_of("depth1_01.png"), 1000, *cameras((0, 0)))
    assert (ours == theirs).mean() >= 0.99


@pytest.mark.parametrize("number", FRAMES)
def test_it_covers_more_with_fewer_slivers_than_align(number):
    _, theirs, ours = frame(number)
    assert (ours > 0).mean() > (theirs > 0).mean()
    assert slivers(ours) < 0.5 * slivers(theirs)


def test_its_edges_are_as_near_to_the_pictures_as_aligns_at_its_best():
    """Each method has the offset that suits it best, since `align` shifts depth by half a pixel.

    The correlations of edges may differ by 0.01. For comparison, ignoring the photograph's distortion changes them by
    0.02.
    """
    scores = np.zeros((len(ASIDE), len(FRAMES), 2))
    for place, aside in enumerate(ASIDE):
        for number, (slopes, theirs, ours) in enumerate(frame(number, aside) for number in FRAMES):
            where = cv2.dilate(((theirs > 0) & (ours > 0)).astype(np.uint8), np.ones((3, 3))) > 0
            scores[place, number] = [edges_agree(depth, slopes, where) for depth in (theirs, ours)]
    theirs, ours = scores.mean(axis=1).max(axis=0)
    assert ours >= theirs - 0.01
