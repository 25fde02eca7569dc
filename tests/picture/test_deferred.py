"""Deferred lighting of things made of images: the order of things and the picture's frame change no colour."""

from __future__ import annotations

from functools import cache
from itertools import permutations
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import MeshScene, capture, models, object_views
from tests.boxes import cuboid
from tests.embree import points_of
from tests.one_lane import both_forms

CAMERA = ibr.Camera.look_at((1.5, -2.2, 2), (0, 0, 0), (0, 0, 1), (203, 151), fov_y=40)
LIGHTS: dict[str, dict[str, Any]] = {
    "shadows": {"direction": (1, 0.6, -1.2), "shadow_size": 128},
    "relit": {"position": (-2, -3, 2.0), "specular": 0.4, "shadow_size": 0, "relight": True},
    "relit in shadow": {"direction": (1, 0.6, -1.2), "shadow_size": 128, "relight": True},
}


def torus(turn: int, size: float = 0.7) -> ibr.Mesh:
    """A coloured torus around one of the axes."""
    made = models.donut(64)
    points = size * np.roll(made.vertices, turn, axis=1)
    colors = np.rint(150 + 60 * np.sin(18 * points)).astype(np.uint8)
    return ibr.Mesh(points, made.faces, colors=colors)


@cache
def crossing() -> tuple[list[Any], ibr.Frame, list[np.ndarray], np.ndarray]:
    """Four kinds of things made of images, which intersect each other, and a mesh; their picture without a light, the
    depths of each alone, and True where the nearest one is told from the others."""
    eye = ibr.Camera.look_at((0.5, -2.6, 2.2), (0, 0, 0), (0, 0, 1), (120, 90), fov_y=40)
    things = [
        ibr.DepthObject(object_views(torus(0), 64), slices=48),
        ibr.DepthMeshObject(object_views(torus(1, 0.65), 64)),
        ibr.VisualHull(object_views(torus(2, 0.6), 64), slices=48),
        capture(torus(1, 0.8), eye),
        torus(2, 0.75),
    ]
    alone = [ibr.render(thing, CAMERA).depth for thing in things]
    return things, ibr.render(things, CAMERA), alone, ~ties(alone)


def ties(alone: list[np.ndarray]) -> np.ndarray:
    """(H, W) True within some pixels of places where the two nearest things have equal depth."""
    depths = np.sort(np.nan_to_num(alone, nan=np.inf), axis=0)
    tied = np.pad((depths[0] == depths[1]) & np.isfinite(depths[0]), 4)
    height, width = depths[0].shape
    return np.any([tied[y : y + height, x : x + width] for y, x in np.ndindex(9, 9)], axis=0)


@pytest.mark.parametrize("light", LIGHTS)
def test_colours_do_not_depend_on_the_order(light):
    (things, plain, alone, told), lamp = crossing(), ibr.Light(**LIGHTS[light])
    first = ibr.render(things, CAMERA, lamp)
    assert min((first.depth == depth).sum() for depth in alone) > 200  # each thing is seen
    assert (first.color != plain.color).any(axis=2)[plain.valid].mean() > 0.2
    assert told[first.valid].mean() > 0.95
    for number, order in enumerate([*permutations(things[:-1])][::5]):
        place = number % len(things)  # position of the mesh
        frame = ibr.render([*order[:place], things[-1], *order[place:]], CAMERA, lamp)
        np.testing.assert_array_equal(frame.depth, first.depth)
        np.testing.assert_array_equal(frame.color[told], first.color[told])


MAKERS: dict[str, Any] = {
    "depth object": lambda views: ibr.DepthObject(views, slices=64),
    "depth meshes": ibr.DepthMeshObject,
    "depth mesh": lambda views: ibr.DepthMesh(views[2]),
    "depth image": lambda views: views[2],
    "depth images": lambda views: ibr.WarpedView(views[:5]),
    "splats": lambda views: ibr.WarpedView(views, method="forward", splat=2),
    "thin": lambda views: ibr.WarpedView(views, blend="nearest", thin=True),
    "hull": lambda views: ibr.VisualHull(views, slices=64),
}


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.thorough if n == "thin" else ()) for n in MAKERS])
def test_a_part_of_the_picture_has_the_same_colours(name):
    """Shading uses the things' own normals. Shadow maps use slopes of the picture's depths, which are one-sided at its
    border."""
    left, top, width, height = 61, 43, 83, 59
    K = CAMERA.K - np.array([[0, 0, left], [0, 0, top], [0, 0, 0]])
    part = ibr.Camera(K, (width, height), CAMERA.world_from_camera)
    thing = MAKERS[name](object_views(torus(0), 96, normals=True))
    floor = ibr.Mesh([[-2, -2, -0.6], [2, -2, -0.6], [2, 2, -0.6], [-2, 2, -0.6]], [[0, 1, 2], [0, 2, 3]])
    for light in ("relit", "relit in shadow"):
        lamp = ibr.Light(**LIGHTS[light])
        whole, cut = (ibr.render([thing, floor], camera, lamp) for camera in (CAMERA, part))
        inside = np.s_[top : top + height, left : left + width]
        same = np.abs(whole.depth[inside] - cut.depth) <= 1e-5 * cut.depth
        own = ibr.render(thing, part).depth == cut.depth
        if light == "relit in shadow":
            border = np.ones(own.shape, bool)
            border[4:-4, 4:-4] = False
            own &= ~border
        assert own.sum() > 150
        assert same[own].mean() > 0.98
        off = np.abs(whole.color[inside].astype(int) - cut.color).max(axis=2)[own & same]
        assert (off <= 1).mean() > 0.999


def test_what_is_drawn_in_front_later_is_lit_on_its_own():
    """A mesh in front of a depth image is shaded once, by its own normals, in either order."""
    camera = ibr.Camera([[60, 0, 40], [0, 60, 30], [0, 0, 1]], (81, 61))
    wall = ibr.DepthImage(np.full((61, 81, 3), 200, np.uint8), np.full((61, 81), 4, np.float32), camera)
    card = ibr.Mesh([[-1, -1, 3], [1, -1, 3], [1, 1, 3.5], [-1, 1, 3.5]], [[0, 2, 1], [0, 3, 2]])
    for relight in (False, True):
        light = ibr.Light(direction=(0.4, 0.2, 1), shadow_size=256, relight=relight)
        alone = ibr.render(card, camera, light)
        for things in ([card, wall], [wall, card]):
            frame = ibr.render(things, camera, light)
            np.testing.assert_array_equal(frame.color[alone.valid], alone.color[alone.valid])


@pytest.mark.thorough
def test_one_lane_lights_many_things_alike():
    """Some packets of 16 pixels show several things."""
    camera = ibr.Camera([[30, 0, 18], [0, 30, 12], [0, 0, 1]], (37, 25))
    depth = np.full((25, 37), 3, np.float32)
    views = []
    for number in range(9):
        mine = (np.arange(37) % 9 == number) * np.ones((25, 1), bool)
        color = np.full((25, 37, 3), 40 + 20 * number, np.uint8)
        views.append(ibr.DepthImage(color, np.where(mine, depth, np.inf), camera))
    light = ibr.Light(direction=(0.3, 0.2, 1), shadow_size=64, relight=True)

    def drawn() -> ibr.Frame:
        fresh = [ibr.DepthImage(view.color, view.depth, camera) for view in views]
        return ibr.render([ibr.WarpedView(view, thin=True) for view in fresh], camera, light)

    wide, one = both_forms(drawn)
    assert wide.valid.all()
    np.testing.assert_array_equal(one.depth, wide.depth)
    assert np.abs(one.color.astype(int) - wide.color).max() <= 1


@pytest.mark.parametrize("how", [{}, {"blend": "nearest"}, {"method": "search"}, {"method": "forward"}], ids=str)
@pytest.mark.parametrize("relight", [False, True])
def test_each_way_of_the_warp_is_lit(how, relight):
    """Two views of a slanted wall are lit by Lambert's law; a card casts a shadow on it."""
    normal = np.array([0.28, 0, -0.96])
    camera = ibr.Camera([[60, 0, 40], [0, 60, 30], [0, 0, 1]], (81, 61))
    views = []
    for step in (-0.2, 0.1):
        seen_by = camera.moved(step, 0, 0)
        y, x = np.mgrid[:61, :81]
        ray = np.stack([(x - 40) / 60, (y - 30) / 60, np.ones((61, 81))], axis=-1)
        depth = (-3.2 - seen_by.center @ normal) / (ray @ normal)
        views.append(ibr.DepthImage(np.full((61, 81, 3), 200, np.uint8), depth.astype(np.float32), seen_by))
    card = ibr.Mesh([[-1.2, -0.6, 2], [-0.4, -0.6, 2], [-0.4, 0.6, 2], [-1.2, 0.6, 2]], [[0, 2, 1], [0, 3, 2]])
    way = np.array([0.3, 0.1, 1.0])
    light = ibr.Light(direction=way, relight=relight, ambient=0.25, shadow_size=256)
    frames = [
        ibr.render(things, camera, light)
        for thing in [ibr.WarpedView(views, **how)]
        for things in ([thing, card], [card, thing])
    ]
    np.testing.assert_array_equal(frames[0].color, frames[1].color)
    np.testing.assert_array_equal(frames[0].depth, frames[1].depth)
    points = points_of(frames[0])
    on_wall = np.abs(points @ normal + 3.2) < 5e-2
    at_card = points - (points[:, 2:] - 2) * way
    beside = np.maximum(np.abs(at_card[:, 0] + 0.8) - 0.4, np.abs(at_card[:, 1]) - 0.6)
    lit, dark = on_wall & (beside > 0.1), on_wall & (beside < -0.1)
    found = frames[0].color[frames[0].valid][:, 0]
    lambert = -normal @ way / np.linalg.norm(way) if relight else 1.0
    assert lit.sum() > 2000
    assert dark.sum() > 40
    assert (np.abs(found[lit] - 200 * (0.25 + 0.75 * lambert)) <= 1).mean() > 0.99
    assert (np.abs(found[dark] - 50.0) <= 1).mean() > 0.99


def test_normals_of_depths_are_those_of_the_thing_alone():
    """A visual hull has no normals, so they come from its depths, even where a mesh cuts it at equal depth."""
    box = cuboid((-0.6, -0.5, -0.4), (0.6, 0.5, 0.4))
    views = object_views(MeshScene(*box, colors=np.full((8, 3), 200, np.uint8)), 96)
    outlines = [ibr.Silhouette(np.where(v.valid[..., None], v.color, np.uint8(200)), v.valid, v.camera) for v in views]
    hull = ibr.VisualHull(outlines, slices=256)
    sheet = ibr.Mesh([[-2, -2, -0.9], [2, -2, 0.7], [2, 2, 0.9], [-2, 2, -0.7]], [[0, 1, 2], [0, 2, 3]])
    light = ibr.Light(**LIGHTS["relit"])
    alone, cut = ibr.render(hull, CAMERA, light), ibr.render([hull, sheet], CAMERA, light)
    mine = cut.valid & (cut.depth == alone.depth)
    hidden = alone.valid & ~mine
    at_cut = mine & np.any([np.roll(hidden, step, axis) for step in (-4, 4) for axis in (0, 1)], axis=0)
    assert at_cut.sum() > 100
    off = np.abs(cut.color[at_cut].astype(int) - alone.color[at_cut]).max(axis=1)
    assert (off <= 12).mean() > 0.98, (off <= 12).mean()
