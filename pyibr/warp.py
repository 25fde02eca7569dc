"""Image warping: a depth image, or several, to a new view (Schaufler & Priglinger 1999)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from pyibr.camera import Camera
from pyibr.epipolar import Rectangle, line_groups
from pyibr.errors import ArgumentError
from pyibr.images import DepthImage, Frame

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pyibr._check import Float64
    from pyibr.opencl.launch import Struct
    from pyibr.opencl.memory import DeviceArray

Method = Literal["epipolar", "search", "forward"]
Sample = Literal["linear", "nearest"]
Edges = Literal["connect", "cut"]
Side = Literal["front", "back", "both"]

_SHOWN = {"front": 1, "back": 2, "both": 3}
_EMPTY = np.float32(-3e38)
_PIXEL_MAP = np.dtype(
    [
        ("dst_from_src", np.float32, 16),
        ("src_from_dst", np.float32, 16),
        ("src_width", np.int32),
        ("src_height", np.int32),
        ("src_pitch", np.int32),
        ("dst_width", np.int32),
        ("dst_height", np.int32),
        ("dst_pitch", np.int32),
        ("dst_perspective", np.int32),
    ]
)
_CUT = np.dtype([("near_scale", np.float32), ("far_scale", np.float32)])


def warp(
    views: DepthImage | Sequence[DepthImage],
    camera: Camera,
    method: Method = "epipolar",
    sample: Sample = "linear",
    edges: Edges = "connect",
    fill: Literal["background"] | None = None,
    *,
    cut_ratio: float = 1.05,
    side: Side = "front",
    splat: float = 1.0,
) -> Frame:
    views = [views] if isinstance(views, DepthImage) else list(views)
    target = _Target(camera, views[0].color.dtype)
    for view in views:
        _warp_one(view, target, method, sample, edges, cut_ratio, side)
    return target.frame()


class _Target:
    """The frame being made, on the device."""

    def __init__(self, camera: Camera, dtype: np.dtype[Any]) -> None:
        from pyibr.opencl.memory import empty

        shape = (camera.height, camera.width)
        self.camera = camera
        self.color = empty((*shape, 3), dtype)
        self.depth = empty(shape, np.float32)
        self.valid = empty(shape, np.uint8)
        self.blank = True  # nothing has been written yet

    def frame(self) -> Frame:
        valid = self.valid.to_host().view(np.bool_)
        return Frame(self.color.to_host(), self.depth.to_host(), valid, self.camera)


@dataclass(frozen=True)
class _Source:
    nearness: DeviceArray
    color: DeviceArray
    low: float
    high: float


def _pitch(width: int) -> int:
    """Row length that holds whole packets and is no multiple of a power of two that caches map to one place."""
    padded = -(-width // 16) * 16
    return padded + 16 if padded % 256 == 0 else padded


def _source(view: DepthImage) -> _Source:
    from pyibr.opencl.launch import launch
    from pyibr.opencl.memory import empty, scratch, upload
    from pyibr.opencl.program import kernel

    width, height = view.camera.size
    pitch = _pitch(width)
    nearness, ranges = scratch((height, pitch), np.float32), empty((height, 2), np.float32)
    launch(
        kernel("warp/nearness.cl", "to_nearness"),
        (height,),
        depth=upload(view.depth),
        nearness=nearness,
        ranges=ranges,
        src_width=width,
        src_height=height,
        src_pitch=pitch,
        src_perspective=view.camera.projection == "perspective",
        far=min(view.far, np.finfo(np.float32).max),
    )
    spread = ranges.to_host()
    low, high = float(spread[:, 0].min()), float(spread[:, 1].max())
    if low > high:
        raise ArgumentError("depth", "at least one valid sample", "none")
    return _Source(nearness, upload(view.color), low, high)


def _warp_one(view, target, method, sample, edges, cut_ratio, side) -> None:
    from pyibr.opencl.device import current
    from pyibr.opencl.launch import Struct, launch
    from pyibr.opencl.memory import scratch, upload
    from pyibr.opencl.program import kernel

    session = current()
    source = _source(view)
    src, dst = view.camera, target.camera
    matrix = dst.pixel_matrix @ dst.camera_from_world @ src.world_from_camera @ np.linalg.inv(src.pixel_matrix)
    inverse = src.pixel_matrix @ src.camera_from_world @ dst.world_from_camera @ np.linalg.inv(dst.pixel_matrix)
    pixel_map = np.zeros((), _PIXEL_MAP)
    pixel_map["dst_from_src"], pixel_map["src_from_dst"] = matrix.ravel(), inverse.ravel()
    pixel_map["src_width"], pixel_map["src_height"] = src.size
    pixel_map["src_pitch"] = _pitch(src.width)
    pixel_map["dst_width"], pixel_map["dst_height"] = dst.size
    pixel_map["dst_pitch"] = _pitch(dst.width)
    pixel_map["dst_perspective"] = dst.projection == "perspective"
    ratio = cut_ratio if edges == "cut" else 0.0
    one = 1.0 if edges == "cut" else 0.0
    cut = np.array((one, ratio) if src.projection == "perspective" else (ratio, one), _CUT)
    area = Rectangle(0, dst.width, 0, dst.height)
    seen = scratch((dst.height + 16, _pitch(dst.width)), np.float32)
    common = {"nearness": source.nearness, "seen": seen, "map": Struct("PixelMap", pixel_map[()]), "cut": Struct("Cut", cut[()]), "shown": _SHOWN[side]}
    if method == "search":
        launch(kernel("warp/search.cl", "search"), dst.size, **common)
    elif _parallax(matrix, src, source) < 1e-3:
        seen.fill(0.0)
    else:
        seen.fill(_EMPTY)
        groups, packets = line_groups(matrix[:3, 3], area, session.lanes)
        launch(
            kernel("warp/epipolar.cl", "epipolar_sweep"),
            (packets,),
            **common,
            groups=upload(groups),
            group_count=len(groups),
            packet_count=packets,
            nearest=source.high,
            farthest=source.low,
        )
    strip = 1 if session.lanes == 1 else -(-dst.width // session.lanes)
    launch(
        kernel("warp/resolve.cl", "resolve", COLOR_BYTES=target.color.dtype.itemsize, STRIP=strip),
        (-(-dst.width // (strip * session.lanes)), dst.height),
        **common,
        src_color=source.color,
        depth=target.depth,
        color=target.color,
        valid=target.valid,
        linear=sample == "linear",
        merge=not target.blank,
        low_x=0,
        high_x=dst.width,
        low_y=0,
        high_y=dst.height,
        window=4.0,
    )
    target.blank = False


def _parallax(matrix: Float64, camera: Camera, source: _Source) -> float:
    """How far the source's corner pixels move in the target, in pixels, from the farthest depth to the nearest."""
    corners = [(x, y, 1.0, n) for n in (source.low, source.high) for x in (0, camera.width - 1) for y in (0, camera.height - 1)]
    u, v, w, _ = matrix @ np.array(corners).T
    ahead = (w[:4] > 0) & (w[4:] > 0)
    with np.errstate(all="ignore"):
        shift = np.hypot(u[:4] / w[:4] - u[4:] / w[4:], v[:4] / w[:4] - v[4:] / w[4:])
    return float(shift[ahead].max()) if ahead.all() else math.inf

