"""The warp on the device: order and arguments of its kernels."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from functools import cached_property
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
from pyibr.picture.deferred import NO_ENTRY, Entry
from pyibr.picture.samples import Samples
from pyibr.picture.surface import Surface
from pyibr.picture.target import Target, clear
from pyibr.warp.lines import line_groups

_NEIGHBOUR_OFFSET_MAX = 16
_LINES = 8  # usual upper bound for the number of lines, as a multiple of a picture's width + height
_LOOK_TORN, _LOOK_CONNECTED = (1.0, 1.5), (0.5, 4.0)  # `rough` and `window` of kernels/warp/resolve.cl: best measured


@dataclass(frozen=True)
class Options:
    """Options for drawing views."""

    search: bool = False  # search for each pixel separately instead of sweeping whole lines
    linear: bool = True  # interpolate between the samples instead of taking the nearest
    connected: bool = False  # treat all neighbours as one surface
    side: Side = "front"  # side of the surface that is shown

    def from_both_sides(self) -> Options:
        """Options for a light's map: the exact surface, from both sides."""
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


@dataclass(frozen=True)
class Pass:
    """One view's surface and the target to draw it into; the methods launch the kernels."""

    surface: Surface
    pixel_map: PixelMap  # from the view to the target
    target: Target
    options: Options
    view: int = 0  # index of the view
    entry: Entry = NO_ENTRY  # result of `entry_for`; if it draws normals, with the samples' normals as an argument

    @cached_property
    def _source(self) -> dict[str, Any]:
        """Arguments of all kernels that search the view's surface."""
        return {
            "surface": self.surface.nearness,
            "map": map_of(self.pixel_map.pair),
            "sides": constant("lib/surface.h", f"SHOWS_{self.options.side.upper()}"),
        }

    @property
    def _picture(self) -> dict[str, Any]:
        """Arguments of the kernels that write the picture: its buffers, the view's colours and number, the light."""
        target = self.target
        origins = {**target.origins, "view": self.view} if target.origins else {}
        color = {"src_color": self.surface.color, "linear": self.options.linear}
        return {**color, **target.outputs(), **origins, **self.entry.arguments}

    @property
    def _sweeps_all(self) -> bool:
        """Tell whether the sweep, if there is one, writes all pixels of the rows (or columns) that are its lines."""
        return self.pixel_map.pair.aligned and not self.options.search and not current().profile.segment

    def draw(self, *, in_reach: bool = False) -> None:
        """Find the first hit of each pixel's ray, roughly by the sweep or by a search, and then exactly.

        in_reach: in a blank target, write only the pixels that the view may reach.
        """
        target, in_reach = self.target, in_reach or not self.target.blank
        (width, height), lanes = target.camera.size, current().profile.lanes
        plane = height * pitch(width) + lanes + _NEIGHBOUR_OFFSET_MAX  # with room for the packet at the last row's end
        hits, spare = self._room_for_hits(plane)  # the device clears the hits while the surface is prepared
        if in_reach and self.pixel_map.reach.empty:
            return
        plane = plane if self.surface.margins.count else 0
        hits, kind = self._find_hits(hits, spare, plane)
        self._resolve(hits, plane, kind, in_reach)
        target.blank = in_reach and target.blank

    def _room_for_hits(self, plane: int) -> tuple[DeviceArray, int]:
        """Allocate planes for hits of lines and of margins, `plane` values each; EMPTY unless the sweep fills them.

        Also return the index of the planes' end. From there on, idle lanes of the sweep write.
        """
        size, profile = self.target.camera.size, current().profile
        lines = _LINES * (sum(size) + profile.lanes) * (max(size) // profile.segment + 1 if profile.segment else 1)
        spare = 2 * plane
        try:
            hits = self.target.scratch(spare + lines)
        except OutOfMemoryError:
            if self.surface.margins.count:
                raise
            spare = plane
            hits = self.target.scratch(spare + lines)
        if not self._sweeps_all:
            clear(hits, constant("lib/pixelspace.h", "EMPTY"))
        return hits, spare

    def _find_hits(self, hits: DeviceArray, spare: int, plane: int) -> tuple[DeviceArray, str]:
        """Find hits by lines (or a search), and draw patches; return the hits and their kind, as in HITS_OF_LINES."""
        surface, pair, reach, epipole = self.surface, self.pixel_map.pair, self.pixel_map.reach, self.pixel_map.epipole
        profile = current().profile
        area = _whole_lines(reach, epipole, self.target.camera) if pair.aligned and not reach.empty else reach
        groups, packets = line_groups(epipole, area, profile.lanes, pair.aligned, profile.segment)
        end = spare + packets * profile.lanes
        lacks_room = end > hits.shape[0]
        if lacks_room:  # far more lines than usual
            hits = self.target.scratch(end)
        if lacks_room or (self._sweeps_all and not packets):
            clear(hits, constant("lib/pixelspace.h", "EMPTY"))
        if reach.empty:
            return hits, "OF_PIXELS"
        kind = "OF_PIXELS" if pair.aligned or self.options.search else "OF_LINES"
        if not packets:  # no epipole, or no pixel besides it: source positions do not depend on nearness
            kind = "WITHOUT_PARALLAX"
        elif self.options.search:
            grid = profile.packets(reach.high_x - reach.low_x, reach.high_y - reach.low_y)
            launch(kernel("warp/search.cl", "search"), grid, hits=hits, **vars(reach), **self._source)
        else:
            launch(
                kernel("warp/epipolar.cl", "epipolar_sweep", **_defines_of_sweep(pair, self.options)),
                (packets,),
                groups=upload(groups),
                group_count=len(groups),
                packet_count=packets,
                nearest=surface.high,
                farthest=surface.low,
                hits=hits,
                plane=plane,
                spare=spare,
                **({"bounds": surface.bounds} if profile.segment else {}),
                **self._source,
            )
        self._draw_patches(hits, plane, lone=kind == "OF_LINES")
        return hits, kind

    def _draw_patches(self, hits: DeviceArray, plane: int, *, lone: bool) -> None:
        """Add the hits on margins, and with `lone` the hits on objects that are too small for lines."""
        profile, margins, prominence = current().profile, self.surface.margins, self.surface.prominence
        rows, blocks, _ = prominence.shape
        lone_items = (rows + 1) * -(-blocks // profile.strip) if lone else 0
        launch(
            kernel("warp/patches.cl", "draw_patches"),
            (lone_items + -(-margins.count // (profile.strip * profile.lanes)),),
            prominence=prominence,
            least=constant("warp/patches.cl", "LONE_BY") / max(self.pixel_map.most_motion, 1e-30),
            lone_items=lone_items,
            margins=margins.quarters,
            count=margins.count,
            margin_pitch=margins.quarters.shape[1],
            hits=hits,
            plane=plane,
            **self._source,
        )

    def _resolve(self, hits: DeviceArray, plane: int, kind: str, in_reach: bool) -> None:
        """Find depth and colour of the pixels from the hits of their lines."""
        profile, target, pixel_map, connected = current().profile, self.target, self.pixel_map, self.options.connected
        area = pixel_map.reach if in_reach else Rectangle(0, target.camera.width, 0, target.camera.height)
        rough, window = _LOOK_CONNECTED if connected else _LOOK_TORN
        # Hits of aligned lines are final. Around other hits `resolve` searches, by parameters that are slow to compute.
        is_exact = pixel_map.pair.aligned and kind == "OF_PIXELS"
        density, typical = (1.0, 1.0) if is_exact else (pixel_map.density, pixel_map.typical)
        launch(
            kernel("warp/resolve.cl", "resolve", **defines_of(target, self.entry)),
            profile.packets(area.high_x - area.low_x, area.high_y - area.low_y, profile.strip),
            merge=not target.blank,
            density=max(density, 1.0),
            typical=typical,
            neighbour_offset=min(math.ceil(0.5 / density), _NEIGHBOUR_OFFSET_MAX),
            rough=rough,
            window=window,
            connected=connected,
            hits=hits,
            plane=plane,
            hit_kind=constant("warp/line_hits.h", f"HITS_{kind}"),
            **vars(area),  # low_x, high_x, low_y, high_y
            **self._source,
            **self._picture,
            **({} if target.classes is None else {"classes": target.classes}),
        )

    def draw_under(self) -> None:
        """Draw the view, a connected surface, where the picture has holes; the pixels become guesses."""
        profile, target, pixel_map = current().profile, self.target, self.pixel_map
        area = pixel_map.reach
        if area.empty:
            return
        farthest, nearest = pixel_map.range_in_target
        launch(
            kernel("warp/under.cl", "draw_under", **target.color_defines, **self.entry.defines),
            profile.packets(area.high_x - area.low_x, area.high_y - area.low_y, profile.strip),
            surface=self.surface.nearness,
            src_color=self.surface.color,
            map=map_of(pixel_map.pair),
            nearest=nearest,
            farthest=farthest,
            in_place=not pixel_map.epipole.any(),
            **vars(area),  # low_x, high_x, low_y, high_y
            **target.outputs(),
            **self.entry.arguments,
        )
        target.guessed = True

    def draw_thin(self) -> None:
        """Draw objects one sample thin, where they are nearer than the picture."""
        ribbons, target = self.surface.ribbons, self.target
        if not ribbons.shape[0]:
            return
        profile, camera = current().profile, target.camera
        defines = {**target.color_defines, **self.entry.defines, "ORIGINS": int(target.source is not None)}
        shared = {"cut": Struct("Cut", self.surface.test.cut), **_nothing_entered(camera), **self._source}
        listed = {"ribbons": ribbons, "count": ribbons.shape[0], **shared}
        for by_index in (False, True):
            launch(kernel("warp/thin.cl", "draw_ribbons", **defines), ribbons.shape, by_index=by_index, **listed)
        grid = profile.packets(*camera.size, profile.strip)
        launch(kernel("warp/thin.cl", "thin_pixels", **defines), grid, **shared, **self._picture)

    def classify(self) -> None:
        """Lower the classes of the holes for which this view knows a more specific class."""
        target, pixel_map, aligned = self.target, self.pixel_map, self.pixel_map.pair.aligned
        assert target.classes is not None
        profile, (width, height) = current().profile, target.camera.size
        defines = {"ALIGNED": int(aligned)}
        groups, packets = line_groups(pixel_map.epipole, Rectangle(0, width, 0, height), profile.lanes, aligned)
        told = target.scratch(height * pitch(width) + (packets + 1) * profile.lanes)
        if not (aligned and packets):  # aligned lines write all pixels
            clear(told, 0.0 if packets else pixel_map.typical)
        shared = {"surface": self.surface.nearness, "told": told, "map": map_of(pixel_map.pair)}
        if packets:
            launch(
                kernel("warp/classify.cl", "classify_lines", **defines),
                (packets,),
                groups=upload(groups),
                group_count=len(groups),
                packet_count=packets,
                nearest=self.surface.high,
                **shared,
            )
        launch(
            kernel("warp/classify.cl", "classify", **defines),
            profile.packets(width, height, profile.strip),
            valid=target.valid,
            classes=target.classes,
            **shared,
        )


def _whole_lines(reach: Rectangle, epipole: Float64, camera: Camera) -> Rectangle:
    """Extend `reach` to all rows of the picture if the lines run along rows, otherwise to all columns."""
    if epipole[0] != 0.0:
        return replace(reach, low_y=0, high_y=camera.height)
    return replace(reach, low_x=0, high_x=camera.width)


def _defines_of_sweep(pair: CameraPair, options: Options) -> dict[str, int]:
    """Defines of kernels/warp/epipolar.cl.

    Lines through the pixels' centres must be exact, and connected surfaces have crests that no line may miss. In other
    cases, `resolve` only searches around the hits.
    """
    on_samples = pair.aligned and pair.off_samples < constant("lib/surface.h", "ON_SAMPLES")
    exact, segment = not (on_samples if pair.aligned else not options.connected), current().profile.segment
    return {"ALIGNED": int(pair.aligned), "EDGES": int(exact), **({"SEGMENT": segment} if segment else {})}


def defines_of(target: Target, entry: Entry) -> dict[str, int]:
    """Defines of kernels/warp/resolve.cl."""
    origins = len(target.origins) and 1 + (target.classes is not None)
    return {"ORIGINS": origins, **target.color_defines, **entry.defines}


def build_ahead_of_warp(pair: CameraPair, options: Options, defines: dict[str, int]) -> None:
    """Start to build the programs that `Pass.draw` needs, in the order of their use, in another process."""
    build_ahead("picture/begin.cl", "prepare" if current().profile.band else "find_edges")
    if not options.search:
        build_ahead("warp/epipolar.cl", "epipolar_sweep", compiled=False, **_defines_of_sweep(pair, options))
    build_ahead("warp/patches.cl", "draw_patches", compiled=False)
    build_ahead("warp/resolve.cl", "resolve", compiled=True, **defines)


def forward_warp(samples: Samples, pixel_map: PixelMap, target: Target, size: float, entry: Entry = NO_ENTRY) -> None:
    """Draw each sample as a square of target pixels; `size`: the square's side."""
    defines = {**target.color_defines, **entry.defines}
    shared = {"map": map_of(pixel_map.pair), **_nothing_entered(target.camera)}
    for by_index in (False, True):
        splatted = {"nearness": samples.nearness, "size": size, "by_index": by_index, **shared}
        launch(kernel("warp/forward.cl", "splat_samples", **defines), pixel_map.pair.src.size, **splatted)
    picture = {"src_color": samples.color, "merge": not target.blank, **target.outputs(), **entry.arguments}
    launch(kernel("warp/forward.cl", "splat_pixels", **defines), target.camera.size, **picture, **shared)
    target.blank = False


def _nothing_entered(camera: Camera) -> dict[str, DeviceArray]:
    """Initial `keys` and `indices` of kernels/warp/keys.h for a camera's picture."""
    keys, indices = (empty((camera.height, camera.width), np.uint32) for _ in range(2))
    clear(keys, 0)
    clear(indices, 0xFFFFFFFF)
    return {"keys": keys, "indices": indices}
