"""Depth in every format: written files read back equal, and are exchanged with other programs."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

import pyibr as ibr
from pyibr.io import image
from tests.io.specimens import SIZES, color_of, depth_of, tiff

DEPTH_SUFFIXES = [".png", ".tiff", ".npy", ".npz", ".pfm", ".exr", ".bin"]
pytestmark = pytest.mark.usefixtures("openexr_if_asked")


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("suffix", DEPTH_SUFFIXES)
def test_depth_round_trip(tmp_path: Path, suffix, size):
    depth, file = depth_of(size), tmp_path / f"depth{suffix}"
    ibr.write_depth(file, depth, depth_scale=1000 if suffix == ".png" else None)
    again = ibr.read_depth(file, depth_scale=1000 if suffix == ".png" else None)
    assert again.dtype == np.float32 and again.flags.c_contiguous
    np.testing.assert_allclose(again, depth, rtol=0, atol=0.50001e-3 if suffix == ".png" else 0)
    assert [f.name for f in tmp_path.iterdir()] == [file.name]  # no temporary file is left


@pytest.mark.parametrize("suffix", DEPTH_SUFFIXES)
def test_scale_means_stored_units_per_scene_unit(tmp_path: Path, suffix):
    file = tmp_path / f"depth{suffix}"
    ibr.write_depth(file, np.full((3, 2), 1.5, np.float32), depth_scale=1000)
    np.testing.assert_allclose(ibr.read_depth(file, depth_scale=500), 3)


@pytest.mark.parametrize("kind", ["z", "distance", "inverse"])
@pytest.mark.parametrize("suffix", [".png", ".npy"])
def test_other_kinds_of_depth_are_what_their_converters_make(tmp_path: Path, kind, suffix):
    depth, file = np.clip(depth_of((61, 37)), 0.5, 9), tmp_path / f"depth{suffix}"
    camera = ibr.Camera([[50, 0, 30], [0, 50, 18], [0, 0, 1]], (61, 37), lens=ibr.Lens("brown_conrady", [0.1] * 4))
    scale = 10_000.0 if kind == "inverse" else 5000.0
    ibr.write_depth(file, depth, depth_scale=scale, depth_kind=kind, camera=camera)
    disparity = ibr.disparity_from_depth(depth, 1, 1)  # for focal length times baseline = 1
    held = {"z": depth, "distance": ibr.euclidean_from_depth(depth, camera), "inverse": disparity}[kind]
    step = 0.5 / scale if suffix == ".png" else 0
    np.testing.assert_allclose(ibr.read_depth(file, depth_scale=scale), held, rtol=1e-6, atol=1.01 * step)
    again = ibr.read_depth(file, depth_scale=scale, depth_kind=kind, camera=camera)
    slope = 9**2 if kind == "inverse" else 1  # most that depth changes per unit of the stored value
    np.testing.assert_allclose(again, depth, rtol=1e-6, atol=1.01 * step * slope)


@pytest.mark.parametrize("suffix", [".png", ".npy"])
def test_disparity_between_principal_points_apart_has_an_offset(tmp_path: Path, suffix):
    focal, baseline, doffs, units = 500.0, 0.1, 7.25, 256  # units: stored units per pixel of disparity
    disparity = np.array([[4.0, 31.5, 0.5, 12.0]])
    how: dict[str, Any] = {"depth_scale": units * focal * baseline, "depth_offset": units * doffs}
    how |= {"depth_kind": "inverse"}
    depth, file = ibr.depth_from_disparity(disparity, focal, baseline, offset=doffs), tmp_path / f"disp{suffix}"
    depth[0, 3] = np.nan
    ibr.write_depth(file, depth, **how)
    stored = image.read_depth(file) if suffix == ".png" else np.load(file)
    np.testing.assert_allclose(stored[0, :3], units * disparity[0, :3], atol=1e-3)  # 1 / z is rounded to float32
    np.testing.assert_allclose(ibr.read_depth(file, **how), depth, rtol=1e-6)
    with pytest.raises(ibr.ArgumentError, match=r"^depth: expected values above depth_offset / depth_scale = 0.145"):
        ibr.write_depth(tmp_path / "d.png", np.full((2, 2), 7.0, np.float32), **how)  # 0.11 pixels below 0
    with pytest.raises(ibr.ArgumentError, match=r"^depth_offset: "):
        ibr.read_depth(file, depth_offset=np.nan, depth_scale=1)


def test_distances_need_their_camera(tmp_path: Path):
    camera = ibr.Camera([[50, 0, 30], [0, 50, 18], [0, 0, 1]], (61, 37))
    ibr.write_depth(tmp_path / "d.npy", depth_of((7, 13)))
    for given, got in ((None, "none"), (camera, "61x37")):
        with pytest.raises(ibr.ArgumentError, match=f"camera: expected the 7x13 camera of the dist.*d.npy, got {got}"):
            ibr.read_depth(tmp_path / "d.npy", depth_scale=None, depth_kind="distance", camera=given)
    with pytest.raises(ibr.ArgumentError, match='kind: expected one of "z", "distance", "inverse"'):
        ibr.read_depth(tmp_path / "d.npy", depth_kind="disparity")  # type: ignore[arg-type]


def test_depth_png_is_the_one_that_others_write_and_read(tmp_path: Path):
    stored = np.random.default_rng(3).integers(0, 65536, (37, 61), dtype=np.uint16)
    cv2.imwrite(str(tmp_path / "cv.png"), stored)
    depth = ibr.read_depth(tmp_path / "cv.png", depth_scale=5000)
    np.testing.assert_array_equal(depth, np.where(stored > 0, stored / 5000, np.nan).astype(np.float32))
    ibr.write_depth(tmp_path / "ours.png", depth, depth_scale=5000)
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "ours.png"), cv2.IMREAD_UNCHANGED), stored)


def test_integer_npy_needs_a_scale_and_has_no_depth_at_zero(tmp_path: Path):
    np.save(tmp_path / "d.npy", np.array([[0, 1500, -3]], np.int16))
    np.testing.assert_array_equal(ibr.read_depth(tmp_path / "d.npy", depth_scale=1000), [[np.nan, 1.5, np.nan]])
    with pytest.raises(ibr.ArgumentError, match="--depth-scale"):
        ibr.read_depth(tmp_path / "d.npy")


def test_npz_with_several_arrays_is_asked_by_name(tmp_path: Path):
    color, depth = color_of((7, 13)), depth_of((7, 13))
    np.savez(tmp_path / "both.npz", color=color, depth=depth)
    np.testing.assert_array_equal(ibr.read_color(tmp_path / "both.npz"), color)
    np.testing.assert_array_equal(ibr.read_depth(tmp_path / "both.npz"), depth)
    np.savez(tmp_path / "others.npz", a=color, b=depth)
    with pytest.raises(ibr.FileFormatError, match="no array 'depth' among a, b"):
        ibr.read_depth(tmp_path / "others.npz")
    np.testing.assert_array_equal(ibr.read_depth(tmp_path / "others.npz", channel="b"), depth)
    np.testing.assert_array_equal(ibr.read_color(tmp_path / "others.npz", channel="a"), color)
    with pytest.raises(ibr.FileFormatError, match="no array 'c' among a, b"):
        ibr.read_depth(tmp_path / "others.npz", channel="c")
    np.save(tmp_path / "d.npy", depth)
    for choice, kinds in (("channel", r"\.exr or \.npz"), ("part", r"\.exr")):
        with pytest.raises(ibr.ArgumentError, match=f"^{choice}: .* a file of {kinds}, for .*npy, got 'b'"):
            ibr.read_depth(tmp_path / "d.npy", **{choice: "b"})


SCALES = [("<", "-1.0"), (">", "1.0"), ("<", "-0.0039"), (">", "2e+2"), ("<", "-1."), (">", ".5")]


@pytest.mark.parametrize(("order", "scale"), SCALES)
@pytest.mark.parametrize("newline", ["\n", "\r\n", " "])
def test_pfm_rows_run_upward_in_either_byte_order(tmp_path: Path, order, scale, newline):
    header = f"Pf{newline}2 3{newline}{scale}{newline}".encode()
    (tmp_path / "d.pfm").write_bytes(header + struct.pack(f"{order}6f", 5, 6, 3, 4, 1, 2))
    np.testing.assert_array_equal(ibr.read_depth(tmp_path / "d.pfm"), [[1, 2], [3, 4], [5, 6]])


@pytest.mark.parametrize("channels", [1, 3])
def test_pfm_is_the_one_that_opencv_writes_and_reads(tmp_path: Path, channels):
    values = np.random.default_rng(4).normal(size=(37, 61, channels)).astype(np.float32)
    cv2.imwrite(str(tmp_path / "cv.pfm"), values[..., ::-1])
    if channels == 1:
        np.testing.assert_array_equal(ibr.read_depth(tmp_path / "cv.pfm"), values[..., 0])
        ibr.write_depth(tmp_path / "ours.pfm", values[..., 0])
    else:
        np.testing.assert_array_equal(ibr.read_color(tmp_path / "cv.pfm"), values)
        ibr.write_color(tmp_path / "ours.pfm", values)
    theirs = cv2.imread(str(tmp_path / "ours.pfm"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(theirs.reshape(values.shape)[..., ::-1], values)


@pytest.mark.parametrize("suffix", DEPTH_SUFFIXES)
def test_names_that_are_no_text_are_names(tmp_path: Path, suffix: str):
    file = tmp_path / f"\udcff\n{suffix}"
    ibr.write_depth(file, np.ones((13, 7), np.float32), depth_scale=1000)
    assert (ibr.read_depth(file, depth_scale=1000) == 1).all()


def test_tiff_depth_of_other_programs(tmp_path: Path):
    depth = depth_of((61, 37))
    cv2.imwrite(str(tmp_path / "cv.tif"), depth)
    np.testing.assert_array_equal(ibr.read_depth(tmp_path / "cv.tif"), depth)
    units = np.nan_to_num(depth * 1000).astype(np.uint16)
    cv2.imwrite(str(tmp_path / "mm.tif"), units)
    found = ibr.read_depth(tmp_path / "mm.tif", depth_scale=1000)
    np.testing.assert_array_equal(found, ibr.depth_from_uint16(units, 1000))
    ibr.write_color(tmp_path / "c.tif", color_of((7, 13)))
    with pytest.raises(ibr.FileFormatError, match="expected gray of 8 or 16 bits, or floats, for depth"):
        ibr.read_depth(tmp_path / "c.tif", depth_scale=1000)


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("kind", ["u1", "u2", "i2", "u4", "i4", "f2", "f4", "f8"])
def test_tiff_of_every_kind_and_byte_order_as_it_is_stored(tmp_path: Path, kind, order):
    values = np.arange(1, 92).reshape(13, 7) * {"u1": 1, "u4": 40_000_000}.get(kind, 5)  # u4: beyond the range of i4
    (tmp_path / "d.tif").write_bytes(tiff(values.astype(order + kind), orientation=6))
    np.testing.assert_array_equal(ibr.read_depth(tmp_path / "d.tif", depth_scale=1), values.astype(np.float32))
    if kind in ("u1", "u2", "f2", "f4", "f8"):
        assert ibr.read_color(tmp_path / "d.tif").shape == (13, 7, 3)


@pytest.mark.parametrize("compression", [cv2.IMWRITE_TIFF_COMPRESSION_NONE, cv2.IMWRITE_TIFF_COMPRESSION_LZW])
def test_tiff_of_doubles_however_it_is_packed(tmp_path: Path, compression):
    depth = np.random.default_rng(1).uniform(0.5, 60, (37, 61))
    cv2.imwrite(str(tmp_path / "d.tif"), depth, [cv2.IMWRITE_TIFF_COMPRESSION, compression])
    np.testing.assert_array_equal(ibr.read_depth(tmp_path / "d.tif"), depth.astype(np.float32))


@pytest.mark.parametrize("shape", [(1, 13, 7), (13, 7, 1), (1, 1, 13, 7), (1, 13, 7, 1)])
def test_axes_of_length_1_are_dropped(tmp_path: Path, shape):
    depth = depth_of((7, 13))
    np.save(tmp_path / "d.npy", depth.reshape(shape))
    np.testing.assert_array_equal(ibr.read_depth(tmp_path / "d.npy"), depth)


def test_colmap_depth_map(tmp_path: Path):
    (tmp_path / "d.bin").write_bytes(b"2&3&1&" + struct.pack("<6f", 1, 2, 3, 4, 5, 0))
    np.testing.assert_array_equal(ibr.read_depth(tmp_path / "d.bin"), [[1, 2], [3, 4], [5, 0]])


def test_gray_that_is_stored_as_colors_is_depth(tmp_path: Path):
    levels = np.arange(7 * 13, dtype=np.uint8).reshape(13, 7)
    ibr.write_color(tmp_path / "d.png", levels[..., None].repeat(3, 2))
    found = ibr.read_depth(tmp_path / "d.png", depth_scale=4)
    np.testing.assert_array_equal(found, np.where(levels > 0, levels / np.float32(4), np.float32(np.nan)))


def test_depth_of_8_bits_has_a_scale_too(tmp_path: Path):
    """Older stereo sets store disparity in 8 bits: four units per pixel, 0 where it is unknown."""
    Image.fromarray(np.array([[0, 4, 255]], np.uint8)).save(tmp_path / "d.png")
    np.testing.assert_allclose(ibr.read_depth(tmp_path / "d.png", depth_scale=4), [[np.nan, 1, 63.75]])
    np.testing.assert_allclose(
        ibr.read_depth(tmp_path / "d.png", depth_scale=400, depth_kind="inverse"), [[np.nan, 100, 400 / 255]], rtol=1e-6
    )


@pytest.mark.parametrize("suffix", [".png", ".npy", ".tif"])
def test_depth_of_16_bits_is_written_by_its_scale(tmp_path: Path, suffix):
    """uint16 depth, which `register` returns, is written and read with its scale, and stays the same."""
    stored = np.arange(0, 65536, 719, dtype=np.uint16).reshape(-1, 4)[:20]
    ibr.write_depth(tmp_path / f"d{suffix}", stored, depth_scale=1000)
    found = ibr.read_depth(tmp_path / f"d{suffix}", depth_scale=1000)
    np.testing.assert_array_equal(found, ibr.depth_from_uint16(stored, 1000))
    with pytest.raises(ibr.ArgumentError, match=r"^depth_scale: "):
        ibr.write_depth(tmp_path / f"d{suffix}", stored)
