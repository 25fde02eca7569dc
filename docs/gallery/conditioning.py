"""Leaks of a depth-weighted splat beside the warp's, as a table and a picture: python docs/gallery/conditioning.py."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from reliefs import show

import pyibr as ibr

SIZE = (384, 224)
CAMERA = ibr.Camera([[340, 0, 191.5], [0, 340, 111.5], [0, 0, 1]], SIZE)
DISK, WALL, SKY = 0.8, 1.5, 1000.0  # metres from the camera
RADIUS, TOP = 0.16, 0.3  # metres: the disk's radius; the wall's height above the camera
BAND = 2  # pixels beside an outline that do not count
DIFFERENT = 8 / 255


def _turned(degrees: float) -> ibr.Camera:
    """A camera that has turned about the disk."""
    angle, middle = np.radians(degrees), np.array([0, 0, DISK])
    eye = middle + DISK * np.array([-np.sin(angle), 0, -np.cos(angle)])
    pose = ibr.Camera.look_at(eye, middle, (0, -1, 0), SIZE, fov_y=40).world_from_camera
    return ibr.Camera(CAMERA.K, SIZE, pose)


MOVES = {
    "dolly in, 0.5 m": CAMERA.moved(0, 0, 0.5),
    "dolly in, 0.2 m": CAMERA.moved(0, 0, 0.2),
    "sideways, 0.15 m": CAMERA.moved(0.15, 0, 0),
    "orbit, 20 degrees": _turned(20),
}


def rendered(camera: ibr.Camera) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Colours from -1 to 1 and depth of an orange disk in front of a blue wall and the sky, by rays."""
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    K = camera.K
    rays = np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones(x.shape)], axis=-1)
    directions, eye = rays @ camera.world_from_camera[:3, :3].T, camera.center
    to_disk, to_wall, to_sky = ((z - eye[2]) / directions[..., 2] for z in (DISK, WALL, SKY))
    at, height = eye + to_disk[..., None] * directions, -(eye[1] + to_wall * directions[..., 1])
    is_disk, is_wall = (np.hypot(at[..., 0], at[..., 1]) < RADIUS) & (to_disk > 0), height < TOP
    behind = np.where(is_wall[..., None], [-0.6, -0.2, 0.6], [0.7, 0.8, 0.9])
    colors = np.where(is_disk[..., None], [1.0, 0.2, -0.6], behind)
    depth = np.where(is_disk, to_disk, np.where(is_wall, to_wall, to_sky))
    return colors.astype(np.float32), depth.astype(np.float32)


def splatted(camera: ibr.Camera) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Warp the first camera's image by the splat of video models: bilinear, weighted by exp(-50 log z / log z_max)."""
    colors, depth = rendered(CAMERA)
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    places, z = camera.project(CAMERA.unproject(np.column_stack([x.ravel(), y.ravel()]), depth.ravel()))
    logs = np.log1p(z)
    strength = np.exp(-50 * logs / logs.max())
    sums = np.zeros((SIZE[1], SIZE[0], 4))
    first = np.floor(places).astype(int)
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        at = first + np.array([dx, dy])
        weight = strength * (1 - np.abs(places - at)).prod(axis=1)
        inside = ((at >= 0) & (at < SIZE)).all(axis=1)
        values = np.column_stack([colors.reshape(-1, 3), np.ones(len(at))]) * weight[:, None]
        np.add.at(sums, (at[inside, 1], at[inside, 0]), values[inside])
    seen = sums[..., 3] > 0
    return np.where(seen[..., None], sums[..., :3] / np.maximum(sums[..., 3:], 1e-300), -1).astype(np.float32), seen


def warped(camera: ibr.Camera) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Warp the same image by pyibr."""
    colors, depth = rendered(CAMERA)
    made = ibr.torch.warp(colors.transpose(2, 0, 1)[None], depth[None], CAMERA, camera)
    return np.where(made.mask[0], made.values[0], -1).transpose(1, 2, 0), made.mask[0, 0]


def counted(camera: ibr.Camera) -> NDArray[np.bool_]:
    """Pixels of the disk at least `BAND` pixels from its outline."""
    inside = np.pad(rendered(camera)[0][..., 2] < 0, BAND)  # the disk alone has little blue
    views = np.lib.stride_tricks.sliding_window_view(inside, (2 * BAND + 1, 2 * BAND + 1))
    return np.asarray(views.all(axis=(2, 3)))


def leaks(picture: NDArray[np.float32], seen: NDArray[np.bool_], camera: ibr.Camera) -> int:
    """Count pixels of the disk that show the wall, a mixture, or nothing."""
    wrong = ~seen | (np.abs(picture - rendered(camera)[0]).max(axis=2) > 2 * DIFFERENT)  # colours from -1 to 1
    return int(wrong[counted(camera)].sum())


def table() -> str:
    """Return the leaks of each move as a table in Markdown."""
    rows = ["| move | pixels of the disk | leaks of the splat | leaks of `pyibr.torch` |", "|---|---|---|---|"]
    for name, camera in MOVES.items():
        splat, own = leaks(*splatted(camera), camera), leaks(*warped(camera), camera)
        rows.append(f"| {name} | {counted(camera).sum()} | {splat} | {own} |")
    return "\n".join(rows)


def beside() -> Figure:
    """Draw a sideways move: by rays, by the splat, and by the warp."""
    camera = MOVES["sideways, 0.15 m"]
    figure, row = plt.subplots(1, 3, figsize=(13.5, 2.9), layout="constrained")
    pictures = {
        "rays": rendered(camera)[0],
        "splat: the wall shows through": splatted(camera)[0],
        "pyibr.torch": warped(camera)[0],
    }
    for axes, (name, picture) in zip(row, pictures.items(), strict=True):
        show(axes, (picture + 1) / 2, name)
    return figure


if __name__ == "__main__":
    print(table())
