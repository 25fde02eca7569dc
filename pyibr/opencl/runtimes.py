"""Find the OpenCL runtimes of this machine, those that pip installed included.

What each of them needs stands in `RUNTIMES`. It is there while the loader reads its list, without a file left behind
and without an environment variable that stays set, but for a missing ``PATH``.
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

from pyibr.core.distributions import version_of
from pyibr.core.errors import DeviceError
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
atexit.register(_until_exit.close)  # after calls have ended, whose module is imported after this one


@dataclass(frozen=True)
class Found:
    """An OpenCL device that a runtime lists; whether it works is another question (see `probe`)."""

    index: int
    platform: str
    name: str
    vendor: str
    version: str
    """The platform's version: the standard's and the runtime's."""
    driver: str
    kind: Kind
    key: str
    """A digest of all that decides whether the device works; the same in every process of this machine."""
    handle: cl.Device = field(repr=False, compare=False)

    def words(self) -> str:
        """All that a user may name it by, in lower case."""
        return "\n".join([self.platform, self.name, self.version, self.driver, self.kind]).lower()


@dataclass(frozen=True)
class Problem:
    """A runtime that is installed but cannot be loaded, and the command that mends it."""

    what: str
    remedy: str


@dataclass(frozen=True)
class Runtime:
    """A CPU's runtime, and all that is particular to it."""

    name: str
    platform: str
    """A part of its platform's name, in lower case."""
    mend: Callable[[], str] = lambda: cpu_remedies()[-1]
    """The command to run where it is listed but does not work; unless there is one, another runtime helps."""
    install: Callable[[], str] = str
    """The command that installs it here, or nothing."""
    wheel: str = ""
    """Its package on PyPI, if only the driver's version, which begins with that, tells it from others."""
    environment: Callable[[], dict[str, str]] = dict
    """Variables that it reads as devices are listed; none where the user has chosen."""
    compiling: Callable[[], dict[str, str]] = dict
    """Those that its compiler reads as a context is made."""
    options: Callable[[Found], list[str]] = lambda _: []
    """Those that programs for a device of its own are built with, beside others."""
    compiles_for_binaries: bool = False
    """True of one that compiles all kernels once more to hand out a binary."""
    keeps_kernels: Callable[[], bool] = lambda: False
    """Tells whether it keeps what it has compiled on disk itself, where other processes find it."""
    stem: str = ""
    """What the name of its library begins with."""
    needs: tuple[str, ...] = ()
    """Libraries beside its own that the dynamic linker does not find, or finds elsewhere: they are loaded first."""
    needs_from: str = ""
    """The command that installs them."""

    def is_of(self, found: Found) -> bool:
        """Tell whether a device is its own."""
        version = version_of(self.wheel) if self.wheel else ""
        return self.platform in found.platform.lower() and version is not None and found.driver.startswith(version)

    def needed_by(self, library: Path) -> list[Path]:
        """Libraries that a library needs, if it is this runtime's."""
        return [library.parent / name for name in self.needs if library.name.startswith(self.stem)]


@functools.cache
def found_devices() -> tuple[Found, ...]:
    """All devices that the OpenCL loader lists, in its order. Nothing is built or run on them.

    Raises
    ------
    DeviceError
        pyopencl or the OpenCL loader cannot be imported.
    """
    if os.name == "posix" and not os.environ.get("PATH"):
        # Where programs are found without it, too; but PoCL's compiler finds no linker then, and ends the process.
        os.environ["PATH"] = os.defpath
    try:
        # Its own cache holds code in a folder that need not be safe, or not even be there: then it cannot be imported.
        with environment({"PYOPENCL_NO_CACHE": "1"}):
            import pyopencl as cl
    except ImportError as error:
        remedy = "pip install --force-reinstall pyopencl"  # with the loader that it needs
        raise DeviceError(f"pyopencl cannot be imported ({error}); to mend it: {remedy}") from error

    listed: list[tuple[cl.Platform, list[cl.Device]]] = []
    with _all_listed(), suppress(cl.Error):  # the loader's way to say that there is none
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
            seen[text] += 1  # equal cards differ by their number alone
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
    """Runtimes that are installed but cannot be loaded, each with the command that mends it."""
    found: list[Problem] = []
    unlisted = unlisted_runtimes()
    for variable in (name for name in LOADER_VARIABLES if os.environ.get(name)):
        others = [str(one.path) for one in unlisted if one.path.name != Path(os.environ[variable]).name]
        hidden = f" and hides {', '.join(others)}" if others else ""
        if hidden or not found_devices():
            what = f"${variable} is set to {os.environ[variable]!r}, so the loader looks nowhere else{hidden}"
            found.append(Problem(what, f"unset {variable}"))
    for runtime, one in itertools.product(RUNTIMES, unlisted):
        if missing := [path.name for path in runtime.needed_by(one.path) if not path.exists()]:
            found.append(Problem(f"{runtime.name} ({one.path}) lacks {', '.join(missing)}", runtime.needs_from))
    if has_nvidias_driver() and not has_nvidias_library():
        what = f"NVIDIA's driver is here, but not its OpenCL library, {NVIDIA}"
        found.append(Problem(what, "set NVIDIA_DRIVER_CAPABILITIES=all in a container, else install that library"))
    return found


def cpu_remedies() -> list[str]:
    """The commands that install an OpenCL runtime for the CPU here, best first."""
    commands = [command for runtime in RUNTIMES if (command := runtime.install())]
    return commands or ["conda install -c conda-forge pyopencl pocl"]


def remedy_for(found: Found) -> str:
    """The command that mends a device that is listed but does not work."""
    if found.kind == "gpu":
        return f"update the OpenCL driver of {found.vendor or found.platform}"
    return runtime_of(found).mend()


def runtime_of(found: Found) -> Runtime:
    """The runtime of a device; one without particulars where it is none of `RUNTIMES`."""
    return next((runtime for runtime in RUNTIMES if runtime.is_of(found)), Runtime("", ""))


def new_context(device: cl.Device) -> cl.Context:
    """A context of a device, whose compiler sees what it wants."""
    import pyopencl as cl

    with environment({name: value for runtime in RUNTIMES for name, value in runtime.compiling().items()}):
        return cl.Context([device])


@contextmanager
def _all_listed() -> Generator[None, None, None]:
    """While it is open, the loader sees the system's runtimes and the unlisted ones, and they see what they want.

    A user who set the loader's own variables is left alone.
    """
    wanted = {name: value for runtime in RUNTIMES for name, value in runtime.environment().items()}
    unlisted = [] if any(os.environ.get(name) for name in LOADER_VARIABLES) else unlisted_runtimes()
    for needed in (path for one in unlisted for runtime in RUNTIMES for path in runtime.needed_by(one.path)):
        with suppress(OSError):  # `problems` tells what is missing
            _load(needed)
    with environment(wanted), seen_by_the_loader(unlisted):
        yield


def _load(needed: Path) -> None:
    """Load a library that a runtime needs, in its own version.

    The linker would take a library of that name that another package has loaded, Open3D's older TBB for Intel's. What
    all can see comes before that. Others have found what they need: Python has their names looked up as it loads them.
    """
    try:
        ctypes.CDLL(needed.name, mode=getattr(os, "RTLD_NOLOAD", 0))
    except OSError:
        ctypes.CDLL(str(needed))
    else:
        ctypes.CDLL(str(needed), mode=ctypes.RTLD_GLOBAL)


def _processor() -> str:
    """Description of this processor: a folder for caches may be shared by machines that differ in nothing else."""
    try:
        with Path("/proc/cpuinfo").open() as file:
            text = file.read(8192).split("\n\n", 1)[0]  # one processor is enough, and there may be hundreds
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
    """PoCL keeps each thread that it starts on a processor of its own.

    Linux wakes threads that have slept side by side on one processor, and spreads them after milliseconds: longer than
    most frames take. A user who chose the processors, or set PoCL's own variables, is left alone.
    """
    everywhere = sys.platform == "linux" and os.sched_getaffinity(0) == set(range(os.cpu_count() or 0))
    return {} if not everywhere or any(name in os.environ for name in _THREAD_VARIABLES) else {"POCL_AFFINITY": "1"}


def _kernels_of_pocl() -> Path | None:
    """The folder that PoCL keeps kernels in; None where that is one that everybody may have made."""
    for variable, below in (("POCL_CACHE_DIR", ""), ("XDG_CACHE_HOME", "pocl/kcache"), ("HOME", ".cache/pocl/kcache")):
        if chosen := os.environ.get(variable):
            return Path(chosen) / below
    return None


def _shares_kernels() -> bool:
    """Tell whether PoCL's folder is one that it can write and that nobody else can."""
    folder = _kernels_of_pocl()
    if folder is None or distrust(folder) is not None:
        return False
    nearest = next((place for place in (folder, *folder.parents) if os.access(place, os.F_OK)), folder)
    with suppress(OSError):
        Path(tempfile.mkdtemp(dir=nearest)).rmdir()
        return True
    return False


def _safe_kernels() -> dict[str, str]:
    """PoCL lists no device where it cannot write its folder, and loads what lies there: then a private one serves."""
    if _shares_kernels():
        return {}
    private = temporary_folder(_until_exit)
    return {} if private is None else {"POCL_CACHE_DIR": str(private)}


def _optimized_once(found: Found) -> list[str]:
    """PoCL optimizes a program, and then each kernel with all that it calls, which is enough: half of a build's time.

    It looks at options between spaces, and clang at what tabs part there; so do the releases that were read. From LLVM
    18 on a pass ends the process if it has not done all at once, and so it may where none has gone before.
    """
    was_read = found.kind == "cpu" and re.search(r"PoCL [3-7]\..*LLVM 1[4-7]\.", found.version)
    return ["-DBY_KERNEL\t-disable-llvm-passes"] if was_read else []


def _mend_pocl_wheel() -> str:
    """Its compiler is older than many processors; the distribution's build is not."""
    here = (SYSTEM_ICDS / "pocl.icd").exists()
    return "pip uninstall pocl-binary-distribution" if here else cpu_remedies()[0]


def _items_apart() -> dict[str, str]:
    """Intel's compiler puts work-items into lanes; of kernels that have lanes already it makes ten times as much code.

    On CPUs without AVX-512 that takes it minutes, for code that never runs: a work-group is one work-item.
    """
    variable = "CL_CONFIG_CPU_VECTORIZER_MODE"
    return {} if variable in os.environ else {variable: "1"}


def _install_intel() -> str:
    fits = sys.platform in ("linux", "win32") and platform.machine() in ("x86_64", "AMD64")
    return "pip install intel-opencl-rt intel-cmplr-lib-rt" if fits else ""


_POCL = Runtime(
    "PoCL",
    "portable computing language",
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
RUNTIMES = (_POCL_WHEEL, _POCL, _INTEL)
"""All that need anything: a device is of the first that says so, and the first that can be installed is best."""
