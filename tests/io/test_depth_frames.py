"""Files with the depth of many frames: each frame reads back exactly, in any order, without reading the others."""

from __future__ import annotations

import tracemalloc
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.io.depth_frames import DepthFrames, frames_in
from pyibr.io.layouts import recording_in
from pyibr.io.recordings import cameras_of, shots_of

av = pytest.importorskip("av", reason="needs PyAV, of the extra video")

COUNT, HEIGHT, WIDTH = 5, 37, 61


def counts(bits: int) -> np.ndarray:
    """Random numbers of `bits` bits, (N, H, W), some of them 0."""
    found = np.random.default_rng(bits).integers(0, 1 << bits, (COUNT, HEIGHT, WIDTH)).astype(np.uint16)
    found[:, 3] = 0
    return found


def film(path: Path, stack: np.ndarray, codec: str, pixels: str) -> Path:
    """Write the numbers as levels of gray into a lossless video."""
    with av.open(str(path), "w") as container:
        options = {"x265-params": "lossless=1:log-level=none"} if codec == "libx265" else {}
        stream = container.add_stream(codec, rate=25, options=options)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, pixels
        for number, frame in enumerate(stack):
            shown = av.VideoFrame.from_ndarray(frame.astype(np.uint8 if pixels == "gray" else np.uint16), format=pixels)
            shown.pts, shown.time_base = number, Fraction(1, 25)
            container.mux(stream.encode(shown))
        container.mux(stream.encode())
    return path


def in_metres(stack: np.ndarray) -> list[np.ndarray]:
    return [ibr.depth_from_uint16(frame, 1000) for frame in stack]


@pytest.mark.parametrize(
    ("codec", "pixels", "bits"),
    [("ffv1", "gray16le", 16), ("ffv1", "gray12le", 12), ("ffv1", "gray", 8), ("libx265", "gray10le", 10)],
)
def test_gray_films_hold_numbers(tmp_path: Path, codec: str, pixels: str, bits: int):
    stack = counts(bits)
    frames = DepthFrames(film(tmp_path / "depth.mkv", stack, codec, pixels))
    assert len(frames) == COUNT and frames.fps == 25
    np.testing.assert_array_equal(list(frames.read(range(COUNT), depth_scale=1000)), in_metres(stack))


def test_what_is_written_is_read(tmp_path: Path):
    stack = counts(16)
    ibr.write_video(tmp_path / "depth.mkv", stack, 30, bits=16)
    frames = DepthFrames(tmp_path / "depth.mkv")
    np.testing.assert_array_equal(list(frames.read(range(COUNT), depth_scale=1000)), in_metres(stack))


@pytest.mark.parametrize("shape", [(COUNT, HEIGHT, WIDTH), (COUNT, 1, HEIGHT, WIDTH), (1, COUNT, HEIGHT, WIDTH, 1)])
@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_arrays_in_any_order(tmp_path: Path, suffix: str, shape: tuple[int, ...]):
    stack = counts(16).astype(np.float32) / 1000
    path = tmp_path / f"depth{suffix}"
    save: Any = np.save if suffix == ".npy" else np.savez_compressed
    save(path, stack.reshape(shape))
    frames = frames_in(path)
    assert frames is not None and len(frames) == COUNT and frames.fps is None
    for number in (3, 4, 0, 2, 2):  # in order, back to the start, past a gap, twice
        np.testing.assert_array_equal(frames.read_one(number, None, {}), stack[number])
    np.testing.assert_array_equal(list(frames.read([0, 2, 3])), stack[[0, 2, 3]])


def test_kinds_of_depth(tmp_path: Path):
    camera = ibr.Camera([[50, 0, 30], [0, 50, 18], [0, 0, 1]], (WIDTH, HEIGHT))
    plane = np.full((2, HEIGHT, WIDTH), 2, np.float32)
    np.save(tmp_path / "inverse.npy", 1 / plane)
    np.save(tmp_path / "distance.npy", np.stack([ibr.euclidean_from_depth(one, camera) for one in plane]))
    np.save(tmp_path / "relative.npy", plane * np.linspace(1, 3, WIDTH, dtype=np.float32))
    for kind in ("inverse", "distance"):
        (depth,) = DepthFrames(tmp_path / f"{kind}.npy").read([1], camera, depth_kind=kind)
        np.testing.assert_allclose(depth, 2, rtol=1e-6)
    (depth,) = DepthFrames(tmp_path / "relative.npy").read([1], depth_kind="relative", near=2, far=8)
    np.testing.assert_allclose(depth[0, [0, -1]], (8, 2), rtol=1e-6)
    with pytest.raises(ibr.ArgumentError, match="camera"):
        list(DepthFrames(tmp_path / "distance.npy").read([0], depth_kind="distance"))


def test_what_holds_no_frames(tmp_path: Path):
    np.save(tmp_path / "one.npy", np.ones((HEIGHT, WIDTH)))
    np.save(tmp_path / "network.npy", np.ones((1, HEIGHT, WIDTH)))  # one image, with the first axis that networks add
    assert frames_in(tmp_path / "one.npy") is None and frames_in(tmp_path / "network.npy") is None
    assert frames_in(tmp_path / "depth.png") is None and len(DepthFrames(tmp_path / "network.npy")) == 1
    np.save(tmp_path / "words.npy", np.array([["a", "b"]]))
    np.save(tmp_path / "five.npy", np.ones((2, 3, 4, 5)))
    np.savez(tmp_path / "whole.npz", depth=np.ones((2, 300, 400)))
    (tmp_path / "half.npz").write_bytes((tmp_path / "whole.npz").read_bytes()[:500])
    for name in ("words.npy", "five.npy", "half.npz", "none.npy", "none.mkv"):
        with pytest.raises(ibr.FileFormatError, match=name):
            frames_in(tmp_path / name)


@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_one_frame_at_a_time_is_in_memory(tmp_path: Path, suffix: str):
    path = tmp_path / f"depth{suffix}"
    save: Any = np.save if suffix == ".npy" else np.savez
    save(path, np.ones((64, 100, 200), np.float32))  # 5.1 MB, 80 kB per frame
    tracemalloc.start()
    for depth in DepthFrames(path).read(range(64)):
        assert depth.shape == (100, 200)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 1_000_000  # bytes: a few frames, and zipfile's buffers


def test_a_folder_of_two_films(tmp_path: Path):
    camera = ibr.Camera([[50, 0, 30], [0, 50, 18], [0, 0, 1]], (WIDTH, HEIGHT))
    camera.save(tmp_path / "camera.json")
    colors = np.random.default_rng(3).integers(0, 256, (COUNT, HEIGHT, WIDTH, 3)).astype(np.uint8)
    ibr.write_video(tmp_path / "color.mkv", colors, 30)
    np.savez(tmp_path / "depth.npz", depth=counts(12))
    np.savetxt(tmp_path / "poses.txt", [[1, 0, 0, 0.1 * k, 0, 1, 0, 0, 0, 0, 1, 0] for k in range(COUNT)])
    views = ibr.load(tmp_path, depth_scale=1000)
    np.testing.assert_array_equal([view.color for view in views], colors)
    np.testing.assert_array_equal([view.depth for view in views], in_metres(counts(12)))
    assert [float(view.camera.center[0]) for view in views] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])
    recording = recording_in(tmp_path)
    last = shots_of(recording, cameras_of(recording))[4]
    assert last is not None
    np.testing.assert_array_equal(last.read_depth(depth_scale=1000)[0], in_metres(counts(12))[4])
    np.savez(tmp_path / "depth.npz", depth=counts(12)[:3])
    with pytest.raises(ibr.ArgumentError, match="a depth for each of the 5 frames"):
        recording_in(tmp_path)


def test_the_array_of_a_folder_of_two_films_is_named(tmp_path: Path):
    ibr.write_video(tmp_path / "color.mkv", np.zeros((2, HEIGHT, WIDTH, 3), np.uint8), 30)
    np.savez(tmp_path / "depth.npz", near=np.ones((2, HEIGHT, WIDTH)), far=np.full((2, HEIGHT, WIDTH), 9.0))
    views = ibr.load(tmp_path, camera=ibr.Camera.from_fov((WIDTH, HEIGHT), fov_x=60), channel="far")
    assert [float(view.depth[0, 0]) for view in views] == [9, 9]
    with pytest.raises(ibr.FileFormatError, match="no array 'depth' among near, far"):
        DepthFrames(tmp_path / "depth.npz")
