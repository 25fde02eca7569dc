"""Specimens of layouts: two frames of a scene whose points are known, laid out as each data set, phone or network does.

The scene is a slanted wall with a picture on it, of which every pixel's ray tells depth and colour exactly.
"""

from __future__ import annotations

import io
import json
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from PIL import Image

import pyibr as ibr

SIZE = (64, 48)
K = np.array([[60.0, 0, 30.3], [0, 62.0, 24.2], [0, 0, 1]])
GL = np.diag([1.0, -1, -1, 1])
NORMAL, OFFSET = np.array([0.25, 0.15, -1.0]), -2.5  # of the wall: points with NORMAL . x = OFFSET


def turned(x: float, y: float, z: float) -> np.ndarray:
    """A rotation by small angles about each axis."""
    a, b, c = (np.array([np.cos(t), np.sin(t)]) for t in (x, y, z))
    about_x = np.array([[1, 0, 0], [0, a[0], -a[1]], [0, a[1], a[0]]])
    about_y = np.array([[b[0], 0, b[1]], [0, 1, 0], [-b[1], 0, b[0]]])
    return np.array([[c[0], -c[1], 0], [c[1], c[0], 0], [0, 0, 1]]) @ about_y @ about_x


def pose(position: tuple[float, float, float], angles: tuple[float, float, float]) -> np.ndarray:
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = turned(*angles), position
    return made


POSES = [pose((0.1, -0.05, 0.05), (0.05, -0.08, 0.06)), pose((-0.25, 0.15, -0.1), (-0.06, 0.12, -0.09))]


class Scene(NamedTuple):
    """Views of two cameras: (H, W) planar depth, distances, (H, W, 3) colours."""

    colors: list[np.ndarray]
    depths: list[np.ndarray]
    distances: list[np.ndarray]
    poses: list[np.ndarray]


def rendered(K: np.ndarray = K, poses: list[np.ndarray] | None = None, size: tuple[int, int] = SIZE) -> Scene:
    """Pictures of the wall by cameras with OpenCV's axes whose pixel centres are at integers."""
    scene = Scene([], [], [], POSES if poses is None else poses)
    y, x = np.mgrid[: size[1], : size[0]]
    local = np.dstack([x, y, np.ones_like(x)]) @ np.linalg.inv(K).T
    for one in scene.poses:
        rays = local @ one[:3, :3].T
        depth = (OFFSET - NORMAL @ one[:3, 3]) / (rays @ NORMAL)
        points = one[:3, 3] + rays * depth[..., None]
        waves = [np.sin(5 * points[..., 0] + k) * np.cos(4 * points[..., 1] - k) for k in range(3)]
        scene.colors.append(np.rint(127.5 + 110 * np.dstack(waves)).astype(np.uint8))
        scene.depths.append(depth * local[..., 2])
        scene.distances.append(depth * np.linalg.norm(local, axis=-1))
    return scene


def png(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(image).save(path)


def counts(values: np.ndarray, scale: float) -> np.ndarray:
    return np.rint(values * scale).astype(np.uint16)


def text(path: Path, content: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content)


def matrix(path: Path, values: np.ndarray) -> None:
    text(path, "\n".join(" ".join(map(repr, row)) for row in np.atleast_2d(values).tolist()) + "\n")


def xyzw(rotation: np.ndarray) -> np.ndarray:
    w = np.sqrt(1 + np.trace(rotation)) / 2
    skew = rotation - rotation.T
    return np.array([skew[2, 1], skew[0, 2], skew[1, 0], 4 * w * w]) / (4 * w)


def tum_line(time: object, pose: np.ndarray) -> str:
    return " ".join(map(str, [time, *pose[:3, 3].tolist(), *xyzw(pose[:3, :3]).tolist()]))


# ---- one function a layout


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
    """At a tenth of its size, the camera that the data set recommends."""
    tum(folder, np.array([[52.5, 0, 31.5], [0, 52.5, 23.5], [0, 0, 1]]))


def icl(folder: Path) -> None:
    """The camera is as it is told, with fy < 0: y up, and its poses rigid in that mirrored frame."""
    mirror = np.diag([1.0, -1, 1, 1])
    scene = rendered(np.array([[48.12, 0, 31.5], [0, 48.0, 23.5], [0, 0, 1]]))
    lines = [tum_line(number, mirror @ pose @ mirror) for number, pose in enumerate(scene.poses, 1)]
    text(folder / "livingRoom2.gt.freiburg", "\n".join(lines))
    for number in (0, 1, 2):  # the first has no pose
        png(folder / f"rgb/{number}.png", scene.colors[max(number - 1, 0)])
        png(folder / f"depth/{number}.png", counts(scene.depths[max(number - 1, 0)], 5000))


def upward(folder: Path) -> None:
    """Two folders of a camera whose fy is negative, and its poses."""
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
    scene, four = rendered(), np.eye(4)
    four[:3, :3] = K
    for kind in ("color", "depth"):
        matrix(folder / f"intrinsic/intrinsic_{kind}.txt", four)
        matrix(folder / f"intrinsic/extrinsic_{kind}.txt", np.eye(4))
    for number, (color, depth, one) in enumerate(zip(scene.colors, scene.depths, scene.poses, strict=True)):
        png(folder / f"color/{number}.png", color)
        png(folder / f"depth/{number}.png", counts(depth, 1000))
        matrix(folder / f"pose/{number}.txt", one)
    png(folder / "color/2.png", scene.colors[0])
    png(folder / "depth/2.png", counts(scene.depths[0], 1000))
    text(folder / "pose/2.txt", "-inf -inf -inf -inf\n" * 4)


def posed_images(folder: Path) -> None:
    scene, four = rendered(), np.eye(4)
    four[:3, :3] = K
    matrix(folder / "intrinsic.txt", four)
    for number, (color, depth, one) in enumerate(zip(scene.colors, scene.depths, scene.poses, strict=True)):
        folder.mkdir(exist_ok=True)
        Image.fromarray(color).save(folder / f"{number:05d}.jpg", quality=98, subsampling=0)
        png(folder / f"{number:05d}.png", counts(depth, 1000))
        matrix(folder / f"{number:05d}.txt", one)


def sens(folder: Path) -> None:
    scene, four = rendered(), np.eye(4)
    four[:3, :3] = K
    row = " ".join(map(str, four.ravel().tolist()))
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
    for number, (color, depth) in enumerate(zip(scene.colors, scene.depths, strict=True)):
        png(folder / f"results/frame{number:06d}.png", color)
        png(folder / f"results/depth{number:06d}.png", counts(depth, 6553.5))


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


def redwood(folder: Path) -> None:
    scene, log = rendered(), ""
    columns = K.T.ravel().tolist()
    text(folder / "camera_primesense.json", json.dumps({"width": 64, "height": 48, "intrinsic_matrix": columns}))
    for number, (color, depth, one) in enumerate(zip(scene.colors, scene.depths, scene.poses, strict=True)):
        png(folder / f"image/{number:05d}.png", color)
        png(folder / f"depth/{number:05d}.png", counts(depth, 1000))
        log += f"{number} {number} {number + 1}\n" + "".join(" ".join(map(repr, r)) + "\n" for r in one.tolist())
    text(folder / "trajectory.log", log)


def colmap(folder: Path) -> None:
    """With a rig: pictures lie in a folder of each of its cameras."""
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
    """Depth under the pictures' names; the model is of the pictures as they were taken."""
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
    for number, (color, depth, one) in enumerate(zip(scene.colors, scene.depths, scene.poses, strict=True)):
        png(folder / f"images/frame_{number:05d}.png", color)
        png(folder / f"depths/frame_{number:05d}.png", counts(depth, 1000 if unit is None else 1 / unit))
        frame = {"file_path": f"images/frame_{number:05d}.png", depth_key: f"depths/frame_{number:05d}.png"}
        frames.append(frame | {"transform_matrix": (one @ GL).tolist()})
    told = {"fl_x": 60, "fl_y": 62, "cx": 30.8, "cy": 24.7, "w": 64, "h": 48, "frames": frames}
    text(folder / "transforms.json", json.dumps(told | ({} if unit is None else {"integer_depth_scale": unit})))


def instant_ngp(folder: Path) -> None:
    nerfstudio(folder, "depth_path", 1 / 7000)


def middlebury(folder: Path) -> None:
    """The other camera stands to the right, its principal point doffs farther right; disparity leaves that out."""
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


def stray(folder: Path) -> None:
    """Depth has a quarter of the samples; the first rows' are unsure, and wrong."""
    scene = rendered()
    small = rendered(ibr.Camera(K, SIZE).resized((32, 24)).K, size=(32, 24))
    text(folder / "camera_matrix.csv", "\n".join(", ".join(map(repr, row)) for row in K.tolist()))
    lines = ["timestamp, frame, x, y, z, qx, qy, qz, qw"]
    for number, one in enumerate(scene.poses):
        stored, sure = counts(small.depths[number], 1000), np.full((24, 32), 2, np.uint8)
        stored[:3], sure[:3] = 700, 0
        png(folder / f"rgb/{number:06d}.png", scene.colors[number])
        png(folder / f"depth/{number:06d}.png", stored)
        png(folder / f"confidence/{number:06d}.png", sure)
        values = [*one[:3, 3].tolist(), *xyzw(one[:3, :3]).tolist()]
        lines.append(f"{number / 60}, {number:06d}, " + ", ".join(map(repr, values)))
    text(folder / "odometry.csv", "\n".join(lines))


def record3d(folder: Path) -> None:
    scene, rows = rendered(), []
    small = rendered(ibr.Camera(K, SIZE).resized((32, 24)).K, size=(32, 24))
    (folder / "depth").mkdir(parents=True, exist_ok=True)
    for number, one in enumerate(scene.poses):
        x, y, z, w = xyzw(one[:3, :3]).tolist()
        rows.append([w, z, -y, -x, *one[:3, 3].tolist()])  # half a turn about x, then that
        png(folder / f"rgb/{number}.png", scene.colors[number])
        np.save(folder / f"depth/{number}.npy", small.depths[number].astype(np.float32))
    told = {"K": K.T.ravel().tolist(), "w": 64, "h": 48, "dw": 32, "dh": 24, "fps": 60, "poses": rows}
    text(folder / "metadata.json", json.dumps(told))


def polycam(folder: Path) -> None:
    """Frames that the app has corrected; the first rows of depth are not sure."""
    stray(folder / "it")
    for number, one in enumerate(POSES):
        told = {"fx": 60, "fy": 62, "cx": 30.3, "cy": 24.2, "width": 64, "height": 48, "blur_score": 9.0}
        told |= {f"t_{i}{j}": (one @ GL)[i, j] for i in range(3) for j in range(4)}
        text(folder / f"keyframes/corrected_cameras/{900 + number}.json", json.dumps(told))
        text(folder / f"keyframes/cameras/{900 + number}.json", "{}")
        for kind, name in (("rgb", "corrected_images"), ("depth", "depth"), ("confidence", "confidence")):
            (folder / "keyframes" / name).mkdir(exist_ok=True)
            (folder / f"it/{kind}/{number:06d}.png").rename(folder / f"keyframes/{name}/{900 + number}.png")
    shutil.rmtree(folder / "it")


def scanner_app(folder: Path) -> None:
    """Depth of all frames, pictures of some."""
    stray(folder / "it")
    for number, one in enumerate([POSES[0], np.eye(4), POSES[1]]):
        told = {
            "intrinsics": K.ravel().tolist(),
            "cameraPoseARFrame": (one @ GL).ravel().tolist(),
            "frame_index": number,
        }
        text(folder / f"frame_{number:05d}.json", json.dumps(told))
        stem = f"{number // 2:06d}.png"
        for kind, name in (("depth", "depth"), ("confidence", "conf")):
            shutil.copy(folder / f"it/{kind}/{stem}", folder / f"{name}_{number:05d}.png")
        if number != 1:
            with Image.open(folder / f"it/rgb/{stem}") as picture:
                picture.save(folder / f"frame_{number:05d}.jpg", quality=98, subsampling=0)
    shutil.rmtree(folder / "it")


def r3d(folder: Path) -> None:
    """Frames as the app packs them into a .r3d file; K is told for each."""
    lzfse = pytest.importorskip("lzfse")
    record3d(folder)
    told = json.loads((folder / "metadata.json").read_text()) | {"K": np.eye(3).ravel().tolist()}
    told["perFrameIntrinsicCoeffs"] = [[60.0, 62.0, 30.3, 24.2]] * 2
    text(folder / "metadata", json.dumps(told))
    (folder / "rgbd").mkdir()
    for number in range(2):
        with Image.open(folder / f"rgb/{number}.png") as picture:
            picture.save(folder / f"rgbd/{number}.jpg", quality=98, subsampling=0)
        depth = np.load(folder / f"depth/{number}.npy")
        (folder / f"rgbd/{number}.depth").write_bytes(lzfse.compress(depth.astype("<f4").tobytes()))
        (folder / f"rgbd/{number}.conf").write_bytes(lzfse.compress(np.full(depth.shape, 2, np.uint8).tobytes()))
    for name in ("rgb", "depth"):
        shutil.rmtree(folder / name)
    (folder / "metadata.json").unlink()


def r3d_packed(folder: Path) -> None:
    r3d(folder / "it")
    packed = shutil.make_archive(str(folder / "one"), "zip", folder / "it")
    Path(packed).rename(folder / "one.r3d")
    shutil.rmtree(folder / "it")


def kitti(folder: Path) -> None:
    """Without poses: of two cameras of the same place."""
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


def depth_anything(
    folder: Path, names: tuple[str, ...] = ("image", "depth", "conf", "extrinsics", "intrinsics")
) -> None:
    scene = rendered()
    depth = np.array(scene.depths, np.float32)
    sure = np.full(depth.shape, 5, np.float32)
    inverses = np.linalg.inv(np.array(scene.poses))[:, :3].astype(np.float32)
    arrays = [np.array(scene.colors), depth, sure, inverses, np.tile(K, (2, 1, 1)).astype(np.float32)]
    if names[0] == "images":  # VGGT's: channels first, depth with an axis behind, a batch of one
        arrays[0] = np.moveaxis(arrays[0], -1, 1).astype(np.float32) / 255
        arrays = [one[None] for one in (arrays[0], depth[..., None], *arrays[2:])]
    folder.mkdir(exist_ok=True)
    np.savez_compressed(folder / "results.npz", **dict(zip(names, arrays, strict=True)))


def vggt(folder: Path) -> None:
    depth_anything(folder, ("images", "depth", "depth_conf", "extrinsic", "intrinsic"))


def moge(folder: Path) -> None:
    """One picture: its centre is the principal point."""
    scene = rendered(np.array([[60.0, 0, 31.5], [0, 62.0, 23.5], [0, 0, 1]]), [np.eye(4)])
    fov = [2 * np.degrees(np.arctan(n / 2 / f)) for n, f in ((64, 60.0), (48, 62.0))]
    png(folder / "image.png", scene.colors[0])
    depth, mask = scene.depths[0].astype(np.float32), np.full((48, 64), 255, np.uint8)
    depth[:3], mask[:3] = 0.1, 0
    np.save(folder / "depth.npy", depth)
    png(folder / "mask.png", mask)
    text(folder / "fov.json", json.dumps(dict(zip(("fov_x", "fov_y"), fov, strict=True))))


def depth_pro(folder: Path) -> None:
    scene = rendered(np.array([[60.0, 0, 31.5], [0, 60.0, 23.5], [0, 0, 1]]), [np.eye(4)])
    png(folder / "a.png", scene.colors[0])
    np.savez(folder / "a.npz", depth=scene.depths[0].astype(np.float32), focallength_px=np.float32(60))


def kitti_drive(folder: Path) -> None:
    scene = rendered(poses=[np.eye(4), np.eye(4)])
    for number, (color, depth) in enumerate(zip(scene.colors, scene.depths, strict=True), 5):
        png(folder / f"image_02/data/{number:010d}.png", color)
        png(folder / f"proj_depth/groundtruth/image_02/{number:010d}.png", counts(depth, 256))
    row = " ".join(map(str, np.column_stack([K, [4.5, 0, 0]]).ravel().tolist()))
    text(folder.parent / "calib_cam_to_cam.txt", f"corner_dist: 9.95e-02\nP_rect_02: {row}\n")


def hypersim(folder: Path) -> None:
    """A camera whose image is tilted: its K is skewed, and it looks along the image's normal."""
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


def ros_bag(folder: Path, packed: bool = False) -> None:
    """The camera moves between two transforms; its optical frame is turned in the body's, as ROS has it."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store, scene, optical = get_typestore(Stores.LATEST), rendered(), np.eye(4)
    types = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
    optical[:3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]

    def header(time: float, frame: str) -> Any:
        stamp = types["Time"](sec=int(time), nanosec=round(time % 1 * 1e9))
        return types["Header"](stamp=stamp, frame_id=frame)

    def transform(time: float, above: str, frame: str, pose: np.ndarray) -> Any:
        x, y, z, w = xyzw(pose[:3, :3]).tolist()
        moved = types["Vector3"](*pose[:3, 3].tolist())
        told = types["Transform"](translation=moved, rotation=types["Quaternion"](x, y, z, w))
        one = types["TransformStamped"](header=header(time, above), child_frame_id=frame, transform=told)
        return types["TFMessage"]([one])

    def picture(time: float, encoding: str, values: np.ndarray) -> Any:
        data = np.frombuffer(values.tobytes(), np.uint8)
        return types["Image"](header(time, "optical"), 48, 64, encoding, 0, len(data) // 48, data)

    def packed_depth(time: float, depth: np.ndarray) -> Any:
        """As compressed_depth_image_transport has it by default: a / depth + b as 16 bits, 10 units far at most."""
        scale, stored = 100 * 101.0, io.BytesIO()
        least = 1 - scale / 10
        Image.fromarray((scale / depth + least).astype(np.uint16)).save(stored, "PNG")
        data = struct.pack("<iff", 0, scale, least) + stored.getvalue()
        form = "32FC1; compressedDepth png"
        return types["CompressedImage"](header(time, "optical"), form, np.frombuffer(data, np.uint8))

    region = types["RegionOfInterest"](0, 0, 0, 0, False)
    info = types["CameraInfo"](
        header(0, "optical"), 48, 64, "plumb_bob", np.zeros(5), K.ravel(), np.eye(3).ravel(),
        np.zeros(12), 0, 0, region,
    )  # fmt: skip
    messages = [("/cam/color/camera_info", info, 0.0), ("/cam/depth/camera_info", info, 0.0)]
    messages.append(("/tf_static", transform(0, "body", "optical", optical), 0.0))
    for time, color, depth, one in zip((5.0, 6.0), scene.colors, scene.depths, scene.poses, strict=True):
        messages.append(("/cam/color/image_raw", picture(time, "bgr8", color[..., ::-1]), time))
        if packed:
            messages.append(("/cam/depth/image_raw/compressedDepth", packed_depth(time + 0.004, depth), time))
        else:
            messages.append(("/cam/depth/image_raw", picture(time + 0.004, "16UC1", counts(depth, 1000)), time))
        body, aside = one @ np.linalg.inv(optical), np.eye(4)
        for sign in (-1, 1):  # halfway between these it is where it was
            aside[0, 3] = sign * 0.3
            messages.append(("/tf", transform(time + sign * 0.02, "map", "body", aside @ body), time))
    with Writer(folder, version=9) as writer:
        connections: dict[str, Any] = {}
        for topic, message, time in messages:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], round(time * 1e9), store.serialize_cdr(message, kind))


def ros_packed(folder: Path) -> None:
    ros_bag(folder, packed=True)


_MAKERS = (tum_camera, eth3d, tum_known, icl, seven_scenes, scannet, posed_images, sens, replica, bop, redwood, colmap)
_MAKERS += (
    eth3d_views,
    nerfstudio,
    instant_ngp,
    middlebury,
    stray,
    record3d,
    r3d,
    r3d_packed,
    polycam,
    scanner_app,
    sintel,
)
_MAKERS += (depth_anything, vggt, kitti, kitti_drive, hypersim, ros_bag, ros_packed, upward, moge, depth_pro)
SPECIMENS: dict[str, tuple[Callable[[Path], None], int]] = {
    one.__name__: (one, 1 if one in (moge, depth_pro) else 2) for one in _MAKERS
}
"""Makers of folders, each with the number of frames that can be used."""
