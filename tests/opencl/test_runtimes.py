"""Finding runtimes that pip and conda installed, and special treatment of PoCL and Intel's runtime."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyopencl as cl
import pytest

import pyibr as ibr
from pyibr.opencl import runtimes, unlisted
from pyibr.opencl.device import VARIABLE
from tests.opencl.test_choice import found
from tools.everything import calls
from tools.processes import run_python, with_path


@pytest.fixture
def intel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make a folder like pip's, whose .icd file holds a path of the build machine; returns the library."""
    (tmp_path / "etc/OpenCL/vendors").mkdir(parents=True)
    (tmp_path / "etc/OpenCL/vendors/intel-cpu.icd").write_text("/opt/placeholder/lib/libintelocl.so\n")
    (tmp_path / "etc/OpenCL/vendors/emulator.icd").write_text("/opt/placeholder/lib/libnothere.so\n")
    (tmp_path / "lib").mkdir()
    for name in ("libintelocl.so", *runtimes._INTEL.needs):
        (tmp_path / "lib" / name).touch()
    monkeypatch.setattr(unlisted, "_prefixes", lambda: [tmp_path])
    for name in unlisted.LOADER_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    return tmp_path / "lib/libintelocl.so"


def test_the_loader_sees_the_mended_path_and_the_systems_runtimes(intel: Path, monkeypatch: pytest.MonkeyPatch):
    system = intel.parent.parent / "system"
    system.mkdir()
    (system / "other.icd").write_text("libother.so\n")
    monkeypatch.setattr(unlisted, "SYSTEM_ICDS", system)
    with runtimes._all_listed():
        folder = Path(os.environ["OCL_ICD_VENDORS"])
        assert sorted(p.read_text().strip() for p in folder.glob("*.icd")) == [str(intel), "libother.so"]
    assert "OCL_ICD_VENDORS" not in os.environ
    assert not folder.exists()


def environment_of(monkeypatch: pytest.MonkeyPatch, prefix: Path, text: str, library: str) -> Path:
    """Make a conda environment with one runtime; returns the runtime's library."""
    monkeypatch.setattr(unlisted, "_prefixes", lambda: [prefix])
    monkeypatch.setattr(unlisted, "SYSTEM_ICDS", prefix / "none")
    monkeypatch.setattr(unlisted, "has_nvidias_library", lambda: False)
    for file, content in (("etc/OpenCL/vendors/one.icd", text), (library, "")):
        (prefix / file).parent.mkdir(parents=True, exist_ok=True)
        (prefix / file).write_text(content)
    return prefix / library


@pytest.mark.parametrize("name", ["libpocl.so.2.13", "libpocl.2.13.dylib"])  # Linux on any processor, and macOS
@pytest.mark.parametrize("text", ["{prefix}/lib/{name}", "{name}"])
def test_condas_runtimes_are_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, name: str):
    library = environment_of(monkeypatch, tmp_path, text.format(prefix=tmp_path, name=name) + "\n", f"lib/{name}")
    assert unlisted.unlisted_runtimes() == [unlisted.Unlisted("one.icd", library)]
    # Not if the environment's folder of .icd files is also the system's.
    monkeypatch.setattr(unlisted, "SYSTEM_ICDS", tmp_path / "etc/OpenCL/vendors")
    assert unlisted.unlisted_runtimes() == []


def test_intels_wheel_is_listed_on_windows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """On Windows, the .icd file names the library for Linux; the actual library has another name and folder."""
    text, library = "/opt/anaconda1anaconda2anaconda3/lib/libintelocl.so\n", "Library/bin/intelocl64.dll"
    here = environment_of(monkeypatch, tmp_path, text, library)
    found = unlisted.unlisted_runtimes()
    assert found == [unlisted.Unlisted("one.icd", here)]
    path = os.environ["PATH"]
    monkeypatch.setenv("PATH", path)  # so that monkeypatch restores it later
    monkeypatch.setattr(unlisted.os, "name", "nt")
    with unlisted.seen_by_the_loader(found):
        seen = os.environ["OCL_ICD_FILENAMES"], os.environ["PATH"]
    monkeypatch.undo()
    assert seen == (str(here), f"{here.parent}{os.pathsep}{path}")
    assert "OCL_ICD_FILENAMES" not in os.environ


def test_nvidias_library_without_its_file_is_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """In containers, NVIDIA's library has no .icd file."""
    environment_of(monkeypatch, tmp_path, "libnothere.so", "nothing")
    monkeypatch.setattr(unlisted, "has_nvidias_library", lambda: True)
    assert unlisted.unlisted_runtimes() == [unlisted.Unlisted("nvidia.icd", Path(unlisted.NVIDIA))]
    monkeypatch.setattr(unlisted, "SYSTEM_ICDS", tmp_path / "etc/OpenCL/vendors")
    (tmp_path / "etc/OpenCL/vendors/nvidia.icd").write_text(f"{unlisted.NVIDIA}\n")
    assert unlisted.unlisted_runtimes() == []


def test_a_container_without_nvidias_library_is_told(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(runtimes, "has_nvidias_driver", lambda: True)
    monkeypatch.setattr(runtimes, "has_nvidias_library", lambda: False)
    assert any("NVIDIA_DRIVER_CAPABILITIES" in problem.remedy for problem in runtimes.problems())


def test_a_folder_that_forbids_programs_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """PoCL loads the kernels that it compiles from its cache; the folder need not exist yet."""
    flags = os.statvfs(tmp_path).f_flag & ~os.ST_NOEXEC
    found = runtimes.found_devices()
    monkeypatch.setattr(os, "statvfs", lambda _: SimpleNamespace(f_flag=flags))
    monkeypatch.setenv("POCL_CACHE_DIR", str(tmp_path / "new/pocl"))
    assert runtimes._forbidden_folder() is None
    flags |= os.ST_NOEXEC
    fault = runtimes._forbidden_folder()
    assert fault is not None and f"their folder {tmp_path}/new/pocl is mounted noexec" in fault.what
    for one in (one for one in found if runtimes.runtime_of(one) is runtimes._POCL):
        assert runtimes.remedy_for(one) == "set POCL_CACHE_DIR to a folder on another file system"
        assert fault in runtimes.problems()
    monkeypatch.delenv("POCL_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert f" {tmp_path}/pocl is" in runtimes._forbidden_folder().what


def test_the_loaders_own_variables_are_respected(intel: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("OCL_ICD_VENDORS", "/somewhere")
    with runtimes._all_listed():
        assert os.environ["OCL_ICD_VENDORS"] == "/somewhere"
    (problem,) = runtimes.problems()
    assert str(intel) in problem.what and problem.remedy == "unset OCL_ICD_VENDORS"
    monkeypatch.setenv("OCL_ICD_VENDORS", str(intel))
    assert runtimes.problems() == [], "the variable names the library"


def test_what_intels_runtime_lacks_is_named(intel: Path):
    assert runtimes.problems() == []
    (intel.parent / "libsvml.so").unlink()
    (problem,) = runtimes.problems()
    assert "libsvml.so" in problem.what and problem.remedy == "pip install intel-cmplr-lib-rt tbb"


def test_what_a_further_runtime_needs_is_one_object(intel: Path, monkeypatch: pytest.MonkeyPatch):
    other = runtimes.Runtime(
        "Another",
        "nobody's",
        lambda: "mend it",
        environment=lambda: {"PYIBR_NOBODYS": "1"},
        stem="libintel",
        needs=("libmore.so",),
        needs_from="install it",
    )
    monkeypatch.setattr(runtimes, "RUNTIMES", (other, *runtimes.RUNTIMES))
    with runtimes._all_listed():
        assert os.environ["PYIBR_NOBODYS"] == "1"
    assert "PYIBR_NOBODYS" not in os.environ
    assert runtimes.problems() == [runtimes.Problem(f"Another ({intel}) lacks libmore.so", "install it")]
    assert runtimes.remedy_for(replace(found(0, "it", "cpu"), platform="Nobody's OpenCL")) == "mend it"


@pytest.mark.parametrize(
    ("kind", "version", "count"),
    [("cpu", "3.1, LLVM 15", 1), ("cpu", "6.0, LLVM 19", 0), ("cpu", "8.0, LLVM 17", 0), ("gpu", "3.1, LLVM 15", 0)],
)
def test_releases_of_pocl_that_were_read_optimize_each_kernel_alone(kind: runtimes.Kind, version: str, count: int):
    device = found(0, "it", kind, f"OpenCL 3.0 PoCL {version}.0.6, SLEEF")
    assert len(runtimes.runtime_of(device).options(device)) == count


AFTER_ANOTHER_LIBRARY = """
import ctypes, sys
from pathlib import Path
from pyibr.opencl import runtimes, unlisted
folder = Path(sys.argv[1])
older = ctypes.CDLL(str(folder / "open3d/libtbb.so.12"))
unlisted._prefixes = lambda: [folder]
with runtimes._all_listed():
    print(ctypes.CDLL(str(folder / "lib/libintelocl.so")).answer(), older.version())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="Intel's runtime from pip is for Linux")
def test_intels_runtime_is_loaded_beside_an_older_library_of_the_same_name(intel: Path):
    """Open3D, for example, loads an older library of that name, which lacks symbols; the linker would use it again."""
    compiler = shutil.which("cc") or pytest.skip("there is no C compiler")
    older = intel.parent.parent / "open3d"
    older.mkdir()
    for name in runtimes._INTEL.needs:
        (intel.parent / name).unlink()
    texts = {
        older / "libtbb.so.12": "int version(void) { return 1; }",
        intel.parent / "libtbb.so.12": "int version(void) { return 2; } int newer(void) { return 40; }",
        intel: "int version(void); int newer(void); int answer(void) { return newer() + version(); }",
    }
    for library, text in texts.items():
        needs = ["-L", library.parent, "-l:libtbb.so.12", "-Wl,-rpath,$ORIGIN"] if library == intel else []
        named = [f"-Wl,-soname,{library.name}", "-x", "c", "-", "-x", "none"]
        subprocess.run([compiler, "-shared", "-fPIC", *named, *needs, "-o", library], input=text, text=True, check=True)
    done = run_python("-c", AFTER_ANOTHER_LIBRARY, intel.parent.parent)
    assert done.stdout.split() == ["42", "1"], done.stderr


KERNEL = """
import os
from pyibr.opencl.program import kernel
print(kernel("lib/clear.cl", "clear").name, os.environ.get("POCL_CACHE_DIR"))
"""


@pytest.mark.thorough
@pytest.mark.parametrize("variable", ["HOME", "XDG_CACHE_HOME", "POCL_CACHE_DIR", ""])
def test_a_home_that_cannot_be_used_costs_no_device(tmp_path: Path, variable: str):
    """Containers may run with HOME=/ as a user without a name; PoCL and pyopencl also keep files in the home."""
    (tmp_path / "file").touch()
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    (tmp_path / "temporary").mkdir()
    paths = {"HOME": tmp_path / "file/home", "XDG_CACHE_HOME": Path("/proc"), "POCL_CACHE_DIR": tmp_path / "open"}
    environment = {name: value for name, value in with_path().items() if name not in {*paths, "PYIBR_CACHE"}}
    environment["TMPDIR"] = str(tmp_path / "temporary")
    environment |= {name: str(paths[name]) for name in ({"HOME", variable} if variable else ())}
    command = [sys.executable, "-W", "ignore", "-c", KERNEL]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == (f"clear {environment.get('POCL_CACHE_DIR')}\n", "")
    left = [*(tmp_path / "temporary").iterdir(), *(tmp_path / "open").iterdir()]
    assert not left, "no private folder stays, and nothing is loaded from shared folders"


@pytest.mark.skipif(os.name != "posix", reason="only POSIX systems need a PATH")
@pytest.mark.parametrize("path", [{}, pytest.param({"PATH": ""}, marks=pytest.mark.thorough)])
def test_an_environment_without_a_path_costs_no_device(tmp_path: Path, path: dict[str, str]):
    """Services may have no PATH, but PoCL's compiler needs it to find a linker."""
    kept = {name: value for name, value in with_path().items() if name.startswith(("PYIBR", "LD_", "PYTHONPATH"))}
    kept |= {"PYIBR_CACHE": str(tmp_path / "cache"), "HOME": str(tmp_path)}  # PoCL's cache is empty
    command = [sys.executable, "-c", "import pyibr as ibr; print([device.works for device in ibr.devices()])"]
    done = subprocess.run(command, env=kept | path, capture_output=True, text=True)
    assert "True" in done.stdout, done.stdout + done.stderr


PICTURES = """
import hashlib
from tools.everything import calls
made = calls()
for name in ("sweep", "mesh", "relief", "sliced"):
    print(hashlib.sha256(b"".join(array.tobytes() for array in made[name]())).hexdigest())
"""


@pytest.mark.thorough
def test_kernels_for_one_size_of_work_groups_draw_the_same(monkeypatch: pytest.MonkeyPatch):
    """PoCL compiles such kernels by default; `make test` disables this for the suite."""
    variable = "POCL_WORK_GROUP_SPECIALIZATION"
    monkeypatch.delenv(variable, raising=False)
    pictures = [run_python("-c", PICTURES, **told).stdout for told in ({}, {variable: "0"})]
    assert pictures[0] == pictures[1] != ""


POCLS = ("POCL_AFFINITY", "POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT")
THREADS = """
import json, os
import pyopencl  # numpy starts threads, which are not PoCL's
before = set(os.listdir("/proc/self/task"))
if {chosen}:
    os.sched_setaffinity(0, {chosen})
from pyibr.opencl.device import current
platform = current().device.platform
new = set(os.listdir("/proc/self/task")) - before
threads = [sorted(os.sched_getaffinity(int(name))) for name in new]
print(json.dumps([platform, threads, os.environ.get("POCL_AFFINITY")]))
"""


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="threads are only pinned on Linux")
@pytest.mark.parametrize("choice", ["nobody's", "taskset", *POCLS])
def test_threads_have_a_processor_each_unless_the_user_chose(choice: str):
    everywhere = sorted(os.sched_getaffinity(0))
    if everywhere != list(range(os.cpu_count() or 0)) or len(everywhere) < 2:
        pytest.skip("this process may not use all processors")
    environment = {name: value for name, value in os.environ.items() if name not in POCLS}
    if choice in POCLS:
        environment[choice] = "0" if choice == "POCL_AFFINITY" else str(len(everywhere))
    script = THREADS.format(chosen={1} if choice == "taskset" else "None")
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    platform, threads, variable = json.loads(done.stdout)
    assert variable == environment.get("POCL_AFFINITY")
    if "Portable" not in platform:
        pytest.skip("the device is not PoCL's")
    if choice == "nobody's":  # threads of other runtimes may be on any processor
        assert sorted(allowed for allowed in threads if len(allowed) == 1) == [[number] for number in everywhere]
    else:
        assert threads and all(allowed == ([1] if choice == "taskset" else everywhere) for allowed in threads)


@pytest.mark.parametrize("chosen", ["", "8"])
def test_intels_compiler_is_told_not_to_fill_lanes_unless_the_user_chose(chosen: str, monkeypatch: pytest.MonkeyPatch):
    """The compiler reads the variable when a context is created, not earlier or later."""
    name = "CL_CONFIG_CPU_VECTORIZER_MODE"
    monkeypatch.setenv(name, chosen) if chosen else monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(cl, "Context", lambda devices: os.environ.get(name))
    assert runtimes.new_context(runtimes.found_devices()[0].handle) == (chosen or "1")
    assert os.environ.get(name, "") == chosen


RELIEF = """
import numpy as np
import pyibr as ibr
square = ibr.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 1, 2]], uv=[[0, 0], [1, 0], [1, 1]])
relief = ibr.ReliefSurface(square, np.eye(4, dtype=np.float32), np.zeros((2, 2, 3), np.uint8), 0.1)
ibr.render(relief, ibr.Camera.look_at((0, 0, 2), (0, 0, 0), (0, 1, 0), (32, 32), fov_y=45))
"""


@pytest.mark.skipif(
    not any("intel" in found.platform.lower() for found in runtimes.found_devices()), reason="needs Intel's runtime"
)
def test_intels_compiler_leaves_lanes_alone(tmp_path: Path):
    """If it filled lanes, it would generate ten times as much code for a relief, in half a minute."""
    environment = os.environ | {"PYIBR_DEVICE": "intel", "PYIBR_CACHE": str(tmp_path / "cache")}
    environment.pop("CL_CONFIG_CPU_VECTORIZER_MODE", None)
    subprocess.run([sys.executable, "-c", RELIEF], env=environment, check=True, timeout=300)
    (program,) = (tmp_path / "cache").rglob("relief-*")
    assert program.stat().st_size < 1e6


@pytest.mark.skipif(
    os.environ.get(VARIABLE) != "intel", reason="make test-intel draws by both runtimes (PYIBR_DEVICE=intel)"
)
@pytest.mark.parametrize("name", ["sweep", "connected", "blended", "registered", "cleaned", "depth image", "relief"])
def test_intels_pictures_are_pocls(name: str):
    """The bits are the same for the releases in `make test-devices`; other releases may round differently."""
    drawn = []
    for device in ("intel", "portable computing language"):
        with ibr.use_device(device):
            drawn.append(calls()[name]())
    for one, other in zip(*drawn, strict=True):
        assert one.shape == other.shape
        level = 1 if one.dtype == np.uint8 else 0
        assert np.isclose(one.astype(float), other, rtol=1e-5, atol=level, equal_nan=True).mean() >= 0.999
