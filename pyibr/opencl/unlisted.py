"""Installed runtimes that are missing in the OpenCL loader's list.

There are three reasons. pip and conda install runtimes into a Python environment, where the loader of pyopencl's wheels
does not search. The ``.icd`` files of Intel's wheels contain a path of the build machine. Containers get NVIDIA's
library without its ``.icd`` file.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import site
import sys
import tempfile
from collections.abc import Generator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

LOADER_VARIABLES = ("OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH", "OCL_ICD_FILENAMES")
"""Variables with which a user sets the OpenCL loader's search path."""
SYSTEM_ICDS = Path("/etc/OpenCL/vendors")
NVIDIA = "libnvidia-opencl.so.1"
_ON_WINDOWS = {"libintelocl.so": "intelocl64.dll"}  # the ``.icd`` file of the wheel has the Linux name on Windows, too


@dataclass(frozen=True)
class Unlisted:
    """A runtime's library, as a path or as a name for the dynamic linker, and the name of its ``.icd`` file."""

    icd: str
    path: Path


def unlisted_runtimes() -> list[Unlisted]:
    """Return all installed runtimes that are not in the loader's list."""
    listed = {icd.name: text for icd in _icds(SYSTEM_ICDS) if (text := _text(icd))}
    found: list[Unlisted] = []
    for prefix in _prefixes():
        for icd in (*_icds(prefix / "etc/OpenCL/vendors"), *_icds(prefix / "Library/etc/OpenCL/vendors")):
            text = _text(icd)
            if text and text not in listed.values() and (library := _library(prefix, text)):
                found.append(Unlisted(icd.name, library))
    if not any("nvidia" in f"{name} {text}" for name, text in listed.items()) and has_nvidias_library():
        found.append(Unlisted("nvidia.icd", Path(NVIDIA)))
    return found


@contextmanager
def seen_by_the_loader(runtimes: list[Unlisted]) -> Generator[None, None, None]:
    """Let the loader see these runtimes in addition to the system's inside the ``with`` block."""
    with ExitStack() as stack:
        if runtimes and os.name == "nt":
            libraries = [str(one.path) for one in runtimes]
            folders = dict.fromkeys(str(one.path.parent) for one in runtimes)
            # Until the process ends, since the runtimes load further libraries when they compile.
            os.environ["PATH"] = os.pathsep.join([*folders, os.environ.get("PATH", "")])
            stack.enter_context(environment({"OCL_ICD_FILENAMES": os.pathsep.join(libraries)}))
        elif runtimes and (folder := temporary_folder(stack)):
            for icd in _icds(SYSTEM_ICDS):
                (folder / icd.name).symlink_to(icd)
            for number, one in enumerate(runtimes):
                (folder / f"pyibr{number}-{one.icd}").write_text(f"{one.path}\n")
            stack.enter_context(environment({"OCL_ICD_VENDORS": str(folder)}))
        yield


@contextmanager
def environment(variables: dict[str, str]) -> Generator[None, None, None]:
    """Set environment variables inside the ``with`` block."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def temporary_folder(stack: ExitStack) -> Path | None:
    """Return a private folder, which is removed when the stack is closed; None if no folder can be created."""
    try:
        folder = Path(tempfile.mkdtemp(prefix="pyibr-"))
    except OSError:
        return None
    maker = os.getpid()
    stack.callback(lambda: shutil.rmtree(folder, ignore_errors=True) if os.getpid() == maker else None)
    return folder


def has_nvidias_library() -> bool:
    """Tell whether the dynamic linker finds NVIDIA's OpenCL library."""
    if os.name != "posix":  # on Windows, drivers register themselves
        return False
    with suppress(OSError):
        ctypes.CDLL(NVIDIA)
        return True
    return False


def has_nvidias_driver() -> bool:
    """Tell whether the Linux kernel has NVIDIA's driver; this also works in containers."""
    return Path("/proc/driver/nvidia/version").exists()


def _prefixes() -> list[Path]:
    """Folders where pip and conda install runtimes: this environment, the user's folder, the machine's folder."""
    return [Path(p) for p in dict.fromkeys([sys.prefix, site.getuserbase(), "/usr/local"])]


def _icds(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.icd"))


def _text(icd: Path) -> str:
    with suppress(OSError, UnicodeDecodeError):
        return icd.read_text().strip()
    return ""


def _library(prefix: Path, text: str) -> Path | None:
    """The library of an ``.icd`` file: at the path in the file, or in the library folder of the environment."""
    named = Path(text)
    places = [named, prefix / "lib" / named.name, prefix / "Library/bin" / _ON_WINDOWS.get(named.name, named.name)]
    return next((place for place in places if place.is_absolute() and place.is_file()), None)
