"""A slanted wall with a picture on it: the depth and colour of every ray are known exactly. Also writes files."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

SIZE = (64, 48)
K = np.array([[60.0, 0, 30.3], [0, 62.0, 24.2], [0, 0, 1]])
GL = np.diag([1.0, -1, -1, 1])
NORMAL, OFFSET = np.array([0.25, 0.15, -1.0]), -2.5  # the wall is the plane of points x with NORMAL . x = OFFSET


def turned(x: float, y: float, z: float) -> np.ndarray:
    """A rotation by the angles x, y and z (radians) about the three axes."""
    a, b, c = (np.array([np.cos(t), np.sin(t)]) for t in (x, y, z))
    about_x = np.array([[1, 0, 0], [0, a[0], -a[1]], [0, a[1], a[0]]])
    about_y = np.array([[b[0], 0, b[1]], [0, 1, 0], [-b[1], 0, b[0]]])
    return np.array([[c[0], -c[1], 0], [c[1], c[0], 0], [0, 0, 1]]) @ about_y @ about_x


def pose(position: tuple[float, float, float], angles: tuple[float, float, float]) -> np.ndarray:
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = turned(*angles), position
    return made


POSES = [pose((0.1, -0.05, 0.05), (0.05, -0.08, 0.06)), pose((-0.25, 0.15, -0.1), (-0.06, 0.12, -0.09))]


class Scene(NamedTuple):
    """Two views: colours (H, W, 3), planar depth and distances along rays (H, W), and poses."""

    colors: list[np.ndarray]
    depths: list[np.ndarray]
    distances: list[np.ndarray]
    poses: list[np.ndarray]


def rendered(K: np.ndarray = K, poses: list[np.ndarray] | None = None, size: tuple[int, int] = SIZE) -> Scene:
    """Render the wall for cameras with OpenCV's axes and pixel centres at integers."""
    scene = Scene([], [], [], POSES if poses is None else poses)
    y, x = np.mgrid[: size[1], : size[0]]
    local = np.dstack([x, y, np.ones_like(x)]) @ np.linalg.inv(K).T
    for one in scene.poses:
        rays = local @ one[:3, :3].T
        depth = (OFFSET - NORMAL @ one[:3, 3]) / (rays @ NORMAL)
        points = one[:3, 3] + rays * depth[..., None]
        waves = [np.sin(5 * points[..., 0] + k) * np.cos(4 * points[..., 1] - k) for k in range(3)]
        scene.colors.append(np.rint(127.5 + 110 * np.dstack(waves)).astype(np.uint8))
        scene.depths.append(depth * local[..., 2])
        scene.distances.append(depth * np.linalg.norm(local, axis=-1))
    return scene


def png(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(image).save(path)


def counts(values: np.ndarray, scale: float) -> np.ndarray:
    return np.rint(values * scale).astype(np.uint16)


def text(path: Path, content: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content)


def matrix(path: Path, values: np.ndarray) -> None:
    text(path, "\n".join(" ".join(map(repr, row)) for row in np.atleast_2d(values).tolist()) + "\n")


def write_frames(folder: Path, scene: Scene, scale: float, color: str, depth: str, pose: str = "", first=0) -> None:
    """Write PNG files of a scene's frames, with depth in units of 1 / scale, and perhaps matrices of their poses.

    `color`, `depth` and `pose` are names of files, with a place for the frame's number, which counts from `first`.
    """
    for number, (seen, far, one) in enumerate(zip(scene.colors, scene.depths, scene.poses, strict=True), first):
        png(folder / color.format(number), seen)
        png(folder / depth.format(number), counts(far, scale))
        if pose:
            matrix(folder / pose.format(number), one)


def xyzw(rotation: np.ndarray) -> np.ndarray:
    w = np.sqrt(1 + np.trace(rotation)) / 2
    skew = rotation - rotation.T
    return np.array([skew[2, 1], skew[0, 2], skew[1, 0], 4 * w * w]) / (4 * w)


def tum_line(time: object, pose: np.ndarray) -> str:
    return " ".join(map(str, [time, *pose[:3, 3].tolist(), *xyzw(pose[:3, :3]).tolist()]))
