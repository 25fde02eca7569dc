"""Calibration files of each kind, written here, and the cameras that they describe."""

from __future__ import annotations

import json
from typing import Any

import cv2
import numpy as np

import pyibr as ibr

SIZE = (61, 37)
K = [[50, 0, 30.5], [0, 51, 17.75], [0, 0, 1]]
BENT = [-0.2, 0.05, 0.001, -0.002, 0.01]
CAMERA = ibr.Camera(K, SIZE, lens=ibr.Lens("brown_conrady", BENT))
FLAT = ibr.Camera(K, SIZE)
FISHEYE = ibr.Camera(K, SIZE, lens=ibr.Lens("kannala_brandt", BENT[:4]))
ROWS = "50 0 30.5\n0 51 17.75\n0 0 1\n"
NUMBERS = "[50, 0., 30.5, 0., 51,\n       17.75, 0., 0., 1.]"
D = str(BENT)
ITEMS = "".join(f"- {float(number)}\n" for row in K for number in row)
INTRINSIC = {"fx": 50, "fy": 51, "cx": 30.5, "cy": 17.75, "width": 61, "height": 37}
DISTORTION = {"k1": -0.2, "k2": 0.05, "k3": 0.01, "k4": 0, "k5": 0, "k6": 0, "p1": 0.001, "p2": -0.002}

ROS = f"""image_width: 61
image_height: 37
camera_name: "left # 1"
camera_matrix:
  rows: 3
  cols: 3
  data: {NUMBERS}
distortion_model: plumb_bob
distortion_coefficients: {{rows: 1, cols: 5, data: {D}}}
"""
ROS_MESSAGE = f"""header:
  frame_id: eye
height: 37
width: 61
distortion_model: ''
d: []
k:
{ITEMS}roi: {{x_offset: 0, y_offset: 0}}
---
height: 99
"""
ROS_INI = f"""[image]

width
61

; remark
height
37

[eye]

camera matrix
{ROWS}
distortion
{D[1:-1].replace(",", "")}
"""
KALIBR = f"""%YAML:1.0
cam0:
  T_cam_imu: # to the imu
  - [1.0, 0.0, 0.0, 0.1]
  - [0.0, 1.0, 0.0, 0.0]
  camera_model: pinhole
  distortion_model: equidistant
  distortion_coeffs: {BENT[:4]}
  intrinsics: [50, 51, 30.5, 17.75]
  resolution: [61, 37]
cam1:
  camera_model: omni
  distortion_model: none
  intrinsics: [50, 51, 30.5, 17.75]
  resolution: [61, 37]
"""
OPENCV = f"""%YAML:1.0
---
image_width: 61
image_height: 37
Camera_Matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: {NUMBERS}
Distortion_Coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: {D}
"""
OPENCV_XML = f"""<?xml version="1.0"?>
<opencv_storage>
<imageSize>61 37</imageSize>
<M1 type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt><data>{ROWS}</data></M1>
<D1 type_id="opencv-matrix"><rows>1</rows><cols>5</cols><dt>d</dt><data>{D[1:-1].replace(",", "")}</data></D1>
</opencv_storage>
"""
ORBBEC = (
    "[DepthIntrinsic]\nfx=40\nfy=40\ncx=20\ncy=15\nwidth=41\nheight=31\n[ColorIntrinsic]\n"
    + "".join(f"{key}={value}\n" for key, value in INTRINSIC.items())
    + "[ColorDistortion]\n"
    + "".join(f"{key}={value}\n" for key, value in DISTORTION.items())
    + "[D2CTransformParam]\n"
    + "".join(f"rot{k}={int(k % 4 == 0)}\n" for k in range(9))
    + "trans0=-25\ntrans1=0\ntrans2=4\n"
)
REALSENSE = {"width": 61, "height": 37, "fx": 50, "fy": 51, "ppx": 30.5, "ppy": 17.75}
REALSENSE |= {"model": "distortion.brown_conrady", "coeffs": BENT}
ORBBEC_JSON = {"rgbIntrinsic": INTRINSIC, "rgbDistortion": DISTORTION}
REPLICA = {"camera": {"w": 61, "h": 37, "fx": 50, "fy": 51, "cx": 30.5, "cy": 17.75, "scale": 6553.5}}
BOP = {"cx": 30.5, "cy": 17.75, "fx": 50, "fy": 51, "width": 61, "height": 37, "depth_scale": 0.1}

FILES: dict[str, tuple[str, ibr.Camera]] = {
    "ost.yaml": (ROS, CAMERA),
    "utf16.yaml": (ROS, CAMERA),
    "echo.yaml": (ROS_MESSAGE, FLAT),
    "ros.ini": (ROS_INI, CAMERA),
    "camchain.yaml#cam0": (KALIBR, FISHEYE),
    "opencv.yml": (OPENCV, CAMERA),
    "opencv.xml#1": (OPENCV_XML, CAMERA),
    "realsense.json": (json.dumps(REALSENSE), CAMERA),
    "rig.json#color": (json.dumps({"color": REALSENSE, "depth": INTRINSIC | {"width": 60}}), CAMERA),
    "bop.json": (json.dumps(BOP), FLAT),
    "replica.json": (json.dumps(REPLICA), FLAT),
    "K.txt": (ROWS, FLAT),
    "K4.txt": ("50 0 30.5 0\n0 51 17.75 0\n0 0 1 0\n0 0 0 1\n", FLAT),
    "camera_matrix.csv": ("50.0,0.0,30.5\n0.0,51.0,17.75\n0.0,0.0,1.0\n", FLAT),
    "K_normalized.txt": (f"{50 / 61} 0 {31 / 61}\n0 {51 / 37} {18.25 / 37}\n0 0 1\n", FLAT),
}


def kinect(wide: float = 3 / 4, **changes: Any) -> dict[str, Any]:
    """An Azure Kinect's calibration file; `wide` is the height of the colour image divided by its width."""
    k = [0.55, -0.02, -0.003, 0.89, 0.09, -0.014]
    depth: dict[str, Any] = {"Location": "CALIBRATION_CameraLocationD0", "SensorWidth": 1024, "SensorHeight": 1024}
    depth |= {"MetricRadius": 1.74, "Intrinsics": {"ModelType": "CALIBRATION_LensDistortionModelBrownConrady"}}
    depth["Intrinsics"]["ModelParameters"] = [0.513, 0.517, 0.4928, 0.4929, *k, 0, 0, -7e-5, 2e-5]
    depth["Rt"] = {"Rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1], "Translation": [0, 0, 0]}
    turn = cv2.Rodrigues(np.array([-0.09, 0.001, 0.002]))[0]
    k = [0.33, -2.49, 1.45, 0.21, -2.3, 1.37]
    middle, focal = 0.5 + (0.507 - 0.5) * 0.75 / wide, 0.6374 * 0.75 / wide  # cy and fy divided by the image's height
    color = depth | {"Location": "CALIBRATION_CameraLocationPV0", "SensorWidth": 4096, "MetricRadius": 0}
    color |= {"SensorHeight": int(4096 * wide), "Intrinsics": dict(depth["Intrinsics"])}
    color["Intrinsics"]["ModelParameters"] = [0.4998, middle, 0.478, focal, *k, 0, 0, -1e-4, -2e-4]
    color["Rt"] = {"Rotation": turn.ravel().tolist(), "Translation": [-0.032, -0.002, 0.004]}
    depth["Intrinsics"] |= changes
    return {"CalibrationInformation": {"Cameras": [depth, color]}}


AZURE = {"CalibrationInformation": {"Cameras": kinect()["CalibrationInformation"]["Cameras"][:1]}}


def oak() -> dict[str, Any]:
    """DepthAI calibration of cameras 0, 1 and 2: 1 is posed relative to 2, 2 relative to 0; 2 is a fisheye."""

    def socket(to: int, x: float, kind: int = 0) -> dict[str, Any]:
        outside = {"rotationMatrix": np.eye(3).tolist(), "toCameraSocket": to, "translation": {"x": x, "y": 0, "z": 0}}
        values = [*BENT, *[0] * 9] if kind == 0 else [*BENT[:4], *[0] * 10]
        size = {"width": SIZE[0], "height": SIZE[1]}
        return {"cameraType": kind, "distortionCoeff": values, "extrinsics": outside, "intrinsicMatrix": K} | size

    return {"batchName": "", "cameraData": [[0, socket(-1, 0)], [1, socket(2, -7.5)], [2, socket(0, 3.75, kind=1)]]}


def transforms() -> tuple[dict[str, Any], ibr.Camera]:
    """NeRF's transforms.json with two frames, and the camera of the first frame."""
    camera = CAMERA.orbited(25, (0, 0, 2)).moved(0.1, 0.2, 0)
    pose, matrix = ibr.Camera(K, SIZE, camera.world_from_camera).to_opengl()
    inside = {"fl_x": 50, "fl_y": 51, "cx": matrix[0, 2], "cy": matrix[1, 2], "w": 61.0, "h": 37.0}
    inside |= {"k1": -0.2, "k2": 0.05, "p1": 0.001, "p2": -0.002, "k3": 0.01}
    frame = {"file_path": "images/0001.jpg", "transform_matrix": pose.tolist()}
    return inside | {"frames": [frame, frame | {"file_path": "images/0002.jpg", "fl_x": 60}]}, camera
