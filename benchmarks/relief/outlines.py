"""``python -m benchmarks.relief.outlines [MESHES]``: compares reliefs on real and on coarse meshes with cast rays.

An even relief has the same height everywhere: it moves the mesh's surface, and its outline, inwards by one distance.
Hills also show whether rays meet the map in the right places. The truth is ray cast by Open3D (Embree): the mesh's
triangles are cut into finer triangles, whose corners are moved along the interpolated normals. Where the mesh is
thinner than the relief is deep, the truth is inside out.
"""

from __future__ import annotations

import functools
import itertools
import sys
from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from benchmarks.results import Skip
from benchmarks.scenes import scanned
from benchmarks.tables import table
from pyibr.capture import models
from pyibr.meshes.heights import height_at

Float64 = NDArray[np.float64]
Mask = NDArray[np.bool_]

SIZE, TURNS, DEPTHS = 320, (20, 110, 200, 290), (0.01, 0.04)
"""Side of the pictures in pixels, degrees around the mesh, and depths relative to the diagonal of its box."""

TILES = (4, 4)
"""Repetitions of the maps along u and v."""

CUTS = 4
"""Number of pieces into which the truth cuts each side of a triangle, and each texel along the sides."""

WHITE = np.full((2, 2, 3), 255, np.uint8)
LIGHT: dict[str, Any] = {"direction": (0.4, -1.0, -0.7), "ambient": 0.2}


def _file(name: str, axis: int | None = None, *, creased: bool = False) -> ibr.Mesh | Skip:
    """Load a mesh of the data folder. `axis`: the axis around which it gets uv; `creased`: without normals."""
    mesh = scanned(name)
    if isinstance(mesh, Skip) or axis is None:
        return mesh
    wrapped = models.with_cylindrical_uv(mesh, axis=axis)
    return ibr.Mesh(wrapped.vertices, wrapped.faces, uv=wrapped.uv) if creased else wrapped


def cube(cells: int = 1) -> ibr.Mesh:
    """Make a cube of 6 x cells x cells squares with hard edges; each side has uv from (0, 0) to (1, 1)."""
    at = np.linspace(0, 1, cells + 1)
    u, v = (values.ravel() for values in np.meshgrid(at, at))
    i = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    square = np.concatenate([np.stack([i, i + 1, i + cells + 2], 1), np.stack([i, i + cells + 2, i + cells + 1], 1)])
    top = np.stack([u - 0.5, v - 0.5, np.full_like(u, 0.5)], axis=1)
    turned = [np.roll(top, axis, axis=1) for axis in range(3)]
    points = np.concatenate([*turned, *(side * (-1, -1, -1) for side in turned)])
    faces = [(square if side < 3 else square[:, ::-1]) + side * u.size for side in range(6)]
    return ibr.Mesh(points, np.concatenate(faces), uv=np.tile(np.stack([u, v], axis=1), (6, 1)))


MESHES: dict[str, Callable[[], ibr.Mesh | Skip]] = {
    "Spot": functools.partial(_file, "spot/spot_triangulated.obj"),
    "cow": functools.partial(_file, "cow.obj.gz", 1),
    "rocker-arm": functools.partial(_file, "rocker-arm.obj.gz", 1),
    "fandisk, smooth": functools.partial(_file, "fandisk.obj.gz", 1),
    "fandisk, creased": functools.partial(_file, "fandisk.obj.gz", 1, creased=True),
    "cheburashka": functools.partial(_file, "cheburashka.obj.gz", 1),
    "human": functools.partial(_file, "human_female_makehuman.obj.gz"),
    "teapot": functools.partial(_file, "teapot.obj.gz", 1),
    "cube of 12 triangles": cube,
    "torus of 6 sides": functools.partial(models.donut, 6),
}


def _hills(texels: int = 16) -> NDArray[np.float32]:
    """Smooth heights from 0.1 to 0.9 that tile."""
    across, down = np.sin(2 * np.pi * (np.indices((texels, texels)) + 0.5) / texels)
    return np.asarray(0.5 + 0.4 * across * down, np.float32)


HEIGHTS: dict[str, NDArray[np.float32]] = {"even": np.full((4, 4), 0.5, np.float32), "hills": _hills()}
"""Maps with a mean of 0.5: outlines move inwards by about half of the relief's depth."""


@dataclass(frozen=True)
class Outline:
    """Figures of a relief, over all pixels of all pictures.

    Attributes
    ----------
    carved : float
        Number of pixels that the relief's outline uncovers from the bare mesh, divided by the true number.
    iou : float
        Intersection over union of the relief's and the true pixels.
    bare_iou : float
        Intersection over union of the bare mesh's and the true pixels.
    holes, spurs : int
        Empty pixels at least two pixels inside the true outline, and covered pixels at least two pixels outside.
    inside_out : int
        Holes whose rays hit the truth from behind, or at a point closer to the mesh than the least displacement.
    false_shadow : float
        Fraction of the lit side's pixels that are in shadow, but lit in the truth.
    off : float
        Fraction of the pixels, at least two pixels inside the true outline, whose depth is wrong by more than a tenth
        of the relief's depth. Pixels that see the truth from behind do not count.
    """

    carved: float
    iou: float
    bare_iou: float
    holes: int
    spurs: int
    inside_out: int
    false_shadow: float
    off: float


def scene_of(vertices: NDArray[Any], faces: NDArray[Any]) -> Any:
    """Build Open3D's ray casting scene of triangles."""
    scene = import_module("open3d").t.geometry.RaycastingScene()
    scene.add_triangles(vertices.astype(np.float32), faces.astype(np.uint32))
    return scene


def carved_scene(relief: ibr.ReliefSurface, fine: int = CUTS) -> Any:
    """Build the true surface of a relief, for ray casting: with `fine` cells for each side of a triangle or texel."""
    mesh, uv = relief.drawn, np.asarray(relief.drawn.uv, np.float64) * relief.tiles
    texels = np.ptp(uv[mesh.faces], axis=1) * relief.height.shape[::-1] * (np.ptp(relief.height) > 0)
    cuts = max(fine, int(np.ceil(fine * np.quantile(texels, 0.99))))
    (points, offsets, places), faces = subdivided(mesh.faces, cuts, mesh.vertices, relief.offsets, uv)
    return scene_of(points - (1 - height_at(relief.height, places, relief.wrap))[:, None] * offsets, faces)


def subdivided(faces: NDArray[Any], cuts: int, *values: NDArray[Any]) -> tuple[list[Float64], NDArray[np.intp]]:
    """Cut each triangle into `cuts` x `cuts` triangles: the vertices' interpolated values, and the new triangles."""
    parts = [(i, j) for i in range(cuts + 1) for j in range(cuts + 1 - i)]
    number = {part: k for k, part in enumerate(parts)}
    weights = np.array([(cuts - i - j, i, j) for i, j in parts]) / cuts
    between = [np.einsum("kw,twc->tkc", weights, rows.astype(np.float64)[faces]) for rows in values]
    cells = [(number[i, j], number[i + 1, j], number[i, j + 1]) for i, j in number if i + j < cuts]
    cells += [(number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]) for i, j in number if i + j < cuts - 1]
    made = np.arange(len(faces))[:, None, None] * len(parts) + np.array(cells)
    return [rows.reshape(-1, rows.shape[-1]) for rows in between], made.reshape(-1, 3)


def around(mesh: ibr.Mesh, turn: float, size: int = SIZE) -> ibr.Camera:
    """A camera at `turn` degrees around a mesh's y axis, slightly above it."""
    low, high = (np.asarray(corner, np.float64) for corner in mesh.bounds)
    middle, extent, angle = (low + high) / 2, float(np.linalg.norm(high - low)), np.radians(turn)
    away = np.array([np.sin(angle), 0.35, np.cos(angle)])
    return ibr.Camera.look_at(middle + 1.15 * extent * away, middle, (0, 1, 0), (size, size), fov_y=42)


def extent_of(mesh: ibr.Mesh) -> float:
    """Length of the diagonal of a mesh's bounding box."""
    return float(np.linalg.norm(np.subtract(*mesh.bounds)))


def measure(mesh: ibr.Mesh, depth: float, size: int = SIZE, heights: str = "even", **options: Any) -> Outline:
    """Measure a relief on a mesh, from all sides; `depth` is relative to the mesh's extent."""
    relief = ibr.ReliefSurface(mesh, HEIGHTS[heights], WHITE, depth * extent_of(mesh), tiles=TILES, **options)
    scene, base = carved_scene(relief), scene_of(mesh.vertices, mesh.faces)
    light, plain = (ibr.Light(**LIGHT, shadow_size=side) for side in (1024, 0))
    least = relief.scale * (1 - float(relief.height.max()))
    rows = []
    for turn in TURNS:
        camera = around(mesh, turn, size)
        rays = _rays(camera)
        hits = scene.cast_rays(rays.astype(np.float32))
        true = np.isfinite(hits["t_hit"].numpy()).reshape(size, size)
        bare = ibr.render(ibr.Mesh(mesh.vertices, mesh.faces), camera).valid
        lit, unshadowed = (ibr.render(relief, camera, lamp) for lamp in (light, plain))
        ours = lit.valid
        told = unshadowed.color.max(axis=2) > 75
        dark = told & (lit.color.max(axis=2) < unshadowed.color.max(axis=2) - 15)
        is_lit = _lit(scene, rays, hits, relief.scale).reshape(size, size)
        counts = (bare & ~ours).sum(), (bare & ~true).sum(), (ours & true).sum(), (ours | true).sum()
        counts += (bare & true).sum(), (bare | true).sum()
        holes = _shrunk(true) & ~ours
        counts += holes.sum(), (ours & ~_grown(true)).sum()
        counts += (_inside_out(base, rays, hits, least, np.flatnonzero(holes)),)
        front = (hits["primitive_normals"].numpy() * rays[:, 3:]).sum(axis=1).reshape(size, size) < 0
        inner = _shrunk(true) & ours & front
        off = inner & (np.abs(lit.depth - hits["t_hit"].numpy().reshape(size, size)) > 0.1 * relief.scale)
        rows.append((*counts, (dark & is_lit).sum(), (told & true & ours).sum(), off.sum(), inner.sum()))
    sums = np.sum(rows, axis=0, dtype=float)
    carved, should, both, either, bare_both, bare_either, empty, spurs, inside_out, dark, told, off, inner = sums
    pixels = int(empty), int(spurs), int(inside_out)
    return Outline(carved / should, both / either, bare_both / bare_either, *pixels, dark / told, off / inner)


def _rays(camera: ibr.Camera) -> Float64:
    """(pixels, 6) origins and directions of rays; the directions have planar depth 1."""
    y, x = np.mgrid[: camera.height, : camera.width]
    ahead = camera.unproject(np.column_stack([x.ravel(), y.ravel()]), np.ones(x.size)) - camera.center
    return np.concatenate([np.broadcast_to(camera.center, ahead.shape), ahead], axis=1)


def _lit(scene: Any, rays: Float64, hits: Any, scale: float) -> Mask:
    """(pixels,) whether the light reaches the points that rays hit."""
    t = hits["t_hit"].numpy().astype(np.float64)
    met = np.isfinite(t)
    back = -np.array(LIGHT["direction"]) / np.linalg.norm(LIGHT["direction"])
    normals = hits["primitive_normals"].numpy().astype(np.float64)
    normals *= -np.sign((normals * rays[:, 3:]).sum(axis=1, keepdims=True))
    from_ = rays[:, :3] + np.where(met, t, 0)[:, None] * rays[:, 3:] + 0.05 * scale * normals
    to_light = np.concatenate([from_, np.broadcast_to(back, from_.shape)], axis=1).astype(np.float32)
    return met & ~scene.test_occlusions(to_light).numpy()


def _inside_out(base: Any, rays: Float64, hits: Any, moved: float, holes: NDArray[np.intp]) -> int:
    """Count holes whose rays hit the truth from behind, or at less than 0.9 of its least displacement from the mesh."""
    t, ahead = hits["t_hit"].numpy()[holes, None].astype(np.float64), rays[holes, 3:]
    from_behind = (hits["primitive_normals"].numpy()[holes] * ahead).sum(axis=1) > 0
    points = (rays[holes, :3] + t * ahead).astype(np.float32)
    return int((from_behind | (base.compute_distance(points).numpy() < 0.9 * moved)).sum())


def _grown(mask: Mask) -> Mask:
    """Add all pixels within two pixels of a mask."""
    padded, (height, width) = np.pad(mask, 2), mask.shape
    return np.any([padded[y : y + height, x : x + width] for y in range(5) for x in range(5)], axis=0)


def _shrunk(mask: Mask) -> Mask:
    """Remove the pixels within two pixels of a mask's outline."""
    return ~_grown(~mask)


def lines(names: list[str], **options: Any) -> Iterator[list[str]]:
    """Rows of the table for the meshes that are available."""
    for name in names:
        mesh = MESHES[name]()
        if isinstance(mesh, Skip):
            continue
        for depth, heights in itertools.product(DEPTHS, HEIGHTS):
            found = measure(mesh, depth, heights=heights, **options)
            carved, iou, bare, holes, spurs, inside_out, dark, off = astuple(found)
            shares = [f"{carved:.2f}", f"{iou:.3f}", f"{bare:.3f}"]
            counts = [f"{holes}", f"{inside_out}", f"{spurs}"]
            yield [name, f"{depth:g}", heights, *shares, *counts, f"{dark:.2%}", f"{off:.2%}"]


if __name__ == "__main__":
    head = ["mesh", "depth", "heights", "carved share", "IoU", "IoU of the bare mesh", "holes, px", "inside out"]
    head += ["spurs, px", "false shadow", "depth off"]
    print(table(head, list(lines(sys.argv[1:] or list(MESHES)))))
