"""Specimens of output from networks that estimate depth."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from tests.io.layouts.wall import K, png, rendered, text

NAMES = ("image", "depth", "conf", "extrinsics", "intrinsics")


def depth_anything(folder: Path, names: tuple[str, ...] = NAMES) -> None:
    scene = rendered()
    depth = np.array(scene.depths, np.float32)
    sure = np.full(depth.shape, 5, np.float32)
    inverses = np.linalg.inv(np.array(scene.poses))[:, :3].astype(np.float32)
    arrays = [np.array(scene.colors), depth, sure, inverses, np.tile(K, (2, 1, 1)).astype(np.float32)]
    if names[0] == "images":  # VGGT: colours with channels first, depth with one channel, all with a first axis of 1
        arrays[0] = np.moveaxis(arrays[0], -1, 1).astype(np.float32) / 255
        arrays = [one[None] for one in (arrays[0], depth[..., None], *arrays[2:])]
    folder.mkdir(exist_ok=True)
    np.savez_compressed(folder / "results.npz", **dict(zip(names, arrays, strict=True)))


def vggt(folder: Path) -> None:
    depth_anything(folder, ("images", "depth", "depth_conf", "extrinsic", "intrinsic"))


def moge(folder: Path) -> None:
    """One picture, whose principal point is its centre."""
    scene = rendered(np.array([[60.0, 0, 31.5], [0, 62.0, 23.5], [0, 0, 1]]), [np.eye(4)])
    fov = [2 * np.degrees(np.arctan(n / 2 / f)) for n, f in ((64, 60.0), (48, 62.0))]
    png(folder / "image.png", scene.colors[0])
    depth, mask = scene.depths[0].astype(np.float32), np.full((48, 64), 255, np.uint8)
    depth[:3], mask[:3] = 0.1, 0
    np.save(folder / "depth.npy", depth)
    png(folder / "mask.png", mask)
    text(folder / "fov.json", json.dumps(dict(zip(("fov_x", "fov_y"), fov, strict=True))))


def depth_pro(folder: Path) -> None:
    scene = rendered(np.array([[60.0, 0, 31.5], [0, 60.0, 23.5], [0, 0, 1]]), [np.eye(4)])
    png(folder / "a.png", scene.colors[0])
    np.savez(folder / "a.npz", depth=scene.depths[0].astype(np.float32), focallength_px=np.float32(60))
