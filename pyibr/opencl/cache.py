"""The cache on disk for test outcomes and programs. Only this module knows its files.

Entries become native code of this process. Therefore an entry is used only if nobody but the user can have written it,
and if its checksum, which covers the entry's identity, is right. Any other entry counts as missing and is made again.
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
_SCHEMA = b"pyibr cache 1\n"  # version of the file format, and of the content that callers write
_SHA256 = 32  # bytes
_BYTES_MAX = 1 << 28  # bytes per folder: some hundred programs for CPUs, whose binaries are the largest
_DAY = 86400.0  # seconds
_TEMPORARY = ".part-"  # prefix of files that are being written
# Rejects links, and does not block on pipes.
_OPEN_FLAGS = sum(getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"))

_warned: set[Path] = set()


def cache_folder() -> Path:
    """Return the folder of pyibr's cache: ``$PYIBR_CACHE``, or else the platform's folder for caches. It may not exist.

    Raises
    ------
    ArgumentError
        ``$PYIBR_CACHE`` is not a folder's path.
    """
    if chosen := os.environ.get(_VARIABLE):
        try:
            return Path(chosen).expanduser().absolute()
        except (OSError, RuntimeError) as error:  # unknown user, or a relative path while the current folder is gone
            raise ArgumentError(f"${_VARIABLE}", "a folder's path", f"{chosen!r}: {error}") from None
    # The XDG specification forbids relative paths.
    if sys.platform == "linux" and (base := Path(os.environ.get("XDG_CACHE_HOME", ""))).is_absolute():
        return base / "pyibr"
    try:
        home = Path.home()
    except RuntimeError:  # a user without a name, for example in containers
        return Path(f"/tmp/pyibr-{_user()}")
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or home / "AppData/Local") / "pyibr" / "Cache"
    return home / ("Library/Caches/pyibr" if sys.platform == "darwin" else ".cache/pyibr")


def cache_fault() -> tuple[str, str] | None:
    """Return the fault of the cache and its remedy; None if the cache can be used."""
    folder = cache_folder()
    for used in (folder, folder / "devices", folder / "programs"):
        if fault := distrust(used):
            why, remedy = fault
            return f"the cache folder {used} is not used, because {why}", remedy
    trial = Entry("programs", "trial", os.urandom(8).hex())  # unique, since other calls remove their own
    trial.write(b"")
    if trial.read() is None:
        what = f"the cache folder {folder} cannot be written, so each process compiles its kernels again"
        return what, f"set {_VARIABLE} to a writable folder"
    trial.forget()
    return None


@dataclass(frozen=True)
class Entry:
    """A file of the cache."""

    room: Literal["devices", "programs"]  # the file's folder
    name: str  # start of the file name, for people
    identity: str  # text with everything that the content depends on

    def read(self) -> bytes | None:
        """Return the content; None if there is none, or it cannot be trusted."""
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
                    os.utime(self._path(room))  # marks it as used today, for pruning
        except OSError:
            return None
        finally:
            os.close(handle)
        content = data[len(_SCHEMA) + _SHA256 :]
        return content if data == self._head(content) + content else None

    def write(self, content: bytes) -> None:
        """Store the content for later processes. If the folder cannot be written, nothing happens.

        A concurrent reader, or a process after a crash, sees either the old entry or the new one.
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
        """Remove the entry."""
        with suppress(OSError):  # in a cache that cannot be written, there is nothing to remove
            self._path(cache_folder() / self.room).unlink(missing_ok=True)

    def _room(self, make: bool = False) -> Path | None:
        """The entry's folder, if it and its parent can be trusted."""
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
        """Header of a file. Its checksum covers the identity, so files cannot be swapped."""
        known = hashlib.sha256(f"{self.room}\0{self.identity}".encode()).digest()
        return _SCHEMA + hashlib.sha256(_SCHEMA + known + content).digest()


def distrust(folder: Path) -> tuple[str, str] | None:
    """Return the reason why an existing folder is not trusted, and the remedy; None if the folder is trusted."""
    try:
        link, status = folder.lstat(), folder.stat()
    except OSError:
        return None  # the folder does not exist; if it cannot be created, nothing is cached
    elsewhere = f"set {_VARIABLE} to a folder of your own"
    if not stat.S_ISDIR(status.st_mode):
        return "it is not a folder", elsewhere
    writers = _writers(status) or ("" if link.st_uid == status.st_uid else "another user, who made the link,")
    if not writers:
        return None
    is_for_all = writers != _OTHERS or status.st_mode & stat.S_ISVTX  # sticky, such as /tmp, which must stay shared
    remedy = elsewhere if is_for_all else f"chmod go-w {shlex.quote(str(folder))}"
    return f"{writers} can change its files", remedy


_OTHERS = "users other than its owner"


def _user() -> int | None:
    """ID of the user that runs this process; None on Windows, where only the user can write to the user's profile."""
    return os.geteuid() if os.name == "posix" else None


def _writers(status: os.stat_result) -> str:
    """Other users who can write to a file or folder; empty if there are none."""
    if _user() is None:
        return ""
    if status.st_uid != _user():
        return "another user, who owns it,"
    return _OTHERS if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH) else ""


def _put(part: Path, path: Path) -> None:
    """Move a file to its path. A folder at this path is removed."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    part.replace(path)


def _prune(room: Path) -> None:
    """Remove the least recently used files beyond `_BYTES_MAX`, and temporary files of killed processes."""
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
