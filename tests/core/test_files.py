"""Files are written as a whole or not at all, and impossible file names are refused."""

from __future__ import annotations

import os
import stat
import threading
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.files import write_atomically, written_together
from pyibr.io import read_range_grid, read_relief_map, write_relief_map

DEPTH = np.ones((4, 5), np.float32)
COLOR = np.zeros((4, 5, 3), np.uint8)
CAMERA = ibr.Camera([[5, 0, 2], [0, 5, 2], [0, 0, 1]], (5, 4))
MESH = ibr.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])


def test_of_many_writers_one_wins_whole(tmp_path: Path):
    file, contents = tmp_path / "file", [bytes([number]) * 300_000 for number in range(8)]
    write_atomically(file, contents[0])
    failed, seen, over = list[Exception](), set[bytes](), threading.Event()

    def write(content: bytes) -> None:
        try:
            for _ in range(15):
                write_atomically(file, content)
        except Exception as error:
            failed.append(error)

    def read() -> None:
        while not over.is_set():
            seen.add(file.read_bytes())

    reader = threading.Thread(target=read)
    writers = [threading.Thread(target=write, args=(content,)) for content in contents]
    reader.start()
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    over.set()
    reader.join()
    assert failed == [] and seen <= set(contents)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_no_link_that_waits_under_the_temporary_name_is_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "victim").write_text("safe")
    monkeypatch.setattr("secrets.token_hex", lambda count: "guessed")
    for link in (".pyibr-guessed", f".file.{os.getpid()}"):
        (tmp_path / link).symlink_to("victim")
    with pytest.raises(ibr.FileFormatError, match="cannot be written"):
        write_atomically(tmp_path / "file", b"new")
    assert (tmp_path / "victim").read_text() == "safe"
    assert not (tmp_path / "file").exists()


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o664])
def test_a_file_keeps_its_mode(tmp_path: Path, mode):
    file = tmp_path / "camera.json"
    file.touch()
    file.chmod(mode)
    CAMERA.save(file)
    assert stat.S_IMODE(file.stat().st_mode) == mode


@pytest.mark.parametrize("mask", [0o022, 0o077])
def test_a_new_file_has_the_mode_that_the_umask_gives(tmp_path: Path, mask):
    before = os.umask(mask)
    try:
        CAMERA.save(tmp_path / "camera.json")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "camera.json").stat().st_mode) == 0o666 & ~mask


def test_a_link_stays_and_what_it_names_is_replaced(tmp_path: Path):
    (tmp_path / "folder").mkdir()
    for name in ("old", "new"):
        (tmp_path / name).symlink_to(f"folder/{name}")
    (tmp_path / "folder" / "old").write_text("old")
    for name in ("old", "new"):
        write_atomically(tmp_path / name, b"written")
        assert (tmp_path / name).is_symlink() and (tmp_path / "folder" / name).read_bytes() == b"written"
    (tmp_path / "round").symlink_to("round")
    with pytest.raises(ibr.FileFormatError, match="round: cannot be written"):
        write_atomically(tmp_path / "round", b"written")


def test_what_is_no_regular_file_is_not_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    os.mkfifo(tmp_path / "pipe.json")
    with pytest.raises(ibr.FileFormatError, match=r"pipe\.json: cannot be written: it is no regular file"):
        CAMERA.save(tmp_path / "pipe.json")
    with pytest.raises(ibr.FileFormatError, match=r"pipe\.json: is no regular file"):
        ibr.Camera.load(tmp_path / "pipe.json")
    CAMERA.save(tmp_path / "locked.json")
    monkeypatch.setattr("os.access", lambda path, mode: False)
    with pytest.raises(ibr.FileFormatError, match=r"locked\.json: cannot be written: Permission denied"):
        CAMERA.save(tmp_path / "locked.json")


USES = {
    "read_color": ibr.read_color,
    "read_depth": ibr.read_depth,
    "read_relief_map": read_relief_map,
    "read_range_grid": read_range_grid,
    "Camera.load": ibr.Camera.load,
    "Mesh.load": ibr.Mesh.load,
    "write_color": lambda path: ibr.write_color(path, COLOR),
    "write_depth": lambda path: ibr.write_depth(path, DEPTH, depth_scale=1000),
    "write_mask": lambda path: ibr.write_mask(path, DEPTH > 0),
    "write_relief_map": lambda path: write_relief_map(path, np.full((4, 5, 3), (0, 0, 1.0)), COLOR[..., 0]),
    "Camera.save": CAMERA.save,
    "Mesh.save": MESH.save,
}


@pytest.mark.parametrize("use", USES)
def test_names_that_no_file_has(tmp_path: Path, use):
    suffix = ".ply" if "Mesh" in use else ".png"
    for path in (None, 3, b"color.png", ["color.png"]):
        with pytest.raises(ibr.ArgumentError, match=r"^path: expected a file's path, .* got "):
            USES[use](path)
    for name in (f"zero\0{suffix}", f"\ud800{suffix}"):
        with pytest.raises(ibr.ArgumentError, match=r"^path: expected a file's path in characters"):
            USES[use](tmp_path / name)
    with pytest.raises(ibr.FileFormatError, match=r"(read|written): File name too long"):
        USES[use](tmp_path / ("x" * 300 + suffix))
    (tmp_path / f"folder{suffix}").mkdir()
    with pytest.raises(ibr.FileFormatError, match="folder"):
        USES[use](tmp_path / f"folder{suffix}")
    (tmp_path / "file").touch()
    with pytest.raises(ibr.FileFormatError, match=r"no such file|file is not a folder"):
        USES[use](tmp_path / "file" / f"x{suffix}")
    (tmp_path / "last\udcff").mkdir()  # names may contain bytes that are not UTF-8
    if "write" in use or "save" in use:
        USES[use](tmp_path / "last\udcff" / f"x\udcff{suffix}")
        assert len(list((tmp_path / "last\udcff").iterdir())) == 1


def test_files_that_are_written_together_are_all_there_or_none(tmp_path: Path):
    first, second = tmp_path / "first", tmp_path / "second"
    write_atomically(first, b"old")
    with pytest.raises(ZeroDivisionError), written_together():
        write_atomically(first, b"new")
        write_atomically(second, b"new")
        raise ZeroDivisionError
    assert [path.name for path in tmp_path.iterdir()] == ["first"] and first.read_bytes() == b"old"
    with written_together():
        write_atomically(second, b"new")
        write_atomically(first, b"new")
        assert first.read_bytes() == b"old" and not second.exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["first", "second"]
    assert first.read_bytes() == second.read_bytes() == b"new"


def test_a_failed_file_takes_those_before_it_along(tmp_path: Path):
    (tmp_path / "folder").mkdir()
    with pytest.raises(ibr.FileFormatError, match="folder: cannot be written: it is a folder"), written_together():
        write_atomically(tmp_path / "before", b"new")
        write_atomically(tmp_path / "folder", b"new")
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]
