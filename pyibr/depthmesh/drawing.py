"""Drawing depth meshes: their triangles for a target, and their colours blended (kernels/depthmesh/blend.cl)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import Fixed, Float64
from pyibr.core.pixelspace import camera_pair, pixel_size
from pyibr.depthmesh.closing import Closing, DrawnViews, may_show_its_back, underlay_of
from pyibr.depthmesh.far_sides import ViewMesh
from pyibr.depthmesh.levels import color_levels
from pyibr.depthmesh.selection import Selection, select_for
from pyibr.depthmesh.tree import Tree
from pyibr.depthmesh.triangulation import Triangles, list_triangles, project_points
from pyibr.images.depth_image import DepthImage
from pyibr.opencl.device import current
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.headers import constant, struct
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, empty, upload
from pyibr.opencl.program import kernel
from pyibr.picture.deferred import NO_ENTRY, Entry, entry_for
from pyibr.picture.normals import noise_bias, showing_normals
from pyibr.picture.shadow import Lighting
from pyibr.picture.target import Target
from pyibr.raster.bins import bin_primitives, bin_side, culled, region_side

Bounds = tuple[Float64, Float64]


@dataclass(frozen=True)
class _Colors:
    """The views' colours on the device: of each all levels, half as large as the one before, one after the other.

    `sizes` holds width, height and start of each level, `ends` numbers of the first and last level of each view.
    `behind`, if holes are closed: of each view those that its depth edges' far sides go on with.
    """

    words: DeviceArray
    sizes: DeviceArray
    ends: list[tuple[int, int]]
    behind: DeviceArray | None


@dataclass(frozen=True)
class Blending:
    """Blending of several views' meshes into one picture.

    Attributes
    ----------
    by : str
        Of the names of `Blend`.
    order : list of int
        The views, those first that are to be drawn.
    closeness : (views,) float64
        Of the views to the target's, in 1 / scene units: their weights.
    count : int
        How many of the first views are blended.
    epsilon : float
        Scene units by which surfaces that are the same may lie behind the front one.
    background : Background, optional
        What shows through holes.
    gains : (views, 3) float64, optional
        What the views' colours are multiplied by.
    """

    by: str
    order: list[int]
    closeness: Float64
    count: int
    epsilon: float
    background: Closing | None
    gains: Float64 | None


def _colors_of(views: Sequence[DepthImage], gains: Float64 | None, background: Closing | None) -> _Colors:
    words, sizes = list[NDArray[np.uint32]](), list[tuple[int, int, int]]()
    ends, start = list[tuple[int, int]](), 0
    for number, view in enumerate(views):
        first = len(sizes)
        for level in color_levels(view, None if gains is None else gains[number]):
            sizes.append((*level.shape[::-1], start))
            words.append(level)
            start += level.size
        ends.append((first, len(sizes) - 1))
    behind = None
    if background is not None:
        behind = [one.colored(words[first]) for one, (first, _) in zip(background.continued, ends, strict=True)]
    return _Colors(_joined(words), upload(np.array(sizes, np.int32)), ends, None if behind is None else _joined(behind))


def _joined(images: Sequence[NDArray[np.uint32]]) -> DeviceArray:
    return upload(np.concatenate([image.ravel() for image in images]))


def _colors_and_normals(
    thing: Fixed, views: Sequence[DepthImage], blending: Blending | None, with_normals: bool
) -> tuple[_Colors, dict[str, DeviceArray]]:
    """The views' colours, and, where they are asked for, the kernel's arguments of their normals in the same form."""
    background, gains = (None, None) if blending is None else (blending.background, blending.gains)
    colors = cached_on_device(thing, "colors", lambda: _colors_of(views, gains, background))
    if not with_normals:
        return colors, {}
    normals = cached_on_device(
        thing, "normals", lambda: _colors_of(list(map(showing_normals, views)), None, background)
    )
    return colors, {"normals": normals.words} | ({} if normals.behind is None else {"far_normals": normals.behind})


def draw_depth_meshes(
    target: Target,
    thing: Fixed,
    meshes: Sequence[ViewMesh],
    tolerance: float,
    bounds: Bounds,
    blending: Blending | None = None,
    occupancy: DeviceArray | None = None,
    reuse: float = 0.0,
    entry: Entry = NO_ENTRY,
) -> None:
    """Draw the mesh of a view, or those of several, blended, into the target.

    Parameters
    ----------
    target : Target
    thing : Fixed
        That keeps its colours on the device.
    meshes : sequence of ViewMesh
    tolerance : float
        Pixels by which each mesh may lie off its surface.
    bounds : (low, high)
        In the world.
    blending : Blending, optional
        Of several meshes.
    occupancy : DeviceArray (H, W) uint32, optional
        Gets bit k set where view k gave colour.
    reuse : float
        Of `pyibr.depthmesh.selection.Selection`.
    entry : Entry
        Of a picture in a light.
    """
    closeness = np.ones(1) if blending is None else blending.closeness
    order, count = ([0], 1) if blending is None else (blending.order, blending.count)
    backs = [n for n in order[:count] if may_show_its_back(meshes[n].view.camera, target.camera, bounds)]
    shown = DrawnViews.of(order, count, backs)
    trees = [meshes[number].tree for number in shown.chosen]
    colors, normals = _colors_and_normals(thing, [mesh.view for mesh in meshes], blending, entry.normals)
    underlay, drawn, colored = None, shown.chosen, shown.chosen  # views of all meshes, and of those with colours
    counts = 0, 0, 0, len(shown.chosen)
    defines, more = {**target.color_defines, **entry.defines}, dict[str, Any]()
    if blending is not None and blending.background is not None:
        underlay, drawn, colored = underlay_of(blending.background, shown), shown.views, [*shown.others, *shown.chosen]
        counts = len(colored), len(shown.around), len(shown.others), len(shown.chosen)
        defines["CLOSED"] = 1
        more = _seen_empty(target.camera, meshes, blending, blending.background, colors)
    triangles = _triangles_for(target, thing, trees, underlay, tolerance, reuse)
    projected = project_points(target.camera, [meshes[number].view for number in drawn], triangles)
    more |= normals | entry.arguments
    more |= _colored(target.camera, [meshes[number].view for number in colored], colored, colors)
    if occupancy is not None:
        defines["OCCUPIED"] = 1
        more["occupancy"] = occupancy
    near = target.near(bounds)
    sides = "both" if target.from_light else "front"  # backs have no colours, but cast shadows
    bins = bin_primitives(target, triangles.corners, projected, near, sides)
    by = "quality" if blending is None else blending.by
    items = min(current().profile.drawers, math.prod(bins.grid))
    layers = len(colored), items, region_side() ** 2
    launch(
        kernel("depthmesh/blend.cl", "draw_meshes", BIN=bin_side(), **defines),
        (items,),
        corners=triangles.corners,
        points=triangles.points,
        firsts=upload(np.array(triangles.firsts, np.int32)),
        weights=upload((closeness[colored] / closeness.max()).astype(np.float32)),
        culled=culled(sides),
        epsilon=0.0 if blending is None else blending.epsilon,
        blank=target.blank,
        counts=Struct("MeshCounts", np.array(counts, struct("depthmesh/blend.cl", "MeshCounts"))),
        by=int(constant("depthmesh/blend.cl", f"BLEND_{by.upper()}")),
        layer_nearness=empty(layers, np.float32),
        layer_owner=empty(layers, np.int32),
        items=items,
        **bins.arguments,
        **target.outputs(),
        **more,
    )
    target.blank = False


@dataclass(frozen=True)
class _CachedTriangles:
    """Triangles, what they follow, and for how long they hold."""

    trees: list[Tree]
    underlay: Triangles | None
    selections: list[Selection]
    triangles: Triangles

    def holds_for(self, camera: Camera, trees: list[Tree], underlay: Triangles | None) -> bool:
        same = len(trees) == len(self.trees) and all(a is b for a, b in zip(trees, self.trees, strict=True))
        return same and underlay is self.underlay and all(one.holds_for(camera) for one in self.selections)


def _cached_for(
    camera: Camera, trees: list[Tree], underlay: Triangles | None, tolerance: float, reuse: float
) -> _CachedTriangles:
    selections = [select_for(tree, camera, tolerance, reuse) for tree in trees]
    marks = [selection.active for selection in selections]
    return _CachedTriangles(trees, underlay, selections, list_triangles(trees, marks, underlay, rated=True))


def _triangles_for(
    target: Target, thing: Fixed, trees: list[Tree], underlay: Triangles | None, tolerance: float, reuse: float
) -> Triangles:
    """The triangles for a target, after those of the underlay: those drawn last, if they hold for it."""
    if not reuse or target.from_light:
        return _cached_for(target.camera, trees, underlay, tolerance, 0.0).triangles
    latest = cached_on_device(thing, "latest triangles", list[_CachedTriangles])
    # At each launch another thread may have its turn: what is found is put there whole.
    found = latest[0] if latest else None
    if found is None or not found.holds_for(target.camera, trees, underlay):
        found = _cached_for(target.camera, trees, underlay, tolerance, reuse)
        latest[:] = [found]
    return found.triangles


def _colored(camera: Camera, views: list[DepthImage], shown: list[int], colors: _Colors) -> dict[str, DeviceArray]:
    """The colours of each mesh's view, and where in them to look."""
    sources = [
        (number, *colors.ends[number], view.camera.projection == "perspective")
        for number, view in zip(shown, views, strict=True)
    ]
    scales = [_focal(view.camera) / _focal(camera) for view in views]
    return {
        "colors": colors.words,
        "levels": colors.sizes,
        "sources": upload(np.array(sources, np.int32)),
        "scales": upload(np.array(scales, np.float32)),
    }


def _seen_empty(
    camera: Camera, meshes: Sequence[ViewMesh], blending: Blending, background: Closing, colors: _Colors
) -> dict[str, Any]:
    """Kernel arguments of the free space that each view has seen, and of the colours behind it."""
    maps = [camera_pair(camera, mesh.view.camera).dst_from_src for mesh in meshes]
    perspectives = [mesh.view.camera.projection == "perspective" for mesh in meshes]
    return {
        "free_depths": background.limits,
        "extended_depths": background.behind,
        "far_colors": colors.behind,
        "cell_free_depths": background.clear,
        "cell_extended_depths": background.open,
        "view_sizes": background.sizes,
        "from_target": upload(np.array(maps, np.float32).reshape(-1, 16)),
        "perspectives": upload(np.array(perspectives, np.int32)),
        "first_levels": upload(np.array([first for first, _ in colors.ends], np.int32)),
        "closeness": upload((blending.closeness / blending.closeness.max()).astype(np.float32)),
        "stride": background.stride,
        "view_count": len(meshes),
        "enclosed": background.enclosed,
    }


def entry_of_meshes(
    target: Target, lighting: Lighting | None, views: Sequence[DepthImage], tolerance: float, bounds: Bounds
) -> Entry:
    """Enter the meshes of views among what is lit afterwards; a light sees other triangles, and the views' noise."""
    if lighting is None:
        return NO_ENTRY
    low, high = bounds
    middle = 0.5 * (low + high)
    noise, apart = noise_bias(views, target.camera, middle)
    bias = tolerance * pixel_size(target.camera, middle) + noise
    return entry_for(target, lighting, bias=bias, apart=apart, normals=True)


def _focal(camera: Camera) -> float:
    """Pixels that a scene unit takes at depth 1, or everywhere."""
    return float(np.sqrt(camera.K[0, 0] * camera.K[1, 1]))
