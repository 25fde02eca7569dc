"""Depth in every format: written files read back equal, and are exchanged with other programs."""

from __future__ import annotations

import struct
import warnings
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
    for choice, kinds in (("channel", r"\.exr or \.npz or \.hdf5 or \.h5"), ("part", r"\.exr")):
        with pytest.raises(ibr.ArgumentError, match=f"^{choice}: .* a file of {kinds}, for .*npy, got 'b'"):
            ibr.read_depth(tmp_path / "d.npy", **{choice: "b"})


SCALES = [("<", "-1.0"), (">", "1.0"), ("<", "-0.0039"), (">", "2e+2"), ("<", "-1."), (">", ".5")]


@pytest.mark.parametrize(("order", "scale"), SCALES)
@pytest.mark.parametrize(
    ("between", "end"), [("\n", "\n"), ("\r\n", "\r\n"), (" ", " "), (" # made by hand\n#1 2 3\n", "\n")]
)
def test_pfm_rows_run_upward_in_either_byte_order(tmp_path: Path, order, scale, between, end):
    header = f"Pf{between}2 3{between}{scale}{end}".encode()
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


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("name", ["d.png", "raw.tif", "lzw.tif", "tiles.tif"])
def test_gray_of_16_bits_in_three_channels_keeps_all_bits(tmp_path: Path, name: str, order: str):
    levels = (np.arange(7 * 13) * 701 % 65536).astype(np.uint16).reshape(13, 7)
    stored = levels[..., None].repeat(3, axis=2)
    if name == "d.png":
        cv2.imwrite(str(tmp_path / name), stored)
    else:
        tifffile = pytest.importorskip("tifffile")
        packed = {"lzw.tif": {"compression": "lzw", "predictor": 2}, "tiles.tif": {"tile": (16, 16)}}.get(name, {})
        if name == "lzw.tif":
            pytest.importorskip("imagecodecs")
        tifffile.imwrite(tmp_path / name, stored, byteorder=order, photometric="rgb", **packed)
    np.testing.assert_array_equal(
        ibr.read_depth(tmp_path / name, depth_scale=1000), ibr.depth_from_uint16(levels, 1000)
    )
    np.testing.assert_array_equal(ibr.read_color(tmp_path / name), stored / np.float32(65535))
    relative = ibr.read_depth(tmp_path / name, depth_kind="relative")
    assert len(np.unique(relative)) == len(np.unique(levels))


def test_colours_of_16_bits_keep_all_bits(tmp_path: Path):
    color = np.random.default_rng(3).integers(0, 65536, (13, 7, 3)).astype(np.uint16)
    for name in ("c.png", "c.tif"):
        cv2.imwrite(str(tmp_path / name), color[..., ::-1])
        np.testing.assert_array_equal(ibr.read_color(tmp_path / name), color / np.float32(65535))
        with pytest.raises(ibr.FileFormatError, match="colours or alpha are no depth"):
            ibr.read_depth(tmp_path / name, depth_scale=1000)


def test_16_bits_in_separate_planes_are_refused(tmp_path: Path):
    tifffile = pytest.importorskip("tifffile")
    planes = np.full((3, 13, 7), 999, np.uint16)
    tifffile.imwrite(tmp_path / "d.tif", planes, photometric="rgb", planarconfig="separate")
    for read in (ibr.read_color, ibr.read_depth):
        with pytest.raises(ibr.FileFormatError, match=r"d\.tif: .* are read if they are stored pixel by pixel"):
            read(tmp_path / "d.tif")


def tinted(levels: np.ndarray) -> np.ndarray:
    """Gray with the tints that the chroma of lossy compression gets."""
    coarse = np.random.default_rng(5).integers(-4, 5, (*np.array(levels.shape) // 8, 3))
    noise = np.kron(coarse, np.ones((8, 8, 1)))
    return (levels[..., None] + noise).clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".webp"])
def test_gray_with_tints_is_read_by_its_brightness(tmp_path: Path, suffix: str):
    levels = np.broadcast_to(np.linspace(20, 200, 64), (40, 64))
    Image.fromarray(tinted(levels)).save(tmp_path / f"d{suffix}")
    for options, expected in (({"depth_scale": 10}, levels / 10), ({"depth_kind": "relative"}, None)):
        with pytest.warns(UserWarning, match=rf"\*\{suffix}: gray with the tints of lossy compression"):
            found = ibr.read_depth(tmp_path / f"d{suffix}", **options)
        if expected is not None:
            assert np.abs(found - expected).mean() < 0.3
        assert found.shape == (40, 64)


def test_false_colours_and_photographs_are_no_gray(tmp_path: Path):
    levels = np.linspace(0, 255, 64 * 40).reshape(40, 64).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "map.jpg"), cv2.applyColorMap(levels, cv2.COLORMAP_TURBO))
    ibr.write_color(tmp_path / "sepia.jpg", (levels[..., None] * np.float32((1, 0.8, 0.6))).astype(np.uint8))
    for name in ("map.jpg", "sepia.jpg"):
        with pytest.raises(ibr.FileFormatError, match="colours or alpha are no depth"):
            ibr.read_depth(tmp_path / name, depth_scale=10)


def test_a_folder_of_jpeg_depth_counts_without_other_files(tmp_path: Path):
    """Beside other files of depth, JPEG is taken as a picture of them."""
    for number in range(2):
        ibr.write_color(tmp_path / f"rgb/{number}.png", color_of((16, 8)))
        Image.fromarray(np.full((8, 16), 40, np.uint8)).save(tmp_path / f"rgb/{number}.depth.jpg")
    ibr.Camera.from_fov((16, 8), fov_x=60).save(tmp_path / "camera.json")
    (tmp_path / "depth").mkdir()
    for number in range(2):
        (tmp_path / f"rgb/{number}.depth.jpg").rename(tmp_path / f"depth/{number}.jpg")
    assert [float(np.median(view.depth)) for view in ibr.load(tmp_path, depth_scale=10)] == [4, 4]
    for number in range(2):
        ibr.write_depth(tmp_path / f"depth/{number}.png", np.full((8, 16), 7, np.float32), depth_scale=10)
    assert [float(np.median(view.depth)) for view in ibr.load(tmp_path, depth_scale=10)] == [7, 7]


@pytest.mark.parametrize("suffix", [".hdf5", ".h5"])
def test_arrays_of_hdf5_have_names(tmp_path: Path, suffix: str):
    """BlenderProc writes colors, depth and more into one file."""
    h5py = pytest.importorskip("h5py")
    color, depth = color_of((7, 13)), depth_of((7, 13))
    file = tmp_path / f"0{suffix}"
    with h5py.File(file, "w") as stored:
        stored["colors"], stored["depth"], stored["cam/near"] = color, depth, depth / 2
    np.testing.assert_array_equal(ibr.read_depth(file), depth)
    np.testing.assert_array_equal(ibr.read_depth(file, channel="depth"), depth)
    np.testing.assert_array_equal(ibr.read_depth(file, channel="/cam/near"), depth / 2)
    np.testing.assert_array_equal(ibr.read_color(file), color)
    with pytest.raises(ibr.FileFormatError, match="no array 'z' among cam/near, colors, depth; name one"):
        ibr.read_depth(file, channel="z")
    with h5py.File(file, "w") as stored:
        stored["a"], stored["b"] = depth, depth
    with pytest.raises(ibr.FileFormatError, match="no array 'depth' among a, b; name one"):
        ibr.read_depth(file)
    with pytest.raises(ibr.FileFormatError, match="only read"):
        ibr.write_depth(file, depth)
    with pytest.raises(ibr.FileFormatError, match="no image format"):
        ibr.write_color(file, color)


RAMP = np.linspace(0, 1, 60).reshape(6, 10)


@pytest.mark.parametrize(
    ("name", "values", "is_map"),
    [
        ("wide.npy", 0.002 + 9.2 * RAMP, True),  # 4,600 to 1
        ("room.npy", 0.4 + 60 * RAMP, False),
        ("sky.npy", np.where(RAMP > 0.8, 1e10, 0.5 + 40 * RAMP), False),
        ("holes.npy", np.where(RAMP > 0.8, np.inf, 0.5 + 40 * RAMP), False),
        ("all16.png", (65535 * RAMP).astype(np.uint16), True),
        ("all8.png", (255 * RAMP).astype(np.uint8), True),
        ("all8.jpg", (255 * RAMP).astype(np.uint8), True),
        ("mm.png", (400 + 9000 * RAMP).astype(np.uint16), False),
        ("lost.png", np.where(RAMP > 0.9, 65535, 9000 * RAMP).astype(np.uint16), False),  # 7-Scenes marks lost samples
        ("far.png", (500 + 65035 * RAMP).astype(np.uint16), False),  # Virtual KITTI's sky
        ("few.png", np.where(RAMP == 1, 65535, 9000 * RAMP).astype(np.uint16), False),
    ],
)
def test_a_map_of_a_network_gets_a_hint(tmp_path: Path, name: str, values: np.ndarray, is_map: bool):
    if name.endswith(".npy"):
        np.save(tmp_path / name, values.astype(np.float32))
    else:
        Image.fromarray(values).save(tmp_path / name)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        ibr.read_depth(tmp_path / name, depth_scale=1000)
        hints = [str(one.message) for one in told]
        ibr.read_depth(tmp_path / name, depth_scale=1000, depth_kind="inverse")
        if name.endswith(".png"):
            with pytest.raises(ibr.ArgumentError, match="depth_scale"):
                ibr.read_depth(tmp_path / name)
    assert len(told) == len(hints) == is_map
    assert all("--depth-is relative" in hint for hint in hints)


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
