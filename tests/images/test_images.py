"""Depth images, and conversions between kinds of depth."""

from __future__ import annotations

import contextlib
import gc
import math
import pickle
import warnings
import weakref

import numpy as np
import pytest

import pyibr as ibr

SIZES = [(7, 13), (1, 1), (61, 37)]


def camera_of(size, projection="perspective") -> ibr.Camera:
    return ibr.Camera([[40, 0.5, 3.2], [0, 44, 5.1], [0, 0, 1]], size, projection=projection)


def image_of(size, dtype=np.uint8):
    rng = np.random.default_rng(0)
    color = rng.integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)
    depth = rng.uniform(1, 9, (size[1], size[0])).astype(np.float32)
    return (color if dtype == np.uint8 else (color / 255).astype(np.float32)), depth


# ---- DepthImage


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_arrays_are_kept_without_a_copy_and_locked(size, dtype):
    color, depth = image_of(size, dtype)
    view = ibr.DepthImage(color, depth, camera_of(size))
    assert np.shares_memory(view.color, color) and np.shares_memory(view.depth, depth)
    assert view.far == math.inf
    for array in (view.color, view.depth, view.valid):
        assert array.flags.c_contiguous
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    depth[0, 0] = 3  # the caller's array can still be changed


def test_strided_arrays_are_copied_to_contiguous_ones():
    color, depth = image_of((61, 37))
    view = ibr.DepthImage(color[:, ::-1], depth[::-1], camera_of((61, 37)))
    assert view.color.flags.c_contiguous and view.depth.flags.c_contiguous
    np.testing.assert_array_equal(view.color, color[:, ::-1])
    np.testing.assert_array_equal(view.depth, depth[::-1])


def test_valid_leaves_out_what_is_no_surface_and_a_backdrop_fills_it():
    depth = np.array([[1, 0, -1, np.nan, np.inf, -np.inf, 4.9, 5, 6]], np.float32)
    color, camera = np.zeros((1, 9, 3), np.uint8), camera_of((9, 1))
    assert np.flatnonzero(ibr.DepthImage(color, depth, camera).valid).tolist() == [0, 6, 7, 8]
    assert np.flatnonzero(ibr.DepthImage(color, depth, camera, far=5).valid).tolist() == [0, 6]
    filled = ibr.DepthImage(color, depth, camera, default_depth=9.0)
    assert filled.depth.tolist() == [[1, 9, 9, 9, 9, 9, *depth[0, 6:].tolist()]]
    near = ibr.DepthImage(color, depth, camera, far=5, default_depth="farthest")
    most = float(depth[0, 6])
    assert near.depth.tolist() == [[1, most, most, most, most, most, most, most, most]]
    assert near.valid.all() and near.far == math.inf
    assert np.isnan(depth[0, 3])  # the given array is unchanged
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(near)).depth, near.depth)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("size", [(1, 1), (61, 37), (300, 400), (40000, 2)])
def test_the_box_around_the_samples(size, projection):
    rng = np.random.default_rng(0)
    camera = camera_of(size, projection).moved(100, 2, -3).orbited(50, (1, 2, 3), axis=(1, -2, 0.5))
    depth = rng.uniform(1, 9, size[::-1]).astype(np.float32)
    depth[rng.random(depth.shape) < 0.2] = math.inf
    depth[: size[1] // 3] = 0
    depth[-1, -1] = 5
    view = ibr.DepthImage(np.zeros((*depth.shape, 3), np.uint8), depth, camera)
    points = view.points
    np.testing.assert_allclose(view.bounds, [points.min(axis=0), points.max(axis=0)], rtol=1e-12)
    low, high = view.bounds_of(np.zeros(depth.shape, bool))
    np.testing.assert_array_equal(low, high)


def test_it_can_be_pickled_and_weakly_referenced():
    view = ibr.DepthImage(*image_of((7, 13)), camera_of((7, 13)), far=7.5)
    session = type("Session", (), {})()
    view.device_cache[session] = {"buffer": lambda: None}  # device data are not pickled
    copy = pickle.loads(pickle.dumps(view))
    np.testing.assert_array_equal(copy.depth, view.depth)
    assert (copy.camera, copy.far, copy.device_cache) == (view.camera, 7.5, {})
    gone = weakref.ref(view)
    del view
    gc.collect()
    assert gone() is None


COLOR, DEPTH = image_of((61, 37))


@pytest.mark.parametrize(
    ("changed", "argument", "words"),
    [
        ({"color": COLOR.transpose(1, 0, 2)}, "color", r"\(37, 61, 3\), got .*\(61, 37, 3\)"),
        ({"color": COLOR.tolist()}, "color", "got list"),
        ({"depth": DEPTH.astype(np.uint16)}, "depth", "depth_from_uint16"),
        ({"depth": DEPTH.T}, "depth", r"\(37, 61\).* got .*\(61, 37\)"),
        ({"depth": DEPTH[..., None]}, "depth", r"\(37, 61, 1\)"),
        ({"depth": None}, "depth", "got NoneType"),
        ({"camera": np.eye(3)}, "camera", "pyibr.Camera"),
        ({"camera": camera_of((37, 61))}, "color", r"\(61, 37, 3\)"),
        ({"far": 0}, "far", "> 0"),
        ({"default_depth": 0}, "default_depth", 'a depth > 0 or "farthest", got '),
        ({"default_depth": 1e39}, "default_depth", "a depth in the range of float32, got float 1e"),
        ({"default_depth": 1e-50}, "default_depth", "a depth in the range of float32, got float 1e-50"),
        ({"default_depth": "near"}, "default_depth", "one of \"farthest\" or a depth > 0, got str 'near'"),
        ({"default_depth": "farthest", "far": 1e-6}, "default_depth", "a depth > 0 for a view with no samples"),
        ({"far": math.nan}, "far", "> 0"),
    ],
)
def test_bad_arguments_are_named(changed, argument, words):
    arguments = {"color": COLOR, "depth": DEPTH, "camera": camera_of((61, 37))} | changed
    with pytest.raises(ibr.ArgumentError, match=words) as caught:
        ibr.DepthImage(**arguments)
    assert caught.value.argument == argument and "\n" not in str(caught.value)


# ---- kinds of depth


def test_disparity_of_motorcycle_calibration():
    depth = ibr.depth_from_disparity([50.0, np.inf, np.nan, -31.086, -40], 994.978, 193.001, offset=31.086)
    assert depth.dtype == np.float32 and depth[0] == pytest.approx(994.978 * 193.001 / 81.086, rel=1e-6)
    assert np.isnan(depth[1:]).all()
    assert np.isnan(ibr.depth_from_disparity(np.zeros((2, 2), np.uint8), 100, 1)).all()


@pytest.mark.parametrize("offset", [0.0, 12.5])
def test_disparity_round_trip(offset):
    depth = DEPTH.copy()
    depth[3, 4] = np.nan
    again = ibr.depth_from_disparity(ibr.disparity_from_depth(depth, 500, 0.1, offset=offset), 500, 0.1, offset=offset)
    np.testing.assert_allclose(again, depth, rtol=1e-5)


@pytest.mark.parametrize("size", SIZES)
def test_euclidean_distance_is_the_distance_of_the_unprojected_point(size):
    camera = camera_of(size)
    _, depth = image_of(size)
    y, x = np.mgrid[: size[1], : size[0]]
    points = camera.unproject(np.column_stack([x.ravel(), y.ravel()]), depth.ravel())
    distance = ibr.euclidean_from_depth(depth, camera)
    np.testing.assert_allclose(distance.ravel(), np.linalg.norm(points, axis=1), rtol=1e-6)
    np.testing.assert_allclose(ibr.depth_from_euclidean(distance, camera), depth, rtol=1e-6)


def test_euclidean_distance_of_an_orthographic_camera_is_planar():
    camera = camera_of((61, 37), "orthographic")
    np.testing.assert_array_equal(ibr.euclidean_from_depth(DEPTH, camera), DEPTH)
    np.testing.assert_array_equal(ibr.depth_from_euclidean(DEPTH, camera), DEPTH)


def test_every_uint16_survives_the_round_trip():
    millimetres = np.array([[0, 1, 1500, 65535]], np.uint16)
    metres = np.array([[np.nan, 0.001, 1.5, 65.535]], np.float32)
    np.testing.assert_array_equal(ibr.depth_from_uint16(millimetres, 1000), metres)
    stored = np.arange(65536, dtype=np.uint16)
    for scale in (1000, 5000, 256, 0.1):
        again = ibr.uint16_from_depth(ibr.depth_from_uint16(stored, scale), scale)
        np.testing.assert_array_equal(again, stored)


@pytest.mark.parametrize("bad", [65.6, 0.0004])
def test_depth_that_does_not_fit_in_16_bits(bad):
    with pytest.raises(ibr.ArgumentError, match=r"depth: expected 1 to 65535 units of 1/1000, got 1 value"):
        ibr.uint16_from_depth(np.array([1, bad, np.nan], np.float32), 1000)


def test_relative_depth_has_its_ends_at_near_and_far():
    values = np.array([[3.0, 5.0], [np.nan, 11.0]])
    depth = ibr.depth_from_relative(values, near=2, far=6)
    # Between the ends, nearness is linear: the value 5 is a quarter of the way from 1/6 to 1/2.
    np.testing.assert_allclose(depth, [[6, 4], [np.nan, 2]], rtol=1e-6)
    for kind in (np.uint8, np.uint16, np.float16):
        np.testing.assert_array_equal(ibr.depth_from_relative(values[:, 1].astype(kind)), np.float32([10, 1]))
    with pytest.raises(ibr.ArgumentError, match="values: expected values that are not all equal"):
        ibr.depth_from_relative([2, 2])
    with pytest.raises(ibr.ArgumentError, match="far: expected a depth beyond near = 3"):
        ibr.depth_from_relative([1, 2], near=3, far=2)


@pytest.mark.parametrize(("near", "far"), [(0.5, 25.0), (2.0, 1000.0), (0.3, 1e6)])
def test_mpeg_levels(near, far):
    ends = ibr.depth_from_mpeg([1.0, 0.5, np.nan], near, far)
    middle = near / 0.5 if far >= 1000 else far * near / (near + 0.5 * (far - near))
    np.testing.assert_allclose(ends, [near, middle, np.nan], rtol=1e-6)
    zero = ibr.depth_from_mpeg([0.0], near, far)
    assert np.isnan(zero[0]) if far >= 1000 else zero[0] == pytest.approx(far)
    assert np.isnan(ibr.depth_from_mpeg([0.0], near, far, zero_is_invalid=True)[0])
    depth = np.linspace(near, 20, 50).astype(np.float32)
    again = ibr.depth_from_mpeg(ibr.mpeg_from_depth(depth, near, far), near, far)
    np.testing.assert_allclose(again, depth, rtol=2e-5)
    assert ibr.mpeg_from_depth([np.nan], near, far)[0] == 0


@pytest.mark.parametrize(("near", "far"), [(0.5, 25.0), (0.1, 1000.0), (0.3, np.inf)])
def test_z_buffers_are_those_of_the_projection(near, far):
    """Z-buffers hold OpenGL's window depth; with `reverse`, Direct3D's depth with exchanged planes."""
    z = np.geomspace(near, min(0.99 * far, 500), 50)
    a, b = (-1, -2 * near) if far == np.inf else ((far + near) / (near - far), 2 * far * near / (near - far))
    window = ((a * -z + b) / z + 1) / 2  # OpenGL looks along -z, so that w = z
    np.testing.assert_allclose(ibr.depth_from_zbuffer(window, near, far), z, rtol=1e-5)
    np.testing.assert_allclose(ibr.depth_from_zbuffer(1 - window, near, far, reverse=True), z, rtol=1e-5)
    depth = z.astype(np.float32)
    np.testing.assert_allclose(ibr.zbuffer_from_depth(depth, near, far), window, atol=1e-6)
    for reverse, cleared in ((False, 1), (True, 0)):
        values = ibr.zbuffer_from_depth([*depth, np.nan, 0, np.inf], near, far, reverse=reverse)
        assert values[-3:].tolist() == [cleared] * 3
        # Values near 1 are rounded by 6e-8 in float32: at depth z this is a relative error of 6e-8 z / near. Values
        # near 0 are precise.
        again = ibr.depth_from_zbuffer(values, near, far, reverse=reverse)
        np.testing.assert_allclose(again[:-3], depth, rtol=1e-6 + (0 if reverse else 6e-8) * 500 / near)
        assert np.isnan(again[-3:]).all()


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda: ibr.depth_from_zbuffer([2.0], 1, 2), "value"),
        (lambda: ibr.depth_from_zbuffer(DEPTH.astype(np.uint16), 1, 2), "value"),
        (lambda: ibr.depth_from_zbuffer([0.5], 0, np.inf), "near"),
        (lambda: ibr.depth_from_zbuffer([0.5], 2, 1), "far"),
        (lambda: ibr.zbuffer_from_depth([0.5], 1, 2), "depth"),
        (lambda: ibr.depth_from_disparity([1.0], 0, 1), "focal"),
        (lambda: ibr.depth_from_disparity([1.0], 1, np.nan), "baseline"),
        (lambda: ibr.disparity_from_depth([1.0], 1, -1), "baseline"),
        (lambda: ibr.depth_from_euclidean(DEPTH.T, camera_of((61, 37))), "distance"),
        (lambda: ibr.euclidean_from_depth(DEPTH.T, camera_of((61, 37))), "depth"),
        (lambda: ibr.depth_from_uint16(DEPTH, 1000), "stored"),
        (lambda: ibr.depth_from_uint16(DEPTH.astype(np.uint16), 0), "scale"),
        (lambda: ibr.depth_from_mpeg(DEPTH.astype(np.uint16), 1, 2), "level"),
        (lambda: ibr.depth_from_mpeg([1.5], 1, 2), "level"),
        (lambda: ibr.depth_from_mpeg([0.5], 2, 1), "far"),
        (lambda: ibr.mpeg_from_depth([0.5], 1, 2), "depth"),
    ],
)
def test_converters_name_the_bad_argument(call, argument):
    with pytest.raises(ibr.ArgumentError) as caught:
        call()
    assert caught.value.argument == argument


EXTREMES = (np.nan, np.inf, -np.inf, 0.0, -0.0, 5e-324, 1e-45, 1e-40, 1e-20, 1.0, -1.0, 65536.0, 1e20, 3.4e38, 1.7e308)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("one", [1e-300, 0.9, 1e300])
@pytest.mark.parametrize("other", [1e-30, np.inf])
def test_nothing_that_depth_may_hold_makes_numpy_warn(tmp_path, dtype, one, other):
    with np.errstate(all="ignore"):
        single, values = (np.array(EXTREMES).astype(kind)[None] for kind in (np.float32, dtype))
    camera = ibr.Camera([[3, 0, 1], [0, 3, 1], [0, 0, 1]], (values.size, 1))
    inside = values[(values >= 0) & (values <= 1)]  # levels are from 0 to 1
    calls = [
        lambda: ibr.depth_from_disparity(values, one, other, offset=1),
        lambda: ibr.disparity_from_depth(values, one, other, offset=1),
        lambda: ibr.depth_from_euclidean(values, camera),
        lambda: ibr.euclidean_from_depth(values, camera),
        lambda: ibr.depth_from_uint16(np.array([[0, 1, 65535]], np.uint16), one),
        lambda: ibr.uint16_from_depth(values, one),
        lambda: ibr.depth_from_relative(values, near=one, far=other),
        lambda: ibr.depth_from_mpeg(inside, one, other),
        lambda: ibr.mpeg_from_depth(values, one, other),
        lambda: ibr.depth_from_zbuffer(inside, one, other),
        lambda: ibr.zbuffer_from_depth(values, one, other, reverse=True),
        lambda: camera.project(np.tile(values.T, 3)),
        lambda: camera.unproject(np.tile(values.T, 2), values[0]),
        lambda: ibr.DepthImage(None, single, camera, far=other).noise,
        lambda: ibr.write_depth(tmp_path / "d.tiff", values, depth_scale=one),
        lambda: ibr.read_depth(tmp_path / "d.tiff", depth_scale=one),
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        for call in calls:
            with contextlib.suppress(ibr.Error):
                call()


# ---- the package


def test_other_names_are_refused():
    with pytest.raises(AttributeError, match="no attribute 'wrap'"):
        _ = ibr.wrap


def test_normals_are_brought_to_length_one():
    camera = ibr.Camera([[10, 0, 3], [0, 10, 4], [0, 0, 1]], (7, 9))
    depth, normals = np.full((9, 7), 2, np.float32), np.tile(np.float32([0.3, 0, -0.4]), (9, 7, 1))
    for scale in (1.0, 2.0, 2.2, 1e-25, 1e25):
        found = ibr.DepthImage(None, depth, camera, normals=normals * np.float32(scale)).normals
        np.testing.assert_allclose(found, np.broadcast_to([0.6, 0, -0.8], (9, 7, 3)), atol=1e-6)
