"""Scenes: a relief to warp, cameras with the epipole in each of the nine regions, scans, bumps, rooms.

The regions are inside the image and around it, as in the warping paper's table 1. The relief has the same shape for
images of all sizes, so the lengths of epipolar segments are proportional to the image's side.
"""

from __future__ import annotations

import functools
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from benchmarks.results import Skip

Array = NDArray[Any]

REGIONS = "ABCDEFGHI"  # row by row: A is above and left of the image, E inside the image, I below and right
MOTIONS = ("forward", "backward")  # the target camera's: the source camera is then behind it (antipode) or in front
DISTANCE = 0.6  # scene units between the cameras; the relief's depth in the source is 3 to 5
_COLUMN, _ROW = (-0.3, 0.35, 1.3), (-0.3, 0.6, 1.3)  # x and y of the epipole by region, relative to the side
_FUJI_SPACING = 62.4  # metres between samples of map tile 10/906/404 (512 a side, at 35.3 degrees north)
LIVINGROOM, ROOM = "livingroom1", "synthetic room"  # names of the scenes of a depth camera
_VGA, _FOCAL = (640, 480), 525.0  # size and focal length of the depth camera, in pixels
_BASELINE = 0.075  # metres between a structured-light camera and its projector
_DISPARITY_STEPS = 8  # steps per pixel
_NO_DEPTH = 65535  # a RealSense stores millimetres, or this
_SAME_SURFACE = 0.02  # neighbours whose nearness differs by a smaller fraction are interpolated
_POSES = {
    0: ((0, 0, 0), (0, 0, 1)),
    4: ((0.005, -0.1, -0.007), (0.016, 0.05, 1)),
    50: ((-0.36, -0.53, 0.24), (0.49, 0.26, 0.83)),
}
"""Camera positions (metres, y down) and directions in the synthetic room, close to the same frames of `LIVINGROOM`."""
STEREO = {
    "cones": ("im2.png", "im6.png", "disp2.png"),
    "teddy": ("im2.png", "im6.png", "disp2.png"),
    "motorcycle": ("motorcycle_left.png", "motorcycle_right.png", "motorcycle_disp.npz"),
}
"""Middlebury pairs (Scharstein & Szeliski 2003, Scharstein et al. 2014): left and right photograph, left disparity."""
_STORED_DISPARITY = 4.0  # stored units per pixel of disparity
_CALIBRATED = {"motorcycle": (994.978, 0.193001, 311.193, 254.877, 31.086)}
"""Focal length, baseline (metres), left principal point, x distance of the principal points; others in pixels."""
_CHUNK = 256  # rows that are computed at a time, to save memory


def relief(n: int) -> tuple[Array, Array]:
    """A smooth relief with a raised box and a raised disc.

    Returns
    -------
    color : uint8 (n, n, 3)
    depth : float32 (n, n)
        Planar z in scene units.
    """
    color, depth = np.empty((n, n, 3), np.uint8), np.empty((n, n), np.float32)
    x = np.linspace(-1, 1, n, dtype=np.float32)
    for top in range(0, n, _CHUNK):
        a, b = x[None, :], x[top : top + _CHUNK, None]
        z = 4.2 + 0.4 * np.sin(2.3 * a + 0.5) * np.cos(2.9 * b) + 0.2 * np.sin(4.1 * (0.6 * a + b) + 1)
        z -= 0.5 * ((np.abs(a + 0.45) < 0.2) & (np.abs(b + 0.4) < 0.25))
        z -= 0.4 * ((a - 0.35) ** 2 + (b - 0.4) ** 2 < 0.06)
        depth[top : top + _CHUNK] = z
        for channel, phase in enumerate((0.0, 2.0, 4.0)):
            waves = 0.3 * np.sin(9 * a + 5 * b + phase) + 0.2 * np.sin(23 * b - 11 * a * b + phase)
            color[top : top + _CHUNK, :, channel] = 255 * (0.5 + waves)
    return color, depth


def white_noise(n: int) -> tuple[Array, Array]:
    """The relief's colours with a random depth in each pixel, from the relief's range of depth.

    Returns
    -------
    color : uint8 (n, n, 3)
    depth : float32 (n, n)
        Planar z in scene units.
    """
    color, depth = relief(n)
    low, high = depth.min(), depth.max()
    return color, low + (high - low) * np.random.default_rng(n).random((n, n), np.float32)


def data_folder() -> Path:
    """Folder of scanned meshes and real height maps."""
    beside = Path(__file__).resolve().parent.parent.parent / "shared/data"
    return Path(os.environ.get("PYIBR_DATA", beside))


@functools.cache
def scanned(name: str) -> ibr.Mesh | Skip:
    """A scanned mesh of the data folder."""
    path = data_folder() / "meshes" / name
    if not path.is_file():
        return Skip(name.split("_")[0], f"{name} is not in $PYIBR_DATA/meshes")
    try:
        return ibr.Mesh.load(path)
    except ibr.MissingPackageError as error:
        return Skip(name.split("_")[0], str(error))


def bricks(n: int = 256) -> tuple[Array, Array]:
    """Height (n, n) uint8 and colour (n, n, 3) uint8 of a wall: 8 rows of 4 bricks, repeatable."""
    y, x = np.mgrid[:n, :n] * (256 / n)
    shifted = (x + 32 * (y // 32 % 2)) % 64
    joint = np.minimum(np.minimum(shifted, 63 - shifted), np.minimum(y % 32, 31 - y % 32))
    rough = 0.5 + 0.5 * np.sin(x * np.pi / 16 + 3 * np.sin(y * np.pi / 32)) * np.sin(y * np.pi / 16)
    ramp = np.clip(joint / 14, 0, 1)
    height = 255 * ramp * ramp * (3 - 2 * ramp) * (0.75 + 0.25 * rough)
    stone = np.array([150, 82, 60]) * (0.7 + 0.3 * rough[..., None])
    color = np.where(joint[..., None] > 3, stone, (150, 145, 135))
    return height.astype(np.uint8), color.astype(np.uint8)


def terrain() -> tuple[Array, float] | Skip:
    """Heights (513, 513) float32 of Mount Fuji and their spacing, in metres: a tile used to time terrain meshers."""
    path = data_folder() / "heightfields/dem/fuji.png"
    if not path.is_file():
        return Skip("fuji", f"{path.name} is not in $PYIBR_DATA/heightfields/dem")
    import cv2

    blue, green, red = np.moveaxis(np.asarray(cv2.imread(str(path)), np.float64), -1, 0)
    heights = (-10000 + 0.1 * (65536 * red + 256 * green + blue)).astype(np.float32)
    return np.pad(heights, ((0, 1), (0, 1)), "edge"), _FUJI_SPACING


def bumps(n: int) -> Array:
    """(n, n) float32 in [0, 1]: smooth heights that are 0 on the border."""
    x = (np.arange(n) + 0.5) / n
    u, v = np.meshgrid(x, x)
    waves = 0.55 + 0.25 * np.sin(9 * u + 4 * v) * np.cos(11 * v - 3 * u) + 0.2 * np.sin(14 * u * v + 1)
    window = np.clip(8 * np.minimum(np.minimum(u, 1 - u), np.minimum(v, 1 - v)) - 0.2, 0, 1)
    return (waves * window * window * (3 - 2 * window)).clip(0, 1).astype(np.float32)


def source_camera(n: int) -> ibr.Camera:
    """Camera with a field of view of 80 degrees in x and in y."""
    middle = (n - 1) / 2
    return ibr.Camera([[0.6 * n, 0, middle], [0, 0.6 * n, middle], [0, 0, 1]], (n, n))


def view(n: int) -> ibr.DepthImage:
    """The relief as the source camera sees it."""
    return ibr.DepthImage(*relief(n), source_camera(n))


def epipole(n: int, region: str) -> Array:
    """Pixel of the epipole in the target, (2,)."""
    row, column = divmod(REGIONS.index(region), 3)
    return np.array([_COLUMN[column], _ROW[row]]) * (n - 1)


def translation(n: int, region: str, motion: str) -> Array:
    """Centre (3,) of the source camera in the target camera's axes; both cameras have the same directions."""
    toward = np.linalg.inv(source_camera(n).K) @ [*epipole(n, region), 1.0]
    return (1 if motion == "backward" else -1) * DISTANCE * toward / np.linalg.norm(toward)


def target_camera(n: int, region: str, motion: str) -> ibr.Camera:
    """The source camera moved so that the epipole lies in ``region``."""
    return source_camera(n).moved(*-translation(n, region, motion))


@functools.lru_cache(maxsize=2)
def rgbd(scene: str, number: int, size: tuple[int, int], noise: float = 0.0) -> ibr.DepthImage | Skip:
    """A frame of a depth camera.

    Parameters
    ----------
    scene : str
        `LIVINGROOM`: frames without noise from the data folder (Choi, Zhou & Koltun 2015), 640 x 480 pixels, scaled
        to cover ``size`` and cropped to the middle. `ROOM`: ray cast at ``size``.
    number : {0, 4, 50}
        Number of the frame.
    size : (width, height)
    noise : float
        Standard deviation of the disparity's noise, in pixels at ``size``. Noisy disparity is rounded to 1/8 pixel,
        like that of a structured-light camera with a baseline of 7.5 cm. With 0, depth is exact.

    Returns
    -------
    DepthImage or Skip
        In metres; NaN where there is no depth.
    """
    camera = depth_camera(scene, number, size)
    try:
        color, depth = _living_room(number, size) if scene == LIVINGROOM else _room_seen_by(camera)
    except ibr.MissingPackageError as error:
        return Skip(scene, str(error))
    if noise > 0:
        depth = with_disparity_noise(depth, float(camera.K[0, 0]), noise, np.random.default_rng(number))
    return ibr.DepthImage(color, depth, camera)


def shelf(number: int, size: tuple[int, int]) -> ibr.DepthImage | Skip:
    """A raw RealSense frame in metres, thinned from 640 x 480 to ``size``; two thirds of its samples have no depth."""
    import cv2

    folder = data_folder() / "rgbd_realsense_shelf"
    if not folder.is_dir():
        return Skip("shelf", "rgbd_realsense_shelf is not in $PYIBR_DATA")
    frame, step = folder / f"frame-{number:06d}", _VGA[0] // size[0]
    color, stored = (np.asarray(cv2.imread(f"{frame}.{kind}.png", -1))[::step, ::step] for kind in ("color", "depth"))
    depth = np.asarray(np.where(stored < _NO_DEPTH, stored, 0) / 1000, np.float32)
    camera = ibr.Camera(np.loadtxt(folder / "intrinsics.K.txt"), _VGA, np.loadtxt(f"{frame}.pose.txt"))
    return ibr.DepthImage(np.ascontiguousarray(color[..., ::-1]), depth, camera.resized(size))


def standing_in(scene: str) -> tuple[str, Skip | None]:
    """Return the scene or, if its frames are missing, the ray-cast `ROOM` and the reason."""
    if scene != LIVINGROOM or (data_folder() / "rgbd_livingroom1").is_dir():
        return scene, None
    return ROOM, Skip(scene, f"rgbd_{scene} is not in $PYIBR_DATA; {ROOM}, ray cast, stands in for it")


def with_disparity_noise(depth: Array, focal: float, noise: float, rng: np.random.Generator) -> Array:
    """Add noise to the disparity of depth, and round it, as `rgbd` describes."""
    disparity = ibr.disparity_from_depth(depth, focal, _BASELINE)
    disparity += rng.normal(0, noise, depth.shape)
    disparity = np.round(disparity * _DISPARITY_STEPS) / _DISPARITY_STEPS
    return ibr.depth_from_disparity(disparity, focal, _BASELINE)


def stereo(name: str) -> tuple[ibr.DepthImage, ibr.Camera, Array] | Skip:
    """The left photograph of a Middlebury pair with its depth, the right camera, and its photograph (H, W, 3) uint8.

    Cones and teddy have no known calibration; any assumed focal length and baseline give the same warped picture.
    """
    import cv2

    folder = data_folder() / "stereo_middlebury" / name
    if not folder.is_dir():
        return Skip(name, f"stereo_middlebury/{name} is not in $PYIBR_DATA")
    left, right, stored = (folder / file for file in STEREO[name])
    pictures = [np.ascontiguousarray(np.asarray(cv2.imread(str(path)))[..., ::-1]) for path in (left, right)]
    if stored.suffix == ".npz":
        disparity = np.load(stored)["arr_0"].astype(np.float32)
    else:
        disparity = np.asarray(cv2.imread(str(stored), cv2.IMREAD_GRAYSCALE), np.float32) / _STORED_DISPARITY
    height, width = disparity.shape
    focal, baseline, cx, cy, apart = _CALIBRATED.get(name, (500.0, 0.1, (width - 1) / 2, (height - 1) / 2, 0.0))
    depth = ibr.depth_from_disparity(disparity, focal, baseline, offset=apart)
    cameras = [ibr.Camera([[focal, 0, x], [0, focal, cy], [0, 0, 1]], (width, height)) for x in (cx, cx + apart)]
    return ibr.DepthImage(pictures[0], depth, cameras[0]), cameras[1].moved(baseline, 0, 0), pictures[1]


def shown(size: tuple[int, int]) -> str:
    """Write a size as results and reports do."""
    return f"{size[0]} x {size[1]}"


def depth_camera(scene: str, number: int, size: tuple[int, int]) -> ibr.Camera:
    """The camera of a frame of `rgbd`."""
    pose = np.eye(4)
    if scene == LIVINGROOM:
        poses = np.loadtxt(data_folder() / "rgbd_livingroom1/poses_gt_cam_to_frame0.txt")
        pose = poses[poses[:, 0] == number][0, 1:].reshape(4, 4)
    else:
        at, forward = (np.array(vector, float) for vector in _POSES[number])
        pose = ibr.Camera.look_at(at, at + forward, (0, -1, 0), _VGA, fov_y=49).world_from_camera
    (width, height), focal = _VGA, _FOCAL
    camera = ibr.Camera([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]], _VGA, pose)
    full, (left, top) = _covering(size)
    K = camera.resized(full).K - np.array([[0, 0, left], [0, 0, top], [0, 0, 0]])
    return ibr.Camera(K, size, pose)


def _covering(size: tuple[int, int]) -> tuple[tuple[int, int], tuple[int, int]]:
    """Size to which 640 x 480 is scaled to cover ``size``, and the columns and rows cropped at the left and top."""
    scale = max(size[0] / _VGA[0], size[1] / _VGA[1])
    width, height = round(scale * _VGA[0]), round(scale * _VGA[1])
    return (width, height), ((width - size[0]) // 2, (height - size[1]) // 2)


@functools.lru_cache(maxsize=2)
def _living_room(number: int, size: tuple[int, int]) -> tuple[Array, Array]:
    """Colour and depth of a frame; depth is interpolated within a surface, and the nearest sample's at edges."""
    import cv2

    folder = data_folder() / "rgbd_livingroom1"
    color = np.asarray(cv2.imread(str(folder / f"color/{number:05d}.jpg")))[..., ::-1]
    stored = np.asarray(cv2.imread(str(folder / f"depth/{number:05d}.png"), cv2.IMREAD_UNCHANGED))
    nearness = np.where(stored > 0, 1000 / np.maximum(stored, 1), 0).astype(np.float32)
    full, (left, top) = _covering(size)
    nearest = cv2.resize(nearness, full, interpolation=cv2.INTER_NEAREST)
    smooth = cv2.resize(nearness, full, interpolation=cv2.INTER_LINEAR)
    nearness = np.where(np.abs(smooth - nearest) < _SAME_SURFACE * nearest, smooth, nearest)
    depth = np.where(nearness > 0, 1 / np.maximum(nearness, np.float32(1e-6)), np.float32(np.nan))
    finer = full[0] >= _VGA[0]
    color = cv2.resize(np.ascontiguousarray(color), full, interpolation=cv2.INTER_LINEAR if finer else cv2.INTER_AREA)
    part = slice(top, top + size[1]), slice(left, left + size[0])
    return np.ascontiguousarray(color[part]), np.ascontiguousarray(depth[part], np.float32)


@functools.lru_cache(maxsize=2)
def _room_seen_by(camera: ibr.Camera) -> tuple[Array, Array]:
    """Ray cast colour and depth, some rows at a time because rays need much memory."""
    from pyibr.capture import MeshScene

    scene, parts = MeshScene.from_mesh(_room()), list[ibr.DepthImage]()
    for top in range(0, camera.height, _CHUNK):
        size = camera.width, min(_CHUNK, camera.height - top)
        K = camera.K - np.array([[0, 0, 0], [0, 0, top], [0, 0, 0]])
        parts.append(scene.capture(ibr.Camera(K, size, camera.world_from_camera)))
    return np.concatenate([part.color for part in parts]), np.concatenate([part.depth for part in parts])


@functools.cache
def _room() -> ibr.Mesh:
    """Four walls with a floor and a ceiling, a cupboard, a table with a box on it, a column, a ball; metres, y down."""
    boxes = [
        ((-1.6, -1.0, -0.8), (1.7, 0.9, 2.6)),
        ((-1.4, -0.4, 1.8), (-0.7, 0.9, 2.2)),
        ((-0.3, 0.35, 1.2), (0.6, 0.4, 1.7)),
        ((0.05, 0.15, 1.35), (0.25, 0.35, 1.55)),
        ((0.7, -1.0, 1.5), (0.85, 0.9, 1.65)),
    ]
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    sides = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    of_box = np.concatenate([sides[:, [0, 1, 2]], sides[:, [0, 2, 3]]])
    vertices = [np.array(low) + corners * (np.array(high) - np.array(low)) for low, high in boxes]
    faces = [of_box + 8 * box for box in range(len(boxes))]
    n = 40  # segments of the ball from pole to pole, and as many around it
    down, around = (axis.ravel() for axis in np.meshgrid(*[np.arange(n + 1) * np.pi / n] * 2, indexing="ij"))
    ball = np.stack([np.sin(down) * np.cos(2 * around), -np.cos(down), np.sin(down) * np.sin(2 * around)], -1)
    first = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel() + 8 * len(boxes)
    vertices.append(np.array((-0.3, 0.65, 1.1)) + 0.25 * ball)
    faces += [np.stack([first, first + 1, first + n + 1], -1), np.stack([first + 1, first + n + 2, first + n + 1], -1)]
    points = np.concatenate(vertices)
    return ibr.Mesh(points, np.concatenate(faces), colors=0.55 + 0.4 * np.sin(3 * points + (0, 1, 2)))
