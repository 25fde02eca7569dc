"""Cache of data that belong to a thing on a device."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

from pyibr.core.checks import Immutable
from pyibr.opencl.device import current

_Made = TypeVar("_Made")


class DeviceCache(dict["tuple[str, Hashable]", Any]):
    """Cached data of a thing on one device, by name and key, with a lock for making more."""

    def __init__(self) -> None:
        super().__init__()
        self.making = threading.RLock()


def known_on_device(thing: Immutable, name: str, key: Hashable = None) -> Any:
    """Return the cached data of this name, or None."""
    return thing.device_cache.get(current(), {}).get((name, key))


def cached_on_device(
    thing: Immutable, name: str, make: Callable[[], _Made], key: Hashable = None, latest: int | None = None
) -> _Made:
    """Return the data that `make` computes for `thing` on the current device, cached under a name.

    A `key` distinguishes several entries of one name; `latest` limits how many of them are kept. One thread at a time
    calls `make`; other threads wait for it.
    """
    caches, session = thing.device_cache, current()
    cache = caches.get(session)
    if cache is None:
        cache = caches.setdefault(session, DeviceCache())  # another thread may have made it
    known = cache.get((name, key))
    if known is not None:
        return known
    with cache.making:
        if (name, key) not in cache:
            made = make()
            if latest is not None:
                for old in [one for one in cache if one[0] == name][: 1 - latest or None]:
                    del cache[old]
            cache[name, key] = made
        return cache[name, key]
