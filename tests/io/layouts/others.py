"""Specimens of stereo, driving and synthetic data sets, and of objects on tables."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from tests.io.layouts.wall import GL, POSES, SIZE, K, counts, png, rendered, text, turned, write_frames


def bop(folder: Path) -> None:
    scene, told = rendered(), {}
    for number, (color, depth, one) in enumerate(zip(scene.colors, scene.depths, scene.poses, strict=True), 3):
        scale = 0.5 if number == 3 else 0.2
        inverse = np.linalg.inv(one)
        told[str(number)] = {"cam_K": K.ravel().tolist(), "depth_scale": scale}
        told[str(number)] |= {"cam_R_w2c": inverse[:3, :3].ravel().tolist()}
        told[str(number)] |= {"cam_t_w2c": (1000 * inverse[:3, 3]).tolist()}
        png(folder / f"rgb/{number:06d}.png", color)
        png(folder / f"depth/{number:06d}.png", counts(depth, 1000 / scale))
    text(folder / "scene_camera.json", json.dumps(told))


def middlebury(folder: Path) -> None:
    """The right camera's principal point is doffs pixels farther right, which stored disparity leaves out."""
    focal, doffs, baseline = 60.0, 2.5, 0.16
    matrices = [np.array([[focal, 0, 30.3 + k * doffs], [0, focal, 24.2], [0, 0, 1]]) for k in (0, 1)]
    steps = [np.eye(4), np.eye(4)]
    steps[1][0, 3] = baseline
    for k in (0, 1):
        scene = rendered(matrices[k], [steps[k]])
        png(folder / f"im{k}.png", scene.colors[0])
        disparity = focal * baseline / scene.depths[0] - doffs
        disparity[:2] = np.inf
        ibr.write_depth(folder / f"disp{k}.pfm", disparity.astype(np.float32))
    lines = [f"cam{k}=[{focal} 0 {matrices[k][0, 2]}; 0 {focal} 24.2; 0 0 1]" for k in (0, 1)]
    text(folder / "calib.txt", "\n".join([*lines, f"doffs={doffs}", "baseline=160", "width=64", "height=48"]))


def kitti(folder: Path) -> None:
    """Two frames from the same position, because this data set has no poses."""
    scene = rendered(poses=[np.eye(4), np.eye(4)])
    for number, (color, depth) in enumerate(zip(scene.colors, scene.depths, strict=True)):
        name = f"2011_09_26_drive_0002_sync_{{}}_{number:010d}_image_02"
        png(folder / "image" / (name.format("image") + ".png"), color)
        png(folder / "groundtruth_depth" / (name.format("groundtruth_depth") + ".png"), counts(depth, 256))
        text(folder / "intrinsics" / (name.format("image") + ".txt"), " ".join(map(str, K.ravel().tolist())))


def sintel(folder: Path) -> None:
    scene = rendered()
    for number, (color, depth, one) in enumerate(zip(scene.colors, scene.depths, scene.poses, strict=True), 1):
        png(folder / f"final/frame_{number:04d}.png", color)
        for kind in ("depth", "camdata_left"):
            (folder / kind).mkdir(exist_ok=True)
        tag, inverse = struct.pack("<f", 202021.25), np.linalg.inv(one)
        data = tag + struct.pack("<ii", *SIZE) + depth.astype("<f4").tobytes()
        (folder / f"depth/frame_{number:04d}.dpt").write_bytes(data)
        (folder / f"camdata_left/frame_{number:04d}.cam").write_bytes(tag + K.tobytes() + inverse[:3].tobytes())


def kitti_drive(folder: Path) -> None:
    scene = rendered(poses=[np.eye(4), np.eye(4)])
    depths = "proj_depth/groundtruth/image_02/{:010d}.png"
    write_frames(folder, scene, 256, "image_02/data/{:010d}.png", depths, first=5)
    row = " ".join(map(str, np.column_stack([K, [4.5, 0, 0]]).ravel().tolist()))
    text(folder.parent / "calib_cam_to_cam.txt", f"corner_dist: 9.95e-02\nP_rect_02: {row}\n")


def hypersim(folder: Path) -> None:
    """A camera whose image plane is tilted: it looks along the plane's normal, with a skewed K."""
    h5py = pytest.importorskip("h5py")
    tilt = turned(0.08, -0.05, 0)
    aslant = np.eye(4)
    aslant[:3, :3] = tilt
    scene = rendered(K, [one @ aslant for one in POSES])
    pixel_from_uv = np.array([[32, 0, 31.5], [0, -24, 23.5], [0, 0, 1]])
    cam_from_uv = GL[:3, :3] @ tilt @ np.linalg.inv(K) @ pixel_from_uv
    metres, names = 0.02, [f"M_cam_from_uv_{i}{j}" for i in range(3) for j in range(3)]
    values = [folder.name, metres, *cam_from_uv.ravel().tolist()]
    head = ["scene_name", "settings_units_info_meters_scale", *names]
    text(folder.parent / "metadata_camera_parameters.csv", ",".join(head) + "\n" + ",".join(map(str, values)) + "\n")
    detail, images = folder / "_detail/cam_00", folder / "images/scene_cam_00"
    detail.mkdir(parents=True)
    arrays = {"frame_indices": np.array([0, 1]), "positions": np.array([one[:3, 3] for one in POSES]) / metres}
    arrays["orientations"] = np.array([(one @ GL)[:3, :3] for one in POSES])
    files = {f"{detail}/camera_keyframe_{name}.hdf5": one for name, one in arrays.items()}
    for number, one in enumerate(scene.distances):
        files[f"{images}_geometry_hdf5/frame.{number:04d}.depth_meters.hdf5"] = one
    for path, one in files.items():
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        with h5py.File(path, "w") as file:
            file["dataset"] = one.astype(np.float16) if "depth" in path else one
    for number, color in enumerate(scene.colors):
        png(Path(f"{images}_final_preview/frame.{number:04d}.tonemap.png"), color)
