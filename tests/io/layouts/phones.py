"""Specimens of recordings from phone apps."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import pyibr as ibr
from tests.io.layouts.wall import GL, POSES, SIZE, K, counts, png, rendered, text, xyzw


def stray(folder: Path) -> None:
    """Depth has a quarter as many samples as the picture has pixels; its first rows are wrong, with low confidence."""
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
        rows.append([w, z, -y, -x, *one[:3, 3].tolist()])  # the rotation after a half turn about x
        png(folder / f"rgb/{number}.png", scene.colors[number])
        np.save(folder / f"depth/{number}.npy", small.depths[number].astype(np.float32))
    told = {"K": K.T.ravel().tolist(), "w": 64, "h": 48, "dw": 32, "dh": 24, "fps": 60, "poses": rows}
    text(folder / "metadata.json", json.dumps(told))


def polycam(folder: Path) -> None:
    """Frames with cameras that the app has corrected; the first rows of depth have low confidence."""
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
    """All frames have depth, but only some have pictures."""
    stray(folder / "it")
    for number, one in enumerate([POSES[0], np.eye(4), POSES[1]]):
        told = {"intrinsics": K.ravel().tolist(), "cameraPoseARFrame": (one @ GL).ravel().tolist()}
        told["frame_index"] = number
        text(folder / f"frame_{number:05d}.json", json.dumps(told))
        stem = f"{number // 2:06d}.png"
        for kind, name in (("depth", "depth"), ("confidence", "conf")):
            shutil.copy(folder / f"it/{kind}/{stem}", folder / f"{name}_{number:05d}.png")
        if number != 1:
            with Image.open(folder / f"it/rgb/{stem}") as picture:
                picture.save(folder / f"frame_{number:05d}.jpg", quality=98, subsampling=0)
    shutil.rmtree(folder / "it")


def r3d(folder: Path) -> None:
    """A packed .r3d file, as the app writes it, with a K for each frame."""
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
