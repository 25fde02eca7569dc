"""Colours, textures and light of meshes compared with their formulas in float64."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from tests.embree import points_of
from tests.reference.heights import bilinear_height
from tests.reference.raster import weights
from tests.scenes import pose

CORNERS = np.array([[-1, -1, 2.0], [1.5, -1, 4], [1.5, 1, 4], [-1, 1, 2]])
FACES = [[0, 2, 1], [0, 3, 2]]
UV = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])


def camera(projection: str = "perspective", size: tuple[int, int] = (90, 70)) -> Camera:
    return Camera([[50, 0, 40], [0, 50, 34.5], [0, 0, 1]], size, projection=projection)


def on_plane(frame: ibr.Frame) -> np.ndarray:
    """(n, 2) u and v at the points that valid pixels show; on the rectangle, x = -1 + 2.5 u and y = -1 + 2 v."""
    return (points_of(frame)[:, :2] + 1) / (2.5, 2)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_colours_are_linear_on_the_surface_not_on_the_screen(projection):
    colors = np.column_stack([UV, 1 - UV[:, :1]]).astype(np.float32)
    cam = camera(projection)
    frame = ibr.render(ibr.Mesh(CORNERS, FACES, colors=colors), cam)
    u, v = on_plane(frame).T
    expected = 255 * np.stack([u, v, 1 - u], axis=-1)
    assert frame.valid.sum() > 1000
    assert np.abs(frame.color[frame.valid] - expected).max() <= 0.6  # rounding to bytes, and float32 positions


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_colours_of_any_triangle(projection, dtype):
    """Steep and small triangles, and triangles that reach behind the camera, have colours by float64 weights."""
    rng = np.random.default_rng(2)
    n = 60
    cam = camera(projection)
    middle = cam.unproject(rng.uniform((0, 0), cam.size, (n, 2)), rng.uniform(2, 6, n))
    points = middle[:, None] + rng.normal(size=(n, 3, 3)) * ((1, 1, 1.5) if projection == "perspective" else 0.3)
    colors = rng.integers(0, 256, (3 * n, 3)).astype(dtype) if dtype == np.uint8 else rng.random((3 * n, 3), np.float32)
    number = np.column_stack([np.arange(n), 0 * np.arange(n), 0 * np.arange(n)]).astype(np.uint8).repeat(3, 0)
    faces = np.arange(3 * n).reshape(-1, 3)
    frame = ibr.render(ibr.Mesh(points.reshape(-1, 3), faces, colors=colors), cam)
    owner = ibr.render(ibr.Mesh(points.reshape(-1, 3), faces, colors=number), cam).color[frame.valid][:, 0]
    pixels = np.argwhere(frame.valid)[:, ::-1]
    weight = np.clip(weights(cam, points[owner], pixels), 0, 1)  # rounded corners may cover pixels outside
    expected = np.einsum("nk,nkc->nc", weight, colors.reshape(n, 3, 3)[owner].astype(float))
    expected *= 1 if dtype == np.uint8 else 255
    assert len(np.unique(owner)) > 20
    assert np.abs(frame.color[frame.valid] - expected).max() <= 0.6  # rounding to bytes, and float32 positions


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_a_magnified_texture_is_bilinear(projection):
    texture = np.random.default_rng(0).integers(0, 256, (5, 7, 3)).astype(np.uint8)
    cam = camera(projection)
    frame = ibr.render(ibr.Mesh(CORNERS, FACES, uv=3 * UV - 1, texture=texture), cam)  # tiles, u and v begin at -1
    u, v = (3 * on_plane(frame) - 1).T
    expected = np.stack([bilinear_height(texture[..., c].astype(float), u, v) for c in range(3)], axis=-1)
    # 1 level of 255, for 21 texels over some 60 pixels: rounding to bytes, and float32 positions.
    assert np.abs(frame.color[frame.valid] - expected).max() <= 1


def test_mip_mapping():
    """From afar, a fine checkerboard is grey; at any distance, a texture of one colour keeps its colour."""
    y, x = np.mgrid[:256, :256]
    board = np.where((x + y) % 2, 255, 0).astype(np.uint8)[..., None].repeat(3, 2)
    flat = np.full((37, 53, 3), 77, np.uint8)
    for depth in (3, 10, 40):
        square = (CORNERS * (1, 1, 0)) * 10 + (0, 0, depth)
        frame = ibr.render(ibr.Mesh(square, FACES, uv=UV * 40, texture=board), camera())
        if depth > 3:  # at least 20 texels per pixel
            assert np.abs(frame.color[frame.valid].astype(int) - 127).max() <= 2
        frame = ibr.render(ibr.Mesh(square, FACES, uv=UV * 40, texture=flat), camera())
        assert (frame.color[frame.valid] == 77).all()


def test_a_texture_far_away_is_its_mean():
    """The mean is also right for floats, and for textures of odd size, whose levels do not halve evenly."""
    rng = np.random.default_rng(0)
    for dtype, size in ((np.uint8, (37, 53)), (np.uint8, (1, 7)), (np.float32, (64, 16))):
        texture = rng.random((*size, 3))
        texture = (texture * 255).astype(dtype) if dtype == np.uint8 else texture.astype(dtype)
        square = (CORNERS * (1, 1, 0)) * 10 + (0, 0, 40)
        frame = ibr.render(ibr.Mesh(square, FACES, uv=UV * 40, texture=texture), camera())
        mean = texture.mean(axis=(0, 1)) * (1 if dtype == np.uint8 else 255)
        # 2: each of up to six levels is rounded to bytes.
        assert frame.valid.sum() > 500
        assert np.abs(frame.color[frame.valid] - mean).max() <= 2


def test_a_checkered_floor_blurs_towards_the_horizon():
    """Near the camera the floor is black and white; where a pixel sees many squares, it is an even grey."""
    board = np.kron([[0, 1], [1, 0]], np.ones((64, 64)))[..., None].repeat(3, 2).astype(np.float32)
    floor = ibr.Mesh(
        [[-400, 1, -400], [400, 1, -400], [400, 1, 400], [-400, 1, 400]], FACES, uv=UV * 800, texture=board
    )
    frame = ibr.render(floor, Camera([[100, 0, 80], [0, 100, 2], [0, 0, 1]], (161, 121)))
    assert frame.valid[3:].all()
    feet, far = frame.color[60:, :, 0].astype(float), frame.color[3:6, :, 0].astype(float)
    assert ((feet < 3) | (feet > 252)).mean() > 0.8  # a square is 50 pixels or more wide
    assert far.std() < 2  # a pixel sees 4 squares or more in y
    assert abs(far.mean() - 127.5) < 2


LIGHTS = [
    ibr.Light(direction=(0.3, 0.5, 1)),
    ibr.Light(direction=(1, 0, 0.2), color=(1, 0.5, 0.2), ambient=0.0),
    ibr.Light(position=(-2, 1, -1), ambient=0.4),
]


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("light", LIGHTS, ids=repr)
@pytest.mark.parametrize("turned", [False, True])
def test_lambert(light, projection, turned):
    """The visible side is lit, whether it is the front or the back."""
    faces = [face[::-1] for face in FACES] if turned else FACES
    cam = camera(projection)
    frame = ibr.render(ibr.Mesh(CORNERS, faces, colors=np.full((4, 3), 200, np.uint8)), cam, light)
    point = points_of(frame)
    normal = np.array([2, 0, -2.5]) / np.hypot(2, 2.5)  # the plane's normal, towards the camera
    to_light = np.tile(-light.direction, (len(point), 1)) if light.position is None else light.position - point
    cosine = np.maximum(to_light @ normal / np.linalg.norm(to_light, axis=1), 0)
    expected = 200 * (light.ambient + (1 - light.ambient) * cosine[:, None] * light.color)
    assert np.abs(frame.color[frame.valid] - np.minimum(expected, 255)).max() <= 0.6


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_normals_are_interpolated_and_made_unit_length(projection):
    """The mesh has normals up to 100 degrees apart, on triangles seen from the front or from the back."""
    rng = np.random.default_rng(3)
    light = ibr.Light(direction=(0.2, -0.4, 1), ambient=0.1)
    for turned in (False, True):
        normals = rng.normal(size=(3, 3)) * 0.6 + (0, 0, 1 if turned else -1)
        face, cam = [[0, 1, 2] if turned else [0, 2, 1]], camera(projection)
        frame = ibr.render(ibr.Mesh(CORNERS[:3], face, normals=normals, colors=np.ones((3, 3), np.float32)), cam, light)
        pixels = np.argwhere(frame.valid)[:, ::-1]
        weight = weights(cam, np.tile(CORNERS[:3], (len(pixels), 1, 1)), pixels)
        normal = weight @ (normals / np.linalg.norm(normals, axis=1, keepdims=True))
        seen = -1 if turned else 1  # if turned, normals point away from the camera
        cosine = seen * normal @ -light.direction / np.linalg.norm(normal, axis=1) / np.linalg.norm(light.direction)
        expected = 255 * (0.1 + 0.9 * np.maximum(cosine, 0))
        assert len(pixels) > 500
        assert np.abs(frame.color[frame.valid] - expected[:, None]).max() <= 0.6


@pytest.mark.parametrize("shadow_size", [0, 64])
def test_normals_tell_the_front_however_corners_run(shadow_size):
    """A ball whose triangles are wound clockwise, or at random, is lit like one whose triangles are wound correctly."""
    a, b = np.meshgrid(np.linspace(0, 2 * np.pi, 40)[:-1], np.linspace(0.01, np.pi - 0.01, 20))
    outward = np.stack([np.sin(b) * np.cos(a), -np.cos(b), np.sin(b) * np.sin(a)], axis=-1).reshape(-1, 3)
    i, j = (part.ravel() for part in np.mgrid[:19, :39])
    k, right = 39 * i + j, 39 * i + (j + 1) % 39
    out = np.concatenate([np.stack([k, k + 39, right], 1), np.stack([right, k + 39, right + 39], 1)])
    mixed = np.where(np.random.default_rng(0).random((len(out), 1)) < 0.5, out, out[:, ::-1])
    light = ibr.Light(direction=(0.2, 0.5, 1), specular=0.4, shadow_size=shadow_size)
    cam = Camera([[90, 0, 40], [0, 90, 34.5], [0, 0, 1]], (90, 70))
    corner = outward[out]
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    assert ((across * corner.mean(axis=1)).sum(axis=1) > 0).all()
    ball = np.add(outward, (0, 0, 4))
    well, *others = (
        ibr.render(ibr.Mesh(ball, faces, normals=outward), cam, light) for faces in (out, out[:, ::-1], mixed)
    )
    assert well.color[well.valid].max() > 200
    for frame in others:
        off = np.abs(frame.color.astype(int) - well.color).max(axis=-1)
        assert (off <= 1).mean() >= 0.999  # turned triangles cover other pixels at edges
    inside = Camera([[50, 0, 40], [0, 50, 34.5], [0, 0, 1]], (90, 70), pose(center=(0, 0, 4)))
    ahead = ibr.Light(direction=(0, 0, 1), shadow_size=0)
    lit = [
        ibr.render(ibr.Mesh(ball, faces, normals=normals), inside, ahead)
        for faces, normals in ((out, outward), (mixed, outward), (out, -outward))
    ]
    for frame in lit:  # inside, the wall ahead faces the light
        assert frame.color[35, 40, 0] >= 203


def test_a_light_shades_textures_and_greys_too():
    """Light perpendicular to the surface shows its full colour; parallel light leaves only the ambient part.

    Meshes without colours have the grey 0.8.
    """
    square = np.array([[-1, -1, 3], [1, -1, 3], [1, 1, 3], [-1, 1, 3.0]])
    texture = np.full((2, 3, 3), (200, 100, 50), np.uint8)
    for mesh, own in (
        (ibr.Mesh(square, FACES, uv=UV, texture=texture), (200, 100, 50)),
        (ibr.Mesh(square, FACES), (204, 204, 204)),
    ):
        for direction, part in (((0, 0, 1), 1), ((1, 0, 0), 0.25), ((0, 0, -1), 0.25)):
            frame = ibr.render(mesh, camera(), ibr.Light(direction=direction))
            assert np.abs(frame.color[frame.valid] - np.multiply(own, part)).max() <= 0.6
        frame = ibr.render(mesh, camera(), ibr.Light(direction=(0, 0, 1), color=(9, 1, 0), ambient=0.0))
        assert (frame.color[frame.valid] == (255, own[1], 0)).all()  # clipped to 255
