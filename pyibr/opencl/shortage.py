"""Memory that is short, told as pyibr tells errors, wherever that shows."""

from __future__ import annotations

import errno
from collections.abc import Generator
from contextlib import contextmanager

from pyibr.core.errors import Error, OutOfMemoryError


@contextmanager
def telling_shortage(device: object) -> Generator[None, None, None]:
    """Within, memory that is short is told by `tell_shortage`."""
    try:
        yield
    except Exception as error:
        tell_shortage(error, device)
        raise


def tell_shortage(error: Exception, device: object, needed: str | None = None) -> None:
    """Raise OutOfMemoryError if that is what an error of NumPy's, the system's or OpenCL's is.

    Parameters
    ----------
    error : Exception
    device : object
        Whose name the message holds.
    needed : str, optional
        For what; else it is what the error says.
    """
    if not isinstance(error, Error) and is_shortage(error):
        what = f" for {needed}" if needed else f": {error}" if str(error) else ""
        raise OutOfMemoryError(f"not enough memory on {device}{what}") from error


def is_shortage(error: Exception) -> bool:
    """Tell whether NumPy, the system or OpenCL want for memory, or the device takes no buffer as large."""
    import pyopencl as cl

    if isinstance(error, (MemoryError, cl.MemoryError)) or getattr(error, "errno", None) == errno.ENOMEM:
        return True
    return isinstance(error, cl.Error) and error.code == cl.status_code.INVALID_BUFFER_SIZE
