"""Registration of depth to the image of another camera, and of colours to the depth of another camera."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera, Projection
from pyibr.core.checks import check_pixels, checked_colors, cut_ratio_from, describe, instance_of, plain_array, positive
from pyibr.core.errors import ArgumentError
from pyibr.core.pixelspace import PixelMap, camera_pair, pitch
from pyibr.core.undistortion import undistorted_face
from pyibr.images import DepthImage
from pyibr.images.depth_image import Color, checked_depth
from pyibr.images.noise import Noise
from pyibr.opencl.device import current, one_call
from pyibr.opencl.headers import constant, struct
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, empty, to_host, upload
from pyibr.opencl.program import kernel
from pyibr.picture.cube_faces import cube_face_cameras, joined_faces
from pyibr.picture.samples import Samples, at_least_a_word, bridged_samples, cut_of
from pyibr.picture.surface import make_surface, straightness_test, test_by_cut
from pyibr.picture.target import Target
from pyibr.picture.undistort import positions_on_device, undistorted_view
from pyibr.warp.launches import Options, Pass, map_of

AnyDepth = TypeVar("AnyDepth", NDArray[np.float32], NDArray[np.uint16])

_CUT_RATIO = 1.05  # neighbours whose depths have a greater ratio may belong to different surfaces
_DEVIATIONS = 3 * 2**0.5  # as in `pyibr.warp.filling`
_STRIDE, _RANGE = 7, (0.02, 0.98)  # the range of depth: two quantiles of every 7th sample in every 7th row
_LENSES = {  # LENS of kernels/lib/lens.h
    "brown_conrady": 1,
    "rational": 1,
    "inverse_brown_conrady": 2,
    "modified_brown_conrady": 2,
    "kannala_brandt": 3,
    "tilted": 4,
}


class RegisteredColor(NamedTuple):
    """Colours of depth samples, as returned by `register_color`.

    Attributes
    ----------
    color : (H, W, 3)
        For each depth sample, in the dtype of the colours; black where the sample is not seen.
    seen : (H, W) bool
        Whether there is a sample and the colour camera sees it.

    Examples
    --------
    >>> import pyibr as ibr
    >>> ibr.RegisteredColor._fields
    ('color', 'seen')
    """

    color: Color
    seen: NDArray[np.bool_]


def register(
    depth: AnyDepth,
    depth_camera: Camera,
    color_camera: Camera,
    *,
    depth_scale: float | None = None,
    cut_ratio: float | None = None,
    noise: Noise | None = None,
) -> AnyDepth:
    """Bring depth to the camera that took the colours: the depth that this camera would have measured.

    The depth image defines a surface, as in `warp`. The surface covers the pixels that measured it: at depth edges it
    extends half a pixel beyond the last samples, so that objects one sample thin are kept. Single missing samples amid
    a surface are bridged. So depth in the colour camera has no gaps between samples. Where the colour camera looks past
    an edge and several surfaces lie on a ray, the result is the nearest one.

    Parameters
    ----------
    depth : (H, W) float32 or uint16
        Planar z of `depth_camera`; NaN, infinite or <= 0 for missing depth.
    depth_camera, color_camera : Camera
        Both with their poses in one world: ``world_from_camera`` is the identity for one camera and the calibration's
        transform for the other. Lenses are taken into account. Different cameras that both stand at the origin give
        a warning.
    depth_scale : float
        For uint16: stored units per scene unit (the unit of the cameras' poses), 1000 for millimetres and metres.
    cut_ratio : float, optional
        Greater than 1: between neighbours whose depths have a greater ratio lies a depth edge, unless noise explains
        the ratio. By default the ratio is 1.05, and the surface's shape must show an edge there, too, as in `warp`.
    noise : float, (a, b, c) or callable, optional
        Noise of the depth in scene units, in the forms that `DepthImage` accepts. By default it is estimated
        from the samples.

    Returns
    -------
    (h, w) array of the depth's dtype
        Planar z of `color_camera` in the same units; NaN (0 for uint16) where the depth camera saw nothing. Depths
        beyond the range of uint16 become 0, too.

    Raises
    ------
    ArgumentError
        If shapes, dtypes and cameras do not fit, or there is no depth at all.

    Warns
    -----
    UserWarning
        If the cameras differ, but both stand at the origin: the pose between them may be missing.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> K = [[100, 0, 31.5], [0, 100, 23.5], [0, 0, 1]]
    >>> depth_camera, color_camera = ibr.Camera(K, (64, 48)), ibr.Camera(K, (64, 48)).moved(0.025, 0, 0)
    >>> registered = ibr.register(np.full((48, 64), 1500, np.uint16), depth_camera, color_camera, depth_scale=1000)
    >>> registered.dtype, int(registered[24, 32])
    (dtype('uint16'), 1500)
    """
    stored, units, ratio = _checked(depth, depth_camera, color_camera, depth_scale, cut_ratio)
    warn_of_one_place(depth_camera, color_camera)
    with one_call():
        registered = _drawn(_view_of(stored, units, depth_camera, noise), color_camera, ratio).picture.depth
        if units:
            counts = empty(registered.shape, np.uint16)
            _convert("to_raw_depth", counts, raw=counts, depth=registered, scale=units)
            registered = counts
        return cast("AnyDepth", registered.to_host())


def register_color(
    depth: NDArray[np.float32] | NDArray[np.uint16],
    depth_camera: Camera,
    color_camera: Camera,
    color: Color,
    *,
    depth_scale: float | None = None,
    cut_ratio: float | None = None,
    noise: Noise | None = None,
) -> RegisteredColor:
    """Bring colours to the samples of depth that the colour camera sees.

    Samples have no colour if something nearer hides them from the colour camera, beyond what noise explains, or if they
    lie outside of its image. Colours of other surfaces next to a sample are not mixed into its colour.

    Parameters
    ----------
    depth, depth_camera, color_camera, depth_scale, cut_ratio, noise
        As for `register`.
    color : (h, w, 3) uint8, or float32 in [0, 1]
        Image of `color_camera`.

    Returns
    -------
    RegisteredColor

    Raises
    ------
    ArgumentError
        As for `register`, whose UserWarning is given, too.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> camera = ibr.Camera([[100, 0, 31.5], [0, 100, 23.5], [0, 0, 1]], (64, 48))
    >>> depth, color = np.full((48, 64), 1.5, np.float32), np.full((48, 64, 3), 90, np.uint8)
    >>> ibr.register_color(depth, camera, camera.moved(0.025, 0, 0), color).color[24, 32].tolist()
    [90, 90, 90]
    """
    stored, units, ratio = _checked(depth, depth_camera, color_camera, depth_scale, cut_ratio)
    warn_of_one_place(depth_camera, color_camera)
    given = checked_colors("color", color, (color_camera.height, color_camera.width, 3))
    with one_call():
        view = _view_of(stored, units, depth_camera, noise)
        return _colors_for(view, color_camera, given, _drawn(view, color_camera, ratio))


def warn_of_one_place(depth_camera: Camera, color_camera: Camera) -> None:
    """Warn if different cameras both stand at the origin, as cameras of calibrations without poses do."""
    if any((one.world_from_camera != np.eye(4)).any() for one in (depth_camera, color_camera)):
        return
    resized = color_camera.resized(depth_camera.size)  # as of phones
    if depth_camera.lens != color_camera.lens or not np.allclose(resized.K, depth_camera.K, rtol=1e-3):
        warnings.warn(
            "the cameras of depth and colour differ, but both stand at the origin; unless they share one viewpoint, "
            "set the depth camera's world_from_camera to its pose in the colour camera's frame (--extrinsics)",
            stacklevel=1,  # one place for all callers: it is shown once
        )


def _view_of(stored: Any, units: float, camera: Camera, noise: Noise | None) -> DepthImage:
    """Return an image of depth alone, in scene units, from the results of `_checked`. The session is held."""
    depth = stored
    if units:
        converted = empty(stored.shape, np.float32)
        _convert("to_depth", converted, raw=upload(stored), depth=converted, scale=units)
        depth = converted.to_host()
    return DepthImage(None, depth, camera, noise=noise)


def _checked(
    depth: NDArray[np.float32] | NDArray[np.uint16],
    depth_camera: Camera,
    color_camera: Camera,
    depth_scale: float | None,
    cut_ratio: float | None,
) -> tuple[Any, float, float | None]:
    """Return the depth, its stored units per scene unit (0 for float32), and the ratio that cuts."""
    for name, camera in (("depth_camera", depth_camera), ("color_camera", color_camera)):
        check_pixels(name, instance_of(name, camera, Camera, "a pyibr.Camera").size)
    shape = depth_camera.height, depth_camera.width
    ratio = None if cut_ratio is None else cut_ratio_from(cut_ratio)
    if not isinstance(depth, np.ndarray) or depth.dtype.name != "uint16":  # pyright: ignore[reportUnnecessaryIsInstance]
        if depth_scale is not None:
            raise ArgumentError("depth_scale", "none for float32 depth, which is in scene units", repr(depth_scale))
        return checked_depth(cast("NDArray[np.float32]", depth), shape), 0.0, ratio
    if depth.shape != shape:
        raise ArgumentError("depth", f"float32 or uint16 of shape {shape}", describe(depth))
    if depth_scale is None:
        raise ArgumentError(
            "depth_scale", "stored units per scene unit for uint16 depth (1000: millimetres to metres)", "none"
        )
    counts = np.ascontiguousarray(plain_array("depth", depth, "integers", 0), np.uint16)  # masked: no depth
    return counts, positive("depth_scale", depth_scale), ratio


def _convert(name: str, made: DeviceArray, **arguments: Any) -> None:
    count, profile = math.prod(made.shape), current().profile
    launch(kernel("warp/raw_depth.cl", name), profile.shares(count), count=count, share=profile.share, **arguments)


@dataclass(frozen=True)
class _Drawn:
    """A depth image drawn as a picture of depth."""

    source: DepthImage  # the image, undistorted
    cut: NDArray[np.void]  # the kernels' struct Cut for the image
    cut_there: NDArray[np.void]  # the kernels' struct Cut for the picture
    samples: Samples  # the image's samples, with single missing ones bridged amid a surface
    picture: Target


def _drawn(view: DepthImage, camera: Camera, cut_ratio: float | None) -> _Drawn:
    """Draw the surface of an image as a camera sees it. The session is held."""
    own, there, ratio = view.camera.projection, camera.projection, cut_ratio or _CUT_RATIO
    noise = _noise_in(view, own)
    cut = cut_of(view.camera, ratio, noise)
    cut_there = cut_of(camera, ratio, noise if own == there else _noise_in(view, there))
    source = undistorted_view(view, cut)
    samples = bridged_samples(source, cut)
    # Here a gap is worse than a bridge over a small step, so neighbours are torn only if both tests tear them.
    test = straightness_test(source.camera, cut) if cut_ratio is None else test_by_cut(source.camera, cut)
    surface = make_surface(samples, source.camera.size, test)
    targets: list[Target] = []
    pool: dict[tuple[int, int], Any] = {}
    for part in cube_face_cameras(camera):
        targets.append(Target(part, np.dtype(np.uint8), channels=0, pool=pool))
        pixel_map = PixelMap(camera_pair(source.camera, part), surface)
        Pass(surface, pixel_map, targets[-1], Options()).draw()
    return _Drawn(source, cut, cut_there, samples, joined_faces(targets, camera))


def _noise_in(view: DepthImage, projection: Projection) -> tuple[float, float]:
    """Largest difference between neighbours that noise explains, as `noise` of `cut_of` for this projection."""
    if not any(view.noise):
        return 0.0, 0.0
    a, b, c = (_DEVIATIONS * each for each in view.noise)
    some = np.ascontiguousarray(view.depth[::_STRIDE, ::_STRIDE])
    depths = some[(some > 0) & (some < view.far)]
    if not len(depths):
        depths = view.depth[(view.depth > 0) & (view.depth < view.far)]
    places = [int(part * len(depths)) for part in _RANGE]
    near, far = np.partition(depths, places)[places].tolist()
    return (b + c / near, a) if projection == "perspective" else (0.0, (a * far + b) * far + c)


def _noise(view: DepthImage) -> Struct:
    """Noise of nearness, in the form for kernels/warp/sample_colors.cl."""
    values = np.zeros((), struct("warp/sample_colors.cl", "Noise"))
    a, b, c = view.noise
    values["a"], values["b"], values["c"] = (a, b, c) if view.camera.projection == "perspective" else (c, -b, a)
    return Struct("Noise", values)


def _lens(camera: Camera) -> tuple[int, Struct]:
    """The lens's number LENS and struct, of kernels/lib/lens.h."""
    values = np.zeros((), struct("lib/lens.h", "Lens"))
    (values["fx"], values["skew"], values["cx"]), (_, values["fy"], values["cy"]), _ = camera.K
    if camera.lens is None:
        return 0, Struct("Lens", values)
    coefficients = camera.lens.coefficients
    values["k"][: len(coefficients)] = coefficients
    values["reach"], values["tilt"] = camera.lens.reach, camera.lens.tilt.ravel()
    return _LENSES[camera.lens.model], Struct("Lens", values)


def _colors_for(view: DepthImage, camera: Camera, color: Color, drawn: _Drawn) -> RegisteredColor:
    """Find the colours of a view's samples in a camera's image. The session is held."""
    width, height = view.camera.size
    kind, lens = _lens(camera)
    samples = drawn.samples
    placed = view.camera.lens is not None
    made = empty((height, width, 3), color.dtype), empty((height, width), np.uint8)
    pinhole = Camera(camera.K, camera.size, camera.world_from_camera, projection=camera.projection)
    defines = {"LENS": kind, "HAS_PLACES": int(placed), "COLOR_BYTES": color.dtype.itemsize}
    launch(
        kernel("warp/sample_colors.cl", "color_samples", **defines),
        current().profile.packets(width, height),
        places=positions_on_device(undistorted_face(view.camera)) if placed else samples.nearness,
        depth=upload(view.depth),
        nearness=samples.nearness,
        shown=drawn.picture.depth,
        color=upload(at_least_a_word(color)),
        width=width,
        height=height,
        pitch=pitch(width),
        perspective=view.camera.projection == "perspective",
        far=1 / constant("lib/surface.h", "NEAREST"),
        map=map_of(camera_pair(drawn.source.camera, pinhole)),
        cut=Struct("Cut", drawn.cut),
        shown_cut=Struct("Cut", drawn.cut_there),
        noise=_noise(view),
        lens=lens,
        sample_color=made[0],
        seen=made[1],
    )
    colors, seen = to_host(made)
    return RegisteredColor(cast("Color", colors), seen.view(np.bool_))
