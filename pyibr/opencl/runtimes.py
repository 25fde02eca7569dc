"""Discovery of this machine's OpenCL runtimes, including runtimes installed by pip.

`RUNTIMES` lists the needs of each runtime. They are met while the loader reads its list. No file is left behind, and no
environment variable stays set, except a missing ``PATH``.
"""

from __future__ import annotations

import atexit
import ctypes
import functools
import hashlib
import itertools
import json
import os
import platform
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from pyibr.core.errors import DeviceError
from pyibr.core.optional import version_of
from pyibr.opencl.cache import distrust
from pyibr.opencl.unlisted import (
    LOADER_VARIABLES,
    NVIDIA,
    SYSTEM_ICDS,
    environment,
    has_nvidias_driver,
    has_nvidias_library,
    seen_by_the_loader,
    temporary_folder,
    unlisted_runtimes,
)

if TYPE_CHECKING:
    import pyopencl as cl

Kind = Literal["cpu", "gpu", "accelerator"]

_THREAD_VARIABLES = ("POCL_AFFINITY", "POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT")

_until_exit = ExitStack()
atexit.register(_until_exit.close)  # runs after calls have ended: their module is imported later


@dataclass(frozen=True)
class Found:
    """An OpenCL device that a runtime lists. It may not work: see `probe`."""

    index: int
    platform: str
    name: str
    vendor: str
    version: str
    """The platform's version: the version of OpenCL, and of the runtime."""
    driver: str
    kind: Kind
    key: str
    """A hash of everything that affects whether the device works; equal in all processes of this machine."""
    handle: cl.Device = field(repr=False, compare=False)

    def words(self) -> str:
        """Return all texts by which a user may select the device, in lower case."""
        return "\n".join([self.platform, self.name, self.version, self.driver, self.kind]).lower()


@dataclass(frozen=True)
class Problem:
    """A runtime that is installed but cannot be loaded, and the command that fixes it."""

    what: str
    remedy: str


@dataclass(frozen=True)
class Runtime:
    """An OpenCL runtime for CPUs and its particulars."""

    name: str
    platform: str
    """A part of the platform's name, in lower case."""
    mend: Callable[[], str] = lambda: cpu_remedies()[0]
    """Returns the command that fixes a listed runtime that does not work; by default, it installs another runtime."""
    install: Callable[[], str] = str
    """Returns the command that installs the runtime here; empty if there is none."""
    wheel: str = ""
    """Package on PyPI, for runtimes recognized by version: the driver's version starts with the package's version."""
    environment: Callable[[], dict[str, str]] = dict
    """Returns variables that the runtime reads when devices are listed; empty where the user has set them."""
    compiling: Callable[[], dict[str, str]] = dict
    """Returns variables that the compiler reads when a context is created."""
    options: Callable[[Found], list[str]] = lambda _: []
    """Returns additional build options for programs on one of the runtime's devices."""
    compiles_for_binaries: bool = False
    """Whether the runtime compiles all kernels again to return a binary."""
    keeps_kernels: Callable[[], bool] = lambda: False
    """Returns whether the runtime keeps compiled kernels on disk, where other processes find them."""
    stem: str = ""
    """Start of the library's file name."""
    needs: tuple[str, ...] = ()
    """Libraries next to it that the dynamic linker does not find, or finds elsewhere: they are loaded first."""
    needs_from: str = ""
    """The command that installs these libraries."""

    def is_of(self, found: Found) -> bool:
        """Tell whether a device belongs to this runtime."""
        version = version_of(self.wheel) if self.wheel else ""
        return self.platform in found.platform.lower() and version is not None and found.driver.startswith(version)

    def needed_by(self, library: Path) -> list[Path]:
        """Return the libraries that `library` needs, if it belongs to this runtime."""
        return [library.parent / name for name in self.needs if library.name.startswith(self.stem)]


@functools.cache
def found_devices() -> tuple[Found, ...]:
    """Return all devices that the OpenCL loader lists, in its order. Nothing is built or run on them.

    Raises
    ------
    DeviceError
        pyopencl or the OpenCL loader cannot be imported.
    """
    if os.name == "posix" and not os.environ.get("PATH"):
        # Programs are found without PATH, too, but PoCL's compiler then finds no linker and ends the process.
        os.environ["PATH"] = os.defpath
    try:
        # pyopencl's cache holds code in a folder that may be unsafe; if the folder is missing, the import fails.
        with environment({"PYOPENCL_NO_CACHE": "1"}):
            import pyopencl as cl
    except ImportError as error:
        remedy = "pip install --force-reinstall pyopencl"  # also installs the loader
        raise DeviceError(f"pyopencl cannot be imported ({error}); to mend it: {remedy}") from error

    listed: list[tuple[cl.Platform, list[cl.Device]]] = []
    with _all_listed(), suppress(cl.Error):  # raised if there is no platform
        for entry in cl.get_platforms():
            with suppress(cl.Error):
                listed.append((entry, entry.get_devices()))
    found: list[Found] = []
    seen: Counter[str] = Counter()
    for entry, handles in listed:
        for handle in handles:
            names = [entry.name, handle.name, handle.vendor]
            versions = [entry.version, handle.version, handle.driver_version, cl.VERSION_TEXT]
            text = json.dumps([names, versions, _processor()])
            seen[text] += 1  # equal cards differ only in their number
            key = hashlib.sha256(f"{text}{seen[text]}".encode()).hexdigest()[:20]
            kind: Kind = "accelerator"
            if handle.type & cl.device_type.GPU:
                kind = "gpu"
            elif handle.type & cl.device_type.CPU:
                kind = "cpu"
            found.append(
                Found(
                    index=len(found),
                    platform=entry.name.strip(),
                    name=" ".join(handle.name.split()),
                    vendor=handle.vendor.strip(),
                    version=entry.version.strip(),
                    driver=handle.driver_version.strip(),
                    kind=kind,
                    key=key,
                    handle=handle,
                )
            )
    return tuple(found)


def problems() -> list[Problem]:
    """Return the runtimes that are installed but cannot be loaded, each with the command that fixes it."""
    found: list[Problem] = []
    unlisted = unlisted_runtimes()
    for variable in (name for name in LOADER_VARIABLES if os.environ.get(name)):
        others = [str(one.path) for one in unlisted if one.path.name != Path(os.environ[variable]).name]
        hidden = f" and does not find {', '.join(others)}" if others else ""
        if hidden or not found_devices():
            what = f"${variable} is set to {os.environ[variable]!r}, so the loader searches only there{hidden}"
            found.append(Problem(what, f"unset {variable}"))
    for runtime, one in itertools.product(RUNTIMES, unlisted):
        if missing := [path.name for path in runtime.needed_by(one.path) if not path.exists()]:
            found.append(Problem(f"{runtime.name} ({one.path}) lacks {', '.join(missing)}", runtime.needs_from))
    if (forbidden := _forbidden_folder()) and any(runtime_of(one) is _POCL for one in found_devices()):
        found.append(forbidden)
    if has_nvidias_driver() and not has_nvidias_library():
        what = f"NVIDIA's driver is installed, but its OpenCL library, {NVIDIA}, is missing"
        found.append(Problem(what, "set NVIDIA_DRIVER_CAPABILITIES=all in a container, else install that library"))
    return found


def _forbidden_folder() -> Problem | None:
    """Find the fault of PoCL's folder of compiled kernels if its file system is mounted noexec."""
    base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    folder = Path(os.environ.get("POCL_CACHE_DIR") or f"{base}/pocl").expanduser().absolute()
    there = next(one for one in (folder, *folder.parents) if one.exists())
    if not hasattr(os, "ST_NOEXEC") or not os.statvfs(there).f_flag & os.ST_NOEXEC:
        return None
    what = f"PoCL cannot load the kernels that it compiles: their folder {folder} is mounted noexec"
    return Problem(what, "set POCL_CACHE_DIR to a folder on another file system")


def cpu_remedies() -> list[str]:
    """Return the commands that install an OpenCL runtime for the CPU on this machine, best first."""
    commands = [command for runtime in RUNTIMES if (command := runtime.install())]
    return commands or ["conda install -c conda-forge pyopencl pocl"]


def remedy_for(found: Found) -> str:
    """Return the command that fixes a device that is listed but does not work."""
    if found.kind == "gpu":
        return f"update the OpenCL driver of {found.vendor or found.platform}"
    return runtime_of(found).mend()


def runtime_of(found: Found) -> Runtime:
    """Return the runtime of a device."""
    return next(runtime for runtime in RUNTIMES if runtime.is_of(found))


def preference(found: Found) -> tuple[int, int]:
    """Return the sort key by which devices are chosen: GPUs, then CPUs by their runtimes, then other devices."""
    kind = ("gpu", "cpu", "accelerator").index(found.kind)
    return kind, RUNTIMES.index(runtime_of(found)) if found.kind == "cpu" else 0


def new_context(device: cl.Device) -> cl.Context:
    """Return a context for a device, created with the variables that its compiler needs."""
    import pyopencl as cl

    with environment({name: value for runtime in RUNTIMES for name, value in runtime.compiling().items()}):
        return cl.Context([device])


@contextmanager
def _all_listed() -> Generator[None, None, None]:
    """Let the loader see the system's runtimes and the unlisted ones, with the variables that they need.

    Variables of the loader that the user has set stay unchanged.
    """
    wanted = {name: value for runtime in RUNTIMES for name, value in runtime.environment().items()}
    unlisted = [] if any(os.environ.get(name) for name in LOADER_VARIABLES) else unlisted_runtimes()
    for needed in (path for one in unlisted for runtime in RUNTIMES for path in runtime.needed_by(one.path)):
        with suppress(OSError):  # `problems` reports missing libraries
            _load(needed)
    with environment(wanted), seen_by_the_loader(unlisted):
        yield


def _load(needed: Path) -> None:
    """Load a library that a runtime needs, in the runtime's own version.

    The linker would otherwise take a library of the same name that another package has loaded, such as Open3D's older
    TBB for Intel's. A library loaded with RTLD_GLOBAL takes precedence. Packages that are already loaded are not
    affected: Python resolves their symbols while it loads them.
    """
    try:
        ctypes.CDLL(needed.name, mode=getattr(os, "RTLD_NOLOAD", 0))
    except OSError:
        ctypes.CDLL(str(needed))
    else:
        ctypes.CDLL(str(needed), mode=ctypes.RTLD_GLOBAL)


def _processor() -> str:
    """Description of this processor, since machines that differ only in it may share a cache folder."""
    try:
        with Path("/proc/cpuinfo").open() as file:
            text = file.read(8192).split("\n\n", 1)[0]  # the first processor
    except OSError:
        return f"{platform.machine()} {platform.processor()}"
    wanted = ("model", "stepping", "flags", "CPU", "Features")
    return "\n".join(line for line in text.splitlines() if line.startswith(wanted))


def _install_pocl() -> str:
    if sys.platform == "linux" and (Path(sys.prefix) / "conda-meta").is_dir():
        return "conda install -c conda-forge pocl"
    try:
        lines = platform.freedesktop_os_release()
    except OSError:
        return ""
    sudo = "" if os.geteuid() == 0 else "sudo "
    family = {lines.get("ID", ""), *lines.get("ID_LIKE", "").split()}
    if family & {"debian", "ubuntu"}:
        return f"{sudo}apt install pocl-opencl-icd ocl-icd-libopencl1"
    if family & {"fedora", "rhel", "centos"}:
        return f"{sudo}dnf install pocl"
    return f"{sudo}pacman -S pocl" if "arch" in family else ""


def _pinned_threads() -> dict[str, str]:
    """Variables that make PoCL pin each of its threads to its own processor.

    Linux wakes threads that slept together on one processor, and spreads them only after milliseconds, longer than most
    frames take. There are no variables if the user chose processors or set PoCL's own variables.
    """
    everywhere = sys.platform == "linux" and os.sched_getaffinity(0) == set(range(os.cpu_count() or 0))
    return {} if not everywhere or any(name in os.environ for name in _THREAD_VARIABLES) else {"POCL_AFFINITY": "1"}


def _kernels_of_pocl() -> Path | None:
    """PoCL's folder for kernels; None where it is a shared folder that any user may have created."""
    for variable, below in (("POCL_CACHE_DIR", ""), ("XDG_CACHE_HOME", "pocl/kcache"), ("HOME", ".cache/pocl/kcache")):
        if chosen := os.environ.get(variable):
            return Path(chosen) / below
    return None


def _shares_kernels() -> bool:
    """Tell whether this user, and nobody else, can write to PoCL's folder."""
    folder = _kernels_of_pocl()
    if folder is None or distrust(folder) is not None:
        return False
    nearest = next((place for place in (folder, *folder.parents) if os.access(place, os.F_OK)), folder)
    with suppress(OSError):
        Path(tempfile.mkdtemp(dir=nearest)).rmdir()
        return True
    return False


def _safe_kernels() -> dict[str, str]:
    """Variables that give PoCL a private folder, unless its own is safe and writable.

    PoCL loads code from its folder, and lists no device if it cannot write there.
    """
    if _shares_kernels():
        return {}
    private = temporary_folder(_until_exit)
    return {} if private is None else {"POCL_CACHE_DIR": str(private)}


def _optimized_once(found: Found) -> list[str]:
    """Build options that make PoCL optimize each kernel, but not the whole program first: half of the build time.

    The option follows a tab. PoCL splits options only at spaces, so it does not see the option; clang splits also at
    tabs, and does. The sources of the matched releases show this. LLVM 18 and later are not matched, because one of
    their passes aborts the process if the whole program was not optimized.
    """
    was_read = found.kind == "cpu" and re.search(r"PoCL [3-7]\..*LLVM 1[4-7]\.", found.version)
    return ["-DBY_KERNEL\t-disable-llvm-passes"] if was_read else []


def _mend_pocl_wheel() -> str:
    """Command that replaces PoCL's wheel, whose compiler is older than many processors, by the distribution's build."""
    here = (SYSTEM_ICDS / "pocl.icd").exists()
    return "pip uninstall pocl-binary-distribution" if here else _install_pocl() or cpu_remedies()[0]


def _items_apart() -> dict[str, str]:
    """Variables that keep Intel's compiler from vectorizing over work-items.

    Kernels are vectorized already, so it would generate ten times as much code. On CPUs without AVX-512 that takes
    minutes, and the code would never run, since a work-group is one work-item.
    """
    variable = "CL_CONFIG_CPU_VECTORIZER_MODE"
    return {} if variable in os.environ else {variable: "1"}


def _install_intel() -> str:
    fits = sys.platform in ("linux", "win32") and platform.machine() in ("x86_64", "AMD64")
    return "pip install intel-opencl-rt intel-cmplr-lib-rt" if fits else ""


_POCL = Runtime(
    "PoCL",
    "portable computing language",
    mend=lambda: forbidden.remedy if (forbidden := _forbidden_folder()) else cpu_remedies()[0],
    install=_install_pocl,
    environment=lambda: {**_pinned_threads(), **_safe_kernels()},
    options=_optimized_once,
    compiles_for_binaries=True,
    keeps_kernels=lambda: os.environ.get("POCL_KERNEL_CACHE") != "0" and _shares_kernels(),
)
_POCL_WHEEL = replace(_POCL, name="PoCL's wheel", mend=_mend_pocl_wheel, install=str, wheel="pocl-binary-distribution")
_WINDOWS = os.name == "nt"
_INTEL = Runtime(
    "Intel's CPU runtime",
    "intel",
    mend=lambda: "pip install --upgrade intel-opencl-rt intel-cmplr-lib-rt",
    install=_install_intel,
    compiling=_items_apart,
    stem="intelocl64" if _WINDOWS else "libintelocl",
    needs=("tbb12.dll",) if _WINDOWS else ("libintlc.so.5", "libirng.so", "libimf.so", "libsvml.so", "libtbb.so.12"),
    needs_from="pip install intel-cmplr-lib-rt tbb",
)
_OTHER = Runtime("another runtime", "")
RUNTIMES = (_INTEL, _POCL_WHEEL, _POCL, _OTHER)
"""Runtimes for CPUs, fastest first by ``python -m benchmarks runtimes``, except that PoCL's wheel precedes PoCL: a
device belongs to the first that matches. Every device matches the last."""
