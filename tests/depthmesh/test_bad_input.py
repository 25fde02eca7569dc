"""Depth meshes with invalid arguments, which errors must name, and of views that contain almost nothing."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import raycast as capture
from pyibr.core.camera import Camera
from pyibr.depthmesh import Segmentation
from tests import scenes

VIEW = scenes.smooth((33, 21))
CAMERA = VIEW.camera.moved(0.2, 0, 0)


def with_depth(depth: np.ndarray) -> ibr.DepthImage:
    height, width = depth.shape
    camera = Camera([[20, 0, width / 2], [0, 20, height / 2], [0, 0, 1]], (width, height))
    return ibr.DepthImage(np.full((height, width, 3), 99, np.uint8), depth.astype(np.float32), camera)


def isolated() -> ibr.DepthImage:
    """A view with valid samples that form no triangle."""
    depth = np.full((9, 9), np.nan)
    depth[::2, ::2] = 2.0
    return with_depth(depth)


NOTHING = [with_depth(np.full((5, 5), bad)) for bad in (np.nan, np.inf, 0.0, -1.0)]
THIN = [with_depth(np.full(shape, 2.0)) for shape in ((1, 7), (7, 1), (1, 1))]
BAD_NUMBERS = [-0.1, np.nan, np.inf, "1", None, [1, 2], True]


def refused(argument: str, call, *arguments, **options) -> str:
    """Return the message of the ArgumentError that a call raises; it must begin with the argument's name."""
    with pytest.raises(ibr.ArgumentError) as caught:
        call(*arguments, **options)
    message = str(caught.value)
    assert message.startswith(f"{argument}: "), message
    assert caught.value.__cause__ is None
    assert "\n" not in message
    return message


@pytest.mark.parametrize("view", [*NOTHING, *THIN, None, "view", VIEW.depth, ibr.Mesh(np.eye(3), [[0, 1, 2]])], ids=str)
def test_no_view_for_a_mesh(view):
    refused("view", ibr.DepthMesh, view)


@pytest.mark.parametrize("tolerance", BAD_NUMBERS, ids=repr)
def test_tolerances(tolerance):
    thing = ibr.DepthMesh(VIEW)
    calls = [(ibr.DepthMesh, VIEW), (ibr.DepthMeshObject, [VIEW])]
    if tolerance is not None:  # for these calls, None means the mesh's tolerance
        calls += [(thing.triangulate, CAMERA), (thing.strips, CAMERA)]
    for call, argument in calls:
        refused("tolerance", call, argument, tolerance=tolerance)
    refused("max_error", thing.simplify, tolerance)
    refused("normals", thing.strips, CAMERA, normals="yes")


@pytest.mark.parametrize("camera", [None, 3, VIEW])
def test_cameras(camera):
    thing, several = ibr.DepthMesh(VIEW), ibr.DepthMeshObject([VIEW])
    for call in (thing.triangulate, thing.strips, several.weights, several.occupancy):
        refused("camera", call, camera)


@pytest.mark.parametrize(
    ("argument", "value"),
    [
        *[("blended", value) for value in (0, -1, 33, 1.5, "3", None, True)],
        *[("epsilon", value) for value in (-0.1, np.nan, "1", [1])],
        *[("blend", value) for value in ("best", None, 0)],
        *[("choose", value) for value in ("best", None, 0)],
        *[("segmentation", value) for value in ("orthogonality", 5)],
        *[(name, value) for name in ("closed", "match_exposures") for value in ("yes", None, 2)],
    ],
)
def test_options_of_objects(argument, value):
    refused(argument, ibr.DepthMeshObject, [VIEW], **{argument: value})


@pytest.mark.parametrize(
    ("argument", "value"),
    [
        *[("test", value) for value in ("best", None, 0)],
        *[("angle", value) for value in (0, -5, 90, np.nan, "5", None, [5])],
        *[(name, value) for name in ("depth_range", "gap") for value in (0, -1, np.nan, np.inf, "1", None)],
        *[("deviations", value) for value in (-1, np.nan, np.inf, "1", None)],
    ],
)
def test_segmentations(argument, value):
    refused(argument, Segmentation, **{argument: value})


@pytest.mark.parametrize("errors", ["max", None, 0])
def test_errors(errors):
    refused("errors", ibr.DepthMesh, VIEW, errors=errors)


@pytest.mark.parametrize("reuse", [-0.1, 0.51, np.nan, None, "some", True], ids=repr)
def test_reuse(reuse):
    refused("reuse", ibr.DepthMesh, VIEW, reuse=reuse)
    refused("reuse", ibr.DepthMeshObject, [VIEW], reuse=reuse)


def test_views_of_objects():
    apart = [ibr.DepthImage(VIEW.color, VIEW.depth, VIEW.camera.moved(100.0 * k, 0, 0)) for k in range(3)]
    pair_and_one = [VIEW, VIEW, apart[2]]
    for views in (
        [],
        (),
        None,
        VIEW,
        "views",
        [3],
        [VIEW, None],
        apart,
        [VIEW, NOTHING[0]],
        [VIEW, THIN[0]],
        pair_and_one,
    ):
        refused("views", ibr.DepthMeshObject, views)
    assert "view 1" in refused("views", ibr.DepthMeshObject, [VIEW, NOTHING[0]])
    assert "view 1" in refused("views", ibr.DepthMeshObject, [VIEW, None])
    assert "view 2" in refused("views", ibr.DepthMeshObject, pair_and_one)
    assert "volume" in refused("views", ibr.DepthMeshObject, apart)


def test_views_of_one_flat_thing():
    """The bounding boxes of the views are flat, and differ by rounding."""
    corners = [[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]]
    wall = capture.MeshScene(corners, [[0, 1, 2], [0, 2, 3]])
    for away in (3.3, 4.7, 5.9):
        cameras = [Camera.look_at((0.1, 0.2, d), (0.1, 0.2, 0), (0, 1, 0), (33, 33), fov_y=30) for d in (4, away)]
        frame = ibr.render(ibr.DepthMeshObject([wall.capture(camera) for camera in cameras]), cameras[0])
        assert frame.valid[1:-1, 1:-1].all()


def test_samples_that_make_no_triangle():
    thing = ibr.DepthMesh(isolated())
    for call in (
        lambda: thing.tree,
        lambda: thing.triangulate(CAMERA),
        lambda: thing.simplify(0.1),
        lambda: thing.strips(CAMERA),
        lambda: ibr.render(thing, CAMERA),
    ):
        assert "triangles" in refused("view", call)
    several = ibr.DepthMeshObject([with_depth(np.full((9, 9), 2.0)), isolated()])
    message = refused("views", ibr.render, several, CAMERA)
    assert "triangles" in message and "in view 1" in message


def test_depths_beyond_single_precision():
    """Products of four distances must fit float32. Huge depths that stand for background are refused without `far`."""
    depth = np.full((9, 9), 2.0)
    depth[2, 2] = 1e15
    camera = with_depth(depth).camera
    assert "far" in refused("view", ibr.DepthMesh(with_depth(depth)).simplify, 0.1)
    assert "1e-06" in refused("view", ibr.render, ibr.DepthMesh(with_depth(5e-7 * depth)), camera)
    told = ibr.DepthImage(np.zeros((9, 9, 3), np.uint8), depth.astype(np.float32), camera, far=1e10)
    assert len(ibr.DepthMesh(told).simplify(0).faces) > 10
    for scale in (1e-4, 1e6):
        flat = with_depth(np.full((9, 9), 2 * scale))
        assert len(ibr.DepthMesh(flat).simplify(1e-3 * scale).faces) == 2
        assert ibr.render(ibr.DepthMesh(flat), flat.camera).valid[1:8, 1:8].all()


def test_a_view_cannot_be_changed_once_it_is_a_mesh():
    thing, several = ibr.DepthMesh(VIEW), ibr.DepthMeshObject([VIEW])
    for made, name in ((thing, "view"), (thing, "tolerance"), (several, "meshes"), (several, "blend")):
        with pytest.raises(AttributeError, match=name):
            setattr(made, name, None)


def test_looking_away():
    """A camera that does not see the surface gets an empty picture, and a coarse mesh."""
    things = ibr.DepthMesh(VIEW), ibr.DepthMeshObject([VIEW])
    own = VIEW.camera.world_from_camera
    for pose in (scenes.pose(yaw=180), scenes.pose(center=(500, 0, 0)), scenes.pose(center=(0, 0, 1000))):
        camera = Camera(CAMERA.K, CAMERA.size, own @ pose)
        for thing in things:
            frame = ibr.render(thing, camera, background=(9, 9, 9))
            assert not frame.valid.any() and np.isnan(frame.depth).all() and (frame.color == 9).all()
        assert not things[1].occupancy(camera).any()
    away = [Camera(CAMERA.K, CAMERA.size, own @ scenes.pose(*p)) for p in ((0, 0, 0, (500, 0, 0)), (180,))]
    for thing in (things[0], ibr.DepthMesh(scenes.smooth((33, 33)))):
        for camera in away:
            assert 2 <= len(thing.triangulate(camera).faces) < 50


def test_views_where_all_is_lost_at_a_tolerance():
    """The views contain a few triangles amid holes, so far away that each triangle is smaller than the tolerance."""
    depth = np.full((17, 17), np.nan)
    depth[3:5, 3:5] = 2.0
    view = with_depth(depth)
    thing, far = ibr.DepthMesh(view), view.camera.moved(0, 0, -1e4)
    assert not ibr.render(thing, far).valid.any()
    refused("camera", thing.triangulate, far)
    assert not ibr.render(ibr.DepthMeshObject([view]), far).valid.any()
    refused("camera", thing.strips, far, tolerance=50)
    refused("camera", thing.triangulate, far, tolerance=50)


@pytest.mark.parametrize("size", [(2, 2), (2, 9), (9, 2), (3, 3)])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_the_least_sizes(size, projection):
    view = scenes.flat(size, projection)
    thing, cells = ibr.DepthMesh(view), (size[0] - 1) * (size[1] - 1)
    assert len(thing.triangulate(view.camera, tolerance=0).faces) == 2 * cells
    assert 2 <= len(thing.simplify(10).faces) <= 2 * cells
    frame = ibr.render([thing, ibr.DepthMeshObject([view])], view.camera.resized((40, 30)))
    assert frame.valid.sum() > 100
    # Depth is inverted, and interpolated within a triangle, with rounding.
    np.testing.assert_allclose(frame.depth[frame.valid], 4, rtol=1e-5)


def test_from_within_the_surface():
    for projection in ("perspective", "orthographic"):
        view = scenes.stepped((61, 37), projection)
        things = ibr.DepthMesh(view, tolerance=0), ibr.DepthMesh(view, tolerance=2), ibr.DepthMeshObject([view])
        points = view.points[:: len(view.points) // 5]
        for eye in points:
            for turn in (0, 90, 200):
                pose = view.camera.world_from_camera @ scenes.pose(yaw=turn)
                pose[:3, 3] = eye
                camera = Camera(CAMERA.K, CAMERA.size, pose)
                for thing in things:
                    frame = ibr.render(thing, camera)
                    np.testing.assert_array_equal(np.isfinite(frame.depth), frame.valid)
                    assert (frame.depth[frame.valid] > 0).all()
