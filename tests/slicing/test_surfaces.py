"""Sliced surfaces against rays cast at the same height field, finely triangulated."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import models
from pyibr.core.camera import Camera
from pyibr.slicing import alpha_tests
from tests.boxes import box, facets
from tests.displaced import Solid, interior, looking, square
from tests.relief.solids import grid
from tests.relief.solids import torus as ring

SCALE = 0.25
SIZE = (200, 150)
FINE = 8  # cells of the truth's mesh per texel: a bilinear patch is a plane to 1/64 of its twist
ELEVATIONS = (90, 60, 35, 15, 5)  # degrees
DIRECTIONS = (10, 100, 190, 280, 55)


def heights(n: int = 32) -> np.ndarray:
    """Hills from 0.1 to 0.9, periodic, so that tiles join."""
    y, x = np.mgrid[:n, :n] * (2 * np.pi / n)
    waves = np.sin(2 * x) * np.cos(y) + 0.5 * np.sin(3 * y + x) + 0.3 * np.cos(4 * x - 2 * y)
    return (0.5 + 0.4 * waves / np.abs(waves).max()).astype(np.float32)


def surface(
    slices: int, slicing: str, test: str = "inside", height: np.ndarray | None = None, clipped: bool = True
) -> ibr.SlicedSurface:
    color = np.full((2, 2, 3), 200, np.uint8)
    return ibr.SlicedSurface(
        square(),
        heights() if height is None else height,
        color,
        SCALE,
        slices=slices,
        slicing=slicing,
        test=test,
        clipped=clipped,
    )


def camera(elevation: float, direction: float, size: tuple[int, int] = SIZE, projection: str = "perspective") -> Camera:
    return looking(elevation, direction, SCALE, size, projection)


@cache
def solid() -> Solid:
    return Solid(heights(), SCALE, FINE)


@cache
def views(projection: str) -> list[tuple[Camera, np.ndarray]]:
    cameras = [camera(e, d, projection=projection) for e in ELEVATIONS for d in DIRECTIONS]
    return [(cam, solid().depth(cam)) for cam in cameras]


PROJECTIONS = ["perspective", "orthographic"]


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_depth_error_falls_as_the_number_of_slices_rises(slicing, projection):
    counts = (16, 32, 64, 128, 256)
    means = []
    truths = views(projection)
    for slices in counts:
        errors = []
        for cam, truth in truths:
            frame = ibr.render(surface(slices, slicing), cam)
            inside = interior(truth) & frame.valid
            errors.append((frame.depth - truth)[inside])
        off = np.concatenate(errors)
        means.append(np.abs(off).mean())
        assert means[-1] <= SCALE / slices
    exponent = np.polyfit(np.log(counts), np.log(means), 1)[0]
    assert -1.15 <= exponent <= -0.85, (exponent, means)


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_no_view_sees_through(slicing, projection):
    for cam, truth in views(projection):
        for slices in (16, 64):
            frame = ibr.render(surface(slices, slicing), cam)
            assert frame.valid[interior(truth)].all()


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_silhouettes(slicing, projection):
    for cam, truth in views(projection):
        frame = ibr.render(surface(256, slicing), cam)
        seen = np.isfinite(truth)
        assert (seen & frame.valid).sum() / (seen | frame.valid).sum() >= 0.99


def test_slices_of_the_surface_are_seen_through_from_the_side():
    """Figure 4 of the paper: at 2 degrees some rays pass between two slices, more so with fewer slices."""
    through = []
    for slices in (8, 32):
        missed = total = 0
        for d in DIRECTIONS:
            cam = camera(2, d)
            inside = interior(solid().depth(cam))
            missed += (~ibr.render(surface(slices, "surface"), cam).valid[inside]).sum()
            total += inside.sum()
        through.append(missed / total)
    assert through[0] > 0.01
    assert through[1] < through[0]


@pytest.mark.parametrize("slicing", ["surface", "orthogonal", "screen"])
def test_the_alpha_test_at_height_0(slicing):
    """At zeros of the map, `inside` shows nothing and `at_least` the base."""
    height = heights()
    height[:, :16] = 0
    cam = camera(90, 90, (64, 64))
    masked = ibr.render(surface(32, slicing, "inside", height), cam)
    based = ibr.render(surface(32, slicing, "at_least", height), cam)
    u = ground(cam)[..., 0]
    v = ground(cam)[..., 1]
    # Half a texel beside the step, heights blend; perspective moves the solid's top.
    flat = (u > 0.05) & (u < 0.45) & (v > 0.05) & (v < 0.95)
    assert not masked.valid[flat].any()
    assert based.valid[flat].all()
    np.testing.assert_allclose(based.depth[flat], 2.2 + 0.5 * SCALE, rtol=1e-5)


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("slicing", ["surface", "orthogonal", "screen"])
def test_at_least_draws_all_of_the_base_from_any_side(slicing, projection):
    """Heights of 0: no rounding of where a ray meets the base may miss it."""
    flat = np.zeros((32, 32), np.float32)
    for elevation in (70, 45, 20):
        cam = camera(elevation, 33, (128, 128), projection)
        frame = ibr.render(surface(64, slicing, "at_least", flat), cam)
        truth = ibr.render(square(), cam)
        inner = cv2.erode(truth.valid.astype(np.uint8), np.ones((3, 3))).astype(bool)
        assert inner.sum() > 1000
        assert frame.valid[inner].all()
        # float32 depths of 2.2; a ray that is taken for one on the base is a 100,000th of the displacement above
        assert np.abs(frame.depth - truth.depth)[inner].max() <= 1e-5


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("slicing", ["surface", "orthogonal", "screen"])
@pytest.mark.parametrize("scale", [0.001, 0.01])
def test_at_least_draws_all_of_the_base_however_shallow_it_is(scale, slicing, projection):
    """Of a 3000th of the distance: heights err by more than a 100,000th of it where rays meet the base."""
    base, flat, white = grid(ring, 96, 48), np.zeros((4, 4), np.float32), np.full((2, 2, 3), 255, np.uint8)
    how = {"fov_y": 42.0} if projection == "perspective" else {"projection": projection, "height": 2.9}
    cam = Camera.look_at((2, -2.5, 1.7), (0, 0, 0), (0, 0, 1), (317, 243), **how)
    inner = cv2.erode(ibr.render(base, cam).valid.astype(np.uint8), np.ones((5, 5))).astype(bool)
    assert inner.sum() > 15000
    for slices in (16, 64):
        shown = ibr.SlicedSurface(base, flat, white, scale, slices=slices, slicing=slicing, test="at_least")
        assert ibr.render(shown, cam).valid[inner].all()
    assert not ibr.render(ibr.SlicedSurface(base, flat, white, scale, slicing=slicing), cam).valid.any()


def ground(cam: Camera) -> np.ndarray:
    """Points where rays meet the plane z = 0."""
    y, x = np.mgrid[: cam.height, : cam.width]
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(cam.K).T @ cam.world_from_camera[:3, :3].T
    origin = cam.world_from_camera[:3, 3]
    return origin + rays * (-origin[2] / rays[..., 2])[..., None]


def test_a_band_opens_steps_between_neighbours():
    """A cliff seen from the side: `inside` fills it, a band shows its top and bottom only."""
    height = np.full((32, 32), 0.1, np.float32)
    height[:, 16:] = 0.9
    cam = camera(20, 180)
    whole = ibr.render(surface(64, "surface", "inside", height), cam)
    band = ibr.render(surface(64, "surface", "band", height), cam)
    assert band.valid.sum() < 0.9 * whole.valid.sum()
    assert not (band.valid & ~whole.valid).any()


def cliffs() -> np.ndarray:
    """A slope with a cliff of 0.3 and one of 0.6, none of them at the border."""
    height = np.tile(np.linspace(0.02, 0.09, 128), (128, 1)).astype(np.float32)
    height[:, 41:87] += 0.3
    height[:, 87:] += 0.9
    return height


@pytest.mark.parametrize("slicing", ["surface", "orthogonal", "screen"])
def test_a_bands_thickness_decides_what_is_apart(slicing):
    """From above nothing of the surface is missed; from the side cliffs are open that are higher than the band.

    Slices are several texels apart, so that hardly one meets the ramps that cliffs are between two texels.
    """
    above, aside = camera(90, 90, projection="orthographic"), camera(20, 180)
    color = np.full((1, 1, 3), 9, np.uint8)
    whole = {cam: ibr.render(surface(16, slicing, "inside", cliffs()), cam).valid for cam in (above, aside)}
    open_at = {}
    for band in (None, 1 / 16, 0.15, 0.45, 0.75, 5.0):
        thing = ibr.SlicedSurface(square(), cliffs(), color, SCALE, slices=16, slicing=slicing, test="band", band=band)
        missed = {cam: (seen & ~ibr.render(thing, cam).valid).sum() / seen.sum() for cam, seen in whole.items()}
        assert missed[above] <= 0.03  # the cliffs themselves: a texel of 128, and a pixel of 100, each
        open_at[band] = missed[aside]
    assert open_at[None] == open_at[1 / 16]
    # Of a cliff what lies lower than a band below its top is open.
    assert open_at[0.15] > 1.2 * open_at[0.45] > 1.2 * open_at[0.75]
    assert open_at[0.45] > 0.02
    assert open_at[0.75] < 0.01
    assert open_at[5.0] == 0


def test_a_band_thinner_than_a_slice_leaves_gaps():
    """Of a slope seen from above each slice shows the part that lies in its band: a half, a quarter."""
    slope = np.tile((np.arange(64) + 0.5) / 64, (64, 1)).astype(np.float32)
    cam = Camera.look_at((0.5, 0.5, 40), (0.5, 0.5, 0), (0, 1, 0), (301, 301), fov_y=1.3)
    inner = (np.abs(ground(cam)[..., :2] - 0.5) < 0.4).all(axis=-1)
    color = np.full((1, 1, 3), 9, np.uint8)
    for part in (1, 0.5, 0.25):
        thing = ibr.SlicedSurface(
            square(), slope, color, 0.01, slices=20, slicing="surface", test="band", band=part / 20
        )
        # 16 slices' edges among 265 pixels across: a pixel each
        assert abs(ibr.render(thing, cam).valid[inner].mean() - part) <= 16 / 265


def test_tests_are_counted():
    cam = camera(60, 30)
    counts = {}
    for slicing in ("surface", "orthogonal", "screen"):
        thing = surface(64, slicing)
        counted, seen = alpha_tests(thing, cam), ibr.render(thing, cam).valid
        assert (counted[seen] >= 1).all()
        assert counted.max() <= 3 * 64 * 2  # no more than the slices that a ray can cross
        counts[slicing] = counted[seen].mean()
    assert counts["orthogonal"] < 64


@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_the_cost_stays_even(slicing):
    """Section 3.4: more slices across the surface than along its normal, but each covers fewer pixels."""
    tests = [alpha_tests(surface(64, slicing), camera(e, d)).sum() for e in ELEVATIONS for d in DIRECTIONS[:2]]
    assert max(tests) <= 1.5 * min(tests)


@pytest.mark.parametrize("elevation", [60, 10])
def test_slices_beside_the_volume_change_the_cost_alone(elevation):
    cam = camera(elevation, 30)
    clipped, whole = surface(32, "screen"), surface(32, "screen", clipped=False)
    frames = [ibr.render(thing, cam) for thing in (clipped, whole)]
    # A slice that grazes an edge of the volume may be within rounding on one side of it, and without on the other.
    assert (frames[0].valid != frames[1].valid).mean() < 1e-3
    both = frames[0].valid & frames[1].valid
    assert (np.abs(frames[0].depth - frames[1].depth)[both] > 1e-5).mean() < 1e-3
    assert alpha_tests(whole, cam).sum() > 1.5 * alpha_tests(clipped, cam).sum()


def test_other_heights_are_checked_as_the_first_ones():
    first = surface(32, "orthogonal")
    for bad in (np.zeros((1, 3 << 20), np.uint8), np.full((4, 4), 2.0), np.zeros((4, 4), int), None):
        messages: list[str] = []
        takers = (first.with_height, lambda height: ibr.SlicedSurface(first.base, height, first.color, SCALE))
        for take in takers:
            with pytest.raises(ibr.ArgumentError) as caught:
                take(bad)
            messages.append(str(caught.value))
        assert messages[0] == messages[1]


def test_other_heights_without_rebuilding():
    first = surface(32, "orthogonal")
    cam = camera(50, 20)
    ibr.render(first, cam)
    second = first.with_height(np.clip(heights() * 0.5, 0, 1))
    assert second.volume is first.volume
    frame, fresh = ibr.render(second, cam), ibr.render(surface(32, "orthogonal", height=heights() * 0.5), cam)
    np.testing.assert_array_equal(frame.depth, fresh.depth)
    assert not np.array_equal(frame.depth, ibr.render(first, cam).depth, equal_nan=True)


def test_colour_and_tiles():
    """Seen from above, a flat surface is its colour image, repeated."""
    color = np.zeros((2, 2, 3), np.uint8)
    color[0, 0], color[1, 1] = (255, 0, 0), (0, 255, 0)
    flat = np.full((2, 2), 0.5, np.float32)
    thing = ibr.SlicedSurface(square(), flat, color, 1e-3, tiles=(4, 2), slices=4)
    cam = camera(90, 90, (96, 96))
    frame = ibr.render(thing, cam)
    point = ground(cam)
    for u, v, expected in ((1 / 16, 1 / 8, (255, 0, 0)), (3 / 16, 3 / 8, (0, 255, 0)), (5 / 16, 1 / 8, (255, 0, 0))):
        y, x = np.unravel_index(np.hypot(point[..., 0] - u, point[..., 1] - v).argmin(), frame.valid.shape)
        # A pixel is 1/60 of the square, hence up to 1/15 of a texel off its centre: 2/15 of the range
        assert np.abs(frame.color[y, x].astype(int) - expected).max() <= 2 / 15 * 255


def test_shading_by_slopes_and_by_a_normal_map():
    """A ramp: its normal is known, and a constant normal map says the same."""
    n = 64
    ramp = np.tile((np.arange(n) + 0.5) / n * 0.5 + 0.2, (n, 1)).astype(np.float32)
    color = np.full((1, 1, 3), 255, np.uint8)
    light = ibr.Light(direction=(-1, 0, -1), ambient=0.0)
    slope = 0.5 * SCALE
    normal = np.array([-slope, 0, 1]) / np.hypot(slope, 1)
    expected = 255 * normal @ np.array([1, 0, 1]) / np.sqrt(2)
    cam = camera(90, 90, (64, 64))
    point = ground(cam)
    inside = (np.abs(point[..., :2] - 0.5) < 0.4).all(axis=-1)
    maps = {"slopes": None, "map": np.tile(normal.astype(np.float32), (4, 4, 1))}
    for name, normal_map in maps.items():
        thing = ibr.SlicedSurface(square(), ramp, color, SCALE, slices=64, normal_map=normal_map)
        shaded = ibr.render(thing, cam, light).color[inside].astype(float)
        assert np.abs(shaded - expected).max() <= 1, name  # rounding to bytes, and float32


@pytest.mark.parametrize("make", [ibr.SlicedSurface, ibr.ReliefSurface])
def test_a_normal_map_of_bytes_is_decoded(make):
    """As the reader of relief maps does; 127 and 128 both are 0."""
    rng = np.random.default_rng(4)
    normals = rng.normal(size=(8, 8, 3)) * (0.4, 0.4, 0) + (0, 0, 1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    in_bytes = np.rint((normals + 1) * 127.5).astype(np.uint8)
    color, height = np.full((2, 2, 3), 255, np.uint8), np.full((4, 4), 0.5, np.float32)
    light, cam = ibr.Light(direction=(-1, -0.5, -1), shadow_size=0), camera(70, 40, (64, 64))
    frames = [
        ibr.render(make(square(), height, color, 0.01, normal_map=given), cam, light)
        for given in (normals.astype(np.float32), in_bytes)
    ]
    assert frames[0].color[frames[0].valid].std() > 20
    # Half a byte of 127.5 in each of three components, all the way through Lambert's law
    assert np.abs(frames[0].color.astype(int) - frames[1].color).max() <= 3
    level = make(square(), height, color, 0.01, normal_map=np.array([[[255, 128, 127], [127, 127, 255]]], np.uint8))
    assert (level.normal_map[..., 2] > 0).all()


@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_a_donut_of_constant_height_is_a_fatter_donut(slicing):
    """No gap between polygons: what is seen is the donut 0.1 farther out, to a slice and the polygons' sagitta."""
    height, color = np.ones((4, 4), np.float32), np.full((1, 1, 3), 200, np.uint8)
    thing = ibr.SlicedSurface(
        models.donut(), height, color, 0.1, tiles=(8, 4), slices=20, slicing=slicing, test="at_least"
    )
    cam = Camera.look_at((1.5, -2.0, 2.5), (0, 0, 0), (0, 0, 1), (160, 120), fov_y=45)
    frame = ibr.render(thing, cam)
    base = models.donut()
    outer = ibr.Mesh(base.vertices + 0.1 * base.normals, base.faces)
    truth = ibr.render(outer, cam)
    both = frame.valid & truth.valid
    assert both.sum() / (frame.valid | truth.valid).sum() >= 0.99
    off = (frame.depth - truth.depth)[both]
    assert np.median(np.abs(off)) <= 0.1 / 20
    assert np.quantile(np.abs(off), 0.9) <= 3 * 0.1 / 20  # a slice is met obliquely


BAD = [
    ("height", {"height": np.full((4, 4), 1.5, np.float32)}, "height"),
    ("negative height", {"height": np.full((4, 4), -0.1, np.float32)}, "height"),
    ("NaN height", {"height": np.full((4, 4), np.nan, np.float32)}, "height"),
    ("empty height", {"height": np.zeros((0, 4), np.float32)}, "height"),
    ("height of strings", {"height": np.array([["a"]])}, "height"),
    ("gray colour", {"color": np.zeros((4, 4), np.uint8)}, "color"),
    ("scale 0", {"scale": 0.0}, "scale"),
    ("scale NaN", {"scale": float("nan")}, "scale"),
    ("tiles 0", {"tiles": (0, 1)}, "tiles"),
    ("tiles 1.5", {"tiles": (1.5, 1)}, "tiles"),
    ("more tiles than floats count", {"tiles": (10**6, 1)}, "uv"),
    ("slices 0", {"slices": 0}, "slices"),
    ("slices 2.5", {"slices": 2.5}, "slices"),
    ("slicing", {"slicing": "sideways"}, "slicing"),
    ("test", {"test": "maybe"}, "test"),
    ("band 0", {"band": 0}, "band"),
    ("band NaN", {"band": float("nan")}, "band"),
    ("band of words", {"band": "thick"}, "band"),
    ("normal map", {"normal_map": np.zeros((4, 4, 3), np.float32)}, "normal_map"),
    ("black normal map", {"normal_map": np.zeros((4, 4, 3), np.uint8)}, "normal_map"),
    ("normal map of int", {"normal_map": np.full((4, 4, 3), 200, np.int32)}, "normal_map"),
    ("NaN normal map", {"normal_map": np.full((4, 4, 3), np.nan, np.float32)}, "normal_map"),
    ("empty normal map", {"normal_map": np.zeros((0, 4, 3), np.uint8)}, "normal_map"),
    ("no mesh", {"base": 3}, "base"),
    ("no uv", {"base": ibr.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])}, "base"),
]


@pytest.mark.parametrize(("what", "changes", "argument"), BAD, ids=[case[0] for case in BAD])
def test_bad_input(what, changes, argument):
    good = {"base": square(), "height": heights(), "color": np.zeros((2, 2, 3), np.uint8), "scale": 1.0}
    with pytest.raises(ibr.ArgumentError, match=f"^{argument}: "):
        ibr.SlicedSurface(**{**good, **changes})


def test_degenerate_triangles_and_flat_uv_are_drawn_or_not_but_do_no_harm():
    corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 2, 2]]
    mesh = ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3], [0, 0, 1], [4, 4, 4]], uv=np.zeros((5, 2)))
    thing = ibr.SlicedSurface(mesh, heights(), np.full((2, 2, 3), 9, np.uint8), 0.1)
    for elevation in (90, 20):
        frame = ibr.render(thing, camera(elevation, 30, (61, 37)))
        assert np.isfinite(frame.depth[frame.valid]).all()
        assert frame.valid.any()


@pytest.mark.parametrize("slicing", ["surface", "orthogonal", "screen"])
@pytest.mark.parametrize("shape", ["cone", "sphere"])
def test_coincident_vertices_at_a_tip_or_a_pole_draw_nothing(shape, slicing):
    """Meshes as modellers make them: a vertex at the tip for each u, and triangles between these."""
    u, v = np.meshgrid(np.linspace(0, 1, 49), np.linspace(0, 1, 13))
    a, ring = 2 * np.pi * u, (1 - v if shape == "cone" else np.sin(np.pi * v).round(9))
    z = 1.5 * v if shape == "cone" else -np.cos(np.pi * v)
    vertices = np.stack([ring * np.cos(a), ring * np.sin(a), z], axis=-1).reshape(-1, 3)
    i = (np.arange(12)[:, None] * 49 + np.arange(48)).ravel()
    faces = np.concatenate([np.stack([i, i + 1, i + 50], 1), np.stack([i, i + 50, i + 49], 1)])
    corner = vertices[faces]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    assert (area < 1e-9).any()
    uv, cam = (
        np.stack([u, v], -1).reshape(-1, 2),
        Camera.look_at((2.5, -3, 2), (0, 0, 0.3), (0, 0, 1), (161, 121), fov_y=45),
    )
    height, color = np.full((4, 4), 0.5, np.float32), np.full((1, 1, 3), 255, np.uint8)
    frames = [
        ibr.render(ibr.SlicedSurface(ibr.Mesh(vertices, kept, uv=uv), height, color, 0.3, slicing=slicing), cam)
        for kept in (faces, faces[area > 1e-9])
    ]
    assert frames[0].valid.sum() > 2000
    np.testing.assert_array_equal(frames[0].valid, frames[1].valid)
    np.testing.assert_array_equal(frames[0].depth, frames[1].depth)


def test_what_is_made_cannot_be_changed():
    made = surface(8, "screen")
    for name in ("color", "height", "scale", "slices"):
        with pytest.raises(AttributeError, match="make a new one"):
            setattr(made, name, getattr(made, name))


def test_flat_heights_are_lit_as_the_mesh():
    """Normals are interpolated: no facets."""
    base = models.donut(16)
    flat, color = np.full((4, 4), 0.999, np.float32), np.full((1, 1, 3), 204, np.uint8)
    light = ibr.Light(direction=(0.4, 0.8, -0.8), shadow_size=0)
    cam = Camera.look_at((1.5, -2.0, 2.5), (0, 0, 0), (0, 0, 1), (160, 120), fov_y=45)
    thing = ibr.SlicedSurface(base, flat, color, 0.001, slices=16)
    frame = ibr.render(thing, cam, light)
    mesh = ibr.render(ibr.Mesh(base.vertices, base.faces, normals=base.normals), cam, light)
    both = frame.valid & mesh.valid
    off = np.abs(frame.color.astype(int) - mesh.color)[both].max(axis=1)
    assert np.median(off) <= 1
    assert np.quantile(off, 0.98) <= 6  # farther out by 0.001, a pixel at an edge sees the next triangle


def test_colours_far_away_are_means():
    """A fine checker from afar: a pixel covers many texels."""
    checker = np.repeat((np.indices((128, 128)).sum(axis=0) % 2 * 255).astype(np.uint8)[..., None], 3, axis=2)
    flat = np.full((4, 4), 0.5, np.float32)
    cam = Camera.look_at((0.5, 0.5, 30), (0.5, 0.5, 0), (0, 1, 0), (61, 61), fov_y=2)
    frame = ibr.render(ibr.SlicedSurface(square(), flat, checker, 0.1, tiles=(4, 4), slices=16), cam)
    inner = frame.color[frame.valid][:, 0].astype(float)
    assert inner.std() <= 2
    assert abs(inner.mean() - 127.5) <= 2


@pytest.mark.parametrize("kind", [ibr.SlicedSurface, ibr.ReliefSurface])
def test_vertices_that_nothing_uses_change_nothing(kind):
    """At the corners of a box, in a triangle without area, and far away."""
    base, height = facets(box()), np.full((4, 4), 0.5, np.float32)
    camera, light = (
        Camera.look_at((2.5, -2.1, 3.4), (0, 0, 0), (0, 0, 1), (96, 80), fov_y=42),
        ibr.Light(direction=(-0.4, 0.5, -1)),
    )
    corners, uv, faces = base.vertices, np.asarray(base.uv), base.faces
    middle = np.array([corners[0], corners[1], 0.5 * (corners[0] + corners[1])])
    flat = np.concatenate([faces, len(corners) + np.arange(3)[None]])

    def drawn(more: np.ndarray, faces: np.ndarray) -> tuple[ibr.Frame, np.ndarray]:
        there = np.concatenate([uv, np.zeros((len(more), 2))])
        mesh = ibr.Mesh(np.concatenate([corners, more]), faces, uv=there)
        made = kind(mesh, height, np.full((1, 1, 3), 255, np.uint8), 0.1)
        return ibr.render(made, camera, light), np.array(made.bounds)

    expected, bounds = drawn(np.empty((0, 3)), faces)
    assert expected.valid.sum() > 1000
    for more, those in ((corners[:8], faces), (middle, flat), (np.array([[2000.0, 0, 0]]), faces)):
        found, around = drawn(more, those)
        np.testing.assert_array_equal(found.valid, expected.valid)
        np.testing.assert_allclose(found.depth, expected.depth, rtol=1e-5)
        np.testing.assert_allclose(found.color.astype(int), expected.color.astype(int), atol=1)
        np.testing.assert_allclose(around, bounds, rtol=1e-6)


def test_seams_by_rounded_sines_are_closed():
    """A textbook's sphere ends at the sine of two pi, which is not 0 for computers: displaced, it stays whole."""
    v, u = np.mgrid[:11, :17]
    polar, around = np.pi * v / 10, 2 * np.pi * u / 16
    points = [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)]
    first = (v * 17 + u)[:-1, :-1].ravel()
    faces = np.concatenate(
        [np.stack([first, first + 17, first + 1], 1), np.stack([first + 1, first + 17, first + 18], 1)]
    )
    exact = [np.where(np.abs(part) < 1e-12, 0, part) for part in points]
    camera = Camera.look_at((3, 0.3, 0.4), (0, 0, 0), (0, 0, 1), (96, 80), fov_y=42)  # towards the seam
    depths = [
        ibr.render(
            ibr.SlicedSurface(
                ibr.Mesh(np.stack(form, -1).reshape(-1, 3), faces, uv=np.stack([u / 16, v / 10], -1).reshape(-1, 2)),
                np.full((4, 4), 0.5, np.float32),
                np.full((1, 1, 3), 255, np.uint8),
                0.2,
            ),
            camera,
        ).depth
        for form in (points, exact)
    ]
    np.testing.assert_allclose(depths[0], depths[1], atol=1e-4)
