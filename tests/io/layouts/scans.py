"""Specimens of scans and reconstructions: data sets of rooms, and files of COLMAP and NeRF tools."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import pyibr as ibr
from tests.io.layouts.wall import GL, SIZE, K, counts, matrix, png, rendered, text, tum_line, write_frames, xyzw

K_4 = np.eye(4)
K_4[:3, :3] = K


def tum(folder: Path, K: np.ndarray = K) -> None:
    scene, times = rendered(K), ("5.100000", "5.133000")
    for time, color, depth in zip(times, scene.colors, scene.depths, strict=True):
        png(folder / f"rgb/{time}.png", color)
        png(folder / f"depth/{time}.png", counts(depth, 5000))
    for kind in ("rgb", "depth"):
        text(folder / f"{kind}.txt", "# a list\n" + "".join(f"{time} {kind}/{time}.png\n" for time in times))
    lines = [tum_line(time, pose) for time, pose in zip(times, scene.poses, strict=True)]
    text(folder / "groundtruth.txt", "# time tx ty tz qx qy qz qw\n" + "\n".join(lines))


def tum_camera(folder: Path) -> None:
    tum(folder)
    ibr.Camera(K, SIZE).save(folder / "camera.json")


def eth3d(folder: Path) -> None:
    tum(folder)
    text(folder / "calibration.txt", "60 62 30.3 24.2\n")


def tum_known(folder: Path) -> None:
    """The camera that the data set recommends, at a tenth of its size."""
    tum(folder, np.array([[52.5, 0, 31.5], [0, 52.5, 23.5], [0, 0, 1]]))


def icl(folder: Path) -> None:
    """ICL-NUIM's camera has fy < 0: its y axis points up, and poses use these mirrored axes."""
    mirror = np.diag([1.0, -1, 1, 1])
    scene = rendered(np.array([[48.12, 0, 31.5], [0, 48.0, 23.5], [0, 0, 1]]))
    lines = [tum_line(number, mirror @ pose @ mirror) for number, pose in enumerate(scene.poses, 1)]
    text(folder / "livingRoom2.gt.freiburg", "\n".join(lines))
    for number in (0, 1, 2):  # frame 0 has no pose
        png(folder / f"rgb/{number}.png", scene.colors[max(number - 1, 0)])
        png(folder / f"depth/{number}.png", counts(scene.depths[max(number - 1, 0)], 5000))


def upward(folder: Path) -> None:
    """Two folders of pictures and depth, with poses, from a camera whose fy is negative."""
    mirror, scene = np.diag([1.0, -1, 1, 1]), rendered()
    matrix(folder / "camera-intrinsics.txt", K @ mirror[:3, :3])
    matrix(folder / "poses.txt", np.array([(mirror @ one @ mirror).ravel() for one in scene.poses]))
    for number, (color, depth) in enumerate(zip(scene.colors, scene.depths, strict=True)):
        png(folder / f"color/{number}.png", color)
        ibr.write_depth(folder / f"depth/{number}.npy", depth.astype(np.float32))


def seven_scenes(folder: Path) -> None:
    scene = rendered()
    matrix(folder / "camera-intrinsics.txt", K)
    for number, (color, depth, one) in enumerate(zip(scene.colors, scene.depths, scene.poses, strict=True)):
        stored = counts(depth, 1000)
        stored[:2] = 65535
        png(folder / f"frame-{number:06d}.color.png", color)
        png(folder / f"frame-{number:06d}.depth.png", stored)
        matrix(folder / f"frame-{number:06d}.pose.txt", one)


def scannet(folder: Path) -> None:
    scene = rendered()
    for kind in ("color", "depth"):
        matrix(folder / f"intrinsic/intrinsic_{kind}.txt", K_4)
        matrix(folder / f"intrinsic/extrinsic_{kind}.txt", np.eye(4))
    write_frames(folder, scene, 1000, "color/{}.png", "depth/{}.png", "pose/{}.txt")
    png(folder / "color/2.png", scene.colors[0])
    png(folder / "depth/2.png", counts(scene.depths[0], 1000))
    text(folder / "pose/2.txt", "-inf -inf -inf -inf\n" * 4)


def posed_images(folder: Path) -> None:
    scene = rendered()
    matrix(folder / "intrinsic.txt", K_4)
    for number, (color, depth, one) in enumerate(zip(scene.colors, scene.depths, scene.poses, strict=True)):
        folder.mkdir(exist_ok=True)
        Image.fromarray(color).save(folder / f"{number:05d}.jpg", quality=98, subsampling=0)
        png(folder / f"{number:05d}.png", counts(depth, 1000))
        matrix(folder / f"{number:05d}.txt", one)


def sens(folder: Path) -> None:
    scene = rendered()
    row = " ".join(map(str, K_4.ravel().tolist()))
    sizes = "".join(f"m_{kind}Width = {SIZE[0]}\nm_{kind}Height = {SIZE[1]}\n" for kind in ("color", "depth"))
    matrices = "".join(f"m_calibration{kind}Intrinsic = {row}\n" for kind in ("Color", "Depth"))
    text(folder / "_info.txt", f"m_versionNumber = 4\n{sizes}m_depthShift = 2000\n{matrices}")
    for number, (color, depth, one) in enumerate(zip(scene.colors, scene.depths, scene.poses, strict=True)):
        png(folder / f"frame-{number:06d}.color.png", color)
        head = b"P5\n%d %d\n65535\n" % SIZE
        (folder / f"frame-{number:06d}.depth.pgm").write_bytes(head + counts(depth, 2000).astype(">u2").tobytes())
        matrix(folder / f"frame-{number:06d}.pose.txt", one)


def replica(folder: Path) -> None:
    scene = rendered()
    camera = {"w": SIZE[0], "h": SIZE[1], "fx": 60.0, "fy": 62.0, "cx": 30.3, "cy": 24.2, "scale": 6553.5}
    text(folder.parent / "cam_params.json", json.dumps({"camera": camera}))
    matrix(folder / "traj.txt", np.array([one.ravel() for one in scene.poses]))
    write_frames(folder, scene, 6553.5, "results/frame{:06d}.png", "results/depth{:06d}.png")


def redwood(folder: Path) -> None:
    scene, log = rendered(), ""
    columns = K.T.ravel().tolist()
    text(folder / "camera_primesense.json", json.dumps({"width": 64, "height": 48, "intrinsic_matrix": columns}))
    write_frames(folder, scene, 1000, "image/{:05d}.png", "depth/{:05d}.png")
    for number, one in enumerate(scene.poses):
        log += f"{number} {number} {number + 1}\n" + "".join(" ".join(map(repr, r)) + "\n" for r in one.tolist())
    text(folder / "trajectory.log", log)


def colmap(folder: Path) -> None:
    """A rig of cameras, each with a folder of pictures."""
    scene, lines = rendered(), ""
    text(folder / "sparse/cameras.txt", "# a list\n1 PINHOLE 64 48 60 62 30.8 24.7\n")
    for number, (color, depth, one) in enumerate(zip(scene.colors, scene.depths, scene.poses, strict=True)):
        inverse, name = np.linalg.inv(one), f"cam{number}/0001.png"
        x, y, z, w = xyzw(inverse[:3, :3]).tolist()
        lines += " ".join(map(str, [number + 1, w, x, y, z, *inverse[:3, 3].tolist(), 1, name])) + "\n\n"
        png(folder / "images" / name, color)
        maps = folder / f"stereo/depth_maps/{name}.geometric.bin"
        maps.parent.mkdir(parents=True, exist_ok=True)
        ibr.write_depth(maps, depth.astype(np.float32))
    text(folder / "sparse/images.txt", lines)


def eth3d_views(folder: Path) -> None:
    """Depth files are named as the pictures; the model has the cameras of the original pictures."""
    colmap(folder)
    (folder / "sparse").rename(folder / "dslr_calibration_jpg")
    maps = folder / "stereo/depth_maps"
    for number in range(2):
        raw = folder / f"ground_truth_depth/cam{number}/0001.png"
        raw.parent.mkdir(parents=True)
        raw.write_bytes(ibr.read_depth(maps / f"cam{number}/0001.png.geometric.bin").astype("<f4").tobytes())
    shutil.rmtree(folder / "stereo")


def nerfstudio(folder: Path, depth_key: str = "depth_file_path", unit: float | None = None) -> None:
    scene, frames = rendered(), list[Any]()
    write_frames(folder, scene, 1 / (unit or 0.001), "images/frame_{:05d}.png", "depths/frame_{:05d}.png")
    for number, one in enumerate(scene.poses):
        frame = {"file_path": f"images/frame_{number:05d}.png", depth_key: f"depths/frame_{number:05d}.png"}
        frames.append(frame | {"transform_matrix": (one @ GL).tolist()})
    told = {"fl_x": 60, "fl_y": 62, "cx": 30.8, "cy": 24.7, "w": 64, "h": 48, "frames": frames}
    text(folder / "transforms.json", json.dumps(told | ({} if unit is None else {"integer_depth_scale": unit})))


def instant_ngp(folder: Path) -> None:
    nerfstudio(folder, "depth_path", 1 / 7000)
