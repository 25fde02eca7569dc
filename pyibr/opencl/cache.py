"""The folder that keeps what one process learned for the next: probe results and program binaries."""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
from pathlib import Path


def cache_folder() -> Path:
    """Where pyibr caches: ``$PYIBR_CACHE``, else the platform's folder for caches.

    Returns
    -------
    Path
        The folder; it may not exist yet.

    Examples
    --------
    >>> cache_folder().is_absolute()
    True
    """
    if chosen := os.environ.get("PYIBR_CACHE"):
        return Path(chosen).expanduser().absolute()
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData/Local") / "pyibr" / "Cache"
    if sys.platform == "darwin":
        return Path.home() / "Library/Caches/pyibr"
    # A relative path there is invalid by the XDG specification.
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (base if base.is_absolute() else Path.home() / ".cache") / "pyibr"


def read_cached(path: Path) -> bytes | None:
    """The file's bytes, or None where it cannot be read."""
    try:
        return path.read_bytes()
    except OSError:
        return None


def write_cached(path: Path, data: bytes) -> bool:
    """Write atomically, so that a process that reads meanwhile sees the old file or the new one.

    Returns
    -------
    bool
        False where the folder cannot be written: a cache is a convenience, never an error.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, part = tempfile.mkstemp(dir=path.parent, prefix=path.name)
    except OSError:
        return False
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        Path(part).replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            Path(part).unlink()
        return False
    return True
