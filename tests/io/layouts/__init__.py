"""Specimens of layouts: folders with two frames of a known scene, as each data set, phone or network stores them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tests.io.layouts import networks, others, phones, ros, scans

_MAKERS: tuple[Callable[[Path], None], ...] = (
    *(scans.tum_camera, scans.eth3d, scans.tum_known, scans.icl, scans.upward, scans.seven_scenes, scans.scannet),
    *(scans.posed_images, scans.sens, scans.replica, scans.redwood, scans.colmap, scans.eth3d_views),
    *(scans.nerfstudio, scans.instant_ngp),
    *(phones.stray, phones.record3d, phones.r3d, phones.r3d_packed, phones.polycam, phones.scanner_app),
    *(networks.depth_anything, networks.vggt, networks.moge, networks.depth_pro),
    *(others.bop, others.middlebury, others.sintel, others.kitti, others.kitti_drive, others.hypersim),
    *(ros.ros_bag, ros.ros_packed),
)
SPECIMENS = {one.__name__: (one, 1 if one in (networks.moge, networks.depth_pro) else 2) for one in _MAKERS}
"""Functions that make folders, each with the number of usable frames."""
