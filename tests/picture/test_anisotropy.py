"""Anisotropic filtering of meshes, sliced surfaces and reliefs, compared with pictures of 64 samples per pixel."""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import cv2
import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.errors import ArgumentError
from pyibr.meshes.textures import normal_pyramid
from tests.displaced import square

KINDS = ["mesh", "slices", "relief"]
TILES = (3, 3)
WHITE = np.full((2, 2, 3), 200, np.uint8)
LIGHT = ibr.Light(direction=(0.3, 0.4, -0.8), shadow_size=0)


def noise(shape: tuple[int, int] = (256, 192)) -> np.ndarray:
    """Noise as sharp as a photograph: its edges are about two texels wide."""
    rough = np.pad(np.random.default_rng(0).random((*shape, 3)), ((8, 8), (8, 8), (0, 0)), mode="wrap")
    smooth = cv2.GaussianBlur(rough, (0, 0), 0.8)[8:-8, 8:-8]
    return np.clip(127 + 400 * (smooth - 0.5), 0, 255).astype(np.uint8)


@cache
def bumps() -> np.ndarray:
    """A repeatable normal map (256, 256, 3) of smooth noise."""
    rough = np.pad(np.random.default_rng(1).random((256, 256)), 16, mode="wrap")
    smooth = 6 * cv2.GaussianBlur(rough, (0, 0), 1.5)[16:-16, 16:-16]
    across, down = (np.roll(smooth, 1, axis) - np.roll(smooth, -1, axis) for axis in (1, 0))
    normals = np.dstack([across, down, np.ones_like(smooth)])
    return (normals / np.linalg.norm(normals, axis=2, keepdims=True)).astype(np.float32)


def turned_square(turn: float) -> ibr.Mesh:
    """The unit square, with uv rotated by `turn` degrees."""
    base = square()
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    return ibr.Mesh(base.vertices, base.faces, uv=np.asarray(base.uv) @ [[c, s], [-s, c]])


def even(kind: str, color: np.ndarray, turn: float = 0, normal_map: np.ndarray | None = None) -> Any:
    """A plane with a texture, as a thing of this kind."""
    base = turned_square(turn)
    if kind == "mesh":
        assert base.uv is not None
        return ibr.Mesh(base.vertices, base.faces, uv=base.uv * np.array(TILES), texture=color)
    if kind == "slices":
        low = np.zeros((4, 4), np.uint8)
        return ibr.SlicedSurface(base, low, color, 0.01, tiles=TILES, slices=4, test="at_least", normal_map=normal_map)
    return ibr.ReliefSurface(base, np.ones((4, 4), np.float32), color, 0.01, tiles=TILES, normal_map=normal_map)


def over(elevation: float, projection: Any = "perspective", azimuth: float = 20, size=(90, 65)) -> ibr.Camera:
    e, a = np.radians(elevation), np.radians(azimuth)
    away = np.array([np.sin(a) * np.cos(e), -np.cos(a) * np.cos(e), np.sin(e)])
    more = {"height": 0.5} if projection == "orthographic" else {}
    return ibr.Camera.look_at(
        (0.5, 0.5, 0) + 1.2 * away, (0.5, 0.5, 0), (0, 0.3, 1), size, fov_y=24, projection=projection, **more
    )


def psnr(frame: ibr.Frame, truth: ibr.Frame) -> float:
    assert truth.alpha is not None
    inside = (truth.alpha == 1) & frame.valid
    assert inside.sum() > 250
    return float(10 * np.log10(255**2 / np.square(frame.color.astype(float) - truth.color)[inside].mean()))


def gain(thing: Any, camera: ibr.Camera, light: ibr.Light | None = None) -> float:
    """Gain of 8 texture reads per pixel over 1 read, in dB of PSNR against 64 samples per pixel."""
    truth = ibr.render(thing, camera, light, samples=64)
    once, often = (psnr(ibr.render(thing, camera, light, anisotropy=n), truth) for n in (1, 8))
    return often - once


@pytest.mark.parametrize(("turn", "projection"), [(0, "perspective"), (45, "orthographic"), (77, "perspective")])
@pytest.mark.parametrize("kind", KINDS)
def test_a_plane_seen_aslant(kind, turn, projection, lanes):
    """Filtering gains 3 dB: it halves the squared error."""
    assert gain(even(kind, noise(), turn), over(10, projection)) >= 3


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["slices", "relief"])
def test_normal_maps(kind):
    assert gain(even(kind, WHITE, normal_map=bumps()), over(10), LIGHT) >= 3


@pytest.mark.parametrize(
    ("make", "elevation"), [(ibr.ReliefSurface, 10), (partial(ibr.SlicedSurface, halvings=3), 20)], ids=KINDS[:0:-1]
)
def test_surfaces_with_heights(make, elevation):
    """The filter's footprint follows the relief's slopes; the base's slopes would be worse than no filter.

    Slopes of slices taken over two texels, as lighting takes them, would gain only 2.6 and 2.4 dB.
    """
    height = (bumps()[..., 0] - bumps()[..., 0].min()) / np.ptp(bumps()[..., 0])
    thing = make(square(), height[::8, ::8].copy(), noise(), 0.02, tiles=TILES)
    assert gain(thing, over(elevation)) >= 3
    assert gain(thing, over(30)) >= 3


@pytest.mark.parametrize("kind", KINDS)
def test_seen_straight_on_it_is_read_once(kind):
    """One read gets the same texels with or without filtering. A mesh reads between levels, and may round otherwise."""
    camera = ibr.Camera.look_at(
        (0.5, 0.5, 2), (0.5, 0.5, 0), (0, 1, 0), (130, 97), fov_y=24, projection="orthographic", height=0.7
    )
    thing = even(kind, noise((256, 256)))
    once, often = (ibr.render(thing, camera, anisotropy=n).color.astype(int) for n in (1, 16))
    assert np.abs(once - often).max() <= 1


def test_what_is_magnified_is_read_once():
    camera, thing = over(10), even("relief", noise((2, 3)))
    once, often = (ibr.render(thing, camera, anisotropy=n).color for n in (1, 64))
    np.testing.assert_array_equal(once, often)


@pytest.mark.parametrize("kind", KINDS)
def test_one_colour_stays_itself(kind):
    """The weights of the reads add up to one."""
    for color in ((10, 200, 77), (255, 255, 255), (0, 0, 0)):
        frame = ibr.render(even(kind, np.full((64, 33, 3), color, np.uint8)), over(5), anisotropy=64)
        assert frame.valid.any()
        assert (frame.color[frame.valid] == color).all()


@pytest.mark.thorough
def test_depth_and_coverage_stay():
    thing = ibr.ReliefSurface(square(), noise((16, 16))[..., 0] / np.float32(255), noise(), 0.05, tiles=TILES)
    once, often = (ibr.render(thing, over(15), LIGHT, anisotropy=n) for n in (1, 8))
    np.testing.assert_array_equal(once.depth, often.depth)


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (5, 3), (64, 48)])
def test_a_map_of_normals_has_its_means(shape):
    normals = np.random.default_rng(2).normal(size=(*shape, 3)).astype(np.float32)
    levels = normal_pyramid(normals)
    np.testing.assert_array_equal(levels[: normals.size].reshape(normals.shape), normals)
    assert np.abs(levels[-3:] - normals.mean(axis=(0, 1))).max() <= 1e-5  # float32 rounding of six levels


@pytest.mark.parametrize("anisotropy", [0, 65, 2.0, True, "8", None])
def test_a_wrong_number_is_refused(anisotropy):
    with pytest.raises(ArgumentError, match=r"anisotropy.*whole number from 1 to 64"):
        ibr.render(even("mesh", noise()), over(10), anisotropy=anisotropy)
