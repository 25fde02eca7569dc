"""Times pictures of Gaussians, and compares them with Open3D on a software Vulkan driver and with float64 in NumPy.

The wall's and the processor's time of a picture run from the cloud on the device to NumPy arrays.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from benchmarks.cases import Plan, Size
from benchmarks.gaussians import clouds, lavapipe
from benchmarks.gaussians.twin import blended
from benchmarks.results import Parameter, Record, Skip
from benchmarks.runner import Case, Work

OURS, PEER, REFERENCE = "ibr.render", lavapipe.NAME, "NumPy, float64"
PLANES, CENTERS = "ibr.render, planes", "NumPy, centres"
WALL, PROCESSOR, FIRST = "end to end", "processor time", "first picture"
BLACK, CHANGED, DIFFERENCE, OFF, NEAR = "black tiles", "changed pixels", "difference", "off", "near"

DEGREES = (0, 3)
RATES = {500_000: 10, 1_000_000: 6}
"""Least pictures a second, by number of Gaussians."""
DEGREE_BAR, PEER_BAR, PLANE_BAR = 1.3, 0.1, 0.99
"""Most times degree 3 over degree 0; most of the peer's processor time; least share of the pixels near the plane."""
NEAR_DEPTH = 1e-3  # relative error
TILE = 16  # side of the peer's tiles in pixels
LIGHT = 8  # levels; darker pixels may be black
FIRSTS = 3


def cases(plan: Plan) -> Iterator[Case]:
    """Yield a case for each cloud, for the peer's pictures of it, for the reference's, and for the plane."""
    for count, turns in plan.gaussians.items():
        for kind in clouds.KINDS:
            parameters: dict[str, Parameter] = {"scene": kind, "gaussians": count}
            yield Case(parameters, functools.partial(_drawn, kind, count, plan.gaussians_size, turns))
            yield Case(parameters, functools.partial(_peer, kind, count, plan.gaussians_size, plan.gaussians_peer))
    for kind in clouds.KINDS:
        count = min(plan.gaussians)
        work = functools.partial(_reference, kind, count, plan.gaussians_size)
        yield Case({"scene": kind, "gaussians": count}, work)
    yield Case({"scene": "plane"}, functools.partial(_plane, plan.gaussians_size))


def _drawn(kind: str, count: int, size: Size, turns: int) -> Work:
    """Draw the cloud of each degree from cameras along a path, in turns, and new clouds from the first camera."""
    made = {degree: clouds.cloud(kind, count, degree) for degree in DEGREES}
    cameras = clouds.path(kind, size, turns)
    for cloud in made.values():
        ibr.render(cloud, cameras[0])

    def read() -> Iterator[Record]:
        times = {(quantity, degree): list[float]() for quantity in (WALL, PROCESSOR, FIRST) for degree in DEGREES}
        for camera in cameras:
            for degree, cloud in made.items():
                start, used = time.perf_counter(), time.process_time()
                ibr.render(cloud, camera)
                times[WALL, degree].append(1e3 * (time.perf_counter() - start))
                times[PROCESSOR, degree].append(1e3 * (time.process_time() - used))
        for _ in range(FIRSTS):
            for degree, one in made.items():
                start = time.perf_counter()
                new = ibr.Gaussians(one.means, one.scales, one.rotations, one.opacities, sh=one.sh)
                ibr.render(new, cameras[0])
                times[FIRST, degree].append(1e3 * (time.perf_counter() - start))
        for (quantity, degree), values in times.items():
            yield Record(OURS, quantity, "ms", {"scene": kind, "gaussians": count, "degree": degree}, values)

    return Work(read=read)


def _peer(kind: str, count: int, size: Size, pictures: int) -> Work | Skip:
    """Draw a cloud by the peer: the first camera twice, as the first picture prepares the cloud, then others."""
    cloud, cameras = clouds.cloud(kind, count, 0), clouds.path(kind, size, pictures)
    parameters: dict[str, Parameter] = {"scene": kind, "gaussians": count, "degree": 0}
    found = lavapipe.drawn(cloud, [cameras[0], *cameras])
    if isinstance(found, Skip):
        return found

    def read() -> Iterator[Record]:
        yield Record(PEER, FIRST, "ms", parameters, found.wall[:1])
        yield Record(PEER, WALL, "ms", parameters, found.wall[1:])
        yield Record(PEER, PROCESSOR, "ms", parameters, found.processor[1:])
        exact = [ibr.render(cloud, camera).color for camera in cameras]
        pairs = list(zip(found.pictures[1:], exact, strict=True))
        black = [float(black_tiles(picture, right)) for picture, right in pairs]
        levels = [float(np.abs(picture.astype(float) - right).mean()) for picture, right in pairs]
        yield Record(PEER, BLACK, "count", parameters, black)
        yield Record(PEER, DIFFERENCE, "count", parameters, levels)
        changed = (found.pictures[0] != found.pictures[1]).any(axis=2).mean()
        yield Record(PEER, CHANGED, "share", parameters, [float(changed)])

    return Work(read=read)


def black_tiles(picture: NDArray[np.uint8], right: NDArray[Any]) -> int:
    """Count the tiles that are black at half of their pixels or more, at which the right picture is not."""
    wrong = ~picture.any(axis=2) & (right.max(axis=2) > LIGHT)
    rows, columns = (side // TILE for side in wrong.shape)
    tiles = wrong[: rows * TILE, : columns * TILE].reshape(rows, TILE, columns, TILE)
    return int((tiles.mean(axis=(1, 3)) >= 0.5).sum())


def _reference(kind: str, count: int, size: Size) -> Work:
    """Compare a picture with float64, and time this once."""
    cloud, (camera,) = clouds.cloud(kind, count, 0), clouds.path(kind, size, 1)
    parameters: dict[str, Parameter] = {"scene": kind, "gaussians": count, "degree": 0}

    def read() -> Iterator[Record]:
        start = time.perf_counter()
        color, _, _ = blended([cloud], camera)
        yield Record(REFERENCE, WALL, "ms", parameters, [1e3 * (time.perf_counter() - start)])
        error = np.abs(ibr.render(cloud, camera).color - 255 * color).max(axis=2)
        yield Record(OURS, OFF, "share", parameters, [float((error > 1).mean())])

    return Work(read=read)


def _plane(size: Size) -> Work:
    """Compare the depth of flat Gaussians on a slanted plane with the plane's, by planes and by centres."""
    normal, through, apart = np.array([0.6, -0.5, -0.62]), np.array([0.0, 0.0, 4.0]), 12.0 / size[0]
    (camera,) = clouds.path("cloud", size, 1)
    axes = np.linalg.svd(normal[None])[2][1:]
    steps = np.arange(-4, 4, apart)
    a, b = (each.reshape(-1, 1) for each in np.meshgrid(steps, steps))
    means = through + a * axes[0] + b * axes[1]
    count = len(means)
    scales, colors = np.tile([apart, apart, 0.0], (count, 1)), np.full((count, 3), 0.5, np.float32)
    rotations = clouds.turned_to(np.tile(normal, (count, 1)), np.zeros(count))
    cloud = ibr.Gaussians(means, scales, rotations, np.full(count, 0.9), colors=colors)
    y, x = np.mgrid[: size[1], : size[0]]
    rays = camera.unproject(np.column_stack([x.ravel(), y.ravel()]), np.ones(x.size)) - camera.center
    true = ((through - camera.center) @ normal / (rays @ normal)).reshape(x.shape)

    def read() -> Iterator[Record]:
        found = {PLANES: ibr.render(cloud, camera).depth, CENTERS: blended([cloud], camera, planes=False)[2]}
        seen = np.isfinite(found[PLANES])
        parameters: dict[str, Parameter] = {"scene": "plane", "gaussians": count, "covered": float(seen.mean())}
        for name, depth in found.items():
            error = np.abs(depth / true - 1)[seen]
            yield Record(name, NEAR, "share", parameters, [float((error <= NEAR_DEPTH).mean())])
            yield Record(name, DIFFERENCE, "share", parameters, [float(np.percentile(error, 99))])

    return Work(read=read)
