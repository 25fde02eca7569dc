"""Drawing depth meshes: their triangles for a target, and their colours blended (kernels/depthmesh/blend.cl)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pyibr.camera import Camera
from pyibr.depthmesh.levels import color_levels
from pyibr.depthmesh.mesh import DepthMesh
from pyibr.depthmesh.object import DepthMeshObject
from pyibr.depthmesh.segmentation import Segmentation
from pyibr.depthmesh.tree import Triangles, active_for, active_within, build_tree, place_triangles, triangles_of
from pyibr.pixelspace import PixelMap
from pyibr.raster import BIN, bin_primitives, rgba_words
from pyibr.target import Target

if TYPE_CHECKING:
    from pyibr.opencl.memory import DeviceArray

_BLENDS = {"quality": 0, "position": 1, "nearest": 2}  # BLEND of kernels/depthmesh/blend.cl
_COARSE_ERROR = 0.005  # of the largest extent: the coarse meshes' under the holes
_UNDERLAID = 2  # times as many views are looked at under the holes as are blended


@dataclass(frozen=True)
class _Colors:
    """The views' colours on the device: of each all levels, half as large as the one before, one after the other.

    `sizes` holds width, height and start of each level, `ends` numbers of the first and last level of each view.
    """

    words: DeviceArray
    sizes: DeviceArray
    ends: list[tuple[int, int]]


@dataclass(frozen=True)
class _Background:
    """What shows through holes, and up to where each view has seen that there is nothing.

    `bridges` are each view's coarse triangles over the cells that segmentation took out, `surfaces` those over the
    others.
    """

    bridges: list[Triangles]
    surfaces: list[Triangles]
    limits: DeviceArray
    sizes: DeviceArray


def _colors_of(thing: DepthMesh | DepthMeshObject, meshes: list[DepthMesh]) -> _Colors:
    from pyibr.opencl.device import current
    from pyibr.opencl.memory import upload

    kept = thing.device_cache.setdefault(current(), {})
    if "colors" not in kept:
        words, sizes = list[NDArray[np.uint32]](), list[tuple[int, int, int]]()
        ends, start = list[tuple[int, int]](), 0
        for mesh in meshes:
            first = len(sizes)
            for color, covered in color_levels(mesh.view):
                sizes.append((color.shape[1], color.shape[0], start))
                words.append(rgba_words(color, covered))
                start += words[-1].size
            ends.append((first, len(sizes) - 1))
        kept["colors"] = _Colors(upload(np.concatenate(words)), upload(np.array(sizes, np.int32)), ends)
    return kept["colors"]


def _background_of(thing: DepthMeshObject) -> _Background:
    """What shows through holes, made once (section 4.5 of the paper)."""
    from pyibr.opencl.device import current
    from pyibr.opencl.memory import upload

    kept = thing.device_cache.setdefault(current(), {})
    if "background" not in kept:
        bridges, surfaces, limits = list[Triangles](), list[Triangles](), list[NDArray[np.float32]]()
        for mesh in thing.meshes:
            trees = build_tree(mesh.view, Segmentation("none")), mesh.tree
            coarse = triangles_of(trees, [active_within(tree, _COARSE_ERROR * thing.extent) for tree in trees])
            bridges.append(_over_holes(coarse[0], mesh))
            surfaces.append(coarse[1])
            view = mesh.view
            unseen = np.where(view.depth >= view.far, np.float32(np.inf), np.float32(0))
            limits.append(np.where(view.valid, view.depth, unseen).ravel())
        starts = np.cumsum([0, *(limit.size for limit in limits[:-1])])
        sizes = [(*mesh.view.camera.size, start) for mesh, start in zip(thing.meshes, starts, strict=True)]
        limits_of_all, sizes_of_all = upload(np.concatenate(limits)), upload(np.array(sizes, np.int32))
        kept["background"] = _Background(bridges, surfaces, limits_of_all, sizes_of_all)
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

    `occupancy`, (H, W) uint32, gets bit k set where view k gave colour.
    """
    from pyibr.opencl.device import current
    from pyibr.opencl.launch import Struct, launch
    from pyibr.opencl.memory import upload
    from pyibr.opencl.program import kernel

    several = isinstance(thing, DepthMeshObject)
    meshes = thing.meshes if several else [thing]
    closeness = thing.closeness(target.camera) if several else np.ones(1)
    order: list[int] = np.argsort(-closeness, kind="stable").tolist()
    chosen = sorted(order[: thing.blended]) if several else order
    trees = [meshes[number].tree for number in chosen]
    tolerance = 0.5 * thing.tolerance if several else thing.tolerance
    triangles = triangles_of(trees, [active_for(tree, target.camera, tolerance) for tree in trees])
    shown = chosen  # the view of each mesh that is drawn
    defines = {"VIEWS": len(chosen), "COLOR_BYTES": target.channel_bytes}
    more: dict[str, Any] = {}
    if several:
        defines["BLEND"] = _BLENDS[thing.blend]
    if several and thing.background:
        background = _background_of(thing)
        others = sorted(order[len(chosen) : _UNDERLAID * len(chosen)])
        triangles += [background.bridges[number] for number in chosen]
        triangles += [background.surfaces[number] for number in others]
        shown = [*chosen, *chosen, *others]
        trees = [meshes[number].tree for number in shown]
        maps = [PixelMap(target.camera, mesh.view.camera, 0.0, 0.0).dst_from_src for mesh in meshes]
        perspectives = [mesh.view.camera.projection == "perspective" for mesh in meshes]
        defines |= {"UNDERLAID": len(shown) - len(chosen), "ALL": len(meshes)}
        more = {
            "limits": background.limits,
            "limit_sizes": background.sizes,
            "from_target": upload(np.array(maps, np.float32).reshape(-1, 16)),
            "perspectives": upload(np.array(perspectives, np.int32)),
        }
    colors = _colors_of(thing, meshes)
    sources = [(number, *colors.ends[number]) for number in shown]
    scales = [_focal(meshes[number].view.camera) / _focal(target.camera) for number in shown]
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
        sources=upload(np.array(sources, np.int32)),
        levels=colors.sizes,
        scales=upload(np.array(scales, np.float32)),
        colors=colors.words,
        weights=upload((closeness[shown] / closeness.max()).astype(np.float32)),
        screen=Struct("Screen", target.screen(near)),
        nearest_w=near,
        culled=culled,
        epsilon=thing.epsilon if several else 0.0,
        blank=target.blank,
        **target.outputs(),
        **more,
    )
    target.blank = False


def _focal(camera: Camera) -> float:
    """Pixels that a scene unit takes at depth 1, or everywhere."""
    return float(np.sqrt(camera.K[0, 0] * camera.K[1, 1]))
