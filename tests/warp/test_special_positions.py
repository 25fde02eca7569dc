"""Positions that random cameras never take: epipoles on samples or on pixels, no motion, images of one row.

A ray that runs along a row, a column or a diagonal of samples sees only the edges between these samples.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera, Projection
from pyibr.warp.view import Edges, Method
from tests import scenes
from tests.exact import KEPT_ULP, off
from tests.reference.lines import sideways_reference
from tests.reference.warp import search_reference

METHODS: tuple[Method, ...] = ("epipolar", "search")
PROJECTIONS: tuple[Projection, ...] = ("perspective", "orthographic")
EDGES: tuple[Edges, ...] = ("connect", "cut")
SHARE = 0.005  # fraction of the pixels that may be wrong: where rounding decides whether a ray meets the surface's end


def image(depth: np.ndarray, camera: Camera) -> ibr.DepthImage:
    color = scenes.texture(*scenes.image_coordinates(camera.size))
    return ibr.DepthImage(color, depth.astype(np.float32), camera)


def beside_border(valid: np.ndarray) -> np.ndarray:
    """(H, W) bool: pixels on both sides of the border between valid pixels and holes."""
    grown, shrunk = (f(valid.astype(np.uint8), np.ones((3, 3), np.uint8)) for f in (cv2.dilate, cv2.erode))
    return grown != shrunk


# --- forward and backward, with the epipole on a sample and on a pixel -------------------------------

SIZE, AT = (29, 23), (12, 10)  # AT: the sample, and the pixel, that the camera moves towards
SURROUNDINGS = ("smooth", "a hole at the epipole", "holes around the epipole", "a hole in its row", "boxes")


def depth_around(surroundings: str) -> np.ndarray:
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    dx, dy = x - AT[0], y - AT[1]
    depth = 4 + 0.3 * np.sin(x / 5) * np.cos(y / 4)
    if surroundings == "a hole at the epipole":
        depth[AT[1], AT[0]] = np.nan
    elif surroundings == "holes around the epipole":
        depth[(np.maximum(abs(dx), abs(dy)) == 2) & (dx != dy)] = np.nan
    elif surroundings == "a hole in its row":
        depth[(dy == 0) & (abs(dx) > 2) & (abs(dx) < 6)] = np.nan
    elif surroundings == "boxes":
        depth[(abs(dx) % 11 > 6) & (abs(dy) % 9 > 4)] = 2.65
    return depth


def forward_pair(projection: Projection, move: float, by: float) -> tuple[Camera, Camera]:
    """A source, and a target moved along z, whose epipole is `by` pixels in x and y from the sample and pixel `AT`."""
    f = 22.0
    K = np.array([[f, 0, AT[0] + by], [0, f, AT[1] + by], [0, 0, 1]])
    if projection == "perspective":
        source = Camera(K, SIZE)
    else:
        source = Camera(K / [[4, 4, 1], [4, 4, 1], [1, 1, 1]], SIZE, projection=projection)
    return source, Camera(K, SIZE).moved(0, 0, move)


def at_epipole() -> np.ndarray:
    """(H, W) bool: the pixel that the camera moves towards. It has no epipolar line; other tests cover it."""
    mask = np.zeros(SIZE[::-1], bool)
    mask[AT[1], AT[0]] = True
    return mask


@pytest.mark.parametrize("by", [0.0, 0.001])
@pytest.mark.parametrize("move", [0.6, -0.6])
@pytest.mark.parametrize("edges", EDGES)
@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("surroundings", SURROUNDINGS)
def test_moves_towards_a_sample_are_the_references(surroundings, projection, edges, move, by):
    source, target = forward_pair(projection, move, by)
    view = image(depth_around(surroundings), source)
    seen = search_reference(view, target, edges=edges)
    assert seen.valid.mean() > 0.2
    # In the epipole's row, column and diagonal, rays see edges between samples amid holes, which the reference lacks.
    y, x = np.indices(seen.valid.shape) - np.array(AT)[::-1, None, None]
    on_samples = (y == 0) | (x == 0) | (x == -y) if by < 0.01 else np.zeros_like(seen.valid)
    open_to_the_reference = on_samples & ~seen.valid
    for method in METHODS:
        frame = ibr.warp(view, target, method=method, edges=edges)
        wrong = off(frame.depth, seen.depth)
        wrong &= ~open_to_the_reference & ~at_epipole()
        if (
            wrong.mean() > SHARE
        ):  # rounding decides at more outlines of boxes: pixels may show what the reference shows 0.002 pixels aside
            beside = [
                search_reference(view, scenes.moved_aside(target, *by), edges=edges).depth for by in np.eye(2) * 0.002
            ]
            wrong &= np.logical_and.reduce([off(frame.depth, depth) for depth in beside])
        assert wrong.mean() <= SHARE, (method, wrong.sum())


@pytest.mark.parametrize("move", [0.6, -0.6])
@pytest.mark.parametrize("edges", EDGES)
@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("surroundings", SURROUNDINGS)
def test_a_hair_beside_a_sample_as_much_is_seen(surroundings, projection, edges, move):
    for method in METHODS:
        frames = []
        for by in (0.0, 0.001, -0.001):
            source, target = forward_pair(projection, move, by)
            frames.append(ibr.warp(image(depth_around(surroundings), source), target, method=method, edges=edges))
        for beside in frames[1:]:
            differs = (frames[0].valid != beside.valid) & ~at_epipole()
            assert not (differs & ~beside_border(frames[0].valid)).any(), (method, np.argwhere(differs).tolist())
            # Along the diagonal through the epipole, up to four rays see edges of missing triangles.
            assert differs.sum() <= max(4, SHARE * differs.size), (method, differs.sum())


@pytest.mark.parametrize("by", [0.0, 0.001, 0.3])
@pytest.mark.parametrize("move", [0.6, -0.6, 0.0])
@pytest.mark.parametrize("edges", EDGES)
@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("surroundings", SURROUNDINGS)
def test_the_pixel_at_the_epipole_sees_its_sample(surroundings, projection, edges, move, by):
    """All points of the pixel's ray project to one position in the source: a sample, or a hole."""
    source, target = forward_pair(projection, move, by)
    depth = depth_around(surroundings)
    # 0.3 pixels away from the sample, the surface's depth differs by less than 1 %.
    most = {0.0: 1e-6, 0.001: 1e-5, 0.3: 0.01}[by]
    for method in METHODS:
        seen = ibr.warp(image(depth, source), target, method=method, edges=edges).depth[AT[::-1]]
        np.testing.assert_allclose(seen, depth[AT[::-1]] - move, rtol=most, err_msg=method)


# --- torn orthographic views -------------------------------------------------------------------------


def ramp_and_steps(size: scenes.Size) -> np.ndarray:
    """A slope on the left, and steps of 0.1 to 1.2 scene units on the right."""
    y, x = np.mgrid[: size[1], : size[0]]
    heights = np.array([0.0, 0.1, 0.0, 0.3, 0.0, 0.45, 0.0, 1.2])
    return np.where(x < size[0] // 3, 6 - 0.02 * x, 6 - heights[(y // 6) % 8])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("back", [1.0, 100.0])
def test_what_is_torn_does_not_depend_on_how_far_back_an_orthographic_camera_stands(method, back):
    size, scale = (75, 58), 12.0
    camera = Camera([[scale, 0, 36.5], [0, scale, 27.8], [0, 0, 1]], size, projection="orthographic")
    depth = ramp_and_steps(size)
    near, far = image(depth, camera), image(depth + back, camera.moved(0, 0, -back))
    for target in (
        Camera([[60, 0, 36.2], [0, 60, 29.1], [0, 0, 1]], size, scenes.pose(pitch=8, center=(0.2, -1.1, 0.4))),
        Camera(camera.K, size, scenes.pose(yaw=14, pitch=22), projection="orthographic"),
    ):
        one, other = (ibr.warp(view, target, method=method, cut_ratio=1.05) for view in (near, far))
        assert 0.3 < one.valid.mean() < 0.95
        # In float32, depths of 106 are rounded by 4e-6, a ten-thousandth of a pixel. This matters at silhouettes only.
        assert (one.valid != other.valid).mean() <= 0.002
        np.testing.assert_array_less(
            np.abs(one.depth - other.depth)[one.valid & other.valid & ~beside_border(one.valid)], 1e-3
        )


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("size", [(75, 58), (46, 91)], ids=str)
@pytest.mark.parametrize("cut_ratio", [1.05, 1.02, 1.3])
def test_an_orthographic_view_is_torn_where_depths_differ_by_a_share_of_its_longer_side(size, cut_ratio, method):
    scale, longer = 12.0, max(size) / 12.0
    step = (cut_ratio - 1) * longer
    camera = Camera([[scale, 0, 36.5], [0, scale, 27.8], [0, 0, 1]], size, projection="orthographic")
    target = Camera(
        camera.K, size, scenes.pose(yaw=-20, center=(2.05, 0, 0.36)), projection="orthographic"
    )  # looks at (0, 0, 6)
    for part in (0.99, 1.01):
        depth = np.where(np.arange(size[0]) < size[0] // 2, 6.0, 6.0 + part * step)[None].repeat(size[1], 0)
        view = image(depth, camera)
        connected, cut = (ibr.warp(view, target, method=method, edges=edges, cut_ratio=cut_ratio) for edges in EDGES)
        assert connected.valid.mean() > 0.7
        gap = connected.valid & ~cut.valid
        if part < 1:
            assert not gap.any()
        else:
            # The slope between both depths is one sample wide, so that cutting it opens one pixel in most rows.
            assert gap.sum() >= 0.9 * size[1]


# --- zooms -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("zoom", [8, 32])
@pytest.mark.parametrize("edges", EDGES)
@pytest.mark.parametrize("method", METHODS)
def test_the_nearest_sample_reaches_no_farther_than_the_surface_itself(method, edges, zoom):
    size = (47, 35)
    y, x = np.mgrid[: size[1], : size[0]]
    depth = np.where((x - 23) ** 2 + (y - 17) ** 2 < 9, 2.2, 4.0)
    depth[(x - 25) ** 2 + (y - 20) ** 2 < 3] = np.nan
    camera = Camera([[40, 0, 23], [0, 40, 17], [0, 0, 1]], size)
    view = image(depth, camera)
    zoomed = [[40 * zoom, 0, 151 / 2], [0, 40 * zoom, 133 / 2], [0, 0, 1]]
    for center in ((0, 0, 0), (0.11, 0, 0), (0.07, -0.05, 0.2)):
        target = Camera(zoomed, (152, 134), scenes.pose(center=center))
        nearest, linear = (
            ibr.warp(view, target, method=method, interpolation=sample, edges=edges) for sample in ("nearest", "linear")
        )
        assert linear.valid.mean() > 0.02
        np.testing.assert_array_equal(nearest.valid, linear.valid)


# --- images that are lines ---------------------------------------------------------------------------


@pytest.mark.parametrize("edges", EDGES)
@pytest.mark.parametrize("length", [2, 3, 57])
@pytest.mark.parametrize("scene", ["smooth", "steps", "holes", "noise"])
def test_lines_of_samples_step_along_themselves(scene, length, edges):
    place = np.arange(length)
    depth = {
        "smooth": 4 + 0.4 * np.sin(place / 5),
        "steps": np.where(place % 9 < 4, 2.2, 4.5),
        "holes": np.where(place % 7 == 3, np.nan, 4.0),
        "noise": np.random.default_rng(2).uniform(2.2, 4.5, length),
    }[scene]
    for axis in (0, 1):
        size = (length, 1) if axis == 0 else (1, length)
        camera = Camera([[40, 0, (size[0] - 1) / 2], [0, 40, (size[1] - 1) / 2], [0, 0, 1]], size)
        view = image(depth.reshape(size[::-1]), camera)
        for step in (0.05, 0.23, -0.23):
            move = (step, 0.0) if axis == 0 else (0.0, step)
            seen = sideways_reference(view, move, edges)
            if not np.isfinite(seen.depth).any():
                continue
            for method in METHODS:
                frame = ibr.warp(view, camera.moved(*move, 0), method=method, edges=edges)
                wrong = off(frame.depth, seen.depth) & ~seen.on_end
                assert not wrong.any(), (axis, step, method, np.argwhere(wrong).tolist())


# --- no motion ---------------------------------------------------------------------------------------


def rough_view(projection: Projection) -> ibr.DepthImage:
    """Depth edges, holes, and samples that are surrounded by holes."""
    size = (61, 47)
    y, x = np.mgrid[: size[1], : size[0]]
    depth = np.where((x // 7 + y // 5) % 3 == 0, 2.2, 4.5) + 0.01 * x
    depth[(7 * x + 3 * y) % 29 == 0] = np.nan
    depth[20:31, 30:41] = np.nan
    depth[25, 35] = 3.0
    f = 45.0 if projection == "perspective" else 9.0
    K = [[f, 0, 31.2], [0, 1.1 * f, 22.7], [0, 0, 1]]
    return image(depth, Camera(K, size, scenes.pose(25, -10, 5, (0.4, -1.1, 0.7)), projection=projection))


@pytest.mark.parametrize("sample", ["linear", "nearest"])
@pytest.mark.parametrize("edges", EDGES)
@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("method", [*METHODS, "forward"])
def test_the_same_camera_sees_every_sample(method, projection, edges, sample):
    """Samples stay where they are, and so do holes, since a missing sample removes its triangles."""
    view = rough_view(projection)
    frame = ibr.warp(view, view.camera, method=method, interpolation=sample, edges=edges)
    np.testing.assert_array_equal(frame.valid, view.valid)
    np.testing.assert_array_max_ulp(frame.depth[view.valid], view.depth[view.valid], KEPT_ULP)
    np.testing.assert_array_equal(frame.color[view.valid], view.color[view.valid])
    assert np.isnan(frame.depth[~view.valid]).all() and not frame.color[~view.valid].any()


@pytest.mark.parametrize("edges", EDGES)
@pytest.mark.parametrize("turn", [(4, 0, 0), (0, -6, 0), (0, 0, 17), (5, -3, 90), (12, -7, 20)], ids=str)
def test_a_turned_camera_sees_the_triangles_that_its_rays_pass(turn, edges):
    view = rough_view("perspective")
    K = [[32, 0, 15.3], [0, 29, 16.9], [0, 0, 1]]
    target = Camera(K, (33, 37), view.camera.world_from_camera @ scenes.pose(*turn))
    seen = search_reference(view, target, edges=edges)
    assert seen.valid.mean() > 0.1
    for method in METHODS:
        wrong = off(ibr.warp(view, target, method=method, edges=edges).depth, seen.depth)
        # The camera does not move, so that no surface is seen edge-on. Rounding matters within 0.001 pixels of edges.
        assert wrong.sum() <= SHARE * wrong.size, (method, wrong.sum())


# --- lines of the target that are lines nowhere in the source ----------------------------------------


@pytest.mark.parametrize("edges", EDGES)
@pytest.mark.parametrize("turn", [90, -90, 180])
@pytest.mark.filterwarnings("ignore:warp. the target camera sees nothing")
def test_turned_to_the_side_and_moved_along_the_turn(turn, edges):
    """The middle column's rays lie in the source camera's plane z = 0, which projects to no pixel of the source."""
    source = Camera([[20, 0, 14], [0, 20, 11], [0, 0, 1]], SIZE)
    target = Camera([[25, 0, 16], [0, 25, 9], [0, 0, 1]], (33, 19), scenes.pose(turn, center=(0, -0.25, 0)))
    view = image(depth_around("smooth"), source)
    wide = Camera([[5, 0, 16], [0, 5, 9], [0, 0, 1]], (33, 19), target.world_from_camera)
    for camera in (target, wide):
        swept, searched = (
            ibr.warp(view, camera, method=method, edges=edges, side="both", fill="background") for method in METHODS
        )
        assert not off(swept.depth, searched.depth).sum() > SHARE * swept.depth.size


# --- targets at the source's own centre: nothing moves with its depth --------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("size", [(36, 28), (36, 1), (1, 28), (1, 1), (2, 2)])
def test_a_frame_around_the_picture_is_empty(size, projection, method):
    """Targets with a border around the source's picture, also at twice its size, have nothing in that border."""
    w, h = size
    K, border = np.array([[40, 0, 17.5], [0, 40, 13.5], [0, 0, 1]]), 4
    view = image(np.full((h, w), 2.0), Camera(K, size, projection=projection))
    for zoom in (1, 2):
        larger = np.diag([zoom, zoom, 1.0]) @ K
        larger[:2, 2] += border + (zoom - 1) * 0.5  # pixels' corners coincide with the source's
        target = Camera(larger, (zoom * w + 2 * border, zoom * h + 2 * border), projection=projection)
        frame = ibr.warp(view, target, method=method, classes=True)
        expected = np.zeros(frame.valid.shape, bool)
        expected[border : border + zoom * h, border : border + zoom * w] = True
        np.testing.assert_array_equal(frame.valid, expected)
        assert (np.abs(frame.source[frame.valid] - [(w - 1) / 2, (h - 1) / 2]) <= [w / 2, h / 2]).all()
        if projection == "perspective" and zoom == 1:
            registered = ibr.register(view.depth, view.camera, target)
            np.testing.assert_array_equal(np.isfinite(registered), expected)


@pytest.mark.parametrize("across", [0, 1])
def test_a_row_of_samples_moved_in_its_plane(across):
    """A scanner sees a single row of samples. If it moves in the row's plane, only lines along the row meet samples."""
    K = np.array([[40, 0, 19.5 * (1 - across)], [0, 40, 19.5 * across], [0, 0, 1]])
    size = (1, 40) if across else (40, 1)
    view = image(np.full(size[::-1], 2.0), Camera(K, size))
    for along, ahead in ((0.2, 0.0), (0.0, 0.5), (0.1, -0.3)):
        step = (0, along, ahead) if across else (along, 0, ahead)
        found = [ibr.warp(view, view.camera.moved(*step), method=method) for method in METHODS]
        assert found[0].valid.sum() >= 34
        np.testing.assert_array_equal(found[0].valid, found[1].valid)
        np.testing.assert_allclose(found[0].depth, found[1].depth, rtol=1e-4)


@pytest.mark.parametrize("degrees", [-60, -25, 40, 80])
@pytest.mark.parametrize("shape", ["step", "slope", "teeth"])
@pytest.mark.parametrize("projection", PROJECTIONS)
def test_an_orthographic_plane_that_cuts_the_surface(projection, shape, degrees):
    """Sweep and search agree where the orthographic target's plane cuts the surface: only the part ahead is visible.

    From an orthographic source to a turned orthographic target, lines run along rows, through the pixels' centres.
    """
    x = np.mgrid[:28, :36][1]
    shapes = {"step": np.where(x < 18, 2.5, 4.5), "slope": 2.5 + x / 12, "teeth": np.where(x % 2, 2.5, 4.5)}
    depth = shapes[shape]
    f = 40 if projection == "perspective" else 12
    view = image(depth, Camera([[f, 0, 17.5], [0, f, 13.5], [0, 0, 1]], (36, 28), projection=projection))
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    pose = np.array([[c, 0, s, 0.1], [0, 1, 0, 0.1], [-s, 0, c, 3.5], [0, 0, 0, 1]])
    target = Camera([[20, 0, 31.5], [0, 20, 23.5], [0, 0, 1]], (64, 48), pose, projection="orthographic")
    for edges in EDGES if shape != "teeth" else ("connect",):  # cutting would leave no triangle of the teeth
        found = [ibr.warp(view, target, method=method, edges=edges, side="both") for method in METHODS]
        assert found[1].valid.sum() > 150
        assert off(found[0].depth, found[1].depth).mean() <= SHARE
        if edges == "connect":  # the sweep then finds the very surface that each line meets
            np.testing.assert_array_equal(found[0].valid, found[1].valid)
