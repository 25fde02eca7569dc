"""The surface of a depth image on the device: edges between samples, and half a pixel more at the image's border."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.pixelspace import pitch
from pyibr.images import DepthImage
from pyibr.opencl.device import current
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.headers import constant, struct
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, begin_to_host, empty, upload, zeros
from pyibr.opencl.program import Kernel, kernel
from pyibr.picture.samples import Samples, begun_samples, cut_of, keep_samples, samples_of

_STEEPEST = 8.0  # depth over width: a surface with a smaller slope between samples faces the camera
_SAMPLES_OF_A_MARGIN, _MARGINS_MIN = 4, 1024  # initial capacity; if there are more margins, they are found again
_STEEP = 0.025  # a limit like _STEEPEST, as a fraction of the nearness: in small images, _STEEPEST hides small edges


@dataclass(frozen=True)
class Margins:
    """The margins of a surface on the device."""

    quarters: DeviceArray  # (MARGIN_PLANES, capacity) float32: see kernels/lib/margins.h
    count: int


@dataclass(frozen=True)
class Surface:
    """A depth image's surface on the device. Its launches may still be running."""

    nearness: DeviceArray
    """(H + 2, pitch) float32: the image's samples and a ring around them, with the bits of kernels/picture/edges.cl."""
    color: DeviceArray  # (H, W, 3); an image of one pixel has a second pixel here
    size: tuple[int, int]  # (W, H)
    test: EdgeTest  # the test that found the edges
    prominence: DeviceArray  # (H, ceil(W / 16), 2) float32: see kernels/picture/small_parts.cl
    wait: Callable[[], tuple[float, float, Margins]]
    """Waits for the launches on the first call, and returns the least and the greatest nearness, and the margins."""

    @property
    def low(self) -> float:
        """Least nearness."""
        return self.wait()[0]

    @property
    def high(self) -> float:
        """Greatest nearness."""
        return self.wait()[1]

    @property
    def margins(self) -> Margins:
        """Parts of pixels next to edges that no triangle covers."""
        return self.wait()[2]

    def with_margins(self, margins: Margins) -> Surface:
        """Return the same surface with other margins."""
        return replace(self, wait=lambda: (self.low, self.high, margins))

    @property
    def grid(self) -> dict[str, Any]:
        """Arguments of kernels that read the samples and their edges."""
        width, height = self.size
        shape = {"width": width, "height": height, "pitch": self.nearness.shape[1]}
        return {"surface": self.nearness, "cut": Struct("Cut", self.test.cut), **shape}

    @cached_property
    def bounds(self) -> DeviceArray:
        """(down, across, 2) float32: least and greatest nearness in windows of cells (kernels/lib/bounds.h)."""
        width, height = self.size
        step, strip = int(constant("lib/bounds.h", "BOUNDS_STEP")), current().profile.strip
        down, across = (size // step + 1 for size in (height, width))
        bounds = empty((down, across, 2), np.float32)
        grid = {name: value for name, value in self.grid.items() if name != "cut"}
        launch(kernel("picture/bounds.cl", "bound_surface"), (-(-across // strip), down), bounds=bounds, **grid)
        return bounds

    @cached_property
    def ribbons(self) -> DeviceArray:
        """(N,) uint32: indices of the ribbons for parts that are one sample wide (kernels/lib/ribbons.h)."""
        width, height = self.size
        begins, profile = zeros((height, width), np.uint16), current().profile
        launch(
            kernel("picture/ribbons.cl", "find_ribbons"),
            profile.packets(width, height, profile.strip),
            begins=begins,
            **self.grid,
        )
        bits = begins.to_host().ravel()
        samples, ways = np.flatnonzero(bits), np.arange(int(constant("lib/ribbons.h", "NEIGHBOURS")))
        numbers = samples[:, None] * len(ways) + ways
        return upload(numbers[(bits[samples, None] >> ways & 1).astype(bool)].astype(np.uint32))


@dataclass(frozen=True)
class EdgeTest:
    """Test that decides which neighbours in a depth image are torn apart, as the kernels' structs Cut and EdgeTest."""

    cut: NDArray[np.void]  # a test of two depths alone; with `straight`, only for pairs whose shape cannot be tested
    straight: NDArray[np.void]


def surface_of(view: DepthImage, cut_ratio: float | None, connected: bool = False) -> Surface:
    """Return the surface of a view without a lens on the current device; cached for each edge test.

    cut_ratio: ratio of depths that tears neighbours apart, as in `cut_of`. With None, neighbours are torn where the
    surface does not continue straight, unless noise explains it. connected: all neighbours are one surface.
    """

    def made() -> Surface:
        if connected or cut_ratio is not None:
            test = test_by_cut(view.camera, cut_of(view.camera, None if connected else cut_ratio))
        else:
            test = straightness_test(view.camera)
        samples, depth = begun_samples(view) if current().profile.band else (samples_of(view), {})
        surface = make_surface(samples, view.camera.size, test, depth=depth)
        keep_samples(view, samples)
        return surface

    return cached_on_device(view, "surface", made, "connected" if connected else cut_ratio)


def straightness_test(camera: Camera, torn_by: NDArray[np.void] | None = None) -> EdgeTest:
    """Return the test that tears neighbours unless their difference is explained without an edge.

    Explanations are a surface that continues straight or faces the camera, noise, and steps of a quantized scale.
    torn_by: a record of the kernels' struct Cut, which must tear the pair as well.
    """
    cut, values = cut_of(camera, 1.0), _record(camera)
    values["straight"] = True
    cut["far_scale" if values["perspective"] else "least"] += values["per_pixel"][2]
    values["both"] = torn_by is not None
    return EdgeTest(cut if torn_by is None else torn_by, values)


def test_by_cut(camera: Camera, cut: NDArray[np.void]) -> EdgeTest:
    """Return the test by a record of the kernels' struct Cut alone."""
    return EdgeTest(cut, _record(camera))


def _record(camera: Camera) -> NDArray[np.void]:
    """A record of the kernels' struct EdgeTest, with the limits for slopes of surfaces that face the camera."""
    values = np.zeros((), struct("lib/surface.h", "EdgeTest"))
    values["perspective"] = camera.projection == "perspective"
    across, down = 1 / camera.K[0, 0], 1 / camera.K[1, 1]
    values["per_pixel"] = _STEEPEST * np.array([across, down, math.hypot(across, down)])
    if values["perspective"]:
        values["per_pixel"] = np.minimum(values["per_pixel"], _STEEP)
    return values


def make_surface(
    samples: Samples,
    size: tuple[int, int],
    test: EdgeTest,
    tear: Callable[[DeviceArray], None] | None = None,
    depth: dict[str, Any] | None = None,
) -> Surface:
    """Begin to make the surface of an image's samples.

    tear: launches kernels that mark further edges in the surface's `nearness`. depth: the arguments of `begun_samples`.
    """
    width, height = size
    surface = empty((height + 2, pitch(width)), np.float32)
    ring = empty((2, 2 * (width + 2) + 2 * height), np.float32)
    block = int(constant("lib/prominence.h", "PROMINENCE_BLOCK"))
    prominence = empty((height, -(-width // block), 2), np.float32)
    shared = {"surface": surface, "width": width, "height": height, "pitch": surface.shape[1]}
    border = {"nearness": samples.nearness, "ring": ring}
    tests = {"noise": samples.noise.array, "test": Struct("EdgeTest", test.straight)}
    edges = {"nearness": samples.nearness, "cut": Struct("Cut", test.cut), **tests}
    profile, capacity = current().profile, max(math.prod(size) // _SAMPLES_OF_A_MARGIN, _MARGINS_MIN)
    piece, pieces = profile.pieces(width)
    margins = _room_for_margins(capacity)
    around = {"prominence": prominence, **tests, **shared}
    if profile.band and tear is None:
        grid = (-(-height // profile.band),)
        of_depth = depth or {"depth": samples.nearness, "ranges": samples.ranges, "far": 0.0}
        steps = border | edges | around | margins | of_depth
        launch(_kernel("prepare"), grid, band=profile.band, converts=bool(depth), **steps)
    else:
        launch(_kernel("find_edges"), (pieces, height), piece=piece, **edges, **shared)
        if tear is not None:
            tear(surface)
        launch(_kernel("continue_border"), (ring.shape[1],), **border, **shared)
        launch(_kernel("look_around"), (pieces, height), piece=piece, **around, **margins)
    values, done = begin_to_host([samples.ranges, ring, margins["count"], samples.noise.array]), surface.session.mark()

    @functools.cache
    def wait() -> tuple[float, float, Margins]:
        done()
        ranges, nearest_and_farthest, found, samples.noise.values = values
        count, room = int(found[0]), margins
        if count > capacity:
            room = _room_for_margins(count)
            launch(_kernel("look_around"), (pieces, height), piece=piece, **around, **room)
        low, high = samples.low_and_high(ranges)
        low, high = min(low, float(nearest_and_farthest[0].min())), max(high, float(nearest_and_farthest[1].max()))
        return low, high, Margins(room["margins"], count)

    return Surface(surface, samples.color, size, test, prominence, wait)


def _kernel(name: str) -> Kernel:
    return kernel("picture/begin.cl", name)


def _room_for_margins(capacity: int) -> dict[str, Any]:
    """Arguments of kernels that find margins: a buffer for them, and their count."""
    # The last packet reads beyond the last margin.
    columns, planes = capacity + current().profile.lanes, int(constant("lib/margins.h", "MARGIN_PLANES"))
    return {"margins": empty((planes, columns), np.float32), "count": zeros((1,), np.int32), "capacity": columns}
