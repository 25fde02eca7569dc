"""Triangulations of depth images: they have no cracks, keep errors within bounds, and carry the views' attributes."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from pyibr.depthmesh import Segmentation
from tests import scenes
from tests.depthmesh.views import (
    PROJECTIONS,
    by_extent,
    cells_of,
    check_crack_free,
    coverage,
    drawn_pixels,
    rough,
    samples_for,
    samples_of,
    samples_within,
    some_camera,
    some_mesh,
    weights_in,
)
from tests.embree import embree, pixels_of, rays_of
from tests.reference import depthmesh as reference
from tests.slicing.solids import views_of_torus

pytest.importorskip("open3d")

TOLERANCES = (0, 0.3, 1, 4, 20, 1e9)


def test_no_triangulation_has_cracks():
    rng = np.random.default_rng(0)
    partly = 0
    for number in range(24):
        thing = some_mesh(rng, number)
        size, drawn = thing.view.camera.size, cells_of(thing)
        for _ in range(2):
            camera = some_camera(rng, thing.view)
            for tolerance in TOLERANCES:
                covered = check_crack_free(samples_for(thing, camera, tolerance), size)
                assert not (covered & ~drawn).any()
                partly += 0 < covered.sum() < drawn.sum()
    assert partly > 30  # coarse ones lose triangles at depth edges


def test_tolerance_0_is_the_full_grid_and_no_edge_is_lost_at_common_ones():
    """The error of a partly drawn triangle is four times its length, so at least 8 pixels: such triangles are split."""
    rng = np.random.default_rng(1)
    for number in range(48):
        thing = some_mesh(rng, number)
        camera, drawn = thing.view.camera, cells_of(thing)
        assert len(samples_for(thing, camera, 0)) == drawn.sum()
        for tolerance in (0, 1, 4):  # less than 8 / 1.4, since distances are up to 1.4 depths
            np.testing.assert_array_equal(coverage(samples_for(thing, camera, tolerance), camera.size), drawn)


def test_vertices_are_the_samples():
    """Vertices are exactly the samples' points, and give back the samples' pixels for images of any size."""
    for projection in PROJECTIONS:
        for size in ((2, 521), (1031, 3), (61, 37)):
            view = rough(np.random.default_rng(1), size, projection, 0.3)
            mesh = ibr.DepthMesh(view, segmentation=Segmentation("none")).triangulate(view.camera, tolerance=0)
            within = mesh.vertices.reshape(*size[::-1], 3)[1:-1, 1:-1]
            np.testing.assert_array_equal(within, view.points.astype(np.float32).reshape(*size[::-1], 3)[1:-1, 1:-1])
            np.testing.assert_array_equal(samples_of(mesh, view.camera), pixels_of(view.camera))


@pytest.mark.parametrize("tolerance", [0.5, 2])
def test_larger_tolerances_have_fewer_triangles(tolerance):
    thing = ibr.DepthMesh(scenes.smooth((129, 97)))
    camera = thing.view.camera.moved(0.5, 0, 0)
    counts = [len(thing.triangulate(camera, tolerance=t).faces) for t in (0, tolerance, 4 * tolerance, 16 * tolerance)]
    assert counts == sorted(counts, reverse=True)
    assert counts[1] > 2 * counts[3]


# --- simplify ----------------------------------------------------------------------------------------


def vertical_error(mesh: ibr.Mesh, view: ibr.DepthImage) -> float:
    """Largest difference in depth between a sample and the triangle that covers it."""
    depth = view.depth.astype(np.float64)
    perspective = view.camera.projection == "perspective"
    z = view.camera.project(mesh.vertices.astype(np.float64))[1]
    samples, straight = samples_of(mesh, view.camera), np.zeros(depth.shape)
    straight[samples[:, 1], samples[:, 0]] = 1 / z if perspective else z
    worst = 0.0
    for some, points in by_extent(samples[mesh.faces]):
        weight = weights_in(drawn_pixels(some, view.camera.size), points)
        plane = (weight * straight[some[..., 1], some[..., 0]][:, None]).sum(axis=-1)
        off = np.abs((1 / plane if perspective else plane) - depth[points[..., 1], points[..., 0]])
        worst = max(worst, off[(weight > -1e-12).all(axis=-1)].max())
    return worst


def test_simplify_never_exceeds_its_error():
    rng = np.random.default_rng(2)
    used = []
    for number in range(24):
        thing = some_mesh(rng, number)
        drawn = cells_of(thing)
        for bound in (0.0, 0.01, 0.05, 0.3, 5.0):
            corners = samples_within(thing, bound)
            np.testing.assert_array_equal(check_crack_free(corners, thing.view.camera.size), drawn)
            worst = vertical_error(thing.simplify(bound), thing.view)
            # The kernel inverts depths of about 4 twice, with a few roundings of 2^-22.
            assert worst <= bound + 4 * 2**-20
            used.append(worst / bound if bound and len(corners) < drawn.sum() else 0)
    assert np.quantile(used, 0.75) > 0.8  # the bound is used almost fully


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_simplify_sees_every_single_sample(projection):
    """A spike on a plane is found at any sample, even at a border or a hole where a single triangle contains it."""
    side, bound = 9, 0.05
    flat = plane((side, side), projection)
    y, x = np.mgrid[:side, :side]
    for beyond in (0 * x, x + y - 8, 8 - x - y, x - y, y - x):  # there are no samples where this is positive
        for at in zip(*np.nonzero(beyond == 0), strict=True):
            depth = np.where(beyond > 0, np.float32(np.nan), flat.depth)
            depth[at] += 0.1
            view = ibr.DepthImage(flat.color, depth, flat.camera)
            thing = ibr.DepthMesh(view, segmentation=Segmentation("none"))
            # 2^-21: rounding of depths of about 6 in float32.
            assert vertical_error(thing.simplify(bound), view) <= bound + 2**-21, at


def plane(size: scenes.Size, projection: str) -> ibr.DepthImage:
    """View of an oblique plane: 1/z, or z for orthographic cameras, is linear in x and y."""
    y, x = np.mgrid[: size[1], : size[0]]
    straight = 0.3 - 0.0007 * x + 0.001 * y
    depth = (1 / straight if projection == "perspective" else 20 * straight).astype(np.float32)
    return ibr.DepthImage(np.zeros((*size[::-1], 3), np.uint8), depth, scenes.source_camera(size, projection))


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_simplify_leaves_few_triangles_of_planes(projection):
    assert len(ibr.DepthMesh(plane((65, 65), projection)).simplify(1e-4).faces) == 2
    # If sides in cells are no powers of two, the quadtree's blocks shrink towards the border, which has 159 cells.
    thing = ibr.DepthMesh(plane((100, 61), projection))
    assert len(thing.simplify(1e-4).faces) <= 2 * 159
    assert cells_of(thing).sum() == 2 * 99 * 60


def test_simplify_gives_fewer_triangles_than_errors_that_bound():
    """`simplify` measures true errors: for 1/1000 of the depth, smooth hills need about a tenth of the triangles."""
    for projection in PROJECTIONS:
        thing = ibr.DepthMesh(scenes.smooth((129, 129), projection), segmentation=Segmentation("none"))
        counts = [len(thing.simplify(bound).faces) for bound in (0.0, 0.004, 0.016, 0.064)]
        assert counts[0] > 0.99 * 2 * 128 * 128  # a few flat triangles merge
        # Errors grow with the square of a triangle's size, so that four times the error needs about a quarter of the
        # triangles.
        assert counts[1] < 0.15 * counts[0]
        assert counts[2] < 0.45 * counts[1] and counts[3] < 0.45 * counts[2]


# --- projected errors -----------------------------------------------------------------------------------


def errors_in_pixels(fine: ibr.Mesh, coarse: ibr.Mesh, camera: Camera) -> np.ndarray:
    """Distances between two meshes, in pixels: from points that pixels see on one mesh to the other, both ways.

    Every third pixel counts. Pixels that see one mesh alone, at outlines, are left out.
    """
    rays, scenes_of = rays_of(camera)[::3], (embree(fine), embree(coarse))
    t = [scene.cast_rays(rays.astype(np.float32))["t_hit"].numpy().astype(np.float64) for scene in scenes_of]
    both = np.isfinite(t[0]) & np.isfinite(t[1])
    assert both.mean() > 0.05
    assert (np.isfinite(t[0]) != np.isfinite(t[1])).sum() <= 0.01 * both.sum()
    found = []
    for mine, other in ((0, 1), (1, 0)):
        points = (rays[:, :3] + rays[:, 3:] * t[mine][:, None])[both]
        off = scenes_of[other].compute_distance(points.astype(np.float32)).numpy()
        far = np.linalg.norm(points - camera.center, axis=1) if camera.projection == "perspective" else 1.0
        found.append(off * camera.K[0, 0] / far)
    return np.concatenate(found)


@cache
def seen(name: str) -> list[tuple[ibr.DepthMesh, Camera]]:
    """Depth meshes, each with a camera that is not at its view."""
    found = []
    if name == "torus":
        camera = Camera.look_at((1.5, 1.2, 3), (0, 0, 0), (0, 1, 0), (200, 160), fov_y=45)
        flat = Camera.look_at((-1.5, 1, 3), (0, 0, 0), (0, 1, 0), (200, 160), projection="orthographic", height=3)
        for kind in PROJECTIONS:
            found += [(ibr.DepthMesh(views_of_torus(kind)[4]), c) for c in (camera, flat)]
        return found
    for projection in PROJECTIONS:
        for noise in (0.0, 0.01):
            view = rough(np.random.default_rng(4), (120, 90), projection, noise)
            view = ibr.DepthImage(view.color, view.depth, view.camera, noise=0)  # errors include the noise
            own = view.camera.world_from_camera
            for move in ({"yaw": -30, "center": (2, 0.3, 0.5)}, {"pitch": 15, "center": (0, 0.8, 1.5)}):
                camera = Camera(scenes.target_intrinsics((200, 150)), (200, 150), own @ scenes.pose(**move))
                found.append((ibr.DepthMesh(view), camera))
    return found


@pytest.mark.parametrize("tolerance", [1, 2, 4])
@pytest.mark.parametrize("name", ["torus", "rough"])
def test_errors_in_pixels(name, tolerance):
    off, left = [], []
    for thing, camera in seen(name):
        fine, coarse = thing.triangulate(camera, tolerance=0), thing.triangulate(camera, tolerance=tolerance)
        left.append(len(coarse.faces) / len(fine.faces))
        off.append(errors_in_pixels(fine, coarse, camera))
    together = np.concatenate(off)
    assert (together <= 1.5 * tolerance).mean() >= 0.995
    # The tree's errors are sums over levels, and true errors are seldom as large.
    assert (together <= tolerance).mean() >= 0.9995
    assert np.mean(left) < {1: 0.95, 2: 0.8, 4: 0.6}[tolerance]


def shapes(size: scenes.Size, projection: str) -> dict[str, ibr.DepthImage]:
    """Views of walls that are rough, wavy, or flat with single spikes, all without noise."""
    a, b = scenes.image_coordinates(size)
    rng, depth = np.random.default_rng(7), {}
    depth["rough"] = 4 + rng.normal(0, 0.03, a.shape)
    depth["waves"] = 4 + 0.05 * np.sin(40 * a) * np.cos(31 * b)
    depth["spikes"] = np.where(rng.random(a.shape) < 0.01, 3.96, 4.0)
    camera = scenes.source_camera(size, projection)
    color = np.zeros((*size[::-1], 3), np.uint8)
    return {name: ibr.DepthImage(color, z.astype(np.float32), camera, noise=0.0) for name, z in depth.items()}


@pytest.mark.parametrize("fov", [60, 100, 140])
@pytest.mark.parametrize("projection", PROJECTIONS)
def test_the_tolerance_holds_at_every_angle_from_the_axis(projection, fov):
    """Errors are largest where the surface lies far off the axis; the border of the surface, too, is within them."""
    count = 160
    for view in shapes((73, 57), projection).values():
        thing, own = ibr.DepthMesh(view, segmentation=Segmentation("none")), view.camera.world_from_camera
        fine, left = thing.simplify(0.0), []
        points = fine.vertices.astype(np.float64)
        for yaw, pitch in ((0.4, 0.1), (-0.3, 0.3), (0.1, -0.42)):
            turn = scenes.pose(yaw=yaw * fov, pitch=pitch * fov)
            there = Camera.look_at((0, 0, 0), (0, 0, 1), (0, -1, 0), (count, count), fov_y=fov)
            place = np.eye(4)
            place[:3, 3] = own[:3, :3].T @ (points.mean(axis=0) - own[:3, 3]) - (0, 0, 1.2)
            camera = Camera(there.K, there.size, own @ place @ turn)
            coarse = thing.triangulate(camera, tolerance=0.25)
            left.append(len(coarse.faces) / len(fine.faces))
            rays = rays_of(camera).astype(np.float32)
            t = embree(coarse).cast_rays(rays)["t_hit"].numpy().astype(np.float64)
            seen = np.isfinite(t)
            at = rays[seen, :3] + rays[seen, 3:] * t[seen, None]
            near = embree(fine).compute_closest_points(at.astype(np.float32))["points"].numpy().astype(np.float64)
            # The rays' float32 rounds by 2^-23 of distances of up to 10, a thousandth of the least pixel.
            off = np.linalg.norm(camera.project(near)[0] - camera.project(at)[0], axis=1)
            assert seen.mean() > 0.05 and off.max() <= 0.251
        assert min(left) < 0.9


@pytest.mark.parametrize("name", ["torus", "rough"])
def test_the_largest_errors_take_fewer_triangles(name):
    """The paper's rule, the largest error instead of the sum, never takes more triangles, and errors grow little."""
    for tolerance in (1, 4):
        counts, off = [], []
        for thing, camera in seen(name):
            paper = ibr.DepthMesh(thing.view, errors="largest")
            counts.append([len(one.triangulate(camera, tolerance=tolerance).faces) for one in (thing, paper)])
            errors = errors_in_pixels(
                paper.triangulate(camera, tolerance=0), paper.triangulate(camera, tolerance=tolerance), camera
            )
            off.append(errors)
        assert all(sums >= largest for sums, largest in counts)
        assert sum(largest for _, largest in counts) < sum(sums for sums, _ in counts)
        # From level to level, errors fall to a quarter. If all have one sign, they add up to 4/3 of the largest.
        assert (np.concatenate(off) <= 4 / 3 * tolerance).mean() >= 0.9995
    np.testing.assert_array_equal(
        paper.triangulate(camera, tolerance=0).faces, thing.triangulate(camera, tolerance=0).faces
    )


def test_far_away_and_out_of_view_it_is_coarse():
    view = scenes.smooth((129, 129))
    thing, own = ibr.DepthMesh(view), view.camera.world_from_camera
    K = scenes.target_intrinsics((200, 150))
    near, far = (Camera(K, (200, 150), own @ scenes.pose(center=(0, 0, -z))) for z in (0, 100))
    fine = len(thing.triangulate(near, tolerance=1).faces)
    assert len(thing.triangulate(far, tolerance=1).faces) < 0.05 * fine
    # A camera that sees a quarter of the width gets the same fine triangles in view, and coarse triangles elsewhere.
    K = np.array([[600, 0, 600], [0, 600, 75], [0, 0, 1]])
    whole, part = Camera(K, (1200, 150), own), Camera(K, (300, 150), own)
    both = [thing.triangulate(camera, tolerance=0.5) for camera in (whole, part)]
    pixels = [part.project(mesh.vertices)[0] for mesh in both]
    inside = [((p > 0) & (p < (300, 150))).all(axis=1) for p in pixels]
    assert inside[0].sum() == inside[1].sum() > 100
    assert (~inside[1]).sum() < 0.35 * (~inside[0]).sum()
    turned = Camera(K, (300, 150), own @ scenes.pose(yaw=180))
    assert len(thing.triangulate(turned, tolerance=0).faces) < 100


# --- attributes of meshes -----------------------------------------------------------------------------


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_vertices_are_samples(projection):
    view = scenes.holed((61, 37), projection)
    thing = ibr.DepthMesh(view)
    target = view.camera.moved(0.5, 0, 0)
    structure = reference.Tree(view, thing.tree.cells.to_host())
    for mesh in (
        thing.triangulate(view.camera, tolerance=0),
        thing.triangulate(target, tolerance=3),
        thing.simplify(0.05),
    ):
        pixel, z = view.camera.project(mesh.vertices.astype(np.float64))
        samples = samples_of(mesh, view.camera)
        x, y = samples.T
        # Positions of about 5 scene units are rounded to float32. A scene unit is at most 60 pixels.
        drawn = drawn_pixels(samples, view.camera.size)
        np.testing.assert_allclose(pixel, drawn, atol=1e-4)
        expected = [structure.drawn_at((x, y))[2] for x, y in samples.tolist()]
        np.testing.assert_allclose(1 / z if projection == "perspective" else -z, expected, rtol=1e-6)
        np.testing.assert_allclose(mesh.uv, (drawn + 0.5) / view.camera.size, rtol=1e-6, atol=1e-7)
        assert mesh.texture is view.color or np.array_equal(mesh.texture, view.color)
        turned = mesh.normals @ view.camera.world_from_camera[:3, :3]
        np.testing.assert_allclose(turned, thing.normals[y, x], atol=1e-6)
        np.testing.assert_array_equal(mesh.attributes["quality"], thing.quality[y, x])
        # The camera sees the triangles' fronts.
        corner = mesh.vertices[mesh.faces].astype(np.float64)
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        sight = corner.mean(axis=1) - view.camera.center if projection == "perspective" else view.camera.forward
        assert (np.sum(normal * sight, axis=1) < 0).all()
        assert len(np.unique(mesh.faces)) == len(mesh.vertices)


def test_the_own_tolerance_is_the_default():
    view = scenes.smooth((65, 65))
    camera = view.camera.moved(0.3, 0, 0)
    thing = ibr.DepthMesh(view, tolerance=3)
    np.testing.assert_array_equal(thing.triangulate(camera).faces, thing.triangulate(camera, tolerance=3).faces)
    assert len(thing.triangulate(camera, tolerance=0).faces) > len(thing.triangulate(camera).faces)


# --- strips -------------------------------------------------------------------------------------------


def decoded(strips: list[np.ndarray]) -> np.ndarray:
    """Triangles (n, 3) of strips, all wound in one direction; triangles that contain a vertex twice are left out."""
    found = []
    for strip in strips:
        three = np.stack([strip[:-2], strip[1:-1], strip[2:]], -1)
        three[1::2] = three[1::2, [1, 0, 2]]
        found.append(three[(three != np.roll(three, 1, axis=1)).all(axis=1)])
    return np.concatenate(found)


def in_order(faces: np.ndarray) -> np.ndarray:
    """Triangles, each turned to begin with its least vertex number, in sorted order."""
    first = faces.argmin(axis=1)[:, None]
    turned = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)
    return turned[np.lexsort(turned.T)]


def test_strips_hold_the_same_triangles():
    rng = np.random.default_rng(3)
    for number in range(16):
        thing = some_mesh(rng, number)
        camera = some_camera(rng, thing.view)
        for tolerance in (0, 1, 8):
            if not len(samples_for(thing, camera, tolerance)):
                continue
            faces = thing.triangulate(camera, tolerance=tolerance).faces
            strips = thing.strips(camera, tolerance=tolerance)
            np.testing.assert_array_equal(in_order(decoded(strips)), in_order(faces))


def test_strips_are_long_where_nothing_is_cut():
    thing = ibr.DepthMesh(scenes.smooth((65, 65)), segmentation=Segmentation("none"))
    for tolerance in (0, 2):
        camera = thing.view.camera.moved(0.3, 0, 0)
        strips, faces = thing.strips(camera, tolerance=tolerance), thing.triangulate(camera, tolerance=tolerance).faces
        assert len(strips) == 1  # one strip passes all triangles
        # A triangle alone takes 3 numbers. In a strip it takes 1, or 2 where the strip turns.
        assert sum(map(len, strips)) < 2 * len(faces)


@pytest.mark.parametrize("floats", [False, True])
@pytest.mark.parametrize("projection", PROJECTIONS)
def test_strips_carry_normals(projection, floats):
    """Strips have the normals of their mesh. On a plane these are the plane's normal, whatever the camera's pose."""
    view = plane((40, 31), projection)
    color = np.random.default_rng(0).integers(0, 256, view.color.shape, np.uint8)
    turned = Camera(view.camera.K, view.camera.size, scenes.pose(30, 10, center=(1, 2, 3)), projection=projection)
    view = ibr.DepthImage((color / 255).astype(np.float32) if floats else color, view.depth, turned)
    thing, camera = ibr.DepthMesh(view, segmentation=Segmentation("none")), turned.moved(0.3, 0.1, 0)
    a, b, c = (view.points[k] for k in (0, 39, 40 * 30))
    expected = np.cross(c - a, b - a)
    expected /= np.linalg.norm(expected)
    for tolerance in (0, 1):
        mesh, numbers = thing.triangulate(camera, tolerance=tolerance), thing.strips(camera, tolerance=tolerance)
        records = thing.strips(camera, tolerance=tolerance, normals=True)
        for strip, record in zip(numbers, records, strict=True):
            np.testing.assert_array_equal(record["number"], strip)
            np.testing.assert_array_equal(record["position"], mesh.vertices[strip])
            np.testing.assert_array_equal(record["color"], mesh.colors[strip])
            np.testing.assert_array_equal(record["normal"], mesh.normals[strip])
            assert record["color"].dtype == view.color.dtype and record.dtype.itemsize == (40 if floats else 31)
            # Positions of about 5 are rounded to 2^-22 of that, and neighbours are at least 0.05 apart.
            np.testing.assert_allclose(record["normal"], np.broadcast_to(expected, (len(strip), 3)), atol=2e-4)
