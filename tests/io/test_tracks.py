"""Name and form, or the user's choice, decide which topic of a bag and which track of a video is depth."""

from __future__ import annotations

import io
import json
import struct
import warnings
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import pyibr as ibr
from pyibr.io.depth_frames import DepthFrames
from pyibr.io.folders import choose, kind_of
from pyibr.io.video import Video
from tests.app.commands import assert_one_line, run, succeeded
from tests.calibrations import AZURE

H, W = 36, 52
GRAY = np.full((H, W, 3), 90, np.uint8)
DEPTH, INFRARED = np.full((H, W), 2500, np.uint16), np.full((H, W), 340, np.uint16)
DEPTH[:, :9] = 1250


NAMES = {
    "depth": ["/depth/image_raw", "/depth_to_rgb/image_raw", "/camera/aligned_depth_to_color/image_raw"],
    "color": ["/rgb/image_raw", "/rgb_to_depth/image_raw", "COLOR"],
    "other": ["/ir/image_raw", "/camera/infra1/image_rect_raw", "/zed/depth/confidence", "Left IR"],
    "": ["/stairs/third/image", ""],
}
NAMES["depth"] += ["/kinect2/sd/image_depth", "/device_0/sensor_0/Depth_0/image/data"]


@pytest.mark.parametrize(("name", "kind"), [(name, kind) for kind, names in NAMES.items() for name in names])
def test_kinds_by_name(name: str, kind: str):
    assert kind_of(name) == kind


@pytest.mark.parametrize(
    ("misfits", "best", "told"),
    [
        ({"/ir/a": 1, "/depth/a": 0}, "/depth/a", "/depth/a is read as depth, not /ir/a (channel="),
        ({"/a": 1, "/b": 0, "/c": 2}, "/b", "/b is read as depth, not /a"),
        ({"/a": 0, "/b": 0}, "/a", "/a is read as depth, not /b"),
        ({"/depth/a": 1, "/rgb/a": 2}, "/depth/a", None),
        ({"/a": 1, "/rgb/a": 2}, "/a", "/a is read as depth, not one with such a name"),
        ({"0": 2}, "0", None),
    ],
)
def test_the_best_is_chosen_and_reported(misfits: dict[str, int], best: str, told: str | None):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        assert choose(Path("x"), "depth", misfits) == best
    assert [told in str(one.message) for one in said if told] == ([True] if told else [])
    assert len(said) == (told is not None)


@pytest.mark.parametrize(
    "misfits", [{}, {"/ir/a": 1, "/rgb/a": 2}, {"/ir/a": 0, "/confidence/a": 0}, {"0 A": 2, "1 B": 2}]
)
def test_nothing_else_becomes_depth(misfits: dict[str, int]):
    with pytest.raises(ibr.FileFormatError, match="x: expected images of depth, got "):
        choose(Path("x"), "depth", misfits)


# ---- topics


def bag(path: Path, images: Mapping[str, tuple[str, Any]]) -> Path:
    """Write one message of each topic: an encoding with an array, or a format with bytes."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    types = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
    header = types["Header"](0, store.types["builtin_interfaces/msg/Time"](1700000000, 0), "eye")
    region = types["RegionOfInterest"](0, 0, 0, 0, False)
    K = np.array([50, 0, 25.5, 0, 50, 17.5, 0, 0, 1.0])
    info = types["CameraInfo"](header, H, W, "plumb_bob", np.zeros(5), K, np.eye(3).ravel(), np.zeros(12), 0, 0, region)
    messages = dict[str, Any]()
    for topic, (form, data) in images.items():
        flat = np.frombuffer(data if isinstance(data, bytes) else data.tobytes(), np.uint8)
        messages[topic] = types["CompressedImage"](header, form, flat)
        if not isinstance(data, bytes):
            messages[topic] = types["Image"](header, H, W, form, 0, data.strides[0], flat)
        place = topic.removesuffix("/compressed").removesuffix("/compressedDepth").rpartition("/")[0]
        messages[f"{place}/camera_info"] = info
    with Writer(path) as writer:
        for topic, one in messages.items():
            connection = writer.add_connection(topic, one.__msgtype__, typestore=store)
            writer.write(connection, 1700000000 * 10**9, store.serialize_ros1(one, one.__msgtype__))
    return path


def png(values: np.ndarray) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(values).save(stream, "PNG")
    return stream.getvalue()


KINECT = {"/ir/image_raw": ("mono16", INFRARED), "/depth/image_raw": ("16UC1", DEPTH), "/rgb/image_raw": ("bgr8", GRAY)}
METRES = (DEPTH / 1000).astype(np.float32)
COLORS = {"/rgb/image": ("rgb8", GRAY)}


def of_kinect(*names: str) -> dict[str, Any]:
    return {topic: image for topic, image in KINECT.items() if topic.split("/")[1] in names}


@pytest.mark.parametrize(
    "images",
    [
        KINECT,
        {"/confidence/map": ("32FC1", METRES * 30), "/range": ("32FC1", METRES), "/eye/left": ("rgb8", GRAY)},
        {"/camera/infra1/image": ("mono16", INFRARED), "/camera/depth/image": ("mono16", DEPTH)} | COLORS,
        {"/depth/image_raw/compressed": ("16UC1; png compressed ", png(DEPTH))} | COLORS,
        {"/depth/image_raw/compressed": ("png", png(DEPTH))} | COLORS,
        {"/d/image/compressedDepth": ("16UC1; compressedDepth", bytes(12) + png(DEPTH))} | COLORS,
        {"/depth/preview": ("mono8", GRAY[..., 0]), "/depth/image": ("16UC1", DEPTH)} | COLORS,
    ],
    ids=lambda images: next(iter(images)),
)
@pytest.mark.filterwarnings("ignore:.*is read as")
def test_depth_of_a_bag_is_depth(tmp_path: Path, images: dict[str, Any]):
    (view,) = ibr.load(bag(tmp_path / "a.bag", images))
    np.testing.assert_array_equal(view.depth, METRES)
    np.testing.assert_array_equal(view.color, GRAY)


def test_the_chosen_topic_is_reported_and_can_be_named(tmp_path: Path):
    out, place = tmp_path / "n.png", bag(tmp_path / "a.bag", KINECT)
    result = run("warp", place, "--move", 0, 0, 0, "-o", out)
    succeeded(result)
    assert "/depth/image_raw is read as depth, not /ir/image_raw" in result.stderr
    for command in (("warp", place, "--move", 0, 0, 0), ("clean", place)):
        for option in ("--depth-topic", "--depth-channel"):
            result = run(*command, option, "ir/image_raw", "-o", tmp_path / "z.npy")
            succeeded(result)
            assert "depth from 0.34 to 0.34" in result.stdout
    assert_one_line(
        run("warp", place, "--move", 0, 0, 0, "-o", out, "--depth-topic", "/none"),
        "a.bag: expected one of /ir/image_raw, /depth/image_raw, got '/none' (channel=; --depth-channel)",
    )


def test_the_topic_of_depth_decides_on_the_device(tmp_path: Path):
    both = {f"/{eye}{topic}": image for eye in ("left", "right") for topic, image in of_kinect("depth", "rgb").items()}
    both["/right/rgb/image_raw"] = ("bgr8", GRAY + np.uint8(9))
    with pytest.warns(UserWarning, match="/right/rgb/image_raw is read as color, not /left/rgb/image_raw"):
        (view,) = ibr.load(bag(tmp_path / "a.bag", both), channel="/right/depth/image_raw")
    assert (view.color == 99).all()


@pytest.mark.parametrize(
    ("images", "message"),
    [
        (of_kinect("ir", "rgb"), "expected images of depth"),
        (of_kinect("depth") | {"/depth/other": ("16UC1", DEPTH)}, "expected images of color"),
        (COLORS | {"/depth/image/compressedDepth": ("16UC1; compressedDepth rvl", bytes(99))}, "rvl"),
        (COLORS | {"/depth/image/compressed": ("16UC1; png compressed", b"broken" * 9)}, r"a\.bag"),
    ],
)
def test_bags_without_readable_depth(tmp_path: Path, images: dict[str, Any], message: str):
    with pytest.raises(ibr.FileFormatError, match=message):
        ibr.load(bag(tmp_path / "a.bag", images))


# ---- tracks

FORMATS = {"yuvj422p": "mjpeg", "yuv420p": "mpeg4", "gray": "ffv1", "gray16le": "ffv1"}


def film(path: Path, tracks: list[tuple[str, str, np.ndarray]], count: int = 1, **files: object) -> Path:
    """Write tracks of constant pictures: title, pixel format, picture. JSON files are attached."""
    av = pytest.importorskip("av", reason="needs PyAV, of the extra video")
    with av.open(str(path), "w") as container:
        streams = []
        for title, pixels, picture in tracks:
            stream = container.add_stream(FORMATS[pixels], rate=30)
            stream.height, stream.width = picture.shape[:2]
            stream.pix_fmt = pixels
            stream.metadata["title"] = title
            streams.append(stream)
        for name, content in files.items():
            container.add_attachment(f"{name}.json", "application/octet-stream", json.dumps(content).encode())
        for number in range(count):
            for stream, (_, pixels, picture) in zip(streams, tracks, strict=True):
                form = "rgb24" if picture.ndim == 3 else "gray" if picture.dtype == np.uint8 else "gray16le"
                frame = av.VideoFrame.from_ndarray(picture, format=form).reformat(format=pixels)
                frame.pts, frame.time_base = number, Fraction(1, 30)
                container.mux(stream.encode(frame))
        for stream in streams:
            container.mux(stream.encode())
    return path


COLOR_TRACK, DEPTH_TRACK = ("COLOR", "yuvj422p", GRAY), ("DEPTH", "gray16le", DEPTH)
IR_TRACK = ("IR", "gray16le", INFRARED)


@pytest.mark.parametrize(
    "tracks",
    [
        [COLOR_TRACK, DEPTH_TRACK, IR_TRACK],
        [IR_TRACK, DEPTH_TRACK, COLOR_TRACK],
        [("", "yuv420p", GRAY), ("", "gray16le", DEPTH)],
        [("infrared left", "gray16le", INFRARED), ("", "gray16le", DEPTH), ("", "yuv420p", GRAY)],
        [("", "gray", GRAY[..., 0]), ("", "gray16le", DEPTH)],
    ],
    ids=lambda tracks: "-".join(title or pixels for title, pixels, _ in tracks),
)
@pytest.mark.filterwarnings("ignore:.*is read as")
def test_depth_of_a_film_is_depth(tmp_path: Path, tracks: list[Any]):
    place = film(tmp_path / "a.mkv", tracks)
    (depth,) = DepthFrames(place).read([0], depth_scale=1000)
    np.testing.assert_array_equal(depth, METRES)
    (color,) = Video(place)
    assert np.abs(color.astype(int) - 90).max() <= 1


def test_a_track_is_chosen_by_title_or_number(tmp_path: Path):
    place = film(tmp_path / "a.mkv", [COLOR_TRACK, DEPTH_TRACK, IR_TRACK])
    for name in ("ir", "2"):
        (depth,) = DepthFrames(place, name).read([0], depth_scale=1000)
        assert (depth == np.float32(0.34)).all()
    (color,) = Video(place, 0)
    assert color.shape == (H, W, 3)
    with pytest.raises(
        ibr.FileFormatError, match=r"mkv: expected one of 0 COLOR, 1 DEPTH, 2 IR, got 'depths' \(channel="
    ):
        DepthFrames(place, "depths")
    with pytest.warns(UserWarning, match="1 DEPTH is read as depth, not 2 IR"):
        DepthFrames(place)
    place = film(tmp_path / "b.mkv", [COLOR_TRACK, IR_TRACK])
    with pytest.raises(ibr.FileFormatError, match="expected images of depth, got 0 COLOR, 1 IR; name one"):
        DepthFrames(place)
    (depth,) = DepthFrames(film(tmp_path / "c.mkv", [("", "yuv420p", GRAY)])).read([0], depth_scale=10)
    assert np.abs(depth - 9).max() < 0.3  # a film of colours holds numbers in green


def calibration() -> dict[str, Any]:
    """An Azure Kinect's calibration: the colour camera stands 32 mm to the right of the depth camera."""
    made = json.loads(json.dumps(AZURE))
    one = made["CalibrationInformation"]["Cameras"]
    one[0]["Intrinsics"]["ModelParameters"] = [0.5, 0.5, 0.49, 0.49, *[0.0] * 10]
    beside = json.loads(json.dumps(one[0])) | {"Location": "CALIBRATION_CameraLocationPV0"}
    one.append(beside | {"SensorWidth": 4096, "SensorHeight": 3072})
    beside["Intrinsics"]["ModelParameters"] = [0.5, 0.5, 0.48, 0.64, *[0.0] * 10]
    beside["Rt"]["Translation"] = [-0.032, 0, 0]
    return made


@pytest.mark.filterwarnings("ignore:.*is read as")
def test_a_kinects_recording_has_colours_depth_and_cameras(tmp_path: Path):
    color, wall = np.full((720, 1280, 3), (30, 90, 150), np.uint8), np.full((288, 320), 1500, np.uint16)
    tracks = [("COLOR", "yuvj422p", color), ("DEPTH", "gray16le", wall), ("IR", "gray16le", wall // 4)]
    place = film(tmp_path / "kinect.mkv", tracks, 2, calibration=calibration())
    views = ibr.load(place)
    assert len(views) == 2
    for view in views:
        assert view.camera == ibr.Camera.from_azure_kinect(calibration(), "720P")
        assert float(view.camera.center[0]) == pytest.approx(0.032)
        assert np.abs(view.color.astype(int) - (30, 90, 150)).max() <= 3
        assert 0.3 < view.valid.mean() < 1
        np.testing.assert_allclose(view.depth[view.valid], 1.5, rtol=1e-5)  # a wall across both axes
    out = succeeded(run("warp", place, "--take", "0:1", "--move", 0, 0, 0, "-o", tmp_path / "n.png"))
    assert "1280x720" in out and "depth from 1.5 to 1.5" in out
    out = succeeded(run("convert", place, "-o", tmp_path / "cameras.json"))
    assert "2 cameras" in out


@pytest.mark.filterwarnings("ignore:.*is read as")
def test_tracks_without_a_fitting_calibration(tmp_path: Path):
    place = film(tmp_path / "a.mkv", [COLOR_TRACK, DEPTH_TRACK, IR_TRACK])
    with pytest.raises(ibr.FileFormatError, match=r"a\.mkv: has neither a\.json nor camera\.json"):
        ibr.load(place)
    camera = ibr.Camera([[50, 0, 25.5], [0, 50, 17.5], [0, 0, 1]], (W, H))
    (view,) = ibr.load(place, camera=camera)
    np.testing.assert_array_equal(view.depth, METRES)
    place = film(tmp_path / "b.mkv", [COLOR_TRACK, DEPTH_TRACK], k4a=calibration())
    with pytest.raises(
        ibr.FileFormatError, match=rf"b\.mkv: k4a\.json: expected a camera of {W}x{H}, the track of color"
    ):
        ibr.load(place)
    place = film(tmp_path / "c.mkv", [COLOR_TRACK, DEPTH_TRACK], own=[camera.to_json()] * 2)
    with pytest.raises(ibr.ArgumentError, match="depth_scale: expected stored units"):  # of unknown depth
        ibr.load(place)


@pytest.mark.filterwarnings("ignore:.*is read as")
def test_frames_of_tracks_go_by_time(tmp_path: Path):
    """The second track begins a frame later."""
    av = pytest.importorskip("av")
    place = tmp_path / "a.mkv"
    with av.open(str(place), "w") as container:
        streams = [container.add_stream("ffv1", rate=10) for _ in range(2)]
        for stream, title, pixels in zip(streams, ("color", "depth"), ("bgr0", "gray16le"), strict=True):
            stream.width, stream.height, stream.pix_fmt, stream.metadata["title"] = W, H, pixels, title
        for number in range(4):
            for stream, form in zip(streams, ("rgb24", "gray16le"), strict=True):
                if form == "rgb24" or number > 0:
                    picture = np.full_like(GRAY if form == "rgb24" else DEPTH, number)
                    frame = av.VideoFrame.from_ndarray(picture, format=form).reformat(format=stream.pix_fmt)
                    frame.pts, frame.time_base = number, Fraction(1, 10)
                    container.mux(stream.encode(frame))
        for stream in streams:
            container.mux(stream.encode())
    views = ibr.load(place, camera=ibr.Camera.from_fov((W, H), fov_x=60), depth_scale=1)
    assert [(int(view.color[0, 0, 0]), int(view.depth[0, 0])) for view in views] == [(1, 1), (2, 2), (3, 3)]


def test_a_film_of_one_frame_is_no_picture_with_a_number(tmp_path: Path):
    """clip7.mkv has a frame 0, and poses by time do not apply to the 7 in its name."""
    film(tmp_path / "clip7.mkv", [("", "yuv420p", GRAY)])
    film(tmp_path / "depth.mkv", [("", "gray16le", DEPTH)])
    (tmp_path / "poses.txt").write_text("0 0 0 0 0 0 0 1\n")
    ibr.write_depth(tmp_path / "depths/3.png", METRES, depth_scale=1000)
    how = ("--depth-scale", 1000, "--fov", 60, "--poses", tmp_path / "poses.txt", "--move", 0, 0, 0)
    for depth in ("depth.mkv", "depths"):
        succeeded(run("warp", tmp_path / "clip7.mkv", tmp_path / depth, *how, "-o", tmp_path / "n.png"))
        assert (tmp_path / "n_0000.png").exists()
        (tmp_path / "n_0000.png").unlink()


def test_compressed_depth_of_floats(tmp_path: Path):
    scale, least = 1010.0, -100.0
    data = struct.pack("<iff", 0, scale, least) + png((scale / METRES + least).astype(np.uint16))
    images = {"/depth/image/compressedDepth": ("32FC1; compressedDepth png", data)}
    (view,) = ibr.load(bag(tmp_path / "a.bag", COLORS | images))
    np.testing.assert_allclose(view.depth, METRES, rtol=0.005)
