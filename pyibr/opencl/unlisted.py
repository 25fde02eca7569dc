"""Runtimes that are here although the OpenCL loader's own list lacks them.

pip and conda put them into a Python environment, where the loader of pyopencl's wheels does not look; the ``.icd``
files of Intel's wheels hold a path of the machine that packed them; containers get NVIDIA's library without its file.
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
"""With which a user tells the OpenCL loader where to look."""
SYSTEM_ICDS = Path("/etc/OpenCL/vendors")
NVIDIA = "libnvidia-opencl.so.1"
_ON_WINDOWS = {"libintelocl.so": "intelocl64.dll"}  # its wheel's file has Linux' name there, too


@dataclass(frozen=True)
class Unlisted:
    """A runtime's library, by its path or a name that the dynamic linker finds, and the name of its ``.icd`` file."""

    icd: str
    path: Path


def unlisted_runtimes() -> list[Unlisted]:
    """All of them; none where the loader's own list has them already."""
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
    """While it is open, the loader sees these runtimes beside the system's."""
    with ExitStack() as stack:
        if runtimes and os.name == "nt":
            libraries = [str(one.path) for one in runtimes]
            folders = dict.fromkeys(str(one.path.parent) for one in runtimes)
            # For as long as the process lives: they load more of their own as they compile.
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
    """While it is open, the environment has these, too."""
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
    """A folder of this process alone, which goes when the stack is closed; None where nothing can be written."""
    try:
        folder = Path(tempfile.mkdtemp(prefix="pyibr-"))
    except OSError:
        return None
    maker = os.getpid()
    stack.callback(lambda: shutil.rmtree(folder, ignore_errors=True) if os.getpid() == maker else None)
    return folder


def has_nvidias_library() -> bool:
    """Tell whether the dynamic linker finds it."""
    if os.name != "posix":  # Windows' drivers list themselves
        return False
    with suppress(OSError):
        ctypes.CDLL(NVIDIA)
        return True
    return False


def has_nvidias_driver() -> bool:
    """Tell whether the kernel has NVIDIA's driver, as containers see, too."""
    return Path("/proc/driver/nvidia/version").exists()


def _prefixes() -> list[Path]:
    """Folders where pip and conda put what belongs to a runtime: this environment, the user's folder, the machine's."""
    return [Path(p) for p in dict.fromkeys([sys.prefix, site.getuserbase(), "/usr/local"])]


def _icds(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.icd"))


def _text(icd: Path) -> str:
    with suppress(OSError, UnicodeDecodeError):
        return icd.read_text().strip()
    return ""


def _library(prefix: Path, text: str) -> Path | None:
    """The library that an ``.icd`` file of an environment means: where it says, or where the environment keeps it."""
    named = Path(text)
    places = [named, prefix / "lib" / named.name, prefix / "Library/bin" / _ON_WINDOWS.get(named.name, named.name)]
    return next((place for place in places if place.is_absolute() and place.is_file()), None)
