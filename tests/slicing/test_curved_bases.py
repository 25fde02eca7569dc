"""Sliced surfaces on curved base meshes, compared with the base meshes moved along their normals."""

from __future__ import annotations

from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import models
from pyibr.core.camera import Camera
from tests.boxes import box
from tests.displaced import Solid, finely_displaced, interior, square
from tests.embree import embree, true_depth
from tests.relief.solids import grid
from tests.relief.solids import torus as ring
from tests.relief.test_normals import rolling
from tests.slicing.test_surfaces import SCALE, heights

EVEN = np.full((8, 8), 0.5, np.float32)
EVEN_COLOR = np.full((2, 2, 3), 255, np.uint8)
SLICINGS = ["surface", "orthogonal", "screen"]
EYES = ABOVE, ASLANT, GRAZING = (0.3, 0.2, 3.4), (1.6, -2.6, 2), (2.9, 1.2, 0.25)


def lines() -> np.ndarray:
    """Thin black lines on white, on which distortions of a texture are visible."""
    y, x = np.mgrid[:256, :256]
    color = np.full((256, 256, 3), 255, np.uint8)
    color[(x % 32 < 3) | (y % 32 < 3)] = 0
    return color


@cache
def blob() -> ibr.Mesh:
    """A coarse ball with bumps, saddles and legs, like the mesh of an animal, with triangles of many sizes."""
    rng = np.random.default_rng(2)
    v, u = np.mgrid[:13, :25]
    turn, polar = 2 * np.pi * (u + 0.3 * np.sin(v)) / 24, np.pi * (0.005 + 0.99 * v / 12)
    way = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1)
    reach = np.ones(way.shape[:2])
    for bump in rng.normal(size=(9, 3)):
        reach += 0.35 * np.exp(8 * (way @ (bump / np.linalg.norm(bump)) - 1))
    i = (v * 25 + u)[:-1, :-1].ravel()
    faces = np.concatenate([np.stack([i, i + 25, i + 1], 1), np.stack([i + 1, i + 25, i + 26], 1)])
    points = (way * reach[..., None]).reshape(-1, 3)
    return ibr.Mesh(points, faces, uv=np.stack([u / 24, v / 12], -1).reshape(-1, 2))


def crate() -> ibr.Mesh:
    """A box with smooth normals, so that flat polygons have very different normals at their corners."""
    mesh = box()
    normals = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1)[:, None]
    return ibr.Mesh(mesh.vertices, mesh.faces, uv=mesh.uv, normals=normals)


BASES: dict[str, Any] = {
    "donut of 6": (lambda: models.donut(6), 0.3),
    "donut of 12": (lambda: models.donut(12), 0.3),
    "donut of 25": (lambda: models.donut(25), 0.1),
    "fat donut of 25": (lambda: models.donut(25), 0.3),
    "blob": (blob, 0.2),
    "crate": (crate, 0.3),
}


def moved(base: ibr.Mesh, by: float) -> ibr.Mesh:
    """The mesh with its vertices moved by `by` along its normals, like a slice at that height."""
    normals = base.normals if base.normals is not None else base.smooth_normals
    return ibr.Mesh(base.vertices + by * normals, base.faces, uv=np.asarray(base.uv) * (5, 2), texture=lines())


# Each slicing with each base, and each eye with some bases; in quick tests, each slicing with two eyes.
VIEWED = [
    pytest.param(name, way, EYES[(i + j) % 3], marks=pytest.mark.thorough if (j - i - i // 3) % 3 else ())
    for i, name in enumerate(BASES)
    for j, way in enumerate(SLICINGS)
]


@pytest.mark.parametrize(("name", "slicing", "eye"), VIEWED)
def test_even_heights_show_the_moved_mesh(name, slicing, eye):
    make, scale = BASES[name]
    filtered: dict[str, Any] = {"samples": 4, "anisotropy": 16}  # else meshes seen obliquely are blurred
    base, camera = make(), Camera.look_at(eye, (0, 0, 0), (0, 0, 1), (160, 120), fov_y=42)
    truth = ibr.render(moved(base, 0.5 * scale), camera, **filtered)
    thing = ibr.SlicedSurface(base, EVEN, lines(), scale, tiles=(5, 2), slices=512, slicing=slicing)
    seen = ibr.render(thing, camera, **filtered)
    both = truth.valid & seen.valid
    assert both.sum() >= 0.99 * (truth.valid | seen.valid).sum()
    # Lines are one or two pixels thick. At outlines in front of the surface, one pixel in a hundred may be wrong.
    assert (np.abs(truth.color.astype(int) - seen.color)[both].max(axis=-1) > 64).mean() <= 0.01


@cache
def hilly_donut(sides: int) -> tuple[ibr.Mesh, list[tuple[Camera, np.ndarray]]]:
    """A donut, and its true depths for three cameras when it is displaced by 0.3."""
    base = models.donut(sides)
    fine = embree(finely_displaced(base, heights(), 0.3, (5, 2), cells=-(-640 // sides)))  # 4 cells per texel
    cameras = [Camera.look_at(eye, (0, 0, 0), (0, 0, 1), (120, 90), fov_y=42) for eye in EYES]
    return base, [(camera, true_depth(fine, camera)) for camera in cameras]


@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
@pytest.mark.parametrize("sides", [12, pytest.param(25, marks=pytest.mark.thorough)])
def test_depth_error_with_hills_falls_with_slices(sides, slicing):
    (base, seen), scale, counts = hilly_donut(sides), 0.3, (32, 256)
    means = []
    for slices in counts:
        thing = ibr.SlicedSurface(base, heights(), EVEN_COLOR, scale, tiles=(5, 2), slices=slices, slicing=slicing)
        off = []
        for camera, truth in seen:
            frame, inside = ibr.render(thing, camera), interior(truth, 0.05)
            assert frame.valid[inside].all()
            off.append(np.abs(frame.depth - truth)[inside])
        means.append(np.concatenate(off).mean())
        assert means[-1] <= scale / slices
    assert np.polyfit(np.log(counts), np.log(means), 1)[0] <= -0.9, means


def test_slices_by_view_are_near_the_true_surface():
    base, scale = models.donut(12), 0.3
    camera = Camera.look_at(ASLANT, (0, 0, 0), (0, 0, 1), (160, 120), fov_y=42)
    truth = true_depth(embree(finely_displaced(base, heights(), scale, (5, 2), cells=54)), camera)
    frame = ibr.render(ibr.SlicedSurface(base, heights(), EVEN_COLOR, scale, tiles=(5, 2), slices="view"), camera)
    inside, pixel = interior(truth, 0.075), 3.7 / camera.K[0, 0]
    assert frame.valid[inside].all()
    assert np.abs(frame.depth - truth)[inside].mean() <= 0.15 * pixel  # the manual says an eighth of a pixel


def test_slices_beside_curved_prisms_change_the_cost_alone():
    camera = Camera.look_at(ASLANT, (0, 0, 0), (0, 0, 1), (160, 120), fov_y=42)
    frames = [
        ibr.render(
            ibr.SlicedSurface(
                models.donut(12), heights(), lines(), 0.3, tiles=(5, 2), slicing="screen", clipped=clipped
            ),
            camera,
        )
        for clipped in (True, False)
    ]
    assert (frames[0].valid != frames[1].valid).mean() < 1e-3
    both = frames[0].valid & frames[1].valid
    # In 1 % of the pixels rays graze the surface, and interpolation between slices decides which slice shows.
    assert (np.abs(frames[0].depth - frames[1].depth)[both] > 1e-4).mean() < 0.01


def test_normals_from_heights_are_the_displaced_torus_own():
    """A displacement of 0.25 stretches the torus up to 1.6 times: to ignore this would change shades by 8 of 255."""
    scale, tiles = 0.25, (6, 3)
    y, x = (np.mgrid[:128, :128] + 0.5) / 128
    camera = Camera.look_at((2, -2.5, 1.7), (0, 0, 0), (0, 0, 1), (160, 120), fov_y=42)

    def displaced(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        points, normals = ring(u, v)
        return np.asarray(points + scale * rolling(u * tiles[0], v * tiles[1])[:, None] * normals)

    fine = grid(ring, 600, 300)
    u, v = np.asarray(fine.uv, np.float64).T
    e = 1e-5
    along = [displaced(u + e, v) - displaced(u - e, v), displaced(u, v + e) - displaced(u, v - e)]
    normals = np.cross(along[0], along[1])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    true = ibr.Mesh(displaced(u, v), fine.faces, normals=normals, colors=np.full((len(u), 3), 255, np.uint8))
    thing = ibr.SlicedSurface(
        grid(ring, 96, 48), rolling(x, y).astype(np.float32), EVEN_COLOR, scale, tiles=tiles, slices=256, halvings=4
    )
    off = []
    for direction in ((-0.3, 0.6, -1), (-1, 0.2, -0.3), (0.2, 1, -0.1)):
        light = ibr.Light(direction=direction, ambient=0.0, shadow_size=0)
        truth, seen = ibr.render(true, camera, light), ibr.render(thing, camera, light)
        both = truth.valid & seen.valid & (np.abs(truth.depth - seen.depth) < 0.02)
        off.append(np.abs(truth.color.astype(int) - seen.color)[both].max(axis=1))
    shades = np.concatenate(off)
    assert shades.mean() <= 1.5  # rounding to bytes, and slopes averaged over two texels
    assert np.quantile(shades, 0.95) <= 5


@pytest.mark.parametrize("fov", [60, 120])
@pytest.mark.parametrize("eye", [(0.5, -0.25, 0.35), (0.2, 0.1, 0.45), (0.5, 0.5, 0.5), (0.9, 1.1, 0.3)])
def test_none_sees_through_one_large_polygon(eye, fov):
    """The best direction of slices differs within the polygon, and rays leave the surface at the polygon's borders."""
    camera = Camera.look_at(eye, (0.55, 0.6, 0), (0.01, 0, 1), (240, 180), fov_y=fov)
    truth = large().depth(camera)
    for slicing in ("orthogonal", "screen"):
        seen = ibr.render(ibr.SlicedSurface(square(), heights(), EVEN_COLOR, SCALE, slicing=slicing), camera).valid
        assert seen[interior(truth)].all()
        # Some rays run exactly along the outlines, and some cut a corner of the volume between two slices.
        assert (np.isfinite(truth) & ~seen).mean() <= 5e-4


@cache
def large() -> Solid:
    return Solid(heights(), SCALE, 8)


def test_a_border_is_no_wider_than_the_surface():
    """A ray that leaves the surface at its border hits something only if it has met the filled volume."""
    camera = Camera.look_at((0.5, -1.2, 0.6), (0.5, 0.5, 0), (0, 0, 1), (240, 180), fov_y=50)
    truth = np.isfinite(large().depth(camera)).astype(np.uint8)
    seen = ibr.render(ibr.SlicedSurface(square(), heights(), EVEN_COLOR, SCALE), camera).valid
    assert not seen[cv2.dilate(truth, np.ones((3, 3))) == 0].any()
