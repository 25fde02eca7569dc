"""The cache on disk: what one process learned for the next, test outcomes and programs; all that knows of its files.

What lies there becomes native code of this process. So an entry is believed only where nobody but the user can have
written it, and only if its checksum is right, which holds for this entry's own name alone. Whatever is doubtful is as
good as missing: it is made anew.
"""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
import stat
import sys
import time
import warnings
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pyibr.core.errors import ArgumentError

_VARIABLE = "PYIBR_CACHE"
_SCHEMA = b"pyibr cache 1\n"  # of entries, with what their makers write into them
_SHA256 = 32  # bytes
_BYTES_MAX = 1 << 28  # of a room: some hundred programs of CPUs, whose binaries are the largest
_DAY = 86400.0  # seconds
_TEMPORARY = ".part-"  # begins the names of entries that are being written
_OPEN_FLAGS = sum(
    getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY")
)  # no link; a pipe never waits

_warned: set[Path] = set()


def cache_folder() -> Path:
    """Folder of pyibr's cache: ``$PYIBR_CACHE``, else the platform's folder for caches.

    Returns
    -------
    Path
        The folder; it may not exist yet.

    Raises
    ------
    ArgumentError
        ``$PYIBR_CACHE`` names no folder.

    Examples
    --------
    >>> cache_folder().is_absolute()
    True
    """
    if chosen := os.environ.get(_VARIABLE):
        try:
            return Path(chosen).expanduser().absolute()
        except (OSError, RuntimeError) as error:  # no such user; or a relative path from a folder that is gone
            raise ArgumentError(f"${_VARIABLE}", "a folder's path", f"{chosen!r}: {error}") from None
    # A relative path there is invalid by the XDG specification.
    if sys.platform == "linux" and (base := Path(os.environ.get("XDG_CACHE_HOME", ""))).is_absolute():
        return base / "pyibr"
    try:
        home = Path.home()
    except RuntimeError:  # a user without a name, as in containers
        return Path(f"/tmp/pyibr-{_user()}")
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or home / "AppData/Local") / "pyibr" / "Cache"
    return home / ("Library/Caches/pyibr" if sys.platform == "darwin" else ".cache/pyibr")


def cache_fault() -> tuple[str, str] | None:
    """Fault of the cache, and what mends it; None where it can be used."""
    folder = cache_folder()
    for used in (folder, folder / "devices", folder / "programs"):
        if fault := distrust(used):
            why, remedy = fault
            return f"the cache folder {used} is not used, because {why}", remedy
    trial = Entry("programs", "trial", os.urandom(8).hex())  # of this call alone: others may remove theirs meanwhile
    trial.write(b"")
    if trial.read() is None:
        what = f"the cache folder {folder} cannot be written, so that each process compiles its kernels"
        return what, f"set {_VARIABLE} to a folder that can be written"
    trial.forget()
    return None


@dataclass(frozen=True)
class Entry:
    """A file of the cache.

    Attributes
    ----------
    room : {"devices", "programs"}
        The folder that it lies in.
    name : str
        For people: what its file's name begins with.
    identity : str
        All that its content depends on.
    """

    room: Literal["devices", "programs"]
    name: str
    identity: str

    def read(self) -> bytes | None:
        """The content; None where there is none that is to be trusted."""
        room = self._room()
        if room is None:
            return None
        try:
            handle = os.open(self._path(room), os.O_RDONLY | _OPEN_FLAGS)
        except OSError:
            return None
        try:
            status = os.fstat(handle)
            if not stat.S_ISREG(status.st_mode) or status.st_size > _BYTES_MAX or _writers(status):
                return None
            data = os.read(handle, status.st_size)
            if abs(time.time() - status.st_mtime) > _DAY:
                with suppress(OSError):
                    os.utime(self._path(room))  # it was used today: others are pruned before it
        except OSError:
            return None
        finally:
            os.close(handle)
        content = data[len(_SCHEMA) + _SHA256 :]
        return content if data == self._head(content) + content else None

    def write(self, content: bytes) -> None:
        """Keep it for the processes to come, where the folder can be written: a cache is a convenience, never an error.

        A process that reads meanwhile, or after a crash, sees the old entry or the new one.
        """
        room = self._room(make=True)
        if room is None:
            return
        part = room / f"{_TEMPORARY}{os.urandom(8).hex()}"
        try:
            with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _OPEN_FLAGS, 0o600), "wb") as file:
                file.write(self._head(content) + content)
                file.flush()
                os.fsync(file.fileno())
            _put(part, self._path(room))
            _prune(room)
        except OSError:
            return
        finally:
            with suppress(OSError):
                part.unlink(missing_ok=True)

    def forget(self) -> None:
        """Remove it."""
        with suppress(OSError):  # a cache that cannot be written was not written by us
            self._path(cache_folder() / self.room).unlink(missing_ok=True)

    def _room(self, make: bool = False) -> Path | None:
        """Its folder, if that and the one above may be used."""
        folder = cache_folder()
        for used in (folder, folder / self.room):
            if make:
                with suppress(OSError):
                    used.parent.mkdir(parents=True, exist_ok=True)
                    used.mkdir(mode=0o700, exist_ok=True)
            if fault := distrust(used):
                if used not in _warned:
                    _warned.add(used)
                    why, remedy = fault
                    text = f"the cache folder {used} is not used, because {why}; to mend it: {remedy}"
                    warnings.warn(text, RuntimeWarning, stacklevel=4)
                return None
        return folder / self.room

    def _path(self, room: Path) -> Path:
        return room / f"{self.name[:40]}-{hashlib.sha256(self.identity.encode()).hexdigest()[:24]}"

    def _head(self, content: bytes) -> bytes:
        """Head of a file. Its checksum binds the content to its identity: files cannot be exchanged."""
        known = hashlib.sha256(f"{self.room}\0{self.identity}".encode()).digest()
        return _SCHEMA + hashlib.sha256(_SCHEMA + known + content).digest()


def distrust(folder: Path) -> tuple[str, str] | None:
    """Why a folder that is there is not used, and what mends it."""
    try:
        link, status = folder.lstat(), folder.stat()
    except OSError:
        return None  # it is not there, and if it cannot be made, nothing is kept
    elsewhere = f"set {_VARIABLE} to a folder of your own"
    if not stat.S_ISDIR(status.st_mode):
        return "it is not a folder", elsewhere
    writers = _writers(status) or ("" if link.st_uid == status.st_uid else "another user, who made the link,")
    if not writers:
        return None
    is_for_all = writers != _OTHERS or status.st_mode & stat.S_ISVTX  # as /tmp, which must stay so
    remedy = elsewhere if is_for_all else f"chmod go-w {shlex.quote(str(folder))}"
    return f"{writers} can change what lies there", remedy


_OTHERS = "others than its owner"


def _user() -> int | None:
    """Number of the user that runs this process. Windows keeps none; there, the user's profile is the user's own."""
    return os.geteuid() if os.name == "posix" else None


def _writers(status: os.stat_result) -> str:
    """Others who can write a file or a folder; empty where nobody can."""
    if _user() is None:
        return ""
    if status.st_uid != _user():
        return "another user, who owns it,"
    return _OTHERS if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH) else ""


def _put(part: Path, path: Path) -> None:
    """Let a file take its place, and a folder's that lies there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    part.replace(path)


def _prune(room: Path) -> None:
    """Remove what was used longest ago, beyond the most bytes, and what processes left that were killed."""
    now = time.time()
    found: list[tuple[float, int, str]] = []
    with os.scandir(room) as entries:
        for entry in entries:
            status = entry.stat(follow_symlinks=False)
            if stat.S_ISREG(status.st_mode) and not entry.name.startswith(_TEMPORARY):
                found.append((status.st_mtime, status.st_size, entry.path))
            elif entry.name.startswith(_TEMPORARY) and abs(now - status.st_mtime) > _DAY:
                Path(entry.path).unlink(missing_ok=True)
    size = 0
    for _, bytes_of_it, path in sorted(found, reverse=True):
        size += bytes_of_it
        if size > _BYTES_MAX:
            Path(path).unlink(missing_ok=True)
