"""What all file formats share: complete writes, and errors that name the file."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager, suppress
from os import PathLike, getpid
from pathlib import Path

from pyibr.core.checks import describe
from pyibr.core.errors import ArgumentError, FileFormatError


def checked_path(path: str | PathLike[str]) -> Path:
    """Return `path` as a Path, or raise ArgumentError."""
    if not isinstance(path, (str, PathLike)):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ArgumentError("path", "a file's path, str or pathlib.Path", describe(path))
    return Path(path)


def folder_for(file: Path) -> None:
    """Make the folder that a file is written into."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _not_written(file, error) from error


@contextmanager
def atomic_path(path: str | PathLike[str]) -> Generator[Path, None, None]:
    """Yield a temporary path beside `path` that takes its place when the block ends without an error.

    A reader never sees half a file. A missing parent folder is made.
    """
    final = checked_path(path)
    temporary = final.with_name(f".{final.stem}.{getpid()}{final.suffix}")
    try:
        folder_for(final)
        yield temporary
        temporary.replace(final)
    except OSError as error:
        raise _not_written(final, error) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def _not_written(file: Path, error: OSError) -> FileFormatError:
    if isinstance(error, (FileExistsError, NotADirectoryError)):
        return FileFormatError(f"{file}: cannot be written: {error.filename} is not a folder")
    return FileFormatError(f"{file}: cannot be written: {error.strerror or error}")


@contextmanager
def reading(path: str | PathLike[str], kind: str) -> Generator[Path, None, None]:
    """Yield `path` if it is a file with content; turn what a decoder raises into FileFormatError."""
    source = checked_path(path)
    try:
        if not source.is_file():
            raise FileFormatError(f"{source}: {'is a folder' if source.is_dir() else 'no such file'}")
        if source.stat().st_size == 0:
            raise FileFormatError(f"{source}: the file is empty")
        yield source
    except (FileFormatError, ImportError, MemoryError):
        raise
    except PermissionError as error:
        raise FileFormatError(f"{source}: cannot be read: {error.strerror}") from error
    except Exception as error:  # decoders raise anything from OSError to struct.error
        cause = error.__cause__ or error
        reason = next(iter(str(cause).strip().splitlines()), type(cause).__name__)[:200]
        raise FileFormatError(f"{source}: not a readable {kind} file, or truncated: {reason}") from error
