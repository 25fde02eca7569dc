"""Drawing depth meshes: their triangles for a target, and their colours blended (kernels/depthmesh/blend.cl)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pyibr.camera import Camera
from pyibr.depthmesh.background import background_of, underlay_of
from pyibr.depthmesh.levels import color_levels
from pyibr.depthmesh.mesh import DepthMesh
from pyibr.depthmesh.object import DepthMeshObject
from pyibr.depthmesh.triangulation import active_for, list_triangles, project_points
from pyibr.pixelspace import camera_pair
from pyibr.raster import BIN, bin_primitives
from pyibr.target import Target

if TYPE_CHECKING:
    from pyibr.opencl.memory import DeviceArray

_BLENDS = {"quality": 0, "position": 1, "nearest": 2}  # BLEND of kernels/depthmesh/blend.cl
_UNDERLAID = 2  # times as many views are looked at under the holes as are blended


@dataclass(frozen=True)
class _Colors:
    """The views' colours on the device: of each all levels, half as large as the one before, one after the other.

    `sizes` holds width, height and start of each level, `ends` numbers of the first and last level of each view.
    """

    words: DeviceArray
    sizes: DeviceArray
    ends: list[tuple[int, int]]


def _colors_of(thing: DepthMesh | DepthMeshObject, meshes: list[DepthMesh]) -> _Colors:
    from pyibr.opencl.device import current
    from pyibr.opencl.memory import upload

    kept = thing.device_cache.setdefault(current(), {})
    if "colors" not in kept:
        words, sizes = list[NDArray[np.uint32]](), list[tuple[int, int, int]]()
        ends, start = list[tuple[int, int]](), 0
        for mesh in meshes:
            first = len(sizes)
            for level in color_levels(mesh.view):
                sizes.append((*level.shape[::-1], start))
                words.append(level.ravel())
                start += level.size
            ends.append((first, len(sizes) - 1))
        kept["colors"] = _Colors(upload(np.concatenate(words)), upload(np.array(sizes, np.int32)), ends)
    return kept["colors"]


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
    active = [active_for(tree, target.camera, tolerance) for tree in trees]
    shown, underlay = chosen, None  # the view of each mesh that is drawn
    defines = {"VIEWS": len(chosen), "COLOR_BYTES": target.channel_bytes}
    more: dict[str, Any] = {}
    if several:
        defines["BLEND"] = _BLENDS[thing.blend]
    if several and thing.background:
        background = background_of(thing)
        others = sorted(order[len(chosen) : _UNDERLAID * len(chosen)])
        underlay = underlay_of(thing, chosen, others)
        shown = [*chosen, *others, *chosen]
        maps = [camera_pair(target.camera, mesh.view.camera).dst_from_src for mesh in meshes]
        perspectives = [mesh.view.camera.projection == "perspective" for mesh in meshes]
        defines |= {"UNDERLAID": len(shown) - len(chosen), "ALL": len(meshes)}
        more = {
            "limits": background.limits,
            "limit_sizes": background.sizes,
            "from_target": upload(np.array(maps, np.float32).reshape(-1, 16)),
            "perspectives": upload(np.array(perspectives, np.int32)),
        }
    triangles = list_triangles(trees, active, underlay, rated=True)
    views = [meshes[number].view for number in shown]
    projected = project_points(target.camera, views, triangles)
    colors = _colors_of(thing, meshes)
    sources = [
        (number, *colors.ends[number], view.camera.projection == "perspective")
        for number, view in zip(shown, views, strict=True)
    ]
    scales = [_focal(view.camera) / _focal(target.camera) for view in views]
    if occupancy is not None:
        defines["OCCUPIED"] = 1
        more["occupancy"] = occupancy
    near = target.near(thing.bounds)
    culled = 0 if target.from_light else 1  # backs have no colours, but cast shadows
    bins = bin_primitives(target, triangles.corners, projected, near, culled)
    launch(
        kernel("depthmesh/blend.cl", "draw_meshes", BIN=BIN, **defines),
        (bins.columns, bins.rows) if current().is_cpu else target.camera.size,
        corners=triangles.corners,
        projected=projected,
        points=triangles.points,
        list=bins.list,
        starts=bins.starts,
        bins_x=bins.columns,
        firsts=upload(np.array(triangles.firsts, np.int32)),
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
