"""Made clouds of Gaussians of three kinds, and the cameras that see them.

*room*: the walls of a room and forty balls in it, in flat Gaussians; one in twelve is four times as large and faint, as
in trained scenes. *cloud*: Gaussians of all shapes that fill a box. *photograph*: a flat Gaussian for each pixel of a
picture with depth.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr

SIZE = (640, 480)
FOCAL = 560.0
_DIRECT = 0.28209479177387814  # the harmonic of degree 0
_BALLS = 40

Array = NDArray[Any]


def cloud(kind: str, count: int, degree: int) -> ibr.Gaussians:
    """Make a cloud of (almost) `count` Gaussians; above degree 0, colours change a little with the direction."""
    rng = np.random.default_rng(count)
    means, normals, scales, opacities, colors = _MAKERS[kind](rng, count)
    sh = rng.normal(0, 0.05, (len(means), (degree + 1) ** 2, 3))
    sh[:, 0] = (np.clip(colors, 0, 1) - 0.5) / _DIRECT
    arrays = (means, scales, turned_to(normals, rng.uniform(0, np.pi, len(means))), np.clip(opacities, 0.004, 0.999))
    return ibr.Gaussians(*(array.astype(np.float32) for array in arrays), sh=sh.astype(np.float32))


def path(kind: str, size: tuple[int, int], count: int) -> list[ibr.Camera]:
    """Cameras that move sideways and turn a little."""
    f = FOCAL * size[0] / SIZE[0]
    K, cameras = [[f, 0, (size[0] - 1) / 2], [0, f, (size[1] - 1) / 2], [0, 0, 1]], list[ibr.Camera]()
    for t in np.linspace(0, 3.3, count):
        eye = np.array([0.3 * np.sin(t), 0.1 * np.cos(t), -0.5 if kind == "room" else 0.0])
        pose = ibr.Camera.look_at(eye, eye + np.array([np.sin(0.12 * np.sin(t)), 0, 1]), (0, -1, 0), size, fov_y=45)
        cameras.append(ibr.Camera(K, size, pose.world_from_camera))
    return cameras


def turned_to(normals: Array, spins: Array) -> Array:
    """(N, 4) quaternions that turn the third axis to a normal (N, 3), or to its opposite, after a spin about it."""
    x, y, z = (normals / np.linalg.norm(normals, axis=1, keepdims=True) * np.where(normals[:, 2:] < 0, -1, 1)).T
    c, s = np.cos(spins), np.sin(spins)
    return np.stack([(1 + z) * c, x * s - y * c, x * c + y * s, (1 + z) * s], axis=1)


def _room(rng: np.random.Generator, count: int) -> tuple[Array, ...]:
    walls, side = count // 2, rng.integers(0, 6, count // 2)
    on_wall, of_wall = rng.uniform(-1, 1, (walls, 3)), np.eye(3)[side % 3]
    on_wall[np.arange(walls), side % 3] = np.where(side < 3, -1, 1)
    middles, radii = (
        rng.uniform(-1, 1, (_BALLS, 3)) * (2.4, 1.5, 2.5) + (0, 0, 3.2),
        rng.uniform(0.15, 0.5, (_BALLS, 1)),
    )
    ball, of_ball = rng.integers(0, _BALLS, count - walls), rng.normal(size=(count - walls, 3))
    of_ball /= np.linalg.norm(of_ball, axis=1, keepdims=True)
    means = np.concatenate([on_wall * (3, 2, 4) + (0, 0, 2), middles[ball] + of_ball * radii[ball]])
    faint = rng.random(count) < 1 / 12
    size = np.exp(rng.normal(np.log(9 / np.sqrt(count)), 0.55, count)) * np.where(faint, 4, 1)
    scales = np.stack([size, size * np.exp(rng.normal(0, 0.5, count)), 0.1 * size], axis=1)
    opacities = np.where(faint, rng.beta(1, 3, count), rng.beta(2.5, 1.2, count))
    colors = 0.5 + 0.5 * np.sin(means * (3, 4, 2.5)) + rng.normal(0, 0.08, (count, 3))
    return means, np.concatenate([of_wall, of_ball]), scales, opacities, colors


def _cloud(rng: np.random.Generator, count: int) -> tuple[Array, ...]:
    places, scales = rng.uniform(-1, 1, (count, 3)), np.exp(rng.normal(np.log(0.02), 0.5, (count, 3)))
    means = places * (3, 2.25, 3) + (0, 0, 4.5)
    return means, rng.normal(size=(count, 3)), scales, rng.beta(1.2, 1.2, count), 0.5 + 0.5 * places


def _photograph(rng: np.random.Generator, count: int) -> tuple[Array, ...]:
    columns = round(np.sqrt(count * 4 / 3))
    rows = count // columns
    v, u = np.mgrid[:rows, :columns].reshape(2, -1) + 0.5
    a, b = 1.15 * (u / columns - 0.5), 0.86 * (v / rows - 0.5)
    z = 3 + 1.2 * np.sin(6 * a) * np.cos(5 * b) - 1.3 * (np.hypot(a, b) < 0.2)
    noise = np.exp(rng.normal(0, 0.3, (len(a), 3)))
    scales = (1.15 / columns * z)[:, None] * (0.8, 0.8, 0.15) * noise
    colors = np.stack([0.5 + 0.5 * np.sin(40 * a), 0.5 + 0.5 * np.cos(30 * b), z / 5], axis=1)
    normals = rng.normal(0, 0.3, (len(a), 3)) - (0, 0, 1)
    return np.stack([a * z, b * z, z], axis=1), normals, scales, rng.normal(0.9, 0.15, len(a)), colors


_MAKERS = {"room": _room, "cloud": _cloud, "photograph": _photograph}
KINDS = tuple(_MAKERS)
