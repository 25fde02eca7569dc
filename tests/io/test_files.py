"""Round trips of every format, and files that are not what their name says."""

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
from pyibr.core.files import write_atomically
from pyibr.io import image

SIZES = [(7, 13), (1, 1), (61, 37)]
DEPTH_SUFFIXES = [".png", ".tiff", ".npy", ".npz", ".pfm", ".exr", ".bin"]
EXACT_SUFFIXES = [".png", ".tif", ".bmp", ".npy", ".npz", ".ppm"]
LOSSLESS = {"webp": {"lossless": True}}
FLOAT_SUFFIXES = [".npy", ".npz", ".pfm", ".exr"]


@pytest.fixture(autouse=True)
def _exr(request):
    if "exr" in str(request.node.callspec.params if hasattr(request.node, "callspec") else ""):
        pytest.importorskip("OpenEXR")


def depth_of(size) -> np.ndarray:
    depth = np.random.default_rng(1).uniform(0.5, 60, size[::-1]).astype(np.float32)
    if depth.size > 1:
        depth[0, -1] = np.nan
    return depth


def color_of(size) -> np.ndarray:
    return np.random.default_rng(2).integers(0, 256, (*size[::-1], 3), dtype=np.uint8)


# ---- round trips


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("suffix", DEPTH_SUFFIXES)
def test_depth_round_trip(tmp_path: Path, suffix, size):
    depth, file = depth_of(size), tmp_path / f"depth{suffix}"
    ibr.write_depth(file, depth, depth_scale=1000 if suffix == ".png" else None)
    again = ibr.read_depth(file, depth_scale=1000 if suffix == ".png" else None)
    assert again.dtype == np.float32
    assert again.flags.c_contiguous
    np.testing.assert_allclose(again, depth, rtol=0, atol=0.50001e-3 if suffix == ".png" else 0)
    assert [f.name for f in tmp_path.iterdir()] == [file.name]  # nothing temporary is left


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
    disparity = ibr.disparity_from_depth(depth, 1, 1)  # of a focal length times a baseline of 1
    held = {"z": depth, "distance": ibr.euclidean_from_depth(depth, camera), "inverse": disparity}[kind]
    step = 0.5 / scale if suffix == ".png" else 0
    np.testing.assert_allclose(ibr.read_depth(file, depth_scale=scale), held, rtol=1e-6, atol=1.01 * step)
    again = ibr.read_depth(file, depth_scale=scale, depth_kind=kind, camera=camera)
    slope = 9**2 if kind == "inverse" else 1  # how much depth changes with what is stored
    np.testing.assert_allclose(again, depth, rtol=1e-6, atol=1.01 * step * slope)


@pytest.mark.parametrize("suffix", [".png", ".npy"])
def test_disparity_between_principal_points_apart_has_an_offset(tmp_path: Path, suffix):
    focal, baseline, doffs, units = 500.0, 0.1, 7.25, 256  # units: stored a pixel
    disparity = np.array([[4.0, 31.5, 0.5, 12.0]])
    how: dict[str, Any] = {"depth_scale": units * focal * baseline, "depth_offset": units * doffs}
    how |= {"depth_kind": "inverse"}
    depth, file = ibr.depth_from_disparity(disparity, focal, baseline, offset=doffs), tmp_path / f"disp{suffix}"
    depth[0, 3] = np.nan
    ibr.write_depth(file, depth, **how)
    stored = image.read_depth(file) if suffix == ".png" else np.load(file)
    np.testing.assert_allclose(stored[0, :3], units * disparity[0, :3], atol=1e-3)  # float32 of 1 / z
    np.testing.assert_allclose(ibr.read_depth(file, **how), depth, rtol=1e-6)
    with pytest.raises(ibr.ArgumentError, match=r"^depth: expected values above depth_offset / depth_scale = 0.145"):
        ibr.write_depth(tmp_path / "d.png", np.full((2, 2), 7.0, np.float32), **how)  # 0.11 pixels below 0
    with pytest.raises(ibr.ArgumentError, match=r"^depth_offset: "):
        ibr.read_depth(file, depth_offset=np.nan, depth_scale=1)


def test_distances_need_their_camera(tmp_path: Path):
    camera = ibr.Camera([[50, 0, 30], [0, 50, 18], [0, 0, 1]], (61, 37))
    ibr.write_depth(tmp_path / "d.npy", depth_of((7, 13)))
    for given, got in ((None, "none"), (camera, "61x37")):
        with pytest.raises(
            ibr.ArgumentError, match=f"camera: expected the one whose 7x13 distances .*d.npy, got {got}"
        ):
            ibr.read_depth(tmp_path / "d.npy", depth_scale=None, depth_kind="distance", camera=given)
    with pytest.raises(ibr.ArgumentError, match='kind: expected one of "z", "distance", "inverse"'):
        ibr.read_depth(tmp_path / "d.npy", depth_kind="disparity")  # type: ignore[arg-type]


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("suffix", EXACT_SUFFIXES)
def test_color_round_trip(tmp_path: Path, suffix, size):
    color, file = color_of(size), tmp_path / f"color{suffix}"
    ibr.write_color(file, color)
    again = ibr.read_color(file)
    assert again.dtype == np.uint8
    np.testing.assert_array_equal(again, color)


@pytest.mark.parametrize("suffix", FLOAT_SUFFIXES)
def test_float_color_round_trip(tmp_path: Path, suffix):
    color, file = color_of((61, 37)).astype(np.float32) / 100, tmp_path / f"color{suffix}"
    ibr.write_color(file, color)
    again = ibr.read_color(file)
    assert again.dtype == np.float32
    np.testing.assert_array_equal(again, color)


@pytest.mark.parametrize("suffix", [".pfm", ".exr"])
def test_bytes_in_a_float_format_are_divided_by_255(tmp_path: Path, suffix):
    color, file = color_of((7, 13)), tmp_path / f"color{suffix}"
    ibr.write_color(file, color)
    np.testing.assert_allclose(ibr.read_color(file) * 255, color, atol=1e-4)


def test_float_color_in_a_byte_format_is_rounded_and_clipped(tmp_path: Path):
    color = np.array([[[-1, 0.499 / 255, 0.501 / 255], [1, 7, np.nan]]], np.float32)
    ibr.write_color(tmp_path / "c.png", color)
    assert ibr.read_color(tmp_path / "c.png").tolist() == [[[0, 0, 1], [255, 255, 0]]]


def test_jpeg_is_close(tmp_path: Path):
    y, x = np.mgrid[:37, :61]
    color = np.dstack([x * 4, y * 6, x + y]).astype(np.uint8)
    ibr.write_color(tmp_path / "c.jpg", color)
    assert np.abs(ibr.read_color(tmp_path / "c.jpg").astype(int) - color).mean() < 2


def test_gray_and_bits_become_rgb(tmp_path: Path):
    gray = color_of((7, 13))[..., 0]
    Image.fromarray(gray).save(tmp_path / "gray.png")
    np.testing.assert_array_equal(ibr.read_color(tmp_path / "gray.png"), np.dstack([gray] * 3))
    Image.fromarray(gray.astype(np.uint16) * 257).save(tmp_path / "gray16.png")
    np.testing.assert_allclose(ibr.read_color(tmp_path / "gray16.png"), np.dstack([gray / 255] * 3), atol=1e-6)


@pytest.mark.parametrize("kind", ["rgba.png", "palette.png", "key.png", "gray.tif", "array.npy", "float.npy"])
def test_transparency_is_told_once_a_folder_and_only_where_there_is_any(tmp_path: Path, kind):
    color, alpha = color_of((13, 7)), np.full((7, 13), 255, np.uint8)
    color[:3], alpha[:3] = (0, 0, 255), 128

    def write(name: str, alpha: np.ndarray) -> None:
        rgba = np.dstack([color, alpha])
        options = {"transparency": (0, 0, 255) if (alpha < 255).any() else (9, 8, 7)} if kind == "key.png" else {}
        if kind.endswith(".npy"):
            np.save(tmp_path / name, rgba if kind == "array.npy" else (rgba / 255).astype(np.float32))
            return
        picture = Image.fromarray(color if options else rgba)
        picture = picture.quantize() if kind == "palette.png" else picture.convert("LA") if "gray" in kind else picture
        picture.save(tmp_path / name, **options)

    for number in range(3):
        write(f"{number}{kind}", alpha)
    with pytest.warns(UserWarning, match="transparency is left out") as told:
        for number in range(3):
            assert ibr.read_color(tmp_path / f"{number}{kind}").shape == (7, 13, 3)
    assert {str(one.message).split(":")[0] for one in told} == {str(tmp_path / f"*{Path(kind).suffix}")}
    write(kind, np.full((7, 13), 255, np.uint8))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert ibr.read_color(tmp_path / kind).shape == (7, 13, 3)


def stored_as(mode: str) -> tuple[Image.Image, np.ndarray]:
    """A picture of Pillow's, and what reading it as a colour image gives."""
    color, gray = color_of((7, 13)), color_of((7, 13))[..., 0]
    if mode == "1":
        return Image.fromarray(gray > 100), np.dstack([(gray > 100) * np.uint8(255)] * 3)
    if mode == "P":
        few = Image.fromarray(color // 64 * 64).quantize(256)
        return few, np.asarray(few.convert("RGB"))
    if mode == "LA":
        return Image.fromarray(np.dstack([gray, 255 - gray])), np.dstack([gray] * 3)
    printed = Image.fromarray(color).convert(mode)  # of other colours
    return printed, np.asarray(printed.convert("RGB"))


@pytest.mark.filterwarnings("ignore:.*transparency")
@pytest.mark.parametrize(
    ("mode", "suffix"),
    [("1", "png"), ("P", "png"), ("P", "gif"), ("LA", "png"), ("LA", "tif"), ("CMYK", "tif"), ("LAB", "tif")],
)
def test_pictures_of_every_mode_become_rgb(tmp_path: Path, mode, suffix):
    picture, expected = stored_as(mode)
    picture.save(tmp_path / f"a.{suffix}")
    np.testing.assert_array_equal(ibr.read_color(tmp_path / f"a.{suffix}"), expected)


@pytest.mark.parametrize("suffix", ["gif", "png", "tif", "webp"])
def test_of_several_images_the_first_is_read(tmp_path: Path, suffix):
    first, other = (np.full((13, 7, 3), value, np.uint8) for value in (0, 255))
    Image.fromarray(first).save(
        tmp_path / f"a.{suffix}", save_all=True, append_images=[Image.fromarray(other)], **LOSSLESS.get(suffix, {})
    )
    with Image.open(tmp_path / f"a.{suffix}") as written:
        assert written.n_frames == 2
    np.testing.assert_array_equal(ibr.read_color(tmp_path / f"a.{suffix}"), first)


@pytest.mark.parametrize("suffix", ["jpg", "png"])
def test_a_turned_picture_is_read_as_it_is_stored(tmp_path: Path, suffix):
    """Cameras' matrices are of the stored pixels, whichever way a viewer turns them."""
    turned = Image.Exif()
    turned[0x0112] = 6
    Image.fromarray(np.full((13, 7, 3), 100, np.uint8)).save(tmp_path / f"a.{suffix}", exif=turned)
    with Image.open(tmp_path / f"a.{suffix}") as written:
        assert written.getexif()[0x0112] == 6
    assert ibr.read_color(tmp_path / f"a.{suffix}").shape == (13, 7, 3)


def test_mask(tmp_path: Path):
    mask = depth_of((61, 37)) > 30
    ibr.write_mask(tmp_path / "mask.png", mask)
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "mask.png")), mask * np.uint8(255))
    ibr.write_mask(tmp_path / "mask.npy", mask)
    np.testing.assert_array_equal(np.load(tmp_path / "mask.npy"), mask, strict=True)


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
    for choice, kinds in (("channel", r"\.exr and \.npz"), ("part", r"\.exr")):
        with pytest.raises(ibr.ArgumentError, match=f"^{choice}: expected none but for {kinds}, of .*d.npy, got 'b'"):
            ibr.read_depth(tmp_path / "d.npy", **{choice: "b"})


# ---- PFM by hand


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


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"Pf\n2 3\n-1.0\n" + bytes(23), "expected 24 bytes of pixels .* got 23"),
        (b"Pf\n2 3\n-1.0\n" + bytes(25), "got 25"),
        (b"Pf\n99999999 99999999\n-1.0\n" + bytes(24), "got 24"),
        (b"Pf\n2 3\n", "no header"),
        (b"P6\n2 3\n255\n" + bytes(18), "no header"),
        (b"Pf\n0 3\n-1.0\n", r"shape \(H, W\), got .*\(3, 0\)"),
        (b"PF\n2 3\n-1.0\n" + bytes(72), r"shape \(H, W\), got .*\(3, 2, 3\)"),
    ],
)
def test_bad_pfm(tmp_path: Path, content, words):
    (tmp_path / "d.pfm").write_bytes(content)
    with pytest.raises(ibr.FileFormatError, match=words):
        ibr.read_depth(tmp_path / "d.pfm")


# ---- names


@pytest.mark.parametrize("suffix", DEPTH_SUFFIXES)
def test_names_that_are_no_text_are_names(tmp_path: Path, suffix: str):
    file = tmp_path / f"\udcff\n{suffix}"
    ibr.write_depth(file, np.ones((13, 7), np.float32), depth_scale=1000)
    assert (ibr.read_depth(file, depth_scale=1000) == 1).all()


# ---- pictures as other programs write them


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "P", "CMYK", "YCbCr", "LAB"])
def test_colors_are_those_of_the_picture_however_they_are_stored(tmp_path: Path, mode):
    """Printers' inks, taken for red, green and blue, are a negative."""
    color = np.zeros((13, 7, 3), np.uint8)
    color[:6], color[6:, :3], color[6:, 3:] = (255, 128, 0), (255, 255, 255), (30, 60, 200)
    name = "c.png" if mode in ("RGB", "RGBA", "P") else "c.tif"
    if mode == "LAB":
        cms = pytest.importorskip("PIL.ImageCms")
        lab = cms.buildTransformFromOpenProfiles(cms.createProfile("sRGB"), cms.createProfile("LAB"), "RGB", "LAB")
        cms.applyTransform(Image.fromarray(color), lab).save(tmp_path / name)
    else:
        picture = Image.fromarray(color)
        (picture.quantize(8) if mode == "P" else picture.convert(mode)).save(tmp_path / name)
    # Files round YCbCr and L*a*b*, too: the first to 2 levels of a channel, a unit of a* and b* is up to 8 of orange.
    read = ibr.read_color(tmp_path / name).astype(int)
    assert np.abs(read - color).max() <= {"YCbCr": 3, "LAB": 8}.get(mode, 0)


def test_a_printers_jpeg_is_no_negative(tmp_path: Path):
    color = np.full((16, 16, 3), (250, 200, 40), np.uint8)
    Image.fromarray(color).convert("CMYK").save(tmp_path / "c.jpg", quality=95)
    assert np.abs(ibr.read_color(tmp_path / "c.jpg").astype(int) - color).max() <= 4  # levels, as of any JPEG


def test_tiff_depth_of_other_programs(tmp_path: Path):
    depth = depth_of((61, 37))
    cv2.imwrite(str(tmp_path / "cv.tif"), depth)
    np.testing.assert_array_equal(ibr.read_depth(tmp_path / "cv.tif"), depth)
    units = np.nan_to_num(depth * 1000).astype(np.uint16)
    cv2.imwrite(str(tmp_path / "mm.tif"), units)
    np.testing.assert_array_equal(
        ibr.read_depth(tmp_path / "mm.tif", depth_scale=1000), ibr.depth_from_uint16(units, 1000)
    )
    ibr.write_color(tmp_path / "c.tif", color_of((7, 13)))
    with pytest.raises(ibr.FileFormatError, match="expected gray of 8 or 16 bits, or floats, for depth"):
        ibr.read_depth(tmp_path / "c.tif", depth_scale=1000)


@pytest.mark.parametrize("shape", [(1, 13, 7), (13, 7, 1), (1, 1, 13, 7), (1, 13, 7, 1)])
def test_axes_of_length_1_are_dropped(tmp_path: Path, shape):
    depth = depth_of((7, 13))
    np.save(tmp_path / "d.npy", depth.reshape(shape))
    np.testing.assert_array_equal(ibr.read_depth(tmp_path / "d.npy"), depth)


# ---- COLMAP by hand


def test_colmap_depth_map(tmp_path: Path):
    (tmp_path / "d.bin").write_bytes(b"2&3&1&" + struct.pack("<6f", 1, 2, 3, 4, 5, 0))
    np.testing.assert_array_equal(ibr.read_depth(tmp_path / "d.bin"), [[1, 2], [3, 4], [5, 0]])


# ---- what is not what its name says


@pytest.mark.parametrize("suffix", [*DEPTH_SUFFIXES, ".jpg", ".tif", ".bmp"])
@pytest.mark.parametrize("damage", ["missing", "empty", "garbage", "folder", "truncated", "header"])
def test_bad_files_are_named_in_one_sentence(tmp_path: Path, suffix, damage):
    is_depth = suffix in DEPTH_SUFFIXES
    file = tmp_path / f"bad{suffix}"
    if is_depth:
        ibr.write_depth(file, depth_of((61, 37)), depth_scale=1000)
    else:
        ibr.write_color(file, color_of((61, 37)))
    content = file.read_bytes()
    file.unlink()
    if damage == "folder":
        file.mkdir()
    elif damage != "missing":
        keep = {"empty": 0, "header": 12, "truncated": len(content) // 2, "garbage": 0}[damage]
        file.write_bytes(b"\x93 rubbish \x00\xff" * 50 if damage == "garbage" else content[:keep])
    with pytest.raises(ibr.FileFormatError) as caught:
        ibr.read_depth(file, depth_scale=1000) if is_depth else ibr.read_color(file)
    message = str(caught.value)
    assert message.startswith(f"{file}: ")
    assert "\n" not in message
    assert ("no such file" in message) == (damage == "missing")


@pytest.mark.parametrize("keep", [20, 300, -100, -1])
def test_truncated_exr(tmp_path: Path, keep):
    pytest.importorskip("OpenEXR")
    file = tmp_path / "d.exr"
    ibr.write_depth(file, depth_of((61, 37)))
    file.write_bytes(file.read_bytes()[:keep])
    with pytest.raises(ibr.FileFormatError, match=r"d\.exr"):
        ibr.read_depth(file)


@pytest.mark.parametrize(
    ("array", "words"),
    [
        (np.zeros((3, 4, 2), np.float32), r"shape \(H, W\)"),
        (np.zeros((0, 4), np.float32), r"shape \(H, W\)"),
        (np.zeros((3, 4), complex), "complex"),
        (np.array([["a"]]), "U1"),
    ],
)
def test_arrays_that_are_no_depth(tmp_path: Path, array, words):
    np.save(tmp_path / "d.npy", array)
    with pytest.raises(ibr.FileFormatError, match=words):
        ibr.read_depth(tmp_path / "d.npy", depth_scale=1)


def test_pickles_are_not_opened(tmp_path: Path):
    np.save(tmp_path / "d.npy", np.array([{}], object), allow_pickle=True)
    with pytest.raises(ibr.FileFormatError, match=r"d\.npy"):
        ibr.read_depth(tmp_path / "d.npy")


def test_gray_that_is_stored_as_colors_is_depth(tmp_path: Path):
    levels = np.arange(7 * 13, dtype=np.uint8).reshape(13, 7)
    ibr.write_color(tmp_path / "d.png", levels[..., None].repeat(3, 2))
    found = ibr.read_depth(tmp_path / "d.png", depth_scale=4)
    np.testing.assert_array_equal(found, np.where(levels > 0, levels / np.float32(4), np.float32(np.nan)))


def test_color_is_no_depth_and_8_bit_is_no_16_bit(tmp_path: Path):
    ibr.write_color(tmp_path / "c.png", color_of((7, 13)))
    ibr.write_mask(tmp_path / "m.png", np.ones((13, 7), bool))
    with pytest.raises(ibr.FileFormatError, match="expected gray of 8 or 16 bits, or floats, for depth, got "):
        ibr.read_depth(tmp_path / "c.png", depth_scale=1000)
    with pytest.raises(ibr.ArgumentError, match=r"^depth_scale: .*for the 8 bits of .*--depth-is relative"):
        ibr.read_depth(tmp_path / "m.png")


def test_depth_of_8_bits_has_a_scale_too(tmp_path: Path):
    """Disparity of older stereo sets: four units a pixel, 0 where there is none."""
    Image.fromarray(np.array([[0, 4, 255]], np.uint8)).save(tmp_path / "d.png")
    np.testing.assert_allclose(ibr.read_depth(tmp_path / "d.png", depth_scale=4), [[np.nan, 1, 63.75]])
    np.testing.assert_allclose(
        ibr.read_depth(tmp_path / "d.png", depth_scale=400, depth_kind="inverse"), [[np.nan, 100, 400 / 255]], rtol=1e-6
    )


@pytest.mark.parametrize("suffix", [".png", ".npy", ".tif"])
def test_depth_of_16_bits_is_written_by_its_scale(tmp_path: Path, suffix):
    """As `register` keeps it: what is read with the same scale is the same depth."""
    stored = np.arange(0, 65536, 719, dtype=np.uint16).reshape(-1, 4)[:20]
    ibr.write_depth(tmp_path / f"d{suffix}", stored, depth_scale=1000)
    np.testing.assert_array_equal(
        ibr.read_depth(tmp_path / f"d{suffix}", depth_scale=1000), ibr.depth_from_uint16(stored, 1000)
    )
    with pytest.raises(ibr.ArgumentError, match=r"^depth_scale: "):
        ibr.write_depth(tmp_path / f"d{suffix}", stored)


def test_floats_of_any_size_are_written(tmp_path: Path):
    color = np.full((3, 4, 3), 0.5)
    for dtype in (np.float16, np.float32, np.float64):
        ibr.write_color(tmp_path / "c.png", color.astype(dtype))
        assert (ibr.read_color(tmp_path / "c.png") == 128).all()


def test_unknown_suffixes(tmp_path: Path):
    (tmp_path / "d.xyz").write_bytes(b"1")
    for name, read in (("d.xyz", ibr.read_depth), ("d", ibr.read_depth)):
        with pytest.raises(
            ibr.FileFormatError, match=r"known are .bin, .dpt, .exr, .hdf5, .npy, .npz, .pfm, .pgm, .png, .tif"
        ):
            read(tmp_path / name)
    with pytest.raises(ibr.FileFormatError, match=r"no image format \.xyz"):
        ibr.write_color(tmp_path / "c.xyz", color_of((7, 13)))


# ---- writing


@pytest.mark.parametrize("scale", [None, 0, -1, np.nan])
def test_png_depth_needs_a_scale(tmp_path: Path, scale):
    with pytest.raises(ibr.ArgumentError, match=r"^depth_scale: "):
        ibr.write_depth(tmp_path / "d.png", depth_of((7, 13)), depth_scale=scale)
    ibr.write_depth(tmp_path / "d.png", depth_of((7, 13)), depth_scale=1000)
    with pytest.raises(ibr.ArgumentError, match=r"^depth_scale: "):
        ibr.read_depth(tmp_path / "d.png", depth_scale=scale)


def test_overflow_writes_nothing(tmp_path: Path):
    with pytest.raises(ibr.ArgumentError, match="1 to 65535 units of 1/5000"):
        ibr.write_depth(tmp_path / "d.png", depth_of((7, 13)), depth_scale=5000)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".png", ".npy", ".pfm", ".exr"])
def test_a_folder_that_cannot_be_made(tmp_path: Path, suffix):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(ibr.FileFormatError, match="file is not a folder"):
        ibr.write_color(tmp_path / "file" / f"c{suffix}", color_of((7, 13)))


def test_an_error_while_writing_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    file = tmp_path / "a.txt"
    file.write_text("old")

    def fail(descriptor: int) -> None:
        raise RuntimeError("the power failed")

    monkeypatch.setattr("os.fsync", fail)
    with pytest.raises(RuntimeError, match="power"):
        write_atomically(file, b"new")
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda p: ibr.write_color(p / "c.png", depth_of((7, 13))), "color"),
        (lambda p: ibr.write_color(p / "c.png", color_of((7, 13)).astype(int)), "color"),
        (lambda p: ibr.write_color(p / "c.png", np.zeros((0, 7, 3), np.uint8)), "color"),
        (lambda p: ibr.write_depth(p / "d.npy", color_of((7, 13))), "depth"),
        (lambda p: ibr.write_mask(p / "m.png", color_of((7, 13))[..., 0]), "mask"),
    ],
)
def test_writers_name_the_bad_argument(tmp_path: Path, call, argument):
    with pytest.raises(ibr.ArgumentError) as caught:
        call(tmp_path)
    assert caught.value.argument == argument


@pytest.mark.parametrize("path", [None, 3, b"color.png"], ids=str)
def test_what_is_no_path(path):
    color, depth = np.zeros((4, 4, 3), np.uint8), np.ones((4, 4), np.float32)
    for use in (
        ibr.read_color,
        ibr.read_depth,
        ibr.Camera.load,
        lambda p: ibr.write_color(p, color),
        lambda p: ibr.write_depth(p, depth),
    ):
        with pytest.raises(ibr.ArgumentError, match=r"^path: expected a file's path"):
            use(path)
