"""Messages of the library: its warnings, and notes on kernel builds, which take seconds."""

from __future__ import annotations

import functools
import logging
import warnings
from collections.abc import Callable, Generator
from contextlib import contextmanager


class _Teller(logging.Handler):
    def __init__(self, tell: Callable[[str], object]) -> None:
        super().__init__(logging.INFO)
        self._tell = tell

    def emit(self, record: logging.LogRecord) -> None:
        self._tell(record.getMessage())


def _tell_warning(tell: Callable[[str], object], message: Warning | str, *_: object, **__: object) -> None:
    tell(str(message))


@contextmanager
def telling(tell: Callable[[str], object]) -> Generator[None, None, None]:
    """Context in which `tell` is called with messages of the logger "pyibr" and with warnings."""
    logger, teller = logging.getLogger("pyibr"), _Teller(tell)
    level = logger.level
    logger.addHandler(teller)
    if logger.getEffectiveLevel() > logging.INFO:
        logger.setLevel(logging.INFO)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = functools.partial(_tell_warning, tell)
            yield
    finally:
        logger.removeHandler(teller)
        logger.setLevel(level)
