"""Text files read the same in different encodings and with different line ends."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from pyibr.io import read_poses
from tests.io.layouts import SPECIMENS
from tests.io.specimens import OTHERS, WRITERS, reader, same
from tests.io.test_layouts import frames_of

FILES = ("camera.json", "textured.obj", "text.ply", "text.stl", "concave.off", "skinned.gltf", "grid.ply", "poses.txt")
FILES += tuple(name for name in OTHERS if name.startswith("cameras.") and name != "cameras.npy")
FORMS = {
    "UTF-16": lambda text: text.encode("utf-16"),
    "a mark": lambda text: text.encode("utf-8-sig"),
    "lines of Windows": lambda text: text.replace("\n", "\r\n").encode(),
}


@pytest.mark.parametrize("name", FILES)
def test_files_of_text(tmp_path: Path, name):
    (WRITERS | OTHERS)[name](tmp_path / name)
    text, read = (tmp_path / name).read_text(encoding="utf-8"), reader(name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        first = read(tmp_path / name)
        for form, encode in FORMS.items():
            (tmp_path / name).write_bytes(encode(text))
            assert same(first, read(tmp_path / name)), form


@pytest.mark.parametrize("name", [name for name in SPECIMENS if not name.startswith("ros_")])
def test_layouts_of_wide_text(tmp_path: Path, name):
    SPECIMENS[name][0](tmp_path / "it")
    first = frames_of(tmp_path / "it")
    for file in tmp_path.rglob("*.*"):
        if file.suffix in (".txt", ".json", ".csv", ".freiburg", ".log"):
            file.write_bytes(FORMS["UTF-16"](file.read_text(encoding="utf-8")))
    for one, other in zip(first, frames_of(tmp_path / "it"), strict=True):
        assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize("line", ["1, 2, 3, 4, 0, 0, 0, 1,", "1;2;3;4;0;0;0;1", "1\t2 3 4 0 0 0 1 # a remark"])
def test_numbers_between_any_marks(tmp_path: Path, line):
    (tmp_path / "p.txt").write_text(f"{line}\n")
    found = read_poses(tmp_path / "p.txt")
    assert found.times.tolist() == [1] and found.world_from_camera[0, :3, 3].tolist() == [2, 3, 4]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("k.txt", "30 31 15.5 11.5"),
        ("k.txt", "[[30. 0. 15.5]\n [0. 31. 11.5]\n [0. 0. 1.]]"),
        ("calib.txt", "cam0=[30 0 15.5; 0 31 11.5; 0 0 1]\ndoffs=0\nwidth=32\nheight=24\n"),
        ("k.yaml", "# Gr\xf6\xdfe\nK: [30, 0, 15.5, 0, 31, 11.5, 0, 0, 1]\n"),
        ("k.npy", ""),
    ],
)
def test_forms_of_k(tmp_path: Path, name, text):
    expected = [[30, 0, 15.5], [0, 31, 11.5], [0, 0, 1]]
    np.save(tmp_path / "k.npy", expected)
    if text:
        (tmp_path / name).write_text(text, encoding="latin-1")
    assert ibr.Camera.load(tmp_path / name, size=(32, 24)).K.tolist() == expected


def test_poses_of_numpy(tmp_path: Path):
    poses = np.tile(np.eye(4), (3, 1, 1))
    np.save(tmp_path / "poses.npy", poses)
    (tmp_path / "printed.txt").write_text(str(poses))
    for name in ("poses.npy", "printed.txt"):
        np.testing.assert_array_equal(read_poses(tmp_path / name).world_from_camera, poses)


def test_wide_text_without_a_mark_is_named(tmp_path: Path):
    (tmp_path / "p.txt").write_bytes("1 2 3 4 0 0 0 1".encode("utf-16-le"))
    with pytest.raises(ibr.FileFormatError, match="UTF-16 without a byte order mark: save it as UTF-8"):
        read_poses(tmp_path / "p.txt")
