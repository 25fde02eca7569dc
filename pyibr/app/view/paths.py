"""Camera paths: smooth paths through a few cameras."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64, number_from
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.rotations import quaternion_from_rotation, rotation_from_quaternion

_SECONDS_MAX = 3600.0  # seconds


@dataclass(frozen=True)
class CameraPath:
    """A smooth path that passes through cameras in order.

    Parameters
    ----------
    cameras : sequence of Camera
        At least one, all perspective. The path uses the size and the principal point of the first camera.
    seconds : float
        Duration from the first to the last camera, more than 0 and up to an hour; all segments take the same time.

    Raises
    ------
    ArgumentError
        If there are no cameras, one is orthographic, or the time is out of its range.

    Examples
    --------
    >>> import pyibr as ibr
    >>> from pyibr.app.view.paths import CameraPath
    >>> start = ibr.Camera([[50, 0, 30], [0, 50, 18], [0, 0, 1]], (61, 37))
    >>> path = CameraPath([start, start.moved(1, 0, 0), start.moved(2, 0, 0)], seconds=4)
    >>> path.at(2.0).center.tolist()
    [1.0, 0.0, 0.0]
    """

    cameras: Sequence[Camera]
    seconds: float = 5.0

    def __post_init__(self) -> None:
        if not self.cameras:
            raise ArgumentError("cameras", "at least one camera", "none")
        if any(camera.projection != "perspective" for camera in self.cameras):
            raise ArgumentError("cameras", "perspective cameras", "an orthographic one")
        number_from("seconds", self.seconds, 1e-3, _SECONDS_MAX, f"seconds > 0, up to {_SECONDS_MAX:g}")

    def at(self, time: float) -> Camera:
        """The camera at a time, 0 to `seconds`; outside of this range it rests.

        Positions follow a Catmull-Rom spline, which passes through all cameras. Rotations follow the shortest arc, and
        focal lengths change by equal factors in equal times.
        """
        last = len(self.cameras) - 1
        at = min(max(time / self.seconds, 0.0), 1.0) * last
        first = min(int(at), max(last - 1, 0))
        part = at - first
        numbers = (max(first - 1, 0), first, min(first + 1, last), min(first + 2, last))
        before, one, other, after = (self.cameras[number] for number in numbers)
        pose = np.eye(4)
        pose[:3, :3] = _between(one.world_from_camera[:3, :3], other.world_from_camera[:3, :3], part)
        pose[:3, 3] = _spline([camera.center for camera in (before, one, other, after)], part)
        start = self.cameras[0]
        zoom = math.exp(part * math.log(_focal(other)) + (1 - part) * math.log(_focal(one))) / _focal(start)
        K = start.K.copy()
        K[:2, :2] *= zoom
        return Camera(K, start.size, pose)

    def to_json(self) -> dict[str, Any]:
        """Return an object for JSON with `seconds` and `cameras`, each as `Camera.save` writes it."""
        return {"seconds": self.seconds, "cameras": [camera.to_json() for camera in self.cameras]}

    @classmethod
    def from_json(cls, data: object, path: str) -> CameraPath:
        """Make a path from the object of a JSON file; raise FileFormatError, which names `path`, for any other."""
        if not isinstance(data, dict) or not {"seconds", "cameras"} >= data.keys() >= {"cameras"}:
            raise FileFormatError(f"{path}: expected a JSON object with cameras and seconds")
        entries = cast("dict[str, Any]", data)
        listed: object = entries["cameras"]
        if not isinstance(listed, list):
            raise FileFormatError(f"{path}: expected a list of cameras, got {type(listed).__name__}")
        cameras = [Camera.from_json(one, path) for one in cast("list[object]", listed)]
        try:
            return cls(cameras, entries.get("seconds", 5.0))
        except ArgumentError as error:
            raise FileFormatError(f"{path}: {error}") from error


def _focal(camera: Camera) -> float:
    """The focal length in image heights."""
    return float(camera.K[1, 1]) / camera.height


def _between(one: Float64, other: Float64, part: float) -> Float64:
    """Interpolate two rotations on the shortest arc."""
    start, end = quaternion_from_rotation(one), quaternion_from_rotation(other)
    cosine = float(start @ end)
    if cosine < 0:
        cosine, end = -cosine, -end
    angle = math.acos(min(cosine, 1.0))
    if angle < 1e-6:
        return rotation_from_quaternion((1 - part) * start + part * end)
    return rotation_from_quaternion(math.sin((1 - part) * angle) * start + math.sin(part * angle) * end)


def _spline(points: Sequence[Float64], part: float) -> Float64:
    """Interpolate between the second and the third of four points."""
    before, one, other, after = points
    u, uu, uuu = part, part**2, part**3
    return 0.5 * (
        2 * one
        + (other - before) * u
        + (2 * before - 5 * one + 4 * other - after) * uu
        + (3 * one - before - 3 * other + after) * uuu
    )
