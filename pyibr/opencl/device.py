"""The device in use, which is opened once per process and changes only at the user's request.

It is the device named by `use_device`, else by ``$PYIBR_DEVICE``, else the first GPU that works, else the fastest CPU
runtime that works. A device must first build and run a tiny kernel. The outcome is kept on disk, so later processes
open their device immediately. Importing this module does not import pyopencl.
"""

from __future__ import annotations

import atexit
import functools
import os
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Generator, Hashable
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from pyibr.core.checks import checked_bool
from pyibr.core.errors import ArgumentError, DeviceError
from pyibr.opencl.cache import cache_folder
from pyibr.opencl.calls import Calls
from pyibr.opencl.choice import Device, choose, describe, explain_broken, select
from pyibr.opencl.in_flight import InFlight
from pyibr.opencl.memory_pool import MemoryPool, Room, tell_shortage
from pyibr.opencl.probe import Doubted, forget, probe
from pyibr.opencl.profile import DeviceProfile, profile_of
from pyibr.opencl.runtimes import Found, found_devices, new_context
from pyibr.opencl.selftest import Outcome
from pyibr.opencl.watch import watches

if TYPE_CHECKING:
    import pyopencl as cl

__all__ = ["Device", "Session", "cache_folder", "current", "devices", "explain", "one_call", "use_device"]

VARIABLE = "PYIBR_DEVICE"


@dataclass(frozen=True, eq=False)
class Session:
    """A device opened in this process."""

    device: Device
    context: cl.Context
    queue: cl.CommandQueue  # shared by all threads; commands run in order
    profile: DeviceProfile
    # Kernels that `kernel` has built
    kernels: dict[Hashable, Any] = field(default_factory=dict["Hashable", Any], repr=False)
    # Free device memory, which `empty` reuses, and free pinned memory on the host
    memory_pool: MemoryPool = field(default_factory=MemoryPool, repr=False)
    pinned_pool: MemoryPool = field(default_factory=MemoryPool, repr=False)
    # Limit of pinned memory for frames, which the system cannot move
    pinned: Room = field(default_factory=lambda: Room(1 << 29), repr=False)
    # A lock for each program, held while it is built or loaded; calls that need other programs continue
    building: dict[Hashable, threading.RLock] = field(default_factory=dict["Hashable", threading.RLock], repr=False)
    # Programs requested by `build_ahead`
    ahead: set[Hashable] = field(default_factory=set["Hashable"], repr=False)
    calls: Calls = field(default_factory=Calls, repr=False)  # calls in progress
    # Launches in flight, by thread
    flights: defaultdict[int, InFlight] = field(default_factory=lambda: defaultdict(InFlight), repr=False)

    @property
    def in_flight(self) -> InFlight:
        """This thread's launches in flight."""
        return self.flights[threading.get_ident()]

    @cached_property
    def copies(self) -> cl.CommandQueue:
        """Queue of copies to the host, which overlap with later launches; `queue` on devices that work in place."""
        import pyopencl as cl

        made = self.queue if self.profile.in_place else cl.CommandQueue(self.context)
        return self.__dict__.setdefault("copies", made)  # another thread may have made it

    @cached_property
    def room(self) -> Room:
        """The device's memory."""
        return self.__dict__.setdefault("room", Room(self.context.devices[0].global_mem_size))

    def call(self) -> AbstractContextManager[None]:
        """Enter a call of this thread. If the call fails, wait for its launches."""
        return self.calls.one(self.in_flight, self.wait)

    def mark(self) -> Callable[[], None]:
        """Mark the current end of the queues; the returned function waits only for the commands before it."""
        import pyopencl as cl

        queues = (self.queue,) if self.copies is self.queue else (self.queue, self.copies)
        markers, in_flight = [cl.enqueue_marker(queue) for queue in queues], self.in_flight
        expected = in_flight.seconds
        for queue in queues:
            queue.flush()

        def wait() -> None:
            if watches:
                watches[-1].wait()
            for marker in markers:
                marker.wait()
            in_flight.seconds = max(in_flight.seconds - expected, 0.0)

        return wait

    def wait(self) -> None:
        """Wait until all commands in the queues are done. Other threads run meanwhile; Ctrl-C works only afterwards."""
        start = time.perf_counter()
        self.mark()()
        self.in_flight.finish(time.perf_counter() - start)


_chosen: ContextVar[Device | None] = ContextVar("pyibr_device", default=None)
_lock = threading.RLock()
_sessions: dict[int, Session] = {}
_failed_here: dict[int, Outcome] = {}
_forked = False
_at_fork: list[list[threading.RLock]] = []
_EXIT_TIMEOUT = 30.0  # longest wait, when the process ends, for calls in other threads, which may be compiling


def _take_locks() -> list[threading.RLock]:
    """Acquire all locks that calls need, once the calls of other threads have ended, or after a timeout."""
    end = time.monotonic() + _EXIT_TIMEOUT
    taken = [_lock] if _lock.acquire(timeout=_EXIT_TIMEOUT) else []  # from here on, no session can be opened
    gates = [session.calls.stop(end) for session in list(_sessions.values())]
    return taken + [gate for gate in gates if gate is not None]


def _before_fork() -> None:
    """Wait for all calls before a fork: Intel's runtime in the child would wait forever for launches in flight."""
    _at_fork.append(_take_locks())


def _after_fork() -> None:
    for lock in _at_fork.pop():
        lock.release()


def _after_fork_in_child() -> None:
    global _forked
    _after_fork()
    _forked = _forked or found_devices.cache_info().currsize > 0


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before_fork, after_in_parent=_after_fork, after_in_child=_after_fork_in_child)


@atexit.register
def _at_exit() -> None:
    """Wait for calls of daemon threads, and keep the locks, since Python would abort if it ended them inside C++ code.

    This thread can still make calls. A daemon thread's next call waits for a lock, where it can end safely.
    """
    if not _forked:  # a forked process has no other threads
        _take_locks()


def devices(*, fresh: bool = False) -> list[Device]:
    """Return all OpenCL devices, including devices that do not work.

    Parameters
    ----------
    fresh : bool
        Test every device now and measure its speed, regardless of earlier results.

    Returns
    -------
    list of Device
        Devices in the loader's order. A device that was never tested is tested now, which takes a second.

    Examples
    --------
    >>> import pyibr as ibr
    >>> any(device.works for device in ibr.devices())
    True
    """
    checked_bool("fresh", fresh)
    with _lock:
        doubted: Doubted = "all" if fresh else "broken"
        return [describe(found, _examine(found, doubted, measure=fresh)) for found in found_devices()]


@contextmanager
def use_device(device: Device | int | str) -> Generator[Device, None, None]:
    """Use a certain device inside the ``with`` block.

    Blocks can be nested. The choice applies to the current thread (or task) only.

    Parameters
    ----------
    device : Device, int or str
        One of `devices`, its index there, or a part of its platform, name, version or kind, such as ``"intel"``,
        ``"pocl"`` or ``"gpu"``, in upper or lower case. Matches of the platform's name have priority. If several
        devices match, the first that works is used.

    Raises
    ------
    ArgumentError
        No device matches.
    DeviceError
        No matching device works; the message has the reasons and the remedies.

    Examples
    --------
    >>> import pyibr as ibr
    >>> with ibr.use_device("cpu") as device:
    ...     print(device.kind)
    cpu
    """
    selector = device.index if isinstance(device, Device) else device
    if isinstance(selector, bool) or not isinstance(selector, (int, str)):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ArgumentError("device", "a Device, an index or a part of a name", type(device).__name__)
    with _lock:
        picked = select(found_devices(), _examine_broken_again, selector, "device")
    with _choosing(picked):
        yield picked


@contextmanager
def _choosing(device: Device) -> Generator[None, None, None]:
    before = _chosen.get()
    try:  # around `set`, too, since Ctrl-C may come right after it
        _chosen.set(device)
        yield
    finally:
        _chosen.set(before)


def current() -> Session:
    """Return the session of the device in use; it is opened on first use.

    Raises
    ------
    DeviceError
        No device works, or the requested device does not; or this process was forked from one that used OpenCL.
    ArgumentError
        ``$PYIBR_DEVICE`` matches no device.
    """
    chosen = _chosen.get()
    session = None if chosen is None or _forked else _sessions.get(chosen.index)
    if session is not None:  # the fast path, inside calls
        return session
    if _forked:  # the runtime's threads are missing here, and its next kernel would wait for them forever
        raise DeviceError(
            "OpenCL was in use when this process was forked and does not survive that; "
            "start worker processes with multiprocessing.get_context('spawn')"
        )
    if chosen is not None:
        return _session(chosen)
    return _default_session(os.environ.get(VARIABLE, ""))


@contextmanager
def one_call() -> Generator[Session, None, None]:
    """Enter a call on the device in use, which stays in use until the call ends.

    All out-of-memory errors become OutOfMemoryError.
    """
    session, before = current(), _chosen.get()
    with session.call():
        try:
            _chosen.set(session.device)  # saves `current` from reading the environment each time
            yield session
        except Exception as error:
            tell_shortage(error, session.device)
            raise
        finally:
            _chosen.set(before)


def explain() -> tuple[Device, str]:
    """Return the device that `current` uses, and the reason for this choice."""
    device = current().device
    if _chosen.get() is not None:
        return device, "named by use_device"
    if os.environ.get(VARIABLE):
        return device, f"named by ${VARIABLE}"
    if device.kind == "gpu":
        return device, "the first GPU that works"
    rivals = [other for other in devices() if other.works and other.kind == device.kind]
    which = "only" if len(rivals) == 1 else "fastest" if device.kind == "cpu" else "first"
    return device, f"the {which} {device.kind} device that works"


@functools.cache
def _default_session(selector: str) -> Session:
    with _lock:
        found = found_devices()
        if selector:
            return _session(select(found, _examine_broken_again, selector, f"${VARIABLE}"))
        while True:
            try:
                device = choose(found, _examine)
            except DeviceError:
                device = choose(found, _examine_broken_again)
            try:
                return _session(device)
            except DeviceError:
                continue  # the device is now marked as failed, and the next best is chosen


def _session(device: Device) -> Session:
    session = _sessions.get(device.index)
    if session is not None:
        return session
    import pyopencl as cl

    with _lock:
        if device.index in _sessions:
            return _sessions[device.index]
        found = found_devices()[device.index]
        try:
            context = new_context(found.handle)
            queue = cl.CommandQueue(context, properties=cl.command_queue_properties.PROFILING_ENABLE)
        except cl.Error as error:
            forget(found)
            failed = _failed_here[device.index] = Outcome(False, f"it cannot be opened: {error}")
            broken = explain_broken([describe(found, failed)])
            raise DeviceError(f"the device does not work.\n{broken}") from error
        session = _sessions[device.index] = Session(device, context, queue, profile_of(device.kind))
        return session


def _examine(found: Found, doubted: Doubted = "nothing", measure: bool = False) -> Outcome:
    return _failed_here.get(found.index) or probe(found, measure, doubted)


def _examine_broken_again(found: Found) -> Outcome:
    """Test a broken device again, once per process, since the outcome on disk may be out of date."""
    return _examine(found, "broken")
