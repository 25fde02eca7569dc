"""Visual hulls compared with closed forms and a float64 reference, and hulls of photographs and of renderings."""

from __future__ import annotations

import json
from functools import cache

import cv2
import numpy as np
import pytest
from PIL import Image

import pyibr as ibr
from pyibr.capture import models, object_views
from pyibr.capture.raycast import MeshScene
from pyibr.core.camera import Camera
from pyibr.images.metrics import silhouette_iou
from tests.data import shared
from tests.embree import rays_of
from tests.one_lane import both_forms
from tests.reference.slicing import first_depth, visual_hull
from tests.slicing.solids import looking, revolved

SLICES = 256
GIVEN, LEFT_OUT = 0.975, 0.95  # least mean IoU of hull and silhouette: in views used for the hull, and in others


def disk_views(size: int = 200, radius: float = 1.0) -> list[ibr.Silhouette]:
    """Silhouettes of a ball from six orthographic cameras, one on each side, each in another colour."""
    views = []
    for k in range(6):
        away = np.eye(3)[k // 2] * (1 if k % 2 else -1) * 3
        camera = Camera.look_at(
            away, (0, 0, 0), np.eye(3)[(k // 2 + 1) % 3], (size, size), fov_y=50, projection="orthographic", height=2.5
        )
        y, x = (np.mgrid[:size, :size] - (size - 1) / 2) * 2.5 / size
        color = np.full((size, size, 3), COLORS[k], np.uint8)
        views.append(ibr.Silhouette(color, x * x + y * y <= radius * radius, camera))
    return views


COLORS = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0), (255, 0, 255), (0, 255, 255)]


@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_three_cylinders(slicing):
    """The hull of a ball's silhouettes along three axes is the intersection of three cylinders, a closed form."""
    hull = ibr.VisualHull(disk_views(), slices=128, slicing=slicing, halvings=5)
    camera = Camera.look_at((2, 3, 4), (0, 0, 0), (0, 1, 0), (120, 100), fov_y=32)
    frame = ibr.render(hull, camera)
    ray = rays_of(camera)[:, 3:]
    front, back = np.zeros(len(ray)), np.full(len(ray), np.inf)
    for axis in range(3):
        o, d = np.delete(camera.center, axis), np.delete(ray, axis, axis=1)
        a, b, c = (d * d).sum(1), d @ o, o @ o - 1
        root = np.sqrt(np.maximum(b * b - a * c, 0)) + np.where(b * b < a * c, np.nan, 0)
        front, back = np.fmax(front, (-b - root) / a), np.minimum(back, (-b + root) / a)  # nan in `back`: a miss
    truth = np.where(front < back, front, np.inf).reshape(100, 120)
    assert silhouette_iou(frame.valid, np.isfinite(truth)) >= 0.99  # the outline is half a sample, 0.006, off
    both = frame.valid & np.isfinite(truth)
    # Samples are 0.0125 apart. The interpolated mask's edge is off by up to half of that; rays meet it obliquely.
    assert np.median(np.abs(frame.depth - truth)[both]) <= 0.0125 / 2
    assert np.quantile(np.abs(frame.depth - truth)[both], 0.95) <= 3 * 0.0125


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_it_is_the_intersection_of_the_silhouettes(projection):
    views = scattered_views()
    first = ibr.VisualHull(views, slices=128)
    how = {"fov_y": 45.0} if projection == "perspective" else {"projection": projection, "height": 2.4}
    camera = Camera.look_at((1, 1.5, 2.5), (0, 0, 0), (0, 1, 0), (90, 70), **how)
    spacing = float(first.box.edges.max()) / 128
    truth = first_depth(visual_hull(views), camera, first.box, spacing / 8)
    for slicing in ("orthogonal", "screen"):
        frame = ibr.render(ibr.VisualHull(views, slices=128, slicing=slicing, halvings=5), camera)
        assert silhouette_iou(frame.valid, np.isfinite(truth)) >= 0.99  # slices miss sharp edges
        both = frame.valid & np.isfinite(truth)
        assert np.quantile(np.abs(frame.depth - truth)[both], 0.95) <= 2 * spacing / 2**5  # oblique slices


def scattered_views() -> list[ibr.Silhouette]:
    """Silhouettes of an ellipsoid from seven cameras of both projections in random poses; images are not square."""
    random = np.random.default_rng(11)
    views = []
    for k in range(7):
        eye, up = random.normal(size=(2, 3))
        how = {"fov_y": 45.0} if k % 2 else {"projection": "orthographic", "height": 2.4}
        camera = Camera.look_at(3 * eye / np.linalg.norm(eye), random.normal(size=3) / 20, up, (130, 110), **how)
        o, d = (part / (1, 0.5, 0.8) for part in np.split(rays_of(camera), 2, axis=1))
        mask = (o * d).sum(1) ** 2 >= (d * d).sum(1) * ((o * o).sum(1) - 1)  # the ray meets the unit ball
        color = np.full((110, 130, 3), 100, np.uint8)
        views.append(ibr.Silhouette(color, mask.reshape(110, 130), camera))
    return views


def test_opposite_silhouettes_are_tested_once():
    views = disk_views(50)
    assert ibr.VisualHull(views).tested == [0, 2, 4]
    assert ibr.VisualHull(views[::-1]).tested == [0, 2, 4]
    assert ibr.VisualHull([views[k] for k in (0, 2, 4, 1)]).tested == [0, 1, 2]
    bitten = views[1].valid.copy()
    bitten[25, 25] = False
    other = ibr.Silhouette(views[1].color, bitten, views[1].camera)
    assert ibr.VisualHull([views[0], other, *views[2:]]).tested == [0, 1, 2, 4]
    moved = ibr.Silhouette(views[1].color, views[1].valid, views[1].camera.moved(0.02, 0, 0))
    assert ibr.VisualHull([views[0], moved, *views[2:]]).tested == [0, 1, 2, 4]
    assert len(ibr.VisualHull(scattered_views()).tested) == 7


def test_what_is_tested_once_is_the_same_hull():
    views, camera = disk_views(101), Camera.look_at((2, 3, 4), (0, 0, 0), (0, 1, 0), (61, 37), fov_y=32)
    six, three = (ibr.render(ibr.VisualHull(some, slices=64), camera) for some in (views, views[::2]))
    np.testing.assert_allclose(six.depth, three.depth, rtol=1e-5)  # rounding changes the box


def test_of_opposite_views_the_closer_one_colours():
    views = disk_views(50)
    hull = ibr.VisualHull(views, slices=64)
    for view, color in zip(views, COLORS, strict=True):
        frame = ibr.render(hull, view.camera)
        # Near the outline the surface is so oblique that the view sees it in part only.
        inner = cv2.erode(frame.valid.astype(np.uint8), np.ones((5, 5))) > 0
        # The four views at right angles weigh a thousandth each, which together changes colours by at most 1 of 255.
        assert np.abs(frame.color[inner].astype(int) - color).max() <= 1


def smooth_ring(name: str, projection: str) -> tuple[MeshScene, list[ibr.Silhouette]]:
    """A donut, or two balls, in smooth colours, and eight exact views from all round, or six along the axes."""
    mesh = models.donut(60)
    vertices, faces = mesh.vertices.astype(np.float64), mesh.faces
    if name == "balls":
        turn = np.linspace(0, np.pi, 41)
        ball, faces = revolved(0.6 * np.column_stack([np.sin(turn), -np.cos(turn)]), closed=False, sides=80)
        vertices, faces = (
            np.concatenate([ball - np.array((0.7, 0, 0)), ball + np.array((0.7, 0.2, 0))]),
            np.concatenate([faces, faces + len(ball)]),
        )
    scene = MeshScene(vertices, faces, colors=(127.5 + 80 * np.sin(1.5 * vertices)).astype(np.uint8))
    if projection == "axes":
        views = object_views(scene, 160)
    else:
        views = []
        for k, angle in enumerate(np.arange(8) * np.pi / 4):
            eye = 5 * np.sin(angle), 2.5 * (-1) ** k, 5 * np.cos(angle)
            how = {"fov_y": 40.0} if projection == "perspective" else {"projection": projection, "height": 3.6}
            views.append(scene.capture(Camera.look_at(eye, (0, 0, 0), (0, 1, 0), (160, 120), **how)))
    return scene, [ibr.Silhouette(view.color, view.valid, view.camera) for view in views]


AROUND = ((1, 0.3, 1.2), (-1, 0.8, 0.3), (0.2, 1.5, 0.4))


@pytest.mark.parametrize("projection", ["perspective", "orthographic", "axes"])
@pytest.mark.parametrize("name", ["donut", "balls"])
def test_colours_come_from_views_that_see_the_point(name, projection):
    """A view that the hull itself hides from a point gives it no colour: not in pictures, and not in meshes."""
    scene, views = smooth_ring(name, projection)
    off: dict[str, list[float]] = {"visible": [], "naive": [], "mesh": []}
    hulls = {texture: ibr.VisualHull(views, texture=texture) for texture in ("visible", "naive")}
    things = {**hulls, "mesh": hulls["visible"].to_mesh(48)}
    for direction in AROUND:
        camera = looking(scene, direction, (160, 120))
        truth = scene.capture(camera)
        for texture, thing in things.items():
            frame = ibr.render(thing, camera)
            on_surface = frame.valid & truth.valid
            if projection == "axes":  # six views leave so much space that half of the hull is not the object's surface
                on_surface &= np.abs(np.where(on_surface, frame.depth - truth.depth, 9)) < 0.03
            off[texture].append(np.abs(frame.color.astype(int) - truth.color)[on_surface].mean())
    assert np.mean(off["visible"]) <= 1.5, off
    assert np.mean(off["mesh"]) <= 1.5 or projection == "axes", off  # none of the six views sees the donut's inner wall
    assert np.mean(off["naive"]) >= 2 * np.mean(off["visible"]), off


def test_a_hull_between_a_views_samples():
    """A coarse view that sees the hull at none of its samples leaves the colours to the other views."""
    scene, middle = smooth_ring("balls", "perspective")[0], np.array((0.02, 0.06, 0))
    small = MeshScene(
        0.01 * scene.vertices + middle, scene.faces, colors=np.full((len(scene.vertices), 3), 90, np.uint8)
    )
    seen = [small.capture(looking(small, direction, (40, 30))) for direction in AROUND]
    outlines = [ibr.Silhouette(view.color, view.valid, view.camera) for view in seen]
    coarse = Camera.look_at((0, 0.1, 5), (0, 0, 0), (0, 1, 0), (8, 6), fov_y=40)
    mask = np.pad(np.ones((4, 4), bool), ((1, 1), (2, 2)))
    hull = ibr.VisualHull([*outlines, ibr.Silhouette(np.full((6, 8, 3), 250, np.uint8), mask, coarse)])
    assert [bool(np.isfinite(depth).any()) for depth in hull.depths] == [True, True, True, False]
    frame = ibr.render(hull, seen[0].camera)
    assert frame.valid.sum() > 50 and frame.color[frame.valid].max() <= seen[0].color[seen[0].valid].max()
    assert len(hull.to_mesh(8).faces) > 0


def test_more_views_leave_less():
    views, camera = scattered_views(), Camera.look_at((1, 1.5, 2.5), (0, 0, 0), (0, 1, 0), (90, 70), fov_y=45)
    frames = [
        ibr.render(ibr.VisualHull(views[:n], slices=128, slicing="screen", halvings=5), camera) for n in (3, 5, 7)
    ]
    for more, fewer in zip(frames[1:], frames, strict=False):
        assert (more.valid & ~fewer.valid).sum() <= 0.01 * more.valid.sum()  # other boxes have other slices
        both = more.valid & fewer.valid
        assert ((fewer.depth - more.depth)[both] <= 0.05).mean() >= 0.99
    assert frames[2].valid.sum() < frames[0].valid.sum()


def test_the_order_of_views_and_a_second_run_change_nothing():
    views, camera = scattered_views(), Camera.look_at((1, 1.5, 2.5), (0, 0, 0), (0, 1, 0), (61, 37), fov_y=45)
    frame, again = (ibr.render(ibr.VisualHull(views, slices=64), camera) for _ in range(2))
    np.testing.assert_array_equal(frame.depth, again.depth)
    np.testing.assert_array_equal(frame.color, again.color)
    turned = ibr.render(ibr.VisualHull(views[::-1], slices=64), camera)
    assert silhouette_iou(frame.valid, turned.valid) >= 0.995
    np.testing.assert_allclose(turned.depth, frame.depth, rtol=1e-5)  # the box is summed in another order


@pytest.mark.parametrize("of_depth", [True, False])
def test_the_order_of_views_that_are_equally_close_changes_no_colour(of_depth):
    """The camera, in front of an edge of the box, is equally close to two of the six views."""
    rng = np.random.default_rng(2)
    views = list[ibr.DepthImage | ibr.Silhouette]()
    for one in object_views(models.donut(), 48):
        color = rng.integers(60, 256, (*one.depth.shape, 3), np.uint8)
        silhouette = ibr.Silhouette(color, one.valid, one.camera)
        views.append(ibr.DepthImage(color, one.depth, one.camera, far=one.far) if of_depth else silhouette)
    camera = Camera.look_at((4, 0, 4), (0, 0, 0), (0, 1, 0), (61, 37), fov_y=40)
    frame, turned = (ibr.render(ibr.VisualHull(some, slices=40), camera) for some in (views, [views[0], *views[:0:-1]]))
    assert frame.valid.sum() > 100
    np.testing.assert_array_equal(frame.color, turned.color)


@pytest.mark.parametrize("size", [(1, 1), (7, 13), (61, 37)])
def test_any_size(size):
    hull = ibr.VisualHull(disk_views(50), slices=64)
    frame = ibr.render(hull, Camera.look_at((2, 3, 4), (0, 0, 0), (0, 1, 0), size, fov_y=20))
    assert frame.valid[size[1] // 2, size[0] // 2]
    np.testing.assert_array_equal(np.isfinite(frame.depth), frame.valid)
    within = ibr.render(hull, Camera.look_at((0.1, 0, 0), (0, 0, 1), (0, 1, 0), size, fov_y=70))
    np.testing.assert_array_equal(np.isfinite(within.depth), within.valid)


@cache
def clock() -> list[ibr.Silhouette]:
    folder = shared("multiview/kaolin_clock")
    views = []
    for file in sorted(folder.glob("*_metadata.json")):
        number = file.name.split("_")[0]
        told = json.loads(file.read_text())["camera_properties"]
        mask = np.asarray(Image.open(folder / f"{number}_mask.png"))
        mask = mask[..., :3].max(axis=2) if mask.ndim == 3 else mask
        # At half the resolution, to save time.
        mask = cv2.resize(mask, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA) > 127
        color = np.zeros((*mask.shape, 3), np.uint8)
        size = mask.shape[1], mask.shape[0]
        focal = told["focal_length"] / told["horizontal_aperture"] * size[0]
        # tf_mat maps row vectors from world to camera, whose z points backwards and y upwards.
        pose = np.linalg.inv(np.array(told["tf_mat"]).T) @ np.diag([1, -1, -1, 1])
        K = [[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]]
        views.append(ibr.Silhouette(color, mask, Camera(K, size, pose)))
    return views


@cache
def dino() -> list[ibr.Silhouette]:
    folder = shared("multiview/middlebury_dino")
    views = []
    for line in next(folder.glob("*par.txt")).read_text().splitlines()[1:]:
        name, *values = line.split()
        K, R, t = np.split(np.array(values, float), [9, 18])
        color = np.asarray(Image.open(folder / name))
        # Masks are made as the data set's authors recommend.
        mask = (color.max(axis=2) > 0.19 * 255).astype(np.uint8)
        mask = cv2.erode(cv2.dilate(mask, disk(10)), disk(7)).astype(bool)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = R.reshape(3, 3).T, -R.reshape(3, 3).T @ t
        views.append(ibr.Silhouette(color, mask, Camera(K.reshape(3, 3), (color.shape[1], color.shape[0]), pose)))
    return views


def disk(radius: int) -> np.ndarray:
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    return (x * x + y * y <= radius * radius).astype(np.uint8)


def overlap(hull: ibr.VisualHull, view: ibr.Silhouette) -> float:
    return silhouette_iou(ibr.render(hull, view.camera).valid, view.valid)


@pytest.mark.thorough
@pytest.mark.parametrize("views", [clock, dino], ids=["clock", "dino"])
def test_the_outline_of_the_hull_is_the_silhouette(views):
    hull = ibr.VisualHull(views(), slices=SLICES)
    assert np.mean([overlap(hull, view) for view in views()]) >= GIVEN


@pytest.mark.thorough
@pytest.mark.parametrize("views", [clock, dino], ids=["clock", "dino"])
def test_a_view_left_out(views):
    every = views()
    scores = []
    for out in range(0, len(every), 4):
        hull = ibr.VisualHull(every[:out] + every[out + 1 :], slices=SLICES)
        scores.append(overlap(hull, every[out]))
    assert np.mean(scores) >= LEFT_OUT


def test_bad_input():
    camera = Camera([[50, 0, 10], [0, 50, 10], [0, 0, 1]], (21, 21))
    color, mask = np.zeros((21, 21, 3), np.uint8), np.zeros((21, 21), bool)
    with pytest.raises(ibr.ArgumentError, match=r"^mask: "):
        ibr.Silhouette(color, mask, camera)
    mask[5:15, 5:15] = True
    for changes, argument in (
        ({"mask": mask.astype(np.uint8)}, "mask"),
        ({"mask": mask[:5]}, "mask"),
        ({"color": color[:5]}, "color"),
        ({"color": mask}, "color"),
        ({"camera": 3}, "camera"),
    ):
        with pytest.raises(ibr.ArgumentError, match=f"^{argument}: "):
            ibr.Silhouette(**{"color": color, "mask": mask, "camera": camera, **changes})
    one = ibr.Silhouette(color, mask, camera)
    away = ibr.Silhouette(color, mask, Camera.look_at((50, 0, 0), (100, 0, 0), (0, 1, 0), (21, 21), fov_y=30))
    for bad in ([], (), None, one, [3], [one, None], [one, away], [one], [one, one]):
        with pytest.raises(ibr.ArgumentError, match=r"^views: "):
            ibr.VisualHull(bad)
    nothing = ibr.DepthImage(color, np.full((21, 21), np.nan, np.float32), camera)
    with pytest.raises(ibr.ArgumentError, match=r"^views: expected views with valid depth, got none in view 1$"):
        ibr.VisualHull([one, nothing])
    for changes, argument in (
        ({"slices": 0}, "slices"),
        ({"slicing": "surface"}, "slicing"),
        ({"halvings": -1}, "halvings"),
    ):
        with pytest.raises(ibr.ArgumentError, match=f"^{argument}: "):
            ibr.VisualHull(disk_views(20), **changes)


@pytest.mark.thorough
def test_one_lane_gives_the_same_colours():
    scene, views = smooth_ring("donut", "perspective")
    camera = looking(scene, AROUND[0], (81, 67))
    wide, narrow = both_forms(lambda: ibr.render(ibr.VisualHull(views), camera))
    assert (wide.valid != narrow.valid).sum() <= 2  # at the outline, float32 decides
    off = np.abs(wide.color.astype(int) - narrow.color).max(axis=-1)[wide.valid & narrow.valid]
    assert np.quantile(off, 0.99) <= 1


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("degrees", [4, 12, 30, 60])
def test_an_object_seen_from_a_narrow_arc_is_whole(degrees, projection):
    """No part of a rod is cut off that is ten times as long, along the lines of sight, as it is wide."""
    ring = models.donut(24, radius=0.2, tube=0.1)
    rod = MeshScene(ring.vertices * np.float32([1, 1, 30]), ring.faces)
    views = []
    for x, y in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        eye = 12 * np.array(
            [np.sin(np.radians(degrees)) * x, np.sin(np.radians(degrees)) * y, -np.cos(np.radians(degrees))]
        )
        tall = {"height": 7.0} if projection == "orthographic" else {}
        camera = Camera.look_at(eye, (0, 0, 0), (0, -1, 0), (100, 100), fov_y=40, projection=projection, **tall)
        seen = rod.capture(camera)
        views.append(ibr.Silhouette(seen.color, seen.valid, camera))
    hull = ibr.VisualHull(views, halvings=6)
    assert hull.bounds[0][2] < -3 and hull.bounds[1][2] > 3
    for view in views:
        lost = view.valid & ~ibr.render(hull, view.camera).valid
        assert lost.sum() <= 0.01 * view.valid.sum()
