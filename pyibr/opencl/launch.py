"""One way to call a kernel: by argument names, checked against its source."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyibr.core.errors import ArgumentError
from pyibr.opencl.memory import DeviceArray
from pyibr.opencl.program import Argument, Kernel
from pyibr.opencl.watch import watches

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
    if watches:
        watches[-1].launch(kernel, grid, arguments, functools.partial(_enqueue, kernel, grid))
    else:
        _enqueue(kernel, grid, **arguments)


def _enqueue(kernel: Kernel, grid: tuple[int, ...], **arguments: DeviceArray | Struct | float) -> None:
    import pyopencl as cl

    if kernel.names != arguments.keys():
        missing, unknown = sorted(kernel.names - set(arguments)), sorted(set(arguments) - kernel.names)
        raise ArgumentError(
            f"{kernel.name}()", f"the arguments {sorted(kernel.names)}", f"missing {missing}, unknown {unknown}"
        )
    values = [_PACK[argument.kind](kernel, argument, arguments[argument.name]) for argument in kernel.arguments]
    kernel.session.in_flight.append(arguments)
    kernel.handle.set_args(*values)
    size = kernel.session.profile.local_size
    local = None if size is None else (size,) * len(grid)
    cl.enqueue_nd_range_kernel(kernel.session.queue, kernel.handle, grid, local)


def _pointer(kernel: Kernel, argument: Argument, value: DeviceArray | Struct | float) -> Any:
    if isinstance(value, DeviceArray) and (value.dtype.fields or value.dtype == _ELEMENTS.get(argument.type[:-1])):
        return value.buffer
    got = value.dtype.name if isinstance(value, DeviceArray) else type(value).__name__
    raise ArgumentError(f"{kernel.name}({argument.name})", f"a device array of {argument.type[:-1]}", got)


def _number(kernel: Kernel, argument: Argument, value: DeviceArray | Struct | float) -> Any:
    if isinstance(value, (int, float, np.number)):
        return float(value) if argument.type == "float" else int(value)
    raise ArgumentError(f"{kernel.name}({argument.name})", f"a number ({argument.type})", type(value).__name__)


def _struct(kernel: Kernel, argument: Argument, value: DeviceArray | Struct | float) -> Any:
    if isinstance(value, Struct) and value.name == argument.type:
        return value.values[()]
    raise ArgumentError(f"{kernel.name}({argument.name})", f"a {argument.type}", type(value).__name__)


_PACK = {"pointer": _pointer, "number": _number, "struct": _struct}
