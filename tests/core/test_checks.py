"""Arrays in all common forms: all functions convert the same forms, and refuse others in one sentence."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.checks import checked_colors
from pyibr.images import metrics

SIZE = (7, 5)
CAMERA = ibr.Camera([[9, 0, 3], [0, 9, 2], [0, 0, 1]], SIZE)
BYTES = np.random.default_rng(0).integers(0, 256, (5, 7, 3), np.uint8)
BYTES[0, 0, :2] = 0, 255
FLOATS = (BYTES / np.float32(255)).astype(np.float32)
WITH_NAN = FLOATS.copy()
WITH_NAN[3, 2, 1] = WITH_NAN[4, 5, 0] = np.nan
DEPTH = np.linspace(1, 3, 35, dtype=np.float32).reshape(5, 7)
HEIGHT = np.linspace(0, 1, 35, dtype=np.float32).reshape(5, 7)
NORMALS = np.full((5, 7, 3), (0.25, 0.5, 0.75), np.float32)
MASK = DEPTH < 2
CORNERS, UV = [[0, 0, 2], [1, 0, 2], [0, 1, 2], [1, 1, 2]], [[0, 0], [1, 0], [0, 1], [1, 1]]
SQUARE = ibr.Mesh(CORNERS, [[0, 1, 2], [3, 2, 1]], uv=UV)

Take = Callable[[Any], Any]

COLORS: dict[str, Take] = {
    "DepthImage": lambda color: ibr.DepthImage(color, DEPTH, CAMERA).color,
    "Silhouette": lambda color: ibr.Silhouette(color, MASK, CAMERA).color,
    "texture": lambda color: ibr.Mesh(CORNERS, [[0, 1, 2]], uv=UV, texture=color).texture,
    "SlicedSurface": lambda color: ibr.SlicedSurface(SQUARE, HEIGHT, color, 0.1).color,
    "ReliefSurface": lambda color: ibr.ReliefSurface(SQUARE, HEIGHT, color, 0.1).color,
}
DEPTHS: dict[str, Take] = {"DepthImage": lambda depth: ibr.DepthImage(BYTES, depth, CAMERA).depth}
HEIGHTS: dict[str, Take] = {
    "SlicedSurface": lambda height: ibr.SlicedSurface(SQUARE, height, BYTES, 0.1).height,
    "with_height": lambda height: ibr.SlicedSurface(SQUARE, HEIGHT, BYTES, 0.1).with_height(height).height,
    "ReliefSurface": lambda height: ibr.ReliefSurface(SQUARE, height, BYTES, 0.1).height,
}
NORMAL_MAPS: dict[str, Take] = {
    "SlicedSurface": lambda normals: ibr.SlicedSurface(SQUARE, HEIGHT, BYTES, 0.1, normal_map=normals).normal_map,
    "ReliefSurface": lambda normals: ibr.ReliefSurface(SQUARE, HEIGHT, BYTES, 0.1, normal_map=normals).normal_map,
}
KINDS = [("color", COLORS, FLOATS), ("depth", DEPTHS, DEPTH), ("height", HEIGHTS, HEIGHT)]
KINDS += [("normal_map", NORMAL_MAPS, NORMALS)]
TAKERS = [(f"{what} of {name}", take, good) for what, takers, good in KINDS for name, take in takers.items()]
each_taker = pytest.mark.parametrize(("name", "take", "good"), TAKERS, ids=[name for name, _, _ in TAKERS])
each_color = pytest.mark.parametrize("take", COLORS.values(), ids=COLORS)

OPTIONAL = ("color of DepthImage", "color of texture", "normal_map of SlicedSurface", "normal_map of ReliefSurface")


class Tagged(np.ndarray):
    """A subclass of arrays, as some libraries define."""


def read_only(array: np.ndarray) -> np.ndarray:
    array = array.copy()
    array.flags.writeable = False
    return array


SAME: dict[str, Callable[[np.ndarray], Any]] = {
    "other byte order": lambda a: a.astype(a.dtype.newbyteorder()),
    "float64": lambda a: a.astype(np.float64),
    "float64 of other byte order": lambda a: a.astype(">f8"),
    "backwards": lambda a: a[::-1, ::-1].copy()[::-1, ::-1],
    "columns first": np.asfortranarray,
    "every other": lambda a: np.repeat(a, 2, axis=1)[:, ::2],
    "read only": read_only,
    "masked nowhere": lambda a: np.ma.masked_array(a, np.zeros(a.shape, bool)),
    "masked by nothing": np.ma.masked_array,
    "subclass": lambda a: a.view(Tagged),
    "memory map": lambda a: a.view(np.memmap),
    "list": lambda a: a.tolist(),
}
WRONG: dict[str, Callable[[np.ndarray], Any]] = {
    "object": lambda a: a.astype(object),
    "text": lambda a: a.astype(str),
    "complex": lambda a: a.astype(complex),
    "bool": lambda a: a > 0.5,
    "int64": lambda a: a.astype(np.int64),
    "int8": lambda a: a.astype(np.int8),
    "dates": lambda a: a.astype(np.int64).astype("datetime64[s]"),
    "records": lambda a: np.zeros(a.shape, [("r", "f4")]),
    "empty": lambda a: a[:0],
    "a number": lambda a: 1.0,
    "None": lambda a: None,
    "ragged": lambda a: [[1.0], [1.0, 2.0]],
    "a dimension more": lambda a: a[None],
    "masked object": lambda a: np.ma.masked_array(a.astype(object), a > 0.5),
}


@each_taker
@pytest.mark.parametrize("how", SAME)
def test_what_holds_the_same_numbers_is_the_same(name, take, good, how):
    given = SAME[how](good)
    kept = take(given)
    assert type(kept) is np.ndarray and kept.dtype == np.float32
    assert kept.flags.c_contiguous
    np.testing.assert_array_equal(kept, take(good))


@each_taker
@pytest.mark.parametrize("how", WRONG)
def test_what_holds_something_else_is_refused_in_one_sentence(name, take, good, how):
    if how == "None" and name in OPTIONAL:
        return
    with pytest.raises(ibr.ArgumentError) as caught:
        take(WRONG[how](good))
    assert caught.value.argument in (name.split(" of ")[0], "texture") and "\n" not in str(caught.value)


@pytest.mark.filterwarnings("ignore:the matrix subclass")
def test_matrices_are_arrays():
    np.testing.assert_array_equal(ibr.DepthImage(BYTES, np.matrix(DEPTH), CAMERA).depth, DEPTH)
    np.testing.assert_array_equal(ibr.SlicedSurface(SQUARE, np.matrix(HEIGHT), BYTES, 0.1).height, HEIGHT)
    assert ibr.Camera(np.matrix(CAMERA.K), SIZE) == CAMERA
    assert type(ibr.Camera(np.matrix(CAMERA.K), SIZE).K) is np.ndarray


def test_masked_depth_is_invalid():
    for dtype in (np.float16, np.float32, np.float64):
        depth = DEPTH.astype(dtype)
        kept = ibr.DepthImage(BYTES, np.ma.masked_array(depth, MASK), CAMERA).depth
        np.testing.assert_array_equal(kept, np.where(MASK, np.float32(np.nan), depth.astype(np.float32)))
    masked = np.ma.masked_array(DEPTH, MASK)
    units = np.ma.masked_array((DEPTH * 1000).astype(np.uint16), MASK)
    for depth in (
        ibr.depth_from_disparity(masked, 1, 1),
        ibr.disparity_from_depth(masked, 1, 1),
        ibr.depth_from_disparity(units, 1, 1, offset=5),
        ibr.depth_from_euclidean(masked, CAMERA),
        ibr.euclidean_from_depth(masked, CAMERA),
        ibr.depth_from_uint16(units, 1000),
        ibr.depth_from_mpeg(masked / 4, 1, 2),
    ):
        np.testing.assert_array_equal(np.isnan(depth), MASK)
    for stored in (ibr.uint16_from_depth(masked, 1000), ibr.mpeg_from_depth(masked, 0.5, 4)):
        assert not stored[MASK].any() and stored[~MASK].all()


@each_taker
def test_what_is_masked_elsewhere_is_refused(name, take, good):
    wrong, said = np.ma.masked_array(good, good > 0.5), "of them masked$"
    if name.startswith("depth"):  # floats may be masked
        wrong = np.ma.masked_array(DEPTH.astype(np.uint16), MASK)
        said = r"^depth: .* got an array of shape \(5, 7\) and dtype uint16, 1[0-9] of them masked$"
    with pytest.raises(ibr.ArgumentError, match=said):
        take(wrong)


@each_color
def test_bytes_are_kept_as_bytes(take):
    np.testing.assert_array_equal(take(BYTES), BYTES)
    assert take(BYTES[:, ::-1]).dtype == np.uint8


@each_color
@pytest.mark.parametrize(
    ("color", "words"),
    [
        (BYTES.astype(np.float32), r"values from 0 to 255 \(divide them by 255\)"),
        (FLOATS * 1.01, r"values from 0 to 1.0\d* \(clip them: np.clip\(color, 0, 1\)\)"),
        (FLOATS - 0.01, r"values from -0.01 to 0.9\d* \(clip them"),
        (FLOATS * 1e30, r"clip them"),
        (WITH_NAN, r"2 values that are not finite, the first at \[3, 2, 1\]"),
        (np.full((5, 7, 3), 1e300), r"105 values that are not finite, the first at \[0, 0, 0\]"),
        (BYTES.astype(np.uint16), "uint16"),
        (BYTES[..., 0], "gray"),
        (np.dstack([BYTES, BYTES[..., 0]]), "alpha"),
    ],
)
def test_colors_out_of_range_are_refused(take, color, words):
    with pytest.raises(ibr.ArgumentError, match=words):
        take(color)


def test_colors_of_vertices_are_checked_alike():
    def take(colors: Any) -> Any:
        return ibr.Mesh(CORNERS, [[0, 1, 2]], colors=colors).colors

    floats = FLOATS[0, :4]
    for how, change in SAME.items():
        np.testing.assert_array_equal(take(change(floats)), floats, err_msg=how)
    for wrong in (floats * 255, floats * np.nan, np.ma.masked_array(floats, floats > 0.5), floats[:3], floats > 0.5):
        with pytest.raises(ibr.ArgumentError, match=r"^colors: "):
            take(wrong)


def test_colors_may_lie_beyond_the_range_by_rounding():
    assert ibr.DepthImage(np.full((5, 7, 3), 1 + 1e-6), DEPTH, CAMERA).color.max() > 1
    assert ibr.DepthImage(np.full((5, 7, 3), -0.0, np.float32), DEPTH, CAMERA).valid.all()


def test_arrays_that_fit_are_not_copied():
    for color in (BYTES, FLOATS):
        assert checked_colors("color", color, (5, 7, 3)) is color


def test_masks_and_measures():
    masked = np.ma.masked_array(MASK, DEPTH > 2)
    for call in (
        lambda: ibr.Silhouette(BYTES, masked, CAMERA),
        lambda: ibr.Silhouette(BYTES, DEPTH, CAMERA),
        lambda: ibr.Silhouette(BYTES, "mask", CAMERA),
        lambda: metrics.psnr(np.ma.masked_array(BYTES, BYTES > 5), BYTES),
        lambda: metrics.psnr("a", BYTES),
        lambda: metrics.depth_rmse(None, DEPTH),
        lambda: metrics.hole_ratio(DEPTH),
        lambda: metrics.silhouette_iou(MASK, masked),
        lambda: ibr.clean_depth("depth"),
        lambda: ibr.clean_depth([[1.0], [1.0, 2.0]]),
        lambda: ibr.clean_depth(DEPTH, color=FLOATS * 255),
        lambda: ibr.clean_depth(DEPTH, before="depth"),
        lambda: ibr.write_color("color.png", None),
        lambda: ibr.write_color("color.png", np.ma.masked_array(BYTES, BYTES > 5)),
        lambda: ibr.write_mask("mask.png", masked),
        lambda: ibr.write_depth("depth.npy", "depth"),
        lambda: ibr.Camera(np.ma.masked_array(CAMERA.K, CAMERA.K == 9), SIZE),
        lambda: ibr.Mesh(np.ma.masked_array(CORNERS, np.equal(CORNERS, 1)), [[0, 1, 2]]),
        lambda: ibr.Mesh(CORNERS, [[0, 1], [2]]),
        lambda: ibr.Mesh(CORNERS, [[0, 1, 2]], uv=[[0], [1, 2]]),
        lambda: ibr.depth_from_disparity("disparity", 1, 1),
        lambda: ibr.depth_from_disparity([1.0], 1, 1, offset=None),
        lambda: ibr.depth_from_disparity([1.0], [[1], [1, 2]], 1),
    ):
        with pytest.raises(ibr.ArgumentError) as caught:
            call()
        assert "\n" not in str(caught.value)
    mask = ibr.Silhouette(BYTES, MASK[::-1], CAMERA).valid
    assert mask.flags.c_contiguous and not mask.flags.writeable
