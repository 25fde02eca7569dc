"""Compares simplified depth images with the meshes of pymartini, pydelatin and Open3D's quadric decimation.

Terrain is seen from above by an orthographic camera. For all libraries, rays measure the distance from each sample to
the mesh, because pymartini's nominal error is neither its mesh's error nor a bound of it.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from benchmarks.cases import Plan
from benchmarks.results import Parameter, Record, Skip
from benchmarks.runner import Case, Subject, Work
from benchmarks.scenes import relief, scanned, terrain
from pyibr.capture import MeshScene, object_views
from pyibr.core.errors import MissingPackageError
from pyibr.depthmesh.segmentation import Segmentation
from pyibr.depthmesh.selection import active_within
from pyibr.depthmesh.tree import Tree
from pyibr.depthmesh.triangulation import list_triangles

OURS, MARTINI, DELATIN, OPEN3D = "pyibr", "pymartini", "pydelatin", "Open3D"
SAME = "pyibr, at pymartini's measured error"
HIERARCHY, TRIANGLES, BOTH = "pyibr, hierarchy", "pyibr, triangles", "pyibr, depth image to triangles"
MESH, WHOLE = "pyibr, simplify", "pyibr, depth image to mesh"
MARTINI_TILE, MARTINI_MESH, MARTINI_BOTH = "pymartini, tile", "pymartini, mesh", "pymartini, tile and mesh"
BARS = {"hierarchy": 1.0, "triangles": 1.0, "delatin": 0.25}
"""Largest ratios on the Fuji tile.

Time of the hierarchy, to pymartini's time for its tile; number of triangles, to pymartini's at its measured error; time
from depth image to triangles, to pydelatin's whole run.
"""

_EXTENT = (0.0005, 0.001, 0.002, 0.004, 0.008)  # nominal errors, relative to the largest extent


@dataclass(frozen=True)
class Surface:
    """A depth image to simplify, with the nominal errors to try."""

    view: ibr.DepthImage
    segmentation: Segmentation
    errors: tuple[float, ...]  # scene units
    error: float  # for timing, one of `errors`

    @property
    def side(self) -> int:
        return self.view.camera.width


def cases(plan: Plan) -> Iterator[Case]:
    """Yield the cases of each surface, by itself and with each peer; then of decimation."""
    beside = {"errors": _ours, MARTINI: _martini, DELATIN: _delatin}
    for name, repeats in plan.simplification.items():
        for case, prepare in beside.items():
            parameters: dict[str, Parameter] = {"case": case, "surface": name}
            yield Case(parameters, functools.partial(_prepare, prepare, parameters, repeats, plan))
    for name, repeats in plan.decimation.items():
        parameters = {"case": OPEN3D, "surface": name}
        yield Case(parameters, functools.partial(_prepare, _open3d, parameters, repeats, plan))


def _prepare(prepare: Any, parameters: dict[str, Parameter], repeats: int, plan: Plan) -> Work | Skip:
    peer = {MARTINI: "pymartini", DELATIN: "pydelatin"}.get(str(parameters["case"]), "open3d")
    try:
        import_module("open3d")  # measures the errors
        module = import_module(peer)
    except ImportError as error:
        return Skip(str(parameters["case"]), str(error))
    surface = _surface(str(parameters["surface"]), plan.depthmesh_side, plan.dragon_mesh)
    return surface if isinstance(surface, Skip) else prepare(surface, parameters, repeats, module)


@functools.cache
def _surface(name: str, side: int, scan: str) -> Surface | Skip:
    """Make "fuji", "relief" (always available), "dragon" (with holes), or "dragon, filled" (with a plane behind it)."""
    if name in ("fuji", "relief"):
        # The quadtree and pymartini work best with a power of two plus one samples a side.
        heights = terrain() if name == "fuji" else (-relief(side + 1)[1], 2 / side)
        if isinstance(heights, Skip):
            return heights
        view = _from_above(*heights)
        errors = (5.0, 10.0, 20.0, 30.0, 60.0, 120.0) if name == "fuji" else tuple(2 * e for e in _EXTENT)
        return Surface(view, Segmentation("none"), errors, errors[3])
    mesh = scanned(scan)
    if isinstance(mesh, Skip):
        return mesh
    try:
        scene = MeshScene.from_mesh(mesh)
    except MissingPackageError as error:
        return Skip(name, str(error))
    filled = name == "dragon, filled"
    view = object_views(scene, side + filled, projection="orthographic" if filled else "perspective")[5]
    extent = float((view.bounds[1] - view.bounds[0]).max())
    if filled:
        depth = np.where(view.valid, view.depth, np.float32(view.depth[view.valid].max()))
        view = ibr.DepthImage(view.color, depth, view.camera)
    rule = Segmentation("none") if filled else Segmentation()
    return Surface(view, rule, tuple(extent * e for e in _EXTENT), extent * _EXTENT[2])


def _from_above(heights: NDArray[np.float32], spacing: float) -> ibr.DepthImage:
    """Make a depth image of a square grid of heights with the given spacing."""
    side, middle = len(heights), (len(heights) - 1) / 2
    K = [[1 / spacing, 0, middle], [0, 1 / spacing, middle], [0, 0, 1]]
    camera = ibr.Camera(K, (side, side), projection="orthographic")
    depth = (1.1 * heights.max() - 0.1 * heights.min() + 1 - heights).astype(np.float32)
    return ibr.DepthImage(np.zeros((side, side, 3), np.uint8), depth, camera)


def departures(view: ibr.DepthImage, vertices: NDArray[Any], faces: NDArray[Any]) -> NDArray[np.float32]:
    """Distance in depth from each valid sample to the triangle on its ray; infinite if its ray meets none.

    A ray that slips through an edge or past the border is replaced by rays a thousandth of a pixel beside it.
    """
    o3d: Any = import_module("open3d")
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.uint32))
    y, x = np.nonzero(view.valid)
    depth, camera = view.depth[y, x], view.camera
    off = np.full(len(depth), np.inf, np.float32)
    for step in ((0, 0), (1, 1), (-1, -1), (1, -1), (-1, 1)):
        pixel = np.stack([x, y], -1) + 1e-3 * np.array(step)
        one = camera.unproject(pixel, np.ones(len(pixel)))
        origin = (
            np.broadcast_to(camera.center, one.shape) if camera.projection == "perspective" else one - camera.forward
        )
        seen = scene.cast_rays(np.concatenate([origin, one - origin], 1).astype(np.float32))["t_hit"].numpy()
        off = np.minimum(off, np.abs(seen - depth))
    return off


def _errors(
    subject: str, surface: Surface, error: float, mesh: tuple[Any, Any], parameters: dict[str, Parameter]
) -> Iterator[Record]:
    """Record a mesh's number of triangles, its measured errors, and the fraction of samples whose rays meet none."""
    here = {**parameters, "error": error}
    yield Record(subject, "triangles", "count", here, [len(mesh[1])])
    off = departures(surface.view, *mesh)
    met = off[np.isfinite(off)]
    yield Record(subject, "largest error", "scene units", here, [float(met.max())])
    yield Record(subject, "rms error", "scene units", here, [float(np.sqrt(np.mean(np.square(met, dtype=np.float64))))])
    yield Record(subject, "missed", "share", here, [1 - len(met) / len(off)])


def _simplified(mesh: ibr.DepthMesh, error: float) -> tuple[Any, Any]:
    made = mesh.simplify(error)
    return made.vertices, made.faces


def _fresh(surface: Surface) -> ibr.DepthMesh:
    view = surface.view
    return ibr.DepthMesh(
        ibr.DepthImage(view.color, view.depth, view.camera, far=view.far), segmentation=surface.segmentation
    )


def _triangles(tree: Tree, error: float) -> tuple[NDArray[Any], NDArray[Any]]:
    """Points and triangles, like the output of pymartini's `get_mesh`."""
    found = list_triangles([tree], [active_within(tree, error)])
    return found.points.to_host(), found.corners.to_host()


def hierarchy(tree: Tree) -> Any:
    """Compute a tree's normals, errors and spheres at once, instead of on first use."""
    _, known = tree.normals, tree.errors
    return known["errors"].to_host()  # waits until all are computed


def _ours(surface: Surface, parameters: dict[str, Parameter], repeats: int, module: Any) -> Work:
    mesh = _fresh(surface)

    def read() -> Iterator[Record]:
        for error in surface.errors:
            yield from _errors(OURS, surface, error, _simplified(mesh, error), parameters)

    subjects: dict[str, Subject] = {
        MESH: lambda: mesh.simplify(surface.error),
        WHOLE: lambda: _fresh(surface).simplify(surface.error),
    }
    return Work(subjects, repeats, read)


def _martini(surface: Surface, parameters: dict[str, Parameter], repeats: int, module: Any) -> Work:
    """Compare with pymartini. Its set-up for a size of tile is not timed, since it serves all tiles of that size."""
    depth, error, mesh = surface.view.depth, surface.error, _fresh(surface)
    martini = module.Martini(surface.side)
    tile = martini.create_tile(depth)

    def found(error: float) -> tuple[Any, Any]:
        vertices, triangles = tile.get_mesh(error)
        x, y = np.asarray(vertices).reshape(-1, 2).T
        return surface.view.camera.unproject(np.stack([x, y], -1), depth[y, x]), np.reshape(triangles, (-1, 3))

    def read() -> Iterator[Record]:
        for nominal in surface.errors:
            records = list(_errors(MARTINI, surface, nominal, found(nominal), parameters))
            yield from records
            (measured,) = (record.values[0] for record in records if record.quantity == "largest error")
            for record in _errors(SAME, surface, measured, _simplified(mesh, measured), parameters):
                yield Record(SAME, record.quantity, record.unit, {**parameters, "error": nominal}, record.values)

    subjects: dict[str, Subject] = {
        HIERARCHY: lambda: hierarchy(_fresh(surface).tree),
        MARTINI_TILE: lambda: martini.create_tile(depth),
        TRIANGLES: lambda: _triangles(mesh.tree, error),
        MARTINI_MESH: lambda: tile.get_mesh(error),
        BOTH: lambda: _triangles(_fresh(surface).tree, error),
        MARTINI_BOTH: lambda: martini.create_tile(depth).get_mesh(error),
    }
    return Work(subjects, repeats, read)


def _delatin(surface: Surface, parameters: dict[str, Parameter], repeats: int, module: Any) -> Work:
    depth = surface.view.depth

    def run(error: float) -> tuple[Any, Any]:
        made = module.Delatin(depth, max_error=error)
        return made.vertices, made.triangles

    def read() -> Iterator[Record]:
        for error in surface.errors:
            vertices, triangles = run(error)
            pixel = np.stack([vertices[:, 0], surface.side - 1 - vertices[:, 1]], -1)
            points = surface.view.camera.unproject(pixel, vertices[:, 2])
            yield from _errors(DELATIN, surface, error, (points, triangles), parameters)

    subjects: dict[str, Subject] = {
        BOTH: lambda: _triangles(_fresh(surface).tree, surface.error),
        WHOLE: lambda: _fresh(surface).simplify(surface.error),
        DELATIN: lambda: run(surface.error),
    }
    return Work(subjects, repeats, read)


def _open3d(surface: Surface, parameters: dict[str, Parameter], repeats: int, module: Any) -> Work:
    """Decimate the full grid by quadrics to pyibr's number of triangles."""
    mesh = _fresh(surface)
    grid, geometry, utility = mesh.triangulate(surface.view.camera, tolerance=0), module.geometry, module.utility
    corners = utility.Vector3dVector(grid.vertices.astype(np.float64)), utility.Vector3iVector(np.array(grid.faces))
    full = geometry.TriangleMesh(*corners)
    counts = {error: len(mesh.simplify(error).faces) for error in surface.errors[1:4]}

    def decimated(error: float) -> Any:
        return full.simplify_quadric_decimation(counts[error])

    def read() -> Iterator[Record]:
        for error in counts:
            made = decimated(error)
            theirs = np.asarray(made.vertices), np.asarray(made.triangles)
            yield from _errors(OURS, surface, error, _simplified(mesh, error), parameters)
            yield from _errors(OPEN3D, surface, error, theirs, parameters)

    error = surface.error if surface.error in counts else next(iter(counts))
    subjects: dict[str, Subject] = {
        WHOLE: lambda: _fresh(surface).simplify(error),
        OPEN3D: lambda: decimated(error),
    }
    return Work(subjects, repeats, read)
