"""Builds OpenCL programs from ``kernels/`` and keeps their binaries on disk."""

from __future__ import annotations

import functools
import json
import logging
import os
import threading
import time
import warnings
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np

from pyibr.core.errors import ArgumentError, BuildError
from pyibr.opencl.binaries import keep_binary
from pyibr.opencl.builder import builder_of
from pyibr.opencl.cache import Entry
from pyibr.opencl.device import Session, current
from pyibr.opencl.headers import SCALARS, display_name, expanded, structs
from pyibr.opencl.in_flight import KernelCost
from pyibr.opencl.runtimes import found_devices, runtime_of
from pyibr.opencl.watch import watches

if TYPE_CHECKING:
    import pyopencl as cl


_Signatures = dict[str, list[tuple[str, str, bool]]]  # name, type and constant of each argument

_NO_DENORMALS = "-cl-denorms-are-zero"
"""They mean nothing in any kernel, and CPUs take a hundred cycles for one. Binaries do not hold this option."""

_SIGNATURE_FORMAT = "constant"  # part of entries' names: what they tell of arguments beyond names and types
_OPTIONS = ["-cl-std=CL1.2", _NO_DENORMALS, "-cl-kernel-arg-info"]
"""Those that every program is built with."""

VARIABLE = "PYIBR_BUILD_OPTIONS"
"""Further ones: tests' ``-Werror``, which no user's compiler is to stumble over."""

_log = logging.getLogger("pyibr")
_LONG = 0.3  # seconds of building: of one program if its device's compiler starts with it, else of several
_spent = 0.0  # seconds that this process has built
_filtering = threading.Lock()  # of warnings, which is the process's
_building: ContextVar[Callable[[str], object]] = ContextVar("building", default=lambda _: None)


@dataclass(frozen=True)
class Argument:
    """One argument of a kernel, as its source declares it."""

    name: str
    type: str  # without address space and qualifiers: "float*", "int", "PixelMap"
    constant: bool  # what it points to is not written
    dtype: np.dtype[Any]  # of its elements, as the source declares them; empty: nothing that the host knows

    @cached_property
    def kind(self) -> Literal["pointer", "number", "struct"]:
        """Kind of the argument: how it is passed."""
        if self.type.endswith("*"):
            return "pointer"
        return "number" if self.type in SCALARS else "struct"


@dataclass(frozen=True)
class Kernel:
    """A built kernel of one session, with what its source says of its arguments."""

    session: Session
    handle: cl.Kernel
    name: str
    arguments: tuple[Argument, ...]
    cost: KernelCost = field(default_factory=KernelCost, compare=False, repr=False)
    lock: threading.Lock = field(default_factory=threading.Lock, compare=False, repr=False)

    @cached_property
    def names(self) -> frozenset[str]:
        """Of the arguments."""
        return frozenset(argument.name for argument in self.arguments)

    @cached_property
    def plan(self) -> tuple[tuple[str, type | None, np.dtype[Any], Argument], ...]:
        """Name, Python's type of a number, dtype, and all that is known: of each argument, in order."""
        kinds = [_number_type(argument) for argument in self.arguments]
        return tuple((one.name, kind, one.dtype, one) for one, kind in zip(self.arguments, kinds, strict=True))


def _number_type(argument: Argument) -> type | None:
    return None if argument.kind != "number" else float if argument.type == "float" else int


def kernel(file: str | Path, name: str, **defines: int) -> Kernel:
    """The kernel ``name`` of a file, built for the current device once per set of defines.

    Parameters
    ----------
    file : str or Path
        Of pyibr's: its path below the kernels' folder, e.g. ``"warp/epipolar.cl"``. Of your own: a `Path`, or an
        absolute path. What such a file includes is looked for in its folder, then among pyibr's kernels, so that
        ``#include "lib/screen.h"`` finds pyibr's. It is built anew once it has changed; its headers are not watched.
    name : str
        The kernel function.
    **defines : int
        Becomes ``-D`` options; ``LANES`` is given by the device unless it is among them.

    Raises
    ------
    ArgumentError
        There is no such file, or it has no such kernel.
    BuildError
        With file, options and the compiler's log; or a file that it includes is not there.
    """
    if watches:
        return watches[-1].build(name, defines, lambda all_of_them: _found(file, name, all_of_them))
    return _found(file, name, defines)


def _found(file: str | Path, name: str, defines: Mapping[str, int]) -> Kernel:
    session = current()
    own = _own(file)
    whole = (file if own is None else (own, _time_of(own)), tuple(sorted(defines.items())) if defines else ())
    found = session.kernels.get((whole, name))
    if found is None:
        with session.building.setdefault(whole, threading.RLock()):
            if (whole, name) in session.kernels:
                return session.kernels[whole, name]
            built = {one.name: one for one in _build(session, str(file) if own is None else own, name, defines)}
            if name not in built:
                raise ArgumentError(
                    "name", f"a kernel of {display_name(own or str(file))}: {', '.join(sorted(built))}", repr(name)
                )
            session.kernels.update({(whole, other): kernel for other, kernel in built.items()})
        found = session.kernels[whole, name]
    return found


def _own(file: str | Path) -> Path | None:
    """Path of a file that is not pyibr's."""
    if isinstance(file, Path):
        return file.absolute()
    return Path(file) if _is_absolute(file) else None


@functools.cache
def _is_absolute(file: str) -> bool:
    return Path(file).is_absolute()


def _time_of(own: Path) -> int:
    """When it was written last."""
    try:
        return own.stat().st_mtime_ns
    except (OSError, ValueError) as error:  # the latter: a name with a NUL
        reason = error.strerror if isinstance(error, OSError) else error
        raise ArgumentError("file", "a file of kernels", f"{own}: {reason}") from None


def _build(session: Session, file: str | Path, name: str, defines: Mapping[str, int]) -> list[Kernel]:
    """All kernels of a file, since they are one program."""
    named = {"LANES": session.profile.lanes, **defines}
    source = expanded(file)
    # A home may be shared by machines whose processors differ, and the names of their devices do not.
    device = found_devices()[session.device.index]
    runtime = runtime_of(device)
    defined = (f"-D{define}={value}" for define, value in sorted(named.items()))
    further = os.environ.get(VARIABLE, "").split()
    options = [*_OPTIONS, *further, *_rounding(session), *runtime.options(device), *defined]
    entry = Entry("programs", Path(file).stem, "\0".join([source, *options, device.key, _SIGNATURE_FORMAT]))
    loaded = _load(session, entry.read())
    if loaded is None:
        with _told(file):
            if (builder := builder_of(device.key)) is not None:
                builder.wait(file, name, named)
            program = _compiled(session, file, source, options)
        signatures = {str(handle.function_name): _signature(handle) for handle in program.all_kernels()}
        head = json.dumps(signatures).encode() + b"\n"
        keep_binary(program, entry, head, runtime.compiles_for_binaries, session.calls)
    else:
        program, signatures = loaded
    declared = {argument[1].rstrip("*") for signature in signatures.values() for argument in signature}
    known = SCALARS | structs(file, source, declared, named)
    return [_kernel_of(session, program, *one, known) for one in signatures.items()]


def _rounding(session: Session) -> list[str]:
    """Quotients and roots rounded as a CPU rounds them, so that pictures are the same: GPUs need to be told."""
    import pyopencl as cl

    able = session.context.devices[0].single_fp_config & cl.device_fp_config.CORRECTLY_ROUNDED_DIVIDE_SQRT
    return ["-cl-fp32-correctly-rounded-divide-sqrt"] if able and session.device.kind != "cpu" else []


def _compiled(session: Session, file: str | Path, source: str, options: list[str]) -> cl.Program:
    import pyopencl as cl

    try:
        return _quietly_built(cl.Program(session.context, source), options)
    except cl.RuntimeError as error:
        raise BuildError(f"{display_name(file)} failed to build with {' '.join(options)}:\n{error}") from error


@contextmanager
def telling_builds(tell: Callable[[str], object]) -> Generator[None, None, None]:
    """Within it, `tell` is called before each program that this thread builds."""
    token = _building.set(tell)
    try:
        yield
    finally:
        _building.reset(token)


@contextmanager
def _told(file: str | Path) -> Generator[None, None, None]:
    """Say that a program is being built, and once why the first picture takes its time."""
    global _spent
    start = time.perf_counter()
    _building.get()(f"kernels are being built for this device, once: {display_name(file)}")
    try:
        yield
    finally:
        before, _spent = _spent, _spent + time.perf_counter() - start
    if before < _LONG <= _spent:
        _log.info("kernels are being built for this device; `pyibr doctor --build` does so beforehand, for good")


def _kernel_of(
    session: Session,
    program: cl.Program,
    name: str,
    signature: list[tuple[str, str, bool]],
    known: Mapping[str, np.dtype[Any]],
) -> Kernel:
    import pyopencl as cl

    arguments = tuple(Argument(*one, known.get(one[1].rstrip("*"), np.dtype(np.void))) for one in signature)
    handle: Any = cl.Kernel(program, name)
    handle.set_arg_types([_passed_as(argument) for argument in arguments])  # twenty times as fast as without
    return Kernel(session, handle, name, arguments)


def _passed_as(argument: Argument) -> np.dtype[Any] | None:
    """Type by which pyopencl passes an argument: buffers as such, the others' bytes."""
    return {"pointer": None, "number": argument.dtype, "struct": np.dtype("V1")}[argument.kind]


def _quietly_built(program: cl.Program, options: list[str]) -> cl.Program:
    """Built without pyopencl's own cache, and without its warning that a compiler said something."""
    import pyopencl as cl

    with _filtering, warnings.catch_warnings():
        warnings.simplefilter("ignore", cl.CompilerWarning)
        return program.build(options=options, cache_dir=cast("str", False))  # its stubs forget False


def _signature(handle: cl.Kernel) -> list[tuple[str, str, bool]]:
    import pyopencl as cl

    info, arguments = cl.kernel_arg_info, list[tuple[str, str, bool]]()
    for i in range(handle.num_args):
        name, declared = (str(handle.get_arg_info(i, wanted)) for wanted in (info.NAME, info.TYPE_NAME))
        qualifiers = cast("int", handle.get_arg_info(i, info.TYPE_QUALIFIER))
        arguments.append((name, declared.replace(" ", ""), bool(qualifiers & cl.kernel_arg_type_qualifier.CONST)))
    return arguments


def _load(session: Session, kept: bytes | None) -> tuple[cl.Program, _Signatures] | None:
    """Load a program from an entry of the cache; None where there is none, or the runtime does not take it."""
    import pyopencl as cl

    if kept is None:
        return None
    described, binary = kept.split(b"\n", 1)
    try:
        program = cl.Program(session.context, [session.context.devices[0]], [binary])
        return _quietly_built(program, [_NO_DENORMALS]), json.loads(described)
    except cl.Error:
        return None  # built by another version of the runtime, which calls itself the same
