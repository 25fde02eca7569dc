"""Times of pyibr's own pictures on CPU runtimes, measured once and kept on disk: the fastest is chosen by them."""

from __future__ import annotations

import functools
import logging
import math
from contextlib import suppress

from pyibr.core.distributions import PYIBR, version_of
from pyibr.opencl.apart import run_apart
from pyibr.opencl.cache import Entry, cache_fault
from pyibr.opencl.runtimes import Found

_TRIAL = "pyibr.app.trial"
"""The pictures: a module by its name, since it draws with systems, which lie above this room."""

_log = logging.getLogger("pyibr")


@functools.cache
def picture_time(found: Found) -> float:
    """Seconds that a small warp and a small relief take; infinite where they fail.

    Their kernels are built for it, which takes seconds: where no cache keeps the outcome, they are left undrawn.
    """
    entry = _entry(found)
    if (kept := entry.read()) is not None:
        return float(kept)
    if cache_fault():
        return math.inf
    _log.info("the speed of %s is measured, once; that takes some seconds", found.platform)
    ended = run_apart(_TRIAL, found.key, task="small pictures")
    if ended is None:
        return math.inf
    seconds = math.inf
    with suppress(ValueError):
        seconds = float(ended.result)
    if math.isinf(seconds):
        _log.warning("%s is not used: %s", found.platform, ended.fault)
    entry.write(repr(seconds).encode())
    return seconds


def forget_picture_time(found: Found) -> None:
    """Have it measured again."""
    picture_time.cache_clear()
    _entry(found).forget()


def _entry(found: Found) -> Entry:
    return Entry("devices", "pictures", f"{found.key}\0{version_of(PYIBR)}")
