"""Files whose contents contradict their names are refused, and files that cannot be written are named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.files import write_atomically
from tests.io.specimens import color_of, depth_of
from tests.io.test_files import DEPTH_SUFFIXES

pytestmark = pytest.mark.usefixtures("openexr_if_asked")


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
    assert message.startswith(f"{file}: ") and "\n" not in message
    assert ("no such file" in message) == (damage == "missing")


@pytest.mark.parametrize(
    ("array", "words"),
    [
        (np.zeros((3, 4, 2), np.float32), r"shape \(H, W\)"),
        (np.zeros((0, 4), np.float32), r"shape \(H, W\)"),
        (np.zeros((3, 4), complex), "complex"),
        (np.array([["a"]]), "U1"),
        (np.array([{}], object), r"d\.npy"),  # pickled
    ],
)
def test_arrays_that_are_no_depth(tmp_path: Path, array, words):
    np.save(tmp_path / "d.npy", array)
    with pytest.raises(ibr.FileFormatError, match=words):
        ibr.read_depth(tmp_path / "d.npy", depth_scale=1)


def test_color_is_no_depth_and_8_bit_is_no_16_bit(tmp_path: Path):
    ibr.write_color(tmp_path / "c.png", color_of((7, 13)))
    ibr.write_mask(tmp_path / "m.png", np.ones((13, 7), bool))
    with pytest.raises(ibr.FileFormatError, match="expected gray of 8 or 16 bits, or floats, for depth, got "):
        ibr.read_depth(tmp_path / "c.png", depth_scale=1000)
    with pytest.raises(ibr.ArgumentError, match=r"^depth_scale: .*for the 8 bits of .*--depth-is relative"):
        ibr.read_depth(tmp_path / "m.png")


def test_unknown_suffixes(tmp_path: Path):
    (tmp_path / "d.xyz").write_bytes(b"1")
    known = "known are .bin, .bmp, .dpt, .exr, .h5, .hdf5, .jpeg, .jpg, .npy, .npz, .pfm, .pgm, .png, .ppm, .tif"
    for name in ("d.xyz", "d"):
        with pytest.raises(ibr.FileFormatError, match=known):
            ibr.read_depth(tmp_path / name)
    with pytest.raises(ibr.FileFormatError, match=r"no image format \.xyz"):
        ibr.write_color(tmp_path / "c.xyz", color_of((7, 13)))
    with pytest.raises(ibr.FileFormatError, match=r"no image format \.pgm"):  # a format that pyibr only reads
        ibr.write_depth(tmp_path / "d.pgm", depth_of((7, 13)))


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
    assert file.read_text() == "old" and list(tmp_path.iterdir()) == [file]


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
