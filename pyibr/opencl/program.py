"""Building of OpenCL programs from ``kernels/``, with a cache of their binaries on disk."""

from __future__ import annotations

import functools
import json
import logging
import os
import threading
import time
import warnings
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np

from pyibr.core.errors import ArgumentError, BuildError
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
"""No kernel needs denormals, and a CPU takes a hundred cycles for one. Binaries do not store this option."""

_SIGNATURE_FORMAT = "constant"  # part of the cache key: entries store this flag besides names and types
_OPTIONS = ["-cl-std=CL1.2", _NO_DENORMALS, "-cl-kernel-arg-info"]
"""Build options of all programs."""

VARIABLE = "PYIBR_BUILD_OPTIONS"
"""Environment variable with further options. Tests set ``-Werror``, which would break builds with users' compilers."""

_log = logging.getLogger("pyibr")
_LONG = 0.3  # seconds of building after which a message is logged: one program with the compiler's start, or several
_spent = 0.0  # seconds that this process has spent on builds
_filtering = threading.Lock()  # warning filters are global to the process
_building: ContextVar[Callable[[str], object]] = ContextVar("building", default=lambda _: None)
_keeps_all: ContextVar[bool] = ContextVar("keeps_all", default=False)


@dataclass(frozen=True)
class Argument:
    """One argument of a kernel, as declared in the source."""

    name: str
    type: str  # without address space and qualifiers: "float*", "int", "PixelMap"
    constant: bool  # a pointer to const
    dtype: np.dtype[Any]  # dtype of the elements; np.void if the host does not know the type

    @cached_property
    def kind(self) -> Literal["pointer", "number", "struct"]:
        """Kind of the argument, which decides how it is passed."""
        if self.type.endswith("*"):
            return "pointer"
        return "number" if self.type in SCALARS else "struct"


@dataclass(frozen=True)
class Kernel:
    """A built kernel of one session, with the arguments that its source declares."""

    session: Session
    handle: cl.Kernel
    name: str
    arguments: tuple[Argument, ...]
    cost: KernelCost = field(default_factory=KernelCost, compare=False, repr=False)
    lock: threading.Lock = field(default_factory=threading.Lock, compare=False, repr=False)

    @cached_property
    def names(self) -> frozenset[str]:
        """Names of the arguments."""
        return frozenset(argument.name for argument in self.arguments)

    @cached_property
    def plan(self) -> tuple[tuple[str, type | None, np.dtype[Any], Argument], ...]:
        """Name, Python type (None unless a number), dtype and `Argument` of each argument, in order."""
        kinds = {one: (float if one.type == "float" else int) for one in self.arguments if one.kind == "number"}
        return tuple((one.name, kinds.get(one), one.dtype, one) for one in self.arguments)


def kernel(file: str | Path, name: str, **defines: int) -> Kernel:
    """Return the kernel ``name`` of a file, built once for the current device and each set of defines.

    Parameters
    ----------
    file : str or Path
        For pyibr's files, the path below the kernels' folder, e.g. ``"warp/epipolar.cl"``. For your own files, a `Path`
        or an absolute path. Their includes are searched in the file's folder, then among pyibr's kernels, so that
        ``#include "lib/screen.h"`` finds pyibr's header. A changed file is built again; changed headers are not
        detected.
    name : str
        The kernel function.
    **defines : int
        Defines, passed as ``-D`` options. ``LANES`` defaults to the device's value.

    Raises
    ------
    ArgumentError
        The file does not exist, or has no such kernel.
    BuildError
        The build fails; the message has the file, the options and the compiler's log. Or an included file is missing.
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
    """Path of a user's file; None for pyibr's files."""
    if isinstance(file, Path):
        return file.absolute()
    return Path(file) if _is_absolute(file) else None


@functools.cache
def _is_absolute(file: str) -> bool:
    return Path(file).is_absolute()


def _time_of(own: Path) -> int:
    """Time of the file's last change, in nanoseconds."""
    try:
        return own.stat().st_mtime_ns
    except (OSError, ValueError) as error:  # ValueError: a name with a NUL
        reason = error.strerror if isinstance(error, OSError) else error
        raise ArgumentError("file", "a file of kernels", f"{own}: {reason}") from None


def _build(session: Session, file: str | Path, name: str, defines: Mapping[str, int]) -> list[Kernel]:
    """Build all kernels of a file as one program."""
    named = {"LANES": session.profile.lanes, **defines}
    source = expanded(file)
    # Machines with a shared home folder may have different processors under the same device name: the key differs.
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
        if _keeps_all.get() or not runtime.compiles_for_binaries:
            _keep(program, entry, head)
    else:
        program, signatures = loaded
    declared = {argument[1].rstrip("*") for signature in signatures.values() for argument in signature}
    known = SCALARS | structs(file, source, declared, named)
    return [_kernel_of(session, program, *one, known) for one in signatures.items()]


def _rounding(session: Session) -> list[str]:
    """Option for correctly rounded quotients and roots on GPUs, so that pictures equal a CPU's."""
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
    """Call `tell` before each program that this thread builds inside the ``with`` block."""
    token = _building.set(tell)
    try:
        yield
    finally:
        _building.reset(token)


@contextmanager
def keeping_binaries() -> Generator[None, None, None]:
    """Keep the binaries of all programs that are built inside the ``with`` block, even if that takes long.

    Before it returns a binary, PoCL compiles every kernel of the program again, for work-groups of any size. So pyibr
    otherwise relies on PoCL's own cache of kernels.
    """
    token = _keeps_all.set(True)
    try:
        yield
    finally:
        _keeps_all.reset(token)


def _keep(program: cl.Program, entry: Entry, head: bytes) -> None:
    import pyopencl as cl

    with suppress(cl.Error):  # some runtimes have no binaries
        (binary,) = cast("list[bytes]", program.get_info(cl.program_info.BINARIES))
        if binary:
            entry.write(head + binary)


@contextmanager
def _told(file: str | Path) -> Generator[None, None, None]:
    """Report that a program is being built, and log once why the first picture takes long."""
    global _spent
    start = time.perf_counter()
    _building.get()(f"kernels are being built for this device, once: {display_name(file)}")
    try:
        yield
    finally:
        before, _spent = _spent, _spent + time.perf_counter() - start
    if before < _LONG <= _spent:
        _log.info("kernels are being built for this device; `pyibr doctor --build` builds all of them in advance")


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
    # Types by which pyopencl passes arguments, None for buffers; a struct passes as bytes of its size.
    passed = [{"pointer": None, "number": one.dtype, "struct": np.dtype("V1")}[one.kind] for one in arguments]
    handle.set_arg_types(passed)  # makes set_args twenty times as fast
    return Kernel(session, handle, name, arguments)


def _quietly_built(program: cl.Program, options: list[str]) -> cl.Program:
    """Build without pyopencl's cache, and without its warnings about compiler output."""
    import pyopencl as cl

    with _filtering, warnings.catch_warnings():
        warnings.simplefilter("ignore", cl.CompilerWarning)
        return program.build(options=options, cache_dir=cast("str", False))  # the stubs lack False


def _signature(handle: cl.Kernel) -> list[tuple[str, str, bool]]:
    import pyopencl as cl

    info, arguments = cl.kernel_arg_info, list[tuple[str, str, bool]]()
    for i in range(handle.num_args):
        name, declared = (str(handle.get_arg_info(i, wanted)) for wanted in (info.NAME, info.TYPE_NAME))
        qualifiers = cast("int", handle.get_arg_info(i, info.TYPE_QUALIFIER))
        arguments.append((name, declared.replace(" ", ""), bool(qualifiers & cl.kernel_arg_type_qualifier.CONST)))
    return arguments


def _load(session: Session, kept: bytes | None) -> tuple[cl.Program, _Signatures] | None:
    """Load a program from a cache entry; None if there is none, or the runtime rejects it."""
    import pyopencl as cl

    if kept is None:
        return None
    described, binary = kept.split(b"\n", 1)
    try:
        program = cl.Program(session.context, [session.context.devices[0]], [binary])
        return _quietly_built(program, [_NO_DENORMALS]), json.loads(described)
    except cl.Error:
        return None  # built by another runtime version with the same name
