"""Commands protect files that they must not overwrite, accept all names of files, and can be interrupted."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

import pyibr as ibr
from tests.app.commands import assert_one_line
from tests.app.plane import Scene
from tools.processes import run_python


def is_refused_before_the_work(scene: Scene, monkeypatch: pytest.MonkeyPatch, *arguments: object, **options) -> str:
    """Run `warp` or `mesh`; return its error. The command must not have drawn or written anything."""

    def work(*_: object, **__: object) -> None:
        raise AssertionError("at work")

    for name in ("warp", "DepthMesh", "read_color"):
        monkeypatch.setattr(ibr, name, work)
    before = {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}
    result = scene.run(*arguments, **options)
    assert_one_line(result)
    assert before == {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}
    return result.stderr.strip()


@pytest.mark.parametrize("name", ["color.png", "depth.png", "link.png", "hard.png", "folder/../color.png"])
@pytest.mark.parametrize("option", ["-o", "--depth-out", "--valid-out"])
def test_no_output_is_an_input(scene: Scene, monkeypatch: pytest.MonkeyPatch, option, name):
    Path("folder").mkdir()
    Path("link.png").symlink_to("depth.png")
    Path("hard.png").hardlink_to("color.png")
    others = () if option == "-o" else ("-o", "new.png")
    line = is_refused_before_the_work(scene, monkeypatch, "--orbit", 5, *others, option, name)
    assert "expected a file of its own, got " in line
    assert ("COLOR" in line) == (name in ("color.png", "hard.png", "folder/../color.png"))


def test_no_numbered_output_and_no_mesh_is_an_input(scene: Scene, monkeypatch: pytest.MonkeyPatch):
    Path("color.png").rename("f_0002.png")
    Path("color.png").symlink_to("f_0002.png")
    path = ("--orbit", 5, "--frames", 4)
    line = is_refused_before_the_work(scene, monkeypatch, *path, "-o", "f.png")
    assert "f_0002.png, the same as COLOR" in line
    Path("d_0001.npy").symlink_to("depth.npy")
    arguments = ("-o", "g.png", "--depth-out", "d.npy")
    assert "DEPTH" in is_refused_before_the_work(scene, monkeypatch, *path, *arguments, depth="depth.npy")
    Path("m.obj").symlink_to("camera.json")
    arguments = ("--max-error", 1, "-o", "m.obj")
    assert "the same as --camera" in is_refused_before_the_work(scene, monkeypatch, *arguments, command="mesh")


def test_no_two_outputs_are_one(scene: Scene, monkeypatch: pytest.MonkeyPatch):
    Path("other.png").symlink_to("new.png")  # new.png does not exist yet
    for second in ("new.png", "other.png", "folder/../new.png"):
        outputs = ("-o", "new.png", "--valid-out", second)
        for frames in (1,) if second == "other.png" else (1, 2):
            path = ("--orbit", 5, "--frames", frames)
            assert "the same as --output" in is_refused_before_the_work(scene, monkeypatch, *path, *outputs)


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
    Path("folder.png").mkdir()
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    assert words in is_refused_before_the_work(scene, monkeypatch, "--orbit", 5, *arguments)


@pytest.mark.parametrize("name", ["a.xyz", "folder.glb", "camera.json/a.glb"])
def test_a_mesh_that_cannot_be_written_is_told_before_the_work(scene: Scene, monkeypatch: pytest.MonkeyPatch, name):
    Path("folder.glb").mkdir()
    is_refused_before_the_work(scene, monkeypatch, "--max-error", 1, "-o", name, command="mesh")


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
    result = scene.run("--orbit", 5, "-o", "new.png")
    assert (result.exit_code, result.stderr.strip()) == (status, line)


def test_names_that_are_no_text(scene: Scene):
    name = Path("\udcff.png")
    Path("color.png").rename("\udcfe.png")
    words = ("depth.npy", "--camera", "camera.json", "--orbit", "5", "-o", name)
    done = run_python("-c", "from pyibr.app.cli import app; app()", "warp", "\udcfe.png", *words)
    # On a busy machine, loading kernels from PoCL's cache may be slow enough for a message.
    assert (done.returncode, re.sub("pyibr: kernels are being built .*\n", "", done.stderr)) == (0, "")
    assert "\ufffd.png: 61x37" in done.stdout and name.exists()


def test_names_do_not_steer_the_terminal(scene: Scene):
    """A file may have any name; its control characters do not reach the terminal."""
    name = Path("a\n\x1b[2J\x9b\u00e9.png")
    result = scene.run("--orbit", 5, "-o", name)
    assert result.exit_code == 0 and name.exists()
    assert "a\\n\\x1b[2J\\x9b\u00e9.png: 61x37" in result.stdout
    name.rename("color.png")
    assert_one_line(scene.run("--orbit", 5, "-o", f"{name}.xyz"), "a\\n\\x1b[2J\\x9b\u00e9.png.xyz: no image format")
