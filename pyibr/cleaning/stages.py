"""Stages of cleaning an image on the device: launches of the kernels in kernels/cleaning."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64, check_pixels
from pyibr.opencl.device import current
from pyibr.opencl.headers import constant, struct
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, empty, to_host, upload, zeros
from pyibr.opencl.program import kernel

_PASSES = 4  # passes of region growing between two checks for changes
_VALUE_MIN = 1e-30  # least length of a scale: if the noise exceeds nearness by such a factor, one guide is enough


def _of_planes(name: str) -> int:
    """Look up a constant of kernels/cleaning/plane.h."""
    return int(constant("cleaning/plane.h", name))


@dataclass(frozen=True)
class Scale:
    """A scale on the device: the kernel arguments `table`, `guide` and `record`."""

    table: DeviceArray
    guide: DeviceArray
    record: Struct


def scale_of(nearest: float, farthest: float, at: Float64, noise: Float64, least: float) -> Scale:
    """Make a scale of nearness (1 / depth) on which noise is equal at every depth (kernels/cleaning/scale.h).

    nearest, farthest: range of depths that the scale covers. at, noise: (k,) values of nearness, and the differences of
    nearness that the scale maps to 1 there. least: smallest of these differences, as a fraction of the nearness.
    """
    shift = int(constant("cleaning/scale.h", "KNOT_SHIFT"))
    first, last = (int(np.float32(1 / depth).view(np.int32)) >> shift for depth in (farthest, nearest))
    knots = np.arange(first - 1, last + 3, dtype=np.int32)  # with a margin, as the device may round quotients otherwise
    nearness = (knots << shift).view(np.float32).astype(np.float64)
    found = least * nearness
    if len(at):  # beyond `at`, noise grows with nearness, so that a single near outlier does not stretch the scale
        found = np.maximum(found, np.interp(nearness, at, noise) * np.maximum(nearness / at[-1], 1))
    values = np.append(0, np.cumsum(2 * np.diff(nearness) / (found[1:] + found[:-1]))).astype(np.float32)
    guides = int(constant("cleaning/scale.h", "GUIDES"))
    parts = np.linspace(0, values[-1], guides + 1, dtype=np.float32)
    guide = np.clip(np.searchsorted(values, parts, side="right") - 1, 0, len(knots) - 2).astype(np.int32)
    record = np.zeros((), struct("cleaning/scale.h", "Scale"))
    record["first"], record["count"] = knots[0], len(knots)
    record["cells_per_value"] = guides / max(float(values[-1]), _VALUE_MIN)
    return Scale(upload(values), upload(guide), Struct("Scale", record))


@dataclass(frozen=True)
class Placed:
    """A depth image as a plane, 0 where there is no depth, and the range of depths in each row."""

    depth: DeviceArray
    ranges: DeviceArray

    @cached_property
    def range(self) -> tuple[float, float]:
        """Least and greatest depth; (inf, -inf) if there is no depth at all."""
        ranges = self.ranges.to_host()
        return float(ranges[:, 0].min()), float(ranges[:, 1].max())


class Image:
    """State of an image during cleaning, as planes of kernels/cleaning/plane.h; the caller must hold the session.

    Attributes
    ----------
    grown : DeviceArray
        Depth of the whole area, set by `fill`.
    """

    grown: DeviceArray

    def __init__(self, width: int, height: int) -> None:
        self._size = width, height
        packets = -(-width // _of_planes("ASIDE")) + 2
        packets += packets % 16 == 0  # avoids powers of two, like `pyibr.core.pixelspace.pitch`
        self._shape = height + 2 * _of_planes("ABOVE"), packets * _of_planes("ASIDE")
        check_pixels("depth", (self._shape[1], self._shape[0]))  # pixels of the margin have indices, too
        record = np.zeros((), struct("cleaning/plane.h", "ImagePlane"))
        record["width"], record["height"], record["pitch"] = width, height, self._shape[1]
        self._plane = Struct("ImagePlane", record)
        self._tint = self._new(np.uint32, 1)
        self._has_color = False
        self._marks = self._new(np.uint8)

    def _new(self, dtype: Any, rows: int | None = None) -> DeviceArray:
        return empty((self._shape[0] if rows is None else rows, self._shape[1]), dtype)

    def _launch(self, name: str, **arguments: Any) -> None:
        """Launch a kernel over strips of all rows of the planes."""
        profile = current().profile
        grid = profile.packets(self._shape[1], self._shape[0], profile.strip)
        launch(kernel("cleaning/clean.cl", name), grid, plane=self._plane, strip=profile.strip, **arguments)

    def _launch_runs(self, name: str, **arguments: Any) -> None:
        """Launch a kernel over runs of the image's rows."""
        run, (width, height) = current().profile.run, self._size
        launch(kernel("cleaning/clean.cl", name), (-(-width // run), height), plane=self._plane, run=run, **arguments)

    def place(self, depth: NDArray[np.float32]) -> Placed:
        """Copy a depth image into a plane."""
        placed = Placed(self._new(np.float32), empty((self._shape[0], 2), np.float32))
        arguments = {"depth": upload(np.ascontiguousarray(depth)), "placed": placed.depth, "ranges": placed.ranges}
        launch(kernel("cleaning/clean.cl", "place_depth"), self._shape[:1], plane=self._plane, **arguments)
        return placed

    def place_colors(self, color: NDArray[Any] | None) -> None:
        """Upload the colours that guide the filling of holes, if there are any."""
        self._has_color = color is not None
        if color is not None:
            self._tint = self._new(np.uint32)
            name = "place_bytes" if color.dtype == np.uint8 else "place_floats"
            self._launch(name, color=upload(np.ascontiguousarray(color)), tint=self._tint)

    def on_scale(self, placed: DeviceArray, scale: Scale) -> DeviceArray:
        """Map a plane of depth to values on a scale."""
        values = self._new(np.float32)
        self._launch("to_scale", placed=placed, values=values, table=scale.table, scale=scale.record)
        return values

    def keep(self, values: DeviceArray, known: DeviceArray | None) -> None:
        """Mark the samples that are kept, and missing samples for which the previous depth still holds."""
        self._launch("keep", values=values, marks=self._marks)
        if known is not None:
            held = self._new(np.uint8)
            colors = {"tint": self._tint, "has_color": self._has_color}
            self._launch("hold", values=values, known=known, marks=self._marks, held=held, **colors)
            self._marks = held

    def fill(self, measured: Placed, before: Placed | None, reach: int) -> None:
        """Grow depth from the seeds over the whole area, which is their closing by a disc of radius `reach`."""
        near, distances = self._new(np.uint8), self._new(np.int32)
        columns, shared = current().profile.packets(self._shape[1], 1)[:1], {"distances": distances, "reach": reach}
        for marks, bits, wanted in ((self._marks, _of_planes("SEED"), 1), (near, 1, 0)):
            sought = {"marks": marks, "bits": bits, "wanted": wanted, "plane": self._plane}
            launch(kernel("cleaning/clean.cl", "column_distances"), columns, **sought, **shared)
            self._launch("within_disc", near=near, **shared)
        costs, steps, parents = distances, self._new(np.int32), near
        colors = {"tint": self._tint, "has_color": self._has_color}
        self._launch("begin_growth", marks=self._marks, near=near, costs=costs, steps=steps, **colors)
        self._relax(costs, steps)
        self._launch("find_parents", costs=costs, parents=parents, **colors)
        self.grown = self._new(np.float32)
        depths = {"measured": measured.depth, "before": (before or measured).depth, "grown": self.grown}
        self._launch("grow", marks=self._marks, costs=costs, parents=parents, **depths)

    def _relax(self, costs: DeviceArray, steps: DeviceArray) -> None:
        """Lower the costs until none changes."""
        (width, height), rows = self._size, int(constant("cleaning/grow.cl", "GROWN_ROWS"))
        across, down = current().profile.packets(width, -(-height // rows))
        stamps = zeros((down + 2, across + 2), np.int32)
        for number in itertools.count(1):
            arguments = {"costs": costs, "steps": steps, "stamps": stamps, "plane": self._plane}
            launch(kernel("cleaning/clean.cl", "relax"), (across, down), number=number, **arguments)
            if number % _PASSES == 0 and stamps.to_host().max() < number:
                return

    def drop_speckle(self, values: DeviceArray, measured: DeviceArray, known: DeviceArray | None) -> bool:
        """Remove the seeds in islands of few samples; return whether there were any."""
        labels, sizes, totals = self._new(np.int32), self._new(np.int32), zeros((2,), np.int32)
        before = {"measured": measured, "known": measured if known is None else known, "has_before": known is not None}
        told = {"labels": labels, "sizes": sizes}
        self._launch_runs("find_runs", values=values, marks=self._marks, totals=totals, **told, **before)
        self._launch_runs("join_runs", values=values, labels=labels)
        self._launch_runs("add_runs", **told)
        self._launch_runs("drop_speckle", values=values, totals=totals, marks=self._marks, **told)
        return bool(totals.to_host()[1])

    def sharpen(self, nearness: Placed) -> NDArray[np.float32]:
        """Sharpened nearness of the samples in soft edges; 0 for all other samples."""
        sharp = empty(self._size[::-1], np.float32)
        self._launch("sharpen", nearness=nearness.depth, sharp=sharp)
        return sharp.to_host()

    def smooth(
        self, before: Placed | None, scale: Scale, strength: float
    ) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Smooth the depth; return it with the mask of invented samples."""
        values = rough = self.grown
        if strength > 0:
            values, rough = self.on_scale(self.grown, scale), self._new(np.float32)
            self._launch("roughen", values=values, rough=rough, strength=strength)
        made = {"depth": empty(self._size[::-1], np.float32), "invented": empty(self._size[::-1], np.uint8)}
        table = {"table": scale.table, "guide": scale.guide, "scale": scale.record}
        last = {"before": self.grown if before is None else before.depth, "has_before": before is not None}
        planes = {"values": values, "rough": rough, "grown": self.grown, "marks": self._marks}
        self._launch("smooth", strength=strength, **planes, **last, **table, **made)
        depth, invented = to_host(list(made.values()))
        return depth, invented
