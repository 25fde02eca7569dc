"""Shadows, compared with rays that are cast from true points of the surface to the light."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import capture, object_views
from pyibr.core.camera import Camera
from pyibr.picture.drawable import as_drawable
from pyibr.picture.shadow import light_cameras
from tests.displaced import Solid, square
from tests.embree import embree, points_of
from tests.exact import same_bits
from tests.one_lane import both_forms
from tests.reference.heights import bilinear_height
from tests.relief.solids import Carved, grid, torus
from tests.shadowed import AMBIENT, CAMERAS, LIGHTS, SCENES, agreement, ball, box, hilly, joined, light_of, plane
from tests.truth import triangulate


@pytest.mark.parametrize("projection", CAMERAS)
@pytest.mark.parametrize("kind", LIGHTS)
@pytest.mark.parametrize("name", SCENES)
def test_shadows_are_those_of_rays(name, kind, projection):
    things = SCENES[name]
    share = agreement(things, embree(*things), CAMERAS[projection], light_of(kind, shadow_size=512))
    assert share >= 0.999


SHAPES = [
    {"direction": (1, 0.4, -0.5)},
    {"position": (-0.6, 0.2, 0.8), "direction": (1.0, 0.3, -0.7), "angle": 70},
    {"position": (0.4, 1.2, 0.6)},
]


@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_sliced_surfaces_shadow_themselves_and_others(shape, slicing):
    height, color, floor = hilly(), np.full((1, 1, 3), 255, np.uint8), plane(3.0, -0.01)
    stone = box((0.5, 0.5, 0.42), (0.12, 0.07, 0.05))
    scene = Solid(height, 0.25, 4).scene
    for mesh in (stone, floor):
        scene.add_triangles(np.array(mesh.vertices), mesh.faces.astype(np.uint32))
    camera = Camera.look_at((0.9, -1.2, 1.3), (0.5, 0.5, 0.05), (0, 0, 1), (240, 180), fov_y=42)
    surface = ibr.SlicedSurface(square(), height, color, 0.25, slices=256, slicing=slicing)
    share = agreement([surface, stone, floor], scene, camera, ibr.Light(**shape, ambient=AMBIENT, shadow_size=512))
    assert share >= 0.99


@pytest.mark.parametrize("shadow", ["map", "search"])
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_reliefs_shadow_themselves_and_others(shape, shadow):
    """The true solid is moved down by the relief's scale, because a relief lies below its square."""
    height, color, floor = hilly(), np.full((1, 1, 3), 255, np.uint8), plane(3.0, -0.26)
    wide = ibr.Mesh(3 * square().vertices - (1, 1, 0), square().faces, uv=3 * square().uv)  # rays leave the square
    stone = box((0.5, 0.5, 0.17), (0.12, 0.07, 0.05))
    scene = embree(stone, floor)
    u, v = np.meshgrid(np.arange(385) / 128 - 1, np.arange(385) / 128 - 1)
    y, x = np.mgrid[:384, :384]
    at = (385 * y + x).ravel()
    faces = np.concatenate([np.stack([at, at + 1, at + 386], 1), np.stack([at, at + 386, at + 385], 1)])
    points = np.stack([u, v, 0.25 * (bilinear_height(height.astype(float), u, v) - 1)], axis=-1).reshape(-1, 3)
    scene.add_triangles(points.astype(np.float32), faces.astype(np.uint32))
    camera = Camera.look_at((0.9, -1.0, 1.05), (0.5, 0.5, -0.2), (0, 0, 1), (240, 180), fov_y=42)
    surface = ibr.ReliefSurface(wide, height, color, 0.25, shadow=shadow)
    share = agreement([surface, stone], scene, camera, ibr.Light(**shape, ambient=AMBIENT, shadow_size=512))
    assert share >= 0.99


@cache
def hilly_torus() -> Any:
    """The torus with hills and the floor below it, for ray casting."""
    floor = plane(3.0, -0.45)
    scene = Carved(torus, hilly(), 0.06, (10, 4)).scene
    scene.add_triangles(np.array(floor.vertices), floor.faces.astype(np.uint32))
    return scene


@pytest.mark.thorough
@pytest.mark.parametrize("shadow", ["map", "search"])
@pytest.mark.parametrize("distance", ["approximate", "exact"])
@pytest.mark.parametrize("shape", [{"direction": (0.6, 0.5, -0.9)}, LIGHTS["spot"], LIGHTS["point"]], ids=str)
def test_curved_reliefs_shadow_themselves_and_others(shape, distance, shadow):
    """The outline of the torus's shadow must show its hills."""
    height, color, floor = hilly(), np.full((1, 1, 3), 255, np.uint8), plane(3.0, -0.45)
    relief = ibr.ReliefSurface(
        grid(torus, 96, 48), height, color, 0.06, tiles=(10, 4), distance=distance, shadow=shadow
    )
    camera = Camera.look_at((1.9, -3.4, 2.6), (0, 0, -0.1), (0, 0, 1), (240, 180), fov_y=45)
    share = agreement([floor, relief], hilly_torus(), camera, ibr.Light(**shape, ambient=AMBIENT, shadow_size=512))
    assert share >= 0.97


FEW = [{"direction": (0.8, 0.9, -1.3)}, LIGHTS["spot"], {"position": (2, -2, 2.5)}]


@pytest.mark.parametrize("shape", FEW, ids=str)
@pytest.mark.parametrize("edges", ["cut", "connect"])
def test_a_warped_depth_image_casts_and_receives(shape, edges):
    """The surface that the warp draws casts the shadows, whether its edges are cut or connected."""
    source = Camera.look_at((0.2, -3.4, 3.2), (0, 0, 0.2), (0, 0, 1), (240, 180), fov_y=50)
    view = capture(joined(SCENES["balls"]), source)
    view = ibr.DepthImage(np.full((180, 240, 3), 255, np.uint8), view.depth, source)
    beam, shelf = box((0.2, -0.9, 0.9), (0.6, 0.05, 0.05)), plane(5.0, -0.4)
    scene = embree(beam, shelf)
    y, x = np.mgrid[:180, :240].reshape(2, -1)
    z = np.nan_to_num(view.depth.ravel().astype(float), nan=1.0, posinf=1.0)
    scene.add_triangles(
        source.unproject(np.stack([x, y], axis=-1), z).astype(np.float32),
        triangulate(view, edges, 1.05).astype(np.uint32),
    )
    camera = source.moved(0.3, -0.1, 0.2).resized((240, 180))
    light = ibr.Light(**shape, ambient=AMBIENT, shadow_size=512)
    for sample in ("linear", "nearest"):
        things = [ibr.WarpedView(view, edges=edges, interpolation=sample), beam, shelf]
        assert agreement(things, scene, camera, light) >= 0.97, sample


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_light_passes_where_edges_are_cut(dtype):
    """A card at depth 2, x from -0.5 to 0.5, stands before a wall at depth 4; light comes from the left at 45 degrees.

    The card's shadow covers x = 1.5 to 2.5 of the wall. If edges are connected, sheets around the card shadow the wall
    from x = -1 to 1.5, too; the source sees only the part beyond x = 1.
    """
    camera = Camera([[60, 0, 60], [0, 60, 40], [0, 0, 1]], (121, 81))
    y, x = np.mgrid[:81, :121]
    depth = np.where((abs(x - 60) <= 15) & (abs(y - 40) <= 15), np.float32(2), np.float32(4))
    view = ibr.DepthImage(np.full((81, 121, 3), 200 if dtype == np.uint8 else 0.5, dtype), depth, camera)
    frame, cut, connected = (
        ibr.render(thing, camera, ibr.Light(direction=(1, 0, 1))).color[40, :, 0] / view.color[0, 0, 0]
        for thing in (view, ibr.WarpedView(view, edges="cut"), ibr.WarpedView(view, edges="connect"))
    )
    np.testing.assert_array_equal(frame, cut)
    np.testing.assert_allclose(cut[77:82], 1)
    np.testing.assert_allclose(connected[77:82], 0.25, atol=0.01)
    for row in (cut, connected):
        np.testing.assert_allclose(row[84:96], 0.25, atol=0.01)
        np.testing.assert_allclose(row[100:119], 1)
        np.testing.assert_allclose(row[47:73], 1)  # the card


@pytest.mark.parametrize("make", [ibr.DepthObject, ibr.VisualHull])
@pytest.mark.parametrize("shape", FEW, ids=str)
def test_objects_from_images_cast_and_receive(shape, make):
    """A ball from depth images, or a box as a hull of six silhouettes.

    The shadow test moves points off the object by a slice, so that points slightly beyond the light's horizon are lit:
    3 % of the ball's pixels.
    """
    solid = ball((0.2, 0.1, 0.75), 0.6) if make is ibr.DepthObject else box((0.2, 0.1, 0.6), (0.6, 0.4, 0.5))
    bar, floor = box((-0.3, -0.6, 1.4), (0.1, 0.7, 0.05)), plane()
    things = [make(object_views(joined([solid]), 128), slices=128), bar, floor]
    share = agreement(
        things, embree(solid, bar, floor), CAMERAS["perspective"], ibr.Light(**shape, ambient=AMBIENT, shadow_size=512)
    )
    assert share >= 0.97


@cache
def every_thing() -> list[Any]:
    """A thing of each kind; they cast shadows on each other."""
    source = Camera.look_at((0, -3, 3), (0, 0, 0), (0, 0, 1), (60, 45), fov_y=40)
    view = capture(joined([plane(1.5, -0.2), ball((0.5, 0.6, 0.1), 0.3)]), source)
    views = object_views(joined([ball((0, 0, 0), 0.3)]), 24)
    shifted = ibr.Mesh(np.add(square().vertices, (-1.2, -0.5, 0)), square().faces, uv=square().uv)
    surface = ibr.SlicedSurface(shifted, hilly()[::8, ::8], np.full((1, 1, 3), 255, np.uint8), 0.25, slices=32)
    return [
        view,
        surface,
        ibr.DepthObject(views, slices=24),
        ibr.VisualHull(views, slices=24),
        ibr.ReliefSurface(
            ibr.Mesh(np.add(square().vertices, (-0.4, 0.4, 0.15)), square().faces, uv=square().uv),
            hilly()[::8, ::8],
            np.full((1, 1, 3), 255, np.uint8),
            0.1,
        ),
        box((0.5, -0.5, 0.8), (0.3, 0.3, 0.05)),
    ]


SEES_ALL = Camera.look_at((1.0, -3.4, 2.4), (0, 0, 0.1), (0, 0, 1), (203, 149), fov_y=40)


@pytest.mark.parametrize("kind", LIGHTS)
def test_again_the_same_bits_and_in_any_order(kind):
    things, light = every_thing(), light_of(kind, shadow_size=200)
    frame, again = (ibr.render(things, SEES_ALL, light) for _ in range(2))
    same_bits(frame, again)
    turned = ibr.render(things[::-1], SEES_ALL, light)
    tied = np.abs(frame.depth - turned.depth) > 0  # the ball is drawn twice: as object and as hull
    assert (np.abs(frame.color.astype(int) - turned.color).max(axis=2) > 1)[~tied].mean() <= 2e-3


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["directional", "spot", "point among them"])
def test_in_one_lane(kind):
    light = light_of(kind, shadow_size=200, specular=0.3)
    wide, one = both_forms(lambda: ibr.render(every_thing.__wrapped__(), SEES_ALL, light))
    # As in the tests without shadows, rounding may change hits of slices and outlines.
    assert (one.valid != wide.valid).mean() <= 2e-3
    assert (np.abs(one.color.astype(int) - wide.color).max(axis=2) <= 2).mean() >= 0.985


def test_without_shadows_nothing_is_shadowed():
    """Without shadow maps, a light leaves images and objects unchanged, and lights each mesh as if it were alone."""
    for shape in LIGHTS.values():
        light = ibr.Light(**shape, shadow_size=0)
        view, surface, solid, hull, _, slab = every_thing()
        for thing in (view, solid, hull):
            np.testing.assert_array_equal(ibr.render(thing, SEES_ALL, light).color, ibr.render(thing, SEES_ALL).color)
        both, alone = ibr.render([surface, slab], SEES_ALL, light), ibr.render(slab, SEES_ALL, light)
        mine = alone.valid & (alone.depth == both.depth)
        assert mine.sum() > 500
        np.testing.assert_array_equal(both.color[mine], alone.color[mine])


def test_a_light_from_behind():
    """A wall that faces away from the light is dark, as a mesh and as a depth image, and so are things before it."""
    camera = Camera([[60, 0, 40], [0, 60, 30], [0, 0, 1]], (81, 61))
    color, depth = np.full((61, 81, 3), 200, np.uint8), np.full((61, 81), 4, np.float32)
    card = ibr.Mesh([[-0.5, -0.5, 3], [0.5, -0.5, 3], [0.5, 0.5, 3], [-0.5, 0.5, 3]], [[0, 2, 1], [0, 3, 2]])
    for shape in ({"direction": (0.1, 0, -1)}, {"position": (0, 0.2, 9)}):
        frame = ibr.render([ibr.DepthImage(color, depth, camera), card], camera, ibr.Light(**shape))
        assert frame.valid.all()
        assert set(np.unique(frame.color[5, :, 0])) == {50}
        assert set(np.unique(frame.color[26:34, 34:46, 0])) == {51}  # a quarter of 204


@pytest.mark.parametrize("shape", LIGHTS.values(), ids=LIGHTS)
def test_maps_hold_all_that_is_lit(shape):
    """Each point of the things' boxes that the light reaches lies in one of its maps, with a margin for the filter."""
    light = ibr.Light(**shape, shadow_size=128)
    bounds = [thing.bounds for thing in SCENES["balls"]]
    cameras = light_cameras(light, bounds)
    assert {camera.size for camera in cameras} == {(128, 128)}
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.uniform(low, high, (2000, 3)) for low, high in bounds])
    if light.position is not None and light.direction is not None:
        off_axis = points - light.position
        cosine = off_axis @ light.direction / np.linalg.norm(off_axis, axis=1) / np.linalg.norm(light.direction)
        points = points[cosine > np.cos(np.radians(light.angle / 2))]
    held = np.zeros(len(points), bool)
    for camera in cameras:
        pixels, depth = camera.project(points)
        held |= (depth > 0) & (pixels > 3.4).all(axis=1) & (pixels < 123.6).all(axis=1)
    assert len(points) > 1000
    assert held.all()


def test_bounds_of_things():
    """Pixels lie within the bounds, which are not much too large. Reliefs, which continue outside, are left out."""
    for thing in every_thing():
        if isinstance(thing, ibr.ReliefSurface):
            continue
        low, high = as_drawable(thing).bounds
        points = points_of(ibr.render(thing, SEES_ALL))
        slack = 1e-4 * np.linalg.norm(np.subtract(high, low))  # rounding of float32
        assert (points >= low - slack).all()
        assert (points <= high + slack).all()
        assert (np.ptp(points, axis=0) >= 0.4 * np.subtract(high, low)).any()  # the box is not much larger


def test_a_thing_alone_and_one_of_no_extent():
    """Things without area, a dot and a line, are no error in any light."""
    dot = ibr.Mesh([[0, 0, 0], [0, 0, 0], [0, 0, 0]], [[0, 1, 2]])
    line = ibr.Mesh([[0, 0, 0], [0, 0, 1], [0, 0, 0.5]], [[0, 1, 2]])
    for shape in (*LIGHTS.values(), {"position": (0, 0, 0)}, {"position": (0, 0, 0), "direction": (0, 0, 1)}):
        for things in ([dot], [line], [dot, plane()]):
            assert ibr.render(things, SEES_ALL, ibr.Light(**shape)).valid.any() == (len(things) == 2)


@pytest.mark.parametrize(
    ("light", "count"),
    [
        ({"direction": (0.6, 0.5, -0.9)}, 1),
        ({"direction": (0, 0, -1)}, 1),
        ({"position": (-8.0, 1.0, 6.0)}, 1),
        ({"position": (-3.0, 1.0, 1.5)}, 6),  # too close for one map
        ({"position": (0.0, 0.0, 0.5)}, 6),
        ({"position": (0.0, 0.0, 0.5), "direction": (1, 0, 0)}, 1),
        ({"position": (0.0, 0.0, 0.5), "direction": (1, 0, 0), "angle": 150}, 6),  # too wide for one map
    ],
)
def test_the_lights_cameras_see_all_of_the_scene(light, count):
    low, high = np.array([-3.0, -3, -0.5]), np.array([3.0, 3, 1])
    cameras = light_cameras(ibr.Light(**light, shadow_size=64), [(low, high)])
    assert len(cameras) == count
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    seen = np.zeros(8, bool)
    for camera in cameras:
        pixel, depth = camera.project(corners)
        seen |= (depth > 0) & (pixel >= -0.5).all(axis=1) & (pixel <= 63.5).all(axis=1)
    assert seen.all() or ("direction" in light and "position" in light)
