"""Compares depth meshes with the paper's tables 1 and 2, with the true models, and with the epipolar warp.

The paper (Pajarola, Sainz & Meng 2003) measured on a Pentium 4 of 2.2 GHz with a GeForce4 4600 Ti. The dragon is the
paper's model. Its "Male" and "Female" are not available, so other models of humans replace them.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from benchmarks.cases import Plan
from benchmarks.depthmesh import simplification
from benchmarks.launches import kernel_times
from benchmarks.results import Parameter, Record, Skip
from benchmarks.runner import Case, Subject, Work, in_turns
from benchmarks.scenes import scanned
from pyibr.capture import MeshScene, models, object_views
from pyibr.core.camera import Projection
from pyibr.core.errors import MissingPackageError
from pyibr.core.optional import opencv
from pyibr.depthmesh.object import Blend
from pyibr.depthmesh.segmentation import Segmentation
from pyibr.depthmesh.selection import select_for
from pyibr.depthmesh.tree import build_tree
from pyibr.depthmesh.triangulation import Triangles, list_triangles
from pyibr.images import metrics


@dataclass(frozen=True)
class Construction:
    """A row of the paper's table 1: number of triangles, and milliseconds."""

    triangles: int
    render: float
    capture: float
    quadtree: float


@dataclass(frozen=True)
class Rendering:
    """A row of the paper's table 2: tolerance in pixels, triangles, milliseconds of each stage, frames per second."""

    tolerance: float
    triangles: int
    selection: float
    depth: float
    color: float
    blend: float
    rate: float


PAPER_CONSTRUCTION = {
    "dragon": Construction(871_414, 430, 36, 405),
    "female": Construction(605_086, 811, 36, 407),
    "male": Construction(641_560, 849, 36, 408),
}
PAPER_RENDERING = {
    "dragon": Rendering(16, 30_635, 16.6, 23.3, 23.5, 0.08, 15),
    "female": Rendering(4, 29_735, 13.3, 19.9, 20.2, 0.1, 18),
    "male": Rendering(4, 22_423, 11.4, 15.9, 16.2, 0.08, 21),
}
BARS = {"selection": 5.0, "rate": 60.0, "overlap": 0.97, "tolerance": 0.5}
"""Bars for the dragon at a tolerance of 1 pixel.

Most milliseconds, fewest frames per second, least IoU of silhouettes, most dB lost compared with the full grid.
"""

CAPTURE, HIERARCHY, FRESH = "capture", "hierarchy", "fresh view and hierarchy"
FRAME, SELECTION = "frame", "selection"
STAGES = {
    "selection": ("activate", "find_triangles", "list_points", "list_triangles"),
    "projection and bins": (
        "project_points",
        "count_bins",
        "total_bins",
        "total_rows",
        "start_bins",
        "fill_bins",
        "sort_bins",
    ),
    "depth, colour and blend": ("draw_meshes",),
}
"""Kernels of a frame, by stage."""

BLENDS: tuple[Blend, ...] = ("quality", "position", "nearest")
FULL_GRID = "quality, full grid"
ANEW = "chosen for each frame"
MOVING = {
    ANEW: 0.0,
    "reuse 0.05": 0.05,
    "reuse 0.1": 0.1,
    "reuse 0.2": 0.2,
}
"""Values of `reuse`: the share of the tolerance by which triangles are chosen finer, so that later frames use them."""
MESH, MESH_FULL, WARP = "depth mesh, 1 px", "depth mesh, full grid", "epipolar warp"
FRESH_MESH, FRESH_WARP = f"{MESH}, fresh view", f"{WARP}, fresh view"

_FILES = {
    "bunny": "bun_zipper.ply.gz",
    "female": "human_female_makehuman.obj.gz",
    "male": "human_male_makehuman.obj.gz",
    "spot": "spot/spot_triangulated.obj",
}
_FRONT = (0.4, 0.3, 1.0)  # direction from the object to the camera
_KERNEL_RUNS = 5
_ORBIT = 30  # frames
_STEPS = (0.1, 0.5, 2.0)  # degrees from frame to frame
_TURN = 15.0  # degrees between a warped view and its target


def cases(plan: Plan) -> Iterator[Case]:
    """Yield the cases of tables 1 and 2, quality, the epipolar warp and moving cameras; then of simplification."""
    for name, repeats in plan.depthmesh_models.items():
        parameters: dict[str, Parameter] = {"case": "construction", "model": name}
        yield Case(parameters, functools.partial(_construction, name, repeats, plan))
    for name, repeats in plan.depthmesh_models.items():
        for tolerance in plan.depthmesh_tolerances:
            parameters = {"case": "frame", "model": name, "tolerance": tolerance}
            yield Case(parameters, functools.partial(_frames, parameters, repeats, plan))
    name, cameras = plan.depthmesh_quality
    for projection in ("perspective", "orthographic"):
        parameters = {"case": "quality", "model": name, "projection": projection}
        yield Case(parameters, functools.partial(_quality, parameters, cameras, plan))
    parameters = {"case": "warp", "model": name}
    yield Case(parameters, functools.partial(_warp, parameters, plan))
    for thing in ("DepthMesh", "DepthMeshObject"):
        for step in _STEPS:
            parameters = {"case": "moving", "model": name, "thing": thing, "degrees": step, "frames": _ORBIT}
            yield Case(parameters, functools.partial(_moving, parameters, plan))
    yield from simplification.cases(plan)


@functools.cache
def _scene(name: str, scan: str) -> MeshScene | Skip:
    mesh = models.donut(60) if name == "donut" else scanned(scan if name == "dragon" else _FILES[name])
    if isinstance(mesh, Skip):
        return mesh
    try:
        return MeshScene.from_mesh(mesh)
    except MissingPackageError as error:
        return Skip(name, str(error))


@functools.cache
def _meshes(name: str, scan: str, side: int, projection: Projection) -> list[ibr.DepthMesh] | Skip:
    """Depth meshes of the model from six sides, as in the paper."""
    scene = _scene(name, scan)
    return (
        scene
        if isinstance(scene, Skip)
        else [ibr.DepthMesh(v) for v in object_views(scene, side, projection=projection)]
    )


def _construction(name: str, repeats: int, plan: Plan) -> Work | Skip:
    scene = _scene(name, plan.dragon_mesh)
    meshes = _meshes(name, plan.dragon_mesh, plan.depthmesh_side, "perspective")
    if isinstance(scene, Skip) or isinstance(meshes, Skip):
        return scene if isinstance(scene, Skip) else Skip(name, "it has no views")
    view = meshes[5].view

    # In separate turns: these subjects allocate and free much memory, which would slow the next subject.
    others: dict[str, Subject] = {
        CAPTURE: functools.partial(scene.capture, view.camera),
        FRESH: lambda: simplification.hierarchy(ibr.DepthMesh(again(view)).tree),
    }

    def read() -> Iterator[Record]:
        parameters: dict[str, Parameter] = {"case": "construction", "model": name}
        yield Record(CAPTURE, "triangles", "count", parameters, [len(scene.faces)])
        for subject, values in in_turns(others, repeats).items():
            yield Record(subject, "end to end", "ms", parameters, values)

    return Work({HIERARCHY: lambda: simplification.hierarchy(build_tree(view, Segmentation()))}, repeats, read)


def again(view: ibr.DepthImage) -> ibr.DepthImage:
    """Copy a depth image without its cached results."""
    return ibr.DepthImage(view.color, view.depth, view.camera, far=view.far)


def _frames(parameters: dict[str, Parameter], repeats: int, plan: Plan) -> Work | Skip:
    meshes = _meshes(str(parameters["model"]), plan.dragon_mesh, plan.depthmesh_side, "perspective")
    if isinstance(meshes, Skip):
        return meshes
    tolerance = float(parameters["tolerance"])
    thing = ibr.DepthMeshObject(meshes, tolerance=tolerance)
    camera = _filled(thing, plan.depthmesh_side)
    trees = [thing.meshes[number].tree for number in np.flatnonzero(thing.weights(camera))]

    def select() -> Triangles:
        found = list_triangles(trees, select_for(trees, camera, 0.5 * tolerance).active)
        found.corners.to_host()  # waits until all triangles are listed
        return found

    def read() -> Iterator[Record]:
        covered = float(ibr.render(thing, camera).valid.mean())
        runs: list[dict[str, list[float]]] = []
        for _ in range(_KERNEL_RUNS):
            with kernel_times() as times:
                ibr.render(thing, camera)
            runs.append(dict(times))
        for stage, kernels in STAGES.items():
            values = [sum(sum(run.get(kernel, ())) for kernel in kernels) for run in runs]
            yield Record(stage, "kernels", "ms", parameters, values)
        triangles = select().firsts[-1]
        yield Record(SELECTION, "triangles", "count", parameters, [triangles])
        yield Record(FRAME, "coverage", "share", parameters, [covered])

    return Work({FRAME: functools.partial(ibr.render, thing, camera), SELECTION: select}, repeats, read)


def _moving(parameters: dict[str, Parameter], plan: Plan) -> Work | Skip:
    """Draw an orbit, with triangles chosen for each frame, and with triangles reused from earlier frames."""
    meshes = _meshes(str(parameters["model"]), plan.dragon_mesh, plan.depthmesh_side, "perspective")
    if isinstance(meshes, Skip):
        return meshes
    whole = ibr.DepthMeshObject(meshes)
    camera = _filled(whole, plan.depthmesh_side)
    middle = 0.5 * (whole.bounds[0] + whole.bounds[1])
    orbit = [_turned(camera, middle, number * float(parameters["degrees"])) for number in range(_ORBIT)]

    def moving(reuse: float) -> Subject:
        if parameters["thing"] == "DepthMesh":
            thing = ibr.DepthMesh(again(meshes[5].view), reuse=reuse)
        else:
            thing = ibr.DepthMeshObject(meshes, reuse=reuse)
        return lambda: [ibr.render(thing, one) for one in orbit]

    subjects = {name: moving(reuse) for name, reuse in MOVING.items()}

    def read() -> Iterator[Record]:
        for name, frames in subjects.items():
            with kernel_times() as times:
                frames()
            once = 1 if parameters["thing"] == "DepthMesh" else whole.blended
            yield Record(name, "chosen", "count", parameters, [len(times.get("activate", ())) / once])

    return Work(subjects, plan.depthmesh_moving, read)


def _filled(thing: ibr.DepthMeshObject, side: int) -> ibr.Camera:
    """Camera whose picture the object fills."""
    low, high = thing.bounds
    middle, edges = 0.5 * (low + high), high - low
    away = 2.2 * float(np.linalg.norm(edges))
    eye = middle + away * np.array(_FRONT) / np.linalg.norm(_FRONT)
    fov = float(np.degrees(2 * np.arctan(0.55 * edges.max() / away)))
    return ibr.Camera.look_at(eye, middle, (0, 1, 0), (side, side), fov_y=fov)


def _quality(parameters: dict[str, Parameter], count: int, plan: Plan) -> Work | Skip:
    """Compare pictures from random directions with rays cast at the model, for each way of blending."""
    name, projection = str(parameters["model"]), parameters["projection"]
    scene = _scene(name, plan.dragon_mesh)
    meshes = _meshes(
        name,
        plan.dragon_mesh,
        plan.depthmesh_side,
        "perspective" if projection == "perspective" else "orthographic",
    )
    if isinstance(scene, Skip) or isinstance(meshes, Skip):
        return scene if isinstance(scene, Skip) else Skip(name, "it has no views")
    things = {blend: ibr.DepthMeshObject(meshes, blend=blend) for blend in BLENDS}
    things |= {FULL_GRID: ibr.DepthMeshObject(meshes, tolerance=0)}
    low, high = things["quality"].bounds
    middle, away = 0.5 * (low + high), 2 * float((high - low).max())
    directions = np.random.default_rng(5).normal(size=(count, 3))

    def read() -> Iterator[Record]:
        found: dict[tuple[str, str], list[float]] = {}
        for direction in directions / np.linalg.norm(directions, axis=1, keepdims=True):
            eye, size = middle + away * direction, (plan.depthmesh_side, plan.depthmesh_side)
            camera = ibr.Camera.look_at(eye, middle, (0, 1, 0), size, fov_y=40)
            truth = scene.capture(camera)
            frames = {name: ibr.render(thing, camera) for name, thing in things.items()}
            both = np.logical_and.reduce([truth.valid, *(frame.valid for frame in frames.values())])
            for name, frame in frames.items():
                values = {
                    "PSNR": metrics.psnr(frame.color, truth.color, valid=both),
                    "SSIM": structural_similarity(frame.color, truth.color, both),
                    "silhouette (IoU)": metrics.silhouette_iou(frame.valid, truth.valid),
                }
                for quantity, value in values.items():
                    found.setdefault((name, quantity), []).append(value)
        for (name, quantity), values in found.items():
            yield Record(name, quantity, "dB" if quantity == "PSNR" else "share", parameters, values)

    return Work(read=read)


def structural_similarity(a: NDArray[Any], b: NDArray[Any], valid: NDArray[np.bool_]) -> float:
    """Mean SSIM (uint8, Gaussian window of 11 pixels) over the valid pixels; other pixels are black in both images."""
    cv2 = opencv("SSIM", "quality")  # a contributed module of OpenCV
    _, every = cv2.quality.QualitySSIM_compute(*(np.where(valid[..., None], image, np.uint8(0)) for image in (a, b)))
    return float(every[valid].mean())


def _warp(parameters: dict[str, Parameter], plan: Plan) -> Work | Skip:
    """Compare mesh and warp of one depth image, seen from 15 degrees to its side."""
    scene = _scene(str(parameters["model"]), plan.dragon_mesh)
    meshes = _meshes(str(parameters["model"]), plan.dragon_mesh, plan.depthmesh_side, "perspective")
    if isinstance(scene, Skip) or isinstance(meshes, Skip):
        return scene if isinstance(scene, Skip) else Skip(MESH, "it has no views")
    view = meshes[5].view
    camera = _aside(view, 0.5 * (scene.vertices.min(axis=0) + scene.vertices.max(axis=0)))
    fine, full = ibr.DepthMesh(view), ibr.DepthMesh(view, tolerance=0)
    subjects: dict[str, Any] = {
        MESH: functools.partial(ibr.render, fine, camera),
        MESH_FULL: functools.partial(ibr.render, full, camera),
        WARP: functools.partial(ibr.warp, view, camera, edges="cut"),
    }
    fresh: dict[str, Subject] = {
        FRESH_MESH: lambda: ibr.render(ibr.DepthMesh(again(view)), camera),
        FRESH_WARP: lambda: ibr.warp(again(view), camera, edges="cut"),
    }

    def read() -> Iterator[Record]:
        for name, values in in_turns(fresh, plan.depthmesh_warp).items():
            yield Record(name, "end to end", "ms", parameters, values)
        truth = scene.capture(camera)
        frames: dict[str, ibr.Frame] = {name: subjects[name]() for name in (MESH, MESH_FULL, WARP)}
        both = np.logical_and.reduce([truth.valid, *(frame.valid for frame in frames.values())])
        extent = float((view.bounds[1] - view.bounds[0]).max())
        for name, frame in frames.items():
            yield Record(name, "PSNR", "dB", parameters, [metrics.psnr(frame.color, truth.color, valid=both)])
            off = np.abs(frame.depth - truth.depth)[both] / extent
            yield Record(name, "median depth error", "share", parameters, [float(np.median(off))])
            yield Record(name, "depth off by over 1 %", "share", parameters, [float((off > 0.01).mean())])
            seen, total = frame.valid & truth.valid, np.count_nonzero(truth.valid)
            yield Record(name, "covered", "share", parameters, [float(seen.sum() / total)])
            yield Record(name, "beside it", "share", parameters, [float((frame.valid & ~truth.valid).sum() / total)])

    return Work(subjects, plan.depthmesh_warp, read)


def _aside(view: ibr.DepthImage, middle: NDArray[Any]) -> ibr.Camera:
    """The view's camera after a turn of 15 degrees about the object's middle."""
    return _turned(view.camera, middle, _TURN)


def _turned(camera: ibr.Camera, middle: NDArray[Any], degrees: float) -> ibr.Camera:
    """Turn a camera about the upright axis through a point."""
    angle = np.radians(degrees)
    turn = np.eye(4)
    turn[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    turn[:3, 3] = middle - turn[:3, :3] @ middle
    return ibr.Camera(camera.K, camera.size, turn @ camera.world_from_camera)
