"""Messages of the library for whoever waits: that kernels are being built, which takes seconds and happens once."""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator
from contextlib import contextmanager


class _Teller(logging.Handler):
    def __init__(self, tell: Callable[[str], object]) -> None:
        super().__init__(logging.INFO)
        self._tell = tell

    def emit(self, record: logging.LogRecord) -> None:
        self._tell(record.getMessage())


@contextmanager
def telling(tell: Callable[[str], object]) -> Generator[None, None, None]:
    """Within it, `tell` is called with what the logger "pyibr" says."""
    logger, teller = logging.getLogger("pyibr"), _Teller(tell)
    level = logger.level
    logger.addHandler(teller)
    if logger.getEffectiveLevel() > logging.INFO:
        logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(teller)
        logger.setLevel(level)
