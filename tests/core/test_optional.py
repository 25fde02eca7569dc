"""pyibr without its optional packages, and its messages for packages that are missing, broken or overwritten."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.errors import MissingPackageError
from pyibr.core.optional import clashes, open3d, opencv, version_of
from tools.processes import run_python

EVERYTHING = """
import sys
for name in ("cv2", "open3d", "OpenEXR", "matplotlib"):
    sys.modules[name] = None
import numpy as np
import pyibr as ibr

rng = np.random.default_rng(0)
camera = ibr.Camera([[30, 0, 18], [0, 30, 12], [0, 0, 1]], (37, 25))
texture, height = rng.integers(0, 256, (13, 7, 3), dtype=np.uint8), rng.random((11, 9), np.float32)
corners = [[-1, -1, 2], [1, -1, 2], [-1, 1, 2], [1, 1, 2]]
base = ibr.Mesh(corners, [[0, 2, 1], [1, 2, 3]], uv=[[0, 0], [1, 0], [0, 1], [1, 1]], texture=texture)
y, x = np.mgrid[:25, :37]
away = np.hypot(x - 18, y - 12)
depth = np.where(away < 8, 1.9 + 0.05 * away, np.inf).astype(np.float32)
view = ibr.DepthImage(rng.integers(0, 256, (25, 37, 3), dtype=np.uint8), depth, camera)
aside = camera.orbited(70, (0, 0, 2))
outlines = [ibr.Silhouette(view.color, np.isfinite(depth), seen) for seen in (camera, aside)]
things = [
    view,
    base,
    ibr.SlicedSurface(base, height, texture, 0.1),
    ibr.ReliefSurface(base, height, texture, 0.1),
    ibr.DepthObject([view], missing="empty"),
    ibr.VisualHull(outlines),
    ibr.DepthMesh(view),
    ibr.DepthMeshObject([view]),
]
for thing in things:
    assert ibr.render([thing], camera, ibr.Light(direction=(0, 0, 1))).valid.any(), thing
assert ibr.warp(view, camera.moved(0.1, 0, 0), fill="background").valid.any()
assert (ibr.clean_depth(depth, view.color).depth > 0).any()
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder that `import cv2` searches first, in a process that has not imported cv2."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(sys.modules, "cv2", None)  # makes monkeypatch restore it
    del sys.modules["cv2"]
    return tmp_path


@pytest.mark.thorough
def test_everything_is_rendered_without_optional_packages():
    done = run_python("-c", EVERYTHING)
    assert done.returncode == 0, done.stderr


def test_a_missing_package_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch):
    for module in ("cv2", "open3d", "OpenEXR"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingPackageError, match=r"meshes need Open3D: pip install 'pyibr-opencl\[open3d\]'$"):
        open3d()
    depth = np.ones((3, 4), np.float32)
    view = ibr.DepthImage(None, depth, ibr.Camera([[3, 0, 2], [0, 3, 1], [0, 0, 1]], (4, 3)))
    with pytest.raises(MissingPackageError, match=r"inpaint\" needs OpenCV: pip install 'pyibr-opencl\[opencv\]'$"):
        ibr.warp(view, view.camera, fill="inpaint")
    with pytest.raises(MissingPackageError, match=r"EXR files need OpenEXR: pip install 'pyibr-opencl\[exr\]'$"):
        ibr.write_depth("depth.exr", depth)


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        ("raise ImportError('libGL.so.1: cannot open shared object file: No such file or directory')", "libGL.so.1"),
        ("import a_part_of_it_that_is_gone", "a_part_of_it_that_is_gone"),
        ("raise AttributeError('_ARRAY_API not found')", "_ARRAY_API"),
    ],
)
def test_a_broken_package_is_told_from_a_missing_one(source: str, reason: str, folder: Path):
    (folder / "cv2.py").write_text(source)
    with pytest.raises(MissingPackageError, match=rf"is installed but cannot be imported \(.*{reason}.*headless"):
        opencv("a video")


def test_what_an_opencv_lacks_is_named(folder: Path):
    (folder / "cv2.py").write_text("__version__ = '4.10.0'\ndef remap(): ...")
    opencv("it", "remap")
    with pytest.raises(MissingPackageError, match=r"needs cv2\.quality, but the installed OpenCV 4\.10\.0 lacks it; "):
        opencv("it", "remap", "quality")


def test_a_folder_that_an_uninstalled_opencv_left_is_no_opencv(folder: Path, monkeypatch: pytest.MonkeyPatch):
    (folder / "cv2").mkdir()
    monkeypatch.setattr(sys, "path", [str(folder)])
    with pytest.raises(MissingPackageError, match=r"it needs cv2\.remap, but only a folder is left"):
        opencv("it", "remap")


# ---- packages that have overwritten each other's files


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A function that installs a distribution, with a name and one file, into an environment that begins empty."""
    monkeypatch.setattr("sys.path", [str(tmp_path)])

    def install(name: str, file: str) -> None:
        folder = tmp_path / f"{name.replace('-', '_')}-1.2.dist-info"
        folder.mkdir(exist_ok=True)
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.2\n")
        (folder / "RECORD").write_text(f"{file},,\n{folder.name}/METADATA,,\n")
        (tmp_path / file).parent.mkdir(exist_ok=True)  # Python 3.12 and later list existing files only
        (tmp_path / file).touch()

    return install


def test_two_builds_of_opencv_clash(installed):
    installed("opencv-python", "cv2/__init__.py")
    assert clashes() == []
    installed("opencv-contrib-python-headless", "cv2/__init__.py")
    ((what, mend),) = clashes()
    assert what.startswith("opencv-python and opencv-contrib-python-headless have both written into cv2/")
    install = "pip install --force-reinstall --no-deps opencv-python==1.2"
    assert mend == f"pip uninstall -y opencv-contrib-python-headless && {install}"


def test_an_older_pyibr_clashes_where_it_writes_into_ours(installed):
    installed("pyibr-opencl", "pyibr/__init__.py")
    installed("pyibr", "ibr/__init__.py")
    assert clashes() == []
    assert (version_of("pyibr-opencl"), version_of("opencv-python")) == ("1.2", None)
    installed("pyibr", "pyibr/__init__.py")
    ((what, mend),) = clashes()
    assert what.startswith("pyibr-opencl and pyibr have both")
    assert mend.startswith("pip uninstall -y pyibr && ")
