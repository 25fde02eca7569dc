"""Kernel launches with arguments by name, checked against the kernel's source."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pyibr.core.errors import ArgumentError, OutOfMemoryError
from pyibr.opencl.headers import difference
from pyibr.opencl.in_flight import QUEUED_SECONDS_MAX, UNSPLIT_SECONDS, piece_of, seconds_of
from pyibr.opencl.memory import DeviceArray
from pyibr.opencl.program import Argument, Kernel
from pyibr.opencl.watch import watches

if TYPE_CHECKING:
    import pyopencl as cl


@dataclass(frozen=True)
class Struct:
    """A value of a C struct that a kernel file defines; ``values`` is a NumPy record with its bytes."""

    name: str
    values: np.ndarray[Any, np.dtype[np.void]]


def launch(kernel: Kernel, grid: tuple[int, ...], **arguments: DeviceArray | Struct | float) -> None:
    """Enqueue ``kernel`` over ``grid`` work-items. Long launches are split into pieces, with a wait after each.

    Parameters
    ----------
    kernel : Kernel
        A kernel from :func:`pyibr.opencl.program.kernel`.
    grid : tuple of int
        Work-items along x, y, ...; kernels check bounds themselves.
    **arguments
        One value per argument in the kernel's source: a :class:`DeviceArray` for a pointer, a :class:`Struct` for a
        struct, a number for a scalar.

    Raises
    ------
    ArgumentError
        If a name is missing or unknown, or the type of a value or of a struct's member differs from the source.
    """
    if not watches:
        _enqueue(kernel, grid, arguments)
        return

    def enqueue(**given: Any) -> None:
        _enqueue(kernel, grid, given)

    watches[-1].launch(kernel, grid, arguments, enqueue)


def _enqueue(kernel: Kernel, grid: tuple[int, ...], arguments: dict[str, Any]) -> None:
    if kernel.names != arguments.keys():
        missing, unknown = sorted(kernel.names - set(arguments)), sorted(set(arguments) - kernel.names)
        raise ArgumentError(
            f"{kernel.name}()", f"the arguments {sorted(kernel.names)}", f"missing {missing}, unknown {unknown}"
        )
    items = math.prod(map(int, grid))
    if items == 0:
        return
    session, expected = kernel.session, items * kernel.cost.seconds_per_item
    if not expected <= UNSPLIT_SECONDS:
        _in_pieces(kernel, grid, arguments)
        return
    in_flight = session.in_flight
    if in_flight.seconds + expected > QUEUED_SECONDS_MAX:
        session.wait()
        session.calls.let_others()
    in_flight.used.append(arguments)
    in_flight.add(kernel.cost, items, _start(kernel, (0,) * len(grid), grid, arguments, whole=True))


def _in_pieces(kernel: Kernel, grid: tuple[int, ...], arguments: Mapping[str, Any]) -> None:
    """Launch in pieces, so that Ctrl-C takes effect between them, and no launch runs so long that a driver stops it."""
    session, items, unknown = kernel.session, math.prod(map(int, grid)), math.isinf(kernel.cost.seconds_per_item)
    alone = items <= math.prod(session.profile.group)  # a single group stays whole: its items may wait for each other
    session.wait()  # for earlier launches, so that Ctrl-C ends the call within one piece
    done = count = timed = 0
    took = spent = 0.0
    while done < items:
        limit = items if alone else kernel.cost.piece_after(count, took, bool(session.calls.others))
        offset, size = piece_of(grid, done, limit)
        session.calls.let_others()
        session.in_flight.used.append(arguments)
        piece = _start(kernel, offset, size, arguments, whole=alone)
        session.wait()
        count, took = math.prod(size), seconds_of(piece)
        done += count
        if not unknown or done > count or done == items:  # a kernel's first piece may include its compilation
            timed, spent = timed + count, spent + took
    kernel.cost.add(spent / max(timed, 1))


def _start(
    kernel: Kernel, offset: tuple[int, ...], size: tuple[int, ...], arguments: Mapping[str, Any], whole: bool = False
) -> cl.Event:
    import pyopencl as cl

    session, local = kernel.session, None
    group = session.profile.group
    if group == (1, 1, 1):
        # CPU runtimes compile a kernel again for launches with an offset. So all launches get an offset, at least along
        # an axis that no kernel uses.
        beyond = group[len(size) :]
        offset, size, local = offset + beyond, size + beyond, group
    elif whole:  # padded to whole groups; not for pieces, as work-items beyond a piece belong to the next one
        local = group[: len(size)]
        size = tuple(-(-items // side) * side for items, side in zip(size, local, strict=True))
    packed = _packed(kernel, arguments)
    try:
        with kernel.lock:  # another thread may launch it, too
            kernel.handle.set_args(*packed)
            return cl.enqueue_nd_range_kernel(session.queue, kernel.handle, size, local, offset)
    except cl.MemoryError as error:  # some drivers allocate buffers on first use
        used = sum(value.nbytes for value in arguments.values() if isinstance(value, DeviceArray))
        what = f"the {used / 2**20:.0f} MiB that {kernel.name}() reads and writes"
        raise OutOfMemoryError(f"not enough memory on {session.device} for {what}") from error


def _packed(kernel: Kernel, arguments: Mapping[str, Any]) -> list[Any]:
    """Arguments in pyopencl's form. Values that already have the declared types take a fast path."""
    packed: list[Any] = []
    for name, kind, dtype, argument in kernel.plan:
        value = arguments[name]
        of = value.__class__
        if kind is of:
            packed.append(value)
        elif of is DeviceArray and value.dtype is dtype and (argument.constant or not value.is_input):
            packed.append(value.buffer)
        elif of is Struct and value.values.dtype is dtype and value.name == argument.type:
            packed.append(value.values)
        else:
            packed.append(_PACK[argument.kind](kernel, argument, value))
    return packed


def _pointer(kernel: Kernel, argument: Argument, value: DeviceArray | Struct | float) -> Any:
    if isinstance(value, DeviceArray) and value.dtype == argument.dtype:
        if value.is_input and not argument.constant:
            raise ArgumentError(
                f"{kernel.name}({argument.name})", "a writable device array", "a read-only one from `upload`"
            )
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
