"""Frusta, the points that they see, and how much of a surface they cover, compared with ray casting."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import MeshScene, models
from pyibr.capture.coverage import Surface, surface_of, unseen_share
from pyibr.capture.frusta import Frustum, Stroke, load_frusta, save_frusta, save_set
from pyibr.capture.proposal import propose_frusta
from pyibr.picture.light import light_for
from tests.capture.test_sets import assert_same
from tests.capture.torus import torus
from tests.data import shared
from tests.embree import embree


@cache
def donut() -> ibr.Mesh:
    return models.donut(64)


def frustum(size: int = 96, **how) -> Frustum:
    return Frustum.look_at((0.5, 0.3, 3), (0, 0, 0), (0, 1, 0), size, **how)


# ---- frusta


def test_the_donut_is_closed_and_its_normals_point_outwards():
    mesh = models.donut(25, radius=2.0, tube=0.5)
    assert len(mesh.faces) == 1250
    ring = np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1])
    np.testing.assert_allclose(np.hypot(ring - 2, mesh.vertices[:, 2]), 0.5, rtol=1e-5)
    corner = mesh.vertices[mesh.faces].astype(float)
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    assert (np.einsum("nc,nc->n", across, mesh.normals[mesh.faces[:, 0]]) > 0).all()
    # The volume, by the divergence theorem, is a little less than the torus's, 2 pi^2 R r^2.
    volume = np.einsum("nc,nc->", across, corner[:, 0]) / 6
    assert 0.96 <= volume / (2 * np.pi**2 * 2 * 0.25) <= 1
    with pytest.raises(ibr.ArgumentError, match="sides"):
        models.donut(2)


def test_what_a_frustum_sees_is_what_rays_see():
    view = frustum().capture(donut())
    truth = MeshScene.from_mesh(donut()).capture(frustum().camera)
    both = view.valid & truth.valid
    assert (view.valid == truth.valid).mean() > 0.998  # silhouettes differ
    np.testing.assert_allclose(view.depth[both], truth.depth[both], rtol=3e-5)
    assert np.isposinf(view.depth[~view.valid]).all()


def test_the_far_plane_and_paint_are_background():
    near = frustum(far=2.9).capture(donut())
    assert 0 < near.valid.sum() < frustum().capture(donut()).valid.sum()
    assert near.depth[near.valid].max() < 2.9
    painted = frustum().painted(Stroke(((0.5, 0.0), (0.5, 1.0)), 0.1), Stroke(((0.5, 0.5),), 0.05, True))
    view = painted.capture(donut())
    np.testing.assert_array_equal(view.valid, frustum().capture(donut()).valid & ~painted.mask)


def test_a_stroke_covers_the_pixels_that_are_near_its_line():
    mask = Stroke(((0.25, 0.5), (0.75, 0.5)), 0.1).mask((40, 20))  # from (10, 10) to (30, 10), 2 pixels to either side
    y, x = np.mgrid[:20, :40] + 0.5
    away = np.hypot(np.clip(np.maximum(10 - x, x - 30), 0, None), y - 10)
    np.testing.assert_array_equal(mask, away <= 2)
    assert Stroke(((0.5, 0.5),), 1e-3).mask((3, 3)).sum() == 1
    assert not Stroke((), 0.5).mask((3, 3)).any()
    erased = frustum(20).painted(Stroke(((0.5, 0.5),), 0.3), Stroke(((0.5, 0.5),), 0.1, True), Stroke(((0, 0),), 0.1))
    assert erased.mask[[10, 10, 0], [10, 14, 0]].tolist() == [False, True, True]


def test_angles_and_sizes_can_be_changed():
    opened = frustum().opened(70, 30, 5.0)
    np.testing.assert_allclose(opened.fov, (70, 30))
    assert opened.far == 5.0
    assert opened.camera.world_from_camera.tolist() == frustum().camera.world_from_camera.tolist()
    resized = opened.resized(64)
    np.testing.assert_allclose(resized.fov, (70, 30))
    assert resized.camera.size == (64, 64)
    for across in (0, 180, np.nan):
        with pytest.raises(ibr.ArgumentError, match="fov"):
            frustum().opened(across, 30, 5.0)


def test_other_cameras_are_no_frusta():
    camera = frustum().camera
    skewed, aside = (camera.K + np.outer((1, 0, 0), off) for off in ((0, 1, 0), (0, 0, 2)))
    for bad in (
        ibr.Camera(camera.K, camera.size, projection="orthographic"),
        ibr.Camera(camera.K, camera.size, lens=ibr.Lens("brown_conrady", [-0.1, 0, 0, 0])),
        ibr.Camera(skewed, camera.size),
        ibr.Camera(aside, camera.size),
    ):
        with pytest.raises(ibr.ArgumentError, match="its axis in the middle"):
            Frustum(bad)
    with pytest.raises(ibr.ArgumentError, match="far"):
        frustum(far=-1.0)


def test_files_hold_frusta_and_their_images(tmp_path):
    frusta = [frustum(far=3.0).painted(Stroke(((0.5, 0.25), (0.1, 1.0)), 0.1), Stroke(((0, 0),), 0.2, True)), frustum()]
    save_frusta(tmp_path / "some.json", frusta, side="both")
    assert load_frusta(tmp_path / "some.json") == (frusta, {"side": "both"})
    views = [one.capture(donut(), light_for(donut(), (0, 0, 1))) for one in frusta]
    save_set(tmp_path / "set", frusta, views, side="front")
    assert load_frusta(tmp_path / "set") == (frusta, {"side": "front"})
    for found, expected in zip(ibr.load(tmp_path / "set"), views, strict=True):
        assert_same(found, expected)
    camera = frustum().camera.to_json()
    for bad in ([{"points": 3}], 3, [3], [{"points": [[0]], "radius": 1}]):
        (tmp_path / "bad.json").write_text(json.dumps({"views": [{"camera": camera, "strokes": bad}]}))
        with pytest.raises(ibr.FileFormatError, match=r"bad\.json: expected a"):
            load_frusta(tmp_path / "bad.json")


def test_plain_meshes_are_lit_and_others_show_their_colours():
    assert light_for(donut(), (0, 0, 1)) is not None
    colored = ibr.Mesh(donut().vertices, donut().faces, colors=np.full((len(donut().vertices), 3), 9, np.uint8))
    assert light_for(colored, (0, 0, 1)) is None
    view = frustum().capture(donut(), light_for(donut(), (0, 0, 1)))
    assert view.color[view.valid].std() > 5


# ---- surfaces


def hits(surface: Surface, rays: Any, points: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Distances, in lengths of `way`, at which rays from just above some points of a surface hit it."""
    off = 1e-4 * float(np.linalg.norm(np.ptp(surface.mesh.bounds, axis=0)))
    start = surface.points[points] + off * surface.normals[points]
    packed = np.concatenate([start, np.broadcast_to(way, start.shape)], axis=1).astype(np.float32)
    return rays.cast_rays(packed)["t_hit"].numpy()


def outside_by_rays(surface: Surface, count: int = 500) -> np.ndarray:
    """(N,) bool: points visible from outside, from which some ray reaches infinity without a hit."""
    rays, found = embree(surface.mesh), np.zeros(len(surface.points), bool)
    for way in np.random.default_rng(7).normal(size=(count, 3)):
        asked = np.flatnonzero(~found & (surface.normals @ way > 0.02 * np.linalg.norm(way)))
        found[asked[np.isinf(hits(surface, rays, asked, way))]] = True
    return found


def seen_by_rays(surface: Surface, frusta: list[Frustum]) -> np.ndarray:
    """(N,) bool: points in some frustum, in front of its far plane, whose rays to its eye hit nothing."""
    rays, found = embree(surface.mesh), np.zeros(len(surface.points), bool)
    for one in frusta:
        pixels, z = one.camera.project(surface.points)
        inside = (z > 0) & (z < one.far) & ((pixels >= -0.5) & (pixels <= np.array(one.camera.size) - 0.5)).all(axis=1)
        way = one.camera.center - surface.points
        asked = np.flatnonzero(inside & (np.sum(way * surface.normals, axis=1) > 0))
        found[asked[hits(surface, rays, asked, way[asked]) > 0.999]] = True
    return found


def test_points_are_spread_evenly_over_the_surface():
    surface = surface_of(donut(), count=20_000)
    radial = np.hypot(surface.points[:, 0], surface.points[:, 1])
    # On a torus with radii R and r, the fraction 1/2 + r / (pi R) of the area is farther than R from the axis.
    assert (radial > 1).mean() == pytest.approx(0.5 + 0.4 / np.pi, abs=0.01)
    assert surface.area == pytest.approx(4 * np.pi**2 * 0.4, rel=0.01)
    np.testing.assert_array_equal(surface_of(donut(), count=20_000).points, surface.points)


@pytest.mark.parametrize("wound", ["as it is", "inside out"])
def test_fronts_are_what_is_seen_from_outside_however_triangles_are_wound(wound):
    faces = donut().faces if wound == "as it is" else donut().faces[:, ::-1]
    surface = surface_of(ibr.Mesh(donut().vertices, faces), count=3000)
    middle = surface.points.copy()
    middle[:, 2] = 0
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    assert (np.sum((surface.points - middle) * surface.normals, axis=1) > 0).all()
    view = frustum().capture(surface.mesh)
    assert 0.2 < surface.seen(view).mean() < 0.5
    assert surface.seen(view, side="back").mean() < 0.05


@pytest.mark.parametrize("eye", [(0.5, 0.3, 3.0), (1.8, 0.0, 0.4), (0.0, 0.0, 0.0)])
def test_what_is_seen_is_what_rays_reach(eye):
    surface = surface_of(torus(), count=4000)
    one = Frustum.look_at(eye, (0.3, -0.9, 0.1), (0, 0, 1), 200, fov=80)
    truth = seen_by_rays(surface, [one])
    assert 0.02 < truth.mean() < 0.7
    agree = surface.seen(one.capture(torus())) == truth
    way = np.array(eye) - surface.points
    cosine = np.sum(way * surface.normals, axis=1) / np.linalg.norm(way, axis=1)
    assert agree[np.abs(cosine) > 0.3].mean() > 0.99  # surface not seen at a grazing angle
    assert agree.mean() > 0.96


def test_resolution_is_pixels_by_area():
    """A plate that faces the camera at depth z = 2 has f^2 / z^2 pixels per unit of area, everywhere in the image."""
    plate = plates(0.0)
    surface = surface_of(plate, count=1000)
    one = Frustum.look_at((0, 0, 2), (0, 0, 0), (0, 1, 0), 100, fov=90)
    dense = surface.resolution(one.capture(plate), side="both")
    np.testing.assert_allclose(dense[dense > 0], (50 / 2) ** 2, rtol=1e-4)
    assert (dense > 0).mean() > 0.99
    tilted = Frustum.look_at((0, 2 * np.sin(1.0), 2 * np.cos(1.0)), (0, 0, 0), (0, 0, 1), 100, fov=10)
    near_middle = np.linalg.norm(surface.points, axis=1) < 0.05
    dense = surface.resolution(tilted.capture(plate), side="both")[near_middle]
    focal = tilted.camera.K[0, 0]
    np.testing.assert_allclose(dense, (focal / 2) ** 2 * np.cos(1.0), rtol=0.1)


def test_the_unseen_share_is_of_what_can_be_seen_from_outside():
    """One ball is inside another, and only the outer ball can be seen from outside."""
    ball = models.donut(32, radius=1e-3, tube=0.5)
    corners = np.concatenate([ball.vertices, 0.6 * ball.vertices])
    surface = surface_of(ibr.Mesh(corners, np.concatenate([ball.faces, ball.faces + len(ball.vertices)])), count=4000)
    outer = np.linalg.norm(surface.points, axis=1) > 0.4
    assert (surface.outer == outer).mean() > 0.99
    assert unseen_share(surface, []) == 1.0
    assert unseen_share(surface, [outer]) < 0.01
    half = surface.points[:, 0] > 0
    assert unseen_share(surface, [half]) == pytest.approx(0.5, abs=0.03)


def plates(*heights: float) -> ibr.Mesh:
    """Squares of 2 x 2 units, one at each of the heights z."""
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    corners = np.concatenate([square + np.array([0, 0, z]) for z in heights])
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * number for number in range(len(heights))])
    return ibr.Mesh(corners, faces)


def test_a_part_has_its_own_points_area_and_bounds():
    box = [[-0.3, -2.0, -1.0], [0.2, 0.5, 1.0]]
    surface = surface_of(plates(0.0), count=4000, within=box)
    assert abs(len(surface.points) - 4000) < 480  # 3 sigma of the estimated fraction in the box
    assert ((surface.points >= box[0]) & (surface.points <= box[1])).all()
    assert surface.area == pytest.approx(0.5 * 1.5, rel=0.05)  # by 4000 points, 0.19 is known to 0.006
    np.testing.assert_array_equal(surface.bounds, [[-0.3, -1.0, 0.0], [0.2, 0.5, 0.0]])
    np.testing.assert_allclose(surface.points.mean(axis=0), (-0.05, -0.25, 0), atol=0.03)
    small = surface_of(plates(0.0), count=4000, within=[[0.5, 0.5, -1], [0.51, 0.51, 1]])
    assert 0 < len(small.points) < 100  # 1 / 40000 of at most 64 * 4000 points
    np.testing.assert_array_equal(surface_of(plates(0.0), count=4000, within=box).points, surface.points)


def test_of_a_part_that_counts_which_the_rest_does_not_hide():
    box = [[-9, -9, -0.01], [9, 9, 0.01]]
    assert surface_of(plates(0.0, 2.0), count=3000, within=box).outer.all()
    between = surface_of(plates(-0.02, 0.0, 0.02), count=3000, within=box)
    inner = (np.abs(between.points[:, :2]) < 0.6).all(axis=1)  # at borders, rays escape
    assert between.outer.mean() > 0.1 and not between.outer[inner].any()
    far = surface_of(plates(0.0, 300.0), count=3000, within=box)  # two plates far apart
    assert far.outer.all()


def test_a_box_is_checked():
    for bad, said in (
        ([[0, 0, 0], [1, 1, 0]], "within: expected a box, its low corner"),
        ([[0, 0, 0]], "within: expected finite numbers of shape"),
        ([[5, 5, 5], [6, 6, 6]], "within: expected a box that holds some"),
        ([[0.95, -0.95, -1], [1.0, -0.949, -0.5]], "within: expected a box that holds some"),
    ):
        with pytest.raises(ibr.ArgumentError, match=said):
            surface_of(plates(0.0), count=500, within=bad)


# ---- proposals


def test_frusta_are_proposed_that_see_more_and_more():
    shares: list[float] = []
    surface = surface_of(donut(), count=4000)
    made = propose_frusta(donut(), 5, 64, surface=surface, progress=lambda *now: shares.append(now[2]))
    assert len(made) == len(shares) == 5
    assert shares == sorted(shares, reverse=True)
    assert shares[-1] < 0.03
    assert propose_frusta(donut(), 5, 64, surface=surface) == made
    assert all(one.camera.size == (64, 64) and one.far < 10 for one in made)


@pytest.mark.thorough
def test_what_is_covered_already_needs_no_more():
    known = propose_frusta(donut(), 5, 64)
    surface = surface_of(donut())
    before = unseen_share(surface, [surface.seen(one.capture(donut())) for one in known])
    more = propose_frusta(donut(), 1, 64, known=known, surface=surface)
    after = unseen_share(surface, [surface.seen(one.capture(donut())) for one in [*known, *more]])
    assert after < before
    fresh = propose_frusta(donut(), 1, 64, surface=surface)
    assert more[0] != fresh[0]


@pytest.mark.thorough
def test_six_cover_the_inner_wall_of_the_torus():
    made = propose_frusta(torus(), 6, 256)
    surface = surface_of(torus(), count=10_000)
    axis = np.ones(3) / np.sqrt(3)
    away = surface.points - np.outer(surface.points @ axis, axis)
    inner = np.sum(surface.normals * away, axis=1) < -0.5 * np.linalg.norm(away, axis=1)
    assert inner.mean() > 0.1
    seen = seen_by_rays(surface, made)
    assert seen[inner].mean() > 0.99
    assert seen.mean() > 0.96


def test_a_part_is_covered_and_no_more():
    box = np.array([[0.2, -2.0, -2.0], [2.0, 2.0, 2.0]])
    surface = surface_of(donut(), count=4000, within=box)
    made = propose_frusta(donut(), 4, 64, surface=surface)
    assert seen_by_rays(surface, made).mean() > 0.97
    whole = surface_of(donut(), count=4000)
    away = whole.points[:, 0] < -0.3
    assert seen_by_rays(whole, made)[away].mean() < 0.5


@pytest.mark.thorough
def test_sixteen_leave_little_of_the_dragon_unseen():
    mesh = ibr.Mesh.load(shared("meshes/dragon_vrip_res3.ply.gz"))
    made = propose_frusta(mesh, 16)
    surface = surface_of(mesh, count=12_000)
    outside = outside_by_rays(surface)
    assert outside.mean() > 0.9
    assert (outside & ~seen_by_rays(surface, made)).sum() <= 0.04 * outside.sum()
    views = [one.capture(mesh) for one in made]
    told = unseen_share(surface, [surface.seen(view) for view in views])
    assert told <= 0.05


def test_arguments_are_checked():
    for bad, word in (((donut(), 0), "count"), ((donut(), 3, 1), "size"), (([1], 3), "mesh")):
        with pytest.raises(ibr.ArgumentError, match=word):
            propose_frusta(*bad)
