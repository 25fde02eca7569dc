"""Cache of what a thing has on a device."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from pyibr.core.checks import Immutable
from pyibr.opencl.device import current

_Made = TypeVar("_Made")


def cached_on_device(thing: Immutable, name: str, make: Callable[[], _Made]) -> _Made:
    """Return what `make` makes for `thing` on the current device, made once under this name."""
    found = thing.device_cache.setdefault(current(), {})
    if name not in found:
        found[name] = make()
    return found[name]
