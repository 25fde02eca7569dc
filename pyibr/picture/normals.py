"""Normals of a depth image's surface: from normal images, or from depths (kernels/picture/normals.cl)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64, instance_of
from pyibr.core.pixelspace import pitch, pixel_size
from pyibr.core.undistortion import check_no_lens
from pyibr.images import DepthImage
from pyibr.opencl.device import current, one_call
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.headers import constant
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import empty
from pyibr.opencl.program import kernel
from pyibr.picture.samples import cut_of, samples_of

_CUT_RATIO = 1.05  # neighbours whose depths have a greater ratio lie on different surfaces
NEIGHBOUR_OFFSET_MAX = 64  # greatest distance, in pixels, to the neighbours whose depths give a pixel's normal
_DEVIATIONS = 3.0  # shadow bias in standard deviations of the noise
_MOST_OF = 0.9  # the noise is evaluated at this quantile of the depths
_SLOPE_ERROR_MAX = 0.1  # standard deviation of slopes due to noise: 6 degrees for a surface that faces the camera


def normals_of(view: DepthImage) -> NDArray[np.float32]:
    """Return the normals of a view's samples: the given ones, and estimates from depths where none are given.

    An estimate is the normal of the plane that best fits the surrounding samples on the same surface: one sample to
    each side, or up to eight if the depths are noisy (`DepthImage.noise`).

    Parameters
    ----------
    view : DepthImage
        A view without a lens.

    Returns
    -------
    (H, W, 3) float32
        Unit vectors in the camera's frame. Estimates point towards the camera. Pixels without samples have arbitrary
        values.

    Raises
    ------
    ArgumentError
        If no sample is valid, or the view has a lens.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> from pyibr.picture.normals import normals_of
    >>> camera = ibr.Camera([[10, 0, 3], [0, 10, 4], [0, 0, 1]], (7, 9), projection="orthographic")
    >>> rising = np.tile(3 + np.arange(7, dtype=np.float32) / 40, (9, 1))  # by a quarter a unit to the right
    >>> [round(float(n), 2) + 0.0 for n in normals_of(ibr.DepthImage(None, rising, camera))[4, 3]]
    [0.24, 0.0, -0.97]
    """
    instance_of("view", view, DepthImage, "a pyibr.DepthImage")
    check_no_lens("view", view.camera)
    if view.normals is None:
        return _found(view)
    known = ~np.isnan(view.normals[..., :1])
    return view.normals if known[view.valid].all() else np.where(known, view.normals, _found(view))


def showing_normals(view: DepthImage) -> DepthImage:
    """Return the view with normals as colours: each world component n is stored as 0.5 + 0.5 n. Cached.

    Code that interpolates and blends colours of views then works on normals, too, for the G-buffer
    (kernels/lib/gbuffer.h).
    """

    def made() -> DepthImage:
        turn = view.camera.world_from_camera[:3, :3].astype(np.float32)
        shown = np.clip(0.5 + 0.5 * (np.nan_to_num(normals_of(view)) @ turn.T), 0, 1)
        return DepthImage(shown, view.depth, view.camera, far=view.far)

    return cached_on_device(view, "normals for colours", made)


def _found(view: DepthImage) -> NDArray[np.float32]:
    width, height = view.camera.size
    with one_call():
        normals, K = empty((height, width, 3), np.float32), view.camera.K
        launch(
            kernel("picture/normals.cl", "fit_normals"),
            current().profile.packets(width, height),
            nearness=samples_of(view).nearness,
            normals=normals,
            width=width,
            height=height,
            pitch=pitch(width),
            perspective=view.camera.projection == "perspective",
            cut=Struct("Cut", cut_of(view.camera, _CUT_RATIO)),
            radius=_radius(view),
            fx=K[0, 0],
            skew=K[0, 1],
            fy=K[1, 1],
            cx=K[0, 2],
            cy=K[1, 2],
        )
        return np.array(normals.to_host())


def noise_bias(views: Sequence[DepthImage], camera: Camera, middle: Float64) -> tuple[float, int]:
    """Return the shadow bias that keeps noisy surfaces made from views from shadowing themselves.

    camera: camera of the picture. middle: (3,) a point in the middle of the surface, in the world. Returns `bias` and
    `apart` of `pyibr.picture.deferred.entry_for`; without noise, `apart` is 1.
    """
    pixel, bias, apart = pixel_size(camera, middle), 0.0, 1
    for view in views:
        radius, off = cached_on_device(
            view, "noise bias", lambda view=view: (_radius(view), _DEVIATIONS * _far_noise(view))
        )
        bias = max(bias, off)
        if radius > 1:
            samples = radius * pixel_size(view.camera, middle)
            apart = max(apart, math.ceil(min(samples / max(pixel, 1e-30), NEIGHBOUR_OFFSET_MAX)))
    return bias, apart


def _noise_at(view: DepthImage, z: float) -> float:
    a, b, c = view.noise
    return (a * z + b) * z + c


def _far_noise(view: DepthImage) -> float:
    """Noise of the view's far samples, in scene units."""
    return _noise_at(view, float(np.quantile(view.depth[view.valid], _MOST_OF))) if view.valid.any() else 0.0


def _radius(view: DepthImage) -> int:
    """Samples to each side from which a normal is estimated: as few as the noise allows."""
    if not view.valid.any():
        return 1
    z, camera = float(np.median(view.depth[view.valid].astype(np.float64))), view.camera
    pixels = float(np.sqrt(camera.K[0, 0] * camera.K[1, 1]))  # per scene unit; in perspective views at depth 1
    noise = _noise_at(view, z) * pixels / (z if camera.projection == "perspective" else 1.0)
    radius_max = int(constant("picture/normals.cl", "RADIUS_MAX"))
    for radius in range(1, radius_max):
        squares = (2 * radius + 1) ** 2 * radius * (radius + 1) / 3  # sum of x^2 over the window
        if noise <= _SLOPE_ERROR_MAX * np.sqrt(squares):
            return radius
    return radius_max
