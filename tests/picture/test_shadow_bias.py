"""The bias of shadow maps: lit surfaces have no dark spots (acne), and shadows begin at the things that cast them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from pyibr.picture.shadow import light_cameras
from tests.displaced import square
from tests.embree import embree
from tests.shadowed import box, edges, first_hits, plane, shares


def sun(elevation: float, turn: float) -> tuple[float, float, float]:
    e, t = np.radians([elevation, turn])
    return -np.cos(e) * np.cos(t), -np.cos(e) * np.sin(t), -np.sin(e)


@pytest.mark.parametrize("size", [64, 256, 1024])
@pytest.mark.parametrize("elevation", [10, 20, 45, 90])
def test_a_lit_plane_has_no_acne(elevation, size):
    """Planes, depth images of a plane and lit sides of boxes have no dark spots, even with texels of many pixels."""
    turned = ibr.Mesh(plane().vertices @ rotation(0.3, 0.2), plane().faces)
    color, depth = np.full((60, 80, 3), 255, np.uint8), np.full((60, 80), 4, np.float32)
    for turn in (33, 200) if elevation < 90 else (0,):
        direction = np.array(sun(elevation, turn))
        near = -3 * direction
        shapes = [
            {"direction": direction},
            {"position": near},
            {"position": near, "direction": direction, "angle": 100},
            {"position": (0, 0, 3 * np.sin(np.radians(elevation)))},
        ]
        for shape in shapes:
            for thing, turned_by in ((plane(), np.eye(3)), (turned, rotation(0.3, 0.2))):
                spun = {key: value if key == "angle" else np.array(value) @ turned_by for key, value in shape.items()}
                camera = Camera.look_at(np.array((0.4, -3, 3)) @ turned_by, (0, 0, 0), (0, 0, 1), (100, 75), fov_y=50)
                picture, plain = (
                    ibr.render(thing, camera, ibr.Light(**spun, shadow_size=n)).color.astype(int) for n in (size, 0)
                )
                assert np.abs(picture - plain).max() <= 1, (turn, shape)
        source = Camera.look_at((0, 0, 4), (0, 0, 0), (0, 1, 0), (80, 60), fov_y=50)
        view = ibr.DepthImage(color, depth, source)
        picture = ibr.render(view, source.moved(0.1, 0.2, 0), ibr.Light(direction=direction, shadow_size=size))
        assert picture.color[picture.valid].min() >= 254


@pytest.mark.parametrize(
    ("size", "projection"),
    [((80, 60), "perspective"), ((160, 120), "orthographic"), ((320, 240), "perspective"), ((80, 60), "orthographic")],
    ids=str,
)
def test_lit_nearest_samples_have_no_acne(projection, size):
    """With nearest samples, a slanted plane and hills are drawn as steps; all of the surface faces the light."""
    K = [[150, 0, 79.5], [0, 150, 59.5], [0, 0, 1]] if projection == "perspective" else np.diag([40.0, 40, 1])
    source = Camera(K, (160, 120), projection=projection)
    y, x = np.mgrid[:120, :160] / 80
    for depth in (4 + x + 0.5 * y, 4 - 0.8 * y, 4 + 0.15 * np.sin(5 * x) * np.cos(4 * y)):
        view = ibr.DepthImage(np.full((120, 160, 3), 255, np.uint8), depth.astype(np.float32), source)
        camera = source.moved(0.2, -0.1, 0.3).resized(size)
        for direction in ((0, 0, 1), (0.1, 0.3, 1), (-0.3, -0.1, 1)):
            for light in (ibr.Light(direction=direction), ibr.Light(position=source.center - np.array(direction))):
                picture = ibr.render(ibr.WarpedView(view, interpolation="nearest"), camera, light)
                dark = picture.color[picture.valid] < 254
                assert picture.valid.mean() > 0.5
                assert dark.mean() <= 0.002, (direction, light.position)  # dark pixels lie at the rims, where steps end


@pytest.mark.parametrize("mapped", [False, True])
@pytest.mark.parametrize("elevation", [50, 70, 90])
@pytest.mark.parametrize("size", [128, 1024])
def test_lit_reliefs_have_no_acne(size, elevation, mapped):
    """All slopes of up to 40 degrees are lit, even if a normal map gives other slopes."""
    y, x = np.mgrid[:32, :32] * (2 * np.pi / 32)
    height = (0.5 + 0.25 * np.sin(x) + 0.25 * np.cos(2 * y)).astype(np.float32)
    level = np.broadcast_to(np.float32([0, 0, 1]), (4, 4, 3)) if mapped else None
    color = np.full((1, 1, 3), 255, np.uint8)
    relief = ibr.ReliefSurface(square(), height, color, 0.15, tiles=(2, 2), normal_map=level)
    camera = Camera.look_at((0.9, -1.0, 1.05), (0.5, 0.5, -0.1), (0, 0, 1), (240, 180), fov_y=42)
    for turn in (0, 33, 200):
        direction = sun(elevation, turn)
        picture, plain = (ibr.render(relief, camera, ibr.Light(direction=direction, shadow_size=n)) for n in (size, 0))
        off = np.abs(picture.color.astype(int) - plain.color).max(axis=2)
        assert off[picture.valid].max() <= 1


@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
@pytest.mark.parametrize("slices", [8, 20, 64])
def test_lit_slices_have_no_acne(slicing, slices):
    """A block's top and visible sides face the light, and are lit for any number of slices."""
    color, height = np.full((1, 1, 3), 255, np.uint8), np.full((8, 8), 0.48, np.float32)
    block = ibr.SlicedSurface(square(), height, color, 0.25, slices=slices, slicing=slicing)
    for eye in ((0.9, -1.2, 1.3), (0.9, -1.6, 0.5)):
        camera = Camera.look_at(eye, (0.5, 0.5, 0.05), (0, 0, 1), (160, 120), fov_y=36)
        for elevation in (10, 30, 60):
            direction = sun(elevation, 280)
            picture, plain = (
                ibr.render(block, camera, ibr.Light(direction=direction, shadow_size=n)) for n in (1024, 0)
            )
            assert picture.valid.sum() > 1500
            assert np.abs(picture.color.astype(int) - plain.color).max() <= 1


def rotation(a: float, b: float) -> np.ndarray:
    return cv2.Rodrigues(np.array([a, b, 0.4]))[0]


@pytest.mark.parametrize("shape", [{"direction": (1, 0, -1)}, {"position": (-3, 0.3, 3)}], ids=str)
@pytest.mark.parametrize("size", [256, 1024])
def test_the_foot_of_a_box_is_in_its_shadow(shape, size):
    """The floor beside the box's dark side is dark from the first pixel on."""
    things = [plane(1.0), box((-0.2, 0, 0.2), (0.2, 0.3, 0.2))]
    camera = Camera.look_at((1.0, 0, 1.6), (0.2, 0, 0), (0, 0, 1), (201, 201), fov_y=40)
    _, points, _ = first_hits(embree(*things), camera)
    for light in (ibr.Light(**shape, shadow_size=size), ibr.Light(**shape, shadow_size=size, angle=60)):
        share, told = shares(things, camera, light)
        floor = (np.abs(points[..., 2]) < 1e-5) & told & (np.abs(points[..., 1]) < 0.2)
        beside = floor & (points[..., 0] > 0) & (points[..., 0] < 0.25)  # the shadow is 0.4 long, or more
        assert beside.sum() > 450
        assert share[beside].max() <= 0.01


def test_a_card_that_stands_on_the_floor():
    """A card has no thickness; its shadow begins at most two texels from its foot."""
    card = ibr.Mesh([[0, -0.5, 0], [0, 0.5, 0], [0, 0.5, 0.6], [0, -0.5, 0.6]], [[0, 1, 2], [0, 2, 3]])
    things, light = [plane(1.0), card], ibr.Light(direction=(1, 0.2, -1))
    camera = Camera.look_at((1.0, 0, 1.6), (0.2, 0, 0), (0, 0, 1), (301, 301), fov_y=40)
    _, points, _ = first_hits(embree(*things), camera)
    share, _ = shares(things, camera, light)
    texel = 1 / min(np.diag(light_cameras(light, [thing.bounds for thing in things])[0].K)[:2])
    beside = (points[..., 2] < 1e-5) & (np.abs(points[..., 1]) < 0.3) & (points[..., 0] > 2 * texel * np.sqrt(2))
    beside &= points[..., 0] < 0.4
    assert beside.sum() > 1000
    assert share[beside].max() <= 0.01


def test_what_is_ten_texels_high_has_a_shadow():
    """At least two thirds of the shadow are drawn. Farther points are lit, because they are moved off the floor."""
    card = ibr.Mesh([[0, -0.5, 0], [0, 0.5, 0], [0, 0.5, 0.03], [0, -0.5, 0.03]], [[0, 1, 2], [0, 2, 3]])
    things, light = [plane(1.0), card], ibr.Light(direction=(1, 0.2, -1), shadow_size=512)
    texel = 1 / light_cameras(light, [thing.bounds for thing in things])[0].K[0, 0]
    assert 9 < 0.03 / texel < 16
    camera = Camera.look_at((0.25, 0, 0.4), (0.015, 0, 0), (0, 0, 1), (301, 301), fov_y=8)
    _, points, _ = first_hits(embree(*things), camera)
    share, _ = shares(things, camera, light)
    beside = (points[..., 2] < 1e-6) & (points[..., 0] > 2 * texel * np.sqrt(2)) & (points[..., 0] < 0.02)
    assert beside.sum() > 5000
    assert share[beside].max() <= 0.01


def room_with_a_card(noise: float, projection: str) -> tuple[ibr.DepthImage, Camera]:
    """A slanted wall and a card in front of it, seen by a depth camera whose noise grows with the square of depth."""
    f, size = (300, (321, 241)) if projection == "perspective" else (75, (321, 241))
    camera = Camera([[f, 0, 160], [0, f, 120], [0, 0, 1]], size, projection=projection)
    y, x = np.mgrid[:241, :321]
    card = (abs(x - 150) < 40) & (abs(y - 110) < 35)
    wall = 4 / (1 + 0.15 * (x - 160) / f) if projection == "perspective" else 4 - 0.15 * (x - 160) / f
    depth = np.where(card, 3, wall)
    depth += noise * (depth / 4) ** 2 * np.random.default_rng(7).normal(size=depth.shape)
    return ibr.DepthImage(np.full((241, 321, 3), 200, np.uint8), depth.astype(np.float32), camera), camera


@pytest.mark.parametrize("relight", [True, False])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("noise", [0.004, 0.012])
def test_noise_of_depth_casts_no_shadow(noise, projection, relight):
    """The card's shadow is the same as without noise, except in a few pixels at the shadow's edges."""
    lamp = {"position": (1.2, -0.8, 0.2)} if projection == "perspective" else {"direction": (-0.3, 0.2, 1)}
    clean, camera = room_with_a_card(0, projection)
    rough, _ = room_with_a_card(noise, projection)
    for thing in (lambda view: view, ibr.DepthMesh, lambda view: ibr.DepthMeshObject([view])):
        dark = []
        for view in (clean, rough):
            bare, shaded = (
                ibr.render(thing(view), camera, ibr.Light(**lamp, shadow_size=size, relight=relight))
                for size in (0, 1024)
            )
            dark.append((bare.color.astype(int) - shaded.color).max(axis=2) > 25)
            shown = bare.valid
        shadow = dark[0] & shown & ~edges(dark[0])
        lit = ~dark[0] & shown & ~edges(dark[0]) & ~edges(clean.depth)
        assert shadow.sum() > 1500 and lit.sum() > 40_000
        assert dark[1][lit].mean() <= 0.02
        assert dark[1][shadow].mean() >= 0.98
