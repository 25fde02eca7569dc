"""Several depth images of one thing, blended per pixel (Pajarola, Sainz & Meng 2003, section 4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, cast
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from pyibr._check import Fixed, Float64, describe, one_of
from pyibr.camera import Camera
from pyibr.depthmesh.levels import color_levels, level_for
from pyibr.depthmesh.mesh import DepthMesh, checked_tolerance
from pyibr.depthmesh.segmentation import Segmentation
from pyibr.depthmesh.tree import (
    Triangles,
    active_for,
    active_within,
    build_tree,
    eye_of,
    place_triangles,
    triangles_of,
)
from pyibr.errors import ArgumentError
from pyibr.images import DepthImage
from pyibr.pixelspace import PixelMap
from pyibr.raster import BIN, bin_primitives, rgba_words
from pyibr.target import Target

Blend = Literal["quality", "position", "nearest"]

if TYPE_CHECKING:
    from pyibr.opencl.memory import DeviceArray

_BLENDS = {"quality": 0, "position": 1, "nearest": 2}  # BLEND of kernels/depthmesh/blend.cl
_EPSILON = 0.01  # of the largest extent
_COARSE_ERROR = 0.005  # of the largest extent: the coarse meshes' under the holes
_MOST = 32  # views that are blended: bits of an occupancy


class DepthMeshObject(Fixed):
    """Depth images of one thing as adaptive meshes, blended per pixel.

    For each target the views whose viewpoints are closest are triangulated, their nearest surfaces found, and the
    colours of those close behind the front one blended.

    Parameters
    ----------
    views : sequence of DepthImage or DepthMesh
        At any poses: six from the sides of a box around an object in the paper (`pyibr.capture.object_views`), or
        frames of a scene. Of a `DepthMesh` the segmentation is its own.
    tolerance : float
        Pixels of the target, >= 0, by which surfaces that are one may lie apart: each mesh gets half of it.
    blend : {"quality", "position", "nearest"}
        "quality" weighs views by the closeness of their viewpoints and, per pixel, by how much their surfaces face
        them; "position" by the former alone; "nearest" takes the colour of the front surface.
    blended : int
        How many views are drawn, 1 to 32: three in the paper. Fewer if there are fewer.
    epsilon : float, optional
        Scene units, >= 0: surfaces that lie less behind the front one are the same. By default 1 % of the largest
        extent of the samples.
    background : bool
        Whether coarse meshes, from which nothing is taken out, show through the holes that segmentation leaves.
    segmentation : Segmentation, optional
        For views that are no `DepthMesh`.

    Raises
    ------
    ArgumentError
        If an argument is out of its range, a view has no valid depth, or one shares no volume with the others.

    Examples
    --------
    >>> import pyibr as ibr
    >>> from pyibr import models
    >>> from pyibr.capture import object_views
    >>> thing = ibr.DepthMeshObject(object_views(models.donut(), 64))
    >>> thing
    <DepthMeshObject 6 views>
    >>> camera = ibr.Camera.look_at((0, 0, 4), (0, 0, 0), (0, 1, 0), (41, 41), fov_y=45)
    >>> frame = ibr.render(thing, camera)
    >>> bool(frame.valid[20, 32]), bool(frame.valid[20, 20])  # the ring, and the hole in it
    (True, False)
    """

    def __init__(
        self,
        views: Sequence[DepthImage | DepthMesh],
        tolerance: float = 1.0,
        blend: Blend = "quality",
        blended: int = 3,
        epsilon: float | None = None,
        background: bool = True,
        segmentation: Segmentation | None = None,
    ) -> None:
        self.meshes = _checked_meshes(views, segmentation)
        self.tolerance = checked_tolerance("tolerance", tolerance)
        one_of("blend", blend, Blend)
        self.blend: Blend = blend
        if isinstance(blended, bool) or not isinstance(blended, (int, np.integer)) or not 1 <= blended <= _MOST:  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ArgumentError("blended", f"an integer from 1 to {_MOST}", describe(blended))
        self.blended = min(int(blended), len(self.meshes))
        boxes = np.array([mesh.bounds for mesh in self.meshes])
        self.bounds: tuple[Float64, Float64] = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
        self.epsilon = _EPSILON * self.extent if epsilon is None else checked_tolerance("epsilon", epsilon)
        self.background = bool(background)
        self.device_cache: WeakKeyDictionary[Any, dict[str, Any]] = WeakKeyDictionary()

    def __repr__(self) -> str:
        return f"<DepthMeshObject {len(self.meshes)} view{'s' * (len(self.meshes) != 1)}>"

    @property
    def extent(self) -> float:
        """The largest edge of the box around the samples, in scene units."""
        return float((self.bounds[1] - self.bounds[0]).max())

    def weights(self, camera: Camera) -> Float64:
        """Positional weights of the views for a camera (section 4.2 of the paper).

        Returns
        -------
        (views,) float64
            Inverse to the distances of the viewpoints from the camera's; the `blended` largest ones, normalised, and 0
            for the others. An orthographic camera's viewpoint is as far from the object's middle as the views' are.
        """
        viewpoints = np.array([mesh.view.camera.center for mesh in self.meshes])
        middle = 0.5 * (self.bounds[0] + self.bounds[1])
        away = float(np.linalg.norm(viewpoints - middle, axis=1).mean())
        distances = np.linalg.norm(viewpoints - eye_of(camera, middle, away), axis=1)
        found = 1.0 / np.maximum(distances, 1e-6 * max(self.extent, away))
        found[np.argsort(-found, kind="stable")[self.blended :]] = 0.0
        return found / found.sum()

    def occupancy(self, camera: Camera) -> NDArray[np.uint32]:
        """Which views gave each pixel its colour: (H, W), bit k for view k (figure 12 of the paper)."""
        from pyibr.opencl.device import current
        from pyibr.opencl.memory import empty

        if not isinstance(camera, Camera):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ArgumentError("camera", "a pyibr.Camera", describe(camera))
        with current().lock:
            found = empty((camera.height, camera.width), np.uint32)
            found.fill(0)
            draw_depth_mesh(Target(camera, np.dtype(np.uint8)), self, found)
            drawn = np.array(found.to_host())
        views = np.zeros_like(drawn)
        for bit, number in enumerate(np.flatnonzero(self.weights(camera))):
            views |= (drawn >> np.uint32(bit) & np.uint32(1)) << np.uint32(number)
        return views


@dataclass(frozen=True)
class _Colors:
    """The views' colours on the device: of each all levels, half as large as the one before, one after the other.

    `sizes` holds width, height, start and number of each level of each view.
    """

    words: DeviceArray
    sizes: list[list[tuple[int, int, int, int]]]


@dataclass(frozen=True)
class _Background:
    """Each view's coarse mesh without segmentation, and up to where each has seen that there is nothing."""

    triangles: list[Triangles]
    limits: DeviceArray
    sizes: DeviceArray


def _colors_of(thing: DepthMesh | DepthMeshObject, meshes: list[DepthMesh]) -> _Colors:
    from pyibr.opencl.device import current
    from pyibr.opencl.memory import upload

    kept = thing.device_cache.setdefault(current(), {})
    if "colors" not in kept:
        words, sizes, start = list[NDArray[np.uint32]](), list[list[tuple[int, int, int, int]]](), 0
        for mesh in meshes:
            sizes.append([])
            for number, (color, covered) in enumerate(color_levels(mesh.view)):
                sizes[-1].append((color.shape[1], color.shape[0], start, number))
                words.append(rgba_words(color, covered))
                start += words[-1].size
        kept["colors"] = _Colors(upload(np.concatenate(words)), sizes)
    return kept["colors"]


def _background_of(thing: DepthMeshObject) -> _Background:
    """What shows through holes, made once (section 4.5 of the paper)."""
    from pyibr.opencl.device import current
    from pyibr.opencl.memory import upload

    kept = thing.device_cache.setdefault(current(), {})
    if "background" not in kept:
        triangles, limits = list[Triangles](), list[NDArray[np.float32]]()
        for mesh in thing.meshes:
            tree = build_tree(mesh.view, Segmentation("none"))
            (several,) = triangles_of([tree], [active_within(tree, _COARSE_ERROR * thing.extent)])
            triangles.append(_over_holes(several, mesh))
            view = mesh.view
            unseen = np.where(view.depth >= view.far, np.float32(np.inf), np.float32(0))
            limits.append(np.where(view.valid, view.depth, unseen).ravel())
        starts = np.cumsum([0, *(limit.size for limit in limits[:-1])])
        sizes = [(*mesh.view.camera.size, start) for mesh, start in zip(thing.meshes, starts, strict=True)]
        kept["background"] = _Background(triangles, upload(np.concatenate(limits)), upload(np.array(sizes, np.int32)))
    return kept["background"]


def _over_holes(triangles: Triangles, mesh: DepthMesh) -> Triangles:
    """Those of a view's triangles whose boxes hold a cell that is not drawn in full."""
    from pyibr.opencl.memory import upload

    width, height = mesh.view.camera.size
    corners = triangles.samples.to_host()[: triangles.count]
    drawn = mesh.tree.cells.to_host()[: height - 1, : width - 1] == 0b1010
    holes = np.zeros((height, width), np.int32)  # above and to the left of each sample
    holes[1:, 1:] = np.cumsum(np.cumsum(~drawn, axis=0, dtype=np.int32), axis=1)
    y, x = np.divmod(corners, width)
    low_x, low_y, high_x, high_y = x.min(axis=1), y.min(axis=1), x.max(axis=1), y.max(axis=1)
    within = holes[high_y, high_x] - holes[low_y, high_x] - holes[high_y, low_x] + holes[low_y, low_x]
    kept = np.ascontiguousarray(corners[within > 0])
    return Triangles(upload(kept if len(kept) else np.zeros((1, 3), np.int32)), len(kept))


def draw_depth_mesh(target: Target, thing: DepthMesh | DepthMeshObject, occupancy: DeviceArray | None = None) -> None:
    """Draw a depth mesh, or several blended, into the target.

    `occupancy`, (H, W) uint32, gets bit k set where the k-th of the views with a weight gave colour.
    """
    from pyibr.opencl.device import current
    from pyibr.opencl.launch import Struct, launch
    from pyibr.opencl.memory import upload
    from pyibr.opencl.program import kernel

    several = isinstance(thing, DepthMeshObject)
    meshes = thing.meshes if several else [thing]
    weights = thing.weights(target.camera) if several else np.ones(1)
    chosen = np.flatnonzero(weights)
    trees = [meshes[number].tree for number in chosen]
    tolerance = 0.5 * thing.tolerance if several else thing.tolerance
    triangles = triangles_of(trees, [active_for(tree, target.camera, tolerance) for tree in trees])
    colors, middle = _colors_of(thing, meshes), 0.5 * (thing.bounds[0] + thing.bounds[1])
    levels = [colors.sizes[number][level_for(meshes[number].view.camera, target.camera, middle)] for number in chosen]
    defines = {"VIEWS": len(chosen), "COLOR_BYTES": target.channel_bytes}
    more: dict[str, Any] = {}
    if several:
        defines["BLEND"] = _BLENDS[thing.blend]
    if several and thing.background:
        background = _background_of(thing)
        triangles += [background.triangles[number] for number in chosen]
        trees += trees
        maps = [PixelMap(target.camera, mesh.view.camera, 0.0, 0.0).dst_from_src for mesh in meshes]
        defines |= {"UNDERLAID": 1, "ALL": len(meshes)}
        more = {
            "limits": background.limits,
            "limit_sizes": background.sizes,
            "from_target": upload(np.array(maps, np.float32).reshape(-1, 16)),
            "perspectives": upload(
                np.array([mesh.view.camera.projection == "perspective" for mesh in meshes], np.int32)
            ),
        }
    if occupancy is not None:
        defines["OCCUPIED"] = 1
        more["occupancy"] = occupancy
    placed = place_triangles(target.camera, trees, triangles)
    near = target.near(thing.bounds)
    culled = 0 if target.from_light else 1  # backs have no colours, but cast shadows
    bins = bin_primitives(target, placed.corners, placed.projected, near, culled)
    launch(
        kernel("depthmesh/blend.cl", "draw_meshes", BIN=BIN, **defines),
        (bins.columns, bins.rows) if current().is_cpu else target.camera.size,
        corners=placed.corners,
        projected=placed.projected,
        places=placed.places,
        list=bins.list,
        starts=bins.starts,
        bins_x=bins.columns,
        firsts=upload(np.array(placed.firsts, np.int32)),
        sizes=upload(np.array(levels, np.int32)),
        colors=colors.words,
        weights=upload(weights[chosen].astype(np.float32)),
        screen=Struct("Screen", target.screen(near)),
        nearest_w=near,
        culled=culled,
        epsilon=thing.epsilon if several else 0.0,
        blank=target.blank,
        **target.outputs(),
        **more,
    )
    target.blank = False


def _checked_meshes(views: object, segmentation: Segmentation | None) -> list[DepthMesh]:
    if not isinstance(views, Sequence) or not views:
        raise ArgumentError("views", "a sequence of at least one view", describe(cast("object", views)))
    meshes: list[DepthMesh] = []
    for number, view in enumerate(cast("Sequence[object]", views)):
        if isinstance(view, DepthMesh):
            meshes.append(view)
        elif not isinstance(view, DepthImage):
            raise ArgumentError("views", "DepthImage or DepthMesh", f"{describe(view)} as view {number}")
        elif not view.valid.any():
            raise ArgumentError("views", "views with valid depth", f"none in view {number}")
        else:
            meshes.append(DepthMesh(view, segmentation=segmentation))
    boxes = np.array([mesh.bounds for mesh in meshes])
    for number, (low, high) in enumerate(boxes):
        meets = (boxes[:, 0] <= high).all(axis=1) & (boxes[:, 1] >= low).all(axis=1)
        if len(meshes) > 1 and meets.sum() == 1:
            raise ArgumentError("views", "views of one thing", f"view {number} shares no volume with any other")
    return meshes
