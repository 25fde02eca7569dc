"""Memory that is short, told as pyibr tells errors, wherever that shows."""

from __future__ import annotations

import errno
from collections.abc import Generator
from contextlib import contextmanager

from pyibr.core.errors import Error, OutOfMemoryError


@contextmanager
def telling_shortage(device: object, needed: str | None = None) -> Generator[None, None, None]:
    """Turn what NumPy, the system and OpenCL raise for want of memory into OutOfMemoryError.

    Parameters
    ----------
    device : object
        Whose name the message holds.
    needed : str, optional
        For what; else it is what the error says.
    """
    try:
        yield
    except Error:
        raise
    except Exception as error:
        if not is_shortage(error):
            raise
        what = f" for {needed}" if needed else f": {error}" if str(error) else ""
        raise OutOfMemoryError(f"not enough memory on {device}{what}") from error


def is_shortage(error: Exception) -> bool:
    """Tell whether NumPy, the system or OpenCL want for memory, or the device takes no buffer as large."""
    import pyopencl as cl

    if isinstance(error, (MemoryError, cl.MemoryError)) or getattr(error, "errno", None) == errno.ENOMEM:
        return True
    return isinstance(error, cl.Error) and error.code == cl.status_code.INVALID_BUFFER_SIZE
