"""Image warping: a depth image, or several, to a new view (Schaufler & Priglinger 1999)."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from pyibr._check import describe, one_of
from pyibr.camera import Camera
from pyibr.epipolar import line_groups
from pyibr.errors import ArgumentError
from pyibr.images import DepthImage, Frame
from pyibr.pixelspace import PixelMap, pitch
from pyibr.samples import Samples, samples_of
from pyibr.target import Target

Method = Literal["epipolar", "search", "forward"]
Sample = Literal["linear", "nearest"]
Edges = Literal["connect", "cut"]
Side = Literal["front", "back", "both"]
Fill = Literal["background"]

_SHOWN = {"front": 1, "back": 2, "both": 3}  # SHOWS_FRONT, SHOWS_BACK of kernels/lib/surface.h
_EMPTY = -3e38  # EMPTY of kernels/lib/pixelspace.h
_CUT = np.dtype([("near_scale", np.float32), ("far_scale", np.float32), ("least", np.float32)])
_OF_LINES, _OWN, _OF_ALL = 0, 1, 2  # ANSWERS_... of kernels/warp/resolve.cl
_SPLAT_MOST = 64.0
_PIXELS_MOST = 1 << 29  # kernels number samples and colour bytes in 32 bits
_APART_MOST = 16
_LOOK_TORN, _LOOK_CONNECTED = (1.0, 2.0), (0.5, 4.0)  # `rough` and `window` of kernels/warp/resolve.cl, measured
_STRIP = 16  # packets of a row that one work-item of a CPU takes: enough to hide what starting it costs


def warp(
    views: DepthImage | Sequence[DepthImage],
    camera: Camera,
    method: Method = "epipolar",
    sample: Sample = "linear",
    edges: Edges = "cut",
    fill: Fill | None = None,
    *,
    cut_ratio: float = 1.05,
    side: Side = "front",
    splat: float = 1.0,
) -> Frame:
    """Render depth images from a new camera.

    A depth image means a surface: the grid of its samples, each cell split from its upper right to its lower left
    corner. Each pixel of the target sees what its ray meets first. Several views are merged by depth.

    Parameters
    ----------
    views : DepthImage or sequence of DepthImage
        The sources, perspective or orthographic, with colours of one dtype. Their buffers stay on the device, so
        that warping the same object again is cheaper.
    camera : Camera
        The target, perspective or orthographic.
    method : {"epipolar", "search", "forward"}
        "epipolar" sweeps whole epipolar lines, O(n^2) (section 4 of the paper); "search" lets each pixel search its
        own epipolar segment, O(n^3); "forward" carries each sample over as a point, which leaves gaps where the
        target sees the surface larger than the source did, and to which `sample`, `edges` and `side` do not apply.
    sample : {"linear", "nearest"}
        Read the surface between the samples, or the sample nearest to where the ray meets the surface; for depth and
        colour alike. Within 1/8 of a pixel of the middle between two samples, either may be taken for the nearest.
    edges : {"cut", "connect"}
        "cut": the surface is open where neighbours' depths differ too much (see `cut_ratio`), as at the borders of
        objects in scenes. "connect": neighbouring samples are one surface, however far apart, as in displacement maps.
    fill : {None, "background"}
        "background" fills holes, along the epipolar line, from the farther of the two sides; `valid` stays False
        there.
    cut_ratio : float
        Greater than 1: `edges="cut"` opens the surface where neighbours' depths have a greater ratio. Depths of an
        orthographic view have no origin that a ratio could refer to: it is cut where they differ by more than
        (`cut_ratio` - 1) times the longer side of what its camera sees.
    side : {"front", "back", "both"}
        Which side of the surface is shown: the one that faces the source's camera, the other (a solid displaced from
        a centre inside it and seen from outside), or either. A ray that meets the other side first sees a hole.
    splat : float
        With "forward": side of the square of target pixels that a sample covers, 1 to 64.

    Returns
    -------
    Frame
        Colour in the views' dtype, planar depth, and where anything was seen.

    Raises
    ------
    ArgumentError
        An argument has a wrong type or value, or a view has no valid depth at all.
    DeviceError
        No OpenCL device works.

    Warns
    -----
    UserWarning
        If the target sees nothing of any view.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> camera = ibr.Camera([[100, 0, 31.5], [0, 100, 31.5], [0, 0, 1]], (64, 64))
    >>> color = np.full((64, 64, 3), 200, np.uint8)
    >>> view = ibr.DepthImage(color, np.full((64, 64), 2.0, np.float32), camera)
    >>> frame = ibr.warp(view, camera.moved(0.2, 0, 0))  # everything shifts by f * b / z = 10 pixels
    >>> int(frame.valid.sum(axis=1)[0])
    54
    """
    sources = _checked_views(views)
    if not isinstance(camera, Camera):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ArgumentError("camera", "a pyibr.Camera", describe(camera))
    for argument, size in [("camera", camera.size), *(("views", view.camera.size) for view in sources)]:
        if size[0] * size[1] > _PIXELS_MOST:
            raise ArgumentError(argument, f"at most {_PIXELS_MOST} pixels", f"{size[0]} x {size[1]}")
    one_of("method", method, Method)
    if fill is not None:
        one_of("fill", fill, Fill, " or None")
    options = _options(sample, edges, cut_ratio, side, splat)

    from pyibr.opencl.device import current

    target = Target(camera, sources[0].color.dtype)
    maps: list[PixelMap] = []
    with current().lock:
        for view in sources:
            samples = samples_of(view)
            pixel_map = PixelMap(view.camera, camera, samples.low, samples.high)
            maps.append(pixel_map)
            if method == "forward":
                _splat(samples, pixel_map, target, options)
            else:
                _look(samples, pixel_map, target, options, method)
        if fill is not None:
            _fill(target, min(maps, key=lambda pixel_map: pixel_map.parallax))
        frame = target.frame()
    if not frame.valid.any():
        warnings.warn("warp: the target camera sees nothing of the views; the frame is empty", stacklevel=2)
    return frame


def drawing(sample: Sample, edges: Edges, cut_ratio: float, side: Side) -> Callable[[Target, DepthImage], None]:
    """Check how views are to be shown, as `warp` does, and return what draws one so by the epipolar warp.

    Into a light's map it draws the surface itself, from both its sides. The session's lock is held meanwhile.
    """
    options = _options(sample, edges, cut_ratio, side)
    hides = _options("linear", edges, cut_ratio, "both")

    def draw(target: Target, view: DepthImage) -> None:
        samples = samples_of(view)
        pixel_map = PixelMap(view.camera, target.camera, samples.low, samples.high)
        _look(samples, pixel_map, target, hides if target.from_light else options, "epipolar")

    return draw


@dataclass(frozen=True)
class _Options:
    linear: bool
    cuts: bool
    cut_ratio: float
    shown: int
    splat: float


def _options(sample: Sample, edges: Edges, cut_ratio: float, side: Side, splat: float = 1.0) -> _Options:
    """Check how a view is to be shown."""
    one_of("sample", sample, Sample)
    one_of("edges", edges, Edges)
    one_of("side", side, Side)
    _number("cut_ratio", cut_ratio, 1.0, math.inf, "a ratio greater than 1")
    _number("splat", splat, 1.0, _SPLAT_MOST, f"1 to {_SPLAT_MOST:g} pixels")
    return _Options(sample == "linear", edges == "cut", float(cut_ratio), _SHOWN[side], float(splat))


def _look(samples: Samples, pixel_map: PixelMap, target: Target, options: _Options, method: Method) -> None:
    """Each pixel looks for what its ray meets first: by sweep or by search, then exactly."""
    from pyibr.opencl.device import current
    from pyibr.opencl.launch import Struct, launch
    from pyibr.opencl.memory import empty, upload
    from pyibr.opencl.program import kernel

    session = current()
    width, height = target.camera.size
    reach = pixel_map.reach
    if reach.empty and not target.blank:
        return
    aligned = pixel_map.aligned
    groups, packets = line_groups(pixel_map.epipole, reach, session.lanes, aligned)
    # Lanes of the sweep with nothing to write need a place of their own to write it; packets at the end of the last
    # row read beyond it.
    beyond = max(packets * session.lanes, session.lanes + _APART_MOST)
    seen = empty((height * pitch(width) + beyond,), np.float32)
    common = {
        "nearness": samples.nearness,
        "seen": seen,
        "map": Struct("PixelMap", pixel_map.struct),
        "cut": Struct("Cut", _cut(pixel_map.src, options)),
        "shown": options.shown,
    }
    answers = _OWN
    if reach.empty:
        seen.fill(_EMPTY)
    elif not packets:
        answers = _OF_ALL  # no epipole, or it is all there is: any nearness gives the source position
        seen.fill(pixel_map.typical)
    elif method == "search":
        answers = _OWN
        seen.fill(_EMPTY)
        launch(
            kernel("warp/search.cl", "search"),
            (-(-(reach.high_x - reach.low_x) // session.lanes), reach.high_y - reach.low_y),
            low_x=reach.low_x,
            high_x=reach.high_x,
            low_y=reach.low_y,
            high_y=reach.high_y,
            **common,
        )
    else:
        seen.fill(_EMPTY)
        # Where a torn surface ends, lines are not asked for more than where to look; a connected one has crests.
        exact = not (pixel_map.on_samples if aligned else options.cuts)
        answers = _OWN if aligned else _OF_LINES
        launch(
            kernel("warp/epipolar.cl", "epipolar_sweep", ALIGNED=int(aligned), EDGES=int(exact)),
            (packets,),
            groups=upload(groups),
            group_count=len(groups),
            packet_count=packets,
            nearest=samples.high,
            farthest=samples.low,
            **common,
        )
    low_x, high_x, low_y, high_y = 0, width, 0, height
    if not target.blank:
        low_x, high_x, low_y, high_y = reach.low_x, reach.high_x, reach.low_y, reach.high_y
    rough, window = _LOOK_TORN if options.cuts else _LOOK_CONNECTED
    strip = 1 if session.lanes == 1 else _STRIP
    apart = min(math.ceil(0.5 / pixel_map.density), _APART_MOST)
    launch(
        kernel("warp/resolve.cl", "resolve", COLOR_BYTES=target.channel_bytes, STRIP=strip, ZOOMED=int(apart > 1)),
        (-(-(high_x - low_x) // (strip * session.lanes)), high_y - low_y),
        src_color=samples.color,
        linear=options.linear,
        merge=not target.blank,
        low_x=low_x,
        high_x=high_x,
        low_y=low_y,
        high_y=high_y,
        answers=answers,
        density=max(pixel_map.density, 1.0),
        typical=pixel_map.typical,
        apart=apart,
        rough=rough,
        window=window,
        **common,
        **target.outputs(),
    )
    target.blank = False


def _cut(camera: Camera, options: _Options) -> NDArray[np.void]:
    """A record of the kernels' struct Cut: which neighbours of the camera's view are torn apart."""
    if not options.cuts:
        return np.array((0.0, 0.0, 0.0), _CUT)
    if camera.projection == "perspective":
        return np.array((1.0, options.cut_ratio, 0.0), _CUT)
    sides = camera.width / camera.K[0, 0], camera.height / camera.K[1, 1]
    return np.array((1.0, 1.0, (options.cut_ratio - 1.0) * max(sides)), _CUT)


def _splat(samples: Samples, pixel_map: PixelMap, target: Target, options: _Options) -> None:
    from pyibr.opencl.launch import Struct, launch
    from pyibr.opencl.memory import empty
    from pyibr.opencl.program import kernel

    shape = (target.camera.height, target.camera.width)
    keys, indices = empty(shape, np.uint32), empty(shape, np.uint32)
    keys.fill(0)
    indices.fill(0xFFFFFFFF)
    bytes_ = target.color.dtype.itemsize
    the_map = Struct("PixelMap", pixel_map.struct)
    for name, more in (("splat_nearness", {}), ("splat_index", {"indices": indices})):
        launch(
            kernel("warp/forward.cl", name, COLOR_BYTES=bytes_),
            pixel_map.src.size,
            nearness=samples.nearness,
            keys=keys,
            map=the_map,
            size=options.splat,
            **more,
        )
    launch(
        kernel("warp/forward.cl", "splat_pixels", COLOR_BYTES=bytes_),
        target.camera.size,
        keys=keys,
        indices=indices,
        src_color=samples.color,
        map=the_map,
        merge=not target.blank,
        **target.outputs(),
    )
    target.blank = False


def _fill(target: Target, pixel_map: PixelMap) -> None:
    from pyibr.opencl.launch import launch
    from pyibr.opencl.memory import empty
    from pyibr.opencl.program import kernel

    width, height = target.camera.size
    bytes_ = target.color.dtype.itemsize
    blocks = empty((-(-height // 16), -(-width // 16)), np.uint8)
    shared = {"valid": target.valid, "blocks": blocks, "width": width, "height": height}
    launch(
        kernel("warp/fill.cl", "fill_blocks", COLOR_BYTES=bytes_),
        (blocks.shape[1], blocks.shape[0]),
        **shared,
    )
    x, y, w = pixel_map.epipole / max(float(np.abs(pixel_map.epipole).max()), 1e-30)
    launch(
        kernel("warp/fill.cl", "fill_holes", COLOR_BYTES=bytes_),
        (width, height),
        color=target.color,
        depth=target.depth,
        epipole_x=x,
        epipole_y=y,
        epipole_w=w,
        **shared,
    )


def _checked_views(views: DepthImage | Sequence[DepthImage]) -> list[DepthImage]:
    sources: list[DepthImage] = [views] if isinstance(views, DepthImage) else list(_listed(views))
    if not sources:
        raise ArgumentError("views", "at least one DepthImage", "an empty sequence")
    for view in sources:
        if not isinstance(view, DepthImage):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ArgumentError("views", "a DepthImage or a sequence of them", describe(view))
        if view.color.dtype != sources[0].color.dtype:
            raise ArgumentError("views", "colours of one dtype", f"{sources[0].color.dtype} and {view.color.dtype}")
    return sources


def _listed(views: object) -> Sequence[DepthImage]:
    """What `views` holds; something else than a sequence is one view, for the check to name."""
    return cast("Sequence[DepthImage]", views if isinstance(views, Sequence) else [views])


def _number(argument: str, value: float, least: float, most: float, expected: str) -> None:
    numeric = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)  # pyright: ignore[reportUnnecessaryIsInstance]
    above = numeric and (value > least if argument == "cut_ratio" else value >= least)
    if not (above and value <= most and math.isfinite(value)):
        raise ArgumentError(argument, expected, repr(value))
