"""Compares relief mapping with the paper's frame rate and with Mesa's llvmpipe."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Any

import numpy as np

import pyibr as ibr
from benchmarks import llvmpipe
from benchmarks.cases import Plan
from benchmarks.results import Parameter, Record, Skip
from benchmarks.runner import Case, Subject, Work
from benchmarks.scenes import bricks, scanned
from pyibr.capture import models
from pyibr.opencl.device import current
from pyibr.opencl.memory import empty
from pyibr.picture.target import Target
from pyibr.relief import draw_relief

SIZE = (800, 600)
PLANE, PLANE_SAFE = "linear, 32 + 6 steps", "safe"
PEER, PEER_FLOAT = "llvmpipe, heights in 8 bits", "llvmpipe, heights in float"
PAPER_RATE = 85.0  # frames per second on a GeForce 6800 GT; the monitor allows no more
BARS = {"plane": 0.3, "same picture": 45.0}
SCENE_BARS = {"torus": ("linear", PAPER_RATE), "teapot": ("linear", PAPER_RATE), "room": ("safe", 25.0)}
"""By scene: the search, and the least frames per second that it must reach."""
ROOMS = ("room", "room, the light moves")
WAYS: dict[str, dict[str, Any]] = {
    "linear": {"search": "linear", "distance": "approximate"},
    "safe": {"search": "safe", "distance": "approximate"},
    "safe, exact": {"search": "safe", "distance": "exact"},
    "linear, exact": {"search": "linear", "distance": "exact"},
    "linear, equation 6": {"search": "linear", "distance": "perpendicular"},
    "flat (no silhouettes)": {"search": "linear", "silhouette": "none", "distance": "approximate"},
}
SAFE_STEPS = 0  # stands for the safe search in place of a number of steps
MAPS = ("bricks", "thin")
EQUAL = 2e-3  # fraction of pixels that may lie a texel too far, as the tests allow the safe search


def cases(plan: Plan) -> Iterator[Case]:
    """Yield the cases of the plane, of the scenes, and of numbers of steps."""
    yield Case({"case": "plane"}, functools.partial(_plane, plan.relief_plane))
    for name, repeats in plan.relief_scenes.items():
        scenes = ROOMS if name == "room" else (name,)
        for scene in scenes:
            make = _room if name == "room" else _scene
            yield Case({"case": "scene", "scene": scene}, functools.partial(make, scene, repeats))
    for name in MAPS:
        yield Case({"case": "steps", "map": name}, functools.partial(_steps, name, plan.relief_steps))


def _square() -> ibr.Mesh:
    corners, uv = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 0], [1, 0], [1, 1], [0, 1]]
    return ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3]], uv=uv)


def _plane(repeats: int) -> Work:
    """Time a relief that fills the picture, seen at some 40 degrees."""
    height, color = bricks()
    camera = ibr.Camera.look_at((0.5, 0.1, 0.35), (0.5, 0.5, 0), (0, 0, 1), SIZE, fov_y=30)
    linear, safe = (
        ibr.ReliefSurface(_square(), height, color, 0.03, tiles=(3, 3), search=s) for s in ("linear", "safe")
    )
    subjects: dict[str, Subject] = {
        PLANE: functools.partial(ibr.render, linear, camera),
        PLANE_SAFE: functools.partial(ibr.render, safe, camera),
    }
    peers: dict[str, llvmpipe.Picture] = {}
    if not isinstance(llvmpipe.context(), str):
        for name in (PEER, PEER_FLOAT):
            peers[name] = llvmpipe.relief(camera, linear, 0.01, 10, in_float=name == PEER_FLOAT)
            subjects[name] = peers[name].picture

    def read() -> Iterator[Record]:
        ours = ibr.render(linear, camera).color.astype(float)
        for name, peer in peers.items():
            error = float(np.square(ours - peer.picture()[0]).mean())
            yield Record(name, "agreement (PSNR)", "dB", {"case": "plane"}, [10 * np.log10(255**2 / error)])

    return Work(subjects, repeats, read)


def _base(name: str) -> tuple[ibr.Mesh, tuple[int, int], float] | Skip:
    """A mesh with uv, its tiles, and the relief's depth relative to the mesh's size."""
    if name == "torus":
        return models.donut(48), (10, 4), 0.02
    files = {"teapot": "teapot.obj.gz", "human": "human_male_makehuman.obj.gz", "spot": "spot/spot_triangulated.obj"}
    mesh = scanned(files[name])
    if isinstance(mesh, Skip):
        return mesh
    if name == "teapot":
        return models.with_cylindrical_uv(mesh, axis=1), (12, 5), 0.015
    return mesh, (24, 24), 0.004


def _scene(name: str, repeats: int) -> Work | Skip:
    base = _base(name)
    if isinstance(base, Skip):
        return base
    mesh, tiles, depth = base
    height, color = bricks()
    low, high = (np.asarray(corner, np.float64) for corner in mesh.bounds)
    middle, extent = 0.5 * (low + high), float(np.linalg.norm(high - low))
    up = (0, 0, 1) if name == "torus" else (0, 1, 0)
    away = np.array([0.4, -0.8, 0.6]) if name == "torus" else np.array([0.5, 0.35, 0.9])
    camera = ibr.Camera.look_at(middle + 1.15 * extent * away, middle, up, SIZE, fov_y=42)
    things = {way: ibr.ReliefSurface(mesh, height, color, depth * extent, tiles=tiles, **o) for way, o in WAYS.items()}
    parameters: dict[str, Parameter] = {"case": "scene", "scene": name}

    def read() -> Iterator[Record]:
        frame = ibr.render(things["safe"], camera)
        yield Record("safe", "coverage", "share", parameters, [float(frame.valid.mean())])
        yield Record("safe", "triangles", "count", parameters, [len(mesh.faces)])

    subjects: dict[str, Subject] = {way: functools.partial(ibr.render, thing, camera) for way, thing in things.items()}
    return Work(subjects, repeats, read)


def _room(name: str, repeats: int) -> Work:
    """Time a scene like the paper's figure 1: walls, floor, columns and a torus, all reliefs, with a spot's shadows.

    A light at rest keeps its shadow map while the scene stays the same; a moving light needs a new map in each frame.
    """
    height, color = bricks()
    quads = [
        ((-3, 2.2, 0), (6, 0, 0), (0, 0, 3)),
        ((-3, -3, 0), (0, 5.2, 0), (0, 0, 3)),
        ((-3, -3, 0), (6, 0, 0), (0, 5.2, 0)),
    ]
    bases: list[tuple[ibr.Mesh, tuple[int, int], float]] = []
    for corner, along, up in (np.array(sides, float) for sides in quads):
        corners = [corner, corner + along, corner + along + up, corner + up]
        uv = [[0, 1], [1, 1], [1, 0], [0, 0]]
        bases.append((ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3]], uv=uv), (5, 3), 0.12))
    for x in (-1.9, 0.1, 2.1):
        bases.append((_column(32, x, 1.2), (3, 4), 0.05))
    ring = models.donut(40, radius=0.62, tube=0.26)
    bases.append(
        (ibr.Mesh(np.add(ring.vertices, (0.5, -0.9, 0.24)), ring.faces, uv=ring.uv, normals=ring.normals), (7, 3), 0.06)
    )
    camera = ibr.Camera.look_at((2.7, -4.4, 2.1), (-0.2, 0.2, 0.9), (0, 0, 1), SIZE, fov_y=48)
    spot = functools.partial(ibr.Light, position=(2.6, -3.6, 4.4), direction=(-2.6, 3.9, -3.9), angle=75)
    things = {
        way: [ibr.ReliefSurface(m, height, color, s, tiles=t, **o) for m, t, s in bases] for way, o in WAYS.items()
    }
    parameters: dict[str, Parameter] = {"case": "scene", "scene": name}

    def read() -> Iterator[Record]:
        frame = ibr.render(things["safe"], camera, spot())
        yield Record("safe", "coverage", "share", parameters, [float(frame.valid.mean())])
        yield Record("safe", "triangles", "count", parameters, [sum(len(mesh.faces) for mesh, _, _ in bases)])

    def drawn(all_: list[ibr.ReliefSurface], light: ibr.Light | None) -> ibr.Frame:
        return ibr.render(all_, camera, light or spot())

    subjects: dict[str, Subject] = {
        way: functools.partial(drawn, all_, spot() if name == "room" else None) for way, all_ in things.items()
    }
    return Work(subjects, repeats, read)


def _column(sides: int, x: float, y: float) -> ibr.Mesh:
    """A cylinder of radius 0.32 from z = 0 to 3."""
    u, v = np.meshgrid(np.linspace(0, 1, sides + 1), np.linspace(0, 1, 9))
    normals = np.stack([np.cos(2 * np.pi * u), np.sin(2 * np.pi * u), 0 * u], axis=-1).reshape(-1, 3)
    points = 0.32 * normals + np.stack([x + 0 * u, y + 0 * u, 3 * v], axis=-1).reshape(-1, 3)
    i = (np.arange(8)[:, None] * (sides + 1) + np.arange(sides)).ravel()
    faces = np.concatenate([np.stack([i, i + 1, i + sides + 2], 1), np.stack([i, i + sides + 2, i + sides + 1], 1)])
    return ibr.Mesh(points, faces, uv=np.stack([u, -v], -1).reshape(-1, 2), normals=normals)


def _steps(name: str, steps: tuple[int, ...]) -> Work:
    """Count the misses of the linear search on a map seen at 15 degrees, and the steps and times of both searches."""
    height = bricks()[0]
    if name == "thin":
        height = np.full((256, 256), 40, np.uint8)
        height[8::32, 12::32] = 255
        height[::64] = 255
    white, angle = np.full((2, 2, 3), 200, np.uint8), np.radians(15)
    eye = np.array([0.5, 0.5, 0]) + 1.4 * np.array([0.3 * np.cos(angle), -0.95 * np.cos(angle), np.sin(angle)])
    camera = ibr.Camera.look_at(eye, (0.5, 0.5, 0), (0, 0, 1), SIZE, fov_y=30)
    things = {SAFE_STEPS: ibr.ReliefSurface(_square(), height, white, 0.05)}
    for n in steps:
        things[n] = ibr.ReliefSurface(_square(), height, white, 0.05, search="linear", steps=n)
    parameters: dict[str, Parameter] = {"case": "steps", "map": name}

    def read() -> Iterator[Record]:
        truth = ibr.render(things[SAFE_STEPS], camera)
        for n, thing in things.items():
            frame = ibr.render(thing, camera)
            missed = (frame.depth - truth.depth)[frame.valid] > 1 / 256
            yield Record(f"{n}", "missed", "share", parameters, [float(missed.mean())])
            yield Record(f"{n}", "steps", "count", parameters, [_mean_steps(thing, camera)])

    subjects: dict[str, Subject] = {f"{n}": functools.partial(ibr.render, thing, camera) for n, thing in things.items()}
    return Work(subjects, 5, read)


def _mean_steps(thing: ibr.ReliefSurface, camera: ibr.Camera) -> float:
    """Mean steps of a ray. Bisections count as steps; within a cell, the safe search takes one step."""
    counts = empty((camera.height, camera.width, 2), np.int32)
    counts.fill(0)
    with current().call():
        draw_relief(Target(camera, np.dtype(np.uint8)), thing, None, counters=counts)
        searches, steps = counts.to_host().reshape(-1, 2).sum(axis=0, dtype=np.int64)
    return float(steps / searches)
