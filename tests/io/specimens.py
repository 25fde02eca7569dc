"""A file of each kind that pyibr reads, how it is read, and how each kind is written: for tests of damages."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import pyibr as ibr
from pyibr.io import read_cameras, read_poses, read_range_grid, read_relief_map, write_relief_map
from tests import calibrations

RNG = np.random.default_rng(0)
SIZE = (17, 11)
COLOR = RNG.integers(0, 256, (*SIZE[::-1], 3), dtype=np.uint8)
DEPTH = RNG.uniform(0.5, 60, SIZE[::-1]).astype(np.float32)
CAMERA = ibr.Camera([[30, 0, 8], [0, 30, 5], [0, 0, 1]], SIZE)
VERTICES = RNG.random((30, 3)).astype(np.float32)
FACES = RNG.integers(0, 30, (40, 3))
NORMALS = VERTICES + np.float32(0.1)
TEXTURED = ibr.Mesh(VERTICES, FACES, uv=RNG.random((30, 2)), normals=NORMALS, texture=COLOR)
COLORED = ibr.Mesh(VERTICES, FACES, uv=None, normals=NORMALS, colors=RNG.integers(0, 256, (30, 3), dtype=np.uint8))

Write = Callable[[Path], None]
Read = Callable[[Path], Any]


def _points(form: str) -> str:
    return form * len(VERTICES) % tuple(VERTICES.ravel().tolist())


def _ply_of_text(path: Path) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 30\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 40\nproperty list uchar int vertex_indices\nend_header\n"
    faces = "3 %d %d %d\n" * len(FACES) % tuple(FACES.ravel().tolist())
    path.write_text(head + _points("%r %r %r\n") + faces)


def _stl_of_text(path: Path) -> None:
    facets = ("facet normal 0 0 1\nouter loop\n" + "vertex %r %r %r\n" * 3 + "endloop\nendfacet\n") * len(FACES)
    path.write_text("solid thing\n" + facets % tuple(VERTICES[FACES].ravel().tolist()) + "endsolid thing\n")


def _packed_ply(path: Path) -> None:
    COLORED.save(path.with_suffix(""))
    path.write_bytes(gzip.compress(path.with_suffix("").read_bytes()))


def _range_grid(path: Path) -> None:
    head = "ply\nformat ascii 1.0\nobj_info num_cols 6\nobj_info num_rows 5\nelement vertex 30\nproperty float x\n"
    head += "property float y\nproperty float z\nelement range_grid 30\nproperty list uchar int vertex_indices\n"
    path.write_text(head + "end_header\n" + _points("%r %r %r\n") + "".join(f"1 {i}\n" for i in range(30)))


def _relief_map(path: Path) -> None:
    write_relief_map(path, np.full((*SIZE[::-1], 3), (0, 0, 1.0)), COLOR[..., 0])


def _poses(path: Path) -> None:
    lines = [f"{k}.5 {k} 2 3 0.5 0.5 -0.5 0.5\n" for k in range(20)]
    path.write_text("# time tx ty tz qx qy qz qw\n" + "".join(lines))


def _cameras(path: Path) -> None:
    CAMERA.save(path)
    one = path.read_text()
    path.write_text(f"[{one}, {one}]")


def _open3d() -> dict[str, Any]:
    intrinsic = {"width": SIZE[0], "height": SIZE[1], "intrinsic_matrix": CAMERA.K.T.ravel().tolist()}
    return {"intrinsic": intrinsic, "extrinsic": CAMERA.camera_from_world.T.ravel().tolist()}


def _open3d_camera(path: Path) -> None:
    path.write_text(json.dumps(_open3d()))


def _open3d_trajectory(path: Path) -> None:
    path.write_text(json.dumps({"class_name": "PinholeCameraTrajectory", "parameters": [_open3d(), _open3d()]}))


def _color(path: Path) -> None:
    ibr.write_color(path, COLOR)


def _depth(path: Path) -> None:
    ibr.write_depth(path, DEPTH, depth_scale=1000)


def _read_depth(path: Path) -> Any:
    return ibr.read_depth(path, depth_scale=1000)


WRITERS: dict[str, Write] = {
    **{f"color{suffix}": _color for suffix in (".png", ".jpg", ".tif", ".bmp", ".webp", ".ppm", ".exr", ".npz")},
    **{f"depth{suffix}": _depth for suffix in (".png", ".tif", ".npy", ".npz", ".pfm", ".exr", ".bin")},
    "relief.png": _relief_map,
    "camera.json": CAMERA.save,
    **{f"textured{suffix}": TEXTURED.save for suffix in (".glb", ".obj")},
    **{f"colored{suffix}": COLORED.save for suffix in (".glb", ".obj", ".ply", ".off", ".stl")},
}
CALIBRATIONS = {
    "ros.yaml": calibrations.ROS,
    "ros.ini": calibrations.ROS_INI,
    "opencv.xml": calibrations.OPENCV_XML,
    "orbbec.ini": calibrations.ORBBEC,
    "azure.json": json.dumps(calibrations.AZURE),
    "oak.json": json.dumps(calibrations.oak()),
    "transforms.json": json.dumps(calibrations.transforms()[0]),
}
OTHERS: dict[str, Write] = {  # what is read, but not written
    "text.ply": _ply_of_text,
    "text.stl": _stl_of_text,
    "packed.ply.gz": _packed_ply,
    "grid.ply": _range_grid,
    "poses.txt": _poses,
    "cameras.json": _cameras,
    "camera.open3d.json": _open3d_camera,
    "cameras.open3d.json": _open3d_trajectory,
    **{f"cameras.{name}": partial(Path.write_text, data=text) for name, text in CALIBRATIONS.items()},
}
CHECKED = ("color.png", "depth.png", "relief.png", "color.npz", "depth.npz", "packed.ply.gz")
"""Formats with sums of all that matters: a damage is seen, or does no harm."""
DECODED_ELSEWHERE = ["depth.png", "depth.tif", "depth.exr"]
DECODED_ELSEWHERE += [name for name in WRITERS if name.startswith(("color.", "relief."))]
"""What libraries in C decode, whose faults might kill the interpreter."""


def reader(name: str) -> Read:
    """Reader of the specimen of this name."""
    if name == "grid.ply":
        return read_range_grid
    by_stem: dict[str, Read] = {"color": ibr.read_color, "depth": _read_depth, "relief": read_relief_map}
    by_stem |= {"camera": ibr.Camera.load, "cameras": read_cameras, "poses": read_poses}
    return by_stem.get(name.partition(".")[0], ibr.Mesh.load)


def same(one: Any, other: Any) -> bool:
    """Tell whether two things that were read are equal."""
    if isinstance(one, tuple):
        return all(same(a, b) for a, b in zip(one, other, strict=True))
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=True)
    if isinstance(one, ibr.Mesh):
        names = ("vertices", "faces", "uv", "normals", "colors", "texture")
        return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)
    return repr(one) == repr(other)
