"""Runtimes from pip: Intel's, as its packages leave it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from pyibr.opencl import runtimes


@pytest.fixture
def intel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder as pip leaves it, the packer's path in the .icd file included; returns the library."""
    (tmp_path / "etc/OpenCL/vendors").mkdir(parents=True)
    (tmp_path / "etc/OpenCL/vendors/intel-cpu.icd").write_text("/opt/placeholder/lib/libintelocl.so\n")
    (tmp_path / "etc/OpenCL/vendors/emulator.icd").write_text("/opt/placeholder/lib/libnothere.so\n")
    (tmp_path / "lib").mkdir()
    for name in ("libintelocl.so", *runtimes._INTEL_NEEDS):
        (tmp_path / "lib" / name).touch()
    monkeypatch.setattr(runtimes, "_prefixes", lambda: [tmp_path])
    for name in runtimes._LOADER_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    return tmp_path / "lib/libintelocl.so"


def test_the_loader_sees_the_mended_path_and_the_systems_runtimes(intel: Path, monkeypatch: pytest.MonkeyPatch):
    system = intel.parent.parent / "system"
    system.mkdir()
    (system / "other.icd").write_text("libother.so\n")
    monkeypatch.setattr(runtimes, "_SYSTEM_ICDS", system)
    with runtimes._mended_runtimes():
        folder = Path(os.environ["OCL_ICD_VENDORS"])
        assert sorted(p.read_text().strip() for p in folder.glob("*.icd")) == [str(intel), "libother.so"]
    assert "OCL_ICD_VENDORS" not in os.environ
    assert not folder.exists()


def test_the_loaders_own_variables_are_respected(intel: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("OCL_ICD_VENDORS", "/somewhere")
    with runtimes._mended_runtimes():
        assert os.environ["OCL_ICD_VENDORS"] == "/somewhere"
    (problem,) = runtimes.problems()
    assert str(intel) in problem.what and problem.remedy == "unset OCL_ICD_VENDORS"


def test_what_intels_runtime_lacks_is_named(intel: Path):
    assert runtimes.problems() == []
    (intel.parent / "libsvml.so").unlink()
    (problem,) = runtimes.problems()
    assert "libsvml.so" in problem.what and problem.remedy == "pip install intel-cmplr-lib-rt"
