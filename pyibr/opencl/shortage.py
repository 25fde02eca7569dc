"""Conversion of all out-of-memory errors to pyibr's OutOfMemoryError."""

from __future__ import annotations

import errno
from collections.abc import Generator
from contextlib import contextmanager

from pyibr.core.errors import Error, OutOfMemoryError


@contextmanager
def telling_shortage(device: object) -> Generator[None, None, None]:
    """Convert out-of-memory errors inside the ``with`` block by `tell_shortage`."""
    try:
        yield
    except Exception as error:
        tell_shortage(error, device)
        raise


def tell_shortage(error: Exception, device: object, needed: str | None = None) -> None:
    """Raise OutOfMemoryError if an error from NumPy, the system or OpenCL means a lack of memory.

    Parameters
    ----------
    error : Exception
    device : object
        The device to name in the message.
    needed : str, optional
        Purpose of the memory, for the message; by default, the message quotes the error.
    """
    if not isinstance(error, Error) and is_shortage(error):
        what = f" for {needed}" if needed else f": {error}" if str(error) else ""
        raise OutOfMemoryError(f"not enough memory on {device}{what}") from error


def is_shortage(error: Exception) -> bool:
    """Tell whether an error means that memory is short, or that a buffer is too large for the device."""
    import pyopencl as cl

    if isinstance(error, (MemoryError, cl.MemoryError)) or getattr(error, "errno", None) == errno.ENOMEM:
        return True
    return isinstance(error, cl.Error) and error.code == cl.status_code.INVALID_BUFFER_SIZE
