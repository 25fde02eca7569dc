"""Undistortion of images on the device: resampling from a lens to a pinhole camera, with depth edges kept."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import check_pixels, cut_ratio_from, instance_of, one_of
from pyibr.core.errors import ArgumentError
from pyibr.core.pixelspace import pitch
from pyibr.core.undistortion import (
    ANGLE_MAX,
    CubeFace,
    PixelPositions,
    positions_in_lens,
    sees_too_far,
    undistorted_camera,
)
from pyibr.images import DepthImage
from pyibr.images.depth_image import Features
from pyibr.images.silhouette import Silhouette
from pyibr.opencl.device import current, one_call
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.headers import constant
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, empty, to_host, upload
from pyibr.opencl.program import kernel
from pyibr.picture.samples import at_least_a_word, cut_of

Interpolation = Literal["linear", "nearest"]

_CACHED_MAX = 4  # undistorted copies of a view, one for each cut


def undistorted(
    view: DepthImage, *, cut_ratio: float | None = 1.05, interpolation: Interpolation = "linear"
) -> DepthImage:
    """Return the view of a pinhole camera at the same pose; the view itself if it has no lens.

    All functions that draw a view with a lens call this first. No part of the view gets fewer samples. Holes stay
    holes, and pixels that the lens did not see become holes.

    Parameters
    ----------
    view : DepthImage
        The view, which caches the result.
    cut_ratio : float or None
        Neighbours whose depths have a greater ratio are two surfaces. Between them, depth and colour are taken from the
        nearest sample; elsewhere they are interpolated. With None, all neighbours are one surface.
    interpolation : {"linear", "nearest"}
        Interpolation of colours between samples.

    Raises
    ------
    ArgumentError
        If there is valid depth farther than 75 degrees from the axis, which no pinhole image can hold.
    DeviceError
        No OpenCL device works.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> lens = ibr.Lens("brown_conrady", [-0.3, 0, 0, 0])
    >>> camera = ibr.Camera([[50, 0, 30], [0, 50, 18], [0, 0, 1]], (61, 37), lens=lens)
    >>> view = ibr.DepthImage(np.zeros((37, 61, 3), np.uint8), np.full((37, 61), 2, np.float32), camera)
    >>> ibr.undistorted(view).camera.width > 61  # its corners were drawn in
    True
    """
    instance_of("view", view, DepthImage, "a pyibr.DepthImage")
    if cut_ratio is not None:
        cut_ratio_from(cut_ratio)
    one_of("interpolation", interpolation, Interpolation)
    return undistorted_view(view, cut_of(view.camera, cut_ratio), interpolation == "linear")


def undistorted_view(view: DepthImage, cut: NDArray[np.void], linear: bool = True) -> DepthImage:
    """Return the same as `undistorted`, with a record of the kernels' struct Cut instead of a ratio."""
    if view.camera.lens is None:
        return view
    with one_call():
        key = cut.tobytes(), linear
        return cached_on_device(view, "undistorted", lambda: _undistorted_view(view, cut, linear), key, _CACHED_MAX)


def undistorted_silhouette(view: Silhouette) -> Silhouette:
    """Return the silhouette of a pinhole camera at the same pose; the view itself if it has no lens.

    Raises
    ------
    ArgumentError
        If the object is seen farther than 75 degrees from the axis, which no pinhole image can hold.
    """
    if view.camera.lens is None:
        return view
    _check_within("mask", "an object", view.valid, view.camera)
    outline = view.valid.astype(np.float32)
    with one_call():
        color, seen = _undistorted(view.color, outline, np.inf, view.camera, cut_of(view.camera, None), linear=True)
    return Silhouette(color, seen > 0, undistorted_camera(view.camera))


def positions_on_device(thing: CubeFace | PixelPositions) -> DeviceArray:
    """Return the positions for kernels, with rows padded to `pitch` by NaN. Cached."""
    return cached_on_device(thing, "places", lambda: _padded(thing.places))


def _padded(places: NDArray[np.float32]) -> DeviceArray:
    count, height, width = places.shape
    padded = np.full((count, height, pitch(width)), np.nan, np.float32)
    padded[..., :width] = places
    return upload(padded)


def _undistorted_view(view: DepthImage, cut: NDArray[np.void], linear: bool) -> DepthImage:
    if sees_too_far(view.camera).any():
        _check_within("depth", "samples", view.valid, view.camera)
    color, depth = _undistorted(view.color, view.depth, view.far, view.camera, cut, linear)
    normals = None
    if view.normals is not None:
        normals, _ = _undistorted(view.normals, view.depth, view.far, view.camera, cut, linear)
    features = None if view.features is None else _undistorted_features(view, view.features, cut, linear)
    camera = undistorted_camera(view.camera)
    # Interpolated samples are unevenly smoothed, so edges are detected with the noise of the original samples.
    colors = color if view.has_color else None
    told: dict[str, Any] = {
        "far": view.far,
        "normals": normals,
        "noise": view.noise,
        "features": features,
        "guessed": view.guessed,
    }
    return DepthImage(colors, depth, camera, **told)


def _undistorted_features(view: DepthImage, features: Features, cut: NDArray[np.void], linear: bool) -> Features:
    """Undistort features as colours of three channels each."""
    made = list[NDArray[Any]]()
    for first in range(0, features.shape[2], 3):
        some = features[..., first : first + 3]
        some = some.astype(np.float32) if some.dtype == np.float16 else some
        padded = np.pad(some, ((0, 0), (0, 0), (0, 3 - some.shape[2])))
        color, _ = _undistorted(padded, view.depth, view.far, view.camera, cut, linear)
        made.append(color[..., : some.shape[2]].astype(features.dtype))
    return np.concatenate(made, axis=2)


def _check_within(argument: str, what: str, valid: NDArray[np.bool_], camera: Camera) -> None:
    beyond = int((valid & sees_too_far(camera)).sum())
    if beyond:
        expected = f"{what} of a lens up to {ANGLE_MAX:g} degrees from its axis"
        raise ArgumentError(argument, expected, f"{beyond} pixels farther from it")


def _undistorted(
    color: NDArray[Any], depth: NDArray[np.float32], far: float, camera: Camera, cut: NDArray[np.void], linear: bool
) -> tuple[NDArray[Any], NDArray[np.float32]]:
    check_pixels("camera", camera.size)
    places = positions_in_lens(camera)
    _, height, width = places.places.shape
    made = empty((height, width, color.shape[2]), color.dtype), empty((height, width), np.float32)
    launch(
        kernel("picture/undistort.cl", "undistort", COLOR_BYTES=color.dtype.itemsize, CHANNELS=color.shape[2]),
        current().profile.packets(width, height),
        places=positions_on_device(places),
        lens_depth=upload(depth),
        color=upload(at_least_a_word(color)),
        lens_width=camera.width,
        lens_height=camera.height,
        far=min(far, 1 / constant("lib/surface.h", "NEAREST")),
        cut=Struct("Cut", cut),
        linear=linear,
        width=width,
        height=height,
        pitch=pitch(width),
        undistorted_depth=made[1],
        undistorted_color=made[0],
    )
    undistorted_color, undistorted_depth = to_host(made)
    return undistorted_color, undistorted_depth
