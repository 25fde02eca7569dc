"""Trajectories: poses of a camera, frame by frame, as data sets and tracking programs write them."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pyibr.core.checks import Float64, checked_pose
from pyibr.core.conventions import rotation_from_quaternion
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import checked_path, reading
from pyibr.io.cameras import read_cameras
from pyibr.io.folders import files_in, units_of

_TUM = 8  # numbers a line: time tx ty tz qx qy qz qw
_EXACT, _ROUNDED = 1e-9, 1e-2  # what poses that are written with all and with few digits are off a rotation by


class Poses(NamedTuple):
    """Result of `read_poses`.

    Attributes
    ----------
    world_from_camera : (N, 4, 4) float64
    times : (N,) float64, or None
        In seconds, or the frames' numbers, if the file has them. Milli-, micro- and nanoseconds since 1970 become
        seconds.

    Examples
    --------
    >>> from pyibr.io import Poses
    >>> Poses._fields
    ('world_from_camera', 'times')
    """

    world_from_camera: Float64
    times: Float64 | None


def read_poses(path: str | PathLike[str]) -> Poses:
    """Read a trajectory: poses of a camera with OpenCV's axes, from the camera to the world.

    Parameters
    ----------
    path : path
        A text file: lines ``time tx ty tz qx qy qz qw`` (TUM RGB-D), lines of 12 (KITTI) or 16 numbers, or of one more
        with the time before them; or 4 x 4 matrices of a row a line (7-Scenes), also with a line of 3 numbers before
        each, the first of which is the frame's (Redwood, Open3D). What follows a # is a remark. A JSON file of
        cameras, as `read_cameras` reads it: Open3D's trajectory. Or a folder of such text files, as
        ``frame-000000.pose.txt``, in the order of their numbers: of those with "pose" in their names, if there are any.

    Returns
    -------
    Poses

    Raises
    ------
    FileFormatError
        If there is no such file, or it holds something else, or a pose that is no rigid motion.

    Examples
    --------
    >>> from pathlib import Path
    >>> from pyibr.io import read_poses
    >>> _ = Path("groundtruth.txt").write_text("# time tx ty tz qx qy qz qw\\n12.5 1 2 3 0 0 0 1\\n")
    >>> poses = read_poses("groundtruth.txt")
    >>> poses.times.tolist(), poses.world_from_camera[0, :3, 3].tolist()
    ([12.5], [1.0, 2.0, 3.0])
    """
    source = checked_path(path)
    if source.suffix.lower() == ".json":
        return Poses(np.array([camera.world_from_camera for camera in read_cameras(source).values()]), None)
    if not source.is_dir():
        return _read_file(source)
    files = files_in(source, (".txt",), "pose") or files_in(source, (".txt",))
    if not files:
        raise FileFormatError(f"{source}: no text files with poses in it")
    parts = [_read_file(file) for file in files]
    times = [part.times for part in parts if part.times is not None]
    matrices = np.concatenate([part.world_from_camera for part in parts])
    return Poses(matrices, np.concatenate(times) if len(times) == len(parts) else None)


def _read_file(path: Path) -> Poses:
    with reading(path, "trajectory") as source:
        lines = [line.partition("#")[0].split() for line in source.read_text(encoding="utf-8").splitlines()]
        rows = [[float(word) for word in line] for line in lines if line]
    lengths = {len(row) for row in rows}
    if lengths == {_TUM}:
        table = np.array(rows)
        matrices, times = np.array([_matrix_of(row) for row in table]), table[:, 0]
    elif lengths <= {3, 4} and 4 in lengths:
        matrices, times = _stacked(path, rows)
    elif len(lengths) == 1 and lengths <= {12, 13, 16, 17}:
        table = np.array(rows)
        timed = table.shape[1] in (13, 17)
        matrices = np.tile(np.eye(4), (len(table), 1, 1))
        numbers = table[:, int(timed) :]
        matrices[:, : numbers.shape[1] // 4] = numbers.reshape(len(table), -1, 4)
        times = table[:, 0] if timed else None
    else:
        found = ", ".join(map(str, sorted(lengths))) or "no"
        raise FileFormatError(f"{path}: expected 8, 12, 13, 16 or 17 numbers a line, or 4 x 4 matrices, got {found}")
    checked: list[Float64] = []
    for number, matrix in enumerate(matrices):
        try:
            checked.append(checked_pose(_rounded_off(matrix)))
        except ArgumentError as error:
            raise FileFormatError(f"{path}: pose {number}: expected {error.expected}, got {error.got}") from error
    if times is not None and not np.isfinite(times).all():
        raise FileFormatError(f"{path}: expected times in seconds, got some that are not finite")
    if times is not None and (units := units_of(times[0])):
        times = times / units
    return Poses(np.array(checked), times)


def _matrix_of(row: Float64) -> Float64:
    """A pose of a line of a TUM file."""
    pose = np.eye(4)
    pose[:3, 3] = row[1:4]
    length = np.linalg.norm(row[4:])
    # What is no rotation is told by the check of the matrix.
    pose[:3, :3] = rotation_from_quaternion(row[[7, 4, 5, 6]]) if 0 < length < np.inf else np.nan
    return pose


def _stacked(path: Path, rows: list[list[float]]) -> tuple[Float64, Float64 | None]:
    """Matrices of four lines each, and of the lines before them, if there are such, the first number."""
    numbered = len(rows[0]) == 3
    lengths = [3, 4, 4, 4, 4] if numbered else [4, 4, 4, 4]
    if [len(row) for row in rows] != lengths * (len(rows) // len(lengths)):
        raise FileFormatError(f"{path}: expected 4 lines of 4 numbers for each pose")
    times = np.array([row[0] for row in rows[::5]]) if numbered else None
    return np.array([row for row in rows if len(row) == 4]).reshape(-1, 4, 4), times


def _rounded_off(matrix: Float64) -> Float64:
    """The rigid motion nearest to a matrix that was written with few digits; itself if it is one, or far from any."""
    if not np.isfinite(matrix).all():
        return matrix
    if not _EXACT < np.abs(matrix[:3, :3].T @ matrix[:3, :3] - np.eye(3)).max() < _ROUNDED:
        return matrix
    left, _, right = np.linalg.svd(matrix[:3, :3])
    exact = matrix.copy()
    exact[:3, :3] = left @ right
    return exact
