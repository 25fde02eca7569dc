"""Drawing of depth meshes: triangles for a target, and blended colours (kernels/depthmesh/blend.cl)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64, Immutable
from pyibr.core.pixelspace import camera_pair, pixel_size
from pyibr.depthmesh.closing import Closed, Closing
from pyibr.depthmesh.levels import feathers_of, view_colors
from pyibr.depthmesh.selection import CHUNK
from pyibr.depthmesh.tree import Tree
from pyibr.depthmesh.triangulation import projected_triangles
from pyibr.depthmesh.viewpoints import DrawnViews
from pyibr.opencl.ahead import build_ahead
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
from pyibr.raster.bins import bin_defines, bin_primitives

Bounds = tuple[Float64, Float64]


@dataclass(frozen=True)
class Blending:
    """Blending of several views' meshes into one picture."""

    by: str  # a name from `Blend`
    drawn: DrawnViews
    closeness: Float64  # (views,) of their viewpoints to the target's, in 1 / scene units: their weights
    epsilon: float  # as for `DepthMeshObject`, in scene units
    share: float = 0.5  # of the tolerance for each mesh: two meshes of one surface may deviate to opposite sides
    closing: Closing | None = None  # surfaces that show through holes
    gains: Float64 | None = None  # (views, 3) factors for the views' colours


ONE_VIEW = Blending("quality", DrawnViews([0]), np.ones(1), 0.0, share=1.0)


def build_ahead_of_meshes(target: Target, closed: Closed, *, is_lit: bool) -> None:
    """Start to build the programs that draw several views' meshes, in another process and in the order of their use.

    With lighting, the drawing program is left out, because it depends on the maps that the light needs.
    """
    build_ahead("picture/begin.cl", "to_nearness")
    build_ahead("depthmesh/tree.cl", "segment")
    if closed:
        build_ahead("depthmesh/simplify.cl", "refine", CHUNK=CHUNK)
    build_ahead("raster/bins.cl", "bound_primitives", compiled=False, CORNERS=3, **bin_defines(3))
    if not is_lit:
        build_ahead("depthmesh/blend.cl", "draw_meshes", compiled=True, **_defines_of(target, closed, NO_ENTRY))


def draw_depth_meshes(
    target: Target,
    thing: Immutable,
    trees: Sequence[Tree],
    bounds: Bounds,
    *,
    tolerance: float,
    reuse: float,
    blending: Blending = ONE_VIEW,
    lighting: Lighting | None = None,
    occupancy: DeviceArray | None = None,
) -> None:
    """Draw one mesh, or several meshes blended, into the target.

    The colours and triangles of all views' `trees` are cached on the device with the `thing`. `bounds` is the box
    around the surfaces in the world; `tolerance`, in pixels, the largest distance between the drawn triangles and the
    surface; `reuse` as in `pyibr.depthmesh.selection.Selection`. `occupancy`, (H, W) uint32, receives bit k where view
    k gave colour.
    """
    views = [tree.view for tree in trees]
    entry = NO_ENTRY
    if lighting is not None:
        middle = 0.5 * (bounds[0] + bounds[1])
        noise, apart = noise_bias(views, target.camera, middle)
        bias = tolerance * pixel_size(target.camera, middle) + noise  # shadow maps are drawn with other triangles
        entry = entry_for(target, lighting, bias=bias, apart=apart, normals=True)
    camera, near = target.camera, target.near(bounds)
    closing, drawn = blending.closing, blending.drawn
    colored = [*drawn.others, *drawn.chosen]
    chosen = [trees[number] for number in drawn.chosen]
    pairs = [camera_pair(views[number].camera, camera) for number in (*drawn.sheets, *drawn.around, *colored)]
    underlay = None if closing is None else closing.underlay(drawn)
    how = blending.share * tolerance, underlay, 0.0 if target.from_light else reuse
    triangles, projected = projected_triangles(thing, chosen, camera, pairs, *how)
    sides = "both" if target.from_light else "front"  # back sides have no colours, but cast shadows
    bins = bin_primitives(target, triangles.corners, projected, near, sides)
    closed: Closed = closing is not None and (bool(closing.arguments) or "sheets")
    defines, outputs = _defines_of(target, closed, entry), target.outputs()
    if "GUESSES" in defines:
        outputs["guesses"] = target.made_guesses()
    if occupancy is not None:
        defines["OCCUPIED"], outputs["occupancy"] = 1, occupancy
    items = min(current().profile.drawers, math.prod(bins.grid))
    layers = len(colored), items, bins.region**2
    counts = tuple(map(len, (drawn.sheets, drawn.around, drawn.others, drawn.chosen)))
    launch(
        kernel("depthmesh/blend.cl", "draw_meshes", **defines),
        (items,),
        corners=triangles.corners,
        points=triangles.points,
        firsts=upload(np.array(triangles.firsts, np.int32)),
        culled=bins.culled,
        epsilon=blending.epsilon,
        blank=target.blank,
        counts=Struct("MeshCounts", np.array(counts, struct("depthmesh/blend.cl", "MeshCounts"))),
        by=int(constant("depthmesh/blend.cl", f"BLEND_{blending.by.upper()}")),
        layer_nearness=empty(layers, np.float32),
        layer_owner=empty(layers, np.int32),
        items=items,
        **bins.arguments,
        **outputs,
        **_view_arguments(thing, trees, blending, colored, camera, entry.normals),
        **entry.arguments,
    )
    target.blank = False


def _defines_of(target: Target, closed: Closed, entry: Entry) -> dict[str, int]:
    """Defines of the drawing kernel, for the way holes are closed and the outputs of each pixel."""
    defines = bin_defines(3) | target.color_defines | entry.defines
    if closed:
        defines["CLOSED"] = int(constant("depthmesh/blend.cl", "BY_SHEETS" if closed == "sheets" else "BY_RAYS"))
        defines |= {} if target.from_light else {"GUESSES": 1}
    return defines


def _view_arguments(
    thing: Immutable,
    trees: Sequence[Tree],
    blending: Blending,
    colored: list[int],
    camera: Camera,
    with_normals: bool,
) -> dict[str, Any]:
    """Arguments from the views: colours and weights, normals if requested, and free space if rays close holes."""
    closing, views = blending.closing, [tree.view for tree in trees]
    far_sides = () if closing is None else closing.far_sides
    feathers = cached_on_device(thing, "feathers", lambda: list(map(feathers_of, trees)))
    colors = cached_on_device(thing, "colors", lambda: view_colors(views, feathers, blending.gains, far_sides))
    closeness = (blending.closeness / blending.closeness.max()).astype(np.float32)
    focal = np.sqrt(camera.K[0, 0] * camera.K[1, 1])
    arguments: dict[str, Any] = {
        "colors": colors.words,
        "levels": colors.sizes,
        "sources": upload(colors.sources[colored]),
        "scales": upload((colors.focals[colored] / focal).astype(np.float32)),
        "weights": upload(closeness[colored]),
    }
    if with_normals:
        normals = list(map(showing_normals, views))
        shown = cached_on_device(thing, "normals", lambda: view_colors(normals, feathers, None, far_sides))
        arguments |= {"normals": shown.words} | ({"far_normals": shown.far_sides} if far_sides else {})
    if closing is not None and closing.arguments:  # free space depends on all views
        maps = np.array([camera_pair(view.camera, camera).src_from_dst for view in views], np.float32)
        arguments |= closing.arguments | {
            "from_target": upload(maps.reshape(-1, 16)),
            "far_colors": colors.far_sides,
            "first_levels": upload(np.ascontiguousarray(colors.sources[:, 1])),
            "closeness": upload(closeness),
        }
    return arguments
