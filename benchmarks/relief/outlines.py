"""``python -m benchmarks.relief.outlines [MESHES]``: compares outlines of reliefs on real meshes with cast rays.

An even relief has the same height everywhere: it moves the mesh's surface, and its outline, inwards by one distance.
The truth is ray cast by Open3D (Embree): the mesh's triangles are cut into finer triangles, whose corners are moved
along the normals. Where the mesh is thinner than the relief is deep, the truth is inside out.
"""

from __future__ import annotations

import functools
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

Float64 = NDArray[np.float64]
Mask = NDArray[np.bool_]

SIZE, TURNS, DEPTHS = 320, (20, 110, 200, 290), (0.01, 0.04)
"""Side of the pictures in pixels, degrees around the mesh, and depths relative to the diagonal of its box."""

HEIGHT = 0.5
"""Height of the even reliefs: the outline moves inwards by half of their depth."""

CUTS = 4
"""Number of pieces into which the truth cuts each side of a triangle."""

WHITE = np.full((2, 2, 3), 255, np.uint8)
LIGHT: dict[str, Any] = {"direction": (0.4, -1.0, -0.7), "ambient": 0.2}


def _file(name: str, axis: int | None = None, *, creased: bool = False) -> ibr.Mesh | Skip:
    """Load a mesh of the data folder. `axis`: the axis around which it gets uv; `creased`: without normals."""
    mesh = scanned(name)
    if isinstance(mesh, Skip) or axis is None:
        return mesh
    wrapped = models.with_cylindrical_uv(mesh, axis=axis)
    return ibr.Mesh(wrapped.vertices, wrapped.faces, uv=wrapped.uv) if creased else wrapped


MESHES: dict[str, Callable[[], ibr.Mesh | Skip]] = {
    "Spot": functools.partial(_file, "spot/spot_triangulated.obj"),
    "cow": functools.partial(_file, "cow.obj.gz", 1),
    "rocker-arm": functools.partial(_file, "rocker-arm.obj.gz", 1),
    "fandisk, smooth": functools.partial(_file, "fandisk.obj.gz", 1),
    "fandisk, creased": functools.partial(_file, "fandisk.obj.gz", 1, creased=True),
    "cheburashka": functools.partial(_file, "cheburashka.obj.gz", 1),
    "human": functools.partial(_file, "human_female_makehuman.obj.gz"),
    "teapot": functools.partial(_file, "teapot.obj.gz", 1),
}


@dataclass(frozen=True)
class Outline:
    """Figures of an even relief, over all pixels of all pictures.

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
        Holes whose rays hit the truth from behind, or at a point closer to the mesh than its displacement.
    false_shadow : float
        Fraction of the lit side's pixels that are in shadow, but lit in the truth.
    """

    carved: float
    iou: float
    bare_iou: float
    holes: int
    spurs: int
    inside_out: int
    false_shadow: float


def scene_of(vertices: NDArray[Any], faces: NDArray[Any]) -> Any:
    """Build Open3D's ray casting scene of triangles."""
    scene = import_module("open3d").t.geometry.RaycastingScene()
    scene.add_triangles(vertices.astype(np.float32), faces.astype(np.uint32))
    return scene


def carved_scene(relief: ibr.ReliefSurface) -> Any:
    """Build the true surface of an even relief, for ray casting."""
    mesh, offsets = relief.drawn, relief.offsets
    parts = [(i, j) for i in range(CUTS + 1) for j in range(CUTS + 1 - i)]
    number = {part: k for k, part in enumerate(parts)}
    weights = np.array([(CUTS - i - j, i, j) for i, j in parts]) / CUTS
    points = np.einsum("kw,twc->tkc", weights, mesh.vertices.astype(np.float64)[mesh.faces])
    ahead, lengths = (np.einsum("kw,twc->tkc", weights, rows[mesh.faces]) for rows in (offsets, _lengths(offsets)))
    points -= (1 - HEIGHT) * lengths * ahead / np.maximum(_lengths(ahead), 1e-12)
    cells = [(number[i, j], number[i + 1, j], number[i, j + 1]) for i, j in number if i + j < CUTS]
    cells += [(number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]) for i, j in number if i + j < CUTS - 1]
    faces = np.arange(len(points))[:, None, None] * len(parts) + np.array(cells)
    return scene_of(points.reshape(-1, 3), faces.reshape(-1, 3))


def _lengths(vectors: Float64) -> Float64:
    return np.linalg.norm(vectors, axis=-1, keepdims=True)


def around(mesh: ibr.Mesh, turn: float, size: int = SIZE) -> ibr.Camera:
    """A camera at `turn` degrees around a mesh's y axis, slightly above it."""
    low, high = (np.asarray(corner, np.float64) for corner in mesh.bounds)
    middle, extent, angle = (low + high) / 2, float(np.linalg.norm(high - low)), np.radians(turn)
    away = np.array([np.sin(angle), 0.35, np.cos(angle)])
    return ibr.Camera.look_at(middle + 1.15 * extent * away, middle, (0, 1, 0), (size, size), fov_y=42)


def extent_of(mesh: ibr.Mesh) -> float:
    """Length of the diagonal of a mesh's bounding box."""
    return float(np.linalg.norm(np.subtract(*mesh.bounds)))


def even_relief(mesh: ibr.Mesh, depth: float, **options: Any) -> ibr.ReliefSurface:
    """A relief whose surface lies at half of its depth everywhere; `depth` is relative to the mesh's extent."""
    return ibr.ReliefSurface(mesh, np.full((4, 4), HEIGHT, np.float32), WHITE, depth * extent_of(mesh), **options)


def measure(mesh: ibr.Mesh, depth: float, size: int = SIZE, **options: Any) -> Outline:
    """Measure an even relief on a mesh, from all sides."""
    relief = even_relief(mesh, depth, **options)
    scene, base = carved_scene(relief), scene_of(mesh.vertices, mesh.faces)
    light, plain = (ibr.Light(**LIGHT, shadow_size=side) for side in (1024, 0))
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
        counts += (_inside_out(base, rays, hits, (1 - HEIGHT) * relief.scale, np.flatnonzero(holes)),)
        rows.append((*counts, (dark & is_lit).sum(), (told & true & ours).sum()))
    sums = np.sum(rows, axis=0, dtype=float)
    carved, should, both, either, bare_both, bare_either, empty, spurs, inside_out, dark, told = sums
    pixels = int(empty), int(spurs), int(inside_out)
    return Outline(carved / should, both / either, bare_both / bare_either, *pixels, dark / told)


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
    """Count holes whose rays hit the truth from behind, or at less than 0.9 of its displacement from the mesh."""
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
        for depth in DEPTHS:
            found = measure(mesh, depth, **options)
            carved, iou, bare, holes, spurs, inside_out, dark = astuple(found)
            shares = [f"{carved:.2f}", f"{iou:.3f}", f"{bare:.3f}"]
            yield [name, f"{depth:g}", *shares, f"{holes}", f"{inside_out}", f"{spurs}", f"{dark:.2%}"]


if __name__ == "__main__":
    head = ["mesh", "depth", "carved share", "IoU", "IoU of the bare mesh", "holes, px", "inside out", "spurs, px"]
    head += ["false shadow"]
    print(table(head, list(lines(sys.argv[1:] or list(MESHES)))))
