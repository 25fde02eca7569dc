"""Rendered data sets: Replica in NICE-SLAM's layout, MPI Sintel, Hypersim."""

from __future__ import annotations

import csv
import functools
from pathlib import Path

import numpy as np

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64
from pyibr.core.conventions import CV_FROM_GL
from pyibr.core.errors import FileFormatError
from pyibr.core.files import read_text, reading
from pyibr.io.arrays import read_hdf5
from pyibr.io.floats import read_camera
from pyibr.io.folders import files_in
from pyibr.io.layouts.parts import by_number, camera_of, inverted, joined, matrix, object_in, own_camera
from pyibr.io.poses import rigid_or_none
from pyibr.io.recordings import COLOR_SUFFIXES, Recording, Stored, paired_files, size_of

_REPLICA = matrix(600.0, 599.5, 339.5)
_SINTEL_PASSES = ("final", "clean", "albedo", "rgb")
_HYPERSIM_FIELD = np.tan(np.pi / 6)  # tangent of half the default field of 60 degrees


def find_replica(folder: Path) -> Recording | None:
    """Find results/frame000000.jpg and depth000000.png beside traj.txt; cam_params.json here or one folder up."""
    results, trajectory = folder / "results", folder / "traj.txt"
    if not (trajectory.is_file() and results.is_dir()):
        return None
    colors, depths = files_in(results, COLOR_SUFFIXES, "frame"), files_in(results, (".png",), "depth")
    if not colors or not depths:
        return None
    found = paired_files(str(results), colors, depths)
    parameters = [place / "cam_params.json" for place in (folder, folder.resolve().parent)]
    file = next((file for file in parameters if file.is_file()), None)
    if file is None:
        known, scale = own_camera("Replica", _REPLICA, (1200, 680), colors), 6553.5
    else:
        camera, scale = _replica_camera(file)
        known = functools.partial(list[Camera], [camera])
    return found._replace(poses=trajectory, known=known, stored=[Stored(scale)] * len(found.colors))


def _replica_camera(file: Path) -> tuple[Camera, float]:
    """The camera, and stored units of depth per metre."""
    told = object_in(file, "")
    try:
        told = told.get("camera", told)
        fx, fy, cx, cy, scale = (float(told[name]) for name in ("fx", "fy", "cx", "cy", "scale"))
        return camera_of(file, matrix(fx, cx, cy, fy), (int(told["w"]), int(told["h"]))), scale
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise FileFormatError(f"{file}: expected w, h, fx, fy, cx, cy and scale: {error}") from error


def find_sintel(folder: Path) -> Recording | None:
    """Find depth .dpt and cameras .cam (in depth and camdata_left) beside pictures, with scene folders or without."""
    places = [(folder.parent.parent, folder, folder.name)]
    places += [(folder, folder / name, "") for name in _SINTEL_PASSES]
    for root, pictures, scene in places:
        depth, data = root / "depth" / scene, root / "camdata_left" / scene
        if depth.is_dir() and data.is_dir() and pictures.is_dir() and (depths := by_number(depth, (".dpt",))):
            break
    else:
        return None
    colors, cameras = by_number(pictures, COLOR_SUFFIXES), by_number(data, (".cam",))
    numbers, found = joined(data, colors, depths, cameras)
    read = [read_camera(cameras[number]) for number in numbers]
    size = size_of(colors[numbers[0]])
    return found._replace(
        known=lambda: [camera_of(cameras[n], K, size) for n, (K, _) in zip(numbers, read, strict=True)],
        placed=[inverted(np.vstack([extrinsic, [0, 0, 0, 1]])) for _, extrinsic in read],
    )


def find_hypersim(folder: Path) -> Recording | None:
    """Find a scene's images and _detail: distance in metres, OpenGL's cameras, maybe with tilted images."""
    details = sorted((folder / "_detail").glob("cam_*"))
    scenes = [(one, folder / "images" / f"scene_{one.name}") for one in details]
    found = [one for one, images in scenes if images.with_name(f"{images.name}_geometry_hdf5").is_dir()]
    if not found:
        return None
    intrinsics, metres = _hypersim_scene(folder)
    colors, depths, cameras, placed = list[Path](), list[Path](), list[Camera](), list[Float64 | None]()
    for detail in found:
        images = folder / "images" / f"scene_{detail.name}"
        pictures = by_number(images.with_name(f"{images.name}_final_preview"), COLOR_SUFFIXES, "tonemap")
        distances = by_number(images.with_name(f"{images.name}_geometry_hdf5"), (".hdf5",), "depth_meters")
        keys = [detail / f"camera_keyframe_{name}.hdf5" for name in ("frame_indices", "orientations", "positions")]
        indices, turns, places = (read_hdf5(key) for key in keys)
        for index, turn, place in zip(indices.ravel(), turns, places, strict=True):
            if int(index) not in pictures or int(index) not in distances:
                continue
            colors.append(pictures[int(index)])
            depths.append(distances[int(index)])
            camera, turned = untilted(keys[1], intrinsics, size_of(colors[0]))
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = turn, place * metres
            exact = rigid_or_none(pose)
            cameras.append(camera)
            placed.append(None if exact is None else exact @ CV_FROM_GL @ turned)
    return Recording(
        colors, depths, known=lambda: cameras, placed=placed, stored=[Stored(kind="distance")] * len(colors)
    )


def untilted(path: Path, cam_from_uv: Float64 | None, size: tuple[int, int]) -> tuple[Camera, Float64]:
    """A pinhole that looks along the normal of its image, and its pose in the frame of the stored camera.

    cam_from_uv: (3, 3), directions (x right, y up, z backward) of (u, v, 1), from -1 to 1 over the picture, v upward.
    An image plane that is oblique to one camera's axis is upright for a rotated camera: the matrix from rays to pixels
    is K times a rotation.
    """
    width, height = size
    if cam_from_uv is None:
        cam_from_uv = np.diag([_HYPERSIM_FIELD, _HYPERSIM_FIELD * height / width, -1])
    uv_from_pixel = np.array([[2 / width, 0, 1 / width - 1], [0, -2 / height, 1 - 1 / height], [0, 0, 1]])
    pixel_from_ray = np.linalg.inv(CV_FROM_GL[:3, :3] @ cam_from_uv @ uv_from_pixel)
    back, upper = np.linalg.qr(pixel_from_ray[::-1].T)  # K and the rotation, rows in reverse order
    K, rotation = upper.T[::-1, ::-1], back.T[::-1]
    signs = np.sign(np.diag(K))
    pose = np.eye(4)
    pose[:3, :3] = (signs[:, None] * rotation).T
    return camera_of(path, K * signs / (K * signs)[2, 2], size), pose


def _hypersim_scene(folder: Path) -> tuple[Float64 | None, float]:
    """Directions of a scene's pixels, if the table of all scenes is near, and metres per unit of its positions."""
    name = "metadata_camera_parameters.csv"
    tables = [place / name for place in (folder, folder / "_detail", folder.resolve().parent)]
    for path in (table for table in tables if table.is_file()):
        rows = _rows(path)
        row = next((row for row in rows if row.get("scene_name") == folder.resolve().name), None)
        if row is not None:
            try:
                numbers = [float(row[f"M_cam_from_uv_{i}{j}"]) for i in range(3) for j in range(3)]
                return np.reshape(numbers, (3, 3)), float(row["settings_units_info_meters_scale"])
            except (KeyError, ValueError) as error:
                raise FileFormatError(f"{path}: {error}") from error
    path = folder / "_detail" / "metadata_scene.csv"
    told = {row.get("parameter_name", ""): row.get("parameter_value", "") for row in _rows(path)}
    try:
        return None, float(told["meters_per_asset_unit"])
    except (KeyError, ValueError) as error:
        raise FileFormatError(f"{path}: expected a number meters_per_asset_unit") from error


def _rows(path: Path) -> list[dict[str, str]]:
    with reading(path, "table") as source:
        rows = csv.DictReader(read_text(source).splitlines())
        return [{(key or "").strip(): str(value).strip() for key, value in row.items()} for row in rows]
