"""Picture of a camera that descends into a relief, made by pictures.py."""

from __future__ import annotations

import cv2
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from reliefs import bricks, noise, quad, show

import pyibr as ibr

SIZE = (430, 300)
SKY = (196, 214, 232)


def canyon() -> tuple[np.ndarray, np.ndarray]:
    """Return height and colour of a plateau with a winding canyon along u, whose walls have layers; both maps tile."""
    y, x = np.mgrid[:512, :512] / 512
    rough = 0.6 * noise(21, 22, 512) + 0.4 * noise(22, 7, 512)
    aside = np.abs(y - 0.5 - 0.1 * np.sin(2 * np.pi * x) - 0.03 * np.sin(6 * np.pi * x + 1))
    rise = ((aside - 0.035 + 0.05 * (rough - 0.5)) / 0.1).clip(0, 1)
    steps = (np.floor(6 * rise) + np.clip(6 * (rise % (1 / 6)) * 3 - 1, 0, 1)) / 6
    height = (0.05 * rough + 0.8 * steps + 0.15 * rough * rise).clip(0, 1)
    layers = 0.5 + 0.5 * np.sin(40 * height + 3 * rough)
    rock = np.array([176, 98, 62]) + layers[..., None] * np.array([44, 40, 34])
    ground = np.array([186, 160, 112]) * (0.8 + 0.3 * noise(23, 3, 512)[..., None])
    color = np.where(
        (rise < 0.02)[..., None], np.array([96, 128, 132]), np.where((rise > 0.97)[..., None], ground, rock)
    )
    return height.astype(np.float32), cv2.GaussianBlur(color.clip(0, 255).astype(np.uint8), (0, 0), 1.2)


def path(x: float) -> float:
    """Return y of the canyon's middle at x, in the world of `walk`: a tile is 3 units wide, and v points to -y."""
    return 1.5 - 0.3 * np.sin(2 * np.pi * x / 3) - 0.09 * np.sin(6 * np.pi * x / 3 + 1)


def walk() -> Figure:
    """Draw two descents of a camera, in three views each: between bricks of a floor, and into a canyon."""
    light = ibr.Light(direction=(0.8, 0.35, -0.75), color=(1.9, 1.8, 1.65), ambient=0.45, shadow_size=2048)
    floor = ibr.ReliefSurface(quad((-4, -4, 0), (8, 0, 0), (0, 8, 0)), *bricks(), 0.14, tiles=(8, 8), shadow="search")
    land = ibr.ReliefSurface(quad((-6, -6, 0), (12, 0, 0), (0, 12, 0)), *canyon(), 0.5, tiles=(4, 4), shadow="search")
    lane = [(x, -0.5, z) for x, z in ((-0.55, 0.25), (-0.2, -0.05), (0.3, -0.09))]
    river = [(x, path(x), z) for x, z in ((-0.9, 0.35), (-0.4, -0.2), (0.5, -0.38))]
    figure, grid = plt.subplots(2, 3, figsize=(13.5, 6.6), layout="constrained")
    for row, thing, eyes in zip(grid, (floor, land), (lane, river), strict=True):
        for axes, (x, y, z) in zip(row, eyes, strict=True):
            ahead = (x + 0.6, -0.49 if thing is floor else path(x + 0.6), z - 0.4 * max(z, 0) - 0.02)
            camera = ibr.Camera.look_at((x, y, z), ahead, (0, 0, 1), SIZE, fov_y=62)
            frame = ibr.render(thing, camera, light, background=SKY, samples=4, anisotropy=4)
            depth = -z / thing.scale
            show(axes, frame.color, f"below the base by {depth:.1f} of the depth" if depth > 0 else "above the base")
    return figure
