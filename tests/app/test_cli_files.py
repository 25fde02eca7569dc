"""Commands protect files that they must not overwrite, accept all names of files, and can be interrupted."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

import pyibr as ibr
from tests.app.commands import assert_one_line
from tests.app.plane import Scene


def is_refused_before_the_work(scene: Scene, monkeypatch: pytest.MonkeyPatch, *arguments: object, **options) -> str:
    """Run `warp` or `mesh`; return its error. The command must not have drawn or written anything."""

    def work(*_: object, **__: object) -> None:
        raise AssertionError("at work")

    for name in ("warp", "DepthMesh", "read_color"):
        monkeypatch.setattr(ibr, name, work)
    before = {path: path.read_bytes() for path in scene.folder.rglob("*") if path.is_file()}
    result = scene.run(*arguments, **options)
    assert_one_line(result)
    assert before == {path: path.read_bytes() for path in scene.folder.rglob("*") if path.is_file()}
    return result.stderr.strip()


@pytest.mark.parametrize("name", ["color.png", "depth.png", "link.png", "hard.png", "folder/../color.png"])
@pytest.mark.parametrize("option", ["-o", "--depth-out", "--valid-out"])
def test_no_output_is_an_input(scene: Scene, monkeypatch: pytest.MonkeyPatch, option, name):
    (scene.folder / "folder").mkdir()
    (scene.folder / "link.png").symlink_to("depth.png")
    (scene.folder / "hard.png").hardlink_to(scene.folder / "color.png")
    others = () if option == "-o" else ("-o", scene.folder / "new.png")
    line = is_refused_before_the_work(scene, monkeypatch, "--orbit", 5, *others, option, scene.folder / name)
    assert "expected a file of its own, got " in line
    assert ("COLOR" in line) == (name in ("color.png", "hard.png", "folder/../color.png"))


def test_no_numbered_output_and_no_mesh_is_an_input(scene: Scene, monkeypatch: pytest.MonkeyPatch):
    (scene.folder / "color.png").rename(scene.folder / "f_0002.png")
    (scene.folder / "color.png").symlink_to("f_0002.png")
    path = ("--orbit", 5, "--frames", 4)
    line = is_refused_before_the_work(scene, monkeypatch, *path, "-o", scene.folder / "f.png")
    assert "f_0002.png, the same as COLOR" in line
    (scene.folder / "d_0001.npy").symlink_to("depth.npy")
    arguments = ("-o", scene.folder / "g.png", "--depth-out", scene.folder / "d.npy")
    assert "DEPTH" in is_refused_before_the_work(scene, monkeypatch, *path, *arguments, depth="depth.npy")
    (scene.folder / "m.obj").symlink_to("camera.json")
    arguments = ("--max-error", 1, "-o", scene.folder / "m.obj")
    assert "the same as --camera" in is_refused_before_the_work(scene, monkeypatch, *arguments, command="mesh")


def test_no_two_outputs_are_one(scene: Scene, monkeypatch: pytest.MonkeyPatch):
    (scene.folder / "other.png").symlink_to("new.png")  # new.png does not exist yet
    for second in ("new.png", "other.png", "folder/../new.png"):
        arguments = ("--orbit", 5, "-o", scene.folder / "new.png", "--valid-out", scene.folder / second)
        assert "the same as --output" in is_refused_before_the_work(scene, monkeypatch, *arguments)
        arguments = ("--orbit", 5, "--frames", 2, *arguments[2:])
        if second != "other.png":
            assert "the same as --output" in is_refused_before_the_work(scene, monkeypatch, *arguments)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("-o", "a.xyz"), "no image format .xyz"),
        (("-o", "a.mp4"), "--output: expected several views for a video, by --frames or from a recording, got one"),
        (("-o", "a"), "without a suffix"),
        (("-o", "a.png", "--depth-out", "b.jpg"), "no depth format .jpg"),
        (("-o", "a.png", "--valid-out", "b.pfm"), "no image format .pfm"),
        (("-o", "camera.json/a.png"), "camera.json is not a folder"),
        (("-o", "folder.png"), "expected a file, got a folder"),
        (("-o", "x" * 300 + ".png"), "File name too long"),
        (("-o", "a.exr"), "pyibr-opencl[exr]"),
    ],
)
def test_what_cannot_be_written_is_told_before_it(scene: Scene, monkeypatch: pytest.MonkeyPatch, arguments, words):
    (scene.folder / "folder.png").mkdir()
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    places = [word if word.startswith("-") else scene.folder / word for word in arguments]
    assert words in is_refused_before_the_work(scene, monkeypatch, "--orbit", 5, *places)


@pytest.mark.parametrize("name", ["a.xyz", "folder.glb", "camera.json/a.glb"])
def test_a_mesh_that_cannot_be_written_is_told_before_the_work(scene: Scene, monkeypatch: pytest.MonkeyPatch, name):
    (scene.folder / "folder.glb").mkdir()
    is_refused_before_the_work(scene, monkeypatch, "--max-error", 1, "-o", scene.folder / name, command="mesh")


@pytest.mark.parametrize(
    ("error", "line", "status"),
    [
        (KeyboardInterrupt(), "pyibr: interrupted", 130),
        (OSError(28, "No space left on device"), "pyibr: [Errno 28] No space left on device", 2),
        (MemoryError(), "pyibr: out of memory", 2),
        (ibr.DeviceError("no device works.\n  to get one\x1b"), "pyibr: no device works.\n  to get one\\x1b", 2),
    ],
)
def test_what_ends_the_work_is_told(scene: Scene, monkeypatch: pytest.MonkeyPatch, error, line, status):
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(ibr, "warp", fail)
    result = scene.run("--orbit", 5, "-o", scene.folder / "new.png")
    assert (result.exit_code, result.stderr.strip()) == (status, line)


def test_names_that_are_no_text(scene: Scene):
    name = scene.folder / "\udcff.png"
    (scene.folder / "color.png").rename(scene.folder / "\udcfe.png")
    words = [sys.executable, "-c", "from pyibr.app.cli import app; app()", "warp", scene.folder / "\udcfe.png"]
    words += [scene.folder / "depth.npy", "--camera", scene.folder / "camera.json", "--orbit", "5", "-o", name]
    done = subprocess.run(words, capture_output=True, text=True)
    # On a busy machine, loading kernels from PoCL's cache may be slow enough for a message.
    assert (done.returncode, re.sub("pyibr: kernels are being built .*\n", "", done.stderr)) == (0, "")
    assert "\ufffd.png: 61x37" in done.stdout and name.exists()


def test_names_do_not_steer_the_terminal(scene: Scene):
    """A file may have any name; its control characters do not reach the terminal."""
    name = scene.folder / "a\n\x1b[2J\x9b\u00e9.png"
    result = scene.run("--orbit", 5, "-o", name)
    assert result.exit_code == 0 and name.exists()
    assert f"{scene.folder}/a\\n\\x1b[2J\\x9b\u00e9.png: 61x37" in result.stdout
    name.rename(scene.folder / "color.png")
    assert_one_line(scene.run("--orbit", 5, "-o", f"{name}.xyz"), "a\\n\\x1b[2J\\x9b\u00e9.png.xyz: no image format")
