"""What a thing has on a device, made once."""

from __future__ import annotations

from collections.abc import Callable, MutableMapping
from typing import Any, Protocol, TypeVar, cast

from pyibr.opencl.device import current

_Made = TypeVar("_Made")


class KeepsOnDevice(Protocol):
    """What buffers are kept with, as long as it lives: `pyibr.core.checks.Fixed` things, and depth images."""

    @property
    def device_cache(self) -> MutableMapping[Any, Any]:
        """By session."""
        ...


def kept(thing: KeepsOnDevice, name: str, make: Callable[[], _Made]) -> _Made:
    """What `make` has made for `thing` on the current device under this name; made now if it has not."""
    found = cast("dict[str, _Made]", thing.device_cache.setdefault(current(), {}))
    if name not in found:
        found[name] = make()
    return found[name]
