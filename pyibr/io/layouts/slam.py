"""Recordings for SLAM: TUM RGB-D and similar ones (ICL-NUIM, Bonn, ETH3D), Open3D's and Redwood's."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from pyibr.core.camera import Camera
from pyibr.core.errors import FileFormatError
from pyibr.core.files import read_text, reading
from pyibr.core.lens import Lens
from pyibr.io.layouts import plain
from pyibr.io.layouts.parts import camera_of, matrix, object_in, own_camera
from pyibr.io.recordings import Recording, Stored, paired_by_time, size_of

_SIZE = (640, 480)
PRIMESENSE = matrix(525.0, 319.5, 239.5)
"""ROS's default intrinsics of such sensors. TUM's depth is registered with them, not with each camera's calibration."""
_FREIBURG3 = matrix(535.4, 320.1, 247.6, 539.2)  # its pictures are already undistorted
_BONN = matrix(542.822841, 315.593520, 237.756098, 542.576870)
_BONN_LENS = Lens("brown_conrady", [0.039903, -0.099343, -0.000730, -0.000144, 0])
_ICL = matrix(481.2, 319.5, 239.5, 480.0)


def find_tum(folder: Path) -> Recording | None:
    """Find lists rgb.txt and depth.txt of times and files, and a trajectory with its own times."""
    if not ((folder / "rgb.txt").is_file() and (folder / "depth.txt").is_file()):
        return None
    (color_times, colors), (depth_times, depths) = (_listed(folder / name) for name in ("rgb.txt", "depth.txt"))
    found = plain.with_files(folder, paired_by_time(colors, color_times, depths, depth_times))
    return found._replace(known=_tum_camera(folder, found.colors), stored=[Stored(5000)] * len(found.colors))


def find_icl(folder: Path) -> Recording | None:
    """Find folders rgb and depth beside a trajectory *.gt.freiburg; the camera's y points up (fy is negative)."""
    trajectories = sorted(folder.glob("*.gt.freiburg"))
    if not trajectories or (found := plain.find_folders(folder)) is None:
        return None
    known = own_camera("ICL-NUIM", _ICL, _SIZE, found.colors)
    stored = [Stored(5000)] * len(found.colors)
    return found._replace(known=known, poses=trajectories[0], points_up=True, stored=stored)


def find_open3d(folder: Path) -> Recording | None:
    """Find two folders beside Open3D's intrinsics or a trajectory.log; depth in mm, or with the intrinsics' scale."""
    found = plain.find_folders(folder)
    if found is None:
        return None
    intrinsics = [path for path in found.cameras if path.suffix == ".json" and "intrinsic_matrix" in object_in(path)]
    if not intrinsics and (found.poses is None or found.poses.suffix != ".log"):
        return None
    scale = object_in(intrinsics[0]).get("depth_scale", 1000) if intrinsics else 1000
    known = own_camera("PrimeSense sensors", PRIMESENSE, _SIZE, found.colors)
    return found._replace(known=known, stored=[Stored(float(scale))] * len(found.colors))


def _tum_camera(folder: Path, colors: Sequence[Path]) -> Callable[[], list[Camera]]:
    """ETH3D's camera from calibration.txt; otherwise a camera chosen by the data set's name."""
    calibration = folder / "calibration.txt"
    if calibration.is_file():
        camera = Camera.load(calibration, size=size_of(colors[0]))
        return lambda: [camera_of(calibration, camera.K, camera.size, camera.lens)]
    name = folder.resolve().name.lower()
    if "bonn" in name:
        return lambda: [Camera(_BONN, _SIZE, lens=_BONN_LENS)]
    is_third = "freiburg3" in name or "fr3" in name
    return own_camera("TUM RGB-D", _FREIBURG3 if is_third else PRIMESENSE, _SIZE, colors)


def _listed(path: Path) -> tuple[list[float], list[Path]]:
    """Times and files in a list of a TUM data set."""
    with reading(path, "list of images") as source:
        lines = [line.split() for line in read_text(source).splitlines() if not line.startswith("#")]
        rows = sorted((float(line[0]), line[1]) for line in lines if line)
    if not rows:
        raise FileFormatError(f"{path}: lists no image")
    return [time for time, _ in rows], [path.parent / name for _, name in rows]
