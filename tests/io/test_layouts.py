"""Layouts of recordings: what is read of a specimen of each lies on the scene's surface, in its colours.

Of each sample a layout's K, pose, depth and scale tell a point. The scene's colour there must be the sample's; and
warped from one frame to the other, colours must agree. Read by a neighbouring convention (y up, poses the other way
round, pixel centres half a pixel aside, another scale) they do not.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pyibr.io.layouts import recording_in
from pyibr.io.recordings import cameras_of, shots_of
from tests.io.layouts import GL, NORMAL, OFFSET, SPECIMENS

Frame = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def frames_of(folder: Path) -> list[Frame]:
    """Colours, depth, K and pose of the frames that can be used; where depth has fewer samples, of these."""
    recording = recording_in(folder)
    found = []
    for shot in shots_of(recording, cameras_of(recording)):
        if shot is not None:
            color, (depth, _) = shot.stored.color(shot.color), shot.read_depth(None, "z", None)
            camera = shot.depth_camera or shot.camera
            if color.dtype != np.uint8:
                color = np.rint(255 * color)
            step = color.shape[0] // depth.shape[0]  # a coarse sample is as large as so many pixels
            small = color.reshape(depth.shape[0], step, depth.shape[1], step, 3).mean((1, 3))
            found.append((small, depth.astype(np.float64), camera.K, camera.world_from_camera))
    return found


def points_of(frame: Frame) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) of the samples, and (N, 3) their colours."""
    color, depth, K, pose = frame
    y, x = np.nonzero(np.isfinite(depth) & (depth > 0))
    local = np.column_stack([x, y, np.ones(len(x))]) @ np.linalg.inv(K).T * depth[y, x, None]
    return local @ pose[:3, :3].T + pose[:3, 3], color[y, x]


def scene_colors(points: np.ndarray) -> np.ndarray:
    waves = [np.sin(5 * points[:, 0] + k) * np.cos(4 * points[:, 1] - k) for k in range(3)]
    return 127.5 + 110 * np.column_stack(waves)


def off_scene(frames: list[Frame]) -> float:
    """How far colours are from the scene's where samples lie, levels of 8 bits; a median."""
    each = [np.abs(scene_colors(points) - colors) for points, colors in map(points_of, frames)]
    return float(np.median(np.concatenate(each)))


def off_other(frames: list[Frame]) -> float:
    """How far the first frame's colours are from the second's where these show its samples; a median."""
    points, colors = points_of(frames[0])
    other, _, K, pose = frames[1]
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    x, y = (local[:, :2] / local[:, 2:] @ K[:2, :2].T + K[:2, 2]).T
    seen = (local[:, 2] > 0) & (x >= 0) & (y >= 0) & (x < other.shape[1] - 1) & (y < other.shape[0] - 1)
    if not seen.any():
        return np.inf
    x, y, colors = x[seen], y[seen], colors[seen]
    i, j = x.astype(int), y.astype(int)
    u, v = (x - i)[:, None], (y - j)[:, None]
    top, bottom = (other[j + k, i] * (1 - u) + other[j + k, i + 1] * u for k in (0, 1))
    return float(np.median(np.abs(top * (1 - v) + bottom * v - colors)))


def neighbours(frames: list[Frame]) -> dict[str, list[Frame]]:
    """The frames by neighbouring conventions."""
    found = {f"half a pixel {by:+}": [(c, z, shifted(K, by), p) for c, z, K, p in frames] for by in (-0.5, 0.5)}
    found |= {f"{by} times as deep": [(c, z * by, K, p) for c, z, K, p in frames] for by in (0.97, 1.03)}
    if len({pose.tobytes() for *_, pose in frames}) > 1:
        found["y up"] = [(c, z, K, p @ GL) for c, z, K, p in frames]
        found["world to camera"] = [(c, z, K, np.linalg.inv(p)) for c, z, K, p in frames]
    return found


def shifted(K: np.ndarray, by: float) -> np.ndarray:
    moved = K.copy()
    moved[:2, 2] += by
    return moved


@pytest.mark.parametrize("name", SPECIMENS)
def test_a_specimen_beats_its_neighbours_in_convention(tmp_path: Path, name):
    make, count = SPECIMENS[name]
    make(tmp_path / "it")
    frames = frames_of(tmp_path / "it")
    assert len(frames) == count
    points = np.concatenate([points_of(frame)[0] for frame in frames])
    # A stored unit, or a pixel of disparity in float32, is less than that
    assert np.abs(points @ NORMAL - OFFSET).max() < 0.006
    right = off_scene(frames)
    assert right < 1.5
    for convention, wrong in neighbours(frames).items():
        assert off_scene(wrong) > 1.5 * right, convention
    if len({pose.tobytes() for *_, pose in frames}) > 1:
        right = off_other(frames)
        assert right < 2
        turned = len({pose[:3, :3].tobytes() for *_, pose in frames}) > 1
        for convention, wrong in neighbours(frames).items():
            if turned or (
                "pixel" not in convention and "up" not in convention
            ):  # between parallel cameras these cancel
                assert off_other(wrong) > right, convention
