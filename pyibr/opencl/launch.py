"""One way to call a kernel: by argument names, checked against its source."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyibr.core.errors import ArgumentError
from pyibr.opencl.headers import difference
from pyibr.opencl.memory import DeviceArray
from pyibr.opencl.program import Argument, Kernel
from pyibr.opencl.watch import watches


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
        If a name is missing or unknown, or a value's type is not what the source declares; a struct's members included.
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
    if isinstance(value, DeviceArray) and value.dtype == argument.dtype:
        return value.buffer
    got = difference(argument.dtype, value.dtype) if isinstance(value, DeviceArray) else type(value).__name__
    raise ArgumentError(f"{kernel.name}({argument.name})", f"a device array of {argument.type[:-1]}", got)


def _number(kernel: Kernel, argument: Argument, value: DeviceArray | Struct | float) -> Any:
    if isinstance(value, (int, float, np.number)):
        return float(value) if argument.type == "float" else int(value)
    raise ArgumentError(f"{kernel.name}({argument.name})", f"a number ({argument.type})", type(value).__name__)


def _struct(kernel: Kernel, argument: Argument, value: DeviceArray | Struct | float) -> Any:
    if isinstance(value, Struct) and value.name == argument.type and value.values.dtype == argument.dtype:
        return value.values[()]
    got = type(value).__name__
    if isinstance(value, Struct):
        got = difference(argument.dtype, value.values.dtype) if value.name == argument.type else f"a {value.name}"
    raise ArgumentError(f"{kernel.name}({argument.name})", f"a {argument.type}", got)


_PACK = {"pointer": _pointer, "number": _number, "struct": _struct}
