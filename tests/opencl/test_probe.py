"""The test that each device passes once, in a separate process, and the cache of its outcomes."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy
import pyopencl
import pytest

from pyibr.core.errors import ArgumentError, DeviceError
from pyibr.opencl import apart
from pyibr.opencl import device as device_module
from pyibr.opencl import probe as probe_module
from pyibr.opencl.choice import choose
from pyibr.opencl.device import current, devices, use_device
from pyibr.opencl.probe import forget, probe
from pyibr.opencl.runtimes import Found, found_devices
from pyibr.opencl.selftest import Outcome
from tests.opencl.test_choice import found
from tests.opencl.test_memory import refusing
from tools.processes import run_python


def test_a_probe_is_kept_and_forgotten(own_cache: Path, monkeypatch: pytest.MonkeyPatch):
    entry = found_devices()[current().device.index]
    assert probe(entry).works
    assert len(list(own_cache.glob("devices/*"))) == 1

    with monkeypatch.context() as patch:
        patch.setattr(probe_module, "_test_apart", refusing(AssertionError("asked the device again")))
        for told in ({entry.key: Outcome(True)}, {}):  # the outcome is known in this process, or from the disk alone
            patch.setattr(probe_module, "_tested", told)
            assert probe(entry) == probe(entry, doubted="broken") == Outcome(True)
            with pytest.raises(AssertionError):
                probe(entry, measure=True)  # its speed is not known yet
            with pytest.raises(AssertionError):
                probe(entry, doubted="all")
    speed = probe(entry, measure=True).speed
    assert speed is not None and min(speed.copy, speed.mad) > 0
    probe_module._tested.clear()
    assert probe(entry).speed == speed
    forget(entry)
    assert not list(own_cache.glob("devices/*"))


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '{"works": true}', '{"works":1,"reason":"","speed":{"x":1}}'])
def test_what_another_version_wrote_is_as_good_as_nothing(text: str, own_cache: Path, monkeypatch: pytest.MonkeyPatch):
    entry = found_devices()[current().device.index]
    monkeypatch.setattr(probe_module, "_test_apart", lambda *_: Outcome(True))
    probe_module._entry(entry).write(text.encode())
    assert probe(entry) == Outcome(True)
    probe_module._tested.clear()
    assert probe_module._kept(entry, "broken") == Outcome(True)


def test_a_device_that_no_process_finds_is_broken_with_a_reason(own_cache: Path):
    outcome = probe(found(0, "gone", "cpu"))
    assert not outcome.works
    assert "another process does not find this device" in outcome.reason


@pytest.mark.skipif(os.name != "posix", reason="the scripts are for a shell")
@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("kill -SEGV $$", "the runtime crashed on a tiny kernel (signal 11)"),
        ("exec sleep 60", "a tiny kernel did not end within 0.2 s"),
    ],
)
def test_a_runtime_that_crashes_or_hangs_is_broken_with_a_reason(
    script: str, reason: str, own_cache: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    python = tmp_path / "python"
    python.write_text(f"#!/bin/sh\n{script}\n")
    python.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(python))
    monkeypatch.setenv(apart.VARIABLE, "0.2" if "sleep" in script else "60")
    assert probe(found(0, "bad", "cpu")) == Outcome(False, reason)


@pytest.mark.parametrize("wrong", ["soon", "-1", "nan", "inf"])
def test_a_time_to_wait_for_runtimes_is_checked(wrong: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(apart.VARIABLE, wrong)
    with pytest.raises(ArgumentError, match=r"PYIBR_TIMEOUT.*seconds > 0"):
        apart.timeout()


def a_call() -> None:
    assert current().device.works


def a_call_on_a_named_device() -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYIBR_DEVICE", found_devices()[0].platform)
        a_call()


def a_list() -> None:
    assert all(device.works or "yesterday" not in device.reason for device in devices())


def a_block() -> None:
    with use_device(found_devices()[0].platform) as device:
        assert device.works


@pytest.mark.parametrize("ask", [a_call, a_call_on_a_named_device, a_list, a_block])
@pytest.mark.parametrize("mended", [True, False])
def test_a_device_that_was_broken_is_asked_again_but_once(
    ask: Any, mended: bool, nothing_open: None, own_cache: Path, monkeypatch: pytest.MonkeyPatch
):
    asked: list[str] = []

    def answer(entry: Found, measure: bool) -> Outcome:
        asked.append(entry.key)
        return Outcome(True) if mended else Outcome(False, "as it is today")

    for entry in found_devices():
        probe_module._entry(entry).write(Outcome(False, "as it was yesterday").to_json().encode())
    monkeypatch.setattr(probe_module, "_test_apart", answer)
    for _ in range(3):
        if mended or ask is a_list:
            ask()
        else:
            with pytest.raises(DeviceError, match="as it is today"):
                ask()
    assert asked and len(asked) == len(set(asked))


def test_a_device_that_was_broken_is_left_alone_where_another_works(own_cache: Path):
    """Testing the broken device again may take long."""
    listed = [found(0, "bad", "gpu"), found_devices()[current().device.index]]
    probe_module._entry(listed[0]).write(Outcome(False, "as it was yesterday").to_json().encode())
    assert choose(listed, device_module._examine).works
    assert listed[0].key not in probe_module._tested


PLANTED = "open({!r}, 'a').write(__name__ + chr(10))\n"


@pytest.fixture
def planted(tmp_path: Path) -> Path:
    """A folder with modules named like imports of Python, numpy and pyopencl. Each module records that it was run."""
    folder = tmp_path / "downloads"
    folder.mkdir()
    for name in ("platform", "sitecustomize", "usercustomize", "json", "typing", "pytools", "attr", "encodings"):
        (folder / f"{name}.py").write_text(PLANTED.format(str(tmp_path / "ran")))
    for name in ("numpy", "pyopencl", "pyibr"):
        (folder / name).mkdir()
        (folder / name / "__init__.py").write_text(PLANTED.format(str(tmp_path / "ran")))
    return folder


@pytest.mark.parametrize("way", ["", "relative", pytest.param("absolute", marks=pytest.mark.thorough)])
def test_the_test_runs_nothing_that_this_process_has_not_imported(planted: Path, own_cache: Path, way: str):
    """In notebooks and with `python -c`, the module path begins with the working directory, which is not run either."""
    code = f"""
import os, sys
import numpy, platform, pyibr as ibr
from pyibr.opencl.runtimes import found_devices
found_devices()
os.chdir({str(planted)!r})
sys.path.insert(0, {{"": "", "relative": "../downloads", "absolute": os.getcwd()}}[{way!r}])
print([device.works for device in ibr.devices(fresh=True)])
"""
    done = run_python("-c", code, cwd="/")
    assert "True" in done.stdout, done.stdout + done.stderr
    assert not (planted.parent / "ran").exists(), (planted.parent / "ran").read_text()


@pytest.mark.skipif(os.name != "posix", reason="a folder that is in use cannot be removed here")
def test_the_working_directory_may_be_gone(tmp_path: Path, own_cache: Path):
    """A shell may stand in a folder that was removed, with which the module path begins."""
    (tmp_path / "gone").mkdir()
    code = "import os; os.rmdir('../gone')\nimport pyibr as ibr; print([d.works for d in ibr.devices(fresh=True)])"
    done = run_python("-c", code, cwd=tmp_path / "gone")
    assert "True" in done.stdout and not done.stderr, done.stdout + done.stderr


def test_the_test_finds_what_this_process_has_wherever_it_lies(tmp_path: Path, own_cache: Path):
    """The module path has several folders, from variables or added by the program, some of them relative."""
    here = Path(__file__).parents[2]
    places = {"one": here / "pyibr", "two": Path(numpy.__file__).parent, "three": Path(pyopencl.__file__).parent}
    for name, package in places.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / package.name).symlink_to(package)
    for more in ("numpy.libs", "pyopencl.libs"):
        if (there := places["two"].parent / more).exists():
            (tmp_path / "two" / more).symlink_to(there)
    (tmp_path / "kernels").symlink_to(here / "kernels")
    code = """
import sys
sys.path[:0] = ["three", "one"]
import pyibr.opencl.apart as apart, pyibr.opencl.probe as probe, pyibr.opencl.selftest as selftest
from pyibr.opencl.runtimes import found_devices
selftest.test = None  # nothing is tested in this process
for found in found_devices():
    print(probe.probe(found))
print(apart._folders())
"""
    path = f"{tmp_path / 'two'}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
    done = run_python("-c", code, cwd=tmp_path, PYTHONPATH=path)
    assert "works=True" in done.stdout, done.stdout + done.stderr
    for name in places:
        assert f"'{tmp_path / name}'" in done.stdout


def test_where_no_python_can_be_started_the_device_is_tested_here(own_cache: Path, monkeypatch: pytest.MonkeyPatch):
    """In an application that embeds Python, `sys.executable` is no Python interpreter."""
    entry = found_devices()[current().device.index]
    for executable in ("/bin/false", "/no/such/python", ""):
        monkeypatch.setattr(sys, "executable", executable)
        assert probe(entry, doubted="all").works
