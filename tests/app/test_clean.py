"""`pyibr clean` equals the library's calls for frames, folders and recordings; errors are one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from pyibr.io.depth_frames import DepthFrames
from tests.app.commands import assert_one_line, run, succeeded
from tests.app.recorded import COUNT, SCALE, Recorded


def clean(*words: object, output: object = "new.npy", scale: object = SCALE):
    return run("clean", *words, scale=scale, output=output)


def written(name: str) -> np.ndarray:
    return ibr.read_depth(name, depth_scale=SCALE)


def test_one_frame_and_what_was_not_measured(recorded: Recorded):
    asked = "--color", "rgb/0.png", "--holes", 3, "--strength", 0.5, "--invented-out", "seen.png"
    out = succeeded(clean("depth/0.png", *asked))
    expected = ibr.clean_depth(recorded.depth(0), recorded.colors[0], holes=3, strength=0.5)
    made = written("new.npy")
    np.testing.assert_allclose(made, expected.depth, rtol=1e-6)  # which allows for the scale's rounding
    found = ibr.read_color("seen.png")[..., 0] == 255
    np.testing.assert_array_equal(found, expected.invented)
    assert f"new.npy: 62x38, {np.isfinite(expected.depth).mean():.1%} covered" in out


def test_frames_of_a_folder_keep_their_names_and_know_the_last_one(recorded: Recorded):
    """Without poses, the camera is assumed to stand still, so the frame before helps to clean the next."""
    succeeded(clean("depth", "--take", "1:4", "--far", 1.5, output="cleaned"))
    before = None
    for number in range(1, COUNT):
        before = ibr.clean_depth(recorded.depth(number), before=before).depth
        near = np.where(before < 1.5, before, np.float32(np.nan))
        found = written(f"cleaned/{number}.png")
        np.testing.assert_array_equal(np.isfinite(found), np.isfinite(near))
        np.testing.assert_allclose(found, near, atol=0.51 / SCALE)  # rounded to whole units
    assert len(list(Path("cleaned").iterdir())) == 3


@pytest.mark.parametrize("name", ["depth.mkv", "depth.npy"])
def test_frames_of_one_file(recorded: Recorded, name):
    counts = np.stack([ibr.uint16_from_depth(recorded.depth(number), SCALE) for number in range(COUNT)])
    if name == "depth.npy":
        np.save(name, counts)
    else:
        ibr.write_video(name, counts, 30, bits=16)
    succeeded(clean(name, "--take", "0:2", output="cleaned.mkv"))
    before = None
    for depth in DepthFrames("cleaned.mkv").read(range(2), depth_scale=SCALE):
        before = ibr.clean_depth(recorded.depth(0 if before is None else 1), before=before).depth
        np.testing.assert_allclose(depth, before, atol=0.51 / SCALE)
    assert_one_line(clean(name, output="cleaned"), "--output: expected a name to number, or .mkv")


def test_a_recording_tells_colours_and_where_the_camera_was(recorded: Recorded):
    out = succeeded(clean(".", "--take", ":2"))
    first = ibr.clean_depth(recorded.depth(0), recorded.colors[0]).depth
    carried = ibr.warp(ibr.DepthImage(None, first, recorded.cameras[0]), recorded.cameras[1]).depth
    second = ibr.clean_depth(recorded.depth(1), recorded.colors[1], before=carried).depth
    for number, depth in enumerate((first, second)):
        np.testing.assert_allclose(written(f"new_{number:04d}.npy"), depth, rtol=1e-6)
    assert "2 frames, 62x38" in out


def test_distances_stay_distances(recorded: Recorded):
    kind = ("--depth-kind", "distance", "--camera", "camera.json")
    how = {"depth_kind": "distance", "camera": recorded.base}
    ibr.write_depth("far.npy", recorded.depths[0], **how)
    succeeded(clean("far.npy", *kind, scale=None))
    expected = ibr.clean_depth(ibr.read_depth("far.npy", **how)).depth
    np.testing.assert_allclose(ibr.read_depth("new.npy", **how), expected, rtol=1e-5)
    refused = clean("far.npy", "--depth-kind", "distance", scale=None)
    assert_one_line(refused, "--camera: expected the camera of the depth for --depth-kind distance, or --fov")


def test_noise_of_disparity_is_told_by_pixels_and_baseline(recorded: Recorded):
    told, camera = ("--noise", 0.5, "--baseline", 0.1), ("--camera", "camera.json")
    succeeded(clean("depth/0.png", *told, *camera))
    noise = ibr.disparity_noise(0.5, recorded.base.K[0, 0], 0.1)
    expected = ibr.clean_depth(recorded.depth(0), noise=noise).depth
    np.testing.assert_allclose(written("new.npy"), expected, rtol=1e-6)
    assert not np.allclose(expected, ibr.clean_depth(recorded.depth(0)).depth, rtol=1e-4)
    assert_one_line(clean("depth/0.png", *told), "--camera: expected the camera of the depth for --noise")
    assert_one_line(clean("depth/0.png", "--noise", 0.5), "--baseline: expected a number > 0 together with")


def test_disparity_stays_disparity_of_principal_points_apart(recorded: Recorded):
    """Middlebury's disparity has an offset between principal points, given by an option or by the layout."""
    focal, baseline, doffs = 70.0, 0.1, 4.0
    disparity = ibr.disparity_from_depth(recorded.depth(0), focal, baseline, offset=doffs)
    ibr.write_depth("bury/disp0.pfm", np.where(np.isfinite(disparity), disparity, np.inf))
    ibr.write_color("bury/im0.png", recorded.colors[0])
    calibration = f"cam0=[{focal} 0 30.5; 0 {focal} 18.5; 0 0 1]\ndoffs={doffs}\nbaseline={1000 * baseline}\n"
    Path("bury/calib.txt").write_text(calibration)
    expected = ibr.clean_depth(recorded.depth(0), recorded.colors[0]).depth
    expected = ibr.disparity_from_depth(expected, focal, baseline, offset=doffs)
    told = "--depth-kind", "inverse", "--depth-offset", doffs, "--color", "rgb/0.png"
    succeeded(clean("bury/disp0.pfm", *told, scale=focal * baseline))
    succeeded(clean("bury", scale=None, output="cleaned"))
    for name in ("new.npy", "cleaned/disp0.pfm"):
        np.testing.assert_allclose(ibr.read_depth(name), expected, rtol=1e-5, atol=1e-5)


def test_what_has_no_depth_is_told_by_the_status(recorded: Recorded):
    np.save("none.npy", np.zeros((38, 62), np.float32))
    result = clean("none.npy", scale=None)
    assert result.exit_code == 3 and "is empty: it has no depth" in result.stderr


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("gone.png",), ("gone.png", "no such file")),
        (("depth/0.png", "--color", "gone.png"), ("gone.png", "no such file")),
        (("depth/0.png", "--color", "rgb"), ("DEPTH: expected a folder",)),
        (("depth", "--take", "9:"), ("--take: expected some of the 4 frames",)),
        (("depth", "--holes", "-1"), ("--holes: expected",)),
        (("depth/0.png", "--strength", "11"), ("--strength: expected a number from 0 to 10",)),
        (("depth/0.png", "--depth-channel", "z"), ("--depth-channel",)),
        (("rgb/0.png",), ("rgb/0.png",)),
        (("cameras",), ("cameras: no file of depth in it",)),
        (("depth/0.png", "--invented-out", "new.pfm"), ("new.pfm: no image format",)),
        (("depth/0.png", "--fov", "200"), ("--fov",)),
        (("depth/0.png", "--device", "none such"), ("none such",)),
    ],
)
def test_mistakes_are_told_in_a_line(recorded: Recorded, words, said):
    assert_one_line(clean(*words), *said, progress="Cleaning")
    assert not list(Path().glob("new*"))


def test_nothing_is_written_over_what_is_read(recorded: Recorded):
    assert_one_line(clean("depth", output="depth"), "--output: expected a", "depth")
    assert_one_line(clean("depth/0.png", output="depth/0.png"), "--output: expected a file of its own")
    assert_one_line(clean("depth/0.png", output="new.xyz"), "new.xyz: no depth format")
    assert_one_line(clean("depth/0.png", scale=None, output="new.png"), "--depth-scale")
