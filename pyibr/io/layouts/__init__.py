"""Layouts of recordings in folders: their names, how each is recognised, and their scales and axes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import decoding
from pyibr.io.layouts import (
    colmap,
    networks,
    phones,
    plain,
    ros,
    scans,
    slam,
    stereo,
    synthetic,
    tracks,
    transforms,
)
from pyibr.io.recordings import Recording
from pyibr.io.video import SUFFIXES


class Layout(NamedTuple):
    """A layout of frames in folders."""

    name: str
    signs: str  # files or entries that identify the layout
    depth: str  # kind and unit of the stored depth
    poses: str  # axes and direction of the poses
    find: Callable[..., Recording | None]  # the recording in a folder; None if the folder has another layout
    suffixes: tuple[str, ...] = ()  # of single files that hold such a recording
    has_choice: bool = False  # whether `find` takes the name of the depth's topic, track or array, too


_TRACK, _OF_TRACKS = "mm of Kinects, else --depth-scale", (tracks.find_tracks, SUFFIXES, True)
_CV, _GL, _INVERSE = "camera to world, y down", "camera to world, y up", "world to camera, y down"

LAYOUTS: tuple[Layout, ...] = (
    Layout("transforms.json", "with depth_file_path", "mm, or integer_depth_scale", _GL, transforms.find_transforms),
    Layout("MoGe", "fov.json beside image and depth", "as stored", "none", networks.find_moge),
    Layout("Depth Anything 3, VGGT", "NPZ with depth, extrinsics, ...", "as stored", _INVERSE, networks.find_stack),
    Layout("Depth Pro", "NPZ with depth and focal length", "metres", "none", networks.find_depth_pro),
    Layout("ROS bag", "*.bag, or metadata.yaml with a bag", "16UC1 mm, 32FC1 m", "tf", ros.find_bag, (".bag",), True),
    Layout("Azure Kinect, video with depth", "a video with tracks of colour and depth", _TRACK, "none", *_OF_TRACKS),
    Layout("BOP", "scene_camera.json", "depth_scale, mm", _INVERSE, scans.find_bop),
    Layout("Middlebury 2014", "calib.txt, im0.png, disp0", "disparity, doffs", "along x", stereo.find_middlebury),
    Layout("Stray Scanner", "camera_matrix.csv beside depth", "mm", _CV, phones.find_stray),
    Layout("Record3D", "metadata.json with K and poses", "metres", _GL, phones.find_record3d),
    Layout("Record3D, packed", "*.r3d, or metadata and rgbd", "metres, LZFSE", _GL, phones.find_r3d, (".r3d",)),
    Layout("Polycam raw data", "keyframes with cameras", "mm", _GL, phones.find_polycam),
    Layout("3D Scanner App", "frame_*.json with cameraPoseARFrame", "mm", _GL, phones.find_scanner_app),
    Layout("COLMAP dense", "images, stereo/depth_maps", "as the model", _INVERSE, colmap.find_dense),
    Layout("ETH3D multi-view", "images beside ground_truth_depth", "metres", _INVERSE, colmap.find_eth3d),
    Layout("TUM RGB-D, Bonn, ETH3D SLAM", "rgb.txt and depth.txt", "5000 a metre", _CV, slam.find_tum),
    Layout("ICL-NUIM", "rgb, depth, *.gt.freiburg", "5000 a metre", "camera to world, mirrored", slam.find_icl),
    Layout("Replica, NICE-SLAM", "results and traj.txt", "6553.5 a metre, or scale", _CV, synthetic.find_replica),
    Layout("MPI Sintel", "depth and camdata_left", "as stored", _INVERSE, synthetic.find_sintel),
    Layout("Hypersim", "images and _detail", "distance in metres", _GL, synthetic.find_hypersim),
    Layout("KITTI selection", "image, groundtruth_depth, intrinsics", "256 a metre", "none", stereo.find_selection),
    Layout("KITTI drive", "proj_depth, image_02, calib_cam_to_cam.txt", "256 a metre", "none", stereo.find_drive),
    Layout("NYU Depth raw", "r-*.ppm and d-*.pgm", "the sensor's counts", "none", scans.find_nyu),
    Layout(".sens, unpacked", "frame-* beside _info.txt", "m_depthShift", _CV, scans.find_sens),
    Layout("7-Scenes", "frame-*.pose.txt", "mm; 65535 is invalid", _CV, scans.find_seven_scenes),
    Layout("ScanNet", "intrinsic_color.txt, or intrinsic.txt", "mm", _CV, scans.find_scannet),
    Layout("Open3D, Redwood", "intrinsics or trajectory.log", "mm, or depth_scale", _CV, slam.find_open3d),
    Layout("two folders", "color (or rgb, images) and depth", "--depth-scale", _CV, plain.find_folders),
    Layout("two videos", "color.mp4 and depth.mkv, .npy or .npz", "--depth-scale", _CV, plain.find_films, (), True),
    Layout("one folder", "files with color and depth in their names", "--depth-scale", _CV, plain.find_names),
)
"""In the order in which they are tried: layouts with more information come first."""


def may_be_recording(place: Path, channel: str | None = None) -> bool:
    """Tell whether the path is a folder, a file with the suffix of a recording, or a video with a track of depth."""
    if place.suffix.lower() in SUFFIXES and place.is_file():
        return tracks.has_depth(place, channel)
    return place.is_dir() or any(place.suffix.lower() in layout.suffixes for layout in LAYOUTS)


def find_recording(folder: Path, channel: str | None = None) -> Recording | None:
    """The recording in a folder or a file; None if no layout fits. channel: the topic or track of depth."""
    for layout in LAYOUTS:
        if not folder.is_dir() and folder.suffix.lower() not in layout.suffixes:
            continue
        with decoding(folder, layout.name, ArgumentError):
            found = layout.find(folder, channel) if layout.has_choice else layout.find(folder)
        if found is not None:
            return found
    return None


def recording_in(folder: Path, channel: str | None = None) -> Recording:
    """The recording in a folder or a file; FileFormatError, which lists the known layouts, if none fits."""
    found = find_recording(folder, channel)
    if found is None:
        known = "; ".join(f"{layout.name} ({layout.signs})" for layout in LAYOUTS)
        raise FileFormatError(
            f"{folder}: found neither frusta.json nor frames of colour and depth. Looked for: {known}"
        )
    return found
