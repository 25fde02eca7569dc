"""Commands with cameras from photographs and files, and with depth of other kinds, sizes and scales."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import pyibr as ibr
from tests.app.commands import assert_one_line, run, succeeded
from tests.app.plane import SIZE, Scene


@pytest.mark.thorough
@pytest.mark.parametrize("clean", [(), ("--clean",)])
def test_depth_of_another_size_wants_its_own_camera(scene: Scene, clean: tuple[str, ...]):
    """Phones store depth with fewer samples than the picture has pixels, for the same view."""
    ibr.write_depth("small.npy", np.full((19, 31), 2, np.float32))
    words = ("--move", "0.2", "0", "0", "-o", "new.png", *clean)
    result = scene.run(*words, depth="small.npy", scale=None)
    assert_one_line(result, "depth: expected 61x37 samples", "or give --depth-camera", "got 31x19")
    scene.camera.resized((31, 19)).save("small.json")
    succeeded(scene.run(*words, "--depth-camera", "small.json", depth="small.npy", scale=None))
    new = ibr.read_color("new.png").astype(int)
    # The depth of the plane is known for 30 x 18 of its samples: for the whole picture except the margins.
    assert (np.abs(new[2:-2, 2:-8] - scene.color[2:-2, 7:-3]) <= 1).all()


@pytest.mark.parametrize("kind", ["distance", "inverse"])
def test_depth_may_be_stored_in_other_kinds(scene: Scene, kind: str):
    """Any kind of depth gives the same picture; output has the kind of the input."""
    move, new, out = ("--move", "0.2", "0", "0.1"), "new.png", "out.npy"
    assert scene.run(*move, "-o", new, "--depth-out", out).exit_code == 0
    expected, depth = ibr.read_color(new), ibr.read_depth(out, depth_scale=1000)
    target = scene.camera.moved(0.2, 0, 0.1)
    ibr.write_depth("other.npy", scene.depth, depth_scale=1000, depth_kind=kind, camera=scene.camera)
    succeeded(scene.run(*move, "-o", new, "--depth-out", out, "--depth-kind", kind, depth="other.npy"))
    assert (np.abs(ibr.read_color(new).astype(int) - expected) <= 1).all()
    np.testing.assert_allclose(ibr.read_depth(out, depth_scale=1000, depth_kind=kind, camera=target), depth, rtol=1e-5)
    words = ("--max-error", "0.001", "-o", "new.ply", "--depth-kind", kind)
    assert scene.run(*words, depth="other.npy", command="mesh").exit_code == 0
    np.testing.assert_allclose(ibr.Mesh.load("new.ply").vertices[:, 2], 2, rtol=1e-5)
    words = ("--depth-camera", "camera.json", "--color-camera", "camera.json", "--depth-kind", kind)
    assert run("register", "other.npy", *words, scale=1000, output=out).exit_code == 0
    np.testing.assert_allclose(ibr.read_depth(out), ibr.read_depth("other.npy"), rtol=1e-5)


def test_cameras_of_files_have_their_lenses(scene: Scene):
    lens = ibr.Lens("brown_conrady", [-0.2, 0.05, 0, 0])
    ibr.Camera(scene.camera.K, SIZE, lens=lens).save("bent.json")
    new, depth = "new.png", "depth_new.npy"
    succeeded(scene.run("--move", "0.2", "0", "0.1", "-o", new, "--depth-out", depth, camera="bent.json"))
    view = ibr.DepthImage(scene.color, scene.depth, ibr.Camera.load("bent.json"))
    frame = ibr.warp(view, view.camera.moved(0.2, 0, 0.1))
    np.testing.assert_array_equal(ibr.read_color(new), frame.color)
    np.testing.assert_allclose(ibr.read_depth(depth, depth_scale=1000)[frame.valid], 1.9, rtol=1e-6)
    succeeded(scene.run("--to", "camera.json", "-o", new, camera="bent.json"))
    succeeded(scene.run("--max-error", "0.01", "-o", "new.ply", camera="bent.json", command="mesh"))


def test_a_photo_without_a_camera_gets_one_that_is_told(scene):
    plain, photo, of_plane = "color.png", "photo.jpg", "plane.jpg"
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 26
    Image.fromarray(scene.color).save(photo, exif=exif)
    exif = Image.Exif()  # focal length 4 mm, 100 sensor pixels per mm; the photo has half the width
    exif.get_ifd(0x8769).update({0x920A: 4.0, 0xA20E: 1000.0, 0xA210: 3, 0xA002: 2 * SIZE[0]})
    Image.fromarray(scene.color).save(of_plane, exif=exif)
    asks = "assumed 60 degrees across; else set --camera, --fov or --focal-35mm"
    cases = (
        ([plain], ibr.Camera.from_fov(SIZE, fov_x=60), asks),
        ([plain, "--fov", 90], ibr.Camera.from_fov(SIZE, fov_x=90), ""),
        ([plain, "--focal-35mm", 50], ibr.Camera.from_fov(SIZE, focal_35mm=50), ""),
        ([photo], ibr.Camera.from_fov(SIZE, focal_35mm=26), "lens of 26 mm (on 35 mm film) by its EXIF data"),
        ([of_plane], ibr.Camera([[200, 0, 30], [0, 200, 18], [0, 0, 1]], SIZE), "mm (on 35 mm film) by its EXIF data"),
    )
    for (picture, *options), camera, told in cases:
        words = (picture, "depth.npy", "--move", 0.2, 0, 0, "--depth-out", "new.npy", *options)
        result = run("warp", *words, output="new.png")
        assert result.exit_code == 0, result.output
        assert told in result.stderr and (told or not result.stderr)
        expected = ibr.warp(ibr.DepthImage(None, scene.depth, camera), camera.moved(0.2, 0, 0)).depth
        # The focal length is rounded to float32.
        np.testing.assert_allclose(ibr.read_depth("new.npy"), expected, rtol=1e-5)
    result = scene.run("--fov", 50, "--move", 0, 0, 0, "-o", "new.png")
    assert_one_line(result, "--fov: expected none together with --camera")


def test_relative_depth_is_sharpened_and_lies_between_near_and_far(scene):
    x = np.arange(SIZE[0])
    level = np.tile(np.interp(x, [27, 33], [200, 20]), (SIZE[1], 1))
    new = "new.npy"
    for values, suffix in ((level.astype(np.uint8), "png"), ((257 * level).astype(np.uint16), "png"), (level, "npy")):
        file = f"level.{suffix}"
        np.save(file, values) if suffix == "npy" else Image.fromarray(values).save(file)
        line = ["--depth-is", "relative", "--near", 2, "--move", 0, 0, 0, "-o", "n.png", "--depth-out", new]
        assert "depth from 2 to 8" in succeeded(scene.run(*line, "--far", 8, depth=file, scale=None))
        depth = ibr.read_depth(new)
        assert set(np.unique(depth.round(3))) == {2, 8}  # no depths between the two surfaces remain
        result = scene.run(*line, "--no-sharpen", depth=file, scale=None)
        assert "depth from 2 to 10" in result.stdout and len(np.unique(ibr.read_depth(new).round(3))) > 4


def test_what_is_out_of_scale_is_told(scene):
    for move, is_told in ((1e-3, True), (0.1, False), (21, True)):
        result = scene.run("--move", move, 0, 0, "-o", "n.png")
        assert (result.exit_code == 0 and "depth from 2 to 2" in result.stdout) or move > 20
        assert ("--move: moves by" in result.stderr) == is_told
    scene.camera.resized((122, 74)).save("large.json")
    result = scene.run("--move", 0.1, 0, 0, "-o", "n.png", camera="large.json")
    assert_one_line(result, "--camera: expected a camera of 61x37 pixels", "Camera.resized", "a camera of 122x74")


def test_warnings_are_told_in_a_line(scene):
    Path("K.txt").write_text("30 0 50\n0 18 50\n0 0 1\n")
    result = scene.run("--move", 0.1, 0, 0, "-o", "n.png", camera="K.txt")
    assert "pyibr: K: fx, fy = 30, 18 and cx, cy = 50, 50 look exchanged" in result.stderr
    assert "Warning" not in result.stderr


def test_a_camera_of_a_file_is_named_behind_it(scene):
    data = {"left": scene.camera.to_json(), "right": scene.camera.moved(0.1, 0, 0).to_json()}
    Path("rig.json").write_text(json.dumps(data))
    for name in ("left", "right"):
        succeeded(scene.run("--move", 0.1, 0, 0, "-o", f"{name}.png", camera=f"rig.json#{name}"))
    result = scene.run("--move", 0.1, 0, 0, "-o", "n.png", camera="rig.json")
    assert_one_line(result, "expected one camera, as ", "rig.json#NAME; got left, right")
