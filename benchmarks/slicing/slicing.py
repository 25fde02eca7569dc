"""Compares objects and surfaces that are drawn by slices with the paper's figures, with Mesa's llvmpipe and with rays.

The paper's figure 12 shows a creature at several sizes and numbers of slices on a GeForce 2 GTS; here a scanned dragon
replaces it. llvmpipe draws the slices as quadrilaterals, front to back, and discards fragments outside the object.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from benchmarks import llvmpipe
from benchmarks.cases import Plan
from benchmarks.results import Parameter, Record, Skip
from benchmarks.runner import Case, Subject, Work
from benchmarks.scenes import bumps, scanned
from pyibr.capture import MeshScene, models, object_views
from pyibr.slicing import alpha_tests

OBJECT, HULL = "depth object", "visual hull"
PEER = {OBJECT: "depth object, llvmpipe", HULL: "visual hull, llvmpipe"}
PAPER = {(150, 70): 24.0, (400, 150): 2.7}
"""The paper's frames per second on a GeForce 2 GTS, by the picture's side in pixels and by slices (section 6)."""
PAPER_DONUT = (35.0, 41.0)  # frames per second, 15 to 25 slices
BARS = {"object": 0.6, "donut": 60.0}  # ratio to llvmpipe at 300 x 300 and 128 slices; frames per second
BAR_AT = (300, 128)
DONUT_SIZE, DONUT_SLICES = (640, 480), 20
DIRECTIONS = ("surface", "orthogonal", "screen")
UNCLIPPED = "screen, unclipped"
SCALE = 0.2  # greatest displacement of a unit square, in scene units

_SCALE = 0.15  # length of the donut's longest hairs, in scene units
_IMAGES = 512  # pixels per side of the six images


def cases(plan: Plan) -> Iterator[Case]:
    """Yield the cases of objects, of the donut, and of each direction of slicing."""
    for (n, slices), repeats in plan.slicing.items():
        parameters: dict[str, Parameter] = {"case": "object", "size": n, "slices": slices}
        yield Case(parameters, functools.partial(_objects, parameters, n, slices, repeats, plan.dragon_mesh))
    yield Case({"case": "mesh"}, functools.partial(_against_mesh, plan.dragon_mesh))
    yield Case({"case": "donut"}, functools.partial(_donut, plan.donut))
    for elevation in plan.elevations:
        for slices in plan.direction_slices:
            parameters = {"case": "directions", "elevation": elevation, "slices": slices}
            yield Case(parameters, functools.partial(_directions, parameters, elevation, slices))


@functools.cache
def _views(scan: str) -> list[ibr.DepthImage] | Skip:
    mesh = scanned(scan)
    if isinstance(mesh, Skip):
        return mesh
    return object_views(MeshScene(mesh.vertices, mesh.faces), _IMAGES)


def _objects(parameters: dict[str, Parameter], n: int, slices: int, repeats: int, scan: str) -> Work | Skip:
    views = _views(scan)
    if isinstance(views, Skip):
        return views
    if isinstance(gl := llvmpipe.context(), str):
        return Skip(PEER[OBJECT], gl)
    things = {OBJECT: ibr.DepthObject(views, slices=slices), HULL: ibr.VisualHull(views, slices=slices)}
    box = things[OBJECT].box
    away = 2.2 * float(np.linalg.norm(box.edges))
    eye = box.center + away * np.array([0.4, 0.3, 1.0]) / np.linalg.norm([0.4, 0.3, 1.0])
    fov = np.degrees(2 * np.arctan(0.55 * box.edges.max() / away))  # the object fills the picture
    camera = ibr.Camera.look_at(eye, box.center, (0, 1, 0), (n, n), fov_y=fov)
    peers = {name: llvmpipe.slices(camera, thing, 0.3 * away, 2 * away) for name, thing in things.items()}
    subjects: dict[str, Subject] = {}
    for name, thing in things.items():
        subjects[name] = functools.partial(ibr.render, thing, camera)
        subjects[PEER[name]] = peers[name].picture

    def read() -> Iterator[Record]:
        for name, thing in things.items():
            ours, theirs = ibr.render(thing, camera).valid, np.isfinite(peers[name].picture()[1])
            yield Record(name, "coverage", "share", parameters, [float(ours.mean())])
            yield Record(name, "agreement with llvmpipe (IoU)", "share", parameters, [_iou(ours, theirs)])
            tests = float(alpha_tests(thing, camera).sum())
            yield Record(name, "alpha tests", "samples", parameters, [tests])

    return Work(subjects, repeats, read)


def _against_mesh(scan: str) -> Work | Skip:
    """Compare the dragon's depth object, with either texture, and its hull with the scanned mesh, from three sides."""
    mesh, views = scanned(scan), _views(scan)
    if isinstance(mesh, Skip) or isinstance(views, Skip):
        return mesh if isinstance(mesh, Skip) else Skip("mesh", "it has no views")
    scene = MeshScene(mesh.vertices, mesh.faces)
    things: dict[str, ibr.DepthObject | ibr.VisualHull] = {
        "visible": ibr.DepthObject(views, slices=256),
        "naive": ibr.DepthObject(views, slices=256, texture="naive"),
        "hull": ibr.VisualHull(views, slices=256),
    }
    box = things["visible"].box
    frames: dict[str, list[tuple[ibr.Frame, ibr.DepthImage]]] = {name: [] for name in things}
    for side in ((0.5, 0.35, 1.0), (-1.0, 0.5, 0.4), (0.6, 0.8, -0.9)):
        away = 2.2 * np.linalg.norm(box.edges) * np.array(side) / np.linalg.norm(side)
        camera = ibr.Camera.look_at(box.center + away, box.center, (0, 1, 0), (480, 360), fov_y=28)
        truth = scene.capture(camera)
        for name, thing in things.items():
            frames[name].append((ibr.render(thing, camera), truth))

    def read() -> Iterator[Record]:
        parameters: dict[str, Parameter] = {"case": "mesh"}
        for name, pairs in frames.items():
            yield Record(name, "silhouette (IoU)", "share", parameters, [_iou(f.valid, t.valid) for f, t in pairs])
            errors: list[float] = []
            for frame, truth in pairs:
                both = frame.valid & truth.valid
                squared = np.square(frame.color.astype(float) - truth.color)[both].mean()
                errors.append(float(10 * np.log10(255**2 / squared)))
            yield Record(name, "colour (PSNR)", "dB", parameters, errors)

    return Work(read=read)


def _iou(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
    return float((a & b).sum() / (a | b).sum())


def _donut(repeats: int) -> Work:
    """Time fur on the paper's donut."""
    rng = np.random.default_rng(1)
    fur = (rng.random((64, 64)) ** 3).astype(np.float32)
    color = np.repeat((60 + 190 * fur[..., None]).astype(np.uint8), 3, axis=2)
    camera = ibr.Camera.look_at((1.7, -2.8, 2.2), (0, 0, 0), (0, 0, 1), DONUT_SIZE, fov_y=45)
    surfaces: dict[str, ibr.SlicedSurface] = {}
    for name in (*DIRECTIONS, UNCLIPPED):
        slicing: Any = name.split(",")[0]
        surfaces[name] = ibr.SlicedSurface(
            models.donut(),
            fur,
            color,
            _SCALE,
            tiles=(8, 4),
            slices=DONUT_SLICES,
            slicing=slicing,
            clipped=name != UNCLIPPED,
        )

    base = models.donut(25)
    parameters: dict[str, Parameter] = {"case": "donut"}

    def read() -> Iterator[Record]:
        for name, surface in surfaces.items():
            covered = float(ibr.render(surface, camera).valid.mean())
            yield Record(name, "coverage", "share", parameters, [covered])
            yield Record(name, "alpha tests", "samples", parameters, [float(alpha_tests(surface, camera).sum())])
            memory = fur.nbytes + base.vertices.nbytes + base.faces.nbytes
            yield Record(name, "memory", "bytes", parameters, [memory])

    subjects: dict[str, Subject] = {
        name: functools.partial(ibr.render, surface, camera) for name, surface in surfaces.items()
    }
    return Work(subjects, repeats, read)


def _directions(parameters: dict[str, Parameter], elevation: int, slices: int) -> Work | Skip:
    try:
        camera, truth, inside = _truth(elevation)
    except ibr.MissingPackageError as error:
        return Skip("the directions of slicing", str(error))

    def read() -> Iterator[Record]:
        for slicing in DIRECTIONS:
            color: NDArray[Any] = np.full((1, 1, 3), 200, np.uint8)
            # The test "inside" would discard the border, whose heights are 0.
            surface = ibr.SlicedSurface(
                _square(), bumps(64), color, SCALE, slices=slices, slicing=slicing, test="at_least"
            )
            frame = ibr.render(surface, camera)
            off = np.abs(frame.depth - truth)[inside & frame.valid] / (SCALE / slices)
            yield Record(slicing, "depth error", "spacings", parameters, [float(off.mean())])
            through = float((~frame.valid)[inside].mean())
            yield Record(slicing, "seen through", "share", parameters, [through])

    return Work(read=read)


def _square() -> ibr.Mesh:
    corners, uv = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 0], [1, 0], [1, 1], [0, 1]]
    return ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3]], uv=uv)


@functools.cache
def _truth(elevation: int) -> tuple[ibr.Camera, NDArray[Any], NDArray[np.bool_]]:
    """A camera at an elevation in degrees, its true depth, and the mask of pixels 3 or more away from depth edges."""
    import cv2

    fine, height = 8, bumps(64)
    n = fine * len(height)
    ticks = (np.arange(n + 1) / n).astype(np.float32)
    u, v = np.meshgrid(ticks, ticks)
    # cv2.remap interpolates between texel centres as slices do; the map is 0 at its border, so repeating has no effect.
    ring = cv2.copyMakeBorder(height, 1, 1, 1, 1, cv2.BORDER_WRAP)
    top = SCALE * cv2.remap(ring, u * len(height) + 0.5, v * len(height) + 0.5, cv2.INTER_LINEAR)
    y, x = np.mgrid[:n, :n]
    i = (y * (n + 1) + x).ravel()
    faces = np.concatenate([np.stack([i, i + 1, i + n + 2], 1), np.stack([i, i + n + 2, i + n + 1], 1)])
    scene = MeshScene(np.stack([u, v, top], -1).reshape(-1, 3), faces)
    e, d = np.radians(elevation), np.radians(30)
    away = np.array([np.cos(e) * np.cos(d), np.cos(e) * np.sin(d), np.sin(e)])
    middle = np.array([0.5, 0.5, 0.5 * SCALE])
    camera = ibr.Camera.look_at(middle + 2.2 * away, middle, (0, 0, 1) if e < 1.5 else (0, 1, 0), (320, 240), fov_y=36)
    truth = scene.capture(camera).depth
    known = np.where(np.isfinite(truth), truth, 1e3).astype(np.float32)
    window = np.ones((7, 7), np.uint8)
    inside = np.isfinite(truth) & (cv2.dilate(known, window) - cv2.erode(known, window) < 0.05)
    return camera, truth, inside
