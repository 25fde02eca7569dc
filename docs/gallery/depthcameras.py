"""Depth of a depth camera, processed step by step: a picture for pictures.py.

The scene and its cameras are synthetic. The depth camera has 320 x 288 samples; the colour camera is 6 cm to the side
and has 640 x 480 pixels. Each has its own lens.
"""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from objects import knot_surface

import pyibr as ibr
from pyibr.capture import MeshScene

_HOLE = (255, 90, 200)


def room() -> MeshScene:
    """Return a knot in front of the corner of a room with wallpaper."""
    (points, triangles, stripes), size = knot_surface(), 33
    x, y = np.meshgrid(np.linspace(-7, 7, size), np.linspace(-7, 7, size))
    sides = [
        np.stack([x, np.full_like(x, 5.0), y], -1),  # the back wall
        np.stack([np.full_like(x, 6.0), x - 2, y], -1),  # the right wall
        np.stack([x, y, np.full_like(x, -4.0)], -1),  # the floor
    ]
    i = (np.arange(size - 1)[:, None] * size + np.arange(size - 1)).ravel()
    square = np.concatenate([np.stack([i, i + 1, i + size + 1], 1), np.stack([i, i + size + 1, i + size], 1)])
    vertices, faces, colors = [points / 1.6], [triangles], [stripes]
    for number, side in enumerate(sides):
        at, lattice = sum(map(len, vertices)), (np.arange(size)[:, None] // 2 + np.arange(size) // 2) % 2
        faces.append(square + at)
        vertices.append(side.reshape(-1, 3))
        tone = np.array([(196, 186, 160), (150, 172, 186), (120, 104, 92)][number])
        colors.append(np.clip(tone + 34 * (lattice.reshape(-1, 1) - 0.5), 0, 255).astype(np.uint8))
    return MeshScene(np.concatenate(vertices), np.concatenate(faces), colors=np.concatenate(colors))


def cameras() -> tuple[ibr.Camera, ibr.Camera]:
    """Return the depth camera and the colour camera."""
    eye = ibr.Camera.look_at((-3.0, -9.5, 3.2), (0.3, 0, -0.4), (0, 0, 1), (320, 288), fov_y=50).world_from_camera
    aside = np.eye(4)
    aside[:3, 3] = 0.6, -0.05, 0
    bent, straight = ibr.Lens("brown_conrady", [-0.16, 0.04, 0, 0]), ibr.Lens("brown_conrady", [0.07, -0.03, 0, 0])
    return (
        ibr.Camera([[300, 0, 161.2], [0, 300, 142.9], [0, 0, 1]], (320, 288), eye, lens=bent),
        ibr.Camera([[610, 0, 318.7], [0, 610, 241.3], [0, 0, 1]], (640, 480), eye @ aside, lens=straight),
    )


def sensed(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return depth with a sensor's errors: noise that grows with squared depth, and mixed and missing samples."""
    rng = np.random.default_rng(4)
    beside = np.roll(depth, 1, axis=1)
    edge = np.abs(beside - depth) > 0.1 * depth
    mixed = np.where(edge & (rng.random(depth.shape) < 0.5), 0.5 * (beside + depth), depth)
    noisy = mixed + rng.normal(0, 5e-4, depth.shape) * mixed**2
    noisy[(rng.random(depth.shape) < 0.06) | (np.roll(edge, 2, axis=1) & (rng.random(depth.shape) < 0.6))] = np.nan
    return noisy.astype(np.float32)


def steps() -> Figure:
    """Draw the steps from the cameras' images to a new view."""
    scene, (depth_camera, color_camera) = room(), cameras()
    depth = sensed(scene.capture(depth_camera).depth)
    color = scene.capture(color_camera).color
    cleaned = ibr.clean_depth(depth).depth
    new = color_camera.orbited(5, color_camera.center + 10 * color_camera.forward)
    registered = {name: ibr.register(one, depth_camera, color_camera) for name, one in (("raw", depth), ("", cleaned))}
    raw, clean = (ibr.DepthImage(color, one, color_camera) for one in registered.values())
    panels = {
        "the depth camera's image": _shades(depth),
        "the colour camera's image": color,
        "depth, cleaned": _shades(cleaned),
        "and registered": _shades(registered[""]),
        "a new view, not cleaned": _shown(ibr.warp(raw, new, samples=4)),
        "cleaned": _shown(ibr.warp(clean, new, samples=4)),
        'and fill="background"': ibr.warp(clean, new, fill="background", samples=4).color,
        "the true view": scene.capture(new).color,
    }
    figure, grid = plt.subplots(2, 4, figsize=(14, 5.8), layout="constrained")
    for axes, (name, image) in zip(grid.ravel(), panels.items(), strict=True):
        axes.imshow(image)
        axes.set_title(name, loc="left", fontsize=12)
        axes.set_axis_off()
    return figure


def _shades(depth: NDArray[Any]) -> NDArray[np.uint8]:
    near, far = 6.0, 17.0
    made = (plt.get_cmap("viridis")(np.nan_to_num((far - depth) / (far - near)))[..., :3] * 255).astype(np.uint8)
    made[~np.isfinite(depth)] = _HOLE
    return made


def _shown(frame: ibr.Frame) -> NDArray[Any]:
    """Put a frame over the colour that marks holes."""
    assert frame.alpha is not None
    bare = 1 - frame.alpha[..., None]
    return np.rint(frame.color + bare * np.array(_HOLE)).clip(0, 255).astype(np.uint8)
