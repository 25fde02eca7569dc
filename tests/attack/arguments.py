"""Random arguments of calls: valid, extreme and wrong. Each seed gives one call."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import pyibr as ibr
from tests import scenes

SIZES = (1, 1, 2, 3, 7, 13, 16, 17, 31, 32, 33, 48, 64, 65, 70)
WRONG: tuple[Any, ...] = (None, "wrong", -1, 0, 1.5, math.nan, math.inf, [], [[1], [1, 2]], {}, object, b"x")
WRONG += (np.zeros((2, 2)),)
LENSES = [("brown_conrady", 5), ("rational", 8), ("modified_brown_conrady", 5), ("inverse_brown_conrady", 4)]
LENSES += [("kannala_brandt", 4), ("tilted", 14)]
SCALES = (1e-30, 1e-12, 1e-9, 1e-6, 1e-3, 1e3, 1e6, 1e9, 1e12, 1e30)
STRANGE_DEPTHS = (math.nan, math.inf, -math.inf, 0.0, -0.0, -1.0, 1e-45, 1e-38, 1e-30, 1e-6, 1e6, 1e10, 1e30, 3.4e38)

EXTREMES: dict[str, tuple[float, ...]] = {
    "means": (0, 1e-30, 1e9, -1e9, 2, 3),
    "scales": (0, 1e-30, 1e-6, 1e3, 1e9),
    "rotations": (0, 1, -1, 1e-300, 1e300),
    "opacities": (0, 1e-45, 1 / 255, 0.5, 0.99, 1),
    "sh": (0, 1e-30, 1e9, -1e9, 5),
}
"""Least, largest and special values of Gaussians."""


@dataclass
class Call:
    """A call to be made later; for `warp` and `render`, its options and `out` are known, too."""

    call: Callable[[], Any]
    options: dict[str, Any] = field(default_factory=dict)
    out: Any = None


class Chance:
    """A random generator with short names for common choices."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def __call__(self, share: float) -> bool:
        return bool(self.rng.random() < share)

    def one(self, choices: Any) -> Any:
        return choices[int(self.rng.integers(len(choices)))]

    def up_to(self, most: int, least: int = 1) -> int:
        return int(self.rng.integers(least, most + 1))

    def size(self) -> tuple[int, int]:
        return self.one(SIZES), self.one(SIZES)

    def scale(self) -> float:
        """Factor by which a scene is scaled, mostly 1."""
        return self.one(SCALES) if self(0.15) else 1.0

    def mostly(self, right: Any) -> Any:
        """Return the right argument or, rarely, a wrong one."""
        return self.one(WRONG) if self(0.004) else right


def random_camera(chance: Chance, scale: float = 1.0, size: tuple[int, int] | None = None) -> ibr.Camera:
    """A camera near the origin that looks along z, or a strange one: inside the scene, behind it, far away, any K."""
    size = chance.size() if size is None else size
    longer, rng = max(size), chance.rng
    projection = "perspective" if chance(0.6) else "orthographic"
    f = longer * rng.uniform(0.5, 1.5)
    if projection == "orthographic":
        f /= 4 * scale
    K = np.array([[f, 0, (size[0] - 1) / 2], [0, f * rng.choice([1, 1, 0.9]), (size[1] - 1) / 2], [0, 0, 1]])
    pose = scenes.pose(*rng.normal(0, 8, 3), center=tuple(rng.normal(0, 0.3, 3)))
    if chance(0.2):  # special positions
        pose = scenes.pose(center=chance.one([(0, 0, 0), (0.25, 0, 0), (0, -0.25, 0), (0, 0, 0.5), (0, 0, -1)]))
    if chance(0.25):
        strange = chance.up_to(8, 0)
        if strange == 0:
            K[0, 1] = rng.normal() * f
        elif strange == 1:
            K[0, 0] *= chance.one([1e-9, 1e-3, 1e3, 1e9])
        elif strange == 2:
            K[:2, 2] += rng.normal(0, chance.one([10, 1e3, 1e9]), 2)
        elif strange == 3:
            K[:2, :2] *= chance.one([1e-30, 1e-6, 1e-2, 1e2, 1e6, 1e30])
        elif strange == 4:
            pose = scenes.pose(*rng.uniform(-180, 180, 3), center=tuple(rng.normal(0, 3, 3)))
        elif strange == 5:
            pose[:3, 3] = rng.normal(0, chance.one([1e-30, 1e-6, 1e2, 1e6, 1e15, 1e30]), 3)
        elif strange == 6:
            pose[:3, 3] = 0, 0, chance.one([2, 3, 4, 10])  # inside and behind
        elif strange == 7:
            pose = scenes.pose(chance.one([90, 180, -90]), chance.one([0, 90]), center=(0, 0, chance.one([0, 3, 6])))
    pose[:3, 3] *= scale
    bent = chance(0.15 if projection == "perspective" else 0.01)
    return ibr.Camera(K, size, pose, projection=projection, lens=random_lens(chance) if bent else None)


def random_lens(chance: Chance) -> Any:
    """A lens of any model, mostly with realistic distortion."""
    model, count = chance.one(LENSES)
    coefficients = chance.rng.normal(0, chance.one([0, 0.01, 0.01, 0.1, 0.1, 1, 1e30]), count)
    radius = chance.one([math.inf, math.inf, 1.0, 0.1, 1e-9])
    return chance.mostly(ibr.Lens(model, chance.mostly(coefficients), radius=chance.mostly(radius)))


def random_depth(chance: Chance, size: tuple[int, int], scale: float = 1.0) -> np.ndarray:
    """Depth (H, W), float32, mostly from 2 to 4.5."""
    rng, (width, height) = chance.rng, size
    y, x = np.mgrid[:height, :width]
    depth = chance.one(
        [
            lambda: np.full((height, width), 3.0),
            lambda: 3 + 0.5 * np.sin(x / 5) * np.cos(y / 7),
            lambda: np.where((x // 5 + y // 7) % 2, 2.0, 4.0),
            lambda: rng.uniform(2, 4.5, (height, width)),
            lambda: np.where(np.hypot(x - width / 2, y - height / 2) < 0.3 * max(size), 3.0, np.nan),
        ]
    )()
    depth = depth * scale
    if chance(0.4):
        some = rng.random((height, width)) < chance.one([0.01, 0.1, 0.5, 1.0])
        depth[some] = rng.choice(STRANGE_DEPTHS, some.sum()) if chance(0.5) else chance.one(STRANGE_DEPTHS)
    with np.errstate(over="ignore"):
        return depth.astype(np.float32)


def random_colors(chance: Chance, shape: tuple[int, ...], floats: bool) -> np.ndarray:
    if floats:
        return chance.rng.random((*shape, 3), np.float32)
    return chance.rng.integers(0, 256, (*shape, 3), np.uint8)


def random_view(chance: Chance, scale: float, floats: bool, colored: bool = True) -> ibr.DepthImage:
    camera = random_camera(chance, scale)
    depth = chance.mostly(random_depth(chance, camera.size, scale))
    color = chance.mostly(random_colors(chance, camera.size[::-1], floats) if colored else None)
    far = chance.one([math.inf, math.inf, math.inf, 3.5 * scale, 1e9])
    default_depth = chance.one(["farthest", 5.0 * scale, 1e30, 1e-30]) if chance(0.1) else None
    normals = random_normals(chance, camera.size) if chance(0.2) else None
    return ibr.DepthImage(color, depth, camera, far=far, normals=normals, default_depth=chance.mostly(default_depth))


def random_normals(chance: Chance, size: tuple[int, int]) -> Any:
    """Normals, mostly towards the camera, of any length; some are not valid."""
    normals = chance.rng.normal(0, 1, (size[1], size[0], 3)) * (0.5, 0.5, 0) + (0, 0, -1)
    normals[chance.rng.random(normals.shape[:2]) < 0.2] *= chance.one([0, np.nan, np.inf, 1e-30, 1e30])
    with np.errstate(over="ignore"):
        return chance.mostly(normals.astype(np.float32))


def random_look(chance: Chance) -> dict[str, Any]:
    """Options of depth images."""
    return {
        "edges": chance.mostly(chance.one(["cut", "connect"])),
        "interpolation": chance.mostly(chance.one(["linear", "nearest"])),
        "side": chance.mostly(chance.one(["front", "front", "back", "both"])),
        "fill": chance.mostly(chance.one([None, None, None, "background", "exemplar", "smooth", "inpaint"])),
        "cut_ratio": chance.mostly(chance.one([1.05, 1.05, 1.0000001, 1.5, 1e30])),
        "thin": chance.mostly(chance.one([False, False, True])),
    }


def random_warp(seed: int) -> Call:
    """Make a call of `warp` with random views, targets and options."""
    chance = Chance(seed)
    scale, floats = chance.scale(), chance(0.3)
    colored = chance(0.95)
    views = [random_view(chance, scale, floats, colored) for _ in range(chance.one([1, 1, 1, 2, 3]))]
    cameras = [random_camera(chance, scale) for _ in range(chance.one([1, 1, 1, 2]))]
    if chance(0.1):
        cameras[0] = views[0].camera
    options = random_look(chance)
    options["samples"] = chance.mostly(chance.one([1, 1, 1, 4, 9]))
    method = chance.one(["epipolar", "epipolar", "search", "forward"])
    options["method"] = chance.mostly(method)
    if method == "forward":
        options["splat"] = chance.mostly(chance.one([1.0, 2, 3.5, 64]))
        options["thin"] = chance.mostly(False)
    else:
        options["classes"] = chance(0.3)
        options["origins"] = chance.mostly(chance(0.3))
        options["blend"] = chance.mostly(chance.one(["quality", "nearest"]))
    several = len(cameras) > 1 or chance(0.1)
    out = None
    if chance(0.2):
        outs = [random_out(chance, camera, views[0].color.dtype) for camera in cameras]
        out = options["out"] = chance.mostly(outs if several else outs[0])
    given = chance.mostly(views if len(views) > 1 or chance(0.2) else views[0])
    targets = chance.mostly(cameras if several else cameras[0])
    return Call(lambda: ibr.warp(given, targets, **options), options, out)


def random_out(chance: Chance, camera: ibr.Camera, dtype: Any) -> ibr.Frame:
    """A frame to write into, with arbitrary content."""
    shape = (camera.height, camera.width)
    if chance(0.05):
        shape, dtype = chance.one([(shape[1], shape[0] + 1), shape]), chance.one([dtype, np.int16, ">f4"])
    color = np.full((*shape, 3), 7, dtype)
    depth = np.full(shape, chance.one(STRANGE_DEPTHS), np.float32)
    return ibr.Frame(color, depth, chance.rng.random(shape) < 0.5, camera)


def random_mesh(chance: Chance, scale: float, uv: bool) -> ibr.Mesh:
    """A wavy sheet at z = 3; sometimes with triangles between any vertices."""
    rng, n = chance.rng, chance.up_to(4, 2)
    y, x = np.mgrid[:n, :n] / (n - 1)
    points = np.column_stack([2 * x.ravel() - 1, 2 * y.ravel() - 1, 3 + 0.2 * np.sin(9 * x * y).ravel()])
    corner = (np.mgrid[: n - 1, : n - 1] * [[[n]], [[1]]]).sum(axis=0).ravel()
    faces = (corner[:, None] + [0, n, 1, 1, n, n + 1]).reshape(-1, 3)
    places = np.column_stack([x.ravel(), y.ravel()])
    if chance(0.25):
        points += rng.normal(0, chance.one([0, 1, 100]), points.shape)
    if chance(0.1):
        points[rng.random(len(points)) < 0.5] = points[0]  # degenerate
    if chance(0.1):
        faces = rng.integers(0, len(points), (5, 3))
    if chance(0.15):
        places = places * chance.one([0, 1e-30, -3, 100, 1e30]) + chance.one([0, 0.5, -1000])
    normals = None
    if chance(0.3):
        normals = rng.normal(0, 1, points.shape) * chance.one([1e-30, 1, 1e30])
    more: dict[str, Any] = {}
    if not uv and chance(0.4):
        more["colors"] = random_colors(chance, (len(points),), chance(0.5))
    textured = not uv and chance(0.4)
    if textured:
        more["texture"] = random_colors(chance, chance.size(), chance(0.5))
    return ibr.Mesh(
        chance.mostly(points * scale),
        chance.mostly(faces),
        uv=places if uv or textured else None,
        normals=normals,
        sides=chance.mostly(chance.one(["both", "front", "back"])),
        **more,
    )


def random_maps(chance: Chance, scale: float) -> dict[str, Any]:
    """Arguments that `SlicedSurface` and `ReliefSurface` share."""
    rng = chance.rng
    # Sizes of 8-bit maps are powers of two, sizes of other maps are not: kernels are built for either
    if chance(0.5):
        height: Any = rng.integers(0, 256, (chance.one([1, 2, 4, 16]), chance.one([1, 8, 32])), np.uint8)
    else:
        height = rng.random((chance.one([3, 7, 33]), chance.one([3, 5, 70])), np.float32)
    if chance(0.2):
        height = np.zeros_like(height)
    normal_map = None
    if chance(0.2):
        normal_map = np.dstack([rng.normal(0, 1, (5, 6, 2)), rng.uniform(0.01, 1, (5, 6))]).astype(np.float32)
    wrap = chance.one(["repeat", "clamp", ("repeat", "clamp")])
    return {
        "base": random_mesh(chance, scale, uv=True),
        "height": chance.mostly(height),
        "color": chance.mostly(random_colors(chance, chance.size(), chance(0.3))),
        "scale": chance.mostly(scale * chance.one([0.2, 0.2, 1e-9, 1e-3, 5, 1e6])),
        "tiles": chance.mostly(chance.one([(1, 1), (1, 1), (3, 2), (1000, 1)]) if wrap == "repeat" else (1, 1)),
        "normal_map": normal_map,
        "wrap": chance.mostly(wrap),
    }


def random_sliced(chance: Chance, scale: float) -> Any:
    maps = random_maps(chance, scale)
    made = ibr.SlicedSurface(
        **maps,
        slices=chance.mostly(chance.one([1, 2, 16, 64, 300, "view", "view"])),
        slicing=chance.mostly(chance.one(["orthogonal", "surface", "screen"])),
        test=chance.mostly(chance.one(["inside", "at_least", "band"])),
        halvings=chance.mostly(chance.one([0, 0, 2, 24])),
        band=chance.mostly(chance.one([None, None, 0.1, 1e-30, 1e30])),
    )
    return made.with_height(random_maps(chance, scale)["height"]) if chance(0.2) else made


def random_relief(chance: Chance, scale: float) -> Any:
    distance = chance.one(["approximate", "approximate", "exact", "exact", "perpendicular"])
    return ibr.ReliefSurface(
        **random_maps(chance, scale),
        silhouette=chance.mostly(chance.one(["quadric", "none"])),
        distance=chance.mostly(distance),
        search=chance.mostly("linear" if distance == "perpendicular" else chance.one(["safe", "linear"])),
        steps=chance.mostly(chance.one([1, 8, 32, 200])),
        halvings=chance.mostly(chance.one([0, 6, 30])),
        shadow=chance.mostly(chance.one(["map", "search"])),
    )


def views_around(chance: Chance, scale: float, floats: bool, count: int) -> list[ibr.DepthImage]:
    """Views of a ball at z = 3 from all sides; sometimes unrelated random views."""
    if chance(0.2):
        return [random_view(chance, scale, floats) for _ in range(count)]
    views = []
    for number in range(count):
        size = chance.one([(9, 7), (16, 16), (33, 31)])
        turn = scenes.pose(90 * number, chance.one([0, 0, 20]))
        turn[:3, 3] = np.array([0, 0, 3]) - 2 * turn[:3, 2]
        turn[:3, 3] *= scale
        f = size[0] * chance.one([1.0, 0.8])
        projection = "perspective"
        if chance(0.3):
            f, projection = f / (2.2 * scale), "orthographic"
        K = [[f, 0, (size[0] - 1) / 2], [0, f, (size[1] - 1) / 2], [0, 0, 1]]
        camera = ibr.Camera(K, size, turn, projection=projection)
        y, x = np.mgrid[: size[1], : size[0]]
        off = ((x - camera.K[0, 2]) / (0.45 * size[0])) ** 2 + ((y - camera.K[1, 2]) / (0.45 * size[1])) ** 2
        depth = np.where(off < 1, 2 - np.sqrt(np.maximum(1 - off, 0)), chance.one([np.nan, np.inf, 1e10, 100])) * scale
        if chance(0.2):
            depth[chance.rng.random(depth.shape) < 0.05] = chance.one(STRANGE_DEPTHS)
        with np.errstate(over="ignore"):
            views.append(ibr.DepthImage(random_colors(chance, size[::-1], floats), depth.astype(np.float32), camera))
    return views


def random_solid(chance: Chance, scale: float, floats: bool) -> Any:
    views = views_around(chance, scale, floats, chance.one([1, 2, 4]))
    more = {
        "slices": chance.mostly(chance.one([1, 7, 64, 128, "view", "view"])),
        "slicing": chance.mostly(chance.one(["orthogonal", "screen"])),
        "halvings": chance.mostly(chance.one([0, 2, 24])),
    }
    if chance(0.2):
        more["only"] = chance.mostly(chance.one([0, 3, -2, 65536]))
    more["texture"] = chance.one(["visible", "naive"])
    if chance(0.5):
        more["thin"] = chance.mostly(chance.one([False, True]))
        made = ibr.DepthObject(chance.mostly(views), missing=chance.one(["empty", "unknown"]), **more)
        others = [*views[:-1], *views_around(chance, scale, floats, 1)]
        return made.with_views(chance.mostly(others)) if chance(0.2) else made
    given: list[Any] = [ibr.Silhouette(v.color, v.depth < 3 * scale, v.camera) if chance(0.5) else v for v in views]
    made = ibr.VisualHull(chance.mostly(given), **more)
    return made.with_views(chance.mostly(given[::-1])) if chance(0.2) else made


def random_depth_mesh(chance: Chance, scale: float, floats: bool) -> Any:
    tolerance = chance.mostly(chance.one([0, 1.0, 20, 1e30]))
    if chance(0.5):
        view, errors = chance.one(views_around(chance, scale, floats, 1)), chance.mostly(chance.one(["sum", "largest"]))
        return ibr.DepthMesh(view, tolerance=tolerance, errors=errors, reuse=chance.mostly(chance.one([0, 0.1, 0.5])))
    return ibr.DepthMeshObject(
        chance.mostly(views_around(chance, scale, floats, 2)),
        tolerance=tolerance,
        blend=chance.mostly(chance.one(["quality", "position", "nearest"])),
        blended=chance.mostly(2),
        epsilon=chance.mostly(chance.one([None, 0.0, 0.1 * scale, 1e30])),
        closed=chance.mostly(chance(0.5)),
        missing=chance.mostly(chance.one(["unknown", "empty"])),
        choose=chance.mostly(chance.one(["closest", "facing"])),
        reuse=chance.mostly(chance.one([0, 0.2])),
    )


def random_gaussians(chance: Chance, scale: float) -> Any:
    """A small cloud in front of the camera; sometimes with the least and largest values, or with equal Gaussians."""
    rng, count = chance.rng, chance.one([1, 2, 15, 16, 17, 100])
    degree = chance.up_to(3, 0)
    arrays = {
        "means": scale * rng.normal((0, 0, 3), chance.one([0, 0.3, 1, 30]), (count, 3)),
        "scales": scale * np.exp(rng.normal(np.log(chance.one([0.01, 0.1, 1])), chance.one([0.1, 1, 4]), (count, 3))),
        "rotations": rng.normal(0, 1, (count, 4)),
        "opacities": rng.beta(1.2, 0.8, count),
        "sh": rng.normal(0, 0.5, (count, (degree + 1) ** 2, 3)),
    }
    for name, values in arrays.items():
        if chance(0.2):
            some = rng.random(values.shape) < chance.one([0.05, 0.5, 1.0])
            values[some] = rng.choice(EXTREMES[name], some.sum())
    if chance(0.2):
        arrays = {name: values[rng.integers(0, count, 40)] for name, values in arrays.items()}
    if chance(0.2):
        arrays["colors"] = random_colors(chance, (len(arrays.pop("sh")),), chance(0.5))
    given = {name: chance.mostly(values) for name, values in arrays.items()}
    return ibr.Gaussians(
        **given,
        low_pass=chance.mostly(chance.one([0.3, 0.3, 0, 1e-30, 1e6])),
        antialiased=chance.mostly(chance(0.3)),
        near=chance.mostly(chance.one([0.2 * scale, 0.2, 1e-6, 1e9])),
    )


def random_thing(chance: Chance, scale: float, floats: bool) -> Any:
    kind = chance.up_to(7)
    if kind == 7:
        return random_gaussians(chance, scale)
    if kind == 1:
        view = random_view(chance, scale, floats)
        if chance(0.4):
            return view
        views = [view, random_view(chance, scale, floats)] if chance(0.3) else view
        return ibr.WarpedView(views, **random_look(chance))
    if kind == 2:
        return random_mesh(chance, scale, uv=False)
    if kind == 3:
        return random_sliced(chance, scale)
    if kind == 4:
        return random_relief(chance, scale) if not floats else random_mesh(chance, scale, uv=True)
    return random_solid(chance, scale, floats) if kind == 5 else random_depth_mesh(chance, scale, floats)


def random_light(chance: Chance, scale: float) -> ibr.Light | None:
    if chance(0.5):
        return None
    kind = chance.up_to(3)
    position, direction = chance.rng.normal(0, 1, 3) * scale, chance.rng.normal(0, 1, 3)
    if chance(0.2):
        position = position * chance.one([0, 1e-30, 1e6, 1e14, 1e30]) + np.array([0, 0, 3]) * scale
        direction = direction * chance.one([1e-300, 1e-30, 1e30, 1e300])
    return ibr.Light(
        direction=chance.mostly(direction) if kind != 2 else None,
        position=chance.mostly(position) if kind != 1 else None,
        color=chance.mostly(chance.one([(1, 1, 1), (0, 0, 0), (1e6, 0, 1), (0.5, 2, 1e-30)])),
        ambient=chance.mostly(chance.one([0, 0.25, 1])),
        angle=chance.mostly(chance.one([90, 1e-3, 179.99, 125])),
        specular=chance.mostly(chance.one([0, 0.5, 1e6])),
        shininess=chance.mostly(chance.one([32, 1e-30, 1e6])),
        shadow_size=chance.mostly(chance.one([0, 2, 3, 64, 100])),
        relight=chance.mostly(chance(0.5)),
    )


def random_render(seed: int) -> Call:
    """A call of `render` with things, a camera, a light and options."""
    chance = Chance(seed)
    scale, floats = chance.scale(), chance(0.2)
    things = [random_thing(chance, scale, floats) for _ in range(chance.one([1, 1, 2, 3]))]
    camera = random_camera(chance, scale)
    options = {"samples": chance.mostly(chance.one([1, 1, 1, 4, 9]))}
    if chance(0.2):
        options["background"] = chance.mostly(chance.one([(1, 0, 0.5), (0, 0, 0), (255, 255, 255)]))
    if chance(0.4):
        options["anisotropy"] = chance.mostly(chance.one([2, 8, 64]))
    light = random_light(chance, scale)
    given = chance.mostly(things if len(things) > 1 or chance(0.5) else things[0])
    filled = [thing.fill for thing in things if isinstance(thing, ibr.WarpedView) and thing.fill is not None]
    blended = any(isinstance(thing, ibr.Gaussians) for thing in things)
    known = {**options, "fill": filled or None, "blended": blended}
    return Call(lambda: ibr.render(given, camera, light, **options), known)


def random_register(seed: int) -> Call:
    """A call of `register` or `register_color` with depth, its camera, another camera and perhaps colours."""
    chance = Chance(seed)
    scale = chance.scale()
    depth_camera, color_camera = (random_camera(chance, scale) for _ in range(2))
    depth: Any = random_depth(chance, depth_camera.size, scale)
    whole = chance(0.4)
    if whole:
        depth = np.clip(np.nan_to_num(1000 * depth.astype(float)), 0, 65535).astype(np.uint16)
    more: dict[str, Any] = {}
    colored = chance(0.5)
    if colored:
        more["color"] = chance.mostly(random_colors(chance, color_camera.size[::-1], chance(0.3)))
    if whole or chance(0.05):
        more["depth_scale"] = chance.mostly(chance.one([1000, 1000, 1, 1e-30, 1e30]))
    if chance(0.3):
        more["cut_ratio"] = chance.mostly(chance.one([1.05, 1.0000001, 1e30]))
    given = [chance.mostly(each) for each in (depth, depth_camera, color_camera)]
    return Call(lambda: (ibr.register_color if colored else ibr.register)(*given, **more))


def random_clean(seed: int) -> Call:
    """A call of `clean_depth` or `sharpen_depth` with depth and options."""
    chance = Chance(seed)
    scale, size = chance.scale(), chance.size()
    depth, more = random_depth(chance, size, scale), dict[str, Any]()
    if chance(0.5):
        more["color"] = chance.mostly(random_colors(chance, size[::-1], chance(0.4)))
    if chance(0.3):
        more["before"] = chance.mostly(random_depth(chance, size, scale))
    if chance(0.3):
        more["holes"] = chance.mostly(chance.one([0, 1, 8, 1000]))
    if chance(0.3):
        more["strength"] = chance.mostly(chance.one([0, 0.5, 1, 3, 1e-30]))
    given = chance.mostly(depth)
    return Call(lambda: ibr.clean_depth(given, **more) if more else ibr.sharpen_depth(given))


MAKERS = {"warp": random_warp, "render": random_render, "register": random_register, "clean": random_clean}
