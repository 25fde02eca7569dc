"""Surfaces of several views without what other views have looked through (kernels/warp/looked_through.cl)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from weakref import ref

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.images.depth_image import DepthImage
from pyibr.opencl.device import current
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.headers import constant, struct
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, empty, zeros
from pyibr.opencl.program import kernel
from pyibr.picture.samples import Samples, samples_of
from pyibr.picture.surface import Margins, Surface, make_surface, surface_of
from pyibr.warp.blending import NOISE_MAX, edge_view

_SETS_MAX = 2  # a view caches the surfaces of at most this many sets of views
_POINTS_MAX = 1 << 21  # points in one batch, unless a single view has more
_FILE = "warp/looked_through.cl"


@dataclass(frozen=True)
class _Member:
    """A view of the set, its struct SetView for the kernels, its surface `own`, and the part of `own` that remains."""

    view: DepthImage
    record: Struct
    samples: Samples
    own: Surface
    surface: Surface


def surfaces_of(views: Sequence[DepthImage], cut_ratio: float | None) -> list[Surface]:
    """Find the surfaces of a set of views on the current device, without what other views have looked through.

    The surfaces are made once for a set, and its first view caches them. With a `cut_ratio`, as in `surface_of`, the
    ratio alone decides which bridges are torn.
    """
    key = tuple(ref(view) for view in views), cut_ratio
    return cached_on_device(views[0], "looked through", lambda: _made(views, cut_ratio), key, _SETS_MAX)


def _made(views: Sequence[DepthImage], cut_ratio: float | None) -> list[Surface]:
    origin = np.mean([view.camera.center for view in views], axis=0)
    own = [surface_of(view, cut_ratio) for view in views]
    members = [
        _Member(view, _record(view, origin), samples_of(view), surface, surface)
        for view, surface in zip(views, own, strict=True)
    ]
    if cut_ratio is None:
        members = _without_bridges(members)
    return _without_margins(members)


def _record(view: DepthImage, origin: Float64) -> Struct:
    """The kernels' struct SetView."""
    camera, values, shift = view.camera, np.zeros((), struct(_FILE, "SetView")), np.eye(4)
    shift[:3, 3] = origin
    matrix = camera.pixel_matrix @ camera.camera_from_world @ shift
    values["pixel_from_world"], values["world_from_pixel"] = matrix.ravel(), np.linalg.inv(matrix).ravel()
    values["width"], values["height"] = camera.size
    values["pitch"] = samples_of(view).nearness.shape[1]
    values["perspective"] = camera.projection == "perspective"
    values["sample"] = (camera.K[0, 0] * camera.K[1, 1]) ** -0.5
    values["noise_2"], values["noise_1"], values["noise_0"] = np.minimum(view.noise, NOISE_MAX)
    return Struct("SetView", values)


def _without_bridges(members: list[_Member]) -> list[_Member]:
    """Tear the members' uncertain bridges that others have looked through."""
    counts = zeros((len(members),), np.int32)
    for number, member in enumerate(members):
        _find_bridges(member, counts, number)
    torn = list(members)
    for points in _batches(counts.to_host()):
        counts.fill(0)
        for number in points.starts:
            _find_bridges(members[number], counts, number, points)
        seen = points.looked_through(members)
        for number in points.starts:
            if seen[points.columns(number)].any():
                torn[number] = _torn(members[number], points, number)
    return torn


def _without_margins(members: list[_Member]) -> list[Surface]:
    """Remove the margins that others have looked through from the members' surfaces."""
    surfaces = [member.surface for member in members]
    for points in _batches([surface.margins.count for surface in surfaces]):
        for number in points.starts:
            _list_margins(members[number], points, number)
        seen = points.looked_through(members)
        for number in points.starts:
            left = int(np.count_nonzero(seen[points.columns(number)] == 0))
            if left < points.counts[number]:
                kept = _kept(surfaces[number].margins, left, points, number)
                surfaces[number] = surfaces[number].with_margins(kept)
    return surfaces


class _Points:
    """Points of some of the members, in adjacent columns, and flags of the points that others have looked through."""

    def __init__(self, counts: dict[int, int]) -> None:
        self.counts = counts
        ends = np.cumsum(list(counts.values())).tolist()
        self.starts: dict[int, int] = dict(zip(counts, [0, *ends], strict=False))
        self.count = ends[-1]
        self.pitch = self.count + current().profile.lanes  # packets at the end read and write beyond it
        self.planes = empty((int(constant(_FILE, "POINT_PLANES")), self.pitch), np.float32)
        self.seen = zeros((self.pitch,), np.uint8)

    def columns(self, number: int) -> slice:
        """The columns of a member's points."""
        return slice(self.starts[number], self.starts[number] + self.counts[number])

    def looked_through(self, members: Sequence[_Member]) -> NDArray[np.uint8]:
        """Test all points against all other members; 1 where a member has looked through."""
        for number, member in enumerate(members):
            own = self.columns(number) if number in self.starts else slice(0, 0)
            launch(
                kernel(_FILE, "look_through"),
                _packets(self.count),
                points=self.planes,
                seen=self.seen,
                surface=member.surface.nearness,
                nearness=member.samples.nearness,
                view=member.record,
                count=self.count,
                pitch=self.pitch,
                own_first=own.start,
                own_end=own.stop,
            )
        return self.seen.to_host()


def _batches(counts: Sequence[int] | NDArray[np.int32]) -> Iterator[_Points]:
    """Divide the points into batches of at most `_POINTS_MAX`; each batch has all points of its members."""
    batch: dict[int, int] = {}
    for number, count in enumerate(map(int, counts)):
        if batch and sum(batch.values()) + count > _POINTS_MAX:
            yield _Points(batch)
            batch = {}
        if count:
            batch[number] = count
    if batch:
        yield _Points(batch)


def _packets(count: int) -> tuple[int]:
    """Work-items for `count` columns, STRIP packets each."""
    profile = current().profile
    return (-(-count // (profile.strip * profile.lanes)),)


def _find_bridges(member: _Member, counts: DeviceArray, number: int, points: _Points | None = None) -> None:
    """Count a member's uncertain bridges, and list them as points if `points` is given."""
    piece, pieces = current().profile.pieces(member.view.camera.width)
    launch(
        kernel(_FILE, "find_bridges"),
        (pieces, member.view.camera.height),
        surface=member.surface.nearness,
        view=member.record,
        steps=edge_view(member.view),
        count=counts,
        number=number,
        piece=piece,
        lists=points is not None,
        points=empty((1,), np.float32) if points is None else points.planes,
        start=0 if points is None else points.starts[number],
        point_pitch=0 if points is None else points.pitch,
    )


def _torn(member: _Member, points: _Points, number: int) -> _Member:
    """Tear the member's bridges that were looked through."""
    columns = points.columns(number)

    def tear(nearness: DeviceArray) -> None:
        launch(
            kernel(_FILE, "tear_bridges"),
            (points.counts[number],),
            points=points.planes,
            seen=points.seen,
            surface=nearness,
            first=columns.start,
            end=columns.stop,
            pitch=points.pitch,
        )

    return replace(member, surface=make_surface(member.samples, member.view.camera.size, member.surface.test, tear))


def _list_margins(member: _Member, points: _Points, number: int) -> None:
    margins = member.surface.margins
    launch(
        kernel(_FILE, "list_margins"),
        _packets(margins.count),
        surface=member.own.nearness,
        view=member.record,
        margins=margins.quarters,
        count=margins.count,
        pitch=margins.quarters.shape[1],
        points=points.planes,
        start=points.starts[number],
        point_pitch=points.pitch,
    )


def _kept(margins: Margins, left: int, points: _Points, number: int) -> Margins:
    """Keep the `left` margins of a member that were not looked through."""
    profile, planes = current().profile, margins.quarters.shape[0]
    kept, count = empty((planes, left + profile.lanes), np.float32), zeros((1,), np.int32)
    launch(
        kernel(_FILE, "keep_margins"),
        profile.shares(margins.count),
        margins=margins.quarters,
        seen=points.seen,
        kept=kept,
        kept_count=count,
        count=margins.count,
        pitch=margins.quarters.shape[1],
        kept_pitch=kept.shape[1],
        start=points.starts[number],
        share=profile.share,
    )
    return Margins(kept, left)
