"""Relit images, compared with ray-cast meshes that are shaded in float64."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import MeshScene, models, object_views
from pyibr.core.camera import Camera
from tests.boxes import cuboid
from tests.data import shared
from tests.embree import embree
from tests.exact import same_bits
from tests.one_lane import both_forms
from tests.shadowed import edges, first_hits, plane, true_shares

LIGHTS: dict[str, dict[str, Any]] = {
    "far": {"direction": (1, 0.6, -1.2)},
    "lamp": {"position": (-2, -3, 2.0), "ambient": 0.1, "specular": 0.4, "color": (1, 0.9, 0.8)},
    "spot": {"position": (1.5, -2.5, 2.5), "direction": (-1.5, 2.5, -2.4), "angle": 70, "ambient": 0.2},
}
PERSPECTIVE = Camera.look_at((1.5, -2.2, 2), (0, 0, 0), (0, 0, 1), (240, 180), fov_y=40)
ORTHOGRAPHIC = Camera.look_at((1.5, -2.2, 2), (0, 0, 0), (0, 0, 1), (240, 180), projection="orthographic", height=2.6)

MAKERS: dict[str, Callable[[list[ibr.DepthImage]], Any]] = {
    "depth object": lambda views: ibr.DepthObject(views, slices=256),
    "depth meshes": ibr.DepthMeshObject,
    "depth mesh": lambda views: ibr.DepthMesh(views[3]),
    "images": lambda views: views,
    "warp": ibr.WarpedView,
    "hull": lambda views: ibr.VisualHull(views, slices=128),
}


def scanned(name: str) -> ibr.Mesh:
    """Load a scan, turn it upright, and scale its longest side to 1.8."""
    made = ibr.Mesh.load(shared(f"meshes/{name}"))
    low, high = made.vertices.min(axis=0), made.vertices.max(axis=0)
    points = (made.vertices - 0.5 * (low + high)) * (1.8 / (high - low).max())
    return colored(points[:, [0, 2, 1]] * (1, -1, 1), made.faces)


def colored(vertices: np.ndarray, faces: np.ndarray) -> ibr.Mesh:
    """Colour a mesh in waves, which are independent of its shading."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    waves = np.sin(18 * (vertices - low) / (high - low).max())
    return ibr.Mesh(vertices, faces, colors=np.rint(150 + 60 * waves).astype(np.uint8))


def donut() -> ibr.Mesh:
    made = models.donut(96)
    return colored(0.7 * made.vertices[:, [0, 2, 1]], made.faces[:, ::-1])


def shaded(color: Any, normals: Any, points: Any, camera: Camera, light: ibr.Light, reached: Any = 1.0) -> np.ndarray:
    """Shade by Lambert and Blinn; returns (H, W, 3), 0 to 255. `reached` is the share of the light that arrives."""
    way = light.position - points if light.position is not None else np.broadcast_to(-light.direction, points.shape)
    way = way / np.linalg.norm(way, axis=-1, keepdims=True)
    share = np.ones(points.shape[:2]) * reached
    if light.position is not None and light.direction is not None:
        cosine = -way @ light.direction / np.linalg.norm(light.direction)
        half = np.radians(light.angle / 2)
        share = share * np.clip((cosine - np.cos(half)) / (np.cos(0.98 * half) - np.cos(half)), 0, 1)
    ahead = points - camera.center if camera.projection == "perspective" else np.broadcast_to(camera.forward, way.shape)
    between = way - ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)
    between = between / np.linalg.norm(between, axis=-1, keepdims=True)
    lambert = np.maximum((normals * way).sum(axis=-1), 0)
    along = np.maximum((normals * between).sum(axis=-1), 1e-6)
    direct = (1 - light.ambient) * share
    bright = np.where(lambert > 0, direct * light.specular * along**light.shininess, 0)[..., None] * light.color
    return np.clip(color * (light.ambient + light.color * (direct * lambert)[..., None]) + 255 * bright, 0, 255)


class Truth:
    """Ray-cast depth, colours and interpolated normals of a mesh; normals are turned towards the camera."""

    def __init__(self, mesh: ibr.Mesh, camera: Camera) -> None:
        found = embree(mesh)
        self.depth, points, own = first_hits(found, camera)
        self.points = np.where(np.isfinite(points), points, 0)
        self.camera, self.scene, self.own = camera, found, own
        rays = np.concatenate([self.points + 1e-2 * own, -own], axis=-1).astype(np.float32)
        answer = found.cast_rays(rays)
        hit = np.isfinite(self.depth)
        face = np.where(hit, answer["primitive_ids"].numpy(), 0).astype(np.int64)
        uv = answer["primitive_uvs"].numpy().astype(float)
        weight = np.stack([1 - uv.sum(axis=-1), uv[..., 0], uv[..., 1]], axis=-1)
        corner = np.array(mesh.faces)[face]
        normals = np.einsum("yxk,yxkc->yxc", weight, mesh.smooth_normals[corner].astype(float))
        normals *= np.where((normals * own).sum(axis=-1, keepdims=True) < 0, -1, 1)
        self.normals = normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-9)
        assert mesh.colors is not None
        self.color = np.einsum("yxk,yxkc->yxc", weight, mesh.colors[corner].astype(float))

    def lit(self, light: ibr.Light, reached: Any = 1.0) -> np.ndarray:
        return shaded(self.color, self.normals, self.points, self.camera, light, reached)

    def seen(self, frame: ibr.Frame) -> np.ndarray:
        """(H, W) True where the frame shows the same surface."""
        with np.errstate(invalid="ignore"):
            return frame.valid & (abs(frame.depth - self.depth) < 0.01 * self.depth)

    def seen_by(self, views: list[ibr.DepthImage]) -> np.ndarray:
        """(H, W) True where an image saw the surface, with nothing in front of it."""
        seen = np.zeros(self.depth.shape, bool)
        for view in views:
            way = view.camera.center - self.points
            if view.camera.projection == "orthographic":
                way = np.broadcast_to(-6 * view.camera.forward, way.shape)
            rays = np.concatenate([self.points + 1e-4 * self.own, way], axis=-1).astype(np.float32)
            seen |= (self.scene.cast_rays(rays)["t_hit"].numpy() > 1) & ((self.own * way).sum(axis=-1) > 0)
        return seen & np.isfinite(self.depth)


def psnr(one: np.ndarray, other: np.ndarray, which: np.ndarray) -> float:
    return float(10 * np.log10(255**2 / np.mean((one.astype(float) - other)[which] ** 2)))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("given", "projection", "camera"),
    [
        (True, "orthographic", PERSPECTIVE),
        (True, "perspective", ORTHOGRAPHIC),
        (False, "orthographic", ORTHOGRAPHIC),
        (False, "perspective", PERSPECTIVE),
    ],
)
def test_a_donut_is_relit(given, projection, camera):
    mesh = donut()
    truth, views = Truth(mesh, camera), object_views(mesh, 192, projection=projection, normals=given)
    for name, least in {"depth object": 31, "depth meshes": 40, "depth mesh": 33, "images": 40, "warp": 40}.items():
        thing = MAKERS[name](views)
        for light in LIGHTS.values():
            frame = ibr.render(thing, camera, ibr.Light(**light, shadow_size=0, relight=True))
            seen = truth.seen(frame)
            assert seen.sum() > 250
            assert psnr(frame.color, truth.lit(ibr.Light(**light)), seen) >= least, name


@cache
def scan(name: str) -> tuple[Truth, list[ibr.DepthImage]]:
    """The truth of a scan, and views of it with normals."""
    mesh = scanned(name)
    return Truth(mesh, PERSPECTIVE.resized((320, 240))), object_views(mesh, 256, normals=True)


def scan_of(name: str, given: bool) -> tuple[Truth, list[ibr.DepthImage]]:
    """`scan`, whose views have normals only if `given`."""
    truth, views = scan(name)
    return truth, views if given else [ibr.DepthImage(view.color, view.depth, view.camera) for view in views]


@pytest.mark.thorough
@pytest.mark.parametrize("given", [True, False], ids=["given", "from depths"])
def test_a_scanned_bunny_is_relit(given):
    truth, views = scan_of("bun_zipper.ply.gz", given)
    for name, least in {"depth object": 36, "depth meshes": 37, "warp": 32}.items():
        thing = MAKERS[name](views)
        for light in LIGHTS.values():
            frame = ibr.render(thing, truth.camera, ibr.Light(**light, shadow_size=0, relight=True))
            seen = truth.seen(frame)
            assert seen.sum() > 19000
            assert psnr(frame.color, truth.lit(ibr.Light(**light)), seen) >= least, name


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("given", "least"), [(True, (34, 30, 33)), (False, (31, 27, 31))], ids=["given", "from depths"]
)
def test_a_scanned_dragon_is_relit_where_images_saw_it(given, least):
    """The dragon has 871,414 triangles. Its scales are smaller than a sample, so estimated normals miss them, and the
    lamp's highlights differ. The outermost pixels are left out: which of them are covered decides about one decibel.
    """
    truth, views = scan_of("dragon_vrip.ply.gz", given)
    inside = cv2.erode(np.isfinite(truth.depth).astype(np.uint8), np.ones((3, 3))) > 0
    by_images = truth.seen_by(views) & inside
    for name in ("depth object", "depth meshes"):
        thing = MAKERS[name](views)
        for light, bar in zip(LIGHTS.values(), least, strict=True):
            frame = ibr.render(thing, truth.camera, ibr.Light(**light, shadow_size=0, relight=True))
            shown = truth.seen(frame)
            seen = shown & by_images
            assert seen.sum() > 0.98 * (shown & inside).sum() > 10500
            assert psnr(frame.color, truth.lit(ibr.Light(**light)), seen) >= bar, name


@pytest.mark.parametrize("name", ["depth object", "depth meshes", pytest.param("warp", marks=pytest.mark.thorough)])
def test_in_shadow_too(name):
    """A card above the donut casts a shadow. Its edges are left out: their errors come from the shadow map's texels."""
    mesh, card = donut(), plane(0.45, 1.1)
    floor = ibr.Mesh(0.5 * plane(4.0, -1.9).vertices, plane().faces, colors=np.full((4, 3), 200, np.uint8))
    scene, truth = embree(mesh, floor, card), Truth(mesh, PERSPECTIVE)
    depth, points, own = first_hits(scene, PERSPECTIVE)
    made = MAKERS[name](object_views(mesh, 192, normals=True))
    things = [*(made if isinstance(made, list) else [made]), floor, card]
    for light in LIGHTS.values():
        lamp = ibr.Light(**light)
        frame, plain = (
            ibr.render(things, PERSPECTIVE, ibr.Light(**light, shadow_size=512, relight=on)) for on in (True, False)
        )
        reached = true_shares(scene, lamp, np.where(np.isfinite(points), points, 0), own)
        mine = truth.seen(frame) & (depth == truth.depth)
        away = mine & ~edges(reached)
        assert 0.1 < reached[mine].mean() < 0.99
        assert away.sum() > 0.6 * mine.sum()
        assert psnr(frame.color, truth.lit(lamp, reached), away) >= 35
        flat = np.isin(np.round(points[..., 2], 4), (-0.95, 1.1)) & (abs(frame.depth - depth) < 1e-3)
        others = flat & ~edges(depth)
        assert others.sum() > 5500
        np.testing.assert_array_equal(frame.color[others], plain.color[others])  # the floor and the card


BENT = Camera(
    PERSPECTIVE.K, PERSPECTIVE.size, PERSPECTIVE.world_from_camera, lens=ibr.Lens("brown_conrady", [-0.15, 0.02, 0, 0])
)


@cache
def donuts() -> tuple[dict[Camera, Truth], list[ibr.DepthImage]]:
    """The donut's truth for a camera with a lens and one without, and views of it with normals."""
    return {camera: Truth(donut(), camera) for camera in (BENT, PERSPECTIVE)}, object_views(donut(), 192, normals=True)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "dtype"),
    [
        ("depth object", np.uint8),
        ("depth meshes", np.uint8),
        ("warp", np.uint8),
        ("depth object", np.float32),
        ("warp", np.float32),
    ],
)
def test_through_a_lens_and_by_several_samples(name, dtype):
    """Silhouettes are left out: their colours are mixed with the background."""
    truths, views = donuts()
    if dtype == np.float32:
        views = [view.in_float for view in views]
    for camera, samples in ((BENT, 1), (PERSPECTIVE, 4), (BENT, 4)):
        truth, light = truths[camera], LIGHTS["lamp"]
        frame = ibr.render(
            MAKERS[name](views), camera, ibr.Light(**light, shadow_size=0, relight=True), samples=samples
        )
        whole = np.ones(frame.valid.shape) if frame.alpha is None else frame.alpha
        inner = truth.seen(frame) & ~edges(truth.depth) & (whole == 1)  # without the ends of the images' surfaces
        color = frame.color if frame.color.dtype == np.uint8 else 255 * frame.color
        assert inner.sum() > 5500
        assert psnr(color, truth.lit(ibr.Light(**light)), inner) >= 36


@pytest.mark.parametrize("name", MAKERS)
@pytest.mark.parametrize("shadow_size", [0, 256])
def test_who_does_not_ask_gets_the_same_bits(name, shadow_size):
    """Normals of views have no effect unless a light has `relight`."""
    bare, told = (object_views(donut(), 48, normals=given) for given in (False, True))
    for light in (None, ibr.Light(direction=(1, 0.6, -1.2), shadow_size=shadow_size)):
        one, other = (ibr.render(MAKERS[name](views), PERSPECTIVE.resized((81, 61)), light) for views in (bare, told))
        same_bits(one, other)


@pytest.mark.parametrize("side", ["front", "back"])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_a_slanted_wall_by_lamberts_law(side, projection):
    """A wall is seen from either side, lit from either side, and shaded by its plane's normal or by a given normal."""
    f = 60 if projection == "perspective" else 15
    camera = Camera([[f, 0, 40], [0, f, 30], [0, 0, 1]], (81, 61), projection=projection)
    normal, bent = np.array([0.48, 0, -0.8]) / np.hypot(0.48, 0.8), np.array([0, 0.6, -0.8])
    y, x = np.mgrid[:61, :81]
    ray = np.stack([(x - 40) / f, (y - 30) / f, np.ones((61, 81))], axis=-1)
    depth = -4 * 0.8 / (ray @ normal) if projection == "perspective" else (-3.2 - ray[..., 0] * normal[0]) / normal[2]
    color, depth = np.full((61, 81, 3), 200, np.uint8), depth.astype(np.float32)
    turned = np.eye(4)
    turned[:3, :3], turned[:3, 3] = np.diag([-1.0, 1, -1]), (0, 0, 9)  # from behind
    eye = camera if side == "front" else Camera(camera.K, camera.size, turned, projection=projection)
    for normals, expected in ((None, normal), (np.broadcast_to(np.float32(bent), (61, 81, 3)), bent)):
        view = ibr.DepthImage(color, depth, camera, normals=normals)
        shown = expected if side == "front" else -expected
        for way in ((0.2, -0.3, 1), (0.3, 0.1, -1), (1, 0, 0.2)):
            light = ibr.Light(direction=way, shadow_size=0, relight=True)
            frame = ibr.render(ibr.WarpedView(view, side=side), eye, light)
            lambert = max(-shown @ np.array(way) / np.linalg.norm(way), 0)
            found = frame.color[frame.valid].astype(float)
            assert len(found) > 1000
            assert abs(found - 200 * (0.25 + 0.75 * lambert)).max() < 0.6  # bytes, and slopes that are off by 1e-4


def test_of_what_has_no_normals_the_picture_tells_them():
    """The faces of a box, drawn as a visual hull, are shaded flat."""
    corners, faces = cuboid((-0.6, -0.5, -0.4), (0.6, 0.5, 0.4))
    views = object_views(MeshScene(corners, faces, colors=np.full((8, 3), 200, np.uint8)), 96)
    outlines = [ibr.Silhouette(np.where(v.valid[..., None], v.color, np.uint8(200)), v.valid, v.camera) for v in views]
    light = ibr.Light(**LIGHTS["far"], shadow_size=0)
    frame = ibr.render(
        ibr.VisualHull(outlines, slices=256), PERSPECTIVE, ibr.Light(**LIGHTS["far"], shadow_size=0, relight=True)
    )
    depth, points, own = first_hits(embree(ibr.Mesh(corners, faces)), PERSPECTIVE)
    expected = shaded(np.full(3, 200.0), own, np.where(np.isfinite(points), points, 0), PERSPECTIVE, light)
    inner = frame.valid & np.isfinite(depth) & ~edges(own[..., 0] > 0.5) & ~edges(own[..., 2] > 0.5) & ~edges(depth)
    assert inner.sum() > 2500
    assert psnr(frame.color, expected, inner) >= 30


@pytest.mark.thorough
def test_in_one_lane_and_again():
    def every_thing() -> list[Any]:
        bare, told = (object_views(donut(), 32, normals=given) for given in (False, True))
        return [told[4], ibr.DepthObject(bare, slices=32), ibr.VisualHull(bare, slices=32)]

    light, camera = ibr.Light(**LIGHTS["lamp"], shadow_size=128, relight=True), PERSPECTIVE.resized((103, 71))
    pictures = both_forms(lambda: [[ibr.render(thing, camera, light) for _ in range(2)] for thing in every_thing()])
    for (wide, again), (one, _) in zip(*pictures, strict=True):
        assert wide.color.tobytes() == again.color.tobytes()
        assert (one.valid != wide.valid).mean() <= 2e-3
        # Rounding changes hits of slices and depth edges, and so the normals that are estimated from the picture.
        assert (np.abs(one.color.astype(int) - wide.color).max(axis=2) <= 2).mean() >= 0.985


def test_relight_is_true_or_false():
    with pytest.raises(ibr.ArgumentError, match="relight"):
        ibr.Light(direction=(0, 0, 1), relight=1)  # pyright: ignore[reportArgumentType]
