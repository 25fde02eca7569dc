"""Depth objects compared with a float64 reference, the intersection of their views' volumes, and with the true mesh."""

from __future__ import annotations

import subprocess
import sys
from functools import cache
from itertools import permutations

import cv2
import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import MeshScene, object_views
from pyibr.core.camera import Camera
from pyibr.images import metrics
from pyibr.images.metrics import silhouette_iou
from pyibr.opencl.watch import watching
from pyibr.slicing import alpha_tests, solid
from tests.boxes import cuboid
from tests.builds import Builds
from tests.data import shared
from tests.embree import rays_of
from tests.picture.test_far import from_afar
from tests.reference.slicing import depth_object, first_depth
from tests.slicing.solids import cup, dragon, looking, spacing, torus, views_of_torus
from tools.processes import with_path

KINDS = ["orthographic", "perspective", "four", "nine, anywhere"]
FRONT = (0.5, 0.4, 1)


def across_slices(thing: ibr.DepthObject, camera: Camera) -> np.ndarray | float:
    """Distance that each pixel's ray moves perpendicularly to the slices while its depth grows by 1."""
    if thing.slicing == "screen":
        return 1.0
    towards = camera.forward if camera.projection == "orthographic" else thing.box.center - camera.center
    axis = np.abs(thing.box.axes @ towards).argmax()
    return np.abs(rays_of(camera)[:, 3:] @ thing.box.axes[axis]).reshape(camera.height, camera.width)


def check(thing: ibr.DepthObject, camera: Camera, truth: np.ndarray) -> None:
    frame, seen = ibr.render(thing, camera), np.isfinite(truth)
    # Slices may miss parts thinner than their distance, at outlines: up to 3 of 1000 pixels here.
    assert silhouette_iou(frame.valid, seen) >= 0.995
    both = frame.valid & seen
    off = (np.abs(frame.depth - truth) * across_slices(thing, camera))[both] * 2**thing.halvings / spacing(thing)
    # A ray's hit is between 0 and 1 spacings behind the surface. The median of 1500 such distances is 0.5; 0.55 is over
    # three standard errors more. 1.02: the truth itself is precise to 0.001.
    assert np.median(off) <= 0.55
    assert np.quantile(off, 0.98) <= 1.02


@cache
def truth_of(kind: str, projection: str = "perspective") -> np.ndarray:
    """True depth of an object made of views of the torus, in float64, by steps half as long as the spacing of slices.

    Parts thinner than a step lie at a two-hundredth of the pixels, which decide no test.
    """
    views, camera = views_of_torus(kind), looking(torus(), FRONT, (90, 74), projection)
    thing = ibr.DepthObject(views, slices=256)
    return first_depth(depth_object(views), camera, thing.box, spacing(thing) / 2)


@pytest.mark.parametrize(
    ("kind", "projection"), [(kind, ("perspective", "orthographic")[k % 2]) for k, kind in enumerate(KINDS)]
)
def test_it_is_the_intersection_of_the_displaced_volumes(kind, projection):
    views, camera = views_of_torus(kind), looking(torus(), FRONT, (90, 74), projection)
    for slicing, halvings in (("orthogonal", 0), ("orthogonal", 5), ("screen", 2)):
        thing = ibr.DepthObject(views, slices=256, slicing=slicing, halvings=halvings)
        check(thing, camera, truth_of(kind, projection))


@pytest.mark.thorough
def test_the_dragon_at_full_size():
    scene, views = dragon()
    camera = looking(scene, FRONT, (120, 90))
    first = ibr.DepthObject(views, slices=256)
    truth = first_depth(depth_object(views), camera, first.box, spacing(first) / 4)
    for slicing, halvings in (("orthogonal", 2), ("screen", 0)):
        check(ibr.DepthObject(views, slices=256, slicing=slicing, halvings=halvings), camera, truth)


@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_more_slices_converge(slicing):
    views, camera = views_of_torus("orthographic"), looking(torus(), FRONT, (90, 74))
    truth, off = truth_of("orthographic"), []
    for slices in (16, 64, 256):
        frame = ibr.render(ibr.DepthObject(views, slices=slices, slicing=slicing, halvings=0), camera)
        off.append(np.median(np.abs(frame.depth - truth)[frame.valid & np.isfinite(truth)]))
    exponent = np.polyfit((4, 6, 8), np.log2(off), 1)[0]
    assert -1.15 <= exponent <= -0.85, off  # errors fall as 1 / slices


def test_without_halvings_points_lie_on_slices():
    thing = ibr.DepthObject(views_of_torus("orthographic"), slices=64, slicing="screen", halvings=0)
    frame = ibr.render(thing, looking(torus(), FRONT, (110, 90)))
    number = frame.depth[frame.valid] / spacing(thing)
    # Depth is about 4 units, or 200 slices, in float32.
    np.testing.assert_allclose(number, np.rint(number), atol=200 * 2**-22)


@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_against_the_mesh_with_the_colours_of_views_that_saw_the_point(slicing):
    views, scores = views_of_torus("orthographic"), {"visible": [], "naive": []}
    for texture, scored in scores.items():
        thing = ibr.DepthObject(views, slices=256, slicing=slicing, texture=texture)
        for direction in (FRONT, (-1, 0.3, 0.2)):
            camera = looking(torus(), direction, (160, 120))
            truth, frame = torus().capture(camera), ibr.render(thing, camera)
            # The object is 160 samples wide: an outline that is half a sample off changes the area by 2 %.
            assert silhouette_iou(frame.valid, truth.valid) >= 0.97
            scored.append(metrics.psnr(frame.color, truth.color, valid=frame.valid & truth.valid))
    assert np.mean(scores["visible"]) > np.mean(scores["naive"]) + 3  # dB
    assert np.mean(scores["visible"]) > 25


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_naive_colours_are_the_three_closest_views_by_their_cosines(projection):
    """Section 4.2: each view has one colour, and the views' weights, which add up to 1, are the same for all pixels."""
    tints = np.array([(200, 30, 60), (10, 220, 90), (50, 120, 250), (240, 230, 20), (90, 0, 180), (0, 160, 170)])
    views = [
        ibr.DepthImage(np.broadcast_to(tint.astype(np.uint8), v.color.shape).copy(), v.depth, v.camera)
        for tint, v in zip(tints, views_of_torus("orthographic"), strict=True)
    ]
    thing, camera = (
        ibr.DepthObject(views, slices=64, texture="naive"),
        looking(torus(), (0.8, 0.5, 1), (90, 70), projection),
    )
    towards = camera.forward if projection == "orthographic" else thing.box.center - camera.center
    cosines = np.array([v.camera.forward for v in views]) @ towards / np.linalg.norm(towards)
    closest = np.argsort(-cosines)[:3]
    expected = cosines[closest] @ tints[closest] / cosines[closest].sum()
    frame = ibr.render(thing, camera)
    shown = frame.color[cv2.erode(frame.valid.astype(np.uint8), np.ones((5, 5))) > 0]
    assert len(shown) > 300
    # Where one of the three views shows background at a point, a fourth view replaces it.
    assert (np.abs(shown - expected).max(axis=1) <= 1).mean() >= 0.97


@pytest.mark.thorough
def test_a_textured_mesh():
    """Parts of Spot, the cow, that its legs hide from a view do not get the legs' colours."""
    mesh = ibr.Mesh.load(next(shared("meshes/spot").glob("*.obj*")))
    scene = MeshScene.from_mesh(mesh)
    views, scores = object_views(scene, 256), {"visible": [], "naive": []}
    for texture, scored in scores.items():
        thing = ibr.DepthObject(views, slices=256, texture=texture)
        for direction in (FRONT, (-0.8, -0.5, 1)):
            camera = looking(scene, direction, (200, 150))
            truth, frame = scene.capture(camera), ibr.render(thing, camera)
            assert silhouette_iou(frame.valid, truth.valid) >= 0.97
            scored.append(metrics.psnr(frame.color, truth.color, valid=frame.valid & truth.valid))
    assert np.mean(scores["visible"]) > np.mean(scores["naive"]) + 1
    assert np.mean(scores["visible"]) > 25


def test_a_cups_cavity_is_in_the_object_and_not_in_the_hull():
    scene = cup()
    views = object_views(scene, 160)
    camera = looking(scene, (0.2, 1.5, 0.3), (120, 120))
    truth = scene.capture(camera)
    frame = ibr.render(ibr.DepthObject(views, slices=200), camera)
    hull = ibr.render(ibr.VisualHull(views, slices=200), camera)
    middle = (slice(50, 70), slice(50, 70))
    np.testing.assert_allclose(frame.depth[middle], truth.depth[middle], atol=0.02)  # the bottom, to 2 slices
    assert (truth.depth[middle] - hull.depth[middle]).min() > 1.0  # the cavity, 1.8 deep, is filled


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
def test_walls_along_views_have_the_colours_of_those_that_see_them(kind):
    """No orthographic view sees a cup's inner walls, except two from above and below, less than a sample wide."""
    scene = cup()
    thing = ibr.DepthObject(object_views(scene, 256, projection=kind), slices=256)
    for direction in ((0.5, 0.9, 1), (0.4, 1.2, 0.8)):
        camera = looking(scene, direction, (180, 140))
        truth, frame = scene.capture(camera), ibr.render(thing, camera)
        both = frame.valid & truth.valid
        off = (np.abs(frame.color.astype(int) - truth.color) > 40).any(axis=-1)
        assert (off & both).sum() <= 0.005 * both.sum()  # pixels at the rim, a sample off
        depth = np.where(truth.valid, truth.depth, 9).astype(np.float32)
        jumps = cv2.dilate(depth, np.ones((3, 3))) > 1.03 * cv2.erode(depth, np.ones((3, 3)))
        inside = both & (cv2.dilate(jumps.astype(np.uint8), np.ones((3, 3))) == 0)
        assert (off & inside).sum() <= 1e-4 * inside.sum()


@pytest.mark.parametrize("kind", KINDS)
def test_the_hull_contains_the_object(kind):
    views, camera = views_of_torus(kind), looking(torus(), FRONT, (110, 90))
    frame, hull = (
        ibr.render(ibr.DepthObject(views, slices=128), camera),
        ibr.render(ibr.VisualHull(views, slices=128), camera),
    )
    # A silhouette ends half-way to the background's samples. An object ends there, or up to a sample farther out.
    both = frame.valid & hull.valid
    assert both.sum() >= 0.98 * frame.valid.sum()
    nearer = hull.depth[both] <= frame.depth[both] + 2 * spacing(ibr.VisualHull(views, slices=128))
    assert nearer.mean() >= 0.98


def test_the_number_of_views_builds_nothing():
    builds, after = Builds(), list[int]()
    with watching(builds):
        for count in (2, 4, 6, 9):
            ibr.render(ibr.DepthObject(views_of_torus("nine, anywhere")[:count]), looking(torus(), (1, 2, 3), (41, 31)))
            after.append(len(builds.of))
    assert after[0] == after[-1] > 0


@pytest.mark.parametrize("kind", KINDS)
def test_the_order_of_views_changes_nothing(kind):
    views, camera = views_of_torus(kind), looking(torus(), FRONT, (90, 70))
    frame = ibr.render(ibr.DepthObject(views, slices=64), camera)
    turned = ibr.render(
        ibr.DepthObject([views[0], *views[:0:-1]], slices=64), camera
    )  # the first view stays, since it defines the box's axes
    np.testing.assert_array_equal(frame.depth, turned.depth)
    np.testing.assert_array_equal(frame.color, turned.color)


@pytest.mark.parametrize("size", [(1, 1), (7, 13), (61, 37)])
def test_any_size_is_a_part_of_a_large_picture(size):
    thing, camera = ibr.DepthObject(views_of_torus("perspective"), slices=64), looking(torus(), FRONT, (90, 70))
    whole = ibr.render(thing, camera)
    width, height = size
    middle = np.add(
        np.argwhere(whole.valid[18:51, 30:60])[0], (18, 30)
    )  # a pixel of the object, such that the part lies within the large picture
    y, x = np.subtract(middle, (height // 2, width // 2))
    K = camera.K - [[0, 0, x], [0, 0, y], [0, 0, 0]]
    part = ibr.render(thing, Camera(K, size, camera.world_from_camera))
    window = whole.depth[y : y + height, x : x + width]
    assert np.isfinite(window).any()
    both = part.valid & np.isfinite(window)
    assert both.sum() >= 0.99 * max(part.valid.sum(), np.isfinite(window).sum())
    # The rays are the same, computed from another K with other rounding, which may choose another slice at outlines.
    assert np.quantile(np.abs(part.depth - window)[both], 0.95) <= 1e-4


@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
@pytest.mark.parametrize("texture", ["visible", "naive"])
def test_from_within_its_box(slicing, texture):
    thing = ibr.DepthObject(views_of_torus("orthographic"), slices=64, slicing=slicing, texture=texture)
    middle, ring = thing.box.center, torus().vertices[0]
    for eye in (middle, middle + 1e-6, 0.5 * (middle + ring), ring):
        frame = ibr.render(thing, Camera.look_at(eye, np.add(middle, (0.3, 2, 0.1)), (0, 0, 1), (41, 33), fov_y=80))
        np.testing.assert_array_equal(np.isfinite(frame.depth), frame.valid)
        assert (frame.depth[frame.valid] > 0).all()
    behind = ibr.render(thing, Camera.look_at(middle + 9, middle + 18, (0, 0, 1), (41, 33)))
    assert not behind.valid.any()


def test_from_afar_it_is_orthographic():
    thing = ibr.DepthObject(views_of_torus("orthographic"), slices=64, slicing="screen")
    flat = looking(torus(), FRONT, (90, 70), "orthographic")
    near, far = ibr.render(thing, flat), ibr.render(thing, from_afar(flat, 1e4))
    assert silhouette_iou(near.valid, far.valid) >= 0.99
    both = near.valid & far.valid
    # Slices lie elsewhere. Depths of 10,000 are rounded to 5e-4, a twentieth of what is allowed.
    off = np.abs(far.depth - 1e4 - near.depth)[both]
    assert np.quantile(off, 0.9) <= 1.5 * spacing(thing) / 2**thing.halvings


def plane_through(thing: ibr.DepthObject) -> ibr.Mesh:
    """A large oblique square through the middle of the object's box."""
    a, b = np.linalg.qr(np.random.default_rng(8).normal(size=(3, 3)))[0][:2] * 5
    corners = np.array([a, b, -a, -b]) + thing.box.center
    return ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3]], colors=np.full((4, 3), 9, np.uint8))


@pytest.mark.parametrize(("slicing", "halvings"), [("orthogonal", 2), ("screen", 0), ("screen", 2)])
def test_one_depth_buffer_with_other_things(slicing, halvings):
    thing = ibr.DepthObject(views_of_torus("orthographic"), slices=40, slicing=slicing, halvings=halvings)
    wall, hull = (
        plane_through(thing),
        ibr.VisualHull(object_views(cup(), 64), slices=40, slicing=slicing, halvings=halvings),
    )
    for projection in ("perspective", "orthographic"):
        camera = looking(torus(), FRONT, (100, 80), projection)
        things = [thing, wall, hull]
        alone = [ibr.render(one, camera) for one in things]
        nearest = np.min([np.where(one.valid, one.depth, np.inf) for one in alone], axis=0)
        for order in permutations(things):
            frame = ibr.render(order, camera)
            np.testing.assert_array_equal(np.where(frame.valid, frame.depth, np.inf), nearest)
        assert all((nearest == one.depth).any() for one in alone)


def test_tests_are_counted():
    thing, camera = ibr.DepthObject(views_of_torus("orthographic"), slices=64), looking(torus(), FRONT, (90, 70))
    counted, seen = alpha_tests(thing, camera), ibr.render(thing, camera).valid
    assert (counted[seen] >= 6).all()  # a visible point has passed the tests of all six views
    # A ray crosses at most 64 * sqrt(3) slices and one more at each end; each takes at most six tests.
    assert counted.max() <= 6 * (64 * 3**0.5 + 2 + thing.halvings)


@pytest.mark.parametrize(("thing", "camera"), [("cup", None), (None, 1)])
def test_what_cannot_be_counted(thing, camera):
    good = ibr.DepthObject(views_of_torus("orthographic"), slices=16)
    with pytest.raises(ibr.ArgumentError, match=r"thing|camera"):
        alpha_tests(thing or good, camera or looking(torus(), FRONT, (9, 7)))


def test_bad_views(monkeypatch):
    views = views_of_torus("orthographic")
    apart = [ibr.DepthImage(v.color, v.depth, v.camera.moved(100.0 * k, 0, 0)) for k, v in enumerate(views)]
    back = views[0].camera.orbited(180, views[0].camera.center)
    turned_away = [views[0], ibr.DepthImage(views[0].color, views[0].depth, back)]
    nothing = ibr.DepthImage(views[0].color, np.full_like(views[0].depth, np.nan), views[0].camera)
    outline = ibr.Silhouette(views[0].color, views[0].valid, views[0].camera)
    for bad in ([], (), None, views[0], [3], [*views, None], apart, turned_away, [*views, nothing], [outline]):
        with pytest.raises(ibr.ArgumentError, match=r"^views: "):
            ibr.DepthObject(bad)
    with pytest.raises(ibr.ArgumentError, match="view 6"):
        ibr.DepthObject([*views, nothing])
    monkeypatch.setattr(solid, "_SAMPLES_MAX", views[0].depth.size)
    with pytest.raises(ibr.ArgumentError, match=r"^views: expected at most \d+ samples in all, got \d+$"):
        ibr.DepthObject(views)


def views_with_background(depth: float, kind: str = "orthographic") -> list[ibr.DepthImage]:
    """Views of the torus, with `depth` in place of the background."""
    views = views_of_torus(kind)
    return [ibr.DepthImage(v.color, np.where(v.valid, v.depth, np.float32(depth)), v.camera) for v in views]


@pytest.mark.parametrize("kind", ["orthographic", "four"])
@pytest.mark.parametrize("depth", [1e5, 1e10, 1e20, 3.4e38])
def test_background_that_is_given_as_depth_is_refused(kind, depth):
    with pytest.raises(ibr.ArgumentError, match=r"^views: .*`far`.* to .* in view 0$"):
        ibr.DepthObject(views_with_background(depth, kind))
    some = views_with_background(depth, kind)
    kept = ibr.DepthObject([ibr.DepthImage(v.color, v.depth, v.camera, far=1e4) for v in some])
    np.testing.assert_allclose(kept.box.edges, ibr.DepthObject(views_of_torus(kind)).box.edges)


def test_a_sample_far_away_has_a_box():
    for far in (0.0, 1e6, -1e12):
        camera = ibr.Camera([[9, 0, 0], [0, 9, 0], [0, 0, 1]], (1, 1)).moved(far, far, far)
        thing = ibr.DepthObject([ibr.DepthImage(np.zeros((1, 1, 3), np.uint8), np.ones((1, 1), np.float32), camera)])
        assert (thing.box.edges > 0).all()
        assert ibr.render(thing, camera.resized((5, 3))).depth.shape == (3, 5)


BAD = [
    *[("slices", value) for value in (0, -3, 1.5, "64", True, None, 10**9)],
    *[("slicing", value) for value in ("surface", None, 1)],
    *[("texture", value) for value in ("best", None)],
    *[("halvings", value) for value in (-1, 0.5, True, 99)],
]


@pytest.mark.parametrize(("argument", "value"), BAD)
def test_bad_options(argument, value):
    with pytest.raises(ibr.ArgumentError, match=rf"^{argument}: "):
        ibr.DepthObject(views_of_torus("four"), **{argument: value})


@pytest.mark.parametrize(("size", "extent"), [(31, (1, 1, 1)), (48, (1, 1, 0.2)), (100, (1, 1, 1)), (256, (1, 1, 0.2))])
def test_a_box_along_the_views_axes(size, extent):
    """The sides of a box, along the views' axes, are outlines in the views."""
    mesh = ibr.Mesh(*cuboid((0, 0, 0), extent))
    thing, camera = (
        ibr.DepthObject(object_views(mesh, size), slices=64),
        Camera.look_at((2, 1.7, 2.6), (0.5, 0.5, 0.3), (0, 0, 1), (121, 91), fov_y=40),
    )
    frame, truth = ibr.render(thing, camera), ibr.render(mesh, camera)
    # Outlines are half a sample off: on each side of the box by 0.5 / size of its width.
    assert silhouette_iou(frame.valid, truth.valid) >= 1 - 6 / size - 0.02


def test_an_image_that_shows_a_part_alone():
    """With `missing="unknown"`, the image limits the object only where it has pixels; else it cuts off the rest."""
    views = views_of_torus("orthographic")
    camera = views[0].camera
    rows, columns = slice(20, 60), slice(30, 80)
    K = camera.K - [[0, 0, 30], [0, 0, 20], [0, 0, 0]]
    part = ibr.DepthImage(
        np.ascontiguousarray(views[0].color[rows, columns]),
        np.ascontiguousarray(views[0].depth[rows, columns]),
        Camera(K, (50, 40), camera.world_from_camera, projection=camera.projection),
    )
    target = looking(torus(), FRONT, (90, 70))
    whole = ibr.render(ibr.DepthObject(views, slices=64), target).valid
    left = ibr.render(ibr.DepthObject([*views[1:], part], slices=64, missing="unknown"), target).valid
    cut = ibr.render(ibr.DepthObject([*views[1:], part], slices=64), target).valid
    assert silhouette_iou(left, whole) >= 0.97
    assert cut.sum() < 0.8 * whole.sum()


IN_BOXES = """
import warnings
import numpy as np, pyibr as ibr
warnings.simplefilter("ignore")  # of numbers that float32 does not hold
depth = np.full((5, 5), np.nan, np.float32)
depth[2, 2] = 3
for focal in (10, 1e16):
    camera = ibr.Camera([[focal, 0, 2], [0, focal, 2], [0, 0, 1]], (5, 5))
    view = ibr.DepthImage(np.full((5, 5, 3), 9, np.uint8), depth, camera)
    for slicing in ("orthogonal", "screen"):
        thing = ibr.DepthObject([view], slices=7, slicing=slicing)
        print(thing.box.edges.max())
        try:
            ibr.render(thing, ibr.Camera([[10, 0, 2], [0, 10, 2], [0, 0, 1]], (5, 5)))
        except ibr.ArgumentError:
            pass  # in one sentence
"""


def test_rays_end_in_boxes_that_float32_does_not_hold():
    command = [sys.executable, "-c", IN_BOXES]
    done = subprocess.run(command, env=with_path(), capture_output=True, text=True, timeout=300, check=True)
    edges = [0.3, 0.3, 7.4e-15, 7.4e-15]  # a pixel's width; a margin for rounding
    np.testing.assert_allclose([float(line) for line in done.stdout.split()], edges, rtol=0.01)


@pytest.mark.parametrize(
    ("slicing", "projection"),
    [("orthogonal", "perspective"), ("orthogonal", "orthographic"), ("screen", "perspective")],
)
def test_one_slice_alone_is_the_object_cut_open(slicing, projection):
    """Figure 16: a slice through the object shows exactly the points that pass the tests of all views."""
    views, camera = views_of_torus("orthographic"), looking(torus(), FRONT, (80, 66), projection)
    start, ahead = np.split(rays_of(camera), 2, axis=1)
    whole = ibr.DepthObject(views, slices=64, slicing=slicing)
    box, towards = whole.box, camera.forward if projection == "orthographic" else whole.box.center - camera.center
    if slicing == "screen":
        middle = float((box.center - camera.center) @ camera.forward)
        normal, first = (
            camera.forward,
            camera.center @ camera.forward + np.rint(middle / spacing(whole)) * spacing(whole),
        )
        numbers = [-9, 0, 12]
    else:
        axis = int(np.abs(box.axes @ towards).argmax())
        normal, first = box.axes[axis], box.low[axis]
        numbers = [int(part * box.edges[axis] / spacing(whole)) for part in (0.3, 0.5, 0.7)]
    for number in numbers:
        thing = ibr.DepthObject(views, slices=64, slicing=slicing, only=number)
        place = first + number * spacing(whole)
        points = start + ((place - start @ normal) / (ahead @ normal))[:, None] * ahead
        along = points @ box.axes.T
        in_box = ((along >= box.low) & (along <= box.high)).all(axis=1)
        truth = (depth_object(views)(points) & in_box).reshape(66, 80)
        frame = ibr.render(thing, camera)
        assert truth.sum() > 160
        # Where a view's surface is parallel to its rays, float32 decides: at most at two pixels of the outline here.
        assert (frame.valid != truth).sum() <= 2
        depth = ((points - camera.center) @ camera.forward).reshape(66, 80)
        np.testing.assert_allclose(frame.depth[frame.valid], depth[frame.valid], rtol=1e-5)


def test_one_slice_alone_has_a_number():
    with pytest.raises(ibr.ArgumentError, match='only: expected None with slices="view"'):
        ibr.DepthObject(views_of_torus("orthographic"), slices="view", only=3)
    beyond = ibr.DepthObject(views_of_torus("orthographic"), slices=64, only=66)
    assert not ibr.render(beyond, looking(torus(), FRONT, (110, 90))).valid.any()
