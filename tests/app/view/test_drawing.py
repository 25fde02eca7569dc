"""The page's styles draw the pictures of the library's calls; overlays and comparisons are right."""

from __future__ import annotations

import inspect
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import pyibr as ibr
from pyibr.app.view.methods import Style, methods_of
from pyibr.app.view.overlays import CLASS_COLORS, class_colors, difference, legend, view_color, view_colors
from pyibr.app.view.painting import kernel_seconds, paint
from pyibr.app.view.parameters import parameters_of, with_parameters
from pyibr.app.view.scene import scene_of
from pyibr.capture import models, object_views
from pyibr.depthmesh import Segmentation
from pyibr.warp.view import OPTIONS

CAMERA = ibr.Camera.look_at((1.5, -1.2, 3), (0, 0, 0), (0, -1, 0), (83, 61), fov_y=43)


@cache
def views() -> list[ibr.DepthImage]:
    return object_views(models.donut(24), 64, projection="perspective")


@cache
def relief() -> ibr.ReliefSurface:
    height = np.random.default_rng(0).integers(0, 256, (16, 8), np.uint8)
    return ibr.ReliefSurface(models.donut(12), height, np.full((4, 8, 3), 200, np.uint8), 0.1)


# ---- methods


def test_each_way_is_the_call_that_its_name_says():
    methods = methods_of(views())
    how = {"cut_ratio": 1.1, "fill": "smooth", "blend": "nearest"}
    style = Style("warp", parameters=tuple(how.items()))
    for name, method in (("warp", "epipolar"), ("search", "search"), ("forward", "forward")):
        expected = ibr.warp(views(), CAMERA, method=method, **how)
        np.testing.assert_array_equal(methods[name].draw(CAMERA, style).color, expected.color)
    things = [ibr.WarpedView(view, cut_ratio=1.1, fill="smooth") for view in views()]
    np.testing.assert_array_equal(methods["render"].draw(CAMERA, style).color, ibr.render(things, CAMERA).color)
    smooth = methods["render"].draw(CAMERA, replace(style, samples=4, anisotropy=2))
    np.testing.assert_array_equal(smooth.color, ibr.render(things, CAMERA, samples=4, anisotropy=2).color)
    solids = {"depth mesh": ibr.DepthMeshObject, "depth object": ibr.DepthObject, "visual hull": ibr.VisualHull}
    for name, made in solids.items():
        plain = Style(name)
        np.testing.assert_array_equal(methods[name].draw(CAMERA, plain).color, ibr.render(made(views()), CAMERA).color)


def test_a_word_of_another_ways_choices_is_left_aside():
    frame = methods_of(views())["warp"].draw(CAMERA, Style("warp", parameters=(("blend", "position"),)))
    np.testing.assert_array_equal(frame.color, ibr.warp(views(), CAMERA).color)


@pytest.mark.thorough
def test_a_light_shines_in_every_way():
    light = ibr.Light(direction=(0, 1, 1), relight=True)
    for name, method in methods_of(views()).items():
        lit, plain = method.draw(CAMERA, Style(name, light=light)), method.draw(CAMERA, Style(name))
        assert (lit.color != plain.color).any(), name


@pytest.mark.parametrize("name", ["warp", "render", "search"])
def test_every_option_of_the_warp_is_a_control(name):
    """From close by, a wire one sample wide is as wide as its samples with `thin`, by the control as by the call."""
    depth = np.full((48, 64), 4.0, np.float32)
    depth[20, 10:50] = 2.0
    wire = ibr.DepthImage(
        np.zeros((48, 64, 3), np.uint8), depth, ibr.Camera([[100, 0, 31.5], [0, 100, 23.5], [0, 0, 1]], (64, 48))
    )
    closer = ibr.Camera([[400, 0, 127.5], [0, 400, 95.5], [0, 0, 1]], (256, 192))
    method = methods_of(wire)[name]
    assert set(method.parameters) | set(method.fixed) == {option.name for option in OPTIONS}
    assert method.parameters["fill"].choices == (None, "background", "smooth", "inpaint", "exemplar")
    found = method.draw(closer, Style(name, parameters=(("thin", True),)))
    assert (found.depth < 3).sum() == (ibr.warp(wire, closer, thin=True).depth < 3).sum() == 40 * 4 * 4


def test_whatever_draws_itself_is_drawn_also_of_a_class_of_ones_own():
    class Own:
        bounds = models.donut(12).bounds

        def draw(self, target, lighting):
            target.clear()
            target.color.fill(77)
            target.depth.fill(2.5)
            target.valid.fill(1)

    methods = methods_of([Own()])
    assert list(methods) == ["render"]
    assert (methods["render"].draw(CAMERA, Style("render")).color == 77).all()


def test_named_things_are_ways_to_choose():
    methods = methods_of({"fine": [relief()], "coarse": relief()})
    assert list(methods) == ["fine", "coarse"]
    for bad in ({}, {3: relief()}, [], [relief(), 3], "word"):
        with pytest.raises(ibr.ArgumentError, match="things"):
            methods_of(bad)


def test_views_of_depth_alone_and_of_both_kinds_of_colours_are_drawn():
    bare = [ibr.DepthImage(None, view.depth, view.camera) for view in views()]
    assert methods_of(bare)["warp"].draw(CAMERA, Style("warp")).color.max() == 255
    mixed = [views()[0].in_float, *views()[1:]]
    frame = methods_of(mixed)["warp"].draw(CAMERA, Style("warp"))
    np.testing.assert_allclose(frame.color, ibr.warp(views(), CAMERA).color / 255, atol=2 / 255)


# ---- parameters


def test_knobs_are_what_a_class_is_made_with():
    parameters = parameters_of([ibr.DepthObject(views(), slices=32)])
    assert list(parameters) == ["slices", "slicing", "texture", "halvings", "missing", "only", "thin"]
    assert (parameters["slices"].kind, parameters["slices"].value) == (int, 32)
    assert parameters["slicing"].choices == ("orthogonal", "screen")
    assert {"tolerance", "blend", "blended", "closed"} <= set(parameters_of([ibr.DepthMeshObject(views())]))
    assert {"scale", "silhouette", "distance"} <= set(parameters_of([relief()]))
    sliced = ibr.SlicedSurface(relief().base, relief().height, relief().color, 0.1, test="band", band=0.1)
    assert {"scale", "slices", "slicing", "test", "halvings"} <= set(parameters_of([sliced]))
    assert parameters_of([sliced])["band"].value == 0.1
    typed = parameters_of([ibr.DepthObject(views(), slices="view")])["slices"]
    assert (typed.kind, typed.value, typed.choices) == (str, "view", ())  # a word or a number is typed
    assert parameters_of([object(), 3, models.donut()]).keys() == {"sides"}


def test_every_option_of_every_thing_has_its_control():
    """All arguments of a thing's class have controls, except images, meshes and maps."""
    height, color = relief().height, relief().color
    made_of = {
        ibr.WarpedView(views()): {"views"},
        ibr.DepthMesh(views()[0]): {"view"},
        ibr.DepthMeshObject(views()): {"views"},
        ibr.DepthObject(views()): {"views"},
        ibr.VisualHull(views()): {"views"},
        ibr.SlicedSurface(relief().base, height, color, 0.1): {"base", "height", "color", "normal_map"},
        relief(): {"base", "height", "color", "normal_map"},
        models.donut(12): {"vertices", "faces", "uv", "normals", "texture", "colors", "attributes"},
    }
    for thing, parts in made_of.items():
        options = set(inspect.signature(type(thing)).parameters) - parts
        parameters = parameters_of([thing])
        assert {name.split(".")[0] for name in parameters} == options, type(thing)
        for name, parameter in parameters.items():
            assert with_parameters(thing, {name: parameter.value}) is thing


def test_what_an_option_consists_of_is_turned_by_itself():
    surface = with_parameters(relief(), {"tiles.1": 3, "wrap.0": "clamp"})
    assert (surface.tiles, surface.wrap) == ((1, 3), ("clamp", "repeat"))
    solid = with_parameters(ibr.DepthMeshObject(views()), {"segmentation.angle": 3.0, "segmentation.test": "none"})
    assert [mesh.segmentation for mesh in solid.meshes] == [Segmentation("none", 3.0)] * 6
    assert with_parameters(solid, {"tolerance": 2.0}).segmentation == Segmentation("none", 3.0)
    assert with_parameters(ibr.DepthObject(views(), slices=32), {"only": 0, "slices": 8}).only == 0


def test_a_turned_knob_makes_the_thing_that_its_class_would_make():
    sliced = {"slices": 16, "texture": "naive"}
    higher = ibr.ReliefSurface(relief().base, relief().height, relief().color, 0.2)
    for thing, values, expected in (
        (ibr.DepthObject(views(), slices=32), sliced, ibr.DepthObject(views(), **sliced)),
        (ibr.DepthMeshObject(views()), {"tolerance": 8.0}, ibr.DepthMeshObject(views(), tolerance=8.0)),
        (relief(), {"scale": 0.2, "unknown": 3}, higher),
    ):
        made = ibr.render(with_parameters(thing, values), CAMERA)
        np.testing.assert_array_equal(made.color, ibr.render(expected, CAMERA).color)
    assert with_parameters(relief(), {"scale": relief().scale}) is relief()
    with pytest.raises(ibr.ArgumentError, match="slices"):
        with_parameters(ibr.DepthObject(views(), slices=32), {"slices": 0})


def test_a_way_draws_its_things_as_their_knobs_are_turned_and_keeps_a_few():
    method = methods_of([ibr.DepthObject(views(), slices=32)])["render"]
    for slices in (8, 16, 8, 4, 6, 7, 9):
        frame = method.draw(CAMERA, Style("render", parameters=(("slices", slices),)))
        np.testing.assert_array_equal(frame.color, ibr.render(ibr.DepthObject(views(), slices=slices), CAMERA).color)
    assert len(method._with_parameters) <= 4


# ---- overlays


def test_classes_are_shown_in_their_colours():
    wide = ibr.Camera.look_at((1.5, -1.2, 3), (0, 0, 0), (0, -1, 0), (83, 61), fov_y=100)
    frame = ibr.warp(views()[3], wide, classes=True)
    shown = class_colors(frame)
    np.testing.assert_array_equal(shown[frame.valid], frame.color[frame.valid])
    for kind, color in CLASS_COLORS.items():
        holes = frame.classes == kind
        assert holes.any(), kind
        np.testing.assert_array_equal(shown[holes], np.tile(np.array(color) * 2 // 3, (holes.sum(), 1)))


def test_views_have_colours_that_are_told_apart():
    frame = ibr.warp(views(), CAMERA, classes=True)
    shown = view_colors(frame, (0, 0, 0))
    assert (shown[frame.view < 0] == 0).all() and len(np.unique(frame.view)) > 2
    for number in range(6):
        own = shown[frame.view == number].astype(float)
        if len(own):
            cosines = own @ view_color(number) / (np.linalg.norm(own, axis=1) * np.linalg.norm(view_color(number)))
            assert cosines.min() > 0.99
    hues = np.array([view_color(number) for number in range(16)], float)
    assert min(np.abs(a - b).max() for i, a in enumerate(hues) for b in hues[:i]) > 20


def test_what_overlays_mean_is_told():
    assert legend("color", 3) == legend("depth", 3) == []
    named = {(color, kind.name.lower()) for kind, color in CLASS_COLORS.items()}
    assert set(legend("classes", 3)) == named and len(legend("classes", 3)) == len(named)
    assert legend("view", 3) == [(view_color(number), str(number)) for number in range(3)]
    many = legend("view", 100)
    assert [text for _, text in many] == [*map(str, range(16)), "to 99"]


def test_who_does_not_know_of_views_is_seen_as_it_is():
    frame = ibr.render(views(), CAMERA)
    np.testing.assert_array_equal(view_colors(frame, (1, 2, 3)), frame.color)


def test_differences_are_absolute_and_multiplied():
    one, other = np.full((2, 3, 3), 10, np.uint8), np.full((2, 3, 3), 14, np.uint8)
    assert (difference(one, other, 4) == 16).all() and (difference(other, one, 100) == 255).all()


# ---- comparisons


def test_a_comparison_is_of_the_two_pictures():
    methods = methods_of(views())
    one, other = (methods[name].draw(CAMERA, Style(name)).color for name in ("warp", "forward"))
    swiped = paint(methods, CAMERA, Style("warp", "forward", "swipe", swipe=0.4))
    border = round(0.4 * 83)
    np.testing.assert_array_equal(swiped.color[:, :border], one[:, :border])
    np.testing.assert_array_equal(swiped.color[:, border + 1 :], other[:, border + 1 :])
    apart = paint(methods, CAMERA, Style("warp", "forward", "difference", gain=3))
    np.testing.assert_array_equal(apart.color, difference(one, other, 3))
    assert "dB in common pixels" in apart.note
    beside = paint(methods, CAMERA, Style("warp", "forward", "side by side", gain=3))
    width = (83 - 2) // 3
    first = (83 - width) // 2
    off = (beside.color[:, :width] != one[:, first : first + width]).any(axis=2)
    assert off.mean() < 0.003  # rays that touch a silhouette, where rounding decides
    assert beside.depth is None and beside.color.shape == (61, 83, 3)
    same = paint(methods, CAMERA, Style("warp", "warp", "side by side", gain=30))
    assert (same.color[:, -width - 1 :][:, 1:] == 0).all()


@pytest.mark.parametrize("size", [(1, 1), (2, 1), (3, 5), (4, 4), (7, 13)])
@pytest.mark.parametrize("layout", ["one", "swipe", "side by side", "difference"])
def test_pictures_of_any_size_are_drawn(size, layout):
    methods = methods_of(views())
    for show in ("color", "depth", "classes", "view"):
        picture = paint(methods, CAMERA.resized(size), Style("warp", "forward", layout, show=show))
        assert picture.color.shape == (size[1], size[0], 3)


def test_an_unknown_way_is_named():
    with pytest.raises(ibr.ArgumentError, match="way: expected one of warp, render"):
        paint(methods_of(views()), CAMERA, Style("wrap"))


def test_kernels_are_timed():
    times = kernel_seconds(methods_of(views()), CAMERA, Style("warp"))
    assert {"epipolar_sweep", "resolve"} <= set(times) and all(seconds > 0 for seconds in times.values())


# ---- scenes


def test_a_scene_begins_where_its_first_view_was_taken_and_is_upright():
    scene = scene_of(views())
    assert scene.start == views()[0].camera and len(scene.sources) == 6
    np.testing.assert_allclose(scene_of(views()[:1]).up, -views()[0].camera.world_from_camera[:3, 1], atol=1e-12)


def test_a_scene_of_meshes_is_seen_whole_from_its_start():
    scene = scene_of(models.donut(), up=(0, 0, 2))
    np.testing.assert_allclose(scene.up, (0, 0, 1))
    pixels, depth = scene.start.project(models.donut().vertices)
    assert (depth > 0).all() and (pixels > -0.5).all() and (pixels < np.array(scene.start.size) - 0.5).all()
    assert scene.plain
    np.testing.assert_allclose(scene.pivot, np.mean(models.donut().bounds, axis=0), atol=1e-6)


def test_a_few_samples_far_out_do_not_tell_where_the_scene_is():
    view = views()[0]
    depth = view.depth.copy()
    depth[0, 0] = 1e6
    scene = scene_of(ibr.DepthImage(view.color, depth, view.camera))
    assert scene.page_space.unit < 2
    with pytest.raises(ibr.ArgumentError, match="up: expected a direction"):
        scene_of(view, up=(0, 0, 0))
