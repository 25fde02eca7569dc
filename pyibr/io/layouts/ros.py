"""ROS bags, of ROS 1 and 2, through rosbags: images, CameraInfo and the camera's poses from tf."""

from __future__ import annotations

import struct
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64
from pyibr.core.errors import FileFormatError
from pyibr.core.files import decoding
from pyibr.core.optional import rosbags, rosbags_types
from pyibr.core.rotations import rotation_from_quaternion
from pyibr.io import image
from pyibr.io.folders import at_one_time, choose
from pyibr.io.poses import rigid_or_none
from pyibr.io.recordings import Recording, Stored, paired_by_time

_IMAGE, _PACKED, _INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo"
_TF = "tf2_msgs/msg/TFMessage"
_DEPTHS = {"16UC1": (np.uint16, 1000.0), "mono16": (np.uint16, 1000.0), "32FC1": (np.float32, 1.0)}
"""Encodings of depth: stored type, and units per metre."""
_COLORS = {"rgb8": (0, 1, 2), "bgr8": (2, 1, 0), "rgba8": (0, 1, 2), "bgra8": (2, 1, 0), "mono8": (0, 0, 0)}
_TRANSFORM, _DATA, _UNITS = "geometry_msgs/msg/Transform", "/image/data", "/option/Depth_Units/value"  # RealSense's
_MISFITS = {"16UC1": 0, "32FC1": 0, "mono16": 1}  # for `choose`
_GRAY_16 = bytes((16, 0))  # a PNG's bits and kind of colour
_GAP_MAX = 0.1  # seconds between transforms; in longer gaps the pose is unknown


class _Step(NamedTuple):
    """A transform of tf: from a frame to its parent."""

    time: float
    above: str
    position: Float64
    wxyz: Float64


class _Images(NamedTuple):
    """An image topic: each message's own time stamp, and its time in the bag."""

    topic: str
    frame: str
    encoding: str
    stamps: list[float]
    at: list[int]


def find_bag(folder: Path, channel: str | None = None) -> Recording | None:
    """Find a .bag, or metadata.yaml with a bag of ROS 2; depth, in topic `channel`, is 16UC1 (mm) or 32FC1 (m)."""
    bags = [folder] if folder.is_file() else sorted(folder.glob("*.bag"))
    is_second = (folder / "metadata.yaml").is_file() and any(any(folder.glob(form)) for form in ("*.db3", "*.mcap"))
    if len(bags) != 1 and not is_second:
        return None
    path = bags[0] if len(bags) == 1 else folder
    with _opened(path) as reader:
        topics = [_images(reader, one) for one in reader.connections if one.msgtype in (_IMAGE, _PACKED)]
        infos = {one.topic: next(_messages(reader, one)) for one in reader.connections if one.msgtype == _INFO}
        steps = _steps(reader)
        units = [next(_messages(reader, one)).data for one in reader.connections if one.topic.endswith(_UNITS)]
    depth, color = _chosen(path, {one.topic: one for one in topics if one is not None}, channel)
    found = paired_by_time([path] * len(color.at), color.stamps, [path] * len(depth.at), depth.stamps)
    times = found.times or []
    of_color, of_depth = (_camera(path, one, infos) for one in (color, depth))
    placed = [_place(steps, color.frame, time) for time in times]
    aside = _place(steps, depth.frame, times[0])
    if of_depth != of_color and placed[0] is not None and aside is not None:
        of_depth = Camera(of_depth.K, of_depth.size, np.linalg.inv(placed[0]) @ aside, lens=of_depth.lens)
    kind, scale = _DEPTHS[depth.encoding]
    scale = 1 / units[0] if units else scale
    of_time = dict(zip(color.stamps, color.at, strict=True))
    return found._replace(
        known=lambda: [of_color],
        placed=placed if color.frame in steps else None,
        depth_cameras=None if of_depth == of_color else (lambda: [of_depth] * len(times)),
        stored=[
            Stored(
                scale,
                color=partial(_color_at, topic=color.topic, at=of_time[time]),
                depth=partial(_depth_at, topic=depth.topic, at=depth.at[place], kind=kind),
                chosen=True,
            )
            for time, (_, place) in zip(times, at_one_time(color.stamps, depth.stamps), strict=True)
        ],
    )


def _chosen(path: Path, topics: dict[str, _Images], channel: str | None) -> tuple[_Images, _Images]:
    """Topics of depth and colours; if there are several devices, both are from one."""
    encodings = {topic: one.encoding for topic, one in topics.items()}
    misfits = {topic: _MISFITS.get(encoding, 2) for topic, encoding in encodings.items()}
    depth = choose(path, "depth", {topic: k for topic, k in misfits.items() if k < 2 or channel is None}, channel)
    near = sorted(topics, key=lambda topic: topic.split("/")[:2] != depth.split("/")[:2])
    forms = {topic: 2 if misfits[topic] < 2 else int(encodings[topic] == "mono8") for topic in near}
    return topics[depth], topics[choose(path, "color", forms)]


@contextmanager
def _opened(path: Path) -> Generator[Any, None, None]:
    readers = rosbags()
    with decoding(path, "ROS bag"), readers.AnyReader([path], default_typestore=_store()) as reader:
        yield reader


@cache
def _store() -> Any:
    """Message types for bags that do not contain them."""
    typesys = rosbags_types()
    return typesys.get_typestore(typesys.Stores.LATEST)


def _messages(reader: Any, connection: Any) -> Iterator[Any]:
    for _, _, data in reader.messages([connection]):
        yield reader.deserialize(data, connection.msgtype)


def _images(reader: Any, connection: Any) -> _Images | None:
    stamps, at, last = list[float](), list[int](), None
    for _, time, data in reader.messages([connection]):
        last = reader.deserialize(data, connection.msgtype)
        stamps.append(_seconds(last.header))
        at.append(time)
    if last is None:
        return None
    encoding = getattr(last, "encoding", getattr(last, "format", "")).partition(";")[0]
    topic = connection.topic
    if encoding == "png" and bytes(last.data[24:26]) == _GRAY_16:
        encoding = "16UC1"
    frame = topic.removesuffix(_DATA) if topic.endswith(_DATA) else last.header.frame_id
    return _Images(topic, frame, encoding, stamps, at)


def _camera(path: Path, images: _Images, infos: dict[str, Any]) -> Camera:
    """The camera of a topic, from CameraInfo beside it or a level higher; rectified images get no lens."""
    topic = images.topic.removesuffix("/compressed").removesuffix("/compressedDepth")
    place = topic.rsplit("/", 1)[0]
    above = place.rsplit("/", 1)[0]
    names = [
        f"{place}/camera_info",
        f"{above}/camera_info",
        f"{above}/info/camera_info",
    ]  # the last is RealSense's
    info = next((infos[name] for name in names if name in infos), None)
    if info is None:
        raise FileFormatError(f"{path}: no {names[0]} for the images of {images.topic}")
    if "rect" not in topic.rsplit("/", 1)[1]:
        return Camera.from_ros(info)
    projection = info.p if hasattr(info, "p") else info.P
    return Camera(np.reshape(projection, (3, 4))[:, :3], (int(info.width), int(info.height)))


def _message_at(path: Path, topic: str, at: int) -> Any:
    with _opened(path) as reader:
        connections = [one for one in reader.connections if one.topic == topic]
        connection, _, data = next(reader.messages(connections, start=at, stop=at + 1))
        return reader.deserialize(data, connection.msgtype)


def _color_at(path: Path, topic: str, at: int) -> NDArray[Any]:
    message = _message_at(path, topic, at)
    if not hasattr(message, "encoding"):
        return image.without_alpha(np.atleast_3d(image.decoded(bytes(message.data))), topic)
    if message.encoding not in _COLORS:
        raise FileFormatError(f"{path}: {topic}: expected images as {', '.join(_COLORS)}, got {message.encoding}")
    rows = np.reshape(message.data, (message.height, message.step))
    channels = 1 if message.encoding == "mono8" else len(message.encoding) - 1
    pixels = rows[:, : message.width * channels].reshape(message.height, message.width, channels)
    return np.ascontiguousarray(pixels[..., list(_COLORS[message.encoding])])


def _depth_at(path: Path, topic: str, at: int, kind: type[np.generic]) -> NDArray[np.float32]:
    message = _message_at(path, topic, at)
    if not hasattr(message, "encoding"):
        return _unpacked(path, message, kind)
    order = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    rows = np.reshape(message.data, (message.height, message.step))[:, : message.width * order.itemsize]
    values = np.ascontiguousarray(rows).view(order).astype(np.float32)
    return np.where(values > 0, values, np.float32(np.nan))


def _unpacked(path: Path, message: Any, kind: type[np.generic]) -> NDArray[np.float32]:
    """Depth as PNG or TIFF, or from compressedDepth: 12 bytes, then a PNG; for floats, its bits hold a / depth + b."""
    data = bytes(message.data)
    is_packed = data[12:16] == b"\x89PNG"
    if not is_packed and ("compressedDepth" in message.format or kind != np.uint16):
        raise FileFormatError(f"{path}: expected depth as PNG, got {message.format or 'another format'}")
    scale, least = struct.unpack_from("<4xff", data) if is_packed else (1.0, 0.0)
    counts = image.decoded(data[12 if is_packed else 0 :]).astype(np.float32)
    known = np.where(counts > 0, counts, np.float32(np.nan))
    return known if kind == np.uint16 else np.float32(scale) / (known - np.float32(least))


def _steps(reader: Any) -> dict[str, list[_Step]]:
    """The transforms of each frame in the order of their times; static ones have the time infinity.

    Transforms of RealSense's streams, whose topics name the parent stream, have the opposite direction.
    """
    found: dict[str, list[_Step]] = {}
    for connection in reader.connections:
        stream, _, above = connection.topic.rpartition("/tf/")
        if connection.msgtype == _TRANSFORM and stream:
            one = next(_messages(reader, connection))
            p, q = one.translation, one.rotation
            wxyz = np.array([q.w, -q.x, -q.y, -q.z])
            position = -rotation_from_quaternion(wxyz) @ np.array([p.x, p.y, p.z])
            found[stream] = [_Step(np.inf, f"stream {above}", position, wxyz)]
        if connection.msgtype == _TF:
            for message in _messages(reader, connection):
                for one in message.transforms:
                    p, q = one.transform.translation, one.transform.rotation
                    step = _Step(
                        np.inf if "static" in connection.topic else _seconds(one.header),
                        one.header.frame_id,
                        np.array([p.x, p.y, p.z]),
                        np.array([q.w, q.x, q.y, q.z]),
                    )
                    found.setdefault(one.child_frame_id, []).append(step)
    return {frame: sorted(steps, key=lambda step: step.time) for frame, steps in found.items()}


def _place(steps: dict[str, list[_Step]], frame: str, time: float) -> Float64 | None:
    """A frame's pose in its topmost ancestor; None if a transform at that time is missing."""
    pose, seen = np.eye(4), set[str]()
    while frame in steps and frame not in seen:
        seen.add(frame)
        own = _at(steps[frame], time)
        if own is None:
            return None
        above = np.eye(4)
        above[:3, :3], above[:3, 3] = rotation_from_quaternion(own.wxyz), own.position
        pose, frame = above @ pose, own.above
    return rigid_or_none(pose)


def _at(steps: list[_Step], time: float) -> _Step | None:
    """The transform at a time, interpolated between its neighbours."""
    if steps[-1].time == np.inf:
        return steps[-1]
    after = int(np.searchsorted([step.time for step in steps], time))
    first, second = steps[max(after - 1, 0)], steps[min(after, len(steps) - 1)]
    if max(abs(first.time - time), abs(second.time - time)) > _GAP_MAX:
        return None
    part = 0.0 if first is second else (time - first.time) / (second.time - first.time)
    turned = second.wxyz if first.wxyz @ second.wxyz >= 0 else -second.wxyz
    position = (1 - part) * first.position + part * second.position
    return _Step(time, first.above, position, (1 - part) * first.wxyz + part * turned)


def _seconds(header: Any) -> float:
    return header.stamp.sec + header.stamp.nanosec * 1e-9
