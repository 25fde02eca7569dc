"""The quadtree's errors, spheres, states, selections and segmentations, compared with the reference in float64."""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from pyibr.depthmesh import Segmentation
from pyibr.depthmesh.selection import select_for
from pyibr.depthmesh.tree import ErrorsBy
from pyibr.depthmesh.triangulation import list_triangles, pixels_of
from tests import scenes
from tests.depthmesh.views import PROJECTIONS, TESTS, cells_of, rough, samples_for, samples_within
from tests.reference import depthmesh as reference

SIZES = [(2, 2), (7, 13), (17, 17), (35, 20)]
ERRORS: tuple[ErrorsBy, ...] = ("sum", "largest")

# Depths of about 4 are stored as inverses: storing and reading round twice each, by 2^-24. Differences of positions
# round a few times more, and each of the up to 12 levels that are summed does all this again.
ATOL = 4 * 12 * 2**-21


@cache
def all_kinds() -> list[tuple[str, ibr.DepthMesh, reference.Tree]]:
    views = {}
    for number, (projection, size) in enumerate(product(PROJECTIONS, SIZES)):
        holes = 0.03 * (number % 2)
        views[f"{size} {projection} {holes}"] = rough(np.random.default_rng(number), size, projection, 0.02, holes)
    views["holed"], views["stepped"] = scenes.holed((31, 19)), scenes.stepped((17, 17), "orthographic")
    kinds = [ERRORS[(number + number // len(SIZES)) % 2] for number in range(len(views))]  # both for each size
    things = [ibr.DepthMesh(view, errors=errors) for view, errors in zip(views.values(), kinds, strict=True)]
    return [(f"{name} {thing.errors}", thing, twin(thing)) for name, thing in zip(views, things, strict=True)]


def twin(thing: ibr.DepthMesh) -> reference.Tree:
    return reference.Tree(thing.view, thing.tree.cells.to_host(), thing.errors == "largest")


def fields(tree: reference.Tree, side: int) -> tuple[np.ndarray, ...]:
    """Errors, radii, depths and states of a tree's vertices, each (side + 1, side + 1); the four corners have none."""
    errors, radii, depths = np.full((3, side + 1, side + 1), -1.0)
    states = np.zeros((side + 1, side + 1), int)
    for (x, y), vertex in tree.vertices.items():
        errors[y, x], radii[y, x], depths[y, x] = vertex.error, vertex.radius, vertex.depth
        for triangle, state in vertex.states.items():
            states[y, x] |= state << (0 if triangle.is_a else 2)
    return errors, radii, depths, states


def test_errors_spheres_and_states():
    for name, thing, twin_tree in all_kinds():
        tree, side = thing.tree, thing.tree.side
        found = [a.to_host()[:, : side + 1] for a in (*tree.errors.values(), tree.states)]
        errors, radii, depths, states = fields(twin_tree, side)
        some = errors >= 0
        assert side == 1 or some.any()
        np.testing.assert_array_equal(found[0] >= 0, some, name)
        np.testing.assert_allclose(found[0][some], errors[some], rtol=1e-5, atol=ATOL, err_msg=name)
        np.testing.assert_allclose(found[1][some], radii[some], rtol=1e-5, atol=ATOL, err_msg=name)
        np.testing.assert_allclose(found[2][some], depths[some], rtol=2**-21, err_msg=name)  # rounding of means
        np.testing.assert_array_equal(found[3][some], states[some], name)


def test_parents_hold_their_children():
    """A parent's error is no less than its children's, and its sphere holds theirs: each vertex can decide alone."""
    for name, thing, structure in all_kinds():
        tree = thing.tree
        kept = [a.to_host()[:, : tree.side + 1].astype(np.float64) for a in tree.errors.values()]
        errors, radii, depths = (np.where(kept[0] >= 0, a, 0 if a is not kept[0] else -1) for a in kept)
        for corner, vertex in structure.vertices.items():
            x, y = corner
            for cx, cy in vertex.children:
                if errors[cy, cx] < 0 or errors[y, x] < 0:
                    continue
                assert errors[y, x] >= errors[cy, cx], name
                away = structure.place((cx, cy), depths[cy, cx]) - structure.place(corner, depths[y, x])
                # The kernel rounds the distance between both centres.
                assert radii[y, x] >= np.linalg.norm(away) + radii[cy, cx] - ATOL, name


def test_the_root_errors_bound_the_flattest_mesh():
    """Errors are sums over levels, so that no sample is off the coarsest triangles by more than the root's error."""
    for projection in PROJECTIONS:
        thing = ibr.DepthMesh(rough(np.random.default_rng(1), (33, 33), projection), segmentation=Segmentation("none"))
        tree = twin(thing)
        most = max(tree.departure(root) for root in tree.roots)
        # `departure` is measured along z, errors are perpendicular to the bisected edges; slopes are below 2 here.
        assert most <= np.hypot(1, 2) * tree.vertices[16, 16].error


def cameras(view: ibr.DepthImage) -> dict[str, Camera]:
    """Cameras in special positions relative to the view's surface, and an orthographic camera."""
    own = view.camera.world_from_camera
    K = scenes.target_intrinsics((90, 70))
    flat = scenes.target_intrinsics((90, 70), "orthographic", zoom=1.5)
    return {
        "same": Camera(K, (90, 70), own),
        "aside": Camera(K, (90, 70), own @ scenes.pose(yaw=-30, center=(2, 0.3, 0.5))),
        "inside": Camera(3 * K - [[0, 0, 80], [0, 0, 60], [0, 0, 2]], (90, 70), own @ scenes.pose(center=(0, 0, 3.5))),
        "behind": Camera(K, (90, 70), own @ scenes.pose(yaw=180, center=(0.5, 0, 8))),
        "grazing": Camera(K, (90, 70), own @ scenes.pose(yaw=-88, center=(4, 0, 3.8))),
        "away": Camera(K, (90, 70), own @ scenes.pose(yaw=180)),
        "flat": Camera(flat, (90, 70), own @ scenes.pose(yaw=-30, center=(2, 0, 0)), projection="orthographic"),
    }


@pytest.mark.thorough
@pytest.mark.parametrize("projection", PROJECTIONS)
def test_selection_and_triangles(projection):
    for size, holes in [((7, 13), 0.0), ((17, 17), 0.01), ((33, 18), 0.0)]:
        thing = ibr.DepthMesh(rough(np.random.default_rng(2), size, projection, 0.02, holes))
        structure = twin(thing)
        for name, camera in cameras(thing.view).items():
            for tolerance in (0, 0.7, 3):
                expected = structure.needed(camera, tolerance)
                marks = select_for([thing.tree], camera, tolerance).active
                active = marks[0].to_host()[:, : thing.tree.side + 1]
                found = {(x, y) for y, x in np.argwhere(active).tolist() if (x, y) in structure.vertices}
                # Rounding decides for vertices whose sphere or error is just at the limit.
                assert len(found ^ expected) <= 2e-3 * len(structure.vertices), (name, tolerance)
                points = list_triangles([thing.tree], marks).points.to_host()
                pixels = pixels_of(points, thing.view)
                assert (pixels >= 0).all() and (pixels < size).all()
                assert len(np.unique(pixels, axis=0)) == len(pixels)
                triangles = samples_for(thing, camera, tolerance)
                kept = {tuple(map(tuple, t)) for t in triangles.tolist()}
                wound = {counter_clockwise(t) for t in structure.triangles(found)}
                assert kept == wound, (name, tolerance)
                assert len(triangles) == len(kept)


def counter_clockwise(triangle: tuple[reference.Corner, ...]) -> tuple[reference.Corner, ...]:
    a, apex, b = triangle
    area = (apex[0] - a[0]) * (b[1] - a[1]) - (apex[1] - a[1]) * (b[0] - a[0])
    return (a, apex, b) if area < 0 else (b, apex, a)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_simplification(projection):
    for size, holes in [((7, 13), 0.0), ((17, 17), 0.01), ((20, 11), 0.0)]:
        thing = ibr.DepthMesh(rough(np.random.default_rng(3), size, projection, 0.01, holes))
        structure = twin(thing)
        for bound in (0.0123, 0.05, 0.3):  # no sample has exactly such an error
            kept = {tuple(map(tuple, t)) for t in samples_within(thing, bound).tolist()}
            assert kept == {counter_clockwise(t) for t in structure.triangles(structure.simplified(bound))}


@pytest.mark.parametrize("deviations", [0, 1.5])
@pytest.mark.parametrize("test", TESTS)
@pytest.mark.parametrize("projection", PROJECTIONS)
def test_segmentation(projection, test, deviations):
    # With these limits, noise decides for many triangles.
    rule = Segmentation(test, angle=25, depth_range=0.03, gap=0.03, deviations=deviations)
    drawn = []
    for size in [(2, 2), (7, 13), (33, 18)]:
        for view in (rough(np.random.default_rng(5), size, projection, 0.2, 0.02), scenes.stepped(size, projection)):
            expected = reference.segmented(view, rule)[:-1, :-1]
            expected = np.stack([expected & 3, expected >> 2], -1) == reference.DRAWN
            if not expected.any():
                continue
            found = cells_of(ibr.DepthMesh(view, segmentation=rule))
            # Rounding decides for triangles just at the limit.
            assert (found != expected).sum() <= 1e-3 * expected.size
            drawn.append(expected.mean())
    assert min(drawn) < (1 if test == "none" else 0.9 if deviations else 0.7)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_normals_and_quality(projection):
    for view in (
        rough(np.random.default_rng(6), (31, 19), projection, 0.02, 0.02),
        scenes.stepped((17, 17), projection),
    ):
        thing = ibr.DepthMesh(view)
        expected = reference.normals(view, reference.segmented(view, thing.segmentation))
        assert thing.normals.dtype == np.float32
        # Positions of about 4, rounded to 2^-22 of that, differ by 0.1: normals are off by 1/10000 of a radian.
        np.testing.assert_allclose(thing.normals, expected, atol=3e-4)
        np.testing.assert_array_equal(thing.quality, np.abs(thing.normals[..., 2]))
        assert 0 <= thing.quality.min() < thing.quality.max() <= 1 + 1e-6


def test_the_normals_of_planes_are_theirs():
    size = (40, 30)
    normal = np.array([0.4, -0.2, -1.0]) / np.linalg.norm([0.4, -0.2, -1.0])
    for projection in PROJECTIONS:
        camera = scenes.source_camera(size, projection)
        y, x = np.mgrid[: size[1], : size[0]]
        ray = np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(camera.K).T
        distance = -4 / (ray @ normal), (-4 - ray[..., :2] @ normal[:2]) / normal[2]
        depth = distance[projection == "orthographic"]
        view = ibr.DepthImage(np.zeros((*size[::-1], 3), np.uint8), depth.astype(np.float32), camera)
        thing = ibr.DepthMesh(view, segmentation=Segmentation(depth_range=0.1))
        np.testing.assert_allclose(thing.normals, np.broadcast_to(normal, (*size[::-1], 3)), atol=2e-4)


@pytest.mark.parametrize("degrees", [45, 70, 80])
def test_steep_surfaces_have_their_normals(degrees):
    """Neighbouring samples of a steep surface differ much in depth, but have the surface's normals."""
    n = 64
    tangent = np.tan(np.radians(degrees))
    across = (np.arange(n) - 31.5) / n
    depth = np.tile(4 / (1 - across * tangent), (n, 1)).astype(np.float32)
    depth[(depth < 2) | (depth > 8)] = np.nan
    camera = ibr.Camera([[n, 0, 31.5], [0, n, 31.5], [0, 0, 1]], (n, n))
    view = ibr.DepthImage(np.zeros((n, n, 3), np.uint8), depth, camera)
    thing = ibr.DepthMesh(view, segmentation=Segmentation("none"))
    assert view.valid.sum() > 300
    np.testing.assert_allclose(thing.quality[view.valid], np.cos(np.radians(degrees)), atol=1e-3)
    # The paper's test drops triangles that are seen edge-on. Where it keeps triangles, they determine the normals.
    drawn = ibr.DepthMesh(view).quality[1:-1, 1:-1][view.valid[1:-1, 1:-1]]
    assert np.isclose(drawn, np.cos(np.radians(degrees)), atol=1e-3).mean() > 0.9
