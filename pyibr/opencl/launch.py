"""One way to call a kernel: by argument names, checked against its source."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pyibr.errors import ArgumentError
from pyibr.opencl.memory import DeviceArray
from pyibr.opencl.program import SCALARS

if TYPE_CHECKING:
    from pyibr.opencl.program import Kernel

_ELEMENTS: dict[str, np.dtype[Any]] = {
    "float": np.dtype(np.float32),
    "short": np.dtype(np.int16),
    "ushort": np.dtype(np.uint16),
    "int": np.dtype(np.int32),
    "uint": np.dtype(np.uint32),
    "uchar": np.dtype(np.uint8),
    "ulong": np.dtype(np.uint64),
}


@dataclass(frozen=True)
class Struct:
    """A value of a C struct that a kernel file defines; ``values`` is its bytes as a NumPy record."""

    name: str
    values: np.ndarray[Any, np.dtype[np.void]]


def launch(kernel: Kernel, grid: tuple[int, ...], **arguments: DeviceArray | Struct | float) -> None:
    """Enqueues ``kernel`` over ``grid`` work-items.

    Parameters
    ----------
    kernel : Kernel
        From :func:`pyibr.opencl.program.kernel`.
    grid : tuple of int
        Work-items along x, y, ...; kernels test their bounds themselves.
    **arguments
        One value per argument in the kernel's source: a :class:`DeviceArray` for a pointer, a :class:`Struct` for a
        struct, a number for a scalar.

    Raises
    ------
    ArgumentError
        If a name is missing or unknown, or a value's type is not what the source declares.
    """
    import pyopencl as cl

    names = kernel.names
    if names != arguments.keys():
        missing, unknown = sorted(names - set(arguments)), sorted(set(arguments) - names)
        raise ArgumentError(
            f"{kernel.name}()", f"the arguments {sorted(names)}", f"missing {missing}, unknown {unknown}"
        )
    values = [_pack(kernel, argument.name, argument.type, arguments[argument.name]) for argument in kernel.arguments]
    local = (1,) * len(grid) if kernel.session.is_cpu else None
    kernel.session.in_flight.append(arguments)
    kernel.handle.set_args(*values)
    cl.enqueue_nd_range_kernel(kernel.session.queue, kernel.handle, grid, local)


def _pack(kernel: Kernel, name: str, declared: str, value: DeviceArray | Struct | float) -> Any:
    if declared.endswith("*"):
        element = declared[:-1]
        if isinstance(value, DeviceArray) and (value.dtype.fields or value.dtype == _ELEMENTS.get(element)):
            return value.buffer
        got = value.dtype.name if isinstance(value, DeviceArray) else type(value).__name__
        raise ArgumentError(f"{kernel.name}({name})", f"a device array of {element}", got)
    if declared in SCALARS:
        if isinstance(value, (int, float, np.number)):
            return float(value) if declared == "float" else int(value)
        raise ArgumentError(f"{kernel.name}({name})", f"a number ({declared})", type(value).__name__)
    if isinstance(value, Struct) and value.name == declared:
        return value.values[()]
    raise ArgumentError(f"{kernel.name}({name})", f"a {declared}", type(value).__name__)
