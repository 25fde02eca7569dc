"""Choice of a device, by rules and by name, and errors if no device works."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from pyibr.core.errors import ArgumentError, DeviceError
from pyibr.opencl import runtimes
from pyibr.opencl.choice import choose, select
from pyibr.opencl.runtimes import Found, remedy_for
from pyibr.opencl.selftest import Outcome

BROKEN = Outcome(False, "every build fails: unknown target CPU 'generic'")


def found(index: int, name: str, kind: runtimes.Kind, version: str = "OpenCL 3.0 PoCL 3.0-rc2") -> Found:
    platform, handle = "Portable Computing Language", None  # the rules do not use the handle
    return Found(index, platform, name, "The maker", version, f"driver {index}", kind, f"key{index}", handle)


class Examiner:
    """Stands in for the test of devices: all but the `broken` ones work. Records which devices were tested."""

    def __init__(self, *broken: str) -> None:
        self.broken = broken
        self.asked: list[str] = []

    def __call__(self, entry: Found) -> Outcome:
        self.asked.append(entry.name)
        return BROKEN if entry.name in self.broken else Outcome(True)


def test_the_first_gpu_that_works_comes_before_any_cpu():
    names = ["cpu", "bad", "good", "next"]
    listed = [found(index, name, "cpu" if name == "cpu" else "gpu") for index, name in enumerate(names)]
    listed[3] = dataclasses.replace(listed[3], platform="Intel(R) OpenCL Graphics")
    examiner = Examiner("bad")
    assert choose(listed, examiner).name == "good"
    assert examiner.asked == ["bad", "good"], "only as many are examined as necessary"


def test_the_fastest_cpu_runtime_that_works_is_chosen_where_no_gpu_works():
    platforms = ["Another", "Portable Computing Language", "Portable Computing Language", "Intel(R) OpenCL"]
    names = ["other", "pocl", "same", "intel"]
    listed = [dataclasses.replace(found(i, names[i], "cpu"), platform=platforms[i]) for i in range(4)]
    listed.append(found(4, "card", "gpu"))
    order: list[str] = []
    while len(order) < 4:
        order.append(choose(listed, Examiner("card", *order)).name)
    assert order == ["intel", "pocl", "same", "other"]


def test_an_accelerator_is_the_last_resort():
    listed = [found(0, "emulator", "accelerator"), found(1, "cpu", "cpu")]
    assert choose(listed, Examiner()).name == "cpu"
    assert choose(listed, Examiner("cpu")).name == "emulator"


@pytest.mark.parametrize(("selector", "index"), [(1, 1), ("1", 1), ("EPYC", 1), ("gpu", 0), ("pocl 6", 1)])
def test_select(selector: int | str, index: int):
    listed = [found(0, "Radeon", "gpu"), found(1, "pthread-AMD EPYC", "cpu", "OpenCL 3.0 PoCL 6.0+debian")]
    assert select(listed, Examiner(), selector, "device").index == index


def test_of_several_that_match_the_first_that_works_is_taken():
    listed = [found(0, "one", "cpu"), found(1, "two", "cpu")]
    assert select(listed, Examiner("one"), "portable", "device").name == "two"


def test_names_of_platforms_come_before_those_of_processors(caplog: pytest.LogCaptureFixture):
    """PoCL names its device after the processor, which may be Intel's."""
    pocl = found(0, "pthread-Intel(R) Xeon(R)", "cpu", "OpenCL 3.0 PoCL 6.0+debian")
    intel = dataclasses.replace(found(1, "Intel(R) Xeon(R)", "cpu", "OpenCL 3.1 LINUX"), platform="Intel(R) OpenCL")
    examiner = Examiner()
    with caplog.at_level("INFO", "pyibr"):
        assert select([pocl, intel], examiner, "intel", "device").platform == intel.platform
        assert select([pocl, intel], examiner, "PoCL", "device").index == 0
    assert not caplog.messages
    with caplog.at_level("INFO", "pyibr"):
        assert select([pocl, intel], examiner, "xeon", "device").index == 0
        assert select([pocl], examiner, "intel", "device").index == 0
    (said,) = caplog.messages
    assert said.startswith("device='xeon' is 0 = ") and "it also matches 1 = Intel(R) OpenCL: Intel(R) Xeon(R)" in said


@pytest.mark.parametrize("selector", ["radeon", 7, -1, "", "  "])
def test_a_name_that_matches_nothing(selector: int | str):
    with pytest.raises(ArgumentError, match=r"\$PYIBR_DEVICE: expected .*0 = Portable.*: one.*, got ") as caught:
        select([found(0, "one", "cpu")], Examiner(), selector, "$PYIBR_DEVICE")
    assert repr(selector) in str(caught.value)


def test_a_named_device_that_does_not_work_is_not_replaced():
    with pytest.raises(DeviceError, match="requested by device='one'") as caught:
        select([found(0, "one", "cpu"), found(1, "two", "cpu")], Examiner("one"), "one", "device")
    assert BROKEN.reason in str(caught.value)
    assert "to mend it: " in str(caught.value)


def debian(monkeypatch: pytest.MonkeyPatch, root: bool = False) -> None:
    release = {"ID": "ubuntu", "ID_LIKE": "debian"}
    monkeypatch.setattr(runtimes.platform, "freedesktop_os_release", lambda: release)
    monkeypatch.setattr(runtimes.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(runtimes.os, "geteuid", lambda: 0 if root else 1000)


def test_the_error_tells_what_was_found_why_it_failed_and_what_mends_it(monkeypatch: pytest.MonkeyPatch):
    debian(monkeypatch)
    with pytest.raises(DeviceError) as caught:
        choose([found(0, "pthread", "cpu")], Examiner("pthread"))
    text = str(caught.value)
    assert "Portable Computing Language: pthread (cpu, driver driver 0)" in text
    assert "unknown target CPU 'generic'" in text
    assert "sudo apt install pocl-opencl-icd" in text
    assert "pip install intel-opencl-rt intel-cmplr-lib-rt" in text


def test_the_error_where_there_is_no_device_at_all(monkeypatch: pytest.MonkeyPatch):
    debian(monkeypatch, root=True)
    for ask in (lambda: choose([], Examiner()), lambda: select([], Examiner(), "gpu", "device")):
        with pytest.raises(DeviceError, match="no OpenCL device was found") as caught:
            ask()
        assert "  apt install pocl-opencl-icd" in str(caught.value), "root needs no sudo"


def test_remedies_fit_the_device(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    debian(monkeypatch)
    monkeypatch.setattr(runtimes, "SYSTEM_ICDS", tmp_path)
    pocl = found(0, "PoCL", "cpu")  # its version is "driver 0"
    monkeypatch.setattr(runtimes, "version_of", {"pocl-binary-distribution": "driver"}.get)
    assert remedy_for(pocl) == "sudo apt install pocl-opencl-icd ocl-icd-libopencl1"
    (tmp_path / "pocl.icd").touch()
    assert remedy_for(pocl) == "pip uninstall pocl-binary-distribution"
    monkeypatch.setattr(runtimes, "version_of", lambda wheel: None)
    assert remedy_for(pocl) == "pip install intel-opencl-rt intel-cmplr-lib-rt"
    assert "The maker" in remedy_for(found(0, "card", "gpu"))
