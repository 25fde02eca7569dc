"""The environment of a measurement."""

from __future__ import annotations

import os
import platform
import re
import subprocess
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

PACKAGES = {
    "pyibr": ("pyibr-opencl",),
    "numpy": ("numpy",),
    "pyopencl": ("pyopencl",),
    "opencv": (
        "opencv-contrib-python-headless",
        "opencv-contrib-python",
        "opencv-python-headless",
        "opencv-python",
    ),
    "open3d": ("open3d", "open3d-cpu"),
    "viser": ("viser",),
    "pymartini": ("pymartini",),
    "pydelatin": ("pydelatin",),
}


_SOURCES = (":(top)", ":(top,exclude)benchmarks/results", ":(top,exclude)docs/*.md")  # a run itself writes results


def environment() -> dict[str, Any]:
    """Return the device and its driver, the versions of packages, the processor, the commit, and the machine's load."""
    import pyibr as ibr
    from pyibr.opencl.device import explain

    device, reason = explain()
    versions = {name: _version(names) for name, names in PACKAGES.items()}
    versions["pyibr"] = ibr.__version__
    return {
        "time": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "device": device.name,
        "device_reason": reason,
        "platform": device.platform,
        "device_version": device.version,
        "driver": device.driver,
        "cpu": cpu_model(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "versions": versions,
        "commit": commit(),
        "load_average": list(os.getloadavg()) if hasattr(os, "getloadavg") else None,
    }


def cpu_model() -> str:
    """Name of the processor, as the system gives it."""
    try:
        found = re.search(r"model name\s*: (.+)", Path("/proc/cpuinfo").read_text())
    except OSError:
        found = None
    return found.group(1) if found else platform.processor()


def commit() -> str | None:
    """Return the commit that is checked out, with "+" if code differs; None without git."""
    here = Path(__file__).parent

    def git(*arguments: str) -> str:
        done = subprocess.run(["git", *arguments], cwd=here, capture_output=True, text=True, check=True)
        return done.stdout.strip()

    try:
        changed = git("status", "--porcelain", "--untracked-files=no", "--", *_SOURCES)
        return git("rev-parse", "HEAD") + "+" * bool(changed)
    except (OSError, subprocess.CalledProcessError):
        return None


def _version(names: tuple[str, ...]) -> str | None:
    for name in names:
        try:
            return version(name)
        except PackageNotFoundError:
            continue
    return None
