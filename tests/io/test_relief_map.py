"""Relief maps: pictures that hold normals and heights."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

import pyibr as ibr
from pyibr.io import read_relief_map, write_relief_map
from tests.data import shared


def made(shape: tuple[int, int] = (7, 13)) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(*shape, 3)) * (0.5, 0.5, 0) + (0, 0, 1)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    return normals.astype(np.float32), rng.integers(0, 256, shape).astype(np.uint8)


@pytest.mark.parametrize("green", ["down", "up"])
@pytest.mark.parametrize("suffix", [".png", ".tif", ".tga"])
def test_what_is_written_is_read(tmp_path, suffix, green):
    normals, height = made()
    write_relief_map(tmp_path / f"map{suffix}", normals, height, green=green)
    read, same = read_relief_map(tmp_path / f"map{suffix}", green=green)
    np.testing.assert_array_equal(same, height)
    depths = read_relief_map(tmp_path / f"map{suffix}", alpha="depth", green=green)[1]
    np.testing.assert_array_equal(depths, 255 - height)
    assert np.abs(read - normals).max() <= 0.008  # rounding by half of 1/127.5 in each component, then normalised
    other, _ = read_relief_map(tmp_path / f"map{suffix}", green="up" if green == "down" else "down")
    np.testing.assert_allclose(other[..., 1], -read[..., 1], atol=1e-6)


@pytest.mark.thorough
def test_a_real_one_is_drawn():
    path = shared("heightfields/ogre_terrain_cc0/Rock20_normheight.dds")
    normals, height = read_relief_map(path)
    assert normals.shape == (1024, 1024, 3)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1, atol=1e-5)
    square = ibr.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]], uv=np.eye(4, 2))
    relief = ibr.ReliefSurface(square, height, np.full((2, 2, 3), 200, np.uint8), 0.05, normal_map=normals)
    camera = ibr.Camera.look_at((0.5, -0.2, 1), (0.5, 0.5, 0), (0, 1, 0), (61, 37), fov_y=40)
    assert ibr.render(relief, camera, ibr.Light(direction=(1, 1, -1))).valid.mean() > 0.3


@pytest.mark.parametrize("mode", ["RGB", "L"])
def test_pictures_without_alpha_are_refused(tmp_path, mode):
    Image.new(mode, (4, 4)).save(tmp_path / "plain.png")
    with pytest.raises(ibr.FileFormatError, match=rf"plain\.png: expected normals and heights as RGBA, got {mode}"):
        read_relief_map(tmp_path / "plain.png")


def test_wrong_arguments(tmp_path):
    normals, height = made()
    for call, name in (
        (lambda: write_relief_map(tmp_path / "a.png", normals[:3], height), "normal_map"),
        (lambda: write_relief_map(tmp_path / "a.png", -normals, height), "normal_map"),
        (lambda: write_relief_map(tmp_path / "a.png", normals, height / 255), "height"),
        (lambda: write_relief_map(tmp_path / "a.png", normals, height, green="left"), "green"),
        (lambda: read_relief_map(tmp_path / "a.png", alpha="bump"), "alpha"),
    ):
        with pytest.raises(ibr.ArgumentError, match=f"^{name}: "):
            call()
    with pytest.raises(ibr.FileFormatError, match="no such file"):
        read_relief_map(tmp_path / "none.png")
    with pytest.raises(ibr.FileFormatError, match="alpha"):
        write_relief_map(tmp_path / "a.bmp2", normals, height)
