"""Calibration files of other programs and devices: the cameras in a tree from `calibration_text`.

Each camera is a function that makes the arguments of `Camera`, under its name in the file. An unreadable camera does
not affect the others.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from os import PathLike
from pathlib import Path, PurePath
from typing import Any, cast

import numpy as np

from pyibr.core import conventions
from pyibr.core.calibration_text import read_tree
from pyibr.core.camera_json import camera_arguments, is_own
from pyibr.core.checks import Float64, checked_pose, checked_size, numbers
from pyibr.core.conventions import Arguments
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import checked_path
from pyibr.core.lens import Lens

Size = tuple[int, int] | None
Cameras = dict[str, Callable[[], Arguments]]
_Tree = Mapping[str, Any]

_SIZES = (("width", "height"), ("image_width", "image_height"), ("w", "h"), ("cols", "rows"))
_PAIRS = ("image_size", "imageSize", "size", "resolution", "img_size")
# OpenCV's users choose the names of K and the distortion, with a number or side for several cameras
_WHICH = r"(\d|left|right|l|r|)"
_MATRIX = re.compile(rf"(?:camera_?matrix|camera matrix|intrinsic_?matrix|intrinsics?|mtx|cam|k|m)_?{_WHICH}", re.I)
_DISTORTION = r"(?:distortion_?coefficients|distortion_?coeffs?|dist_?coeffs?|distortion|dist|d)_?{}"
_FISHEYES = ("equidistant", "fisheye", "kannala_brandt")
_TEXTS = (".yaml", ".yml", ".xml", ".ini", ".txt", ".csv")  # these suffixes hold only calibrations
_LISTED = 12  # largest number of names in a message
_ODD_FORMS = (TypeError, ValueError, LookupError, AttributeError, ArithmeticError, RecursionError)  # damaged files
_MILLIMETRES, _CENTIMETRES = 1000, 100  # per metre
_OPENCV_ORDER = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")


class _NoSizeError(ArgumentError):
    """The file lacks the images' size, and the caller gave none."""


def file_and_name(path: str | PathLike[str]) -> tuple[Path, str | None]:
    """Return the file, and the camera's name in `FILE#NAME`, or None."""
    file = checked_path(path)
    if "#" not in str(path) or file.exists():
        return file, None
    whole, _, name = str(path).rpartition("#")
    return Path(whole), name


def read_calibration(path: str | PathLike[str]) -> tuple[Path, str | None, object]:
    """Return the file, the requested camera's name or None, and the file's content."""
    file, name = file_and_name(path)
    return file, name, read_tree(file)


@contextmanager
def making(path: str | PathLike[str]) -> Generator[None, None, None]:
    """Turn errors about the numbers in a file into FileFormatError."""
    try:
        yield
    except _NoSizeError as error:
        raise ArgumentError("size", f"the (width, height) of the images whose K is in {path}", "none") from error
    except ArgumentError as error:
        raise FileFormatError(f"{path}: {error}") from error
    except _ODD_FORMS as error:
        raise FileFormatError(f"{path}: not a camera of a known form: {type(error).__name__} {error}"[:300]) from error


def cameras_in(tree: object, path: str | PathLike[str], size: Size = None) -> Cameras:
    """Return the cameras in a tree by name; a single unnamed camera is "".

    path: for messages. size: (width, height) of the pictures, for files that lack it.
    """
    return {name: partial(_arranged, make) for name, make in _as_told(tree, path, size).items()}


def points_up(path: str | PathLike[str]) -> bool:
    """Tell whether y points up in the frame of a file's cameras; separate pose files share that frame."""
    with suppress(FileFormatError, ArgumentError, *_ODD_FORMS):
        file, _, tree = read_calibration(path)
        return any(_is_upward(make()["K"]) for make in _as_told(tree, file, (1, 1)).values())
    return False


def _is_upward(K: object) -> bool:
    return bool(numbers("K", K, (3, 3))[1, 1] < 0)


def _as_told(tree: object, path: str | PathLike[str], size: Size) -> Cameras:
    """The cameras of a tree as stored, possibly with y up."""
    if is_matrix(tree):
        return {"": partial(_arguments, tree, size)}
    found = _below(tree, path, size)
    if not found and PurePath(path).suffix.lower() in _TEXTS:
        raise FileFormatError(f"{path}: no camera in it: expected K, or a calibration of a known program or device")
    return found or {"": partial(camera_arguments, tree, path)}


def _below(tree: object, path: str | PathLike[str], size: Size) -> Cameras:
    children: Iterable[tuple[object, object]] = ()
    if isinstance(tree, list):
        children = enumerate(cast("list[object]", tree))
    elif isinstance(tree, dict):
        known = cast("dict[str, Any]", tree)
        if is_own(known):
            return {"": partial(camera_arguments, known, path)}
        for kind in _KINDS:
            if found := kind(known, size):
                return found
        size = _size_in(known) or size
        children = known.items()
    below = ((key, _below(value, path, size)) for key, value in children if not is_matrix(value))
    return {f"{key}.{name}" if name else str(key): make for key, found in below for name, make in found.items()}


def is_matrix(tree: object) -> bool:
    """Tell whether the tree is a list of rows of numbers."""
    rows = cast("list[object]", tree) if isinstance(tree, list) else []
    return bool(rows) and all(isinstance(row, list) and _are_numbers(cast("list[object]", row)) for row in rows)


def _are_numbers(values: list[object]) -> bool:
    return all(isinstance(value, (int, float)) for value in values)


def chosen(found: Cameras, name: str | None, path: str | PathLike[str], size: Size = None) -> Cameras:
    """Return the camera named `name`; without a name, cameras of this `size`, or all if there are none."""
    if name is not None:
        named = [own for own in found if name.lower() in (own.lower(), PurePath(own).stem.lower())]
        if not named:
            raise FileFormatError(f"{path}: expected one of {listed(found)} behind #, got {name}")
        return {own: found[own] for own in named[:1]}
    if len(found) == 1 or size is None:
        return found
    fitting: Cameras = {}
    for own, make in found.items():
        with suppress(ArgumentError):  # another camera may be unusable
            if tuple(make()["size"]) == size:
                fitting[own] = make
    is_one = len({repr(make()) for make in fitting.values()}) == 1
    return dict([*fitting.items()][:1]) if is_one else fitting or found


def listed(names: Iterable[str]) -> str:
    """Join names for a message."""
    first = list(names)
    return ", ".join([*first[:_LISTED], *(["..."] if len(first) > _LISTED else [])])


def _arranged(make: Callable[[], Arguments]) -> Arguments:
    """Camera arguments with y down: if fy < 0, y points up in a left-handed world, so y and the world are mirrored."""
    made = make()
    if not _is_upward(made["K"]):
        return made
    warnings.warn("fy < 0: y is mirrored, and so are the world and the poses of recordings", stacklevel=2)
    pose, lens = made.get("world_from_camera"), made.get("lens")
    if lens is not None and lens.model != "kannala_brandt":  # p1 adds terms to y that are even in y
        k1, k2, p1, *others = lens.coefficients
        lens = Lens(lens.model, [k1, k2, -p1, *others], radius=lens.radius)
    turned = conventions.mirrored(np.eye(4) if pose is None else checked_pose(pose))
    return {**made, "K": np.asarray(made["K"]) @ np.diag([1, -1, 1]), "world_from_camera": turned, "lens": lens}


def _arguments(K: object, size: Size, lens: Lens | None = None, pose: Float64 | None = None) -> Arguments:
    """Arguments of a camera whose K is 3 x 3, 3 x 4 or 4 x 4, in pixels or in fractions of the picture's size."""
    if size is None:
        raise _NoSizeError("size", "the images' size", "none")
    values = numbers("K", np.ravel(np.asarray(K)), (None,))
    if len(values) == 4:
        fx, fy, cx, cy = values
        values = np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1])
    if len(values) not in (9, 12, 16):
        raise ArgumentError("K", "3 x 3, 3 x 4 or 4 x 4 numbers, or fx fy cx cy", f"{len(values)}")
    matrix = values.reshape(4 if len(values) == 16 else 3, -1)[:3, :3]
    if _is_normalized(matrix, size):
        matrix = conventions.intrinsics_from_normalized(matrix, size)
    return {"K": matrix, "size": size, "world_from_camera": pose, "lens": lens}


def _is_normalized(K: Float64, size: tuple[int, int]) -> bool:
    """Tell whether K is in fractions of the picture's size: no real centre lies within the first pixel."""
    return bool((np.abs(K[:2, 2] - 0.5) < 0.5).all() and min(size) > 2 and max(K[0, 0], K[1, 1]) < min(size))


def _size_in(tree: _Tree) -> Size:
    """The pictures' size in a mapping, or in the entry that ROS's INI files name "image"."""
    named = {str(key).lower(): value for key, value in tree.items()}
    for across, down in _SIZES:
        if across in named and down in named and not isinstance(named[across], (dict, str)):
            return checked_size(tuple(int(np.ravel(named[side])[0]) for side in (across, down)))
    for name in _PAIRS:
        if isinstance(tree.get(name), list) and len(tree[name]) == 2:
            return checked_size(tuple(int(side) for side in tree[name]))
    return _size_in(tree["image"]) if isinstance(tree.get("image"), dict) else None


def _lone(tree: _Tree, _: Size) -> Cameras | None:
    """RealSense's, Kalibr's or ROS's camera."""
    if "ppx" in tree:
        convert = conventions.camera_from_realsense
    elif "camera_model" in tree and isinstance(tree.get("intrinsics"), list):
        convert = conventions.camera_from_kalibr
    elif "distortion_model" in tree and {"k", "K", "camera_matrix"} & tree.keys() and _size_in(tree) is not None:
        convert = conventions.camera_from_ros
    else:
        return None
    return {"": partial(convert, tree)}


def _azure_kinect(tree: _Tree, _: Size) -> Cameras | None:
    if "CalibrationInformation" not in tree:
        return None
    there = [entry.get("Location") for entry in tree["CalibrationInformation"].get("Cameras", ())]
    modes = [mode for mode in conventions.KINECT_MODES if conventions.kinect_location(mode) in there]
    return {mode: partial(conventions.camera_from_azure_kinect, tree, mode) for mode in modes}


def _opencv(tree: _Tree, size: Size) -> Cameras | None:
    """Matrices of OpenCV's FileStorage, or plain numbers; several cameras have a number or side in their names."""
    own = _size_in(tree) or size
    found: Cameras = {}
    for key, value in tree.items():
        which = _MATRIX.fullmatch(key)
        data = _data_of(value)
        if which is None or not _is_square(data):
            continue
        named = re.compile(_DISTORTION.format(which[1]), re.I)
        bent = next((tree[name] for name in tree if named.fullmatch(name)), None)
        found[which[1]] = partial(_of_opencv, data, bent, _is_fisheye(tree), own)
    return found


def _is_square(data: object) -> bool:
    """Tell whether the data is a 3 x 3 or 4 x 4 matrix, as rows or as one list."""
    rows = data if is_matrix(data) else [data]
    return is_matrix(rows) and sum(map(len, cast("list[list[float]]", rows))) in (9, 16)


def _is_fisheye(tree: _Tree) -> bool:
    model = str(tree.get("distortion_model", tree.get("camera_model", ""))).lower()
    return bool(tree.get("fisheye_model") or tree.get("fisheye")) or any(name in model for name in _FISHEYES)


def _data_of(matrix: object) -> Any:
    """The numbers of OpenCV's matrix, or of a plain one."""
    return cast("dict[str, Any]", matrix).get("data") if isinstance(matrix, dict) else matrix


def _of_opencv(K: object, distortion: Any, fisheye: bool, size: Size) -> Arguments:
    values = _data_of(distortion)
    coefficients = np.ravel(np.asarray([] if values is None else values, np.float64))
    return _arguments(K, size, Lens.from_opencv(coefficients, fisheye=fisheye) if coefficients.size else None)


def _plain(tree: _Tree, size: Size) -> Cameras | None:
    """Camera from fx, fy, cx and cy, with OpenCV's coefficients by name."""
    return {"": partial(_of_numbers, tree, _size_in(tree) or size)} if {"fx", "cx"} <= tree.keys() else None


def _of_numbers(tree: _Tree, size: Size, distortion: _Tree | None = None, pose: Float64 | None = None) -> Arguments:
    intrinsics = numbers("fx, fy, cx, cy", [tree.get(key) for key in ("fx", "fy", "cx", "cy")], (4,))
    return _arguments(intrinsics, size, _lens_of(distortion or tree), pose)


def _lens_of(tree: _Tree, fisheye: bool = False) -> Lens:
    names = ("k1", "k2", "k3", "k4") if fisheye else _OPENCV_ORDER
    return Lens.from_opencv([float(tree.get(name) or 0) for name in names], fisheye=fisheye)


def _orbbec(tree: _Tree, _: Size) -> Cameras | None:
    """Camera parameters of the SDK, from its viewer (INI) or as its structs (JSON); millimetres."""
    words = [key[: -len("Intrinsic")] for key, value in tree.items() if key.endswith("Intrinsic") and "fx" in value]
    moved = tree.get("D2CTransformParam", tree.get("transform"))

    def made(word: str) -> Arguments:
        inside = tree[f"{word}Intrinsic"]
        pose = None if moved is None or word.lower().startswith("depth") else _moved_by_orbbec(moved)
        return _of_numbers(inside, _size_in(inside), tree.get(f"{word}Distortion") or {"k1": 0}, pose)

    return {word: partial(made, word) for word in words}


def _moved_by_orbbec(entries: _Tree) -> Float64:
    """Pose of the colour camera in the depth camera's frame."""
    rotation, translation = (
        entries[name] if name in entries else [entries[f"{name}{k}"] for k in range(count)]
        for name, count in (("rot", 9), ("trans", 3))
    )
    R = numbers("rot", np.ravel(rotation), (9,)).reshape(3, 3)
    return conventions.pose_from_extrinsics(R, numbers("trans", np.ravel(translation), (3,)) / _MILLIMETRES)


def _oak(tree: _Tree, _: Size) -> Cameras | None:
    """DepthAI's calibration: sockets with transforms from camera to camera, in centimetres."""
    if "cameraData" not in tree:
        return None
    sockets: dict[int, _Tree] = {int(socket): data for socket, data in tree["cameraData"]}

    def pose(socket: int, known: Sequence[int]) -> Float64:
        outside = sockets[socket]["extrinsics"]
        to = int(outside["toCameraSocket"])
        if to not in sockets or to in known:
            return np.eye(4)
        step, shift = np.eye(4), outside["translation"]
        step[:3, :3] = numbers("rotationMatrix", outside["rotationMatrix"], (3, 3))
        step[:3, 3] = np.array([shift["x"], shift["y"], shift["z"]], np.float64) / _CENTIMETRES
        return pose(to, (*known, socket)) @ checked_pose(step, "extrinsics")

    def made(socket: int) -> Arguments:
        data = sockets[socket]
        values, fisheye = data["distortionCoeff"], data.get("cameraType") == 1
        lens = Lens.from_opencv(values[:4] if fisheye else values, fisheye=fisheye) if values else None
        return _arguments(data["intrinsicMatrix"], _size_in(data), lens, pose(socket, (socket,)))

    return {f"CAM_{chr(ord('A') + socket)}": partial(made, socket) for socket in sockets}


def _frames(tree: _Tree, size: Size) -> Cameras | None:
    """NeRF's transforms.json: OpenGL's axes, pixel centres at halves; common entries apply to all frames."""
    frames = tree.get("frames")
    if not isinstance(frames, list):
        return None
    found: Cameras = {}
    for k, frame in enumerate(cast("list[Any]", frames)):
        if isinstance(frame, dict) and "transform_matrix" in frame:
            path = str(cast("_Tree", frame).get("file_path", k))
            name = PurePath(path.replace("\\", "/")).name
            found[path if name in found else name] = partial(_of_frame, {**tree, **cast("dict[str, Any]", frame)}, size)
    return found


def _of_frame(tree: _Tree, size: Size) -> Arguments:
    size = _size_in(tree) or size
    if size is None:
        raise _NoSizeError("size", "the images' size", "none")
    focal = [tree.get("fl_x"), tree.get("fl_y", tree.get("fl_x"))]
    if focal[0] is None:
        angle = tree.get("camera_angle_x")
        across = size[0] / 2 / np.tan(numbers("camera_angle_x", angle, ()) / 2)
        focal = [across, across]
    fx, fy = numbers("fl_x, fl_y", focal, (2,))
    center = [float(tree.get(key, side / 2)) - 0.5 for key, side in (("cx", size[0]), ("cy", size[1]))]
    pose = numbers("transform_matrix", tree["transform_matrix"], (None, 4))
    pose = np.vstack([pose[:3], (0, 0, 0, 1)]) @ conventions.CV_FROM_GL
    K = np.array([[fx, 0, center[0]], [0, fy, center[1]], [0, 0, 1]])
    return {"K": K, "size": size, "lens": _lens_of(tree, _is_fisheye(tree)), "world_from_camera": pose}


_KINDS: tuple[Callable[[_Tree, Size], Cameras | None], ...] = (
    _azure_kinect,
    _oak,
    _orbbec,
    _frames,
    _lone,
    _opencv,
    _plain,
)
