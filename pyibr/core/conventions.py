"""Other libraries' camera conventions, as functions of plain arrays.

pyibr's own convention: x right, y down, z forward; pixel centres at integers; `world_from_camera` maps column
vectors. Each function here converts from one other convention to this one, or back.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from pyibr.core.checks import Float64, describe, numbers, positive
from pyibr.core.errors import ArgumentError
from pyibr.core.lens import Lens, LensModel

Arguments = dict[str, Any]
"""Arguments of `Camera`: K, size and lens, maybe world_from_camera."""

# Between y up, z backward (OpenGL, NeRF) and y down, z forward; its own inverse.
CV_FROM_GL = np.diag([1.0, -1.0, -1.0, 1.0])
# Between x left, y up (PyTorch3D) and x right, y down; its own inverse.
CV_FROM_PYTORCH3D = np.diag([-1.0, -1.0, 1.0])

COLMAP_MODELS: Mapping[str, tuple[int, int]] = {
    "SIMPLE_PINHOLE": (3, 0),
    "PINHOLE": (4, 0),
    "SIMPLE_RADIAL": (3, 1),
    "RADIAL": (3, 2),
    "OPENCV": (4, 4),
    "OPENCV_FISHEYE": (4, 4),
    "FULL_OPENCV": (4, 8),
    "FOV": (4, 1),
    "SIMPLE_RADIAL_FISHEYE": (3, 1),
    "RADIAL_FISHEYE": (3, 2),
    "THIN_PRISM_FISHEYE": (4, 8),
    "RAD_TAN_THIN_PRISM_FISHEYE": (4, 12),
}
"""Parameters before the distortion, and coefficients of it (k1 k2 p1 p2 k3 ...), in the order of COLMAP's numbers."""
_COLMAP_UNSUPPORTED = ("FOV", "THIN_PRISM_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE")

# Other programs' names of lens models, by pyibr's; "none": no lens; "opencv": the number of coefficients chooses one
_LENS_NAMES = {
    "none": "none no no_distortion rectified",
    "opencv": "pinhole perspective simple_pinhole opencv radtan radial_tangential plumb_bob brown brown_conrady "
    "rational rational_polynomial brown_conrady_k6 full_opencv simple_radial radial pinhole_full pinhole_radtan8",
    "kannala_brandt": "fisheye equidistant equi opencv_fisheye kannala_brandt kannala_brandt4 kb4 "
    "simple_radial_fisheye radial_fisheye",
    "modified_brown_conrady": "modified_brown_conrady",
    "inverse_brown_conrady": "inverse_brown_conrady",
}
_LENS_KINDS = {name: kind for kind, names in _LENS_NAMES.items() for name in names.split()}
_OF_ROS = "a distortion_model of plumb_bob, rational_polynomial, equidistant"
_OF_KALIBR = "a distortion_model of radtan, equidistant, none"
# RealSense's names, in the order of its numbers, and their lenses; None: not supported
_REALSENSE_MODELS: Mapping[str, LensModel | None] = {
    "none": "brown_conrady",  # its coefficients are zeros
    "modified_brown_conrady": "modified_brown_conrady",
    "inverse_brown_conrady": "inverse_brown_conrady",
    "ftheta": None,
    "brown_conrady": "brown_conrady",
    "kannala_brandt4": "kannala_brandt",
}
ORBBEC_MODELS = ("none", "modified_brown_conrady", "inverse_brown_conrady", "brown_conrady", "rational", "kb4")
"""Lens models of Orbbec's SDK, in the order of its numbers."""

# Azure Kinect, by mode: side of the square that the depth sensor forms, offset of the image in the square, image size
_KINECT_DEPTH: Mapping[str, tuple[int, tuple[int, int], tuple[int, int]]] = {
    "NFOV_UNBINNED": (1024, (192, 180), (640, 576)),
    "NFOV_2X2BINNED": (512, (96, 90), (320, 288)),
    "WFOV_UNBINNED": (1024, (0, 0), (1024, 1024)),
    "WFOV_2X2BINNED": (512, (0, 0), (512, 512)),
    "PASSIVE_IR": (1024, (0, 0), (1024, 1024)),
}
# The colour camera's images: as wide as the sensor, centred in its height
_KINECT_COLOR: Mapping[str, tuple[int, int]] = {
    "720P": (1280, 720),
    "1080P": (1920, 1080),
    "1440P": (2560, 1440),
    "1536P": (2048, 1536),
    "2160P": (3840, 2160),
    "3072P": (4096, 3072),
}
KINECT_MODES = (*_KINECT_DEPTH, *_KINECT_COLOR)
_KINECT_MODEL = "CALIBRATION_LensDistortionModelBrownConrady"  # OpenCV's rational model
_KINECT_RADIUS = 1.7  # the SDK's default for calibrations without a radius


def with_principal_point_moved(K: Float64, by: float) -> Float64:
    """Return `K` with `by` pixels added to its principal point."""
    moved = K.copy()
    moved[:2, 2] += by
    return moved


def intrinsics_from_normalized(K: Float64, size: tuple[int, int]) -> Float64:
    """Return K in pixels for a K in fractions of the picture's width and height, whose middle is (0.5, 0.5)."""
    return with_principal_point_moved(np.diag([*size, 1.0]) @ K, -0.5)


def mirrored(pose: Float64) -> Float64:
    """Convert a pose with y up to a pose with y down, in a mirrored world."""
    mirror = np.diag([1.0, -1.0, 1.0, 1.0])
    return mirror @ pose @ mirror


def pose_from_extrinsics(rotation: Float64, translation: Float64) -> Float64:
    """Invert x_camera = rotation x_world + translation into a (4, 4) `world_from_camera`."""
    pose = np.eye(4)
    pose[:3, :3] = rotation.T
    pose[:3, 3] = -rotation.T @ translation
    return pose


def intrinsics_from_colmap(model: str, params: object) -> tuple[Float64, Float64, bool]:
    """Return K (pixel centres at integers), OpenCV's coefficients, and whether the lens is a fisheye."""
    known = [name for name in COLMAP_MODELS if name not in _COLMAP_UNSUPPORTED]
    if model not in known:
        raise ArgumentError("model", f"one of {', '.join(known)}", describe(model))
    linear, distorted = COLMAP_MODELS[model]
    values = numbers(f"params of {model}", params, (linear + distorted,))
    fx, fy, cx, cy = values[[0, 0, 1, 2]] if linear == 3 else values[:4]
    distortion = np.zeros(8 if distorted == 8 else 4)
    distortion[:distorted] = values[linear:]
    return _matrix(fx, fy, cx - 0.5, cy - 0.5), distortion, model.endswith("FISHEYE")


def colmap_from_intrinsics(K: Float64, lens: Lens | None) -> tuple[str, Float64]:
    """Return COLMAP's model and its params."""
    linear = [K[0, 0], K[1, 1], K[0, 2] + 0.5, K[1, 2] + 0.5]
    if lens is None:
        return "PINHOLE", np.array(linear)
    values = lens.to_opencv()
    if lens.model == "kannala_brandt":
        return "OPENCV_FISHEYE", np.array([*linear, *values])
    if lens.model == "tilted":
        raise ArgumentError("lens", "a lens that COLMAP supports: no thin prism and no tilted sensor", str(lens))
    if not values[4:].any():
        return "OPENCV", np.array([*linear, *values[:4]])
    return "FULL_OPENCV", np.array([*linear, *values, *[0.0] * (8 - len(values))])


def find_lens_kind(name: object) -> str | None:
    """Return the kind in `_LENS_NAMES` of a lens model's name in another program; None if pyibr lacks it."""
    word = re.sub(r"[^a-z0-9]+", "_", str(name).lower()).strip("_")
    return _LENS_KINDS.get(re.sub("^(rs2_|ob_)?distortion_", "", word))


def lens_kind(argument: str, name: object, known: str = "a lens that pyibr has") -> str:
    """Return the kind as `find_lens_kind` does; ArgumentError if pyibr lacks it."""
    kind = find_lens_kind(name)
    if kind is None:
        raise ArgumentError(argument, known, repr(name))
    return kind


def lens_of_kind(kind: str, coefficients: object) -> Lens | None:
    """Make a lens of a kind from coefficients in its order; none means zeros. OpenCV's may number 1 or 2, too."""
    values = numbers("distortion", np.ravel(np.asarray(coefficients)), (None,))
    if kind == "none":
        return None
    if kind != "opencv":
        values = values if values.size else np.zeros(4)
        is_longer = kind == "kannala_brandt" and len(values) == 5 and values[4] == 0  # RealSense's
        return Lens(cast("LensModel", kind), values[:4] if is_longer else values)
    return Lens.from_opencv([*values, *[0.0] * (4 - len(values))] if len(values) < 3 else values)


def camera_from_ros(info: object) -> Arguments:
    """Return the camera of the raw image of a ROS `CameraInfo` (message or mapping), or of a calibration file."""
    for name in ("binning_x", "binning_y"):
        if int(_part(info, "info", name, default=0)) > 1:
            raise ArgumentError("info", "an image of full resolution", f"{name} = {_part(info, 'info', name)}")
    region = _part(info, "info", "roi", default={})
    if any(int(_part(region, "info", name, default=0)) for name in ("x_offset", "y_offset")):
        raise ArgumentError("info", "an image that is not cropped", "a region of interest")
    # drivers of rectified cameras leave the name empty; RealSense's recorder writes its own names
    kind = lens_kind("info", _part(info, "info", "distortion_model") or "plumb_bob", _OF_ROS)
    matrix = _part(info, "info", "k", "K", "camera_matrix")
    values = _part(info, "info", "d", "D", "distortion_coefficients", default=[])
    matrix, values = (_part(each, "info", "data", default=each) for each in (matrix, values))  # files wrap them
    K = numbers("info", np.ravel(np.asarray(matrix)), (9,)).reshape(3, 3)
    size = int(_part(info, "info", "width", "image_width")), int(_part(info, "info", "height", "image_height"))
    return {"K": K, "size": size, "lens": lens_of_kind(kind, values)}


def ros_from_camera(K: Float64, size: tuple[int, int], lens: Lens | None) -> dict[str, Any]:
    """Return the fields of a ROS `CameraInfo` for the raw image."""
    values = np.zeros(5) if lens is None else lens.to_opencv()
    model = {4: "equidistant", 5: "plumb_bob"}.get(len(values), "rational_polynomial")
    width, height = size
    return {"width": width, "height": height, "distortion_model": model, "d": values.tolist(), "k": K.ravel().tolist()}


def camera_from_realsense(intrinsics: object) -> Arguments:
    """Return the camera of `pyrealsense2.intrinsics`, or of a mapping of its attributes."""
    name = "intrinsics"
    fx, fy, cx, cy = (float(_part(intrinsics, name, each)) for each in ("fx", "fy", "ppx", "ppy"))
    given = _part(intrinsics, name, "model", default="none")
    if isinstance(given, int):
        known = tuple(_REALSENSE_MODELS)
        model = known[given] if 0 <= given < len(known) else str(given)
    else:  # "distortion.brown_conrady", "Brown Conrady", "RS2_DISTORTION_BROWN_CONRADY"
        model = str(given).lower().replace(" ", "_").removeprefix("distortion.").removeprefix("rs2_distortion_")
    ours = _REALSENSE_MODELS.get(model)
    if ours is None:
        known = ", ".join(each for each, lens in _REALSENSE_MODELS.items() if lens)
        raise ArgumentError(name, f"a model of {known}", str(given))
    values = np.zeros(5) if model == "none" else np.asarray(_part(intrinsics, name, "coeffs", default=[0.0] * 5))
    lens = Lens(ours, values[:4] if ours == "kannala_brandt" else values)
    size = int(_part(intrinsics, name, "width")), int(_part(intrinsics, name, "height"))
    return {"K": _matrix(fx, fy, cx, cy), "size": size, "lens": lens}


def realsense_from_camera(K: Float64, size: tuple[int, int], lens: Lens | None) -> dict[str, Any]:
    """Return the attributes of `pyrealsense2.intrinsics`."""
    model, values = "none", [0.0] * 5
    if lens is not None:
        names = {ours: name for name, ours in _REALSENSE_MODELS.items()}
        if lens.model not in names:
            raise ArgumentError("lens", f"a lens that RealSense supports: {', '.join(map(str, names))}", lens.model)
        model, values = names[lens.model], [*lens.coefficients, 0.0][:5]
    return {
        "width": size[0],
        "height": size[1],
        "fx": float(K[0, 0]),
        "fy": float(K[1, 1]),
        "ppx": float(K[0, 2]),
        "ppy": float(K[1, 2]),
        "model": model,
        "coeffs": values,
    }


def camera_from_kalibr(camera: object) -> Arguments:
    """Return one camera of Kalibr's `camchain.yaml`."""
    name = "camera"
    model = str(_part(camera, name, "camera_model"))
    if model != "pinhole":
        raise ArgumentError(name, "a camera_model of pinhole", repr(model))
    kind = lens_kind(name, _part(camera, name, "distortion_model"), _OF_KALIBR)
    fx, fy, cx, cy = numbers("intrinsics", _part(camera, name, "intrinsics"), (4,)).tolist()
    size = tuple(int(side) for side in _part(camera, name, "resolution"))
    values: Any = [] if kind == "none" else _part(camera, name, "distortion_coeffs", "distortion_coefficients")
    return {"K": _matrix(fx, fy, cx, cy), "size": size, "lens": lens_of_kind(kind, values)}


def kalibr_from_camera(K: Float64, size: tuple[int, int], lens: Lens | None) -> dict[str, Any]:
    """Return the entries of a camera in Kalibr's `camchain.yaml`."""
    values = np.zeros(5) if lens is None else lens.to_opencv()
    fisheye = len(values) == 4
    if values[4:].any():
        raise ArgumentError("lens", "a lens that Kalibr supports: k1 k2 p1 p2, or a fisheye", str(lens))
    return {
        "camera_model": "pinhole",
        "intrinsics": [float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])],
        "distortion_model": "equidistant" if fisheye else "radtan",
        "distortion_coeffs": values[:4].tolist(),
        "resolution": list(size),
    }


def kinect_location(mode: str) -> str:
    """Return the name of a mode's camera in an Azure Kinect's calibration."""
    return f"CALIBRATION_CameraLocation{'D0' if mode in _KINECT_DEPTH else 'PV0'}"


def camera_from_azure_kinect(calibration: object, mode: object) -> Arguments:
    """Return one camera of an Azure Kinect, with its pose in the depth camera's frame, in metres."""
    name = "calibration"
    word = str(mode).upper()  # "720P", "K4A_COLOR_RESOLUTION_720P", "MJPG_720P"
    known = next((each for each in KINECT_MODES if f"_{word}".endswith(f"_{each}")), None)
    if known is None:
        raise ArgumentError("mode", f"one of {', '.join(KINECT_MODES)}", repr(mode))
    location = kinect_location(known)
    entries = _part(_part(calibration, name, "CalibrationInformation"), name, "Cameras")
    if not isinstance(entries, list):
        raise ArgumentError(name, "a list of Cameras", describe(entries))
    found = [each for each in cast("list[object]", entries) if _part(each, name, "Location") == location]
    if not found:
        raise ArgumentError(name, f"a camera with the Location {location}", "none")
    inside, motion = (_part(found[0], name, each) for each in ("Intrinsics", "Rt"))
    values = numbers(name, _part(inside, name, "ModelParameters"), (14,))
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, *aside, p2, p1 = values.tolist()
    if (model := _part(inside, name, "ModelType")) != _KINECT_MODEL or any(aside):
        raise ArgumentError(name, f"a ModelType of {_KINECT_MODEL} about the principal point", f"{model} {aside}")
    sensor = [positive(name, _part(found[0], name, side)) for side in ("SensorWidth", "SensorHeight")]
    if known in _KINECT_DEPTH:
        across, (left, top), size = _KINECT_DEPTH[known]
        down = float(across)
    else:
        size = _KINECT_COLOR[known]
        across, left = size[0], 0
        down = across * sensor[1] / sensor[0]  # early calibrations are for 16:9 instead of 4:3
        top = (down - size[1]) / 2
    # Fractions of the whole image's size, from its corner, which is half a pixel before the first pixel's centre
    K = _matrix(fx * across, fy * down, cx * across - left - 0.5, cy * down - top - 0.5)
    (radius,) = numbers(name, [_part(found[0], name, "MetricRadius")], (1,)).tolist()
    rotation = numbers(name, np.ravel(_part(motion, name, "Rotation")), (9,)).reshape(3, 3)
    pose = pose_from_extrinsics(rotation, numbers(name, _part(motion, name, "Translation"), (3,)))
    lens = Lens("rational", [k1, k2, p1, p2, k3, k4, k5, k6], radius=radius or _KINECT_RADIUS)
    return {"K": K, "size": size, "lens": lens, "world_from_camera": pose}


def _matrix(fx: float, fy: float, cx: float, cy: float) -> Float64:
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def _part(thing: object, argument: str, *names: str, default: Any = None) -> Any:
    """The first of these keys in a mapping, or of these attributes of an object."""
    for name in names:
        if isinstance(thing, Mapping):
            if name in thing:
                return cast("Mapping[str, Any]", thing)[name]
        elif hasattr(thing, name):
            return getattr(thing, name)
    if default is None:
        raise ArgumentError(argument, f"something with {' or '.join(names)}", describe(cast("object", thing)))
    return default


def pytorch3d_from_camera(K: Float64, size: tuple[int, int], camera_from_world: Float64) -> dict[str, Any]:
    """Return the arguments of `PerspectiveCameras`: row vectors, x left, y up, NDC over the shorter side."""
    half = min(size) / 2
    return {
        "R": (CV_FROM_PYTORCH3D @ camera_from_world[:3, :3]).T,
        "T": CV_FROM_PYTORCH3D @ camera_from_world[:3, 3],
        "focal_length": np.array([K[0, 0], K[1, 1]]) / half,
        "principal_point": -(K[:2, 2] + 0.5 - np.array(size) / 2) / half,
        "image_size": (size[1], size[0]),
        "in_ndc": True,
    }


def camera_from_pytorch3d(
    R: object, T: object, focal_length: object, principal_point: object, size: tuple[int, int]
) -> Arguments:
    """Return the camera of one `PerspectiveCameras` in NDC."""
    half = min(size) / 2
    focal = numbers("focal_length", focal_length, (2,)) * half
    center = np.array(size) / 2 - numbers("principal_point", principal_point, (2,)) * half - 0.5
    rotation = CV_FROM_PYTORCH3D @ numbers("R", R, (3, 3)).T
    translation = CV_FROM_PYTORCH3D @ numbers("T", T, (3,))
    pose = pose_from_extrinsics(rotation, translation)
    return {"K": _matrix(*focal, *center), "size": size, "world_from_camera": pose}
