"""Maps that are not repeated: heights, colours, normals and shadows at a map's border and outside of it."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from pyibr.meshes.textures import halved
from tests.displaced import interior
from tests.embree import embree, rays_of
from tests.one_lane import both_forms, unlike
from tests.reference.heights import bilinear_height
from tests.shadowed import AMBIENT, edges, first_hits, shares, true_shares

SCALE = 0.15
SIZE = (160, 120)
WHITE = np.full((1, 1, 3), 255, np.uint8)
ON_MAP = (0.0, 0.0), (1.0, 1.0)
BEYOND = (-0.4, -0.6), (1.6, 1.2)  # uv at the square's corners
SLICES = 256
SYSTEMS: dict[str, dict[str, Any]] = {
    "slices": {"slices": SLICES},
    "slices along the screen": {"slices": SLICES, "slicing": "screen"},
    "relief": {},
    "relief, even steps": {"search": "linear", "steps": 256},
    "relief, exact": {"distance": "exact"},
}


def square(span: tuple[tuple[float, float], tuple[float, float]]) -> ibr.Mesh:
    """A square at z = 0 with x and y from 0 to 1; `span` has the uv of its first and of its third corner."""
    (u0, v0), (u1, v1) = span
    corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    return ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3]], uv=[[u0, v0], [u1, v0], [u1, v1], [u0, v1]])


def ramp(columns: int, rows: int, seed: int = 0) -> np.ndarray:
    """Heights that rise from corner to corner, with noise: opposite borders differ by up to 0.9."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows)
    return np.clip(0.45 * x + 0.45 * y + rng.uniform(0, 0.1, x.shape), 0, 1).astype(np.float32)


@cache
def in_bytes(columns: int, rows: int) -> np.ndarray:
    """`ramp` as bytes."""
    return np.rint(255 * ramp(columns, rows)).astype(np.uint8)


def thing(system: str, span: Any, height: np.ndarray, color: np.ndarray = WHITE, **more: Any) -> Any:
    kind = ibr.ReliefSurface if system.startswith("relief") else ibr.SlicedSurface
    return kind(square(span), height, color, SCALE, **{"wrap": "clamp", **SYSTEMS[system], **more})


def scene(system: str, span: Any, height: np.ndarray, wrap: tuple[str, str] = ("clamp", "clamp")) -> Any:
    """The triangulated surface over the square and 0.3 around it, in about five cells a texel."""
    heights = height / 255 if height.dtype == np.uint8 else height.astype(float)
    (u0, v0), (u1, v1) = span
    texels = 1.6 * max((u1 - u0) * height.shape[1], (v1 - v0) * height.shape[0])
    ticks = np.linspace(-0.3, 1.3, min(481, 81 + int(5 * texels)))
    x, y = (values.ravel() for values in np.meshgrid(ticks, ticks))
    rise = bilinear_height(heights, u0 + (u1 - u0) * x, v0 + (v1 - v0) * y, wrap)
    z = SCALE * (rise - 1 if system.startswith("relief") else rise)
    n = len(ticks)
    i = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate([np.stack([i, i + 1, i + n + 1], 1), np.stack([i, i + n + 1, i + n], 1)])
    return embree(ibr.Mesh(np.column_stack([x, y, z]), faces))


def above(elevation: float, projection: Any = "perspective", size: Any = SIZE, away: float = 1.9) -> Camera:
    e = np.radians(elevation)
    eye = np.array([0.5, 0.5, 0]) + away * np.array([0.5 * np.cos(e), -0.87 * np.cos(e), np.sin(e)])
    tall = {"height": 1.4} if projection == "orthographic" else {}
    return Camera.look_at(eye, (0.5, 0.5, 0), (0, 0.2, 1), size, fov_y=40, projection=projection, **tall)


def known(system: str, span: Any, camera: Camera, points: np.ndarray) -> np.ndarray:
    """(H, W) True where the truth holds: rays must meet a relief's base, or hit slices above the base."""
    if system.startswith("relief"):
        return ibr.render(square(span), camera).valid
    return ((points[..., :2] > 0.005) & (points[..., :2] < 0.995)).all(axis=-1)


@cache
def scene_of(kind: str, span: Any, name: str, wrap: tuple[str, str]) -> Any:
    """`scene` with the map of this name, cached for all systems of a kind."""
    return scene(kind, span, MAPS[name], wrap)


def share_right(
    system: str, span: Any, name: str, camera: Camera, true_wrap: tuple[str, str] = ("clamp", "clamp"), **more: Any
) -> float:
    """Fraction of `known` pixels, away from depth edges, whose depth is right within two slices."""
    truth, points, _ = first_hits(scene_of(system.split()[0].rstrip(","), span, name, true_wrap), camera)
    frame = ibr.render(thing(system, span, MAPS[name], **more), camera)
    counted = known(system, span, camera, points) & interior(truth, 0.06)
    assert counted.sum() > 2000
    off = np.abs(frame.depth - truth)
    # Rays meet slices at 30 degrees or more, and a relief's surface within 0.001 of its depth.
    return float((off <= 2 * SCALE / SLICES)[counted].mean())


MAPS = {"bytes, powers of two": in_bytes(32, 16), "odd": ramp(33, 15), "a row": ramp(9, 1), "a column": in_bytes(1, 8)}
MAPS["one texel"] = np.full((1, 1), 0.3, np.float32)


EACH = [pytest.param(name, marks=pytest.mark.thorough if name == "relief, exact" else ()) for name in SYSTEMS]


@pytest.mark.parametrize("system", EACH)
@pytest.mark.parametrize("span", [ON_MAP, BEYOND], ids=["on the map", "beyond it"])
@pytest.mark.parametrize("name", MAPS)
def test_clamped_heights(name, span, system):
    for camera in (above(70), above(35, "orthographic")):
        assert share_right(system, span, name, camera) >= 0.995


@pytest.mark.thorough
@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize("wrap", [("repeat", "clamp"), ("clamp", "repeat")])
def test_heights_clamped_along_one_axis(wrap, system):
    """Each of the kernels with one axis and bytes, and with the other axis and floats, or the other way round."""
    name = "odd" if (wrap[0] == "clamp") != (system == "relief, exact") else "bytes, powers of two"
    # Cliffs where the map repeats are half a texel wide, of 33 or 15 texels, so more pixels are near them. In
    # oblique views, cliffs from left to right occlude a part of the picture, and are sharper in the truth.
    for elevation in (70, 35) if wrap[0] == "clamp" else (70,):
        assert share_right(system, BEYOND, name, above(elevation), wrap, wrap=wrap) >= 0.99
    assert share_right(system, BEYOND, name, above(70), wrap, wrap="clamp") < 0.9


@pytest.mark.parametrize("system", ["slices", "relief"])
def test_a_repeated_map_jumps_at_its_border(system):
    """With a map that is repeated, the checks of this file fail."""
    assert share_right(system, ON_MAP, "odd", above(70), wrap="repeat") < 0.97
    assert share_right(system, BEYOND, "odd", above(70), wrap="repeat") < 0.5


@pytest.mark.thorough
@pytest.mark.parametrize("system", ["slices", "relief", "relief, exact"])
def test_one_lane_sees_the_same(system):
    camera, made = above(35, size=(101, 77)), thing(system, BEYOND, MAPS["odd"])
    outlines, depths, _ = unlike(*both_forms(lambda: ibr.render(made, camera)))
    assert outlines <= 1e-3 and depths <= 0.002  # at outlines, rounding decides


def test_no_clamped_map_changes_what_lies_off_its_border():
    """Rays that stay half a texel away from the border see the same surface, whether the map is repeated or clamped."""
    height, camera = ramp(24, 24), above(80)
    for system in ("slices", "relief"):
        found = [ibr.render(thing(system, ON_MAP, height, wrap=wrap), camera) for wrap in ("repeat", "clamp")]
        _, points, _ = first_hits(scene(system, ON_MAP, height), camera)
        # At 80 degrees, a ray moves sideways by 0.18 of the relief's depth.
        inner = (np.abs(points[..., :2] - 0.5) < 0.5 - 0.5 / 24 - 0.18 * SCALE).all(axis=-1)
        assert inner.sum() > 2000
        np.testing.assert_allclose(found[0].depth[inner], found[1].depth[inner], atol=1e-6)


def straight_above(texels: float, of: int, projection: Any = "orthographic") -> Camera:
    """A camera straight above the square, whose pixels are `texels` wide if the square is `of` texels wide."""
    return Camera.look_at(
        (0.5, 0.5, 3), (0.5, 0.5, 0), (0, 1, 0.1), (29, 23), fov_y=1, projection=projection, height=23 * texels / of
    )


@pytest.mark.parametrize("size", [(64, 64), (90, 70)])
@pytest.mark.parametrize("search", ["safe", "linear"])
def test_levels_seen_from_afar(search, size):
    """Pixels are 5.6 texels wide, so kernels read the third level, whose texels cover 4 x 4 texels of the map."""
    height, camera = ramp(*size), straight_above(5.6, 2 * size[0])
    truth, _, _ = first_hits(scene("relief", BEYOND, halved(halved(height))), camera)
    frame = ibr.render(thing("relief", BEYOND, height, search=search, steps=256), camera)
    assert frame.valid.sum() > 300
    assert np.abs(frame.depth - truth)[frame.valid].max() <= 1e-3 + SCALE / 256


def uv_from_above(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """The uv on the square's plane, by the span BEYOND, of each pixel of an orthographic camera above it."""
    places = rays_of(camera)[:, :2].reshape(camera.height, camera.width, 2)
    (u0, v0), (u1, v1) = BEYOND
    return u0 + (u1 - u0) * places[..., 0], v0 + (v1 - v0) * places[..., 1]


@pytest.mark.thorough
@pytest.mark.parametrize("level", [0, 1])
@pytest.mark.parametrize("size", [(20, 14), (33, 1), (1, 1)])
@pytest.mark.parametrize("system", ["slices", "relief"])
def test_clamped_colours(system, size, level):
    """On a flat surface, colours come from the level of the map whose texels are as large as a pixel."""
    wraps: list[tuple[str, str]] = [("clamp", "clamp"), ("repeat", "clamp"), ("clamp", "repeat")]
    color = np.rint(255 * np.dstack([ramp(*size, seed) for seed in (1, 2, 3)])).astype(np.uint8)
    seen = np.floor(halved(color) + 0.5) if level else color.astype(float)
    camera = straight_above(0.7 if level == 0 else 2.8, max(2 * size[0], 1.8 * size[1], 40))
    full, way = np.ones((2, 2), np.float32), {"test": "at_least"} if system == "slices" else {}
    u, v = uv_from_above(camera)
    for wrap in wraps:
        frame = ibr.render(thing(system, BEYOND, full, color, wrap=wrap, **way), camera)
        expected = np.dstack([bilinear_height(seen[..., c], u, v, wrap) for c in range(3)])
        assert frame.valid.sum() >= 100
        assert np.abs(frame.color - expected)[frame.valid].max() <= 0.52, wrap  # rounding to bytes


@pytest.mark.thorough
@pytest.mark.parametrize(("system", "size"), [("slices", (20, 14)), ("relief", (20, 14)), ("relief", (1, 9))])
def test_clamped_normals(system, size):
    rng = np.random.default_rng(5)
    normals = np.dstack([rng.uniform(-0.5, 0.5, (*size[::-1], 2)), np.ones(size[::-1])]).astype(np.float32)
    camera, light = straight_above(0.7, 40), ibr.Light(direction=(-0.5, -0.3, -1), ambient=0.0, shadow_size=0)
    full = np.ones((2, 2), np.float32)
    way = {"test": "at_least"} if system == "slices" else {}
    frame = ibr.render(thing(system, BEYOND, full, normal_map=normals, **way), camera, light)
    u, v = uv_from_above(camera)
    told = np.dstack([bilinear_height(normals[..., c].astype(float), u, v, ("clamp", "clamp")) for c in range(3)])
    told /= np.linalg.norm(told, axis=-1, keepdims=True)
    towards = np.array([0.5, 0.3, 1]) / np.linalg.norm([0.5, 0.3, 1])
    assert frame.valid.sum() >= 100
    assert np.abs(frame.color[..., 0] - 255 * (told @ towards))[frame.valid].max() <= 1


@pytest.mark.thorough
@pytest.mark.parametrize("system", ["slices", "relief", "relief, exact"])
def test_slopes_shade_and_cast_shadows_as_far_as_the_map_reaches(system):
    """A disk lies on a slope that ends at the map's border: no cliff is there, and the surface outside is flat."""
    y, x = np.mgrid[:24, :32] / 24
    height = (0.3 * (1.33 - x) + 0.55 * (np.hypot(x - 0.65, y - 0.45) < 0.25)).astype(np.float32)
    light, camera = ibr.Light(direction=(0.8, 0.5, -0.5), ambient=AMBIENT, shadow_size=1024), above(65, size=(240, 180))
    solid = scene(system, BEYOND, height)
    depth, points, normals = first_hits(solid, camera)
    truth = true_shares(solid, light, points, normals)
    share, told = shares(thing(system, BEYOND, height), camera, light)
    inner = (np.abs(points[..., :2] - 0.5) < 0.48).all(axis=-1)
    counted = told & inner & known(system, BEYOND, camera, points) & ~edges(truth) & np.isfinite(depth)
    assert counted.sum() > 4500
    assert 0.015 < 1 - truth[counted].mean() < 0.5
    assert ((share > 0.5) == truth)[counted].mean() >= 0.995
    # Away from kinks, the shading has the truth's normals.
    plain = ibr.Light(direction=light.direction, ambient=AMBIENT, shadow_size=0)
    shade = ibr.render(thing(system, BEYOND, height), camera, plain).color[..., 0].astype(float)
    towards = -np.asarray(light.direction) / np.linalg.norm(light.direction)
    expected = 255 * (AMBIENT + (1 - AMBIENT) * np.maximum(normals @ towards, 0))
    assert np.median(np.abs(shade - expected)[counted]) <= 1
    assert (np.abs(shade - expected)[counted] <= 4).mean() >= 0.94  # kinks are two texels of 64 wide


@pytest.mark.parametrize("kind", [ibr.SlicedSurface, ibr.ReliefSurface])
def test_what_does_not_fit_is_said(kind):
    with pytest.raises(ibr.ArgumentError, match=r"^wrap: "):
        kind(square(ON_MAP), ramp(4, 4), WHITE, 0.1, wrap="mirror")
    with pytest.raises(ibr.ArgumentError, match=r"^tiles: expected 1 along an axis with wrap=\"clamp\""):
        kind(square(ON_MAP), ramp(4, 4), WHITE, 0.1, tiles=(1, 2), wrap=("repeat", "clamp"))
    with pytest.raises(ibr.ArgumentError, match=r"^wrap: .*a pair of these, got "):
        kind(square(ON_MAP), ramp(4, 4), WHITE, 0.1, wrap=["repeat", "clamp"])


def test_other_heights_are_clamped_too():
    first = thing("slices", BEYOND, MAPS["odd"])
    again, fresh = first.with_height(ramp(7, 9, 3)), thing("slices", BEYOND, ramp(7, 9, 3))
    np.testing.assert_array_equal(ibr.render(again, above(50)).depth, ibr.render(fresh, above(50)).depth)


@pytest.mark.thorough
def test_places_beyond_a_clamped_map_are_its_border():
    camera = above(60)
    places = thing("relief", BEYOND, MAPS["odd"]).tile_coordinates(camera)
    seen = np.isfinite(places[..., 0])
    assert seen.any()
    assert places[seen].min() == 0
    assert places[seen].max() == 1
