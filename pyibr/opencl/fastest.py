"""Times of pyibr's pictures on CPU runtimes, for the choice of the fastest; measured once and kept on disk."""

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
"""Module that draws the pictures. It is only named here, since it uses systems, which are in a higher layer."""

_log = logging.getLogger("pyibr")


@functools.cache
def picture_time(found: Found) -> float:
    """Return the seconds that a small warp and a small relief take; infinite if they fail.

    Their kernels must be built first, which takes seconds. So without a cache for the result, nothing is measured.
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
    """Forget the time, so that it is measured again."""
    picture_time.cache_clear()
    _entry(found).forget()


def _entry(found: Found) -> Entry:
    return Entry("devices", "pictures", f"{found.key}\0{version_of(PYIBR)}")
