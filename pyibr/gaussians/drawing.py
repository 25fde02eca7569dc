"""The launches that blend Gaussians into a picture (kernels/gaussians/)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.opencl.device import current
from pyibr.opencl.headers import constant
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, empty, upload
from pyibr.opencl.program import Kernel, kernel
from pyibr.picture.target import Target
from pyibr.raster.bins import bin_defines, list_boxes, place_counts

_BIN = 16  # side of a bin in pixels: the lanes of a CPU's work-item, which draws a bin row by row
_PACKET = 16  # Gaussians are padded to whole packets
_KEY_BITS, _DIGIT_BITS = 32, 8
_NONE = -1000.0  # log2 of the opacity of padding


@dataclass(frozen=True)
class Planes:
    """One cloud on the device: its values as planes, one for each number of a Gaussian."""

    shapes: DeviceArray  # (SHAPE, pitch) of kernels/gaussians/project.cl
    coefficients: DeviceArray  # (3 * harmonics, pitch)
    bounds: tuple[NDArray[np.float64], NDArray[np.float64]]
    degree: int
    low_pass: float
    near: float


def planes_of(
    means: NDArray[np.float32],
    scales: NDArray[np.float32],
    rotations: NDArray[np.float32],
    opacities: NDArray[np.float32],
    sh: NDArray[np.float32],
) -> tuple[DeviceArray, DeviceArray]:
    """Upload Gaussians in a given order: `shapes` and `coefficients` of `Planes`."""
    count, pitch = len(means), -(-len(means) // _PACKET) * _PACKET
    shapes = np.zeros((int(constant("gaussians/project.cl", "SHAPE")), pitch), np.float32)
    coefficients = np.zeros((3 * sh.shape[1], pitch), np.float32)
    shapes[:3, :count], shapes[3:6, :count] = means.T, scales.T
    shapes[6:10, :count], shapes[10] = rotations.T, _NONE
    with np.errstate(divide="ignore"):
        shapes[10, :count] = np.maximum(np.log2(opacities.astype(np.float64)), _NONE)
    coefficients[:, :count] = sh.reshape(count, -1).T
    return upload(shapes), upload(coefficients)


def blend_clouds(clouds: Sequence[Planes], target: Target) -> None:
    """Blend clouds into the target, together; where depths are equal, earlier clouds come first."""
    count = sum(cloud.shapes.shape[1] for cloud in clouds)
    records = empty((count, int(constant("gaussians/splat.h", "RECORD"))), np.float32)
    boxes, keys = empty((count, 4), np.int16), empty((count,), np.uint32)
    first = 0
    for cloud in clouds:
        _project(cloud, target, first, records, boxes, keys)
        first += cloud.shapes.shape[1]
    places, visible = _sorted_by_depth(target, keys)
    ordered, share = empty(boxes.shape, np.int16), current().profile.share
    grid = current().profile.shares(count)
    order = {"places": places, "visible": visible, "count": count, "share": share}
    launch(_kernel(target, "order_boxes"), grid, boxes=boxes, ordered=ordered, **order)
    columns, rows = (-(-size // _BIN) for size in target.camera.size)
    found, starts = list_boxes(ordered, columns, rows, **_SORTING, **bin_defines(3))
    fresh = target.alpha is None
    if target.alpha is None:
        target.alpha = empty((target.camera.height, target.camera.width), np.float32)
    launch(
        _kernel(target, "blend_gaussians"),
        current().profile.grid((columns, rows), target.camera.size),
        records=records,
        places=places,
        list=found,
        starts=starts,
        bins_x=columns,
        fresh=int(fresh),
        screen=Struct("Screen", target.screen(1.0)),
        alpha=target.alpha,
        **target.outputs(),
    )


_SORTING = {"CORNERS": 3}  # with `bin_defines`, the program that also sorts triangles


def _kernel(target: Target, name: str) -> Kernel:
    return kernel("gaussians/gaussians.cl", name, BIN=_BIN, **target.color_defines)


def _project(
    cloud: Planes, target: Target, first: int, records: DeviceArray, boxes: DeviceArray, keys: DeviceArray
) -> None:
    pitch, profile = cloud.shapes.shape[1], current().profile
    origin: Float64 = target.camera.center.astype(np.float32).astype(np.float64)
    axes: dict[str, Any] = {f"origin_{name}": float(value) for name, value in zip("xyz", origin, strict=True)}
    launch(
        _kernel(target, "project_gaussians"),
        profile.packets(pitch, 1, profile.strip)[:1],
        shapes=cloud.shapes,
        coefficients=cloud.coefficients,
        pitch=pitch,
        degree=cloud.degree,
        low_pass=cloud.low_pass,
        near_z=cloud.near,
        screen=Struct("Screen", target.screen(target.near(cloud.bounds), origin)),
        first=first,
        records=records,
        boxes=boxes,
        keys=keys,
        **axes,
    )


def _sorted_by_depth(target: Target, keys: DeviceArray) -> tuple[DeviceArray, DeviceArray]:
    """Return the indices of visible Gaussians in the order of depth, and `visible` of kernels/gaussians/sort.cl."""
    (count,), chunks = keys.shape, current().profile.chunks
    digits = int(constant("gaussians/sort.cl", "DIGITS"))
    counts = empty((chunks, digits), np.int32)
    visible = empty((digits + 1,), np.int32)  # only read after the first pass
    places = empty((count,), np.int32)
    spare = [(empty((count,), np.uint32), empty((count,), np.int32)) for _ in range(2)]
    side = int(digits**0.5)
    for number in range(_KEY_BITS // _DIGIT_BITS):
        common = {"keys": keys, "visible": visible, "count": count, "shift": _DIGIT_BITS * number, "chunks": chunks}
        launch(_kernel(target, "count_digits"), (chunks,), counts=counts, **common)
        starts, _ = place_counts(counts, side, side, **_SORTING, **bin_defines(3))
        moved_keys, moved_places = spare[number % 2]
        moved = {"moved_keys": moved_keys, "moved_places": moved_places}
        launch(_kernel(target, "move_by_digit"), (chunks,), counts=counts, places=places, **common, **moved)
        keys, places = moved_keys, moved_places
        if number == 0:
            visible = starts
    return places, visible
