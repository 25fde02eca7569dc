"""Image warping: a depth image, or several, to a new view (Schaufler & Priglinger 1999)."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Iterable, Sequence
from typing import Any, Literal, cast, overload

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import check_pixels, describe, number_from, one_of, true_or_false
from pyibr.core.errors import ArgumentError
from pyibr.core.pixelspace import PixelMap, camera_pair
from pyibr.core.straight import origins_in_lens
from pyibr.images import DepthImage, Frame
from pyibr.opencl.device import one_call
from pyibr.picture.antialiasing import averaged, checked_side, finer
from pyibr.picture.drawable import Edges, Fill, Look, Sample, Side
from pyibr.picture.panes import joined, pane_cameras
from pyibr.picture.samples import Samples, samples_of
from pyibr.picture.straighten import straightened
from pyibr.picture.target import Target, frames
from pyibr.warp.blending import Blend
from pyibr.warp.blending import blend as blend_layers
from pyibr.warp.drawing import options_of
from pyibr.warp.filling import fill_holes
from pyibr.warp.launches import Options, classify, look
from pyibr.warp.launches import splat as splat_samples

Array = NDArray[Any]
Method = Literal["epipolar", "search", "forward"]

_SPLAT_MOST = 64.0


@overload
def warp(
    views: DepthImage | Sequence[DepthImage],
    camera: Camera,
    method: Method = ...,
    sample: Sample = ...,
    edges: Edges = ...,
    fill: Fill | None = ...,
    *,
    cut_ratio: float = ...,
    side: Side = ...,
    thin: bool = ...,
    splat: float = ...,
    blend: Blend = ...,
    classes: bool = ...,
    samples: int = ...,
    out: Frame | None = ...,
) -> Frame: ...
@overload
def warp(
    views: DepthImage | Sequence[DepthImage],
    camera: Sequence[Camera],
    method: Method = ...,
    sample: Sample = ...,
    edges: Edges = ...,
    fill: Fill | None = ...,
    *,
    cut_ratio: float = ...,
    side: Side = ...,
    thin: bool = ...,
    splat: float = ...,
    blend: Blend = ...,
    classes: bool = ...,
    samples: int = ...,
    out: Sequence[Frame] | None = ...,
) -> list[Frame]: ...
def warp(
    views: DepthImage | Sequence[DepthImage],
    camera: Camera | Sequence[Camera],
    method: Method = "epipolar",
    sample: Sample = "linear",
    edges: Edges = "cut",
    fill: Fill | None = None,
    *,
    cut_ratio: float = 1.05,
    side: Side = "front",
    thin: bool = False,
    splat: float = 1.0,
    blend: Blend = "quality",
    classes: bool = False,
    samples: int = 1,
    out: Frame | Sequence[Frame] | None = None,
) -> Frame | list[Frame]:
    """Render depth images from a new camera.

    A depth image means a surface: the grid of its samples, each cell split from its upper right to its lower left
    corner. Each pixel of the target sees what its ray meets first. Several views are blended (see `blend`).

    Parameters
    ----------
    views : DepthImage or sequence of DepthImage
        The sources, perspective or orthographic, with colours of one dtype, or all of depth alone. Their
        buffers stay on the device, so that warping the same object again is cheaper.
    camera : Camera or sequence of Camera
        The target, perspective or orthographic; or several, which are drawn without a wait between them: each frame is
        the same as by a call of its own.
    method : {"epipolar", "search", "forward"}
        "epipolar" sweeps whole epipolar lines, O(n^2) (section 4 of the paper); "search" lets each pixel search its
        own epipolar segment, O(n^3); "forward" carries each sample over as a point, which leaves gaps where the
        target sees the surface larger than the source did, and to which `sample`, `edges` and `side` do not apply.
    sample : {"linear", "nearest"}
        Read the surface between the samples, or the sample nearest to where the ray meets the surface; for depth and
        colour alike.
    edges : {"cut", "connect"}
        "cut": the surface is open where neighbours' depths differ too much (see `cut_ratio`), as at the borders of
        objects in scenes. "connect": neighbouring samples are one surface, however far apart, as in displacement maps.
    fill : {None, "background", "smooth", "inpaint"}
        What is shown in holes; `valid` stays False there, and depth is filled, too. "background": what lies behind,
        from all around each hole; and where a view has a colour but no depth, that colour (black is none). "smooth":
        whatever is around, by distance. "inpaint": colours continued by OpenCV (Telea 2004), which is slower.
    cut_ratio : float
        Greater than 1: `edges="cut"` opens the surface where neighbours' depths have a greater ratio. Depths of an
        orthographic view have no origin that a ratio could refer to: it is cut where they differ by more than
        (`cut_ratio` - 1) times the longer side of what its camera sees.
    side : {"front", "back", "both"}
        Which side of the surface is shown: the one that faces the source's camera, the other (a solid displaced from
        a centre inside it and seen from outside), or either. A ray that meets the other side first sees a hole.
    thin : bool
        Things one sample thin (wires, leaves, bars), of which the surface between samples has nothing or little, are
        drawn as wide as their samples: each sample that makes a whole cell with its neighbours on no side as a square
        of its own size, swept to the neighbours that it is connected with. Not with "forward", whose samples are
        squares (see `splat`). Sensors' flying pixels become visible, too: see `clean_depth`.
    splat : float
        With "forward": side of the square of target pixels that a sample covers, 1 to 64.
    blend : {"quality", "nearest"}
        How several views become one picture. "quality": where what they see is no farther apart than their noise
        explains, all of them count: by resolution (up to the target's), by the angle between their ray and the
        target's, and less near their holes and depth edges; their exposures are matched first, where they overlap, to
        the one in the middle. Depths are blended, too. "nearest": each pixel is of the view that shows it nearest.
    classes : bool
        The frame tells, too, what each pixel is (`Frame.classes`: seen, hidden, never observed, outside of the view),
        and where in which view it comes from (`Frame.source`, `Frame.view`: of several, the one that counts most). Not
        with "forward". Following the holes' rays takes longer the larger the range of depth is.
    samples : int
        A pixel, on a regular grid within it: 1, 4, 9, 16, 25, 36, 49 or 64. Several make silhouettes and depth edges
        smooth, at up to as many times the cost; `Frame.alpha` tells how much of each pixel is covered. Only with one
        there are `classes`.
    out : Frame or sequence of Frame, optional
        Frames whose arrays are written instead of new ones: C-contiguous and writable, of the target's size and the
        views' dtype, each of them once. What `classes` tells is new in any case. A call that Ctrl-C ends leaves them
        written in part.

    Returns
    -------
    Frame, or list of Frame if `camera` is a sequence
        Colour in the views' dtype, planar depth, and where anything was seen.

    Raises
    ------
    ArgumentError
        An argument has a wrong type or value, or a view has no valid depth at all.
    DeviceError
        No OpenCL device works.
    MissingPackageError
        OpenCV is not installed (`fill="inpaint"`).

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
    given = _checked_views(views)
    cameras = _checked_cameras(camera)
    _check_sizes("camera", cameras)
    _check_sizes("views", [view.camera for view in given])
    one_of("method", method, Method)
    options = options_of(Look(sample, edges, cut_ratio, side, fill, thin), method == "search")
    one_of("blend", blend, Blend)
    number_from("splat", splat, 1.0, _SPLAT_MOST, f"1 to {_SPLAT_MOST:g} pixels")
    asked = true_or_false("classes", classes)
    if asked and method == "forward":
        raise ArgumentError("classes", 'False with method="forward", which asks no rays', "True")
    if options.thin and method == "forward":
        raise ArgumentError("thin", 'False with method="forward", which draws each sample as a square', "True")
    side_by_side = checked_side(samples)
    if asked and side_by_side > 1:
        raise ArgumentError("classes", "False with several samples a pixel, which may be of several classes", "True")
    outs = _checked_out(out, camera, cameras, given)
    sources = [straightened(view, cut_ratio=options.cut_ratio, linear=options.linear) for view in given]
    fine = [finer(one, side_by_side) for one in cameras]
    panes = [pane_cameras(one) for one in fine]
    _check_sizes("camera", itertools.chain(*panes))
    _check_sizes("views", [view.camera for view in sources])

    with one_call():
        prepared = [samples_of(view) for view in sources]
        pool: dict[int, Any] = {}
        targets: list[Target] = []
        like = sources[0].color
        for one, finer_one, parts, into in zip(cameras, fine, panes, outs, strict=True):
            whole = into if side_by_side == 1 else None
            drawn: list[Target] = []
            for part in parts:
                own = whole if one.lens is None else None
                drawn.append(Target(part, like.dtype, out=own, classes=asked, pool=pool, channels=like.shape[2]))
                _draw_views(drawn[-1], sources, prepared, method, options, float(splat), blend)
            targets.append(averaged(joined(drawn, finer_one, options.linear, whole), one, side_by_side, into))
        made = frames(targets)
    for frame in made:
        _through_lenses(frame, given)
    _tell_empty(made, isinstance(camera, Camera))
    return made[0] if isinstance(camera, Camera) else made


def _tell_empty(made: Sequence[Frame], is_single: bool) -> None:
    """Warn the caller of `warp` of frames without anything."""
    empty = [number for number, frame in enumerate(made) if not frame.valid.any()]
    if empty and is_single:
        warnings.warn("warp: the target camera sees nothing of the views; the frame is empty", stacklevel=3)
    elif empty:
        some = ", ".join(map(str, empty))
        warnings.warn(f"warp: target cameras {some} see nothing of the views; their frames are empty", stacklevel=3)


def _through_lenses(frame: Frame, views: Sequence[DepthImage]) -> None:
    """What a frame says of places in straightened views becomes what it says of the views."""
    if frame.source is None or frame.view is None:
        return
    for number, view in enumerate(views):
        if view.camera.lens is not None:
            own = frame.view == number
            frame.source[own] = origins_in_lens(view.camera, frame.source[own].astype(np.float64))


def _draw_views(
    target: Target,
    sources: Sequence[DepthImage],
    samples: Sequence[Samples],
    method: Method,
    options: Options,
    size: float,
    how: Blend,
) -> None:
    """Draw all views into a target, then what is asked for of its holes."""
    maps = [
        PixelMap(camera_pair(view.camera, target.camera), some.low, some.high)
        for view, some in zip(sources, samples, strict=True)
    ]
    several = len(sources) > 1 and how == "quality"
    layers = [target.layer() for _ in sources] if several else [target] * len(sources)
    for number, (some, pixel_map, layer) in enumerate(zip(samples, maps, layers, strict=True)):
        if method == "forward":
            splat_samples(some, pixel_map, layer, size)
        else:
            look(some, pixel_map, layer, options, number)
    if several:
        blend_layers(layers, sources, target)
    if target.classes is not None:
        for number, (some, pixel_map) in enumerate(zip(samples, maps, strict=True)):
            classify(some, pixel_map, target, options, number == 0)
    if options.fill is not None:
        fill_holes(target, list(zip(samples, maps, strict=True)), options.fill)


def _check_sizes(argument: str, cameras: Iterable[Camera]) -> None:
    for camera in cameras:
        check_pixels(argument, camera.size)


def _checked_views(views: DepthImage | Sequence[DepthImage]) -> list[DepthImage]:
    sources: list[DepthImage] = [views] if isinstance(views, DepthImage) else list(_listed(views))
    if not sources:
        raise ArgumentError("views", "at least one DepthImage", "an empty sequence")
    for view in sources:
        if not isinstance(view, DepthImage):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ArgumentError("views", "a DepthImage or a sequence of them", describe(view))
        if view.has_color != sources[0].has_color:
            raise ArgumentError("views", "views that all have colours, or none", "some of depth alone")
        if view.color.dtype != sources[0].color.dtype:
            raise ArgumentError("views", "colours of one dtype", f"{sources[0].color.dtype} and {view.color.dtype}")
    return sources


def _checked_cameras(camera: Camera | Sequence[Camera]) -> list[Camera]:
    cameras = [camera] if isinstance(camera, Camera) else list(camera) if isinstance(camera, Sequence) else []  # pyright: ignore[reportUnnecessaryIsInstance]
    if not cameras:
        got = "an empty sequence" if isinstance(camera, Sequence) else describe(camera)
        raise ArgumentError("camera", "a pyibr.Camera or a sequence of them", got)
    for one in cameras:
        if not isinstance(one, Camera):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ArgumentError("camera", "a pyibr.Camera or a sequence of them", describe(one))
    return cameras


def _checked_out(
    out: Frame | Sequence[Frame] | None,
    camera: Camera | Sequence[Camera],
    cameras: Sequence[Camera],
    views: Sequence[DepthImage],
) -> Sequence[Frame | None]:
    """A frame to write into for each camera, or None."""
    if out is None:
        return [None] * len(cameras)
    several = not isinstance(camera, Camera)
    outs = list(out) if isinstance(out, Sequence) else [out]
    if several != isinstance(out, Sequence) or len(outs) != len(cameras):
        expected = f"a sequence of {len(cameras)} frames" if several else "a Frame"
        raise ArgumentError("out", expected, f"{len(outs)} frames" if isinstance(out, Sequence) else describe(out))
    taken: list[Array] = [array for view in views for array in (view.color, view.depth)]
    like = views[0].color
    for one, frame in zip(cameras, outs, strict=True):
        if not isinstance(frame, Frame):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ArgumentError("out", "a Frame", describe(frame))
        shape = one.height, one.width
        kinds = (
            ("color", (*shape, like.shape[2]), like.dtype),
            ("depth", shape, np.float32),
            ("valid", shape, np.bool_),
        )
        for name, expected, dtype in kinds:
            given: object = getattr(frame, name)
            array = cast("Array", given)
            if not isinstance(given, np.ndarray) or array.shape != expected or array.dtype != dtype:
                raise ArgumentError(f"out.{name}", f"{np.dtype(dtype)} of shape {expected}", describe(array))
            if not (array.flags.c_contiguous and array.flags.writeable):
                raise ArgumentError(f"out.{name}", "a C-contiguous array that may be written", "one that is not")
            if any(np.may_share_memory(array, other) for other in taken):
                raise ArgumentError(f"out.{name}", "memory of its own", "memory that another array has, too")
            taken.append(array)
    return outs


def _listed(views: object) -> Sequence[DepthImage]:
    """What `views` holds; something else than a sequence is one view, for the check to name."""
    return cast("Sequence[DepthImage]", views if isinstance(views, Sequence) else [views])
