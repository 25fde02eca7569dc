"""Image warping: one or several depth images to a new view (Schaufler & Priglinger 1999)."""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, cast, overload

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import check_pixels, checked_bool, describe
from pyibr.core.errors import ArgumentError
from pyibr.core.undistortion import origins_in_lens
from pyibr.images import DepthImage, Frame
from pyibr.opencl.device import one_call
from pyibr.opencl.memory_pool import telling_shortage
from pyibr.picture.bands import Begin, frames_in_memory
from pyibr.picture.picture import PictureParts
from pyibr.picture.target import Target
from pyibr.warp.features import scatter_features
from pyibr.warp.view import OPTIONS, WarpedView, WarpOptions

if TYPE_CHECKING:
    from typing_extensions import Unpack

Array = NDArray[Any]
Views = DepthImage | Sequence[DepthImage] | WarpedView


@overload
def warp(
    views: Views,
    camera: Camera,
    *,
    origins: bool = ...,
    classes: bool = ...,
    samples: int = ...,
    out: Frame | None = ...,
    **options: Unpack[WarpOptions],
) -> Frame: ...
@overload
def warp(
    views: Views,
    camera: Sequence[Camera],
    *,
    origins: bool = ...,
    classes: bool = ...,
    samples: int = ...,
    out: Sequence[Frame] | None = ...,
    **options: Unpack[WarpOptions],
) -> list[Frame]: ...
def warp(
    views: Views,
    camera: Camera | Sequence[Camera],
    *,
    origins: bool = False,
    classes: bool = False,
    samples: int = 1,
    out: Frame | Sequence[Frame] | None = None,
    **options: Unpack[WarpOptions],
) -> Frame | list[Frame]:
    """Render depth images from a new camera.

    Parameters
    ----------
    views : DepthImage, sequence of DepthImage, or WarpedView
        The sources. Depth images are drawn with the options; a `WarpedView` has options of its own.
    camera : Camera or sequence of Camera
        The target, perspective or orthographic; or several targets, which are drawn without a wait between them: each
        frame equals the frame of a separate call.
    origins : bool
        Add the origin of each pixel to the frame: the place in the source and the view (`Frame.source`, `Frame.view`;
        with several views, the view of the greatest weight). Not with `method="forward"`.
    classes : bool
        Add the origins and the class of each pixel to the frame (`Frame.classes`: seen, hidden, never observed, outside
        of the view). Not with `method="forward"`.
    samples : int
        Number of samples a pixel, on a regular grid within it: 1, 4, 9, 16, 25, 36, 49 or 64. Several samples make
        silhouettes and depth edges smooth, at up to as many times the cost; `Frame.alpha` gives the covered part of
        each pixel. `origins` and `classes` require a single sample.
    out : Frame or sequence of Frame, optional
        Frames to write into, instead of new ones. Their arrays are C-contiguous and writable, have the target's size
        and the views' dtype, and share no memory. Arrays for `origins` and `classes` are new in any case, and those for
        features if the frame has none. If Ctrl-C ends the call, the frames are partly written.
    **options
        Options of `WarpedView`, such as `method`, `interpolation`, `edges` and `fill`.

    Returns
    -------
    Frame, or list of Frame if `camera` is a sequence
        Colour in the views' dtype, planar depth, and a mask of the pixels that were seen. If the views have features,
        the frames have features and origins, too.

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
        If the target sees no part of any view.

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
    made = warped_frames(views, camera, origins=origins, classes=classes, samples=samples, out=out, **options)
    _tell_empty(made, isinstance(camera, Camera))
    return made[0] if isinstance(camera, Camera) else made


def warped_frames(
    views: Views,
    camera: Camera | Sequence[Camera],
    *,
    origins: bool = False,
    classes: bool = False,
    samples: int = 1,
    out: Frame | Sequence[Frame] | None = None,
    **options: Unpack[WarpOptions],
) -> list[Frame]:
    """Return the frames of `warp` as a list, without a warning of empty ones."""
    thing = _view_of(views, options)
    cameras = checked_cameras("camera", camera)
    for view in thing.views:
        check_pixels("views", view.camera.size)
    asked = {"origins": checked_bool("origins", origins), "classes": checked_bool("classes", classes)}
    for one in cameras:
        PictureParts(one, samples)  # checks them
    for name in (name for name, is_asked in asked.items() if is_asked):
        if thing.method == "forward":
            raise ArgumentError(name, 'False with method="forward", which casts no rays', "True")
        if samples > 1:
            raise ArgumentError(name, "False with several samples a pixel, which may differ", "True")
    if samples > 1 and thing.channels:
        raise ArgumentError("samples", "1 with views that have features", str(samples))
    asked["origins"] |= asked["classes"] or thing.channels > 0
    outs = _checked_out(out, camera, cameras, thing.views)
    with telling_shortage("this machine"):
        sources = thing.sources
    for view in sources:
        check_pixels("views", view.camera.size)

    def draw(target: Target) -> None:
        thing.draw(target, None)
        thing.guess(target, None)
        thing.finish(target)
        target.hide_guesses()

    color = thing.views[0].color

    def begin() -> Begin:
        shared: dict[str, Any] = {"dtype": color.dtype, "channels": color.shape[2], "pool": {}, **asked}

        def one(camera: Camera, out: Frame | None) -> Callable[[], Frame]:
            target = PictureParts(camera, samples).drawn(draw, out=out, **shared)
            if thing.channels:
                thing.carry_features(target)
            return target.begin_frame()

        return one

    with one_call() as session:
        thing.begin(cameras[0], **asked)
        made = frames_in_memory(session, cameras, outs, begin, in_bands=thing.fill is None)
    with telling_shortage("this machine"):
        for frame in made:
            _through_lenses(frame, thing.views)
    return made


def warp_transposed(
    view: DepthImage, camera: Camera, gradient: NDArray[np.float32], **options: Unpack[WarpOptions]
) -> NDArray[np.float32]:
    """Return the transposed map of the warp of a view's features: (H, W, C) sums at the samples.

    A sample sums the values of the pixels of `gradient`, (height, width, C), with the weights that it has in them.
    Neither camera has a lens.
    """
    thing = WarpedView(view, **options)
    with one_call():
        thing.begin(camera, origins=True)
        target = Target(camera, view.color.dtype, channels=0, origins=True)
        thing.draw(target, None)
        return scatter_features(thing.corners(target, 0), gradient, view.depth.shape).to_host()


def _complete_signature() -> inspect.Signature:
    """Signature of `warp` with all options by name, for `help` and the manual."""
    own = inspect.signature(warp)
    parameters = [one for one in own.parameters.values() if one.kind is not one.VAR_KEYWORD]
    return own.replace(parameters=[*parameters[:2], *OPTIONS, *parameters[2:]])


warp.__signature__ = _complete_signature()  # pyright: ignore[reportFunctionMemberAccess]


def _view_of(views: Views, options: WarpOptions) -> WarpedView:
    if isinstance(views, WarpedView):
        if options:
            raise ArgumentError(next(iter(options)), "none: a WarpedView has options of its own", "one")
        return views
    return WarpedView(views, **options)


def _tell_empty(made: Sequence[Frame], is_single: bool) -> None:
    """Warn the caller of `warp` about empty frames."""
    empty = [number for number, frame in enumerate(made) if not (frame.valid.any() or np.isfinite(frame.depth).any())]
    if empty and is_single:
        warnings.warn("warp: the target camera sees nothing of the views; the frame is empty", stacklevel=3)
    elif empty:
        some = ", ".join(map(str, empty))
        warnings.warn(f"warp: target cameras {some} see nothing of the views; their frames are empty", stacklevel=3)


def _through_lenses(frame: Frame, views: Sequence[DepthImage]) -> None:
    """Convert a frame's origins from undistorted views to the views with their lenses."""
    if frame.source is None or frame.view is None:
        return
    for number, view in enumerate(views):
        if view.camera.lens is not None:
            own = frame.view == number
            frame.source[own] = origins_in_lens(view.camera, frame.source[own].astype(np.float64))


def checked_cameras(argument: str, camera: Camera | Sequence[Camera]) -> list[Camera]:
    """Return the cameras of an argument, at least one."""
    cameras = [camera] if isinstance(camera, Camera) else list(camera) if isinstance(camera, Sequence) else []  # pyright: ignore[reportUnnecessaryIsInstance]
    if not cameras:
        got = "an empty sequence" if isinstance(camera, Sequence) else describe(camera)
        raise ArgumentError(argument, "a pyibr.Camera or a sequence of them", got)
    for one in cameras:
        if not isinstance(one, Camera):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ArgumentError(argument, "a pyibr.Camera or a sequence of them", describe(one))
    return cameras


def _checked_out(
    out: Frame | Sequence[Frame] | None,
    camera: Camera | Sequence[Camera],
    cameras: Sequence[Camera],
    views: Sequence[DepthImage],
) -> Sequence[Frame | None]:
    """Frame to write into for each camera, or None."""
    if out is None:
        return [None] * len(cameras)
    several = not isinstance(camera, Camera)
    outs = list(out) if isinstance(out, Sequence) else [out]
    if several != isinstance(out, Sequence) or len(outs) != len(cameras):
        expected = f"a sequence of {len(cameras)} frames" if several else "a Frame"
        raise ArgumentError("out", expected, f"{len(outs)} frames" if isinstance(out, Sequence) else describe(out))
    taken: list[Array] = [
        array for view in views for array in (view.color, view.depth, view.features) if array is not None
    ]
    like, features = views[0].color, views[0].features
    for one, frame in zip(cameras, outs, strict=True):
        if not isinstance(frame, Frame):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ArgumentError("out", "a Frame", describe(frame))
        shape = one.height, one.width
        kinds = (
            ("color", (*shape, like.shape[2]), like.dtype),
            ("depth", shape, np.float32),
            ("valid", shape, np.bool_),
        )
        if features is not None and frame.features is not None:
            kinds = (*kinds, ("features", (*shape, features.shape[2]), features.dtype))
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
