"""In OpenEXR files of renderers and compositors, the channel of depth and the layer of colours are found."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pyibr as ibr

exr = pytest.importorskip("OpenEXR")

SIZE = (13, 7)
DEPTH = np.random.default_rng(1).uniform(0.5, 60, SIZE).astype(np.float32)
OTHER = np.random.default_rng(2).uniform(0, 1, (3, *SIZE)).astype(np.float32)
RGB = dict(zip("RGB", OTHER, strict=True))


def named(layer: str, channels: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {f"{layer}.{name}": pixels for name, pixels in channels.items()}


def write(path: Path, *parts: dict[str, Any], names: tuple[str, ...] = ("",), **header: Any) -> None:
    header = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage, **header}
    made = [exr.Part(dict(header), dict(part), name) for name, part in zip(names, parts, strict=True)]
    exr.File(made).write(str(path))


XYZ = dict(zip("XYZ", OTHER, strict=True))
SMALL = dict(zip("xyz", OTHER, strict=True))
GRAY = {name: DEPTH for name in "RGB"}


@pytest.mark.parametrize(
    "channels",
    [
        {"Z": DEPTH},
        {"Z": DEPTH, "Y": OTHER[0]},
        {"Y": DEPTH, "R": OTHER[0]},
        {"Z": DEPTH, **RGB, **named("right", {"Z": OTHER[0]})},  # the right view of a stereo file
        {**RGB, "depth": DEPTH},
        {**RGB, **named("Depth", {"V": DEPTH}), **named("Normal", XYZ)},  # Blender
        {**named("V L.Combined", RGB), **named("V L.Depth", {"Z": DEPTH}), **named("V L.Mist", {"Z": OTHER[0]})},
        {**named("ViewLayer.Depth", {"Z": DEPTH}), **named("ViewLayer.Position", XYZ), "ViewLayer.IndexOB.X": OTHER[0]},
        {**RGB, **named("FinalImageMovieRenderQueue_WorldDepth", GRAY)},  # Unreal
        {**RGB, **named("WorldDepth", {"R": DEPTH})},
        {**RGB, "Pz": DEPTH, **named("P", XYZ)},  # Houdini
        {**RGB, **named("depth", {"Z": DEPTH}), **named("N", XYZ)},  # Nuke
        {**RGB, **named("zDepth", GRAY)},
        GRAY,
    ],
    ids=lambda channels: "+".join(channels)[:60],
)
def test_depth_is_what_is_called_so(tmp_path: Path, channels):
    write(tmp_path / "d.exr", channels)
    np.testing.assert_array_equal(ibr.read_depth(tmp_path / "d.exr"), DEPTH)


@pytest.mark.parametrize(
    ("channels", "words"),
    [
        ({"A": DEPTH}, "no channel called depth or Z among A; name one"),
        ({**RGB, **named("P", SMALL)}, r"no channel called depth or Z among B, G, P\.x, P\.y, P\.z, R"),  # Houdini
        (RGB, "no channel called depth or Z among B, G, R; name one"),
        (named("Normal", XYZ), "among Normal.X, Normal.Y, Normal.Z; name one"),
        ({**RGB, **named("Mist", {"Z": DEPTH})}, "among B, G, Mist.Z, R"),
        (named("depth", RGB), "among depth.B, depth.G, depth.R"),
        ({"A.Depth.Z": DEPTH, "B.Depth.Z": DEPTH}, r"several layers with depth: A\.Depth, B\.Depth; name one"),
        ({"Y": DEPTH, "RY": DEPTH, "BY": DEPTH}, r"colours as chroma \(RY, BY\) are not supported"),
    ],
)
def test_what_may_be_something_else_is_refused(tmp_path: Path, channels, words):
    write(tmp_path / "d.exr", channels)
    with pytest.raises(ibr.FileFormatError, match=words):
        ibr.read_depth(tmp_path / "d.exr")


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_channels_and_parts_are_chosen_by_name(tmp_path: Path, dtype):
    values = DEPTH.astype(dtype)
    parts = {**RGB, **named("a", RGB | {"R": OTHER[2]})}, {"Z": values}, {"Z": values + 3, "b.W": values}
    write(tmp_path / "d.exr", *parts, names=("rgba", "depth_left", "depth_right"))
    read = functools.partial(ibr.read_depth, tmp_path / "d.exr")
    np.testing.assert_array_equal(read(), values)
    np.testing.assert_array_equal(read(part="depth_right"), values + 3)
    np.testing.assert_array_equal(read(part="depth_right", channel="b.W"), values)
    np.testing.assert_array_equal(read(channel="G"), OTHER[1])
    assert ibr.read_color(tmp_path / "d.exr")[0, 0, 0] == OTHER[0, 0, 0]
    assert ibr.read_color(tmp_path / "d.exr", channel="a")[0, 0, 0] == OTHER[2, 0, 0]
    everything = "rgba: B, G, R, a.B, a.G, a.R; depth_left: Z; depth_right: Z, b.W"
    with pytest.raises(ibr.FileFormatError, match=f"no channel 'Q' among {everything}"):
        read(channel="Q")
    with pytest.raises(ibr.FileFormatError, match="no part 'x' among rgba, depth_left, depth_right"):
        read(part="x")


@pytest.mark.parametrize(
    ("low", "rows", "columns"),
    [((4, 2), slice(2, 15), slice(4, 11)), ((-2, -3), slice(0, 10), slice(0, 5)), ((50, 50), slice(0), slice(0))],
)
def test_data_windows_are_placed_in_the_display_window(tmp_path: Path, low, rows, columns):
    high = low[0] + SIZE[1] - 1, low[1] + SIZE[0] - 1
    write(tmp_path / "d.exr", {"Z": DEPTH, **RGB}, dataWindow=(low, high), displayWindow=((0, 0), (15, 19)))
    expected = np.full((20, 16), np.nan, np.float32)
    top, left = (max(0, -place) for place in low[::-1])
    part = slice(top, top + rows.stop - (rows.start or 0)), slice(left, left + columns.stop - (columns.start or 0))
    expected[rows, columns] = DEPTH[part]
    np.testing.assert_array_equal(ibr.read_depth(tmp_path / "d.exr"), expected)
    expected[:] = 0
    expected[rows, columns] = RGB["G"][part]
    np.testing.assert_array_equal(ibr.read_color(tmp_path / "d.exr")[..., 1], expected)


def test_colours_of_the_picture_among_layers_and_parts(tmp_path: Path):
    for layers in (RGB, named("Combined", RGB), named("A.B", RGB), RGB | named("Other", XYZ)):
        write(tmp_path / "c.exr", {**layers, **named("Depth", {"Z": DEPTH})})
        np.testing.assert_array_equal(ibr.read_color(tmp_path / "c.exr"), np.moveaxis(OTHER, 0, -1))
    others = {name: OTHER[0] * 0 for name in "RGB"}
    write(tmp_path / "c.exr", {**named("V.DiffCol", others), **named("V.Combined", RGB), **named("V.Emit", others)})
    np.testing.assert_array_equal(ibr.read_color(tmp_path / "c.exr")[..., 0], OTHER[0])
    write(tmp_path / "c.exr", others, RGB, names=("normals", "beauty"))
    np.testing.assert_array_equal(ibr.read_color(tmp_path / "c.exr")[..., 0], OTHER[0])


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["A.R", "A.G", "A.B", "B.R", "B.G", "B.B"], "several layers with R, G, B: A, B"),
        (["A.R", "A.G", "Z"], "no channels R, G, B, nor Y, among A.G, A.R, Z"),
    ],
)
def test_no_colours_to_choose(tmp_path: Path, names, words):
    write(tmp_path / "c.exr", {name: DEPTH for name in names})
    with pytest.raises(ibr.FileFormatError, match=words):
        ibr.read_color(tmp_path / "c.exr")
