"""Runtimes from pip: Intel's, as its packages leave it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
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
    for name in ("libintelocl.so", *runtimes._INTEL.needs):
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


def test_what_a_further_runtime_needs_is_one_object(intel: Path, monkeypatch: pytest.MonkeyPatch):
    other = runtimes.Runtime(
        "Another",
        "nobody's",
        lambda: "mend it",
        environment=lambda: {"PYIBR_NOBODYS": "1"},
        library="libintel",
        needs=("libmore.so",),
        needs_from="install it",
    )
    monkeypatch.setattr(runtimes, "RUNTIMES", (*runtimes.RUNTIMES, other))
    with runtimes._mended_runtimes():
        assert os.environ["PYIBR_NOBODYS"] == "1"
    assert "PYIBR_NOBODYS" not in os.environ
    assert runtimes.problems() == [runtimes.Problem(f"Another ({intel}) lacks libmore.so", "install it")]
    device = runtimes.Found(0, "Nobody's OpenCL", "it", "its maker", "OpenCL 3.0", "", "cpu", "key", None)  # pyright: ignore[reportArgumentType]
    assert runtimes.remedy_for(device) == "mend it"


POCLS = ("POCL_AFFINITY", "POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT")
THREADS = """
import json, os
import pyopencl  # numpy's threads are none of PoCL's
before = set(os.listdir("/proc/self/task"))
if {chosen}:
    os.sched_setaffinity(0, {chosen})
from pyibr.opencl.device import current
platform = current().device.platform
new = set(os.listdir("/proc/self/task")) - before
threads = [sorted(os.sched_getaffinity(int(name))) for name in new]
print(json.dumps([platform, threads, os.environ.get("POCL_AFFINITY")]))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="threads are kept on processors on Linux alone")
@pytest.mark.parametrize("choice", ["nobody's", "taskset", *POCLS])
def test_threads_have_a_processor_each_unless_the_user_chose(choice: str):
    everywhere = sorted(os.sched_getaffinity(0))
    if everywhere != list(range(os.cpu_count() or 0)) or len(everywhere) < 2:
        pytest.skip("not all processors are this process's")
    environment = {name: value for name, value in os.environ.items() if name not in POCLS}
    if choice in POCLS:
        environment[choice] = "0" if choice == "POCL_AFFINITY" else str(len(everywhere))
    script = THREADS.format(chosen={1} if choice == "taskset" else "None")
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    platform, threads, variable = json.loads(done.stdout)
    assert variable == environment.get("POCL_AFFINITY")
    if "Portable" not in platform:
        pytest.skip("PoCL is not what computes here")
    if choice == "nobody's":  # another runtime's threads may be anywhere
        assert sorted(allowed for allowed in threads if len(allowed) == 1) == [[number] for number in everywhere]
    else:
        assert threads and all(allowed == ([1] if choice == "taskset" else everywhere) for allowed in threads)
