"""Cameras inside a relief, below its base mesh, compared with rays cast at a fine mesh of the relief."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from pyibr.relief.interior import nearest_weights
from tests.displaced import interior, square
from tests.relief.solids import Carved, Surface, cylinder, grid, plane, sphere, torus
from tests.relief.test_shadows import blocks
from tests.relief.test_truth import distance, tiled_noise
from tests.shadowed import AMBIENT, edges, first_hits, shares, true_shares

WHITE = np.full((2, 2, 3), 200, np.uint8)
SIZE = (121, 87)
BASES: dict[str, tuple[Surface, tuple[int, int], tuple[int, int], float, tuple[float, float]]] = {
    # surface, cells, tiles, scale, and the (u, v) at which two lanes between blocks cross
    "plane": (plane, (1, 1), (9, 9), 0.1, (4 / 9, 4 / 9)),
    "tube": (cylinder, (64, 8), (12, 5), 0.12, (0.0, 0.6)),
    "sphere": (sphere, (64, 32), (12, 4), 0.12, (0.0, 0.5)),
    "torus, outside": (torus, (96, 48), (16, 6), 0.06, (0.0, 0.0)),
    "torus, inside": (torus, (96, 48), (16, 6), 0.06, (0.0, 0.5)),
}
CELL = 1.3e-3  # scene units, an eighth of a texel: the true mesh cuts off edges of the bilinear surface
LOOKS = {  # directions: components along u, along v and up
    "along u": (1, 0, 0),
    "along v, down": (0, 1, -0.4),
    "up": (1, 0.5, 0.8),
    "back, nearly level": (-1, -0.6, 0.02),
}


def below(surface: Surface, u: float, v: float, depth: float) -> tuple[np.ndarray, np.ndarray]:
    """The point `depth` scene units below the surface at (u, v), and axes there as rows: along u, along v, up."""
    points, normals = surface(np.array([u, u + 1e-4]), np.array([v, v]))
    up, (eye, aside) = normals[0], points - depth * normals
    along = (aside - eye) / np.linalg.norm(aside - eye)
    return eye, np.stack([along, np.cross(up, along), up])


def looking(surface: Surface, u: float, v: float, depth: float, way: tuple[float, ...], size=SIZE) -> Camera:
    eye, axes = below(surface, u, v, depth)
    return Camera.look_at(eye, eye + np.array(way) @ axes, axes[2] + 0.01 * axes[0], size, fov_y=70)


@cache
def carved(name: str, smooth: bool) -> Carved:
    surface, _, tiles, scale, _ = BASES[name]
    return Carved(surface, hills() if smooth else blocks(), scale, tiles, fine=2)


@cache
def hills() -> np.ndarray:
    """Smooth noise that tiles, 32 x 32 texels."""
    return np.ascontiguousarray(tiled_noise(3, 5)[::2, ::2])


@cache
def relief(name: str, smooth: bool = False, **options: Any) -> ibr.ReliefSurface:
    surface, cells, tiles, scale, _ = BASES[name]
    return ibr.ReliefSurface(
        grid(surface, *(FINE * count for count in cells)),
        hills() if smooth else blocks(),
        WHITE,
        scale,
        tiles=tiles,
        **options,
    )


FINE = 3
"""Factor by which bases have more cells than in `BASES`, so that they are at most 0.0002 inside of the true circles."""

FACETS = 0.01
"""Error divided by distance, due to facets that rays graze; with a third of the cells, it was 0.06."""


def check(frame: ibr.Frame, truth: np.ndarray, camera: Camera, part: float) -> None:
    """Assert that every pixel away from edges shows the relief, off by at most the fraction `part` of its distance."""
    inside = interior(truth, 0.027)
    assert inside.sum() > 30
    assert frame.valid[inside].all()
    assert (frame.valid != np.isfinite(truth)).mean() <= 0.02
    off, most = distance(frame, truth, camera)[inside], part * truth[inside] + CELL
    assert (off <= most).mean() >= 0.97
    assert (off <= 0.5 * most).mean() >= 0.5


@pytest.mark.thorough
@pytest.mark.parametrize("search", ["safe", "linear"])
@pytest.mark.parametrize("look", LOOKS)
@pytest.mark.parametrize("name", BASES)
def test_between_blocks(name, look, search):
    surface, _, _, scale, (u, v) = BASES[name]
    camera = looking(surface, u, v, 0.5 * scale, LOOKS[look])
    frame = ibr.render(relief(name, search=search, steps=2048), camera)
    check(frame, carved(name, False).depth(camera), camera, FACETS)


@pytest.mark.parametrize(("name", "look"), [("plane", LOOKS["up"]), ("tube", (1, 0.5, 0.3))])
def test_few_steps_are_enough_for_rays_that_leave(name, look):
    """Steps end where a ray leaves the relief. If they went on to the mesh's end, they would be longer than blocks."""
    surface, _, _, scale, (u, v) = BASES[name]
    camera = looking(surface, u, v, 0.5 * scale, look)
    frame = ibr.render(relief(name, search="linear", steps=64), camera)
    check(frame, carved(name, False).depth(camera), camera, FACETS)


@pytest.mark.thorough
@pytest.mark.parametrize("look", LOOKS)
@pytest.mark.parametrize(("name", "distance_"), [("plane", "approximate"), ("torus, inside", "exact")])
def test_over_the_lowest_place_of_hills(name, look, distance_, lanes):
    surface, _, tiles, scale, (u, v) = BASES[name]
    row, column = np.unravel_index(hills().argmin(), hills().shape)
    u, v = u + (column + 0.5) / 32 / tiles[0], v + (row + 0.5) / 32 / tiles[1]
    camera = looking(surface, u, v, 0.6 * scale, LOOKS[look])
    frame = ibr.render(relief(name, True, distance=distance_), camera)
    check(frame, carved(name, True).depth(camera), camera, FACETS)


@pytest.mark.parametrize("name", ["plane", "sphere"])
def test_nothing_jumps_where_the_eye_passes_through_the_base(name):
    """The camera moves from above the base to below it, each time by a thousandth of the relief's depth."""
    surface, _, _, scale, (u, v) = BASES[name]
    thing, frames = relief(name), []
    for depth in (-1e-3, 1e-3):
        camera = looking(surface, u, v, depth * scale, (1, 0.2, -0.8))
        assert (thing.interior_point(camera) is not None) == (depth > 0)
        frames.append(ibr.render(thing, camera))
    above, under = frames
    assert above.valid.mean() > 0.7
    assert (above.valid != under.valid).mean() <= 0.01
    both = above.valid & under.valid
    # The camera moves by 0.002 of the depth. From outside, rays enter a curved base at other places.
    off = np.abs(above.depth - under.depth)[both] / scale
    assert np.median(off) <= 0.01
    assert np.quantile(off, 0.9) <= 0.1


@pytest.mark.parametrize(
    "eye", [(0.5, 0.5, -0.05), (0.5, 0.5, -0.11), (-0.02, 1 / 3, -0.05), (2 / 3, 1 / 3, 0.05)], ids=str
)
def test_no_place_within(eye):
    """The camera is inside of solid parts, below the bottom, beyond the border, or above the base."""
    thing = ibr.ReliefSurface(square(), blocks(), WHITE, 0.1, tiles=(3, 3))
    assert thing.interior_point(Camera.look_at(eye, (2, 0.4, 0.3), (0, 0, 1), SIZE, fov_y=70)) is None
    if eye[2] < 0 < eye[0]:
        frame = ibr.render(thing, Camera.look_at(eye, (0.6, 0.5, 0.3), (0, 0, 1), SIZE, fov_y=70))
        assert not frame.valid.any()


def test_an_orthographic_camera_is_nowhere():
    camera = Camera.look_at((1 / 3, 1 / 3, -0.05), (1, 0.4, 0), (0, 0, 1), SIZE, projection="orthographic", height=1)
    assert ibr.ReliefSurface(square(), blocks(), WHITE, 0.1, tiles=(3, 3)).interior_point(camera) is None


@pytest.mark.parametrize("name", ["tube", "torus, outside", "torus, inside"])
def test_places_are_on_parallel_surfaces(name):
    """The place found for a point is that of the smooth surface from which the point was moved down."""
    surface, cells, tiles, scale, _ = BASES[name]
    thing = ibr.ReliefSurface(grid(surface, 3 * cells[0], 3 * cells[1]), np.zeros((4, 4)), WHITE, scale, tiles=tiles)
    rng = np.random.default_rng(4)
    low = np.array([0.1, 0.3 if name == "torus, inside" else 0.1])
    for u, v in rng.uniform(low, low + 0.3, (8, 2)):
        depth = rng.uniform(0.1, 0.9)
        eye, axes = below(surface, u, v, depth * scale)
        place = thing.interior_point(Camera.look_at(eye, eye + axes[0], axes[2], SIZE, fov_y=70))
        assert place is not None
        assert abs(place.depth - depth) <= 0.02
        np.testing.assert_allclose(place.uv, np.array([u, v]) * tiles, atol=2e-3)


def test_nearest_points_of_triangles():
    """No other point on the triangle, out of many, is nearer than the point found."""
    rng = np.random.default_rng(5)
    corners, point = rng.normal(size=(50, 3, 3)), rng.normal(size=3)
    weights = nearest_weights(corners, np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), point)
    assert (weights >= 0).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    found = np.linalg.norm(np.einsum("tk,tkc->tc", weights, corners) - point, axis=1)
    tried = rng.dirichlet((0.5, 0.5, 0.5), 4000)
    tried[:3000, 0], tried[:3000] = 0, np.roll(tried[:3000], 1, axis=1)
    tried /= tried.sum(axis=1, keepdims=True)
    least = np.linalg.norm(np.einsum("nk,tkc->tnc", tried, corners) - point, axis=2).min(axis=1)
    assert (found <= least + 1e-12).all()
    assert (found >= least - 0.1).all()


def cube() -> ibr.Mesh:
    """A cube two units wide, whose sides have separate corners, normals and uv."""
    points, faces = [], []
    for axis in range(3):
        for sign in (-1, 1):
            side = np.array([[-1, -1, sign], [1, -1, sign], [1, 1, sign], [-1, 1, sign]], float)
            points.append(np.roll(side, axis + 1, axis=1)[::sign])
            faces += [[4 * len(points) - 4 + k for k in corner] for corner in ((0, 1, 2), (0, 2, 3))]
    normals = np.repeat([np.roll([0, 0, sign], axis + 1) for axis in range(3) for sign in (-1, 1)], 4, axis=0)
    return ibr.Mesh(
        np.concatenate(points), faces, uv=np.tile([[0, 0], [1, 0], [1, 1], [0, 1]], (6, 1)), normals=normals
    )


def test_a_lane_is_open_where_the_mesh_ends():
    """The lane is in a cube's upper side. Its end shows the wall behind the cube, and no more blocks."""
    wall = ibr.Mesh([[3, -9, -9], [3, 9, -9], [3, 9, 9], [3, -9, 9]], [[0, 1, 2], [0, 2, 3]], sides="both")
    camera = Camera.look_at((0.5, 0, 0.9), (3, 0, 0.9), (0, 0, 1), SIZE, fov_y=30)
    frame = ibr.render([ibr.ReliefSurface(cube(), blocks(), WHITE, 0.2, tiles=(2, 2)), wall], camera)
    assert frame.depth[43, 60] == pytest.approx(2.5, abs=1e-4)
    # The lane is 8 to 12 of 32 texels wide, so that both of its walls begin at most 6/32 from its middle.
    x = (np.arange(SIZE[0]) - camera.K[0, 2]) / camera.K[0, 0] * 0.5
    assert frame.depth[43, np.abs(x) < 3 / 32] == pytest.approx(2.5, abs=1e-4)
    assert (frame.depth[43, np.abs(x) > 7 / 32] < 0.5).all()


@pytest.mark.thorough
def test_maps_of_bytes_that_do_not_tile():
    camera = looking(plane, 4 / 9, 4 / 9, 0.05, LOOKS["back, nearly level"])
    bytes_ = np.rint(255 * np.tile(blocks(), (9, 9))).astype(np.uint8)
    base = grid(plane, 1, 1)
    clamped = ibr.render(ibr.ReliefSurface(base, bytes_, WHITE, 0.1, wrap="clamp"), camera)
    check(clamped, carved("plane", False).depth(camera), camera, 0.0)


@pytest.mark.parametrize(
    ("distance_", "anisotropy"), [("perpendicular", 1), pytest.param("approximate", 8, marks=pytest.mark.thorough)]
)
def test_all_distances_are_one_within(distance_, anisotropy):
    """On a plane, rays from inside hit the same points with each way to measure distance and with filtered colours."""
    camera = looking(plane, 4 / 9, 4 / 9, 0.05, LOOKS["along u"])
    plain = ibr.render(relief("plane", search="linear", steps=256), camera)
    other = relief("plane", search="linear", steps=256, distance=distance_)
    frame = ibr.render(other, camera, anisotropy=anisotropy)
    assert plain.valid.mean() > 0.5
    np.testing.assert_array_equal(frame.valid, plain.valid)
    np.testing.assert_allclose(frame.depth, plain.depth, rtol=1e-5)  # separate builds may round differently


@pytest.mark.thorough
def test_normals_of_a_map_light_walls_within():
    """With a map of upright normals, all parts are equally bright; with normals from the heights they are not."""
    camera, light = (
        looking(plane, 4 / 9, 4 / 9, 0.05, LOOKS["along u"]),
        ibr.Light(direction=(0, 0, -1), ambient=0, shadow_size=0),
    )
    upright = (((0.0, 0.0, 1.0),) * 2,) * 2
    flat = ibr.render(relief("plane", normal_map=upright), camera, light)
    sloping = ibr.render(relief("plane"), camera, light)
    np.testing.assert_array_equal(flat.valid, sloping.valid)
    assert np.abs(flat.color[flat.valid].astype(int) - 200).max() <= 1  # rounding
    assert sloping.color[sloping.valid].min() < 100


@pytest.mark.thorough
@pytest.mark.parametrize("shadow", ["map", "search"])
@pytest.mark.parametrize("name", ["plane", "tube"])
def test_light_falls_between_blocks(name, shadow):
    """Three pixels or more from edges of shadows and blocks, light and shadow are right.

    On the tube, the edges come from a mesh of 64 sides.
    """
    surface, _, _, scale, (u, v) = BASES[name]
    camera = looking(surface, u, v, 0.5 * scale, LOOKS["along u"], (200, 150))
    light = ibr.Light(direction=(-0.5, 1, -0.5), ambient=AMBIENT)
    scene = carved(name, False).scene
    depth, points, normals = first_hits(scene, camera)
    truth = true_shares(scene, light, points, normals)
    share, told = shares(relief(name, shadow=shadow), camera, light)
    counted = told & np.isfinite(depth) & ~edges(truth) & interior(depth, 0.02)
    assert counted.sum() > 1800
    assert 0.1 < truth[counted].mean() < 0.9
    assert ((share > 0.5) == truth)[counted].mean() >= (0.99 if name == "plane" else 0.95)
