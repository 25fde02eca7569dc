"""What all file formats share: complete writes, and errors that name the file."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager, suppress
from os import PathLike, getpid
from pathlib import Path

from pyibr.errors import FileFormatError


@contextmanager
def atomic_path(path: str | PathLike[str]) -> Generator[Path, None, None]:
    """Yield a temporary path beside `path` that takes its place when the block ends without an error.

    A reader never sees half a file. A missing parent folder is made.
    """
    final = Path(path)
    temporary = final.with_name(f".{final.stem}.{getpid()}{final.suffix}")
    try:
        final.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        temporary.replace(final)
    except (FileExistsError, NotADirectoryError) as error:
        raise FileFormatError(f"{final}: cannot be written: {error.filename} is not a folder") from error
    except OSError as error:
        raise FileFormatError(f"{final}: cannot be written: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def reading(path: str | PathLike[str], kind: str) -> Generator[Path, None, None]:
    """Yield `path` if it is a file with content; turn what a decoder raises into FileFormatError."""
    source = Path(path)
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
