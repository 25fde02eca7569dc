"""Shadows of reliefs on themselves, by a shadow map and by a search, compared with cast rays."""

from __future__ import annotations

from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from pyibr.opencl.watch import watching
from tests.builds import Builds
from tests.displaced import square
from tests.relief.solids import Carved, cylinder, grid, sphere, torus
from tests.relief.test_truth import bricks
from tests.shadowed import AMBIENT, edges, first_hits, shares, true_shares

SHADOWS: list[Any] = ["map", "search"]
WHITE = np.full((2, 2, 3), 255, np.uint8)
SOLIDS = {"torus": (torus, (96, 48)), "sphere": (sphere, (64, 32)), "cylinder": (cylinder, (64, 8))}


@cache
def blocks() -> np.ndarray:
    """A map of 32 x 32 texels with one block, whose slanted sides are two texels wide; it tiles."""
    y, x = np.mgrid[:32, :32]
    inside = np.minimum(np.minimum(x, 31 - x), np.minimum(y, 31 - y))
    return np.clip((inside - 4) / 2, 0, 1).astype(np.float32)


def check_even(name: str, scale: float, light: ibr.Light, least: int) -> None:
    """Hardly a lit pixel of an even solid is in shadow, by map and by search; `least`: number of lit pixels."""
    surface, cells = SOLIDS[name]
    camera = Camera.look_at((2.2, -3, 1.9), (0, 0, 0), (0, 0, 1), (240, 180), fov_y=42)
    scene = Carved(surface, np.zeros((32, 32)), scale, (6, 4)).scene
    _, points, normals = first_hits(scene, camera)
    truth = true_shares(scene, light, points, normals)
    assert truth.sum() > least
    for shadow in SHADOWS:
        relief = ibr.ReliefSurface(grid(surface, *cells), np.zeros((4, 4)), WHITE, scale, tiles=(4, 4), shadow=shadow)
        share, told = shares(relief, camera, light)
        assert (told & (share < 0.5) & truth).sum() <= 0.005 * ibr.render(relief, camera).valid.sum(), shadow


@pytest.mark.parametrize("scale", [0.03, 0.1, 0.15])
@pytest.mark.parametrize("name", SOLIDS)
def test_a_deep_even_relief_does_not_shade_itself(name, scale):
    """The light's rays enter at other triangles, below other quadrics: a map alone would shade 11 %."""
    check_even(name, scale, ibr.Light(direction=(1, 0.2, -0.3), ambient=AMBIENT), 1100)


LIGHTS = {
    "along the ring": {"direction": (0.2, 1, -0.1)},
    "from below": {"direction": (-0.68, 0.71, 0.21)},
    "near": {"position": (1.92, 2.18, -0.75)},
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", LIGHTS)
def test_a_deep_torus_is_no_wider_in_its_shadow(name):
    """The ring's other side casts its shadow across the torus. By equation 7 it would be too wide, by 2 % or more."""
    check_even("torus", 0.15, ibr.Light(**LIGHTS[name], ambient=AMBIENT), 280)


@pytest.mark.parametrize("light", [{"direction": (0.2, 0.5, -1)}, {"position": (-1.0, 1, 3)}], ids=["far", "near"])
def test_the_shadow_on_the_ground_is_no_wider(light):
    """By equation 7 the torus's shadow would be a quarter larger; 3 % are a fifth of a pixel along its outline."""
    ground = ibr.Mesh([[-4, -4, -1.2], [4, -4, -1.2], [4, 4, -1.2], [-4, 4, -1.2]], [[0, 1, 2], [0, 2, 3]])
    camera = Camera.look_at((2, -4, 5), (0, 0, -1), (0, 0, 1), (320, 240), fov_y=60)
    scene = Carved(torus, np.zeros((32, 32)), 0.15, (6, 4)).scene
    scene.add_triangles(ground.vertices.astype(np.float32), ground.faces.astype(np.uint32))
    depth, points, normals = first_hits(scene, camera)
    lamp = ibr.Light(**light, ambient=AMBIENT)
    truth = true_shares(scene, lamp, points, normals)
    relief = ibr.ReliefSurface(grid(torus, 96, 48), np.zeros((4, 4)), WHITE, 0.15, tiles=(4, 4))
    share, told = shares([ground, relief], camera, lamp)
    counted = told & (np.abs(points[..., 2] + 1.2) < 1e-3) & ~edges(depth)
    dark, true = (share < 0.5)[counted], ~truth[counted]
    assert true.sum() > 700
    assert (dark & ~true).sum() <= 0.03 * true.sum()
    assert (~dark & true).sum() <= 0.03 * true.sum()


@pytest.mark.thorough
@pytest.mark.parametrize("shadow", SHADOWS)
@pytest.mark.parametrize("direction", [(-1, 0.2, -0.6), (-0.5, 1, -0.5), (-1, -0.8, -0.3)], ids=str)
@pytest.mark.parametrize("scale", [0.05, 0.12])
def test_blocks_on_a_tube(scale, direction, shadow):
    """Three pixels or more from edges of shadows and blocks, light and shadow are right."""
    light = ibr.Light(direction=direction, ambient=AMBIENT)
    camera = Camera.look_at((3.2, -1.2, 0.3), (0, 0, 0), (0, 0, 1), (320, 240), fov_y=42)
    scene = Carved(cylinder, blocks(), scale, (12, 5)).scene
    depth, points, normals = first_hits(scene, camera)
    truth = true_shares(scene, light, points, normals)
    relief = ibr.ReliefSurface(grid(cylinder, 64, 8), blocks(), WHITE, scale, tiles=(12, 5), shadow=shadow)
    share, told = shares(relief, camera, light)
    counted = told & np.isfinite(depth) & ~edges(truth) & ~edges(depth, 0.06)
    assert counted.sum() > 20000
    agrees = ((share > 0.5) == truth)[counted].mean()
    # If the light is low over the surface, its shadow map and its quadrics are less precise.
    assert agrees >= (0.998 if direction[2] == -0.3 else 0.9997), agrees


FROM_WITHIN = {
    "middle": ("cylinder", {"position": (0.05, 0.1, 0.02)}),
    "wall": ("cylinder", {"position": (0.3, -0.2, 0.4)}),
    "far, sphere": ("sphere", {"direction": (0.5, -0.6, 1)}),
    "wall, sphere": ("sphere", {"position": (0.3, -0.2, 0.4)}),
}


@pytest.mark.parametrize("name", FROM_WITHIN)
def test_no_light_comes_through_from_within(name):
    """No light reaches the sides of blocks that face a light inside of the solid, or behind it.

    Both solids are open at their ends.
    """
    solid, light = FROM_WITHIN[name]
    (surface, cells), tiles = SOLIDS[solid], (12, 5)
    lamp = ibr.Light(**light, ambient=AMBIENT)
    camera = Camera.look_at((3.2, -1.2, 0.3), (0, 0, 0), (0, 0, 1), (320, 240), fov_y=42)
    scene = Carved(surface, blocks(), 0.12, tiles).scene
    depth, points, normals = first_hits(scene, camera)
    truth = true_shares(scene, lamp, points, normals)
    relief = ibr.ReliefSurface(grid(surface, *cells), blocks(), WHITE, 0.12, tiles=tiles)
    share, told = shares(relief, camera, lamp)
    counted = told & np.isfinite(depth) & ~truth & ~edges(truth) & ~edges(depth, 0.06)
    assert counted.sum() > 200
    assert (share < 0.5)[counted].mean() >= 0.99  # blocks reach down to the bottom


@pytest.mark.parametrize("direction", [(0.5, -1, -1), (0.3, -1, -0.4)], ids=str)
@pytest.mark.parametrize(
    "options", [{}, pytest.param({"distance": "exact"}, marks=pytest.mark.thorough), {"silhouette": "none"}]
)
def test_a_wall_lit_from_behind_casts_its_shadow(direction, options):
    """Three pixels or more from its edge, the shadow is that of the mesh without a relief."""
    corners = [[-1, 0, 0.5], [1, 0, 0.5], [1, 0, 2.5], [-1, 0, 2.5]]
    wall = ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3]], uv=[[0, 1], [1, 1], [1, 0], [0, 0]])
    corners = [[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]]
    ground = ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3]], colors=np.full((4, 3), 255, np.uint8))
    camera = Camera.look_at((7, -1.5, 6), (0.5, -2, 0), (0, 0, 1), (320, 240), fov_y=40)
    light = ibr.Light(direction=direction, ambient=AMBIENT)
    relief = ibr.ReliefSurface(wall, blocks(), WHITE, 0.15, tiles=(3, 3), **options)
    (carved, told), (bare, _) = (shares([ground, thing], camera, light) for thing in (relief, wall))
    counted = told & ~ibr.render(wall, camera).valid & ~edges(bare < 0.5)
    assert (counted & (bare < 0.5)).sum() > 500
    assert ((carved < 0.5) == (bare < 0.5))[counted].all()


@pytest.mark.thorough
def test_small_tiles_far_away():
    """The truth has 6 x 6 rays per pixel. A shadow map shows moire if its texels cover many texels of the relief."""
    camera = Camera.look_at((0.5, -0.55, 0.5), (0.5, 0.45, 0), (0, 0, 1), (160, 120), fov_y=50)
    finer = camera.resized((960, 720))
    light = ibr.Light(direction=(1, 0.3, -0.6), ambient=AMBIENT)

    def picture(camera: Camera, shadow: Any) -> np.ndarray:
        relief = ibr.ReliefSurface(square(), bricks(), WHITE, 0.008, tiles=(24, 24), shadow=shadow)
        return ibr.render(relief, camera, light).color.astype(float)

    truth = picture(finer, "search").reshape(120, 6, 160, 6, 3).mean(axis=(1, 3))
    inside = cv2.erode(ibr.render(square(), camera).valid.astype(np.uint8), np.ones((5, 5))) > 0
    off = {way: np.sqrt(np.square(picture(camera, way) - truth)[inside].mean()) for way in SHADOWS}
    assert off["search"] <= 0.5 * off["map"], off


@pytest.mark.parametrize(
    "options",
    [{}, {"search": "linear"}, pytest.param({"distance": "exact"}, marks=pytest.mark.thorough), {"silhouette": "none"}],
)
def test_both_ways_agree_on_a_plane(options):
    """Away from edges of shadows, both agree; edges in the shadow map are off by up to two of its texels."""
    camera = Camera.look_at((0.9, -1.0, 1.05), (0.5, 0.5, 0), (0, 0, 1), (320, 240), fov_y=42)
    light = ibr.Light(direction=(0.7, 0.5, -0.6), ambient=AMBIENT, shadow_size=1024)
    mapped, found = (
        shares(ibr.ReliefSurface(square(), blocks(), WHITE, 0.1, tiles=(4, 4), shadow=way, **options), camera, light)
        for way in SHADOWS
    )
    counted = mapped[1] & found[1] & ~edges(mapped[0] > 0.5) & ~edges(found[0] > 0.5)
    assert counted.sum() > 5000
    assert 0.1 < (found[0][counted] > 0.5).mean() < 0.9
    assert ((mapped[0] > 0.5) == (found[0] > 0.5))[counted].mean() >= 0.999


@pytest.mark.parametrize("silhouette", ["quadric", "none"])
@pytest.mark.parametrize(
    ("cells", "scale"), [((12, 8), 0.02), ((12, 8), 0.1), ((16, 10), 0.05), ((32, 20), 0.1), ((64, 48), 0.05)], ids=str
)
def test_an_even_relief_on_a_coarse_ball_does_not_shade_itself(cells, scale, silhouette):
    """From facet to facet, normals and quadrics of entering rays change: a map alone would shade up to a quarter."""
    ball = ibr.ReliefSurface(grid(sphere, *cells), np.full((8, 8), 0.5), WHITE, scale, silhouette=silhouette)
    camera = Camera.look_at((1.5, -3, 1.2), (0, 0, 0), (0, 0, 1), (180, 150), fov_y=45)
    lit, plain = (
        ibr.render(ball, camera, ibr.Light(direction=(0.5, 1, -0.6), ambient=0.2, shadow_size=size))
        .color[..., 0]
        .astype(int)
        for size in (1024, 0)
    )
    told = plain > 75
    assert told.sum() > 2800
    assert (told & (plain - lit > 15)).sum() <= 0.005 * told.sum()


def test_one_program_whatever_hides_the_light_and_however_the_base_bends():
    light, camera = (
        ibr.Light(direction=(1, 0.2, -1)),
        Camera.look_at((0, -3, 2), (0, 0, 0), (0, 0, 1), (41, 31), fov_y=42),
    )
    builds = Builds()
    with watching(builds):
        for base in (square(), grid(torus, 12, 8)):
            for shadow in SHADOWS:
                ibr.render(ibr.ReliefSurface(base, blocks(), WHITE, 0.1, shadow=shadow), camera, light)
    assert len([of for of in builds.of if of[0] == "draw_relief" and ("LIT", 1) in of]) == 1
