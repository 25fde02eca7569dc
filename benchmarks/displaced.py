"""Compares reliefs and sliced surfaces with triangle meshes that are cut from the same base: time at equal error.

A base of few triangles carries a height map. The true surface is the base, cut so finely that each texel has several
vertices, which are displaced along the interpolated normals; Embree (Open3D) casts rays at it. Coarser cuts are the
meshes that are drawn. All subjects thus have one base, so that its facets are no subject's error.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from benchmarks.cases import Plan
from benchmarks.relief.outlines import scene_of, subdivided
from benchmarks.results import Parameter, Record, Skip
from benchmarks.runner import Case, Subject, Work
from pyibr.capture import models
from pyibr.meshes.heights import height_at

Heights = NDArray[np.float32]

SCALE = 0.1  # greatest displacement: a quarter of the tube's radius
CUTS = (2, 4, 8, 16, 24, 32, 48)
"""Numbers of pieces into which each side of the base's triangles is cut."""
EXACT = "relief, exact"
OURS: dict[str, Callable[..., Any]] = {
    EXACT: ibr.ReliefSurface,
    "relief, approximate": functools.partial(ibr.ReliefSurface, distance="approximate"),
    "slices, by the view": functools.partial(ibr.SlicedSurface, slices="view"),
    "64 slices": functools.partial(ibr.SlicedSurface, slices=64),
}


def mesh_name(cut: int) -> str:
    """Name of a mesh in results."""
    return f"mesh, cut {cut} x {cut}"


def cases(plan: Plan) -> Iterator[Case]:
    """Yield a case for each map and size of picture."""
    truths = functools.cache(lambda name: _cast(_cut(_base(), *MAPS[name], plan.displaced_truth)))
    for name in MAPS:
        for size, repeats in plan.displaced.items():
            parameters: dict[str, Parameter] = {"map": name, "size": f"{size[0]} x {size[1]}"}
            yield Case(parameters, functools.partial(_case, parameters, name, size, repeats, truths))


def _smooth() -> Heights:
    y, x = np.mgrid[:128, :128] * (2 * np.pi / 128)
    return (0.5 + 0.25 * np.sin(x + np.sin(y)) + 0.25 * np.cos(2 * y) * np.cos(x)).astype(np.float32)


def _rough(n: int = 1024) -> Heights:
    """Repeatable noise with more weight on longer waves, as in terrain."""
    waves = np.fft.rfft2(np.random.default_rng(3).normal(size=(n, n)))
    waves /= np.maximum(np.hypot(np.fft.fftfreq(n)[:, None], np.fft.rfftfreq(n)), 1 / n) ** 1.4
    heights = np.fft.irfft2(waves, s=(n, n))
    return ((heights - heights.min()) / np.ptp(heights)).astype(np.float32)


MAPS: dict[str, tuple[Heights, tuple[int, int]]] = {"smooth": (_smooth(), (6, 3)), "rough": (_rough(), (1, 1))}
"""By name: heights, and their repetitions along u and v."""


def _base() -> ibr.Mesh:
    return models.donut(24)


def _cut(base: ibr.Mesh, height: Heights, tiles: tuple[int, int], cut: int) -> ibr.Mesh:
    """Cut each triangle into cut x cut triangles, and displace their vertices inwards along the normals."""
    assert base.normals is not None and base.uv is not None
    (points, normals, uv), faces = subdivided(base.faces, cut, base.vertices, base.normals, base.uv)
    uv *= tiles
    points -= (1 - height_at(height, uv, ("repeat", "repeat"))[:, None]) * SCALE * normals
    return ibr.Mesh(points, faces, uv=uv)


def _cast(mesh: ibr.Mesh) -> Any | Skip:
    """Open3D's scene of a mesh."""
    try:
        return scene_of(mesh.vertices, mesh.faces)
    except ImportError as error:
        return Skip("Embree", str(error))


def _case(
    parameters: dict[str, Parameter], name: str, size: tuple[int, int], repeats: int, truths: Callable[[str], Any]
) -> Work | Skip:
    scene = truths(name)
    if isinstance(scene, Skip):
        return scene
    (height, tiles), base = MAPS[name], _base()
    color = np.full((2, 2, 3), 200, np.uint8)
    lower = base.replaced(vertices=base.vertices - np.float32(SCALE) * np.asarray(base.normals))  # slices rise above it
    things: dict[str, Any] = {
        way: make(lower if "slices" in way else base, height, color, SCALE, tiles=tiles) for way, make in OURS.items()
    }
    things |= {mesh_name(cut): _cut(base, height, tiles, cut).replaced(texture=color) for cut in CUTS}
    camera = ibr.Camera.look_at((1.7, -2.8, 2.2), (0, 0, 0), (0, 0, 1), size, fov_y=42)

    def read() -> Iterator[Record]:
        y, x = np.mgrid[: size[1], : size[0]]
        points = camera.unproject(np.stack([x, y], axis=-1).reshape(-1, 2).astype(float), np.ones(x.size))
        rays = np.concatenate([np.broadcast_to(camera.center, points.shape), points - camera.center], axis=1)
        truth = scene.cast_rays(rays.astype(np.float32))["t_hit"].numpy().reshape(x.shape)
        for way, thing in things.items():
            frame = ibr.render(thing, camera)
            solid = np.isfinite(truth)
            off = float(np.abs(frame.depth - truth)[frame.valid & solid].mean() / SCALE)
            yield Record(way, "depth error", "share", parameters, [off])
            same = float((frame.valid & solid).sum() / (frame.valid | solid).sum())
            yield Record(way, "silhouette (IoU)", "share", parameters, [same])
            yield Record(way, "memory", "bytes", parameters, [_bytes_of(thing, base, height)])

    subjects: dict[str, Subject] = {way: functools.partial(ibr.render, one, camera) for way, one in things.items()}
    return Work(subjects, repeats, read)


def _bytes_of(thing: Any, base: ibr.Mesh, height: Heights) -> int:
    """Bytes of vertices, triangles, uv, normals and heights, without colours."""
    mesh = thing if isinstance(thing, ibr.Mesh) else base
    arrays = [one for one in (mesh.vertices, mesh.faces, mesh.uv, mesh.normals) if one is not None]
    if isinstance(thing, ibr.ReliefSurface):
        arrays += [thing.levels.texels, thing.levels.bounds]
    elif isinstance(thing, ibr.SlicedSurface):
        arrays.append(height)
    return sum(one.nbytes for one in arrays)
