"""Depth images on the device, with nearness instead of depth (kernels/lib/pixelspace.h)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import check_lengths, check_pixels
from pyibr.core.errors import ArgumentError
from pyibr.core.pixelspace import longer_side, pitch
from pyibr.images import DepthImage
from pyibr.opencl.device import current
from pyibr.opencl.device_cache import cached_on_device, known_on_device
from pyibr.opencl.headers import constant, struct
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, empty, upload
from pyibr.opencl.program import kernel
from pyibr.picture.noise import NoiseOnDevice, noise_on_device
from pyibr.picture.target import Target

_LARGEST = float(np.finfo(np.float32).max)


@dataclass(frozen=True)
class Samples:
    """A depth image on the device."""

    nearness: DeviceArray  # (H, pitch) float32: 1/z (perspective) or -z (orthographic); NO_SURFACE where invalid
    color: DeviceArray  # (H, W, 3)
    ranges: DeviceArray  # (pieces, 2) float32: least and greatest nearness in a piece of a row, (inf, -inf) if empty
    perspective: bool  # whether nearness is 1/z
    noise: NoiseOnDevice

    @property
    def low(self) -> float:
        """Least nearness."""
        return self._low_and_high[0]

    @property
    def high(self) -> float:
        """Greatest nearness."""
        return self._low_and_high[1]

    @cached_property
    def _low_and_high(self) -> tuple[float, float]:
        return self.low_and_high(self.ranges.to_host())  # waits for the device

    def low_and_high(self, ranges: NDArray[np.float32]) -> tuple[float, float]:
        """Return the least and greatest nearness from `ranges` on the host; ArgumentError if there are no samples."""
        low, high = float(ranges[:, 0].min()), float(ranges[:, 1].max())
        if low > high:
            raise ArgumentError(
                "depth", "a view with at least one sample that is finite, > 0 and nearer than `far`", "none"
            )
        nearest, farthest = (1 / high, 1 / low) if self.perspective else (-high, -low)
        check_lengths("depth", nearest, farthest, "at least some depths")
        return low, high


def cut_of(camera: Camera, ratio: float | None, noise: tuple[float, float] = (0.0, 0.0)) -> NDArray[np.void]:
    """Return a record of the kernels' struct Cut, which decides where neighbours in a depth image are torn apart.

    ratio: ratio of depths that tears neighbours apart; for an orthographic camera, 1 plus the difference of depths in
    units of the image's longer side. With None, all neighbours are one surface. noise: tolerance for noise: a fraction
    of the nearness, and a constant nearness to add.
    """
    values = np.zeros((), struct("lib/surface.h", "Cut"))
    if ratio is None:
        return values
    far_scale, least = ratio + noise[0], noise[1]
    if camera.projection == "orthographic":  # depths have no origin, so the image's size sets the scale
        far_scale, least = 1.0, least + (ratio - 1.0) * longer_side(camera)
    values["near_scale"], values["far_scale"], values["least"] = 1.0, min(far_scale, _LARGEST), min(least, _LARGEST)
    return values


def samples_of(view: DepthImage) -> Samples:
    """Return the view's nearness and colour on the current device. Cached."""
    return cached_on_device(view, "samples", lambda: _converted(*_begun(view)))


def begun_samples(view: DepthImage) -> tuple[Samples, dict[str, Any]]:
    """Return cached samples; or else empty buffers for them, and the arguments of the launch that fills them.

    After that launch, `keep_samples` adds them to the cache.
    """
    known = known_on_device(view, "samples")
    return _begun(view) if known is None else (known, {})


def keep_samples(view: DepthImage, samples: Samples) -> None:
    """Cache the samples of `begun_samples`, after the launch that fills them."""
    cached_on_device(view, "samples", lambda: samples)


def bridged_samples(view: DepthImage, cut: NDArray[np.void]) -> Samples:
    """Return the view's samples with single missing samples inside a surface interpolated. Not cached.

    cut: a record of the kernels' struct Cut.
    """
    samples, arguments = _begun(view)
    return _converted(samples, {**arguments, "cut": Struct("Cut", cut)}, "to_bridged_nearness")


def view_of(target: Target) -> DepthImage:
    """Return the picture as a depth image whose samples come from the target's buffers, without an upload."""
    frame = target.frame()
    view = DepthImage(frame.color, frame.depth, frame.camera)
    cached_on_device(view, "samples", lambda: _converted(*_begun(view, target)))
    return view


def _begun(view: DepthImage, target: Target | None = None) -> tuple[Samples, dict[str, Any]]:
    """Empty buffers for samples, and the arguments of the launch that fills them."""
    check_pixels("views", view.camera.size)
    width, height = view.camera.size
    depth = upload(view.depth) if target is None else target.depth
    color = upload(at_least_a_word(view.color)) if target is None else target.color
    samples = Samples(
        nearness=empty((height, pitch(width)), np.float32),
        color=color,
        ranges=empty((current().profile.pieces(width)[1] * height, 2), np.float32),
        perspective=view.camera.projection == "perspective",
        noise=noise_on_device(view.depth_noise, depth),
    )
    far = min(view.far, 1 / constant("lib/surface.h", "NEAREST"))  # for greater depths, nearness would be invalid
    return samples, {"depth": depth, "ranges": samples.ranges, "far": far}


def _converted(samples: Samples, arguments: dict[str, Any], name: str = "to_nearness") -> Samples:
    (height, width), profile = arguments["depth"].shape, current().profile
    piece, pieces = profile.pieces(width)
    launch(
        kernel("picture/begin.cl", name),
        (pieces, height),
        nearness=samples.nearness,
        src_width=width,
        src_height=height,
        src_pitch=pitch(width),
        src_perspective=samples.perspective,
        piece=piece,
        **arguments,
    )
    return samples


def at_least_a_word(color: Any) -> Any:
    """Return the colours, padded to at least four bytes.

    Kernels read four bytes per pixel, but an image of one pixel has three.
    """
    return np.resize(color, (1, 2, 3)) if color.size == 3 else color
