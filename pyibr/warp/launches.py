"""The warp on the device: order and arguments of its kernels."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64
from pyibr.core.errors import OutOfMemoryError
from pyibr.core.pixelspace import CameraPair, PixelMap, Rectangle, pitch
from pyibr.images.depth_image import Side
from pyibr.opencl.ahead import build_ahead
from pyibr.opencl.device import current
from pyibr.opencl.headers import constant, struct
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, empty, upload
from pyibr.opencl.program import kernel
from pyibr.picture.clear import clear
from pyibr.picture.deferred import NO_ENTRY, Entry
from pyibr.picture.samples import Samples
from pyibr.picture.surface import Surface
from pyibr.picture.target import Target
from pyibr.warp.lines import line_groups

_NEIGHBOUR_OFFSET_MAX = 16
_LINES = 8  # exceeds the number of a picture's lines, relative to the sum of its sides
_LOOK_TORN, _LOOK_CONNECTED = (1.0, 1.5), (0.5, 4.0)  # `rough` and `window` of kernels/warp/resolve.cl, measured


@dataclass(frozen=True)
class Options:
    """Options for drawing views.

    Attributes
    ----------
    search : bool
        Search for each pixel separately instead of sweeping whole lines.
    linear : bool
        Interpolate between the samples instead of taking the nearest.
    connected : bool
        Treat all neighbours as one surface.
    side : str
        Side of the surface that is shown: one of `Side`.
    """

    search: bool = False
    linear: bool = True
    connected: bool = False
    side: Side = "front"

    def from_both_sides(self) -> Options:
        """Options for a light's map: the exact surface, whichever side the light is on."""
        return Options(connected=self.connected, side="both")


@functools.lru_cache(maxsize=256)
def map_of(pair: CameraPair) -> Struct:
    """The kernels' struct PixelMap."""
    values = np.zeros((), struct("lib/pixelspace.h", "PixelMap"))
    values["dst_from_src"], values["src_from_dst"] = pair.dst_from_src.ravel(), pair.src_from_dst.ravel()
    values["src_width"], values["src_height"], values["src_pitch"] = *pair.src.size, pitch(pair.src.width)
    values["dst_width"], values["dst_height"], values["dst_pitch"] = *pair.dst.size, pitch(pair.dst.width)
    values["dst_perspective"] = pair.dst.projection == "perspective"
    return Struct("PixelMap", values)


def inverse_warp(
    surface: Surface,
    pixel_map: PixelMap,
    target: Target,
    options: Options,
    view: int = 0,
    entry: Entry = NO_ENTRY,
    *,
    in_reach: bool = False,
) -> None:
    """Find the first hit of each pixel's ray: by sweep or by search, then exactly.

    view: its number. entry: entry of a picture in a light, with the samples' normals if it draws them. in_reach: write
    no more pixels of a blank target than the view may reach.
    """
    # The device clears it while the surface is prepared.
    hits, spare = _room_for_hits(surface, pixel_map.pair, target, options)
    reach = pixel_map.reach
    if reach.empty and (in_reach or not target.blank):
        return
    shared = {**_shared(surface, pixel_map, options), "hits": hits}
    plane = _plane_of(target.camera) if surface.margins.count else 0
    hit_kind = _find_hits(surface, pixel_map, target, options, plane, spare, shared)
    found = {**shared, "plane": plane, "hit_kind": hit_kind}
    _resolve(surface, pixel_map, target, options, found, view, entry, in_reach)
    target.blank = in_reach and target.blank


def _shared(surface: Surface, pixel_map: PixelMap, options: Options) -> dict[str, Any]:
    """Arguments of all kernels that search a view's surface."""
    return {
        "surface": surface.nearness,
        "map": map_of(pixel_map.pair),
        "sides": constant("lib/surface.h", f"SHOWS_{options.side.upper()}"),
    }


def _plane_of(camera: Camera) -> int:
    """Number of values in a plane of hits: packets at the end of its last row read beyond it."""
    return camera.height * pitch(camera.width) + current().profile.lanes + _NEIGHBOUR_OFFSET_MAX


def _sweeps_all(pair: CameraPair, options: Options) -> bool:
    """Tell whether the sweep, if there is one, covers all pixels of its lines: rows or columns of the picture."""
    return pair.aligned and not options.search and not current().profile.segment


def _room_for_hits(surface: Surface, pair: CameraPair, target: Target, options: Options) -> tuple[DeviceArray, int]:
    """Allocate planes of line hits and margin hits, EMPTY unless the sweep clears them; also returns the planes' end.

    Beyond the end, lanes of the sweep write that have nothing to write.
    """
    plane = _plane_of(target.camera)
    size, segment = target.camera.size, current().profile.segment
    lines = _LINES * (sum(size) + current().profile.lanes) * (max(size) // segment + 1 if segment else 1)
    spare = 2 * plane
    try:
        hits = target.scratch(spare + lines)
    except OutOfMemoryError:
        if surface.margins.count:
            raise
        spare = plane
        hits = target.scratch(spare + lines)
    if not _sweeps_all(pair, options):
        clear(hits, constant("lib/pixelspace.h", "EMPTY"))
    return hits, spare


def _find_hits(
    surface: Surface,
    pixel_map: PixelMap,
    target: Target,
    options: Options,
    plane: int,
    spare: int,
    shared: dict[str, Any],
) -> float:
    """Find hits by lines (or a search), and draw patches; returns HITS_... in kernels/warp/line_hits.h."""
    profile, reach, epipole, aligned = current().profile, pixel_map.reach, pixel_map.epipole, pixel_map.pair.aligned
    area = _whole_lines(reach, epipole, target.camera) if aligned and not reach.empty else reach
    groups, packets = line_groups(epipole, area, profile.lanes, aligned, profile.segment)
    room = shared["hits"].shape[0]
    kind = _hits("OF_PIXELS" if aligned or options.search or reach.empty else "OF_LINES")
    if spare + packets * profile.lanes > room:  # far more lines than usual
        shared["hits"] = target.scratch(spare + packets * profile.lanes)
    if spare + packets * profile.lanes > room or (_sweeps_all(pixel_map.pair, options) and not packets):
        clear(shared["hits"], constant("lib/pixelspace.h", "EMPTY"))
    if reach.empty:
        return kind
    if not packets:  # no epipole, or no other pixel: any nearness gives the source position
        kind = _hits("WITHOUT_PARALLAX")
    elif options.search:
        launch(
            kernel("warp/search.cl", "search"),
            profile.packets(reach.high_x - reach.low_x, reach.high_y - reach.low_y),
            low_x=reach.low_x,
            high_x=reach.high_x,
            low_y=reach.low_y,
            high_y=reach.high_y,
            **shared,
        )
    else:
        launch(
            kernel("warp/epipolar.cl", "epipolar_sweep", **_defines_of_sweep(pixel_map.pair, options)),
            (packets,),
            groups=upload(groups),
            group_count=len(groups),
            packet_count=packets,
            nearest=surface.high,
            farthest=surface.low,
            plane=plane,
            spare=spare,
            **({"bounds": surface.bounds} if profile.segment else {}),
            **shared,
        )
    _draw_patches(surface, pixel_map, plane, shared, lone=kind == _hits("OF_LINES"))
    return kind


def _defines_of_sweep(pair: CameraPair, options: Options) -> dict[str, int]:
    """Defines of kernels/warp/epipolar.cl.

    Lines through the pixels' centres must be exact, and connected surfaces have crests that no line may miss.
    Elsewhere lines only show where to look.
    """
    on_samples = pair.aligned and pair.off_samples < constant("lib/surface.h", "ON_SAMPLES")
    exact, segment = not (on_samples if pair.aligned else not options.connected), current().profile.segment
    return {"ALIGNED": int(pair.aligned), "EDGES": int(exact), **({"SEGMENT": segment} if segment else {})}


def defines_of(target: Target, entry: Entry) -> dict[str, int]:
    """Defines of kernels/warp/resolve.cl."""
    origins = len(target.origins) and 1 + (target.classes is not None)
    return {"ORIGINS": origins, **target.color_defines, **entry.defines}


def build_ahead_of_warp(pair: CameraPair, options: Options, defines: dict[str, int]) -> None:
    """Build the programs that `inverse_warp` needs, in their order, in parallel to this process."""
    build_ahead("picture/begin.cl", "prepare" if current().profile.band else "find_edges")
    if not options.search:
        build_ahead("warp/epipolar.cl", "epipolar_sweep", compiled=False, **_defines_of_sweep(pair, options))
    build_ahead("warp/patches.cl", "draw_patches", compiled=False)
    build_ahead("warp/resolve.cl", "resolve", compiled=True, **defines)


def _draw_patches(surface: Surface, pixel_map: PixelMap, plane: int, shared: dict[str, Any], *, lone: bool) -> None:
    """Add the hits on margins, and with `lone` the hits on objects that are too small for lines."""
    profile, margins = current().profile, surface.margins
    rows, blocks, _ = surface.prominence.shape
    lone_items = (rows + 1) * -(-blocks // profile.strip) if lone else 0
    launch(
        kernel("warp/patches.cl", "draw_patches"),
        (lone_items + -(-margins.count // (profile.strip * profile.lanes)),),
        prominence=surface.prominence,
        least=constant("warp/patches.cl", "LONE_BY") / max(pixel_map.most_motion, 1e-30),
        lone_items=lone_items,
        margins=margins.quarters,
        count=margins.count,
        margin_pitch=margins.quarters.shape[1],
        plane=plane,
        **shared,
    )


def _hits(name: str) -> float:
    """Number of a kind of hits, HITS_... in kernels/warp/line_hits.h."""
    return constant("warp/line_hits.h", f"HITS_{name}")


def _whole_lines(reach: Rectangle, epipole: Float64, camera: Camera) -> Rectangle:
    """Extend `reach` to all rows of the picture, or all columns: a line for each of them, along the epipole's axis."""
    if epipole[0] != 0.0:
        return replace(reach, low_y=0, high_y=camera.height)
    return replace(reach, low_x=0, high_x=camera.width)


def _resolve(
    surface: Surface,
    pixel_map: PixelMap,
    target: Target,
    options: Options,
    shared: dict[str, Any],
    view: int,
    entry: Entry,
    in_reach: bool,
) -> None:
    """Find depth and colour of the pixels from the hits of their lines."""
    profile = current().profile
    low_x, high_x, low_y, high_y = 0, target.camera.width, 0, target.camera.height
    if in_reach or not target.blank:
        reach = pixel_map.reach
        low_x, high_x, low_y, high_y = reach.low_x, reach.high_x, reach.low_y, reach.high_y
    rough, window = _LOOK_CONNECTED if options.connected else _LOOK_TORN
    # Hits of aligned lines are final, and the parameters of a search around them take time to compute.
    is_exact = pixel_map.pair.aligned and shared["hit_kind"] == _hits("OF_PIXELS")
    density, typical = (1.0, 1.0) if is_exact else (pixel_map.density, pixel_map.typical)
    neighbour_offset = min(math.ceil(0.5 / density), _NEIGHBOUR_OFFSET_MAX)
    classes = {} if target.classes is None else {"classes": target.classes}
    launch(
        kernel("warp/resolve.cl", "resolve", **defines_of(target, entry)),
        profile.packets(high_x - low_x, high_y - low_y, profile.strip),
        src_color=surface.color,
        linear=options.linear,
        merge=not target.blank,
        low_x=low_x,
        high_x=high_x,
        low_y=low_y,
        high_y=high_y,
        density=max(density, 1.0),
        typical=typical,
        neighbour_offset=neighbour_offset,
        rough=rough,
        window=window,
        connected=options.connected,
        **shared,
        **target.outputs(),
        **_origins(target, view),
        **classes,
        **entry.arguments,
    )


def _origins(target: Target, view: int) -> dict[str, Any]:
    """Arguments of kernels that write the origins of a view's pixels, if the target has any."""
    return {**target.origins, "view": view} if target.origins else {}


def draw_thin(
    surface: Surface,
    pixel_map: PixelMap,
    target: Target,
    options: Options,
    view: int = 0,
    entry: Entry = NO_ENTRY,
) -> None:
    """Draw objects one sample thin, where they are nearer than the picture; parameters as in `inverse_warp`."""
    ribbons = surface.ribbons
    if not ribbons.shape[0]:
        return
    profile, (width, height) = current().profile, target.camera.size
    shared = {**_shared(surface, pixel_map, options), "cut": Struct("Cut", surface.test.cut)}
    keys, indices = empty((height, width), np.uint32), empty((height, width), np.uint32)
    clear(keys, 0)
    clear(indices, 0xFFFFFFFF)
    defines = {**target.color_defines, **entry.defines}
    defines["ORIGINS"] = int(target.source is not None)
    listed = {"ribbons": ribbons, "count": ribbons.shape[0], "keys": keys, **shared}
    for name, more in (("thin_nearness", {}), ("thin_index", {"indices": indices})):
        launch(kernel("warp/thin.cl", name, **defines), (ribbons.shape[0],), **listed, **more)
    launch(
        kernel("warp/thin.cl", "thin_pixels", **defines),
        profile.packets(width, height, profile.strip),
        keys=keys,
        indices=indices,
        src_color=surface.color,
        linear=options.linear,
        **shared,
        **target.outputs(),
        **_origins(target, view),
        **entry.arguments,
    )


def forward_warp(samples: Samples, pixel_map: PixelMap, target: Target, size: float, entry: Entry = NO_ENTRY) -> None:
    """Carry each sample over to a square of `size` pixels."""
    shape = (target.camera.height, target.camera.width)
    keys, indices = empty(shape, np.uint32), empty(shape, np.uint32)
    clear(keys, 0)
    clear(indices, 0xFFFFFFFF)
    the_map, defines = map_of(pixel_map.pair), {**target.color_defines, **entry.defines}
    for name, more in (("splat_nearness", {}), ("splat_index", {"indices": indices})):
        launch(
            kernel("warp/forward.cl", name, **defines),
            pixel_map.pair.src.size,
            nearness=samples.nearness,
            keys=keys,
            map=the_map,
            size=size,
            **more,
        )
    launch(
        kernel("warp/forward.cl", "splat_pixels", **defines),
        target.camera.size,
        keys=keys,
        indices=indices,
        src_color=samples.color,
        map=the_map,
        merge=not target.blank,
        **target.outputs(),
        **entry.arguments,
    )
    target.blank = False


def classify(surface: Surface, pixel_map: PixelMap, target: Target) -> None:
    """Reduce the holes' classes by the reasons that this view knows."""
    assert target.classes is not None
    profile, (width, height) = current().profile, target.camera.size
    defines = {"ALIGNED": int(pixel_map.pair.aligned)}
    area = Rectangle(0, width, 0, height)
    groups, packets = line_groups(pixel_map.epipole, area, profile.lanes, pixel_map.pair.aligned)
    told = target.scratch(height * pitch(width) + (packets + 1) * profile.lanes)
    clear(told, 0.0 if packets else pixel_map.typical)
    shared = {"surface": surface.nearness, "told": told, "map": map_of(pixel_map.pair)}
    if packets:
        launch(
            kernel("warp/classify.cl", "classify_lines", **defines),
            (packets,),
            groups=upload(groups),
            group_count=len(groups),
            packet_count=packets,
            nearest=surface.high,
            **shared,
        )
    launch(
        kernel("warp/classify.cl", "classify", **defines),
        profile.packets(width, height, profile.strip),
        valid=target.valid,
        classes=target.classes,
        **shared,
    )
