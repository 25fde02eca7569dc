"""Detection of installed packages that have overwritten each other's files."""

from __future__ import annotations

from pathlib import Path

import pytest

from pyibr.core.optional import clashes, version_of


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A function that installs a distribution, with a name and one file, into an environment that begins empty."""
    monkeypatch.setattr("sys.path", [str(tmp_path)])

    def install(name: str, file: str) -> None:
        folder = tmp_path / f"{name.replace('-', '_')}-1.2.dist-info"
        folder.mkdir()
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
    assert mend == (
        "pip uninstall -y opencv-contrib-python-headless && pip install --force-reinstall --no-deps opencv-python==1.2"
    )


def test_anothers_pyibr_clashes_only_where_it_writes_into_ours(installed):
    installed("pyibr-opencl", "pyibr/__init__.py")
    installed("pyibr", "ibr/__init__.py")
    assert clashes() == []


def test_an_older_name_of_ours_clashes(installed):
    installed("pyibr-opencl", "pyibr/__init__.py")
    installed("pyibr", "pyibr/__init__.py")
    ((what, mend),) = clashes()
    assert what.startswith("pyibr-opencl and pyibr have both")
    assert mend.startswith("pip uninstall -y pyibr && ")


def test_versions(installed):
    installed("pyibr-opencl", "pyibr/__init__.py")
    assert version_of("pyibr-opencl") == "1.2"
    assert version_of("pyibr") is None
