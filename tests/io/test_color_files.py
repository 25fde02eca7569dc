"""Pictures in every format: written files read back equal, and files of other programs are read."""

from __future__ import annotations

import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

import pyibr as ibr
from pyibr.io import image
from tests.io.specimens import SIZES, color_of, depth_of

EXACT_SUFFIXES = [".png", ".tif", ".bmp", ".npy", ".npz", ".ppm"]
LOSSLESS = {"webp": {"lossless": True}}
FLOAT_SUFFIXES = [".npy", ".npz", ".pfm", ".exr"]
pytestmark = pytest.mark.usefixtures("openexr_if_asked")


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("suffix", [*EXACT_SUFFIXES, ".pfm", ".exr"])
def test_color_round_trip(tmp_path: Path, suffix, size):
    color, file = color_of(size), tmp_path / f"color{suffix}"
    kinds = [color] * (suffix in EXACT_SUFFIXES) + [color.astype(np.float32) / 100] * (suffix in FLOAT_SUFFIXES)
    for kind in kinds:
        ibr.write_color(file, kind)
        again = ibr.read_color(file)
        assert again.dtype == kind.dtype
        np.testing.assert_array_equal(again, kind)


@pytest.mark.parametrize("suffix", [".pfm", ".exr"])
def test_bytes_in_a_float_format_are_divided_by_255(tmp_path: Path, suffix):
    color, file = color_of((7, 13)), tmp_path / f"color{suffix}"
    ibr.write_color(file, color)
    np.testing.assert_allclose(ibr.read_color(file) * 255, color, atol=1e-4)


def test_float_color_in_a_byte_format_is_rounded_and_clipped(tmp_path: Path):
    color = np.array([[[-1, 0.499 / 255, 0.501 / 255], [1, 7, np.nan]]])
    for dtype in (np.float16, np.float32, np.float64):
        ibr.write_color(tmp_path / "c.png", color.astype(dtype))
        assert ibr.read_color(tmp_path / "c.png").tolist() == [[[0, 0, 1], [255, 255, 0]]]


def test_jpeg_is_close(tmp_path: Path):
    y, x = np.mgrid[:37, :61]
    color = np.dstack([x * 4, y * 6, x + y]).astype(np.uint8)
    ibr.write_color(tmp_path / "c.jpg", color)
    assert np.abs(ibr.read_color(tmp_path / "c.jpg").astype(int) - color).mean() < 2


@pytest.mark.filterwarnings("ignore:.*transparency")
def test_gray_and_bits_become_rgb(tmp_path: Path):
    gray = color_of((7, 13))[..., 0]
    with_alpha, bits = np.dstack([gray, 255 - gray]), (gray > 100) * np.uint8(255)
    for name, stored, shown in (
        ("gray.png", gray, gray),
        ("alpha.png", with_alpha, gray),
        ("alpha.tif", with_alpha, gray),
        ("bits.png", gray > 100, bits),
    ):
        Image.fromarray(stored).save(tmp_path / name)
        np.testing.assert_array_equal(ibr.read_color(tmp_path / name), np.dstack([shown] * 3))
    for name in ("gray16.png", "gray16.pgm"):
        Image.fromarray(gray.astype(np.uint16) * 257).save(tmp_path / name)
        np.testing.assert_allclose(ibr.read_color(tmp_path / name), np.dstack([gray / 255] * 3), atol=1e-6)


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
    with pytest.warns(UserWarning, match="transparency is ignored") as told:
        for number in range(3):
            assert ibr.read_color(tmp_path / f"{number}{kind}").shape == (7, 13, 3)
    assert {str(one.message).split(":")[0] for one in told} == {str(tmp_path / f"*{Path(kind).suffix}")}
    write(kind, np.full((7, 13), 255, np.uint8))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert ibr.read_color(tmp_path / kind).shape == (7, 13, 3)


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
    """EXIF's rotation is ignored, because camera matrices refer to the pixels as stored."""
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


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "P", "P of GIF", "CMYK", "YCbCr", "LAB"])
def test_colors_are_those_of_the_picture_however_they_are_stored(tmp_path: Path, mode):
    """A printer's inks (CMYK), for example, would look like a negative if read as red, green and blue."""
    color = np.zeros((13, 7, 3), np.uint8)
    color[:6], color[6:, :3], color[6:, 3:] = (255, 128, 0), (255, 255, 255), (30, 60, 200)
    name = "c.png" if mode in ("RGB", "RGBA", "P") else "c.gif" if mode == "P of GIF" else "c.tif"
    if mode == "LAB":
        cms = pytest.importorskip("PIL.ImageCms")
        lab = cms.buildTransformFromOpenProfiles(cms.createProfile("sRGB"), cms.createProfile("LAB"), "RGB", "LAB")
        cms.applyTransform(Image.fromarray(color), lab).save(tmp_path / name)
    else:
        picture = Image.fromarray(color)
        (picture.quantize(8) if mode[0] == "P" else picture.convert(mode)).save(tmp_path / name)
    # The files' values are rounded. In YCbCr this changes a channel by up to 2 levels; in L*a*b* a unit of a* or b*
    # is up to 8 levels for orange.
    read = ibr.read_color(tmp_path / name).astype(int)
    np.testing.assert_array_equal(read, Image.open(tmp_path / name).convert("RGB"))
    assert np.abs(read - color).max() <= {"YCbCr": 3, "LAB": 8}.get(mode, 0)


def test_a_printers_jpeg_is_no_negative(tmp_path: Path):
    color = np.full((16, 16, 3), (250, 200, 40), np.uint8)
    Image.fromarray(color).convert("CMYK").save(tmp_path / "c.jpg", quality=95)
    assert np.abs(ibr.read_color(tmp_path / "c.jpg").astype(int) - color).max() <= 4  # levels of 255, the error of JPEG


@pytest.mark.parametrize("deflate", ["isal.isal_zlib", "zlib"])
@pytest.mark.parametrize("shape", [(1, 1), (37, 61), (37, 61, 3), (37, 61, 4)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_png_is_what_others_read(monkeypatch: pytest.MonkeyPatch, deflate, shape, dtype):
    monkeypatch.setattr(image, "_deflate", pytest.importorskip(deflate))
    pixels = np.random.default_rng(5).integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)
    theirs = cv2.imdecode(np.frombuffer(image.encoded(pixels, ".png"), np.uint8), cv2.IMREAD_UNCHANGED)
    channels = [0] if len(shape) == 2 else [2, 1, 0, 3][: shape[2]]
    np.testing.assert_array_equal(theirs.reshape(*shape[:2], -1)[..., channels], pixels.reshape(*shape[:2], -1))


def test_packed_textures_are_pictures(tmp_path: Path):
    Image.fromarray(np.full((8, 8, 3), (255, 0, 0), np.uint8)).save(tmp_path / "c.dds", pixel_format="DXT1")
    np.testing.assert_array_equal(ibr.read_color(tmp_path / "c.dds"), np.full((8, 8, 3), (255, 0, 0)))
