"""Foundations of all file formats: atomic writes, bounded reads, and errors that name the file."""

from __future__ import annotations

import errno
import gzip
import os
import re
import secrets
import stat
from collections.abc import Generator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import BinaryIO, NamedTuple, Protocol, cast

import numpy as np

from pyibr.core.checks import describe
from pyibr.core.errors import ArgumentError, FileFormatError, MissingPackageError

UNPACKED_MAX = 1 << 30
"""Bytes that the content of a packed file (gzip, NPZ, EXR, glTF's repeated parts) may take once it is unpacked."""

_TIMES, _LITTLE = 50, 1 << 24
"""Of packed text: so often its size, or so many bytes, may be unpacked. Once it is parsed it takes up to 60 times that;
real meshes and scans become a tenth or more of their size by packing."""

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


def write_atomically(path: str | os.PathLike[str], data: bytes) -> None:
    """Write a file of these bytes, or leave what is there.

    A reader never sees half a file, and of several writers one wins. A missing parent folder is made. A link is
    followed: what it names is replaced, and keeps its mode and, if the system lets it, its owner. What a killed
    process leaves behind is named ``.pyibr-...`` and may be deleted.
    """
    named, waiting = checked_path(path), _waiting.get()
    if waiting is not None:
        _stage(named, data, waiting)
        return
    with written_together() as alone:
        _stage(named, data, alone)


@contextmanager
def written_together() -> Generator[list[_Staged], None, None]:
    """Files that are written within this block get their names at its end, in their order; if one fails, none does."""
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
    """Yield a stream for a file that is written piece by piece; as `write_atomically`, it is whole or not there."""
    with written_together() as alone, _staged(checked_path(path), alone) as stream:
        yield stream


def _stage(named: Path, data: bytes, files: list[_Staged]) -> None:
    with _staged(named, files) as stream:
        stream.write(data)


@contextmanager
def _staged(named: Path, files: list[_Staged]) -> Generator[BinaryIO, None, None]:
    """Yield a stream to a file under a name of its own, and put it to those that wait for theirs."""
    try:
        named.parent.mkdir(parents=True, exist_ok=True)
        old = _replaceable(named)
        final = Path(os.path.realpath(named))
        temporary = final.with_name(f".pyibr-{secrets.token_hex(8)}")
        # The name is new, or this fails: no link that waits there is followed. The umask has its say on new files,
        # and while a private file is written again it stays private.
        flags = os.O_CREAT | os.O_EXCL | os.O_RDWR | getattr(os, "O_BINARY", 0)
        descriptor = os.open(temporary, flags, 0o666 if old is None else 0o600)
        files.append(_Staged(temporary, final, named))
        with os.fdopen(descriptor, "w+b") as stream:
            yield stream
            stream.flush()
            os.fsync(descriptor)  # or a power failure might leave the new name without its content
        if old is not None:
            if hasattr(os, "chown"):
                with suppress(OSError):
                    os.chown(temporary, old.st_uid, old.st_gid)
            temporary.chmod(stat.S_IMODE(old.st_mode))
    except OSError as error:
        raise _not_written(named, error) from error


def check_writable(path: str | os.PathLike[str]) -> None:
    """Raise what `write_atomically` would raise of what is there already; nothing is made or written."""
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
    """Return a key that is the same for all names of a file, links included, whether it is there or not."""
    file = checked_path(path)
    try:
        found = file.stat()
    except OSError:
        return os.path.realpath(file)
    return found.st_dev, found.st_ino


def _replaceable(path: Path) -> os.stat_result | None:
    """Status of a file, through links; OSError if it is nothing that a new file may replace."""
    try:
        old = path.stat()  # by the system's rules for links, which `realpath` alone would go round
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
    """Raise FileFormatError if there is neither a file nor a folder of this name."""
    if not checked_path(path).exists():
        raise FileFormatError(f"{path}: no such file or folder")


@contextmanager
def reading(path: str | os.PathLike[str], kind: str) -> Generator[Path, None, None]:
    """Yield `path` if it is a file with content; turn what a decoder raises into FileFormatError."""
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
    """Turn what decoders of a file, or of a folder of such, raise into FileFormatError; but for what is `passing`."""
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
        words = re.sub(r" ?<[^<>]* object at 0x[0-9a-f]+>", "", str(cause))  # which tell users nothing
        reason = next(iter(words.strip().splitlines()), type(cause).__name__)[:200]
        raise FileFormatError(f"{source}: not a readable {kind} file, or truncated: {reason}") from error


def check_unpacked(size: int) -> None:
    """Raise ValueError if a packed file's content is larger than any that is read."""
    if size > UNPACKED_MAX:
        raise ValueError(f"its content takes {size} bytes; up to {UNPACKED_MAX} are read from a packed file")


def read_bytes(source: Path) -> bytes:
    """A file's bytes, unpacked if gzip packed them, text as UTF-8; ValueError if there are too many then."""
    with source.open("rb") as stream:
        if stream.read(2) == b"\x1f\x8b":
            size = stream.seek(0, os.SEEK_END)
            stream.seek(0)
            with gzip.open(stream) as unpacked:
                return utf8_of(read_at_most(unpacked, max(_TIMES * size, _LITTLE)))
        stream.seek(0)
        return utf8_of(stream.read())


def read_text(source: Path) -> str:
    """Read a text, of whatever form programs write; remarks in other alphabets' bytes do no harm."""
    data = utf8_of(source.read_bytes())
    if b"\0" in data:
        raise ValueError("it is no text, or of UTF-16 without a mark: save it as UTF-8")
    return data.decode("utf-8", "replace")


def utf8_of(data: bytes) -> bytes:
    """Text as UTF-8 without a mark before it; programs of Windows write UTF-16 and marks. Other bytes as they are."""
    is_wide = data.startswith((b"\xff\xfe", b"\xfe\xff"))
    return data.decode("utf-16").encode("utf-8") if is_wide else data.removeprefix(b"\xef\xbb\xbf")


def read_rows(source: Path) -> list[list[float]]:
    """Read numbers of a text, a list a line, what follows a # is a remark; or of NumPy's NPY, a list for each entry."""
    if source.suffix.lower() == ".npy":
        array = np.load(source, mmap_mode="r", allow_pickle=False)
        return array.reshape(len(array), -1).tolist()
    lines = [words_of(line.partition("#")[0]) for line in read_text(source).splitlines()]
    return [[float(word) for word in line] for line in lines if line]


def words_of(line: str) -> list[str]:
    """Words of a line of numbers, as people and programs write such: also in brackets."""
    return re.sub(r"[,;\[\]]", " ", line).split()


def read_at_most(stream: _Readable, size_max: int = UNPACKED_MAX) -> bytes:
    """All of what a packed stream holds; ValueError if that is too much."""
    parts: list[bytes] = []
    size = 0
    while part := stream.read(_CHUNK):
        size += len(part)
        check_unpacked(size)
        if size > size_max:
            raise ValueError(f"it unpacks to more than {size_max} bytes, more than {_TIMES} times its size")
        parts.append(part)
    return b"".join(parts)
