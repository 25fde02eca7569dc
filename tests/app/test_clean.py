"""`pyibr clean` equals the library's calls for frames, folders and recordings; errors are one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from pyibr.io.depth_frames import DepthFrames
from tests.app.commands import assert_one_line, places, run, succeeded
from tests.app.recorded import COUNT, SCALE, Recorded


class Delivered(Recorded):
    """A recording, for `pyibr clean`."""

    def clean(self, *words: object, output: object = "new.npy", scale: object = SCALE):
        """Run `pyibr clean`; words that name files in the folder become their paths."""
        given = [*(["--depth-scale", scale] if scale else []), "-o", self.folder / str(output)]
        return run("clean", *places(self.folder, words), *given)

    def stored(self, number: int) -> np.ndarray:
        return ibr.read_depth(self.folder / f"depth/{number}.png", depth_scale=SCALE)

    def written(self, name: str) -> np.ndarray:
        return ibr.read_depth(self.folder / name, depth_scale=SCALE)


@pytest.fixture
def delivered(tmp_path: Path) -> Delivered:
    return Delivered(tmp_path)


def test_one_frame_and_what_was_not_measured(delivered: Delivered):
    asked = "--color", "rgb/0.png", "--holes", 3, "--strength", 0.5, "--invented-out", delivered.folder / "seen.png"
    out = succeeded(delivered.clean("depth/0.png", *asked))
    expected = ibr.clean_depth(delivered.stored(0), delivered.colors[0], holes=3, strength=0.5)
    made = delivered.written("new.npy")
    np.testing.assert_allclose(made, expected.depth, rtol=1e-6)  # which allows for the scale's rounding
    found = ibr.read_color(delivered.folder / "seen.png")[..., 0] == 255
    np.testing.assert_array_equal(found, expected.invented)
    assert f"new.npy: 62x38, {np.isfinite(expected.depth).mean():.1%} covered" in out


def test_frames_of_a_folder_keep_their_names_and_know_the_last_one(delivered: Delivered):
    """Without poses, the camera is assumed to stand still, so the frame before helps to clean the next."""
    succeeded(delivered.clean("depth", "--take", "1:4", "--far", 1.5, output="cleaned"))
    before = None
    for number in range(1, COUNT):
        before = ibr.clean_depth(delivered.stored(number), before=before).depth
        near = np.where(before < 1.5, before, np.float32(np.nan))
        found = delivered.written(f"cleaned/{number}.png")
        np.testing.assert_array_equal(np.isfinite(found), np.isfinite(near))
        np.testing.assert_allclose(found, near, atol=0.51 / SCALE)  # rounded to whole units
    assert len(list((delivered.folder / "cleaned").iterdir())) == 3


@pytest.mark.parametrize("name", ["depth.mkv", "depth.npy"])
def test_frames_of_one_file(delivered: Delivered, name):
    counts = np.stack([ibr.uint16_from_depth(delivered.stored(number), SCALE) for number in range(COUNT)])
    if name == "depth.npy":
        np.save(delivered.folder / name, counts)
    else:
        ibr.write_video(delivered.folder / name, counts, 30, bits=16)
    succeeded(delivered.clean(name, "--take", "0:2", output="cleaned.mkv"))
    before = None
    for depth in DepthFrames(delivered.folder / "cleaned.mkv").read(range(2), depth_scale=SCALE):
        before = ibr.clean_depth(delivered.stored(0 if before is None else 1), before=before).depth
        np.testing.assert_allclose(depth, before, atol=0.51 / SCALE)
    assert_one_line(delivered.clean(name, output="cleaned"), "--output: expected a name to number, or .mkv")


def test_a_recording_tells_colours_and_where_the_camera_was(delivered: Delivered):
    out = succeeded(delivered.clean(".", "--take", ":2"))
    first = ibr.clean_depth(delivered.stored(0), delivered.colors[0]).depth
    carried = ibr.warp(ibr.DepthImage(None, first, delivered.cameras[0]), delivered.cameras[1]).depth
    second = ibr.clean_depth(delivered.stored(1), delivered.colors[1], before=carried).depth
    for number, depth in enumerate((first, second)):
        np.testing.assert_allclose(delivered.written(f"new_{number:04d}.npy"), depth, rtol=1e-6)
    assert "2 frames, 62x38" in out


def test_distances_stay_distances(delivered: Delivered):
    kind = ("--depth-kind", "distance", "--camera", "camera.json")
    how = {"depth_kind": "distance", "camera": delivered.base}
    ibr.write_depth(delivered.folder / "far.npy", delivered.depths[0], **how)
    succeeded(delivered.clean("far.npy", *kind, scale=None))
    expected = ibr.clean_depth(ibr.read_depth(delivered.folder / "far.npy", **how)).depth
    np.testing.assert_allclose(ibr.read_depth(delivered.folder / "new.npy", **how), expected, rtol=1e-5)
    refused = delivered.clean("far.npy", "--depth-kind", "distance", scale=None)
    assert_one_line(refused, "--camera: expected the camera of the depth for --depth-kind distance, or --fov")


def test_noise_of_disparity_is_told_by_pixels_and_baseline(delivered: Delivered):
    told, camera = ("--noise", 0.5, "--baseline", 0.1), ("--camera", "camera.json")
    succeeded(delivered.clean("depth/0.png", *told, *camera))
    noise = ibr.disparity_noise(0.5, delivered.base.K[0, 0], 0.1)
    expected = ibr.clean_depth(delivered.stored(0), noise=noise).depth
    np.testing.assert_allclose(delivered.written("new.npy"), expected, rtol=1e-6)
    assert not np.allclose(expected, ibr.clean_depth(delivered.stored(0)).depth, rtol=1e-4)
    assert_one_line(delivered.clean("depth/0.png", *told), "--camera: expected the camera of the depth for --noise")
    assert_one_line(delivered.clean("depth/0.png", "--noise", 0.5), "--baseline: expected a number > 0 together with")


def test_disparity_stays_disparity_of_principal_points_apart(delivered: Delivered):
    """Middlebury's disparity has an offset between principal points, given by an option or by the layout."""
    focal, baseline, doffs = 70.0, 0.1, 4.0
    disparity = ibr.disparity_from_depth(delivered.stored(0), focal, baseline, offset=doffs)
    ibr.write_depth(delivered.folder / "bury/disp0.pfm", np.where(np.isfinite(disparity), disparity, np.inf))
    ibr.write_color(delivered.folder / "bury/im0.png", delivered.colors[0])
    calibration = f"cam0=[{focal} 0 30.5; 0 {focal} 18.5; 0 0 1]\ndoffs={doffs}\nbaseline={1000 * baseline}\n"
    (delivered.folder / "bury/calib.txt").write_text(calibration)
    expected = ibr.clean_depth(delivered.stored(0), delivered.colors[0]).depth
    expected = ibr.disparity_from_depth(expected, focal, baseline, offset=doffs)
    told = "--depth-kind", "inverse", "--depth-offset", doffs, "--color", "rgb/0.png"
    succeeded(delivered.clean("bury/disp0.pfm", *told, scale=focal * baseline))
    succeeded(delivered.clean("bury", scale=None, output="cleaned"))
    for name in ("new.npy", "cleaned/disp0.pfm"):
        np.testing.assert_allclose(ibr.read_depth(delivered.folder / name), expected, rtol=1e-5, atol=1e-5)


def test_what_has_no_depth_is_told_by_the_status(delivered: Delivered):
    np.save(delivered.folder / "none.npy", np.zeros((38, 62), np.float32))
    result = delivered.clean("none.npy", scale=None)
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
def test_mistakes_are_told_in_a_line(delivered: Delivered, words, said):
    assert_one_line(delivered.clean(*words), *said, progress="Cleaning")
    assert not list(delivered.folder.glob("new*"))


def test_nothing_is_written_over_what_is_read(delivered: Delivered):
    assert_one_line(delivered.clean("depth", output="depth"), "--output: expected a", "depth")
    assert_one_line(delivered.clean("depth/0.png", output="depth/0.png"), "--output: expected a file of its own")
    assert_one_line(delivered.clean("depth/0.png", output="new.xyz"), "new.xyz: no depth format")
    assert_one_line(delivered.clean("depth/0.png", scale=None, output="new.png"), "--depth-scale")
