"""Target cameras of `warp`: --to, --move, --orbit and --frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pyibr.app.options import print_note
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError
from pyibr.images import DepthImage
from pyibr.io import read_cameras

Move = tuple[float, float, float]


class Job(NamedTuple):
    """A view to draw, and its number among the written views."""

    views: Sequence[DepthImage]
    target: Camera
    number: int


class Targets:
    """The new cameras, given by exactly one option.

    to: a file or folder with cameras. move, orbit: steps and degrees from the camera of the (first) source. frames:
    number of views along the path.
    """

    def __init__(self, to: Path | None, move: Move | None, orbit: float | None, frames: int) -> None:
        options = (("--to", to), ("--move", move), ("--orbit", orbit))
        given = [name for name, value in options if value is not None]
        if len(given) != 1:
            raise ArgumentError("new camera", "one of --to, --move, --orbit", " and ".join(given) or "none")
        if frames > 1 and to is not None:
            raise ArgumentError("--frames", "1 with --to (a path needs --move or --orbit)", str(frames))
        self._to = None if to is None else list(read_cameras(to).values())
        self._move, self._orbit, self._frames = move, orbit, frames
        self._distance: float | None = None
        self._is_compared = False

    def count(self, recorded: int | None) -> int | None:
        """Number of new views of a recording with `recorded` frames, or of a scene (None); None for a single view."""
        if recorded is None:
            several = self._frames if self._to is None else len(self._to)
            return several if several > 1 else None
        if self._frames > 1:
            expected = "1 for a recording, which gives a view for each of its frames (or --together)"
            raise ArgumentError("--frames", expected, str(self._frames))
        if self._to is not None and len(self._to) not in (1, recorded):
            raise ArgumentError("--to", f"one camera, or one for each of the {recorded} frames", str(len(self._to)))
        return recorded

    def of_scene(self, views: Sequence[DepthImage], count: int | None) -> Iterator[Job]:
        """Yield a job with all views for each target."""
        for number, part in enumerate(np.linspace(0, 1, count) if count else [1.0]):
            yield Job(views, self._camera(views, number, float(part)), number)

    def of_frame(self, views: Sequence[DepthImage], place: int, number: int) -> Job:
        """The job of a recording's frame: its views, its target and its number."""
        return Job(views, self._camera(views, place, 1.0), number)

    def _camera(self, views: Sequence[DepthImage], number: int, part: float) -> Camera:
        if self._to is not None:
            return self._to[number % len(self._to)]
        camera = views[0].camera
        if self._move is not None:
            self._compare(views, float(np.linalg.norm(self._move)))
            return camera.moved(*(part * np.array(self._move)))
        distance = self._depth_of(views)
        if distance is None:
            return camera  # there is no depth to see
        return camera.orbited(part * (self._orbit or 0.0), camera.center + camera.forward * distance)

    def _depth_of(self, views: Sequence[DepthImage]) -> float | None:
        """Median depth of the first frame with depth; a median for each frame would make the view shake."""
        if self._distance is None:
            depths = next((view.depth[view.valid] for view in views if view.valid.any()), None)
            self._distance = None if depths is None else float(np.median(depths))
        return self._distance

    def _compare(self, views: Sequence[DepthImage], move: float) -> None:
        """Note, once, a move that is negligible or leads far out of the scene."""
        distance, is_new = self._depth_of(views), not self._is_compared
        self._is_compared = True
        if is_new and distance is not None and move > 0 and not 1e-3 <= move / distance <= 2:
            print_note(f"--move: moves by {move:.3g} at a median depth of {distance:.3g}; are both in the same unit?")
