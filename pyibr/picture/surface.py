"""The surface of a depth image on the device: which samples are torn apart, and half a pixel more at its border."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.pixelspace import pitch
from pyibr.images import DepthImage
from pyibr.images.noise import DepthNoise
from pyibr.opencl.device import current
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.headers import constant, struct
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, begin_to_host, empty, to_host
from pyibr.opencl.program import kernel
from pyibr.picture.samples import Samples, cut_of, samples_of

_STEEPEST = 8.0  # depth over width: a surface that recedes by less from sample to sample faces the camera
_SAMPLES_OF_A_MARGIN, _MARGINS_MIN = 4, 1024  # mostly there are fewer margins; else they are found once more
_STEEP = 0.025  # share of the nearness: with few samples a surface may be steeper, but edges are as small
_DEVIATIONS = 4.0 * math.sqrt(2)  # of a sample's noise, by which neighbours may differ


@dataclass(frozen=True)
class Surface:
    """A depth image's surface on the device.

    Attributes
    ----------
    nearness : DeviceArray (H + 2, pitch) float32
        Of the image's samples within a ring of further ones, with the bits of kernels/picture/edges.cl.
    color : DeviceArray (H, W, 3)
    size : (W, H)
        Of the image: an image of one pixel has colours of two.
    low, high : float
        Least and greatest nearness.
    margins : Margins
        What no triangle covers of the pixels of samples beside edges.
    test : EdgeTest
        It told the edges.
    noise : callable
        Returns (a, b, c): neighbours of nearness n may differ by a + b n + c n^2 by noise alone. Found on first use.
    """

    nearness: DeviceArray
    color: DeviceArray
    size: tuple[int, int]
    low: float
    high: float
    margins: Margins
    test: EdgeTest
    noise: Callable[[], tuple[float, float, float]]

    @cached_property
    def prominence(self) -> DeviceArray:
        """(H, ceil(W / 16), 2) float32: by how much of nearness a sample of 16 stands out most, inf if it is torn off.

        As seen from the front, and from the back; -inf if noise explains it.
        """
        width, height = self.size
        block, strip = int(constant("lib/prominence.h", "PROMINENCE_BLOCK")), current().profile.strip
        prominence = empty((height, -(-width // block), 2), np.float32)
        noise_0, noise_1, noise_2 = self.noise()
        launch(
            kernel("picture/begin.cl", "measure_prominence"),
            (-(-prominence.shape[1] // strip), height),
            surface=self.nearness,
            prominence=prominence,
            width=width,
            height=height,
            pitch=self.nearness.shape[1],
            noise_0=noise_0,
            noise_1=noise_1,
            noise_2=noise_2,
        )
        return prominence

    @cached_property
    def bounds(self) -> DeviceArray:
        """(down, across, 2) float32: least and greatest nearness in windows of cells (kernels/lib/bounds.h)."""
        width, height = self.size
        step, strip = int(constant("lib/bounds.h", "BOUNDS_STEP")), current().profile.strip
        down, across = (size // step + 1 for size in (height, width))
        bounds = empty((down, across, 2), np.float32)
        launch(
            kernel("picture/bounds.cl", "bound_surface"),
            (-(-across // strip), down),
            surface=self.nearness,
            bounds=bounds,
            width=width,
            height=height,
            pitch=self.nearness.shape[1],
        )
        return bounds


@dataclass(frozen=True)
class Margins:
    """The margins of a surface on the device.

    Attributes
    ----------
    quarters : DeviceArray (MARGIN_PLANES, capacity) float32
        kernels/lib/margins.h.
    found : (1,) int32
        How many there are, once the session has been waited for.
    """

    quarters: DeviceArray
    found: NDArray[np.int32]

    @property
    def count(self) -> int:
        """Number of them."""
        return int(self.found[0])


@dataclass(frozen=True)
class EdgeTest:
    """Test that tells which neighbours in a depth image are torn apart.

    Attributes
    ----------
    cut : record
        Of the kernels' struct Cut: by their depths alone; with `straight`, for pairs of which nothing else is known.
    straight : record
        Of the kernels' struct EdgeTest.
    """

    cut: NDArray[np.void]
    straight: NDArray[np.void]


def surface_of(view: DepthImage, cut_ratio: float | None, connected: bool = False) -> Surface:
    """The view's surface on the current device, made once for each way to tell its edges.

    Parameters
    ----------
    view : DepthImage
        Of a camera without a lens.
    cut_ratio : float or None
        Of depths, that tears neighbours apart, as `cut_of` takes it. None: what does not go on straight does, if noise
        does not explain it.
    connected : bool
        All neighbours are one surface.
    """

    def made() -> Surface:
        samples = samples_of(view)  # the device makes them while noise is found
        if connected or cut_ratio is not None:
            test = test_by_cut(view.camera, cut_of(view.camera, None if connected else cut_ratio))
        else:
            test = straightness_test(view)
        return make_surface(samples, view, test)

    return cached_on_device(view, "surface", made, "connected" if connected else cut_ratio)


def straightness_test(view: DepthImage, torn_by: NDArray[np.void] | None = None) -> EdgeTest:
    """Surfaces go on straight, or face the camera; noise and the steps of a scale are no edges.

    torn_by: a record of the kernels' struct Cut; what it does not tear is none, either.
    """
    cut, values = cut_of(view.camera, 1.0), _record(view.camera)
    values["straight"] = True
    values["noise"] = _noise_between(view.depth_noise, bool(values["perspective"]))
    cut["far_scale" if values["perspective"] else "least"] += values["per_pixel"][2]
    values["both"] = torn_by is not None
    return EdgeTest(cut if torn_by is None else torn_by, values)


def test_by_cut(camera: Camera, cut: NDArray[np.void]) -> EdgeTest:
    """By a record of the kernels' struct Cut alone."""
    return EdgeTest(cut, _record(camera))


def _record(camera: Camera) -> NDArray[np.void]:
    """A record of the kernels' struct EdgeTest, which knows how steep surfaces are that face the camera."""
    values = np.zeros((), struct("lib/surface.h", "EdgeTest"))
    values["perspective"] = camera.projection == "perspective"
    across, down = 1 / camera.K[0, 0], 1 / camera.K[1, 1]
    values["per_pixel"] = _STEEPEST * np.array([across, down, math.hypot(across, down)])
    if values["perspective"]:
        values["per_pixel"] = np.minimum(values["per_pixel"], _STEEP)
    return values


def _noise_between(noise: DepthNoise, perspective: bool) -> tuple[float, float, float]:
    """Difference of neighbours that noise explains, as `Surface.noise` returns it."""
    a, b, c = (_DEVIATIONS * each for each in noise.deviation)
    return (a, b, c) if perspective else (c, -b, a)


def make_surface(
    samples: Samples, view: DepthImage, test: EdgeTest, tear: Callable[[DeviceArray], None] | None = None
) -> Surface:
    """The surface of samples of an image; `tear` launches what tears more of its `nearness` than the test does."""
    size = width, height = view.camera.size
    surface = empty((height + 2, pitch(width)), np.float32)
    ring = empty((2, 2 * (width + 2) + 2 * height), np.float32)
    piece, pieces = current().profile.pieces(width)
    shared = {"surface": surface, "width": width, "height": height, "pitch": surface.shape[1]}
    given = {"nearness": samples.nearness, **shared}
    tests = {"cut": Struct("Cut", test.cut), "test": Struct("EdgeTest", test.straight)}
    launch(kernel("picture/begin.cl", "find_edges"), (pieces, height), piece=piece, **tests, **given)
    if tear is not None:
        tear(surface)
    launch(kernel("picture/begin.cl", "continue_border"), (ring.shape[1],), ring=ring, **given)
    margins = _find_margins(surface, size, test, max(math.prod(size) // _SAMPLES_OF_A_MARGIN, _MARGINS_MIN))
    # The one wait for all that there is of a view
    ranges, nearest_and_farthest = to_host([samples.ranges, ring])
    if margins.count > margins.quarters.shape[1]:
        margins = _find_margins(surface, size, test, margins.count)
        surface.session.wait()
    low, high = samples.low_and_high(ranges)
    low, high = min(low, float(nearest_and_farthest[0].min())), max(high, float(nearest_and_farthest[1].max()))
    noise = functools.partial(_noise_between, view.depth_noise, samples.perspective)
    return Surface(surface, samples.color, size, low, high, margins, test, noise)


def _find_margins(surface: DeviceArray, size: tuple[int, int], test: EdgeTest, capacity: int) -> Margins:
    """Begin to find the margins; no more than `capacity` are written."""
    (width, height), lanes = size, current().profile.lanes
    piece, pieces = current().profile.pieces(width)
    # Packets at the end read beyond the last one.
    quarters = empty((int(constant("lib/margins.h", "MARGIN_PLANES")), capacity + lanes), np.float32)
    count = empty((1,), np.int32)
    count.fill(0)
    launch(
        kernel("picture/begin.cl", "find_margins"),
        (pieces, height),
        surface=surface,
        margins=quarters,
        count=count,
        width=width,
        height=height,
        pitch=surface.shape[1],
        piece=piece,
        capacity=quarters.shape[1],
        test=Struct("EdgeTest", test.straight),
    )
    return Margins(quarters, begin_to_host([count])[0])
