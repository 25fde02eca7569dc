"""Foundations of all file formats: atomic writes, bounded reads, and errors that name the file."""

from __future__ import annotations

import errno
import gzip
import os
import re
import secrets
import stat
from collections.abc import Generator
from contextlib import contextmanager, nullcontext, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import BinaryIO, NamedTuple, Protocol, cast

import numpy as np

from pyibr.core.checks import describe
from pyibr.core.errors import ArgumentError, FileFormatError, MissingPackageError

UNPACKED_MAX = 1 << 30
"""Limit on the unpacked bytes of a packed file (gzip, NPZ, EXR, glTF's repeated parts)."""

_TIMES, _LITTLE = 50, 1 << 24
"""Packed text may unpack to this many times its size, or to this many bytes. Once parsed it takes up to 60 times that.
Packed, real meshes and scans keep at least a tenth of their size."""

_CHUNK = 1 << 20


class _Readable(Protocol):
    def read(self, size: int, /) -> bytes: ...


def checked_path(path: str | os.PathLike[str]) -> Path:
    """Return `path` as a Path, or raise ArgumentError."""
    is_path = isinstance(path, (str, os.PathLike))  # pyright: ignore[reportUnnecessaryIsInstance]
    name = cast("object", os.fspath(path) if is_path else path)
    if not isinstance(name, str):
        raise ArgumentError("path", "a file's path, str or pathlib.Path", describe(path))
    try:
        if b"\0" not in os.fsencode(name):
            return Path(name)
    except UnicodeEncodeError:
        pass
    raise ArgumentError("path", "a file's path in characters that file names may have", describe(path))


def like(path: str | os.PathLike[str]) -> Path:
    """The name of all files of this kind in the folder, for warnings that are shown once for all frames."""
    file = checked_path(path)
    return file.with_name(f"*{file.suffix}")


def write_atomically(path: str | os.PathLike[str], data: bytes) -> None:
    """Write these bytes to a file, or leave the old file.

    A reader never sees half a file, and if several processes write, one of them wins. A missing parent folder is made.
    A link is followed: its target is replaced, and keeps its mode and, if the system permits, its owner. A killed
    process may leave a file named ``.pyibr-...``, which may be deleted.
    """
    named, waiting = checked_path(path), _waiting.get()
    with written_together() if waiting is None else nullcontext(waiting) as files, _staged(named, files) as stream:
        stream.write(data)


@contextmanager
def written_together() -> Generator[list[_Staged], None, None]:
    """Give all files written within this block their names at its end, in order; if one fails, none is renamed."""
    files: list[_Staged] = []
    token = _waiting.set(files)
    try:
        yield files
        for file in files:
            try:
                file.temporary.replace(file.final)
            except OSError as error:
                raise _not_written(file.named, error) from error
    finally:
        _waiting.reset(token)
        for file in files:
            with suppress(OSError):
                file.temporary.unlink()


class _Staged(NamedTuple):
    """A complete file that waits for its name."""

    temporary: Path
    final: Path
    named: Path


_waiting: ContextVar[list[_Staged] | None] = ContextVar("waiting", default=None)


@contextmanager
def written_whole(path: str | os.PathLike[str]) -> Generator[BinaryIO, None, None]:
    """Yield a stream for a file that is written in pieces; as in `write_atomically`, it is whole or absent."""
    with written_together() as alone, _staged(checked_path(path), alone) as stream:
        yield stream


@contextmanager
def _staged(named: Path, files: list[_Staged]) -> Generator[BinaryIO, None, None]:
    """Yield a stream to a temporary file, and add the file to those that wait for their names."""
    try:
        named.parent.mkdir(parents=True, exist_ok=True)
        old = _replaceable(named)
        final = Path(os.path.realpath(named))
        temporary = final.with_name(f".pyibr-{secrets.token_hex(8)}")
        # O_EXCL: if the name exists, this fails, and no planted link is followed. New files obey the umask; a private
        # file stays private while it is rewritten.
        flags = os.O_CREAT | os.O_EXCL | os.O_RDWR | getattr(os, "O_BINARY", 0)
        descriptor = os.open(temporary, flags, 0o666 if old is None else 0o600)
        files.append(_Staged(temporary, final, named))
        with os.fdopen(descriptor, "w+b") as stream:
            yield stream
            stream.flush()
            os.fsync(descriptor)  # else a power failure might leave the new name without its content
        if old is not None:
            if hasattr(os, "chown"):
                with suppress(OSError):
                    os.chown(temporary, old.st_uid, old.st_gid)
            temporary.chmod(stat.S_IMODE(old.st_mode))
    except OSError as error:
        raise _not_written(named, error) from error


def check_writable(path: str | os.PathLike[str]) -> None:
    """Raise the errors of `write_atomically` that existing files and folders cause; nothing is made or written."""
    file = checked_path(path)
    try:
        folder = next(folder for folder in file.absolute().parents if os.path.lexists(folder))
        if not folder.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(folder))
        if _replaceable(file) is None and not os.access(folder, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except OSError as error:
        raise _not_written(file, error) from error


def identity(path: str | os.PathLike[str]) -> object:
    """Return a key that is equal for all names of a file, links included, whether or not the file exists."""
    file = checked_path(path)
    try:
        found = file.stat()
    except OSError:
        return os.path.realpath(file)
    return found.st_dev, found.st_ino


def _replaceable(path: Path) -> os.stat_result | None:
    """Status of a file, through links; OSError if a new file may not replace it."""
    try:
        old = path.stat()  # obeys the system's rules for links, which `realpath` alone would bypass
    except FileNotFoundError:
        return None
    if stat.S_ISDIR(old.st_mode):
        raise IsADirectoryError(errno.EISDIR, "it is a folder")
    if not stat.S_ISREG(old.st_mode):
        raise OSError(errno.EINVAL, "it is no regular file")
    if not os.access(path, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    return old


def _not_written(file: Path, error: OSError) -> FileFormatError:
    if isinstance(error, (FileExistsError, NotADirectoryError)):
        return FileFormatError(f"{file}: cannot be written: {error.filename} is not a folder")
    return FileFormatError(f"{file}: cannot be written: {error.strerror or error}")


def check_exists(path: str | os.PathLike[str]) -> None:
    """Raise FileFormatError if no file or folder has this name."""
    if not checked_path(path).exists():
        raise FileFormatError(f"{path}: no such file or folder")


@contextmanager
def reading(path: str | os.PathLike[str], kind: str) -> Generator[Path, None, None]:
    """Yield `path` if it is a file with content; turn a decoder's errors into FileFormatError."""
    source = checked_path(path)
    try:
        found = source.stat()
    except (FileNotFoundError, NotADirectoryError) as error:
        raise FileFormatError(f"{source}: no such file") from error
    except OSError as error:
        raise FileFormatError(f"{source}: cannot be read: {error.strerror}") from error
    if not stat.S_ISREG(found.st_mode):
        raise FileFormatError(f"{source}: is {'a folder' if stat.S_ISDIR(found.st_mode) else 'no regular file'}")
    if found.st_size == 0:
        raise FileFormatError(f"{source}: the file is empty")
    with decoding(source, kind):
        yield source


@contextmanager
def decoding(source: Path, kind: str, *passing: type[Exception]) -> Generator[None, None, None]:
    """Turn errors of decoders into FileFormatError, except those in `passing`; `source` is the file or folder."""
    try:
        yield
    except (FileFormatError, MissingPackageError, *passing):
        raise
    except PermissionError as error:
        raise FileFormatError(f"{source}: cannot be read: {error.strerror}") from error
    except MemoryError as error:
        raise FileFormatError(f"{source}: does not fit into the memory") from error
    except Exception as error:  # decoders raise anything from OSError to struct.error
        cause = error.__cause__ or error
        words = re.sub(r" ?<[^<>]* object at 0x[0-9a-f]+>", "", str(cause))  # not for users
        reason = next(iter(words.strip().splitlines()), type(cause).__name__)[:200]
        raise FileFormatError(f"{source}: not a readable {kind} file, or truncated: {reason}") from error


def check_unpacked(size: int) -> None:
    """Raise ValueError if a packed file's content exceeds the limit."""
    if size > UNPACKED_MAX:
        raise ValueError(f"its content takes {size} bytes; up to {UNPACKED_MAX} are read from a packed file")


def read_bytes(source: Path) -> bytes:
    """A file's bytes, unpacked if gzip packed them, text as UTF-8; ValueError if the unpacked content is too large."""
    with source.open("rb") as stream:
        if stream.read(2) == b"\x1f\x8b":
            size = stream.seek(0, os.SEEK_END)
            stream.seek(0)
            with gzip.open(stream) as unpacked:
                return utf8_of(read_at_most(unpacked, max(_TIMES * size, _LITTLE)))
        stream.seek(0)
        return utf8_of(stream.read())


def read_text(source: Path) -> str:
    """Read a text in the usual encodings; undecodable bytes in comments are replaced."""
    data = utf8_of(source.read_bytes())
    if b"\0" in data:
        raise ValueError("it is no text, or UTF-16 without a byte order mark: save it as UTF-8")
    return data.decode("utf-8", "replace")


def utf8_of(data: bytes) -> bytes:
    """Text as UTF-8 without a byte order mark; programs on Windows write UTF-16 and marks. Other bytes stay."""
    is_wide = data.startswith((b"\xff\xfe", b"\xfe\xff"))
    return data.decode("utf-16").encode("utf-8") if is_wide else data.removeprefix(b"\xef\xbb\xbf")


def read_rows(source: Path) -> list[list[float]]:
    """Read numbers: a list for each line of a text, without comments after #, or for each entry of an NPY file."""
    if source.suffix.lower() == ".npy":
        array = np.load(source, mmap_mode="r", allow_pickle=False)
        return array.reshape(len(array), -1).tolist()
    lines = [words_of(line.partition("#")[0]) for line in read_text(source).splitlines()]
    return [[float(word) for word in line] for line in lines if line]


def words_of(line: str) -> list[str]:
    """Words of a line of numbers, separated by spaces, commas, semicolons or brackets."""
    return re.sub(r"[,;\[\]]", " ", line).split()


def read_at_most(stream: _Readable, size_max: int = UNPACKED_MAX) -> bytes:
    """The whole content of a packed stream; ValueError if it is too large."""
    parts: list[bytes] = []
    size = 0
    while part := stream.read(_CHUNK):
        size += len(part)
        check_unpacked(size)
        if size > size_max:
            raise ValueError(f"it unpacks to more than {size_max} bytes, more than {_TIMES} times its size")
        parts.append(part)
    return b"".join(parts)
