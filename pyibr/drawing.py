"""Names for writing a rendering system of your own with kernels; see the manual's page on it.

Each name is documented where it is defined.
"""

from __future__ import annotations

from pyibr.core.checks import Immutable
from pyibr.opencl.device import current, one_call
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.headers import constant, struct
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, copy, empty, to_host, upload
from pyibr.opencl.program import kernel
from pyibr.picture.deferred import Entry, entry_for
from pyibr.picture.drawable import Blending, Drawable, Finishing, Guessing, as_drawable
from pyibr.picture.samples import view_of
from pyibr.picture.shadow import Lighting
from pyibr.picture.target import Target

__all__ = [
    "Blending",
    "DeviceArray",
    "Drawable",
    "Entry",
    "Finishing",
    "Guessing",
    "Immutable",
    "Lighting",
    "Struct",
    "Target",
    "as_drawable",
    "cached_on_device",
    "constant",
    "copy",
    "current",
    "empty",
    "entry_for",
    "kernel",
    "launch",
    "one_call",
    "struct",
    "to_host",
    "upload",
    "view_of",
]
