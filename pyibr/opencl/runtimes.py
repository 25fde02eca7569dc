"""Find the OpenCL runtimes of this machine, those that pip installed included.

Intel's CPU runtime from PyPI (``intel-opencl-rt``) cannot be found as it is installed: its ``.icd`` file
holds a path of the machine that packed it, and the libraries it needs lie where the dynamic linker does not
look. Both are mended here while the loader reads its list, without a file left behind and without an
environment variable that stays set. PoCL's threads are kept on processors of their own in the same way.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import json
import os
import platform
import site
import sys
import tempfile
from collections import Counter
from collections.abc import Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from pyibr.core.errors import DeviceError

if TYPE_CHECKING:
    import pyopencl as cl

Kind = Literal["cpu", "gpu", "accelerator"]

_SYSTEM_ICDS = Path("/etc/OpenCL/vendors")
_LOADER_VARIABLES = ("OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH", "OCL_ICD_FILENAMES")
_THREAD_VARIABLES = ("POCL_AFFINITY", "POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT")
_INTEL_NEEDS = ("libintlc.so.5", "libirng.so", "libimf.so", "libsvml.so")
_INTEL_PIP = "pip install intel-opencl-rt intel-cmplr-lib-rt"


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


@functools.cache
def found_devices() -> tuple[Found, ...]:
    """All devices that the OpenCL loader lists, in its order. Nothing is built or run on them.

    Raises
    ------
    DeviceError
        pyopencl or the OpenCL loader cannot be imported.
    """
    try:
        import pyopencl as cl
    except ImportError as error:
        raise DeviceError(f"pyopencl cannot be imported ({error}); to mend it: {loader_remedy()}") from error

    listed: list[tuple[cl.Platform, list[cl.Device]]] = []
    with _mended_runtimes(), _pinned_threads(), suppress(cl.Error):  # the loader's way to say that there is none
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
    mended = _mended_icds()
    for variable in (name for name in _LOADER_VARIABLES if os.environ.get(name)):
        hidden = f" and hides {', '.join(str(library) for _, library in mended)}" if mended else ""
        if hidden or not found_devices():
            what = f"${variable} is set to {os.environ[variable]!r}, so the loader looks nowhere else{hidden}"
            found.append(Problem(what, f"unset {variable}"))
    for _, library in mended:
        if missing := [name for name in _INTEL_NEEDS if not (library.parent / name).exists()]:
            what = f"Intel's CPU runtime ({library}) lacks {', '.join(missing)}"
            found.append(Problem(what, "pip install intel-cmplr-lib-rt"))
    return found


def cpu_remedies() -> list[str]:
    """The commands that install an OpenCL runtime for the CPU here, best first."""
    commands: list[str] = []
    if command := _system_remedy():
        commands.append(command)
    if sys.platform == "linux" and platform.machine() in ("x86_64", "AMD64"):
        commands.append(_INTEL_PIP)
    return commands or ["conda install -c conda-forge pocl"]


def remedy_for(found: Found) -> str:
    """The command that mends a device that is listed but does not work."""
    if found.kind == "gpu":
        return f"update the OpenCL driver of {found.vendor or found.platform}"
    if "intel" in found.platform.lower():
        return _INTEL_PIP.replace("install", "install --upgrade")
    wheel = _pip_pocl()
    if not wheel or not found.driver.startswith(wheel):
        return cpu_remedies()[-1]  # it is the distribution's: another runtime helps
    # The wheel's compiler is older than many processors; the distribution's build is not.
    if (_SYSTEM_ICDS / "pocl.icd").exists():
        return "pip uninstall pocl-binary-distribution"
    return cpu_remedies()[0]


def loader_remedy() -> str:
    """The command that installs pyopencl with the loader that it needs."""
    return "pip install --force-reinstall pyopencl"


def _system_remedy() -> str:
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
    if "arch" in family:
        return f"{sudo}pacman -S pocl"
    return ""


def _pip_pocl() -> str:
    """The version of PoCL's wheel, if that is installed."""
    from importlib import metadata

    try:
        return metadata.version("pocl-binary-distribution")
    except metadata.PackageNotFoundError:
        return ""


def _prefixes() -> list[Path]:
    """Where pip puts a wheel's data: this environment, the user's folder, the machine's."""
    return [Path(p) for p in dict.fromkeys([sys.prefix, site.getuserbase(), "/usr/local"])]


def _mended_icds() -> list[tuple[str, Path]]:
    """(name, library) of every ``.icd`` file of pip's whose path is wrong and whose library is here."""
    mended: list[tuple[str, Path]] = []
    for prefix in _prefixes():
        for icd in sorted((prefix / "etc/OpenCL/vendors").glob("*.icd")):
            try:
                library = Path(icd.read_text().strip())
            except (OSError, UnicodeDecodeError):
                continue
            here = prefix / "lib" / library.name
            if library.is_absolute() and not library.exists() and here.is_file():
                mended.append((icd.name, here))
    return mended


@contextmanager
def _mended_runtimes() -> Generator[None, None, None]:
    """While it is open, the loader sees the system's runtimes and the mended ones.

    A user who set the loader's own variables is left alone.
    """
    mended = _mended_icds()
    if not mended or any(os.environ.get(name) for name in _LOADER_VARIABLES):
        yield
        return
    for _, library in mended:
        _preload(library.parent)
    with tempfile.TemporaryDirectory(prefix="pyibr-icd-") as folder:
        for icd in _SYSTEM_ICDS.glob("*.icd"):
            (Path(folder) / icd.name).symlink_to(icd)
        for number, (name, library) in enumerate(mended):
            (Path(folder) / f"pip{number}-{name}").write_text(f"{library}\n")
        os.environ["OCL_ICD_VENDORS"] = folder
        try:
            yield
        finally:
            del os.environ["OCL_ICD_VENDORS"]


@contextmanager
def _pinned_threads() -> Generator[None, None, None]:
    """While it is open, PoCL keeps each thread that it starts on a processor of its own.

    Linux wakes threads that have slept side by side on one processor, and spreads them after milliseconds: longer than
    most frames take. A user who chose the processors, or set PoCL's own variables, is left alone.
    """
    everywhere = sys.platform == "linux" and os.sched_getaffinity(0) == set(range(os.cpu_count() or 0))
    if not everywhere or any(name in os.environ for name in _THREAD_VARIABLES):
        yield
        return
    os.environ["POCL_AFFINITY"] = "1"
    try:
        yield
    finally:
        del os.environ["POCL_AFFINITY"]


def _preload(folder: Path) -> None:
    """Load what Intel's runtime links to, so that the dynamic linker finds it already there."""
    for name in _INTEL_NEEDS:
        try:
            ctypes.CDLL(str(folder / name))
        except OSError:  # `problems` tells what is missing
            continue


def _processor() -> str:
    """What this processor is: a folder for caches may be shared by machines that differ in nothing else."""
    try:
        with Path("/proc/cpuinfo").open() as file:
            text = file.read(8192).split("\n\n", 1)[0]  # one processor is enough, and there may be hundreds
    except OSError:
        return f"{platform.machine()} {platform.processor()}"
    wanted = ("model", "stepping", "flags", "CPU", "Features")
    return "\n".join(line for line in text.splitlines() if line.startswith(wanted))
