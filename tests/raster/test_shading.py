"""Colours, textures and light of meshes against their formulas in float64."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.camera import Camera

CORNERS = np.array([[-1, -1, 2.0], [1.5, -1, 4], [1.5, 1, 4], [-1, 1, 2]])
FACES = [[0, 2, 1], [0, 3, 2]]
UV = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])


def camera(projection: str = "perspective", size: tuple[int, int] = (90, 70)) -> Camera:
    return Camera([[50, 0, 40], [0, 50, 34.5], [0, 0, 1]], size, projection=projection)


def on_plane(cam: Camera, frame: ibr.Frame) -> np.ndarray:
    """(n, 2) u and v of the square at the frame's valid pixels: x is -1 + 2.5 u, y is -1 + 2 v."""
    y, x = np.nonzero(frame.valid)
    point = cam.unproject(np.stack([x, y], axis=-1), frame.depth[frame.valid].astype(float))
    return np.stack([(point[:, 0] + 1) / 2.5, (point[:, 1] + 1) / 2], axis=-1)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_colours_are_linear_on_the_surface_not_on_the_screen(projection):
    colors = np.column_stack([UV, 1 - UV[:, :1]]).astype(np.float32)
    cam = camera(projection)
    frame = ibr.render(ibr.Mesh(CORNERS, FACES, colors=colors), cam)
    u, v = on_plane(cam, frame).T
    expected = 255 * np.stack([u, v, 1 - u], axis=-1)
    assert frame.valid.sum() > 1000
    assert np.abs(frame.color[frame.valid] - expected).max() <= 0.6  # rounding to bytes, and float32 positions


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_a_magnified_texture_is_bilinear(projection):
    texture = np.random.default_rng(0).integers(0, 256, (5, 7, 3)).astype(np.uint8)
    cam = camera(projection)
    frame = ibr.render(ibr.Mesh(CORNERS, FACES, uv=3 * UV - 1, texture=texture), cam)  # tiled, from -1 on
    u, v = (3 * on_plane(cam, frame) - 1).T
    x, y = u * 7 - 0.5, v * 5 - 0.5
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - x0)[:, None], (y - y0)[:, None]
    a, b = texture[y0 % 5, x0 % 7] * (1 - fx) + texture[y0 % 5, (x0 + 1) % 7] * fx, None
    b = texture[(y0 + 1) % 5, x0 % 7] * (1 - fx) + texture[(y0 + 1) % 5, (x0 + 1) % 7] * fx
    expected = a * (1 - fy) + b * fy
    # 21 texels over some 60 pixels: 1 unit for rounding to bytes and positions in float32.
    assert np.abs(frame.color[frame.valid] - expected).max() <= 1


def test_mip_mapping():
    """A fine checkerboard far away is its mean, a constant texture is constant at any distance."""
    y, x = np.mgrid[:256, :256]
    board = np.where((x + y) % 2, 255, 0).astype(np.uint8)[..., None].repeat(3, 2)
    flat = np.full((37, 53, 3), 77, np.uint8)
    for depth in (3, 10, 40):
        square = (CORNERS * (1, 1, 0)) * 10 + (0, 0, depth)
        frame = ibr.render(ibr.Mesh(square, FACES, uv=UV * 40, texture=board), camera())
        if depth > 3:  # at least 20 texels a pixel
            assert np.abs(frame.color[frame.valid].astype(int) - 127).max() <= 2
        frame = ibr.render(ibr.Mesh(square, FACES, uv=UV * 40, texture=flat), camera())
        assert (frame.color[frame.valid] == 77).all()


LIGHTS = [
    ibr.Light(direction=(0.3, 0.5, 1)),
    ibr.Light(direction=(1, 0, 0.2), color=(1, 0.5, 0.2), ambient=0.0),
    ibr.Light(position=(-2, 1, -1), ambient=0.4),
]


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("light", LIGHTS, ids=repr)
@pytest.mark.parametrize("turned", [False, True])
def test_lambert(light, projection, turned):
    """Either side is lit as the side that is seen."""
    faces = [face[::-1] for face in FACES] if turned else FACES
    cam = camera(projection)
    frame = ibr.render(ibr.Mesh(CORNERS, faces, colors=np.full((4, 3), 200, np.uint8)), cam, light)
    y, x = np.nonzero(frame.valid)
    point = cam.unproject(np.stack([x, y], axis=-1), frame.depth[frame.valid].astype(float))
    normal = np.array([2, 0, -2.5]) / np.hypot(2, 2.5)  # of the plane, towards the camera
    to_light = np.tile(-light.direction, (len(point), 1)) if light.position is None else light.position - point
    cosine = np.maximum(to_light @ normal / np.linalg.norm(to_light, axis=1), 0)
    expected = 200 * (light.ambient + (1 - light.ambient) * cosine[:, None] * light.color)
    assert np.abs(frame.color[frame.valid] - np.minimum(expected, 255)).max() <= 0.6


BAD_LIGHTS = [
    ({}, "direction"),
    ({"direction": (1, 0, 0), "position": (0, 0, 0)}, "direction"),
    ({"direction": (0, 0, 0)}, "direction"),
    ({"direction": (1, 0)}, "direction"),
    ({"position": (np.nan, 0, 0)}, "position"),
    ({"direction": (1, 0, 0), "color": (-1, 0, 0)}, "color"),
    ({"direction": (1, 0, 0), "ambient": 1.5}, "ambient"),
]


@pytest.mark.parametrize(("arguments", "argument"), BAD_LIGHTS)
def test_bad_lights(arguments, argument):
    with pytest.raises(ibr.ArgumentError, match=f"^{argument}: "):
        ibr.Light(**arguments)
