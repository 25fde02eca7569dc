"""NYU Depth's raw recordings: r-*.ppm and d-*.pgm of one Kinect, with the data set's calibration."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.errors import FileFormatError
from pyibr.core.lens import Lens
from pyibr.io import image
from pyibr.io.folders import files_in
from pyibr.io.layouts.parts import matrix
from pyibr.io.recordings import Recording, Stored, paired_by_time

_SIZE = (640, 480)
# From the data set's toolbox, which counts pixels from 1
_COLOR = matrix(518.857901175, 324.582449411, 252.737616633, 519.469611121)
_COLOR_LENS = Lens("brown_conrady", [0.207966153, -0.586138252, 0.000722314, 0.001047963, 0.498569867])
_DEPTH = matrix(582.624481677, 312.044758708, 237.443896264, 582.691032710)
_DEPTH_LENS = Lens("brown_conrady", [-0.099897237, 0.390653246, 0.001929059, -0.001942202, -0.510317251])
_ROTATION = np.array(
    [
        [0.999977988, -0.005035992, -0.004319662],
        [0.005051842, 0.999980519, 0.003666237],
        [0.004301115, -0.003687978, 0.999983949],
    ]
)
_TRANSLATION = -np.array([0.025031876, 0.000662387, -0.000293423])
_FAR = 10.0  # metres; the toolbox treats farther depth as invalid


def find_raw(folder: Path) -> Recording | None:
    """Find pictures r-TIME-COUNT.ppm and depth d-TIME-COUNT.pgm."""
    colors = [file for file in files_in(folder, (".ppm",), "r-") if file.name.startswith("r-")]
    depths = [file for file in files_in(folder, (".pgm",), "d-") if file.name.startswith("d-")]
    if not colors or not depths:
        return None
    found = paired_by_time(colors, [_time(file) for file in colors], depths, [_time(file) for file in depths])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = _ROTATION, _TRANSLATION
    of_depth = Camera(_DEPTH, _SIZE, pose, lens=_DEPTH_LENS)
    return found._replace(
        known=lambda: [Camera(_COLOR, _SIZE, lens=_COLOR_LENS)],
        depth_cameras=lambda: [of_depth] * len(found.colors),
        stored=[Stored(depth=_metres)] * len(found.colors),
    )


def _time(file: Path) -> float:
    found = re.match(r"[rd]-(\d+\.\d+)", file.name)
    if found is None:
        raise FileFormatError(f"{file}: expected a time in its name, such as r-1294886360.208451-2996770081.ppm")
    return float(found[1])


def _metres(path: Path) -> NDArray[np.float32]:
    """Depth in metres from the sensor's counts, whose bytes are swapped in these files."""
    counts = image.read_depth(path).astype(np.uint16).byteswap().astype(np.float64)
    with np.errstate(divide="ignore"):
        metres = 351.3 / (1092.5 - counts)
    return np.where((metres > 0) & (metres < _FAR), metres, np.nan).astype(np.float32)
