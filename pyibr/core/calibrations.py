"""Calibration files of other programs and devices: the cameras in a tree from `calibration_text`.

Each camera is a function that makes the arguments of `Camera`, under its name in the file. An unreadable camera does
not affect the others.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from os import PathLike
from pathlib import Path, PurePath
from typing import Any, cast

import numpy as np

from pyibr.core import conventions
from pyibr.core.calibration_text import read_tree
from pyibr.core.camera_json import camera_arguments, is_open3d, is_own
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
_DISTORTION = re.compile(
    r"(?:distortion_?(?:coefficients|coeffs?|coefs?|param(?:eter)?s)|dist_?(?:coefficients|coeffs?|coefs?|params)"
    rf"|distortion|dist|coeffs|kc|d)_?{_WHICH}",
    re.I,
)
_SIDES = "depth|rgb|colou?r|ir|left|right|"
_INTRINSIC = re.compile(rf"({_SIDES})_?intrinsics?", re.I)
_MODEL = re.compile(r"(?:camera|distortion|projection)_?(?:model|type)(?:_?(?:type|name))?|model_?type", re.I)
_NAME = re.compile(r"(?:lens_?)?(?:model|type)", re.I)  # of a lens's model, or of a product
_FISHEYE = re.compile(r"(?:is_?)?fisheye(?:_?model)?", re.I)
_LACKING = re.compile(r"f_?theta.*|lat_?long|equirect.*|ortho(?:graphic|photo)|omni.*|spherical|panorama.*", re.I)
_LENS_OR_POSE = re.compile(  # keys of other programs; numbers, or lists and objects with numbers
    r".*(?:distor|dist_?co|fisheye|prism|tangential|radial|skew|lens(?!_?pos)|mirror|vignett|poly_?par|affine_?par"
    r"|extrinsic|rotation|translation|quaternion|orientation|(?<![rm])pose|transform|_from_|2world|2cam|w2c|c2w"
    r"|to_?(?:world|cam|depth|colou?r|rgb|body|imu)).*|[krt]vecs?|qvec|rot|trans?|rt|[rt]_\w+|[rtd]|kc|coef\w*|param(?:eter)?s"
    r"|(?:camera_?)?(?:position|location|origin|cent(?:er|re)_of_projection)|[kpsb]_?\d+|tau_?[xy12]?|xi|alpha|beta",
    re.I,
)
_ASIDE = re.compile(  # of another sensor, another image, or the whole scene
    r"imu.*|housing.*|.*rectif.*|applied_transform|orientation_override|extrinsic_parameters|[rt]vecs|inertial.*", re.I
)
_TEXTS = (".yaml", ".yml", ".xml", ".ini", ".txt", ".csv")  # these suffixes hold only calibrations
_LISTED = 12  # largest number of names in a message
_ODD_FORMS = (TypeError, ValueError, LookupError, AttributeError, ArithmeticError, RecursionError)  # damaged files
_MILLIMETRES, _CENTIMETRES = 1000, 100  # per metre
_COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "taux", "tauy")
_OF_FISHEYE = ("k1", "k2", "k3", "k4")
_OF_CAMODOCAL = {"fx": "mu", "fy": "mv", "cx": "u0", "cy": "v0", "k1": "k2", "k2": "k3", "k3": "k4", "k4": "k5"}
_ROTATIONS, _SHIFTS = ("rot", "rotation", "rotationMatrix", "R"), ("trans", "tran", "transform", "translation", "T")
_OAK_TYPES = ("perspective", "fisheye", "equirectangular", "radial_division")


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
    found = _as_told(tree, path, size, unread := list[str]())
    warn_of_unread(path, unread)
    return {name: partial(_arranged, make) for name, make in found.items()}


def warn_of_unread(path: str | PathLike[str], keys: Iterable[str]) -> None:
    """Warn of the keys that `unread_in` yields."""
    if names := listed(dict.fromkeys(keys)):
        warnings.warn(f"{path}: not read, though it may be a lens or a pose: {names}", stacklevel=3)


def points_up(path: str | PathLike[str]) -> bool:
    """Tell whether y points up in the frame of a file's cameras; separate pose files share that frame."""
    with suppress(FileFormatError, ArgumentError, *_ODD_FORMS):
        file, _, tree = read_calibration(path)
        return any(_is_upward(make()["K"]) for make in _as_told(tree, file, (1, 1), []).values())
    return False


def _is_upward(K: object) -> bool:
    return bool(numbers("K", K, (3, 3))[1, 1] < 0)


def _as_told(tree: object, path: str | PathLike[str], size: Size, unread: list[str]) -> Cameras:
    """The cameras of a tree as stored, possibly with y up; the names of unread keys are added to `unread`."""
    if is_matrix(tree):
        return {"": partial(_of_rows, cast("list[list[float]]", tree), size)}
    found = _below(tree, path, size, unread, {})
    if not found and isinstance(tree, dict):
        _lens_kind(cast("dict[str, Any]", tree))
        if extrinsics_in(cast("object", tree)) is not None:
            raise FileFormatError(f"{path}: expected K, got a transform between two cameras; see --extrinsics")
    if not found and PurePath(path).suffix.lower() in _TEXTS:
        raise FileFormatError(f"{path}: no camera in it: expected K, or a calibration of a known program or device")
    return found or {"": partial(camera_arguments, tree, path)}


def _below(tree: object, path: str | PathLike[str], size: Size, unread: list[str], above: _Tree) -> Cameras:
    """The cameras in a part of a file. above: entries around it that name the model of the lens."""
    children: Iterable[tuple[object, object]] = ()
    if isinstance(tree, list):
        children = enumerate(cast("list[object]", tree))
    elif isinstance(tree, dict):
        known = cast("dict[str, Any]", tree)
        if is_own(known) and not above:
            unread += unread_in(known, "intrinsic_matrix|intrinsic|extrinsic") if is_open3d(known) else ()
            return {"": partial(camera_arguments, known, path)}
        for find, keys in _KINDS:
            if found := find({**above, **known}, size):
                unread += unread_in(known, keys)
                return found
        size = _size_in(known) or size
        above = {**above, **{key: value for key, value in known.items() if re.fullmatch(_NAMES, key, re.I)}}
        children = known.items()
    below = {
        key: (value, {} if is_matrix(value) else _below(value, path, size, unread, above)) for key, value in children
    }
    found = {
        f"{key}.{name}" if name else str(key): make for key, (_, one) in below.items() for name, make in one.items()
    }
    if found and isinstance(tree, dict):
        unread += unread_in({str(key): value for key, (value, one) in below.items() if not one}, f"(?i:{_NAMES})")
    return found


def unread_in(tree: object, keys: str) -> Iterator[str]:
    """Yield the keys beside a camera that look like a lens or a pose and say something, unless they match `keys`."""
    if isinstance(tree, list):
        for value in cast("list[object]", tree):
            yield from unread_in(value, keys) if not isinstance(value, float) else ()
    for key, value in cast("dict[str, object]", tree).items() if isinstance(tree, dict) else ():
        if re.fullmatch(keys, key):
            yield from unread_in(value, keys)
        elif not _ASIDE.fullmatch(key):
            is_name, kind = _MODEL.fullmatch(key) or _NAME.fullmatch(key), conventions.find_lens_kind(value)
            is_told = kind in ("opencv", "none") or (kind and _NAME.fullmatch(key)) or key == "type"
            if is_name and value and isinstance(value, str) and not is_told:
                yield f"{key} {value}"
            elif (_LENS_OR_POSE.fullmatch(key) or _LACKING.fullmatch(key)) and not _says_nothing(value):
                yield key
            else:
                yield from unread_in(value, keys)


def _says_nothing(value: object) -> bool:
    """Tell whether the value is a word, empty, zero, or an identity."""
    if isinstance(value, dict):
        known = cast("dict[str, object]", value)
        value = known.get("data", list(known.values()))
    if not isinstance(value, list):
        return not isinstance(value, (int, float)) or not value
    with suppress(ValueError, TypeError):
        flat = np.asarray(value, np.float64).ravel()
        return not flat.any() or any(np.array_equal(flat, np.eye(k).ravel()) for k in (3, 4))
    return all(map(_says_nothing, cast("list[object]", value)))


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
    if lens is not None and lens.model != "kannala_brandt":  # of p1, a prism and a tilt, terms of y are even in y
        values = np.array(lens.coefficients)
        values[[place for place in (2, 10, 11, 12) if place < len(values)]] *= -1  # p1, s3, s4 and tx
        lens = Lens(lens.model, values, radius=lens.radius)
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


def _realsense(tree: _Tree, _: Size) -> Cameras | None:
    return {"": partial(conventions.camera_from_realsense, tree)} if "ppx" in tree else None


def _kalibr(tree: _Tree, _: Size) -> Cameras | None:
    is_one = "camera_model" in tree and isinstance(tree.get("intrinsics"), list)
    return {"": partial(conventions.camera_from_kalibr, tree)} if is_one else None


def _ros(tree: _Tree, _: Size) -> Cameras | None:
    is_one = "distortion_model" in tree and {"k", "K", "camera_matrix"} & tree.keys() and _size_in(tree) is not None
    return {"": partial(conventions.camera_from_ros, tree)} if is_one else None


def _azure_kinect(tree: _Tree, _: Size) -> Cameras | None:
    if "CalibrationInformation" not in tree:
        return None
    there = [entry.get("Location") for entry in tree["CalibrationInformation"].get("Cameras", ())]
    modes = [mode for mode in conventions.KINECT_MODES if conventions.kinect_location(mode) in there]
    return {mode: partial(conventions.camera_from_azure_kinect, tree, mode) for mode in modes}


def _opencv(tree: _Tree, size: Size) -> Cameras | None:
    """Matrices of OpenCV's FileStorage, or plain numbers; several cameras have a number or side in their names."""
    own = _size_in(tree) or size
    matrices: dict[str, Any] = {}
    for key, value in tree.items():
        which = _MATRIX.fullmatch(key)
        if which is not None and _is_square(data := _data_of(value)):
            matrices[which[1]] = data
    bent = _distortions(tree)
    strays = [key for key, which in bent.items() if which not in map(str.lower, matrices)]
    own_of = {which: [key for key in bent if bent[key] == which.lower()] for which in matrices}
    return {which: partial(_with_lens, data, tree, own_of[which], own, strays) for which, data in matrices.items()}


def _distortions(tree: _Tree) -> dict[str, str]:
    """Keys of lists or objects of coefficients, and the number or side in each."""
    found = {key: which[1].lower() for key in tree if (which := _DISTORTION.fullmatch(key))}
    return {key: which for key, which in found.items() if isinstance(tree[key], (list, dict)) and tree[key]}


def _is_square(data: object) -> bool:
    """Tell whether the data is a 3 x 3 or 4 x 4 matrix, as rows or as one list."""
    rows = data if is_matrix(data) else [data]
    return is_matrix(rows) and sum(map(len, cast("list[list[float]]", rows))) in (9, 16)


def _data_of(matrix: object) -> Any:
    """The numbers of OpenCV's matrix, or of a plain one."""
    return cast("dict[str, Any]", matrix).get("data") if isinstance(matrix, dict) else matrix


def _with_lens(K: object, tree: _Tree, keys: Sequence[str], size: Size, strays: Sequence[str] = ()) -> Arguments:
    """A camera with the lens whose coefficients stand at a key, or beside K by name. strays: keys of no camera."""
    if len(keys) > 1 or strays:
        raise ArgumentError("distortion", "one for each K, with a name like K's", listed([*keys, *strays]))
    return _arguments(K, size, _lens_in(tree, tree[keys[0]] if keys else None))


def _plain(tree: _Tree, size: Size) -> Cameras | None:
    """Camera from fx, fy, cx and cy, with OpenCV's coefficients by name or in a list."""
    return {"": partial(_of_numbers, tree, size)} if {"fx", "cx"} <= tree.keys() else None


def _of_numbers(tree: _Tree, size: Size, bent: Sequence[str] = (), strays: Sequence[str] = ()) -> Arguments:
    _lens_kind(tree)  # a lens that pyibr lacks may have other numbers, too
    intrinsics = numbers("fx, fy, cx, cy", [tree.get(key) for key in ("fx", "fy", "cx", "cy")], (4,))
    return _with_lens(intrinsics, tree, list({*bent, *_distortions(tree)}), _size_in(tree) or size, strays)


def _camodocal(tree: _Tree, size: Size) -> Cameras | None:
    """Camera of camodocal and the VINS programs; a fisheye's coefficients of theta^3 to theta^9 are named k2 to k5."""
    inside = tree.get("projection_parameters")
    if not isinstance(inside, dict):
        return None
    own = cast("dict[str, Any]", inside)
    fisheye = {ours: own[theirs] for ours, theirs in _OF_CAMODOCAL.items() if theirs in own} if "mu" in own else own
    return {"": partial(_of_numbers, {**tree, **fisheye}, size)}


def _of_rows(rows: list[list[float]], size: Size) -> Arguments:
    """K as rows, maybe with a row of distortion; or a row: fx fy cx cy [distortion], or ARKit's w h fx fy cx cy."""
    values = [number for row in rows for number in row]
    count = 9 if [len(row) for row in rows[:3]] == [3, 3, 3] and len(rows) == 4 else len(values)
    if len(rows) == 1 and len(values) > 4 and values[1] > values[0] / 2:  # fy, where K has the skew
        width, height, *others = values
        if len(values) == 6 and abs(values[4] / width - 0.5) < 0.25 and abs(values[5] / height - 0.5) < 0.25:
            return _arguments(others, checked_size((int(width), int(height))))
        count = 4
    return _arguments(values[:count], size, conventions.lens_of_kind("opencv", values[count:]))


def _mapping(value: Any) -> _Tree:
    """The value if it is a mapping, else an empty one."""
    return cast(_Tree, value) if isinstance(value, dict) else {}


def _lens_in(tree: _Tree, coefficients: Any = None) -> Lens | None:
    """The lens beside K, by its model's name, from these coefficients or from the mapping's keys."""
    inside = _mapping(coefficients)
    kind, own = _lens_kind({**tree, **inside}), _by_name(tree)
    if coefficients is not None and any(own.values()):
        raise ArgumentError("distortion", "coefficients in a list or by name", "both")
    values: Any = inside.get("coeffs", inside.get("data")) if inside else coefficients
    if values is not None:
        return conventions.lens_of_kind(kind, values)
    own = own if coefficients is None else _by_name(inside)
    order = _OF_FISHEYE if kind == "kannala_brandt" else _COEFFICIENTS[: 14 if kind == "opencv" else 5]
    if beyond := [name for name in own if name not in order and own[name]]:
        raise ArgumentError("distortion", f"a lens of {', '.join(order)}", ", ".join(beyond))
    return conventions.lens_of_kind(kind, [own.get(name, 0.0) for name in order])


def _by_name(tree: _Tree) -> dict[str, float]:
    """Coefficients of a lens by their names in OpenCV's formulas."""
    named = {key.lower().replace("_", ""): value for key, value in tree.items() if isinstance(value, (int, float))}
    return {name: float(value) for name, value in named.items() if re.fullmatch(r"[kps]\d+|tau[xy]", name)}


def _lens_kind(tree: _Tree) -> str:
    """The kind of lens that a mapping names, OpenCV's if it names none; ArgumentError for a lens that pyibr lacks."""
    kinds = list[str]()
    for key, value in tree.items():
        if not isinstance(value, (str, int, float)) or not value:
            continue
        if (
            _MODEL.fullmatch(key)
            or key.lower() == "distortion"
            or (_NAME.fullmatch(key) and conventions.find_lens_kind(value))
        ):
            kinds.append(conventions.lens_kind(key, value))
        elif _FISHEYE.fullmatch(key):
            kinds.append("kannala_brandt")
        elif _LACKING.fullmatch(key):
            conventions.lens_kind("lens", key)
    return next((kind for kind in kinds if kind != "opencv"), "opencv")


def _orbbec(tree: _Tree, size: Size) -> Cameras | None:
    """Camera parameters of Orbbec's SDK, from its viewer (INI) or as its structs (JSON); objects with such names."""
    words = {key: which[1] for key in tree if (which := _INTRINSIC.fullmatch(key)) and isinstance(tree[key], dict)}
    words = {key: word for key, word in words.items() if "fx" in tree[key] and "ppx" not in tree[key]}
    found: Cameras = {}
    for key, word in words.items():
        bent = [name for name in tree if re.fullmatch(rf"{word}_?(?:{_DISTORTION.pattern})", name, re.I)]
        strays = [name for name in _distortions(tree) if name not in bent]
        around = {name: value for name, value in tree.items() if not isinstance(value, (dict, list))}
        moved = None if word.lower() == "depth" else tree.get("D2CTransformParam", tree.get("transform"))
        known = {**around, **tree[key], **{name: tree[name] for name in bent}}
        found[key.removesuffix("Intrinsic")] = partial(_of_orbbec, known, bent, size, moved, strays)
    return found


def _of_orbbec(tree: dict[str, Any], bent: list[str], size: Size, moved: object, strays: list[str]) -> Arguments:
    """A camera, posed by the transform from the depth camera's frame to its own."""
    models = [tree[key].get("model") for key in bent if isinstance(tree[key], dict)]
    for model in models if models and isinstance(models[0], int) else ():
        tree = {**tree, "distortion_model": conventions.ORBBEC_MODELS[model]}
    made, pose = _of_numbers(tree, size, bent, strays), extrinsics_in(moved)
    if moved is not None and pose is None:
        raise ArgumentError("transform", "rot and trans, as of Orbbec's SDK", type(moved).__name__)
    return made if pose is None else {**made, "world_from_camera": np.linalg.inv(pose)}


def extrinsics_in(tree: object) -> Float64 | None:
    """Return the (4, 4) transform from one camera to another in an object of Orbbec, RealSense or OpenCV, in metres.

    None if the tree is no such object. Orbbec's rotations are rows, its units millimetres; RealSense's rotations are
    nine numbers by columns.
    """
    entries = cast("dict[str, Any]", tree) if isinstance(tree, dict) else {}
    for name, count in (("rot", 9), ("trans", 3)):
        if f"{name}0" in entries:
            entries = {**entries, name: [entries[f"{name}{k}"] for k in range(count)]}
    turn, shift = (next((name for name in names if name in entries), None) for names in (_ROTATIONS, _SHIFTS))
    if turn is None or shift is None or "fx" in entries or any(map(_MATRIX.fullmatch, entries)):
        return None
    made, is_orbbec = np.eye(4), shift in ("trans", "transform")
    R = numbers(turn, np.ravel(_data_of(entries[turn])), (9,)).reshape(3, 3)
    is_by_columns = not is_orbbec and isinstance(entries[turn], list) and not is_matrix(entries[turn])
    made[:3, :3] = R.T if is_by_columns else R
    made[:3, 3] = numbers(shift, np.ravel(_data_of(entries[shift])), (3,)) / (_MILLIMETRES if is_orbbec else 1)
    return checked_pose(made, "extrinsics")


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
        values: Any = data["distortionCoeff"]
        kind = conventions.lens_kind("cameraType", _OAK_TYPES[int(data.get("cameraType", 0))])
        lens = conventions.lens_of_kind(kind, values[:4] if kind == "kannala_brandt" else values)
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
    size, kind = _size_in(tree) or size, _lens_kind(tree)
    if size is None:
        raise _NoSizeError("size", "the images' size", "none")
    focal = [tree.get("fl_x"), tree.get("fl_y", tree.get("fl_x"))]
    if focal[0] is None:
        seen = [(side, tree.get(f"camera_angle_{axis}")) for axis, side in zip("xy", size, strict=True)]
        pairs = (2 * ([pair for pair in seen if pair[1]] or seen))[:2]  # one angle: square pixels
        focal = [side / 2 / np.tan(numbers("camera_angle_x, camera_angle_y", angle, ()) / 2) for side, angle in pairs]
    fx, fy = numbers("fl_x, fl_y", focal, (2,))
    center = [float(tree.get(key, side / 2)) - 0.5 for key, side in (("cx", size[0]), ("cy", size[1]))]
    pose = numbers("transform_matrix", tree["transform_matrix"], (None, 4))
    pose = np.vstack([pose[:3], (0, 0, 0, 1)]) @ conventions.CV_FROM_GL
    K = np.array([[fx, 0, center[0]], [0, fy, center[1]], [0, 0, 1]])
    is_rational = tree.get("camera_model") == "FULL_OPENCV" or tree.get("k5") or tree.get("k6")
    if tree.get("k4") and kind == "opencv" and not is_rational:
        raise ArgumentError("k4", "0, as no lens of pyibr has nerfstudio's k4 of r^8", str(tree["k4"]))
    return {"K": K, "size": size, "lens": _lens_in(tree), "world_from_camera": pose}


_NAMES = f"{_MODEL.pattern}|{_FISHEYE.pattern}|{_LACKING.pattern}"
_PLAIN_KEYS = rf"(?i:{_DISTORTION.pattern}|{_NAMES}|[kps]_?\d+|tau_?[xy])"
_AZURE_KEYS = "CalibrationInformation|Cameras|Location|Intrinsics|Model.*|Rt|Rotation|Translation"
_OAK_KEYS = "cameraData|cameraType|distortionCoeff|extrinsics|rotationMatrix|.*CameraSocket|translation|specTranslation"
_ORBBEC_KEYS = (
    rf"(?i:(?:{_SIDES})_?(?:intrinsics?|{_DISTORTION.pattern}))|D2CTransformParam|transform|rot\d?|trans\d?|model"
)
_KALIBR_KEYS = "camera_model|distortion_model|distortion_coeffs|distortion_coefficients"
_KINDS: tuple[tuple[Callable[[_Tree, Size], Cameras | None], str], ...] = (
    (_azure_kinect, _AZURE_KEYS),
    (_oak, _OAK_KEYS),
    (_frames, rf"frames|transform_matrix|rotation|(?i:{_NAMES})|[kps]\d+"),  # Blender's turntables have a rotation
    (_camodocal, f"projection_parameters|{_PLAIN_KEYS}"),
    (_orbbec, f"{_ORBBEC_KEYS}|{_PLAIN_KEYS}"),
    (_realsense, "model|coeffs"),
    (_kalibr, _KALIBR_KEYS),
    (_ros, "distortion_model|[kKdDrRpP]|distortion_coefficients"),
    (_opencv, rf"{_PLAIN_KEYS}|(?i:{_MATRIX.pattern}|[rp]\d)"),
    (_plain, _PLAIN_KEYS),
)
"""In the order in which they are tried, with the keys that each reads, or that belong to other images."""
