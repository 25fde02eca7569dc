"""The benchmark of depth cameras: its scenes, its maps for OpenCV's remap, and its sections of the report."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from benchmarks import scenes
from benchmarks.cases import FULL, QUICK
from benchmarks.cleaning import cleaning
from benchmarks.results import Record, Result, Skip
from benchmarks.warp import filling, opencv, registration, rgbd, rgbd_uses, steady
from benchmarks.warp.opencv import Task
from pyibr.images import metrics
from tests.benchmarks.test_report import ENVIRONMENT, reported
from tests.reference.edges import edges_of

SCENES = [scenes.ROOM, scenes.LIVINGROOM]
SIZE = (131, 77)  # relatively wider than the camera's picture


def view(scene: str, number: int, size: tuple[int, int] = SIZE, noise: float = 0.0):
    if scene == scenes.ROOM:
        pytest.importorskip("open3d", exc_type=ImportError)
    elif not (scenes.data_folder() / "rgbd_livingroom1").is_dir():
        pytest.skip(f"needs {scene}")
    found = scenes.rgbd(scene, number, size, noise)
    assert not isinstance(found, Skip)
    return found


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("size", [SIZE, (640, 480), (211, 208)], ids=scenes.shown)
def test_frames_of_a_scene_are_of_one_world(scene: str, size: tuple[int, int]) -> None:
    """Poses, K and depth of scaled and cropped frames belong together: warped to another frame's camera, they agree."""
    source, target = view(scene, 0, size), view(scene, 4, size)
    assert source.camera.size == size and source.color.shape == (size[1], size[0], 3)
    task = Task(source.color, source.depth, source.camera, target.camera)
    frame = task.ours(edges="cut")
    both = frame.valid & target.valid & (np.abs(frame.depth - target.depth) < 0.02 * target.depth)
    assert both.mean() > 0.75
    # The living room's depth is in whole millimetres. 6 levels of 255: at a small size, edges fill much of the picture.
    assert metrics.median_depth_error(frame.depth, target.depth, valid=both) <= 1e-3
    assert metrics.median_color_error(frame.color, target.color, valid=both) <= 6


@pytest.mark.parametrize("scene", SCENES)
def test_noise_is_of_the_disparity_and_in_steps(scene: str) -> None:
    clean, noisy = view(scene, 0), view(scene, 0, noise=0.5)
    assert np.array_equal(clean.color, noisy.color)
    scale = clean.camera.K[0, 0] * 0.075
    with np.errstate(divide="ignore"):
        exact, found = scale / clean.depth.astype(float), scale / noisy.depth.astype(float)
    both = clean.valid & noisy.valid & (exact > 2.5)  # over five sigmas, so that no disparity is negative
    np.testing.assert_allclose(8 * found[both], np.round(8 * found[both]), atol=1e-4)
    # Noise has a deviation of 0.5, and rounding to eighths one of 1/8 / sqrt(12). The samples give it to a few percent.
    assert (found - exact)[both].std() == pytest.approx(np.hypot(0.5, 0.125 / np.sqrt(12)), rel=0.08)
    assert not (noisy.valid & ~clean.valid).any()


@pytest.mark.parametrize("motion", ["0 to 50", "50 to 0"])
def test_maps_for_opencv_read_the_source_where_our_frame_does(motion: str) -> None:
    """They do although the cameras are turned relative to each other."""
    import cv2

    source, target = (view(scenes.ROOM, int(number), (320, 240)) for number in motion.split(" to "))
    task = Task(source.color, source.depth, source.camera, target.camera, {"edges": "cut"})
    across, down = opencv.source_positions(task)
    frame = task.ours(edges="cut")
    assert np.array_equal(across >= 0, frame.valid)
    read = cv2.remap(task.color, across, down, cv2.INTER_LINEAR)
    off = np.abs(read.astype(int) - frame.color).max(axis=2)[frame.valid]
    assert frame.valid.mean() > 0.4
    # Torn cells are left out, since pyibr does not interpolate across edges of objects.
    torn = edges_of(source)
    whole = ~(torn.right[:-1, :-1] | torn.right[1:, :-1] | torn.below[:-1, :-1] | torn.below[:-1, 1:])
    x, y = (np.clip(a.astype(int), 0, n - 2) for a, n in zip((across, down), source.camera.size, strict=True))
    within = whole[y, x][frame.valid]
    assert within.mean() > 0.9
    assert np.quantile(off[within], 0.98) <= 2


def test_warp_frame_means_the_same_warp() -> None:
    source, target = (view(scenes.ROOM, number, (320, 240)) for number in (0, 50))
    task = Task(source.color, source.depth, source.camera, target.camera)
    records = list(opencv.sameness(task, rgbd.NEAREST, rgbd.OURS[rgbd.NEAREST], {}))
    (difference,) = (record.values[0] for record in records if record.quantity == "median depth difference")
    assert difference < 0.005  # warpFrame rounds positions to whole pixels


def canned(linear: float) -> Result:
    """A made-up result: warpFrame takes 10 ms.

    pyibr linear takes ``linear`` times as long without noise. pyibr nearest takes half as long, in one row four times.
    """
    result = Result("rgbd", ENVIRONMENT)
    for size, noise, (kind, motions) in itertools.product(
        ("640 x 480", "3840 x 2160"), (0.0, 0.3), rgbd.MOTIONS.items()
    ):
        for motion in motions:
            here = {"case": "warp", "scene": scenes.ROOM, "size": size, "noise": noise, "kind": kind, "motion": motion}
            worst = size == "3840 x 2160" and noise == 0.3 and motion == "from 50"
            factors = {rgbd.LINEAR: linear + noise, rgbd.NEAREST: 4.0 if worst else 0.5, opencv.BASE: 1.0}
            for subject, factor in factors.items():
                values = [10 * factor * f for f in (0.9, 1.0, 1.3)]
                result.records.append(Record(subject, "end to end", "ms", here, values))
            result.records.append(Record(rgbd.LINEAR, "kernels", "ms", here, [3.0]))
            for subject in (rgbd.NEAREST, opencv.BASE):
                result.records.append(Record(subject, "coverage", "share", here, [0.5]))
            result.records.append(Record(opencv.BASE, "median depth difference", "share", here, [0.01]))
    return result


def test_section_names_the_worst_row_and_which_bars_are_met(tmp_path: Path) -> None:
    text = reported(canned(linear=0.7), tmp_path)
    assert (
        "pyibr nearest, 3840 x 2160, 0.3 pixels of noise, 7 cm sideways, from 50: **4.00 times** the\ntime of" in text
    )
    assert "1 of 40 rows of pyibr are slower than cv2.warpFrame." in text
    assert "| from pose to pose | 640 x 480 | 0 | 0.70 | at most 0.8 | met |" in text
    assert "| from pose to pose | 640 x 480 | 0.3 | 1.00 | at most 1.2 | met |" in text
    assert "| 7 cm sideways | 640 x 480 | 0 | 0.70 | at most 0.6 | **not met** |" in text
    assert "| 7 cm sideways | 3840 x 2160 | 0.3 | 1.00 |  |  | 2.25 |" in text
    assert "These figures were published by others" in text
    assert (tmp_path / "rgbd.png").stat().st_size > 5000


def test_uses_are_judged_by_their_bars(tmp_path: Path) -> None:
    result = Result("rgbd", ENVIRONMENT)

    def add(case: str, subject: str, quantity: str, values: list[float], **parameters: str | int | float) -> None:
        unit = "share" if quantity == "coverage" else "ms"
        result.records.append(Record(subject, quantity, unit, {"case": case, "size": "64 x 64", **parameters}, values))

    for count, time in zip(rgbd_uses.THREADS, (5.0, 3.0), strict=True):
        add("threads", "resolve", "kernel", [time], noise=0.3, threads=count)
        add("threads", "epipolar_sweep", "kernel", [time + 1], noise=0.3, threads=count)
    for subject, time in ((rgbd_uses.SMOOTH, 1.0), (rgbd_uses.NOISE, 3.9)):
        add("white noise", subject, "resolve", [time], edges="connect")
        add("white noise", subject, "coverage", [0.9], edges="connect")
    add("stereo", "cut", "end to end", [20.0], noise=0.1)
    add("light field", rgbd_uses.ONE_CALL, "end to end", [5.0], views=48, view="fresh")
    add("light field", rgbd_uses.SINGLE, "end to end", [10.0], views=48, view="fresh")
    for subject, time in ((rgbd_uses.PLAIN, 4.0), ("origins", 4.4), ("classes", 6.4)):
        add("told", subject, "end to end", [time], motion="0 to 50", view="kept")
    add("small", rgbd_uses.FRESH, "end to end", [0.36])
    add("small", rgbd_uses.KEPT, "end to end", [0.2])
    text = reported(result, tmp_path)
    assert "| all | 11.0 | 7.00 | 1.57 | at least 1.85 | **not met** |" in text
    assert "| 3.90 | at most 4 | met |" in text
    assert "| 50 | at least 60 | **not met** |" in text
    assert "| 0.50 | at most 0.6 | met |" in text
    assert "| 1.10 | at most 1.15 | met |" in text
    assert "| 1.60 | at most 1.5 | **not met** |" in text
    assert "| fresh | 0.360 (0.360 to 0.360) | at most 0.35 | **not met** |" in text
    assert "| kept | 0.200 (0.200 to 0.200) |  |  |" in text


def test_what_changes_over_time_is_judged_by_the_input(tmp_path: Path) -> None:
    result = Result("rgbd", ENVIRONMENT)

    def add(subject: str, where: str, fill: str, depth: float, color: float) -> None:
        at = {"case": "steady", "size": "64 x 64", "motion": "0 to 4", "frames": 30, "where": where, "fill": fill}
        result.records.append(Record(subject, steady.DEPTH, "scene units", at, [depth]))
        result.records.append(Record(subject, steady.COLOR, "share", at, [color / 255]))

    add(steady.INPUT, steady.INPUT, "", 0.020, 2.0)
    for fill, color in zip(steady.FILLS, (1.9, 2.0, 2.1), strict=True):
        for subject in (steady.RAW, steady.SINGLE, steady.STEADY):
            add(subject, steady.SEEN, fill, 0.010, 1.5)
            add(subject, steady.HOLES, fill, 0.015, color)
    text = reported(result, tmp_path)
    assert "A camera at rest takes 30 frames" in text
    assert f"| background | {steady.STEADY} | 10.0 | 1.50 | 15.0 | 1.90 | met |" in text
    assert f"| inpaint | {steady.STEADY} | 10.0 | 1.50 | 15.0 | 2.10 | **not met** |" in text
    assert f"| inpaint | {steady.RAW} | 10.0 | 1.50 | 15.0 | 2.10 |  |" in text


def test_filling_is_judged_by_opencvs(tmp_path: Path) -> None:
    result = Result("filling", ENVIRONMENT)
    for motion, off in (("0 to 4", 17.0), ("4 to 0", 18.5)):
        at = {"scene": scenes.ROOM, "motion": motion}
        for subject, error in zip((*filling.FILLS, filling.TELEA), (off, 20.0, 19.0, 18.0), strict=True):
            result.records.append(Record(subject, filling.BETWEEN, "share", at, [error / 255]))
    text = reported(result, tmp_path)
    assert "| 0 to 4 | 17.0 | 20.0 | 19.0 | 18.0 | below cv2.inpaint | met |" in text
    assert "| 4 to 0 | 18.5 | 20.0 | 19.0 | 18.0 | below cv2.inpaint | **not met** |" in text


@pytest.mark.parametrize("name", scenes.STEREO)
def test_photographs_with_disparity_are_of_one_world(name: str) -> None:
    """Colours are off by at most 5.8 levels; backward warps by the given disparity are off by 3.0 to 5.3."""
    if not (scenes.data_folder() / "stereo_middlebury").is_dir():
        pytest.skip("needs the photographs")
    found = scenes.stereo(name)
    assert not isinstance(found, Skip)
    view, camera, right = found
    frame = ibr.warp(view, camera)
    assert frame.valid.mean() > 0.75
    assert metrics.median_color_error(frame.color, right, valid=frame.valid) <= 5.8


def test_registration_is_judged_by_its_bars(tmp_path: Path) -> None:
    result = Result("registration", ENVIRONMENT)
    for rig, size in itertools.product(registration.RIGS, ("640 x 480", "1280 x 720", "1920 x 1080")):
        at = {"scene": scenes.ROOM, "rig": rig, "size": size, "noise": 0.0}
        for subject in (registration.REGISTERED, registration.MILLIMETRES, registration.COLORS):
            result.records.append(Record(subject, "end to end", "ms", at, [7.5]))
        for subject in (opencv.REGISTER, registration.DILATED):
            result.records.append(Record(subject, "end to end", "ms", at, [10.0]))
        for subject in (registration.REGISTERED, opencv.REGISTER, registration.DILATED):
            result.records.append(Record(subject, "coverage", "share", at, [0.9]))
    text = reported(result, tmp_path)
    for bar in ("1 | met", "0.6 | **not met**", "1.2 | met", "0.7 | **not met**"):
        assert f"| 0.75 | at most {bar} | 90.0% |" in text
    assert "| 0.75 |  |  | 90.0% |" in text


def test_cleaning_is_judged_by_its_bars(tmp_path: Path) -> None:
    result = Result("cleaning", ENVIRONMENT)
    for size, took in (("640 x 480", 10.0), ("1280 x 720", 20.0), ("64 x 48", 10.0)):
        at = {"scene": scenes.ROOM, "size": size, "noise": 0.3}
        for subject in (cleaning.CLEANED, cleaning.STEADY, cleaning.BILATERAL):
            result.records.append(Record(subject, "end to end", "ms", at, [took]))
        result.records.append(Record(cleaning.TWIN, "end to end", "ms", at, [125.0]))
        for subject in (cleaning.CLEANED, cleaning.TWIN):
            result.records.append(Record(subject, "gain", "dB", at, [13.5]))
    text = reported(result, tmp_path)
    assert "| 0.08 | at most 0.1 | met | 13.5 dB |" in text
    assert "| 0.16 | at most 0.1 | **not met** | 13.5 dB |" in text
    assert "| 0.08 |  |  | 13.5 dB |" in text


def test_without_the_data_the_room_stands_in_and_the_report_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYIBR_DATA", str(tmp_path))
    plan = replace(QUICK, rgbd_scene=scenes.LIVINGROOM)
    cases = list(rgbd.cases(plan))
    skip = cases[0].prepare()
    assert isinstance(skip, Skip) and "stands in" in skip.reason
    assert {case.parameters["scene"] for case in cases if "scene" in case.parameters} == {scenes.ROOM}


def test_bars_are_of_cases_that_are_run() -> None:
    sizes = {scenes.shown(size) for size in FULL.rgbd}
    for kind, size, noise in rgbd.BARS:
        assert kind in rgbd.MOTIONS and size in sizes and noise in FULL.rgbd_noise
