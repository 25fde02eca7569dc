"""Draw a picture of each kind into a file, or compare the files of two machines.

python tools/pictures.py here.npz
python tools/pictures.py --compare here.npz there.npz
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import pyibr as ibr
from pyibr.capture import MeshScene, models, object_views

SIZE = (64, 48)  # larger pictures take minutes on an emulated machine
CAMERA = ibr.Camera([[60, 0, 31.5], [0, 60, 23.5], [0, 0, 1]], SIZE)
EYE = ibr.Camera.look_at((2.8, 1.3, 2.4), (0, 0, 0), (0, 0, 1), SIZE, fov_y=45)
LIGHT = ibr.Light(direction=(-1, -0.3, -1))


def room(step: float = 0.0) -> ibr.DepthImage:
    """A ball in front of a wavy wall, with a little noise; the camera stands `step` units to the right."""
    camera = CAMERA.moved(step, 0, 0)
    x, y = np.meshgrid(*(np.arange(size) for size in SIZE))
    rays = camera.unproject(np.stack([x, y], -1).reshape(-1, 2), np.ones(x.size)).reshape(*x.shape, 3) - camera.center
    wall = 4 + 0.2 * np.sin(3 * (step + 4 * rays[..., 0])) * np.cos(5 * rays[..., 1])
    middle = np.array([0.3, 0.1, 2.5]) - camera.center
    a, b, c = (rays * rays).sum(-1), rays @ middle, middle @ middle - 0.5**2
    inside = b * b > a * c
    depth = np.where(inside, (b - np.sqrt(np.maximum(b * b - a * c, 0))) / a, wall)
    depth *= 1 + 0.001 * np.random.default_rng(1).standard_normal(depth.shape)
    seen = camera.center + depth[..., None] * rays
    color = 127.5 + 110 * np.stack([np.sin(9 * seen[..., 0]), np.sin(7 * seen[..., 1]), np.where(inside, 1, -1)], -1)
    return ibr.DepthImage(color.astype(np.uint8), depth.astype(np.float32), camera)


def heights() -> dict[str, Any]:
    """Options of a relief on a torus: a map of hills, and its colours."""
    u, v = np.meshgrid(*2 * (np.linspace(0, 2 * np.pi, 64, endpoint=False),))
    height = (0.5 + 0.25 * np.sin(3 * u) + 0.25 * np.cos(2 * v)).astype(np.float32)
    color = (255 * np.stack([height, 1 - height, np.sin(u) ** 2], -1)).astype(np.uint8)
    return {"height": height, "color": color, "scale": 0.06}


def pictures() -> dict[str, Callable[[], Any]]:
    """All calls by name; each returns a frame or an array."""
    view, beyond, aside = room(), CAMERA.moved(0.15, 0.05, 0.2), CAMERA.moved(0.2, 0, 0)
    donut = models.donut(24)
    taken = object_views(MeshScene.from_mesh(donut), 32)
    warp: Any = ibr.warp
    return {
        "warp": lambda: warp(view, beyond),
        "warp, search": lambda: warp(view, beyond, method="search"),
        "warp, forward": lambda: warp(view, beyond, method="forward"),
        "warp, sideways": lambda: warp(view, aside),
        "warp, filled from behind": lambda: warp(view, beyond, fill="background"),
        "warp, filled smoothly, samples": lambda: warp(view, beyond, fill="smooth", samples=4),
        "warp, two views": lambda: warp([view, room(0.4)], beyond),
        "registration": lambda: ibr.register(view.depth, CAMERA, aside.resized((80, 60))),
        "cleaning": lambda: ibr.clean_depth(view.depth, view.color).depth,
        "mesh in light": lambda: ibr.render(donut, EYE, LIGHT),
        "slices": lambda: ibr.render(ibr.SlicedSurface(donut, **heights()), EYE),
        "relief in light": lambda: ibr.render(ibr.ReliefSurface(donut, **heights()), EYE, LIGHT),
        "depth object": lambda: ibr.render(ibr.DepthObject(taken), EYE),
        "hull": lambda: ibr.render(ibr.VisualHull(taken), EYE),
        "depth mesh": lambda: ibr.render(ibr.DepthMesh(view), beyond),
        "depth-mesh object": lambda: ibr.render(ibr.DepthMeshObject(taken), EYE),
    }


def draw(out: Path) -> None:
    """Draw all pictures into a file, with the device's name, and print their times."""
    arrays: dict[str, np.ndarray] = {}
    for name, call in pictures().items():
        start = time.perf_counter()
        drawn = call()
        print(f"{name}: {time.perf_counter() - start:.1f} s, kernels built", flush=True)
        parts = {"depth": drawn} if isinstance(drawn, np.ndarray) else {"color": drawn.color, "depth": drawn.depth}
        arrays |= {f"{name}/{part}": array for part, array in parts.items() if array is not None}
    device = next(device for device in ibr.devices() if device.works)
    told = {"device": device.name, "driver": device.driver, "version": device.version}
    np.savez_compressed(out, told=json.dumps(told), **arrays)  # pyright: ignore[reportArgumentType]


def compare(here: Path, there: Path) -> dict[str, dict[str, Any]]:
    """Compare two files: for each picture, count pixels that differ in any bit, and find the largest difference.

    Differences of colour are in levels of 255, differences of depth relative to the depth. `covered` counts the pixels
    that have depth in only one of two pictures.
    """
    rows: dict[str, dict[str, Any]] = {}
    with np.load(here) as one, np.load(there) as other:
        for key in sorted(set(one.files) - {"told"}):
            name, part = key.rsplit("/", 1)
            a, b = one[key].astype(np.float64), other[key].astype(np.float64)
            row = rows.setdefault(name, {"pixels": a.shape[0] * a.shape[1]})
            same = (a == b) | (np.isnan(a) & np.isnan(b))
            row[f"{part} differs"] = int((~same).any(-1).sum() if a.ndim == 3 else (~same).sum())
            if part == "depth":
                row["covered"] = int((np.isnan(a) != np.isnan(b)).sum())
                a, b = a / np.where(a > 0, a, 1), b / np.where(a > 0, a, 1)
            row[f"{part} most"] = float(np.nanmax(np.abs(a - b), initial=0))
    return rows


def told(file: Path) -> dict[str, str]:
    """Read the name of the device that drew the pictures of a file."""
    with np.load(file) as pictures:
        return json.loads(str(pictures["told"]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--compare", action="store_true")
    arguments = parser.parse_args()
    if arguments.compare:
        print(json.dumps(compare(*arguments.files), indent=1))
    else:
        draw(*arguments.files)


if __name__ == "__main__":
    main()
