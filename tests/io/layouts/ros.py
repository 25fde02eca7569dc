"""Specimens of ROS recordings."""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.io.layouts.wall import K, counts, rendered, xyzw


def ros_bag(folder: Path, packed: bool = False) -> None:
    """Each frame's pose lies between two transforms; the camera's axes differ from the body's, as usual in ROS."""
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
        """Pack depth as compressed_depth_image_transport does by default: a / depth + b in 16 bits, up to depth 10."""
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
        for sign in (-1, 1):  # halfway between both, the body has the right pose
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
