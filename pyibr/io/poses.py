"""Trajectories: poses of a camera, frame by frame, as data sets and tracking programs write them."""

from __future__ import annotations

import re
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pyibr.core.calibration_text import read_tree
from pyibr.core.calibrations import extrinsics_in, making
from pyibr.core.checks import Float64, checked_pose
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import checked_path, read_rows, read_text, reading, words_of
from pyibr.core.rotations import rotation_from_quaternion
from pyibr.io.cameras import read_cameras
from pyibr.io.folders import files_in, units_of

_NUMBER = re.compile(r"[-+]?(\d|\.\d|(nan|inf)$)", re.I)
_TITLES = re.compile(r"(quat|quaternion|pos|position|translation|rotation|orientation|pose|format)s?")
_TREES = (".json", ".yaml", ".yml", ".ini")
_TUM = 8  # numbers per line: time tx ty tz qx qy qz qw


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
    """Read a trajectory: a camera's poses with OpenCV's axes, from the camera to the world.

    Parameters
    ----------
    path : path
        One of these forms:

        - a text file with lines ``time tx ty tz qx qy qz qw`` (TUM RGB-D), maybe with a node's number after it
          (RTAB-Map). A header that names the columns of a position and a quaternion, such as ``qw``, gives another
          order or further columns (EuRoC, RTAB-Map, rostopic);
        - a text file with lines of 12 (KITTI) or 16 numbers, or one more with the time first;
        - a text file of 4 x 4 matrices, one row a line (7-Scenes). A line of 3 numbers may precede each, the frame's
          number first (Redwood, Open3D);
        - an NPY file of such matrices;
        - a JSON file of cameras that `read_cameras` reads, such as Open3D's trajectory;
        - the transform between two cameras, as JSON, YAML or INI of RealSense, Orbbec or OpenCV: the pose of the first
          camera in the second one's frame;
        - a folder of such text files, for example ``frame-000000.pose.txt``, in the order of their numbers. If any
          name contains "pose", only these files are read.

        In text files, # starts a comment.

    Returns
    -------
    Poses

    Raises
    ------
    FileFormatError
        If there is no such file, its form is unknown, or a pose is no rigid motion.

    Examples
    --------
    >>> from pathlib import Path
    >>> from pyibr.io import read_poses
    >>> _ = Path("groundtruth.txt").write_text("# time tx ty tz qx qy qz qw\\n12.5 1 2 3 0 0 0 1\\n")
    >>> poses = read_poses("groundtruth.txt")
    >>> poses.times.tolist(), poses.world_from_camera[0, :3, 3].tolist()
    ([12.5], [1.0, 2.0, 3.0])
    """
    found = read_trajectory(checked_path(path))
    if found.error is not None:
        raise found.error
    return Poses(np.array(found.poses), found.times)


class Trajectory(NamedTuple):
    """Poses (4, 4) as stored in a file or folder."""

    poses: list[Float64 | None]  # None: unusable, such as the infinite poses after a tracker lost track
    times: Float64 | None
    files: list[Path] | None  # the file of each pose, if each has its own
    error: FileFormatError | None  # of the first unusable pose


def read_trajectory(source: Path) -> Trajectory:
    """Read a trajectory as in `read_poses`; unusable poses are None; FileFormatError if all are unusable."""
    with making(source):
        pose = extrinsics_in(read_tree(source)) if source.suffix.lower() in _TREES else None
    if pose is not None:
        return Trajectory([pose], None, None, None)
    if source.suffix.lower() == ".json":
        return Trajectory([camera.world_from_camera for camera in read_cameras(source).values()], None, None, None)
    found = _read_folder(source) if source.is_dir() else _read_file(source)
    if found.error is not None and not any(pose is not None for pose in found.poses):
        raise found.error
    return found


def _read_folder(folder: Path) -> Trajectory:
    files = files_in(folder, (".txt",), "pose") or files_in(folder, (".txt",))
    if not files:
        raise FileFormatError(f"{folder}: no text files with poses in it")
    poses, times, named = list[Float64 | None](), list[Float64](), list[Path]()
    first: FileFormatError | None = None
    for file in files:
        try:
            one = _read_file(file)
        except FileFormatError as error:
            one = Trajectory([None], None, None, error)
        first = first or one.error
        poses += one.poses
        named += [file] * len(one.poses)
        times += [] if one.times is None else [one.times]
    stamped = np.concatenate(times) if times and sum(map(len, times)) == len(poses) else None
    return Trajectory(poses, stamped, named if len(named) == len(files) else None, first)


def _read_file(path: Path) -> Trajectory:
    with reading(path, "trajectory") as source:
        named = [] if source.suffix.lower() == ".npy" else _named(read_text(source).splitlines())
        rows = named or read_rows(source)
    lengths = {len(row) for row in rows}
    if not named and lengths == {_TUM + 1} and all(row[-1].is_integer() for row in rows):
        rows, lengths = [row[:_TUM] for row in rows], {_TUM}
    if named or lengths == {_TUM}:
        table = np.array(rows)
        matrices = np.array([pose_of(row[-7:-4], row[-4:]) for row in table])
        times = table[:, 0] if table.shape[1] == _TUM else None
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
        form = "8, 12, 13, 16 or 17 numbers a line (9: the last is whole), or 4 x 4 matrices"
        raise FileFormatError(f"{path}: expected {form}, got {found}")
    if times is not None and not np.isfinite(times).all():
        raise FileFormatError(f"{path}: expected times in seconds, got some that are not finite")
    if times is not None and (units := units_of(times[0])):
        times = times / units
    poses, first = list[Float64 | None](), None
    for number, matrix in enumerate(matrices):
        try:
            poses.append(checked_pose(matrix))
        except ArgumentError as error:
            poses.append(None)
            first = first or FileFormatError(f"{path}: pose {number}: expected {error.expected}, got {error.got}")
    return Trajectory(poses, times, None, first)


def _named(lines: list[str]) -> list[list[float]]:
    """Rows of time, position and quaternion (x, y, z, w) by a header that names the columns; [] without one."""
    cells = [words_of(line.partition("#")[0]) for line in lines]
    first = next((k for k, words in enumerate(cells) if words and _NUMBER.match(words[0])), 0)
    for columns in (_columns_of(header.lower(), len(cells[first])) for header in lines[:first]):
        if columns:
            return [[float(words[k]) for k in columns] for words in cells[first:] if words]
    return []


def _columns_of(header: str, count: int) -> list[int]:
    """Columns of the time, the position and the quaternion (x, y, z, w) among `count` names; [] if it names none."""
    header = re.sub(r"\[[^\]w]*\]|\([^)w]*\)", " ", header)  # units
    header = re.sub(r"\bq_?([0123])\b", lambda one: f"q{'wxyz'[int(one[1])]}", header)
    names = [word for word in re.findall(r"[\w.]+", header) if not _TITLES.fullmatch(word)][-count:]
    ends, stems = "".join(name[-1] for name in names), [name[:-1] for name in names]
    wxyz = [
        k for k in range(count) if sorted(ends[k : k + 4]) == ["w", "x", "y", "z"] and len({*stems[k : k + 4]}) == 1
    ]
    xyz = [k for k in range(count) for q in wxyz[-1:] if ends[k : k + 3] == "xyz" and not q - 3 < k < q + 4]
    if xyz and len(names) == count:
        found = [*range(xyz[0], xyz[0] + 3), *(ends.index(axis, wxyz[-1]) for axis in "xyzw")]
        return found if 0 in found else [0, *found]
    return [0, 1, 2, 3, 5, 6, 7, 4] if count == _TUM and re.search(r"w\W*(?:q_?)?x\W*(?:q_?)?y", header) else []


def rigid_or_none(matrix: NDArray[np.floating[Any]]) -> Float64 | None:
    """Nearest rigid motion to a rounded matrix; None if there is none."""
    try:
        return checked_pose(matrix)
    except ArgumentError:
        return None


def pose_of(position: Float64, xyzw: Float64) -> Float64:
    """A (4, 4) pose from a position and a quaternion (x, y, z, w); NaN if the quaternion is no rotation."""
    pose = np.eye(4)
    pose[:3, 3] = position
    is_rotation = 0 < np.linalg.norm(xyzw) < np.inf
    pose[:3, :3] = rotation_from_quaternion(xyzw[[3, 0, 1, 2]]) if is_rotation else np.nan
    return pose


def _stacked(path: Path, rows: list[list[float]]) -> tuple[Float64, Float64 | None]:
    """Matrices of four lines each, and the first number of each preceding line of three, if there are such lines."""
    numbered = len(rows[0]) == 3
    lengths = [3, 4, 4, 4, 4] if numbered else [4, 4, 4, 4]
    if [len(row) for row in rows] != lengths * (len(rows) // len(lengths)):
        raise FileFormatError(f"{path}: expected 4 lines of 4 numbers for each pose")
    times = np.array([row[0] for row in rows[::5]]) if numbered else None
    return np.array([row for row in rows if len(row) == 4]).reshape(-1, 4, 4), times
