"""Clouds of Gaussians for the tests."""

from __future__ import annotations

import numpy as np

import pyibr as ibr


def cloud(count: int, degree: int = 0, seed: int = 0, middle: float = 4.0, size: float = 0.06) -> ibr.Gaussians:
    """Gaussians of all sizes, shapes and directions, in front of a camera at the origin."""
    rng = np.random.default_rng(seed)
    means = rng.uniform(-1, 1, (count, 3)) * (2.2, 1.7, 1.5) + (0, 0, middle)
    scales = np.exp(rng.normal(np.log(size), 0.7, (count, 3)))
    sh = rng.normal(0, 0.5, (count, (degree + 1) ** 2, 3)) * np.where(np.arange((degree + 1) ** 2) > 0, 0.3, 1)[:, None]
    return ibr.Gaussians(means, scales, rng.normal(size=(count, 4)), rng.beta(1.2, 1.2, count), sh=sh)


def camera(size: tuple[int, int] = (131, 97), projection: str = "perspective") -> ibr.Camera:
    """A camera at the origin that looks along z, turned and moved a little."""
    f = 0.9 * size[0] if projection == "perspective" else 0.22 * size[0]
    K = [[f, 0.02 * f, 0.47 * size[0]], [0, 1.05 * f, 0.52 * size[1]], [0, 0, 1]]
    pose = ibr.Camera.look_at((0.2, -0.1, 0.1), (0, 0.1, 4), (0.1, -1, 0), size, fov_y=50).world_from_camera
    return ibr.Camera(K, size, pose, projection=projection)


def shuffled(thing: ibr.Gaussians, seed: int = 1) -> ibr.Gaussians:
    """The same Gaussians in another order."""
    return like(thing, np.random.default_rng(seed).permutation(len(thing)))


def like(thing: ibr.Gaussians, chosen: object = slice(None), **changes: object) -> ibr.Gaussians:
    """Some of the Gaussians, with other values or options."""
    names = ("means", "scales", "rotations", "opacities", "sh")
    return ibr.Gaussians(**{**{name: getattr(thing, name)[chosen] for name in names}, **changes})
