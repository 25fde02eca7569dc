"""A specimen of each file format that pyibr reads, with a function that writes it and one that reads it."""

from __future__ import annotations

import gzip
import json
import struct
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import pyibr as ibr
from pyibr.io import read_cameras, read_poses, read_range_grid, read_relief_map, write_relief_map
from tests import calibrations
from tests.io.others_meshes import write_concave_off, write_painted_obj, write_skinned, write_wedges_ply

RNG = np.random.default_rng(0)
SIZE = (17, 11)
SIZES = [(7, 13), (1, 1), (61, 37)]
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


def depth_of(size) -> np.ndarray:
    depth = np.random.default_rng(1).uniform(0.5, 60, size[::-1]).astype(np.float32)
    if depth.size > 1:
        depth[0, -1] = np.nan
    return depth


def color_of(size) -> np.ndarray:
    return np.random.default_rng(2).integers(0, 256, (*size[::-1], 3), dtype=np.uint8)


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


def tiff(values: np.ndarray, orientation: int = 1) -> bytes:
    """Make a TIFF file with the array's byte order, without a library."""
    order, kind = ">" if values.dtype.byteorder == ">" else "<", {"u": 1, "i": 2, "f": 3}[values.dtype.kind]
    height, width = values.shape
    fields = [(256, width), (257, height), (258, 8 * values.itemsize), (259, 1), (262, 1), (273, 146)]
    fields += [(274, orientation), (277, 1), (278, height), (279, values.nbytes), (339, kind)]
    entries = b"".join(struct.pack(f"{order}HHII", tag, 4, 1, value) for tag, value in fields)
    head = b"II*\0" if order == "<" else b"MM\0*"
    return head + struct.pack(f"{order}IH", 8, len(fields)) + entries + bytes(4) + values.tobytes()


def _tiff_of_doubles(path: Path) -> None:
    path.write_bytes(tiff(DEPTH.astype(">f8"), orientation=6))


def _exr_of_parts(path: Path) -> None:
    """Write an OpenEXR file of two parts; depth has another data window than colour."""
    import OpenEXR

    shown = (0, 0), (SIZE[0] + 4, SIZE[1] + 3)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "displayWindow": shown}
    color = {f"beauty.{name}": np.ascontiguousarray(COLOR[..., k], np.float32) for k, name in enumerate("RGB")}
    window = {"dataWindow": ((2, 1), (SIZE[0] + 1, SIZE[1]))}
    parts = [OpenEXR.Part({**header}, color, "color"), OpenEXR.Part({**header, **window}, {"Depth.Z": DEPTH}, "depth")]
    OpenEXR.File(parts).write(str(path))


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
_SCENE = {"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"camera": 0, "translation": [1, 2, 3]}]}
_SCENE |= {"cameras": [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}]}
OTHERS: dict[str, Write] = {  # formats that are read only
    "text.ply": _ply_of_text,
    "text.stl": _stl_of_text,
    "packed.ply.gz": _packed_ply,
    "painted.obj": write_painted_obj,
    "wedges.ply": write_wedges_ply,
    "concave.off": write_concave_off,
    "skinned.gltf": write_skinned,
    "depth.doubles.tif": _tiff_of_doubles,
    "depth.parts.exr": _exr_of_parts,
    "grid.ply": _range_grid,
    "poses.txt": _poses,
    "cameras.json": _cameras,
    "camera.open3d.json": _open3d_camera,
    "cameras.open3d.json": _open3d_trajectory,
    "poses.npy": partial(np.save, arr=np.tile(np.eye(4), (3, 1, 1))),
    "cameras.npy": partial(np.save, arr=CAMERA.K),
    "cameras.calib.txt": partial(Path.write_text, data="cam0=[30 0 8; 0 30 5; 0 0 1]\nwidth=17\nheight=11\n"),
    "cameras.par.txt": partial(Path.write_text, data="1\na.png 30 0 8 0 30 5 0 0 1 1 0 0 0 1 0 0 0 1 2 3 4\n"),
    "cameras.gltf": partial(Path.write_text, data=json.dumps(_SCENE)),
    "depth.pgm": partial(Path.write_bytes, data=b"P5\n17 11\n65535\n" + (9 * DEPTH).astype(">u2").tobytes()),
    **{f"cameras.{name}": partial(Path.write_text, data=text) for name, text in CALIBRATIONS.items()},
}
CHECKED = ("color.png", "depth.png", "relief.png", "color.npz", "depth.npz", "packed.ply.gz")
"""Specimens whose formats have checksums over all relevant bytes: damage is detected or does no harm."""
DECODED_ELSEWHERE = ["depth.png", "depth.tif", "depth.exr", "depth.doubles.tif", "depth.parts.exr", "depth.pgm"]
DECODED_ELSEWHERE += [name for name in WRITERS if name.startswith(("color.", "relief."))]
"""Specimens that libraries in C decode, which might crash the interpreter."""


def reader(name: str) -> Read:
    """Look up the function that reads a specimen."""
    if name == "grid.ply":
        return read_range_grid
    by_stem: dict[str, Read] = {"color": ibr.read_color, "depth": _read_depth, "relief": read_relief_map}
    by_stem |= {"camera": ibr.Camera.load, "cameras": partial(read_cameras, size=SIZE), "poses": read_poses}
    return by_stem.get(name.partition(".")[0], ibr.Mesh.load)


def same(one: Any, other: Any) -> bool:
    """Tell whether two results of one reader are equal."""
    if isinstance(one, tuple):
        return all(same(a, b) for a, b in zip(one, other, strict=True))
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=True)
    if isinstance(one, ibr.Mesh):
        names = ("vertices", "faces", "uv", "normals", "colors", "texture")
        return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)
    return repr(one) == repr(other)
