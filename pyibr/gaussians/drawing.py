"""The launches that blend Gaussians into a picture (kernels/gaussians/)."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.opencl.device import current
from pyibr.opencl.headers import constant
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, empty, upload
from pyibr.opencl.program import Kernel, kernel
from pyibr.picture.shadow import Lighting
from pyibr.picture.target import Target
from pyibr.raster.bins import list_boxes, place_counts

_BIN = 16  # side of a bin in pixels: the lanes of a CPU's work-item, which draws a bin row by row
_PACKET = 16  # Gaussians are padded to whole packets
_BLOCK = 4096  # Gaussians whose numbers fit in a cache
_KEY_BITS = 31  # positive floats
_ROW = 64  # digits that are summed as one row of bins
_NONE = -1000.0  # log2 of the opacity of padding


@dataclass(frozen=True)
class Planes:
    """One cloud on the device: a plane for each number of a Gaussian (kernels/gaussians/project.cl)."""

    values: DeviceArray  # (SHAPE + 3 * harmonics, pitch) float32
    low_pass: float
    antialiased: bool
    near: float

    @cached_property
    def digest(self) -> bytes:
        """Digest of the Gaussians and the options."""
        made = hashlib.blake2b(np.array([self.low_pass, self.antialiased, self.near]).data)
        made.update(self.values.to_host().data)
        return made.digest()


def planes_of(columns: Sequence[NDArray[np.float32]], order: NDArray[np.int64]) -> DeviceArray:
    """Upload the numbers of Gaussians in a given order: `Planes.values`."""
    count = len(order)
    planes = np.zeros((len(columns), -(-count // _PACKET) * _PACKET), np.float32)
    for first in range(0, count, _BLOCK):
        part = order[first : first + _BLOCK]
        for plane, column in zip(planes, columns, strict=True):
            plane[first : first + len(part)] = column[part]
    opacities = planes[int(constant("gaussians/project.cl", "SHAPE")) - 1]
    with np.errstate(divide="ignore"):
        opacities[:] = np.maximum(np.log2(opacities, dtype=np.float64), _NONE)
    return upload(planes)


def blend_clouds(clouds: Sequence[Planes], target: Target, lighting: Lighting | None) -> None:
    """Blend clouds into the target, together, in the shadows of opaque things."""
    if len(clouds) > 1:  # which cloud comes first at equal distances must not depend on the caller's order
        clouds = sorted(clouds, key=lambda cloud: cloud.digest)
    count = sum(cloud.values.shape[1] for cloud in clouds)
    records = empty((count, int(constant("gaussians/splat.h", "RECORD"))), np.float32)
    boxes, keys = empty((count, 4), np.uint16), empty((count,), np.uint32)
    first = 0
    for cloud in clouds:
        _project(cloud, target, lighting, first, records, boxes, keys)
        first += cloud.values.shape[1]
    places, visible = _sorted_by_distance(target, keys)
    ordered, profile = empty(boxes.shape, np.uint16), current().profile
    order = {"places": places, "visible": visible, "count": count, "share": profile.share}
    launch(_kernel(target, "order_boxes"), profile.shares(count), boxes=boxes, ordered=ordered, **order)
    columns, rows = (-(-size // _BIN) for size in target.camera.size)
    found, starts = list_boxes(ordered, columns, rows)
    launch(
        _kernel(target, "blend_gaussians"),
        profile.grid((columns, rows), target.camera.size),
        records=records,
        places=places,
        list=found,
        starts=starts,
        bins_x=columns,
        screen=Struct("Screen", target.screen(1.0)),
        alpha=target.made_alpha(),
        **target.outputs(),
    )


def _kernel(target: Target, name: str, **defines: int) -> Kernel:
    return kernel("gaussians/gaussians.cl", name, BIN=_BIN, **target.color_defines, **defines)


def _project(
    cloud: Planes,
    target: Target,
    lighting: Lighting | None,
    first: int,
    records: DeviceArray,
    boxes: DeviceArray,
    keys: DeviceArray,
) -> None:
    """Project a cloud's Gaussians to the elements from `first` on."""
    (rows, pitch), profile = cloud.values.shape, current().profile
    origin: Float64 = target.camera.center.astype(np.float32).astype(np.float64)
    axes: dict[str, Any] = {f"origin_{name}": float(value) for name, value in zip("xyz", origin, strict=True)}
    defines = dict[str, int]()
    if lighting is not None and lighting.maps is not None:
        defines, axes = lighting.defines, axes | lighting.arguments(origin=origin, opaque=True)
    launch(
        _kernel(target, "project_gaussians", **defines),
        profile.packets(pitch, 1, profile.strip)[:1],
        planes=cloud.values,
        pitch=pitch,
        degree=math.isqrt((rows - int(constant("gaussians/project.cl", "SHAPE"))) // 3) - 1,
        low_pass=cloud.low_pass * target.side**2,
        antialiased=int(cloud.antialiased),
        near_z=0.0 if target.from_light else cloud.near,
        screen=Struct("Screen", target.screen(1.0, origin)),
        first=first,
        records=records,
        boxes=boxes,
        keys=keys,
        **axes,
    )


def _sorted_by_distance(target: Target, keys: DeviceArray) -> tuple[DeviceArray, DeviceArray]:
    """Return the indices of visible Gaussians in the order of distance, and `visible` of kernels/gaussians/sort.cl."""
    (count,), chunks = keys.shape, current().profile.chunks
    digits = int(constant("gaussians/sort.cl", "DIGITS"))
    counts = empty((chunks, digits), np.int32)
    visible = empty((digits + 1,), np.int32)  # only read after the first pass
    places = empty((count,), np.int32)
    spare = [(empty((count,), np.uint32), empty((count,), np.int32)) for _ in range(2)]
    bits = digits.bit_length() - 1
    for number, shift in enumerate(range(0, _KEY_BITS, bits)):
        common = {"keys": keys, "visible": visible, "count": count, "shift": shift, "chunks": chunks}
        launch(_kernel(target, "count_digits"), (chunks,), counts=counts, **common)
        starts, _ = place_counts(counts, _ROW, digits // _ROW)
        moved_keys, moved_places = spare[number % 2]
        moved = {"moved_keys": moved_keys, "moved_places": moved_places}
        launch(_kernel(target, "move_by_digit"), (chunks,), counts=counts, places=places, **common, **moved)
        keys, places = moved_keys, moved_places
        if number == 0:
            visible = starts
    return places, visible
