"""Choice of a device, messages on those that do not work, and what is remembered."""

from __future__ import annotations

import dataclasses
import math
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl as cl
import pytest

from pyibr.core.errors import ArgumentError, DeviceError
from pyibr.opencl import apart, runtimes, selftest
from pyibr.opencl import device as device_module
from pyibr.opencl import probe as probe_module
from pyibr.opencl.choice import choose, select
from pyibr.opencl.device import current, devices, explain, one_call, use_device
from pyibr.opencl.outcome import Outcome
from pyibr.opencl.probe import forget, probe
from pyibr.opencl.profile import profile_of
from pyibr.opencl.runtimes import Found, found_devices, remedy_for
from tests.processes import run_within, with_path

BROKEN = Outcome(False, "every build fails: unknown target CPU 'generic'")


def found(index: int, name: str, kind: runtimes.Kind, version: str = "OpenCL 3.0 PoCL 3.0-rc2") -> Found:
    handle: Any = None  # what the rules never look at
    platform = "Portable Computing Language"
    return Found(index, platform, name, "The maker", version, f"driver {index}", kind, f"key{index}", handle)


class Examiner:
    """Outcomes and times of pictures written down beforehand, and a record of who was asked."""

    def __init__(self, **known: Outcome | float) -> None:
        self.known = known
        self.asked: list[str] = []
        self.timed: list[str] = []

    def __call__(self, entry: Found) -> Outcome:
        self.asked.append(entry.name)
        known = self.known[entry.name]
        return known if isinstance(known, Outcome) else Outcome(True)

    def picture_time(self, entry: Found) -> float:
        self.timed.append(entry.name)
        known = self.known[entry.name]
        assert isinstance(known, float)
        return known


def chosen(listed: list[Found], examiner: Examiner) -> str:
    return choose(listed, examiner, examiner.picture_time).name


@pytest.fixture
def nothing_open(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """As in a process that has opened no device yet."""
    device_module._default_session.cache_clear()
    with monkeypatch.context() as patch:
        patch.setattr(device_module, "_sessions", {})
        patch.setattr(device_module, "_failed_here", {})
        yield
    device_module._default_session.cache_clear()


def run(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], env=with_path(), capture_output=True, text=True)


# --- the rule -------------------------------------------------------------------------------------


def test_the_first_gpu_that_works_comes_before_any_cpu():
    listed = [
        found(0, "cpu", "cpu"),
        found(1, "bad", "gpu"),
        found(2, "good", "gpu"),
        found(3, "next", "gpu"),
    ]
    examiner = Examiner(cpu=1.0, bad=BROKEN, good=9.0, next=5.0)
    assert chosen(listed, examiner) == "good"
    assert examiner.asked == ["bad", "good"] and not examiner.timed, "no more is examined than the choice needs"


def test_the_fastest_cpu_runtime_is_chosen_where_no_gpu_works():
    listed = [
        found(0, "bad", "gpu"),
        found(1, "slow", "cpu"),
        found(2, "quick", "cpu"),
        found(3, "broken", "cpu"),
    ]
    examiner = Examiner(bad=BROKEN, slow=2.0, quick=1.0, broken=BROKEN)
    assert chosen(listed, examiner) == "quick"
    assert examiner.timed == ["slow", "quick"]


def test_a_single_runtime_is_not_measured():
    examiner = Examiner(only=1.0, broken=BROKEN)
    assert chosen([found(0, "broken", "cpu"), found(1, "only", "cpu")], examiner) == "only"
    assert not examiner.timed


@pytest.mark.parametrize("seconds", [1.0, math.inf])
def test_equal_runtimes_are_taken_in_their_order(seconds: float):
    assert chosen([found(0, "a", "cpu"), found(1, "b", "cpu")], Examiner(a=seconds, b=seconds)) == "a"


def test_an_accelerator_is_the_last_resort():
    listed = [found(0, "emulator", "accelerator"), found(1, "cpu", "cpu")]
    assert chosen(listed, Examiner(emulator=1.0, cpu=9.0)) == "cpu"
    assert chosen(listed, Examiner(emulator=1.0, cpu=BROKEN)) == "emulator"


# --- what a user names ----------------------------------------------------------------------------


@pytest.mark.parametrize(("selector", "index"), [(1, 1), ("1", 1), ("EPYC", 1), ("gpu", 0), ("pocl 6", 1)])
def test_select(selector: int | str, index: int):
    listed = [found(0, "Radeon", "gpu"), found(1, "pthread-AMD EPYC", "cpu", "OpenCL 3.0 PoCL 6.0+debian")]
    examiner = Examiner(**{"Radeon": 1.0, "pthread-AMD EPYC": 1.0})
    assert select(listed, examiner, selector, "device").index == index


def test_of_several_that_match_the_first_that_works_is_taken():
    listed = [found(0, "one", "cpu"), found(1, "two", "cpu")]
    assert select(listed, Examiner(one=BROKEN, two=1.0), "portable", "device").name == "two"


def test_names_of_platforms_come_before_those_of_processors(caplog: pytest.LogCaptureFixture):
    """PoCL calls its device on a processor of Intel's by the processor's name."""
    pocl = found(0, "pthread-Intel(R) Xeon(R)", "cpu", "OpenCL 3.0 PoCL 6.0+debian")
    intel = dataclasses.replace(found(1, "Intel(R) Xeon(R)", "cpu", "OpenCL 3.1 LINUX"), platform="Intel(R) OpenCL")
    examiner = Examiner(**{pocl.name: 1.0, intel.name: 1.0})
    with caplog.at_level("INFO", "pyibr"):
        assert select([pocl, intel], examiner, "intel", "device").platform == intel.platform
        assert select([pocl, intel], examiner, "PoCL", "device").index == 0
    assert not caplog.messages
    with caplog.at_level("INFO", "pyibr"):
        assert select([pocl, intel], examiner, "xeon", "device").index == 0
        assert select([pocl], examiner, "intel", "device").index == 0
    (said,) = caplog.messages
    assert said.startswith("device='xeon' is 0 = ") and "it fits 1 = Intel(R) OpenCL: Intel(R) Xeon(R), too" in said


@pytest.mark.parametrize("selector", ["radeon", 7, -1, "", "  "])
def test_a_name_that_matches_nothing(selector: int | str):
    with pytest.raises(ArgumentError, match=r"\$PYIBR_DEVICE: expected .*0 = Portable.*: one.*, got ") as caught:
        select([found(0, "one", "cpu")], Examiner(one=1.0), selector, "$PYIBR_DEVICE")
    assert repr(selector) in str(caught.value)


def test_a_named_device_that_does_not_work_is_not_replaced():
    with pytest.raises(DeviceError, match="asked for by device='one'") as caught:
        select(
            [found(0, "one", "cpu"), found(1, "two", "cpu")],
            Examiner(one=BROKEN, two=1.0),
            "one",
            "device",
        )
    assert BROKEN.reason in str(caught.value)
    assert "to mend it: " in str(caught.value)


# --- what is said ---------------------------------------------------------------------------------


def debian(monkeypatch: pytest.MonkeyPatch, root: bool = False) -> None:
    release = {"ID": "ubuntu", "ID_LIKE": "debian"}
    monkeypatch.setattr(runtimes.platform, "freedesktop_os_release", lambda: release)
    monkeypatch.setattr(runtimes.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(runtimes.os, "geteuid", lambda: 0 if root else 1000)


def test_the_error_tells_what_was_found_why_it_failed_and_what_mends_it(monkeypatch: pytest.MonkeyPatch):
    debian(monkeypatch)
    with pytest.raises(DeviceError) as caught:
        chosen([found(0, "pthread", "cpu")], Examiner(pthread=BROKEN))
    text = str(caught.value)
    assert "Portable Computing Language: pthread (cpu, driver driver 0)" in text
    assert "unknown target CPU 'generic'" in text
    assert "sudo apt install pocl-opencl-icd" in text
    assert "pip install intel-opencl-rt intel-cmplr-lib-rt" in text


def test_the_error_where_there_is_no_device_at_all(monkeypatch: pytest.MonkeyPatch):
    debian(monkeypatch, root=True)
    for ask in (lambda: chosen([], Examiner()), lambda: select([], Examiner(), "gpu", "device")):
        with pytest.raises(DeviceError, match="no OpenCL device was found") as caught:
            ask()
        assert "  apt install pocl-opencl-icd" in str(caught.value), "root needs no sudo"


def test_remedies_fit_the_device(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    debian(monkeypatch)
    monkeypatch.setattr(runtimes, "SYSTEM_ICDS", tmp_path)
    pocl = found(0, "PoCL", "cpu")  # of version "driver 0"
    monkeypatch.setattr(runtimes, "version_of", {"pocl-binary-distribution": "driver"}.get)
    assert remedy_for(pocl) == "sudo apt install pocl-opencl-icd ocl-icd-libopencl1"
    (tmp_path / "pocl.icd").touch()
    assert remedy_for(pocl) == "pip uninstall pocl-binary-distribution"
    monkeypatch.setattr(runtimes, "version_of", lambda wheel: None)
    assert remedy_for(pocl) == "pip install intel-opencl-rt intel-cmplr-lib-rt"
    assert "The maker" in remedy_for(found(0, "card", "gpu"))


# --- this machine ---------------------------------------------------------------------------------


def test_a_device_of_this_machine_works_and_is_opened_once():
    session = current()
    assert session is current()
    assert session.device in devices()
    assert session.device.works and not session.device.reason and not session.device.remedy
    assert session.context.devices == [found_devices()[session.device.index].handle]
    assert session.profile is profile_of(session.device.kind)


def test_a_cpu_whose_kernels_work_in_copies_is_told(monkeypatch: pytest.MonkeyPatch):
    handle = found_devices()[current().device.index].handle
    assert selftest.test(handle, measure=False).works
    buffer = cl.Buffer

    def copied(context: cl.Context, flags: int, size: int = 0, hostbuf: np.ndarray | None = None) -> cl.Buffer:
        if flags & cl.mem_flags.USE_HOST_PTR:
            flags = flags & ~cl.mem_flags.USE_HOST_PTR | cl.mem_flags.COPY_HOST_PTR
        return buffer(context, flags, size, hostbuf)

    monkeypatch.setattr(cl, "Buffer", copied)
    told = selftest.test(handle, measure=False)
    assert not told.works and "the host's own memory" in told.reason


def test_a_cpu_works_in_wide_lanes_and_in_place_and_what_is_no_cpu_does_not():
    for kind, lanes, in_place in (("cpu", 16, True), ("gpu", 1, False), ("accelerator", 1, False)):
        profile = profile_of(kind)
        assert (profile.lanes, profile.in_place) == (lanes, in_place)
        assert profile.block**2 == lanes
        assert profile.grid((4, 3), (101, 77)) == ((4, 3) if kind == "cpu" else (101, 77))
        assert profile.packets(101, 77) == (7 if kind == "cpu" else 101, 77)


def test_the_environment_variable_names_the_device(monkeypatch: pytest.MonkeyPatch):
    index = current().device.index
    monkeypatch.setenv("PYIBR_DEVICE", str(index))
    assert current().device.index == index
    assert explain()[1] == "named by $PYIBR_DEVICE"
    monkeypatch.setenv("PYIBR_DEVICE", "no such device")
    with pytest.raises(ArgumentError, match=r"\$PYIBR_DEVICE"):
        current()


def test_use_device_nests_and_ends(monkeypatch: pytest.MonkeyPatch):
    usual = current()
    monkeypatch.setenv("PYIBR_DEVICE", "no such device")  # so that the block is what counts
    with use_device(usual.device.index) as outer:
        assert current() is usual and outer == usual.device
        with use_device(outer) as inner:
            assert inner == outer and current() is usual
        with pytest.raises(ArgumentError, match="device: expected"), use_device("no such device"):
            pass
        assert current() is usual
        assert explain()[1] == "named by use_device"
    with pytest.raises(ArgumentError):
        current()


def test_a_call_stays_on_its_device(monkeypatch: pytest.MonkeyPatch):
    usual = current()
    with one_call() as session:
        assert session is usual
        monkeypatch.setenv("PYIBR_DEVICE", "no such device")
        assert current() is usual
    with pytest.raises(ArgumentError):
        current()


def test_use_device_holds_for_its_own_thread(monkeypatch: pytest.MonkeyPatch):
    usual = current().device
    monkeypatch.setenv("PYIBR_DEVICE", "no such device")
    seen: list[object] = []

    def elsewhere() -> None:
        try:
            seen.append(current())
        except ArgumentError as error:
            seen.append(error)

    with use_device(usual):
        thread = threading.Thread(target=elsewhere)
        thread.start()
        thread.join()
        assert current().device == usual
    assert isinstance(seen[0], ArgumentError)


def test_threads_that_start_together_share_one_session(nothing_open: None):
    barrier = threading.Barrier(8)
    seen: list[object] = []

    def start() -> None:
        barrier.wait()
        seen.append(current())

    threads = [threading.Thread(target=start) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(seen) == 8 and len(set(map(id, seen))) == 1


@pytest.mark.parametrize("wrong", [None, 1.5, True, ["cpu"]])
def test_use_device_refuses_what_names_no_device(wrong: Any):
    with pytest.raises(ArgumentError, match="device: expected a Device"), use_device(wrong):
        pass


def test_a_device_that_cannot_be_opened_is_named(nothing_open: None, own_cache: Path, monkeypatch: pytest.MonkeyPatch):
    import pyopencl as cl

    def refuse(devices: object) -> None:
        raise cl.MemoryError("no room on the device")

    monkeypatch.setattr(cl, "Context", refuse)
    with pytest.raises(DeviceError, match="it cannot be opened: no room on the device"):
        current()
    assert not list(own_cache.glob("devices/*")), "the next process asks again"


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
def test_a_forked_process_gets_an_error_and_does_not_hang():
    code = """
import dataclasses
import os
from pyibr.core.errors import DeviceError
from pyibr.opencl.device import current
current()
if os.fork() == 0:
    try:
        current()
    except DeviceError as error:
        os._exit(7 if "spawn" in str(error) else 1)
    os._exit(2)
print(os.waitstatus_to_exitcode(os.wait()[1]))
"""
    done = run(code)
    assert done.stdout.strip() == "7", done.stderr


# --- what is remembered ---------------------------------------------------------------------------


def test_a_probe_is_kept_and_forgotten(own_cache: Path, monkeypatch: pytest.MonkeyPatch):
    entry = found_devices()[current().device.index]
    assert probe(entry).works
    assert len(list(own_cache.glob("devices/*"))) == 1

    def never(*_: object) -> Outcome:
        raise AssertionError("asked the device again")

    with monkeypatch.context() as patch:
        patch.setattr(probe_module, "_test_apart", never)
        for told in ({entry.key: Outcome(True)}, {}):  # by this process, and by the disk
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


def test_a_runtime_that_crashes_is_broken_with_a_reason(
    own_cache: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    python = tmp_path / "python"
    python.write_text("#!/bin/sh\nkill -SEGV $$\n")
    python.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(python))
    assert probe(found(0, "bad", "cpu")) == Outcome(False, "the runtime crashed on a tiny kernel (signal 11)")


def test_a_runtime_that_hangs_is_broken_with_a_reason(own_cache: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    python = tmp_path / "python"
    python.write_text("#!/bin/sh\nexec sleep 60\n")
    python.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(python))
    monkeypatch.setenv(apart.VARIABLE, "0.2")
    assert "did not end within 0.2 s" in probe(found(0, "bad", "cpu")).reason


@pytest.mark.parametrize("wrong", ["soon", "-1", "nan", "inf"])
def test_a_time_to_wait_for_runtimes_is_checked(wrong: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(apart.VARIABLE, wrong)
    with pytest.raises(ArgumentError, match=r"PYIBR_TIMEOUT.*seconds > 0"):
        apart.run_apart("none", task="nothing")


def a_call() -> None:
    assert current().device.works


def a_call_on_a_named_device(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYIBR_DEVICE", found_devices()[0].platform)
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
    arguments = [monkeypatch] if ask is a_call_on_a_named_device else []
    for _ in range(3):
        if mended or ask is a_list:
            ask(*arguments)
        else:
            with pytest.raises(DeviceError, match="as it is today"):
                ask(*arguments)
    assert asked and len(asked) == len(set(asked))


def test_a_device_that_was_broken_is_left_alone_where_another_works(own_cache: Path):
    """To ask it may take long."""
    listed = [found(0, "bad", "gpu"), found_devices()[current().device.index]]
    probe_module._entry(listed[0]).write(Outcome(False, "as it was yesterday").to_json().encode())
    assert choose(listed, device_module._examine, lambda entry: 1.0).works
    assert listed[0].key not in probe_module._tested


# --- tested apart ---------------------------------------------------------------------------------

PLANTED = "open({!r}, 'a').write(__name__ + chr(10))\n"


TWO_DEVICES = """
import threading, numpy as np, pyibr as ibr
from pyibr.opencl.device import current
from tests.scenes import stepped
view = stepped((61, 37))
targets = [view.camera.moved(0.1 * step, 0.1, 0.2) for step in range(8)]
drawn = {}

def draw(index):
    with ibr.use_device(index):
        frames = ibr.warp(view, targets[:3]) + [ibr.warp(view, one) for one in targets]
        drawn[index] = current().device.index, [frame.color.tobytes() + frame.depth.tobytes() for frame in frames]

threads = [threading.Thread(target=draw, args=(index,)) for index in (0, 1)]
for one in threads: one.start()
for one in threads: one.join()
assert [drawn[index][0] for index in (0, 1)] == [0, 1]
assert drawn[0][1] == drawn[1][1]
print("both")
"""


@pytest.mark.thorough
@pytest.mark.skipif("PoCL" not in current().device.version, reason="only PoCL lists this processor twice")
def test_two_devices_are_in_use_at_the_same_time():
    kind = current().device.name.partition("-")[0]  # as PoCL calls it, which versions do differently
    done = run_within(120, [sys.executable, "-c", TWO_DEVICES], POCL_DEVICES=f"{kind} {kind}")
    assert done.stdout == "both\n", done.stderr


@pytest.fixture
def planted(tmp_path: Path) -> Path:
    """A folder with modules of names that Python, numpy and pyopencl import; each that runs writes itself down."""
    folder = tmp_path / "downloads"
    folder.mkdir()
    for name in ("platform", "sitecustomize", "usercustomize", "json", "typing", "pytools", "attr", "encodings"):
        (folder / f"{name}.py").write_text(PLANTED.format(str(tmp_path / "ran")))
    for name in ("numpy", "pyopencl", "pyibr"):
        (folder / name).mkdir()
        (folder / name / "__init__.py").write_text(PLANTED.format(str(tmp_path / "ran")))
    return folder


def test_what_lies_in_the_working_directory_is_not_run(planted: Path, own_cache: Path):
    """The parent's path begins with its script's folder, as that of the command `pyibr` does."""
    script = planted.parent / "bin" / "script.py"
    script.parent.mkdir()
    script.write_text("import pyibr as ibr; print([device.works for device in ibr.devices(fresh=True)])")
    done = subprocess.run([sys.executable, script], cwd=planted, env=with_path(), capture_output=True, text=True)
    assert "True" in done.stdout, done.stdout + done.stderr
    assert not (planted.parent / "ran").exists(), (planted.parent / "ran").read_text()


@pytest.mark.parametrize("way", ["", "relative", pytest.param("absolute", marks=pytest.mark.thorough)])
def test_the_test_runs_nothing_that_this_process_has_not_imported(planted: Path, own_cache: Path, way: str):
    """As in notebooks and with `python -c`, whose path begins with the working directory."""
    code = f"""
import os, sys
import numpy, platform, pyibr as ibr
from pyibr.opencl.runtimes import found_devices
found_devices()
os.chdir({str(planted)!r})
sys.path.insert(0, {{"": "", "relative": "../downloads", "absolute": os.getcwd()}}[{way!r}])
print([device.works for device in ibr.devices(fresh=True)])
"""
    done = subprocess.run([sys.executable, "-c", code], cwd="/", env=with_path(), capture_output=True, text=True)
    assert "True" in done.stdout, done.stdout + done.stderr
    assert not (planted.parent / "ran").exists(), (planted.parent / "ran").read_text()


@pytest.mark.skipif(os.name != "posix", reason="a folder that is in use cannot be removed here")
def test_the_working_directory_may_be_gone(tmp_path: Path, own_cache: Path):
    """As in a shell whose folder was removed and made anew; the path begins with that folder."""
    (tmp_path / "gone").mkdir()
    code = "import os; os.rmdir('../gone')\nimport pyibr as ibr; print([d.works for d in ibr.devices(fresh=True)])"
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=tmp_path / "gone", env=with_path(), capture_output=True, text=True)
    assert "True" in done.stdout and not done.stderr, done.stdout + done.stderr


def test_the_test_finds_what_this_process_has_wherever_it_lies(tmp_path: Path, own_cache: Path):
    """Packages in several folders, which the environment names or the program adds, some of them by a relative path."""
    import numpy
    import pyopencl

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
    environment = with_path() | {"PYTHONPATH": f"{tmp_path / 'two'}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert "works=True" in done.stdout, done.stdout + done.stderr
    for name in places:
        assert f"'{tmp_path / name}'" in done.stdout


def test_where_no_python_can_be_started_the_device_is_tested_here(own_cache: Path, monkeypatch: pytest.MonkeyPatch):
    """The executable of an application that embeds Python is no Python."""
    entry = found_devices()[current().device.index]
    for executable in ("/bin/false", "/no/such/python", ""):
        monkeypatch.setattr(sys, "executable", executable)
        assert probe(entry, doubted="all").works


# --- the end of a process -------------------------------------------------------------------------

ENDING = """
import threading, time
import numpy as np
import pyibr as ibr
size = 400
camera = ibr.Camera([[300, 0, 200], [0, 300, 200], [0, 0, 1]], (size, size))
views = [ibr.DepthImage(np.full((size, size, 3), 9, np.uint8), np.full((size, size), 2, np.float32), camera)
         for _ in range(4)]
begun = threading.Event()
def work():
    while True:
        ibr.warp(views, camera.moved(0.1, 0.05, 0.2), fill="background")
        begun.set()
for _ in range({threads}):
    threading.Thread(target=work, daemon=True).start()
begun.wait({wait})
time.sleep({more})
"""


@pytest.mark.thorough
@pytest.mark.parametrize(
    "number", [n if n in (0, 1, 4) else pytest.param(n, marks=pytest.mark.thorough) for n in range(8)]
)
def test_a_process_ends_cleanly_while_daemon_threads_call(number: int):
    """The first call may still open the device and build kernels, or one of many may be in flight."""
    early = number < 3
    code = ENDING.format(
        threads=1 + number % 3, wait=0 if early else 60, more=0.1 * number if early else 0.003 * number
    )
    done = run(code)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.thorough
def test_the_last_call_may_come_after_the_end_has_begun():
    code = ENDING.format(threads=2, wait=60, more=0)
    last = "import atexit\natexit.register(lambda: print(ibr.warp(views[0], camera).valid.all()))\n"
    for whole in (last + code, code + last):
        done = run(whole)
        assert (done.returncode, done.stdout, done.stderr) == (0, "True\n", "")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
def test_a_forked_process_ends_without_waiting():
    code = (
        ENDING.format(threads=2, wait=60, more=0)
        + """
import os, sys
start = time.monotonic()
if os.fork() == 0:
    sys.exit(7)
print(os.waitstatus_to_exitcode(os.wait()[1]), time.monotonic() - start < 5)
"""
    )
    done = run(code)
    assert (done.returncode, done.stdout) == (0, "7 True\n"), done.stderr
