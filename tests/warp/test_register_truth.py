"""Registration compared with rays cast at a room: thin objects, noise, missing samples, and many pairs of cameras."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import MeshScene
from tests.boxes import cuboid
from tests.embree import embree, pixels_of
from tests.truth import project

pytest.importorskip("open3d")

BASELINE = 0.075  # distance of a structured-light camera from its projector, in metres
BARREL = ibr.Lens("brown_conrady", [-0.12, 0.03, 0.001, -0.0005, 0.0])
RATIONAL = ibr.Lens("rational", [0.548, -0.021, 2e-05, -7e-05, -0.0027, 0.89, 0.086, -0.0139])

Box = tuple[tuple[float, float, float], tuple[float, float, float]]
LARGE: tuple[Box, ...] = (
    ((-1.6, -1.0, -0.8), (1.7, 0.9, 2.6)),  # the room
    ((-1.4, -0.4, 1.8), (-0.7, 0.9, 2.2)),
    ((-0.3, 0.35, 1.2), (0.6, 0.4, 1.7)),
    ((0.05, 0.15, 1.35), (0.25, 0.35, 1.55)),
    ((0.7, -1.0, 1.5), (0.85, 0.9, 1.65)),
)
BARS: tuple[Box, ...] = tuple(
    ((x, -0.7, z), (x + 0.011, -0.1, z + 0.011))
    for x, z in np.column_stack([np.arange(-0.9, 0.6, 0.19), 1.1 + 0.1 * np.arange(8)]).tolist()
)


@dataclass(frozen=True)
class Room:
    """A scene that can be captured, and asked for obstacles between a camera and points."""

    pictures: MeshScene
    rays: Any

    def before(self, eye: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(N,) distances from an eye to the first surface towards each of the points, as fractions of the way."""
        ways = points - eye
        answer = np.full(len(ways), np.nan)
        known = np.isfinite(ways).all(axis=1)
        packed = np.concatenate([np.broadcast_to(eye, ways.shape), ways], axis=1)[known].astype(np.float32)
        answer[known] = self.rays.cast_rays(packed)["t_hit"].numpy()
        return answer


def room(boxes: Iterable[Box]) -> Room:
    solids = [cuboid(low, high) for low, high in boxes]
    vertices = np.concatenate([corners for corners, _ in solids])
    triangles = np.concatenate([faces + 8 * number for number, (_, faces) in enumerate(solids)])
    rays = embree(ibr.Mesh(vertices, triangles))
    return Room(MeshScene(vertices, triangles, colors=0.55 + 0.4 * np.sin(3 * vertices + (0, 1, 2))), rays)


@cache
def scene(thin: bool = True) -> Room:
    return room(LARGE + BARS if thin else LARGE)


@cache
def picture(one: ibr.Camera, thin: bool = True) -> ibr.DepthImage:
    return scene(thin).pictures.capture(one)


def camera(size: tuple[int, int], focal: float, lens: ibr.Lens | None = None, pose: np.ndarray | None = None):
    K = [[focal, 0, size[0] / 2 - 2.3], [0, 1.01 * focal, size[1] / 2 + 1.6], [0, 0, 1]]
    return ibr.Camera(K, size, pose, lens=lens)


def posed(x: float, y: float, z: float, *turn: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = cv2.Rodrigues(np.array(turn or (0.01, -0.02, 0.015)))[0], (x, y, z)
    return pose


# The sizes and focal lengths keep columns of rays off the boxes' edges.
HERE, SMALL, LARGE_ONE = (
    camera((307, 229), 252),
    camera((157, 119), 130),
    camera((509, 383), 418.3),
)
NARROW = {
    "beside": (HERE, camera((301, 233), 260, pose=posed(0.05, 0.003, -0.004))),
    "lenses": (camera((307, 229), 252, RATIONAL), camera((301, 233), 260, BARREL, posed(0.05, 0.003, -0.004))),
    "small depth": (SMALL, camera((613, 347), 490, pose=posed(0.05, 0.003, -0.004))),
    "large depth": (LARGE_ONE, camera((211, 127), 160, BARREL, posed(-0.05, 0.003, -0.004))),
    "narrower": (HERE, camera((307, 229), 299, pose=posed(0.05, 0.003, -0.004, 0, np.radians(1), 0))),
    "behind": (HERE, camera((301, 233), 290, pose=posed(0.02, 0, -0.25))),
    "ahead": (HERE, camera((301, 233), 240, pose=posed(0.02, 0, 0.25))),
    "portrait": (HERE, camera((229, 307), 260, pose=posed(0.05, 0, 0, 0, 0, np.pi / 2))),
}
WIDE = {
    "30 cm": (HERE, camera((301, 233), 240, pose=posed(0.3, 0.02, 0, 0, -0.2, 0.01))),
    "90 cm": (HERE, camera((301, 233), 216, pose=posed(0.9, -0.1, 0.3, 0.05, -0.8, 0.02))),
}


def measured(one: ibr.Camera, noise: float = 0.0, dropped: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """True depth, and depth with noise of `noise` pixels of disparity, without the fraction `dropped` of samples."""
    depth = picture(one).depth
    rng, focal = np.random.default_rng(7), one.K[0, 0]
    made = depth.copy()
    if noise:
        made = focal * BASELINE / (focal * BASELINE / depth + rng.normal(0, noise, depth.shape))
    made[rng.random(depth.shape) < dropped] = np.nan
    return depth, made.astype(np.float32)


def around(mask: np.ndarray, pixels: int) -> np.ndarray:
    kernel = np.ones((2 * pixels + 1, 2 * pixels + 1))
    return cv2.dilate(mask.astype(np.uint8), kernel, borderValue=0).astype(bool)


def changes(mask: np.ndarray, pixels: int) -> np.ndarray:
    return around(mask, pixels) & around(~mask, pixels)


def silhouettes(depth: np.ndarray, pixels: int) -> np.ndarray:
    """(H, W) bool: pixels at most `pixels` from a place where nearness bends by more than 0.3 % in a row or column."""
    nearness, edge = 1 / depth.astype(float), np.zeros(depth.shape, bool)
    for axis in (0, 1):
        step = np.diff(nearness, axis=axis)
        bend = np.abs(np.diff(step, axis=axis)) > 3e-3 * nearness[1:-1] if axis == 0 else None
        bend = np.abs(np.diff(step, axis=axis)) > 3e-3 * nearness[:, 1:-1] if bend is None else bend
        edge[(slice(1, -1), slice(None)) if axis == 0 else (slice(None), slice(1, -1))] |= bend
    return around(edge, pixels)


@cache
def seen_in_color(depth_camera: ibr.Camera, color_camera: ibr.Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The colour camera's true depth, the pixels that the depth camera saw, too, and the certain ones among them.

    Certain pixels are more than two pixels of the coarser camera away from silhouettes and from unseen pixels.
    """
    depth = picture(color_camera).depth
    points = color_camera.unproject(pixels_of(color_camera), depth.ravel())
    back = depth_camera.project(points)[0]
    inside = ((back > 1) & (back < np.array(depth_camera.size) - 2)).all(axis=1)
    seen = ((np.abs(scene().before(depth_camera.center, points) - 1) < 2e-3) & inside).reshape(depth.shape)
    two = int(np.ceil(2 * max(1.0, color_camera.K[0, 0] / depth_camera.K[0, 0])))
    return depth, seen, seen & ~around(~seen, two) & ~silhouettes(depth, two)


@pytest.mark.parametrize("rig", [*NARROW, *WIDE])
def test_depth_of_what_both_see_has_no_gaps(rig):
    cameras = {**NARROW, **WIDE}[rig]
    truth, _, sure = seen_in_color(*cameras)
    assert sure.mean() > 0.15
    found = ibr.register(measured(cameras[0])[1], *cameras)
    # From a depth camera that sees a table nearly edge-on, the table's samples may differ by more than the cut ratio.
    assert np.isnan(found[sure]).mean() <= (2e-3 if rig in WIDE else 0)
    off = np.abs(found / truth - 1)[sure & np.isfinite(found)]
    assert (off < 1e-3).mean() > 0.995
    assert (off < 0.02).mean() > 0.9998


@pytest.mark.parametrize(("noise", "dropped"), [(0.3, 0.0), (0.3, 0.05), (0.6, 0.0)])
@pytest.mark.parametrize("rig", ["beside", "lenses", "large depth", "ahead"])
def test_noise_tears_no_surface(rig, noise, dropped):
    cameras = NARROW[rig]
    truth, _, sure = seen_in_color(*cameras)
    found = ibr.register(measured(cameras[0], noise, dropped)[1], *cameras)
    # Noise above three deviations tears 0.3 % of the edges, and a triangle has three edges. If neighbouring samples are
    # dropped, larger holes remain.
    assert np.isnan(found[sure]).mean() < (0.01 if dropped else 0.008)
    clean = np.abs(measured(cameras[0], noise)[1] / measured(cameras[0])[0] - 1)
    off = np.abs(found / truth - 1)[sure & np.isfinite(found)]
    assert np.median(off) < 1.1 * np.median(clean), "the result is no noisier than the input"


@pytest.mark.parametrize("rig", NARROW)
def test_thin_things_are_there(rig):
    """On bars one to five samples wide, at least as many pixels seen by both cameras are right as with OpenCV."""
    cameras = NARROW[rig]
    truth, seen, _ = seen_in_color(*cameras)
    behind = picture(cameras[1], thin=False).depth
    bars = seen & (truth < 0.99 * behind)
    assert bars.sum() > 200
    found = ibr.register(measured(cameras[0])[1], *cameras)
    right = (np.abs(found / truth - 1) < 0.02)[bars].mean()
    # Outlines are uncertain by half a sample, which is up to a third of the pixels of bars one sample wide.
    assert right > (0.65 if rig == "small depth" else 0.75)
    assert np.isnan(found[bars]).mean() < 0.02
    if cameras[0].lens is None and cameras[1].lens is None:
        relation = cameras[1].camera_from_world @ cameras[0].world_from_camera
        depth = measured(cameras[0])[1]
        points = cv2.registerDepth(cameras[0].K, cameras[1].K, np.zeros(5), relation, depth, cameras[1].size)
        # OpenCV draws each sample as a point one pixel wide, even if the sample is smaller.
        assert right >= (np.abs(points / truth - 1) < 0.02)[bars].mean() - 0.01


def colored(cameras: tuple[ibr.Camera, ibr.Camera], depth: np.ndarray) -> ibr.RegisteredColor:
    return ibr.register_color(depth, *cameras, picture(cameras[1]).color)


@cache
def seen_samples(depth_camera: ibr.Camera, color_camera: ibr.Camera) -> tuple[np.ndarray, np.ndarray]:
    """Masks (H, W) of samples that the colour camera sees, and of samples for which this is certain."""
    depth = measured(depth_camera)[0]
    points = depth_camera.unproject(pixels_of(depth_camera), depth.ravel())
    pixels, before_it = color_camera.project(points)
    inside = ((pixels >= -0.5) & (pixels <= np.array(color_camera.size) - 0.5)).all(axis=1) & (before_it > 0)
    seen = ((scene().before(color_camera.center, points) > 1 - 2e-3) & inside).reshape(depth.shape)
    return seen, ~(changes(seen, 3) | silhouettes(depth, 3))


@pytest.mark.parametrize(("noise", "dropped"), [(0.0, 0.0), (0.1, 0.0), (0.3, 0.05)])
@pytest.mark.parametrize("rig", NARROW)
def test_samples_get_colours_where_they_are_seen(rig, noise, dropped):
    cameras = NARROW[rig]
    seen, sure = seen_samples(*cameras)
    depth = measured(cameras[0], noise, dropped)[1]
    found = colored(cameras, depth)
    sure = sure & np.isfinite(depth)
    assert (seen & sure).mean() > 0.3 and (~seen & sure).mean() > 0.005
    few = 0 if noise < 0.3 else 2e-3  # noise moves samples before or behind others
    assert (~found.seen)[seen & sure].mean() <= few
    assert found.seen[~seen & sure].mean() <= few
    assert not found.color[~found.seen].any()


@pytest.mark.parametrize("rig", WIDE)
def test_wide_baselines_hide_what_the_depth_camera_saw(rig):
    cameras = WIDE[rig]
    seen, sure = seen_samples(*cameras)
    found = colored(cameras, measured(cameras[0])[1])
    assert not (~found.seen & seen & sure).any()
    # 2.5 % of the hidden samples may get colours: the depth camera did not see the surfaces that hide them, which are
    # sides of boxes and parts outside of the depth image.
    assert found.seen[~seen & sure].mean() < 0.025


@pytest.mark.parametrize(("size", "noise"), [((211, 193), 0.0), ((211, 193), 0.1), ((53, 48), 0.0)])
@pytest.mark.parametrize("angle", [1.4, 1.8])
def test_a_ball_hides_itself(angle, size, noise):
    """Samples of a ball that face away from a colour camera at its side get no colour: the ball hides them."""
    left = camera(size, 1.9 * size[0])
    pose = np.eye(4)
    pose[:3, :3] = cv2.Rodrigues(np.array([0, -angle, 0]))[0]
    pose[:3, 3] = np.array([0, 0, 2.0]) - 2.0 * pose[:3, 2]
    right = ibr.Camera(left.K, left.size, pose)
    ways = np.column_stack([left.ideal_positions(pixels_of(left)), np.ones(size[0] * size[1])])
    a, b, c = (ways**2).sum(axis=1), -4 * ways[:, 2], 4 - 0.45**2  # the ball around (0, 0, 2)
    with np.errstate(invalid="ignore"):
        depth = (-b - np.sqrt(b * b - 4 * a * c)) / (2 * a)
    points = ways * depth[:, None]
    towards = right.center - points
    facing = ((points - [0, 0, 2]) * towards).sum(axis=1) / (0.45 * np.linalg.norm(towards, axis=1))
    rng = np.random.default_rng(3)
    noisy = (1 / (1 / depth + rng.normal(0, noise / (left.K[0, 0] * BASELINE), depth.shape))).astype(np.float32)
    color = np.full((size[1], size[0], 3), 90, np.uint8)
    found = ibr.register_color(noisy.reshape(size[::-1]), left, right, color).seen.ravel()
    turned, faces = facing < -0.35, facing > 0.2  # cosines to the camera; in between, noise decides
    assert turned.mean() > 0.05 and faces.mean() > 0.05
    assert found[faces].mean() > (0.97 if noise else 0.999)
    # Near the outline, few samples show the surface's slope. In small images, the outermost samples are cut off.
    assert found[turned].mean() < (0.02 if size[0] > 100 else 0.03)


def test_colours_are_of_the_own_surface():
    """No sample of the wall gets the red of the bars in front of it, and no sample of a bar gets the wall's blue."""
    cameras = NARROW["beside"]
    depth, _ = measured(cameras[0])
    behind = picture(cameras[0], thin=False).depth
    there, color = picture(cameras[1]), np.zeros((233, 301, 3), np.uint8)
    bars_there = there.depth < 0.99 * picture(cameras[1], thin=False).depth
    color[...] = np.where(bars_there[..., None], (255, 0, 0), (0, 0, 255))
    found = ibr.register_color(depth, *cameras, color)
    pixels = cameras[1].project(cameras[0].unproject(pixels_of(cameras[0]), depth.ravel()))[0]
    x, y = np.clip(np.rint(np.nan_to_num(pixels)), 0, np.array(cameras[1].size) - 1).astype(int).T
    # Within a pixel of the bars' outlines, the picture itself may show either colour.
    sure = found.seen & ~changes(bars_there, 1)[y, x].reshape(depth.shape)
    bars = depth < 0.99 * behind
    assert (bars & sure).sum() > 50 and (~bars & sure).sum() > 40_000
    np.testing.assert_array_equal(found.color[bars & sure], [[255, 0, 0]] * int((bars & sure).sum()))
    np.testing.assert_array_equal(found.color[~bars & sure], [[0, 0, 255]] * int((~bars & sure).sum()))
    # Even there, samples mix both colours less than a third as often as with bilinear interpolation.
    plain = cv2.remap(color, *pixels.astype(np.float32).reshape(*depth.shape, 2).transpose(2, 0, 1), cv2.INTER_LINEAR)
    both, either = (np.count_nonzero(each[found.seen], axis=1) > 1 for each in (found.color, plain))
    assert both.sum() < either.sum() / 3


@pytest.mark.parametrize(
    "model", ["none", "brown_conrady", "rational", "tilted", "modified_brown_conrady", "kannala_brandt"]
)
def test_colours_come_from_where_opencv_sees_the_samples(model):
    """The picture's colours encode pixel positions: each sample gets its position by OpenCV, to 0.01 pixels."""
    numbers = {
        "brown_conrady": [-0.22, 0.05, 0.002, -0.001, 0.002],
        "rational": list(RATIONAL.coefficients),
        "tilted": [*RATIONAL.coefficients, 0.01, -0.005, -0.02, 0.01, 0.08, -0.05],
        "modified_brown_conrady": [-0.2, 0.05, 0, 0, 0.003],
        "kannala_brandt": [0.02, -0.01, 0.002, 0],
    }
    lens = ibr.Lens(model, numbers[model]) if model != "none" else None
    depth_camera = camera((153, 115), 126, BARREL)
    there = camera((205, 167), 100, lens, posed(0.05, 0.003, -0.004))
    depth = (2 + 0.5 * np.sin(np.arange(153) / 45) + np.zeros((115, 1))).astype(np.float32)
    x, y = np.meshgrid(*map(np.arange, there.size))
    places = np.stack([x / 205, y / 167, 0 * x], axis=-1).astype(np.float32)
    found = ibr.register_color(depth, depth_camera, there, places)
    points = depth_camera.unproject(pixels_of(depth_camera), depth.ravel())
    local = points @ there.camera_from_world[:3, :3].T + there.camera_from_world[:3, 3]
    expected = project(there, local)  # by OpenCV
    inside = ((expected >= 0) & (expected <= np.array(there.size) - 1)).all(axis=1)
    assert found.seen.ravel()[inside].all() and inside.mean() > 0.9
    got = found.color.reshape(-1, 3)[:, :2] * there.size
    assert np.abs(got - expected)[inside].max() < 0.01
