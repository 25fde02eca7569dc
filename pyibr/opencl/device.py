"""The device in use: opened once per process, chosen anew by nobody but the user.

The choice: the device named by `use_device`, else by ``$PYIBR_DEVICE``, else the first GPU that works, else
the CPU runtime that works and draws fastest. A device counts only after it has built and run a tiny kernel; the outcome
is kept on disk, so a later process opens its device at once. Importing this module imports no pyopencl.
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
from pyibr.opencl.binaries import forget_all, reading
from pyibr.opencl.cache import cache_folder
from pyibr.opencl.calls import Calls
from pyibr.opencl.choice import Device, choose, describe, explain_broken, select
from pyibr.opencl.fastest import forget_picture_time, picture_time
from pyibr.opencl.in_flight import InFlight
from pyibr.opencl.memory_pool import MemoryPool, Room
from pyibr.opencl.outcome import Outcome
from pyibr.opencl.probe import Doubted, forget, probe
from pyibr.opencl.profile import DeviceProfile, profile_of
from pyibr.opencl.runtimes import Found, found_devices, new_context
from pyibr.opencl.shortage import tell_shortage
from pyibr.opencl.watch import watches

if TYPE_CHECKING:
    import pyopencl as cl


__all__ = ["Device", "Session", "cache_folder", "current", "devices", "explain", "one_call", "use_device"]

VARIABLE = "PYIBR_DEVICE"


@dataclass(frozen=True, eq=False)
class Session:
    """A device opened in this process.

    Attributes
    ----------
    device : Device
        What was opened.
    context : pyopencl.Context
        Its context, of this one device.
    queue : pyopencl.CommandQueue
        Its queue, of all threads; commands run in order.
    profile : DeviceProfile
        How it is used, since it is a CPU or a GPU.
    kernels : dict
        What `kernel` has built here.
    memory_pool : MemoryPool
        Memory that `empty` hands out again.
    pinned_pool : MemoryPool
        The same of memory on the host that the device copies to by itself.
    pinned : Room
        How much of that frames may hold: the system can move none of it.
    building : dict of threading.RLock
        Held while a program is built or loaded, each by one; others' calls go on with what there is.
    ahead : set
        Programs that `build_ahead` was asked for.
    calls : Calls
        Those in progress.
    flights : dict of int to InFlight
        What the queue still has to do, by thread.
    """

    device: Device
    context: cl.Context
    queue: cl.CommandQueue
    profile: DeviceProfile
    kernels: dict[Hashable, Any] = field(default_factory=dict["Hashable", Any], repr=False)
    memory_pool: MemoryPool = field(default_factory=MemoryPool, repr=False)
    pinned_pool: MemoryPool = field(default_factory=MemoryPool, repr=False)
    pinned: Room = field(default_factory=lambda: Room(1 << 29), repr=False)
    building: dict[Hashable, threading.RLock] = field(default_factory=dict["Hashable", threading.RLock], repr=False)
    ahead: set[Hashable] = field(default_factory=set["Hashable"], repr=False)
    calls: Calls = field(default_factory=Calls, repr=False)
    flights: defaultdict[int, InFlight] = field(default_factory=lambda: defaultdict(InFlight), repr=False)

    @property
    def in_flight(self) -> InFlight:
        """This thread's part of what the queue still has to do."""
        return self.flights[threading.get_ident()]

    @cached_property
    def copies(self) -> cl.CommandQueue:
        """Queue of copies to the host, which run beside later launches; where nothing is copied, the launches' own."""
        import pyopencl as cl

        made = self.queue if self.profile.in_place else cl.CommandQueue(self.context)
        return self.__dict__.setdefault("copies", made)  # another thread may have made it

    @cached_property
    def room(self) -> Room:
        """The device's memory."""
        return self.__dict__.setdefault("room", Room(self.context.devices[0].global_mem_size))

    def call(self) -> AbstractContextManager[None]:
        """Be in a call of this thread, which is awaited if it fails: it may not have asked for its results."""
        return self.calls.one(self.in_flight, self.wait)

    def mark(self) -> Callable[[], None]:
        """Mark what is in the queues now; the function that is returned waits for that alone."""
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
        """Until all that is in the queues now is done. Other threads run meanwhile; Ctrl-C counts afterwards."""
        start = time.perf_counter()
        self.mark()()
        self.in_flight.finish(time.perf_counter() - start)


_chosen: ContextVar[Device | None] = ContextVar("pyibr_device", default=None)
_lock = threading.RLock()
_sessions: dict[int, Session] = {}
_failed_here: dict[int, Outcome] = {}
_forked = False
_at_fork: list[list[threading.RLock]] = []
_EXIT_TIMEOUT = 30.0  # seconds that a call in another thread may still take when the process ends: it may be compiling


def _take_locks() -> list[threading.RLock]:
    """All that no call is made without, once other threads' calls are done, or after a while."""
    end = time.monotonic() + _EXIT_TIMEOUT
    taken = [_lock] if _lock.acquire(timeout=_EXIT_TIMEOUT) else []  # from here on no session is opened
    if reading.acquire(timeout=_EXIT_TIMEOUT):
        taken.append(reading)
    gates = [session.calls.stop(end) for session in list(_sessions.values())]
    return taken + [gate for gate in gates if gate is not None]


def _before_fork() -> None:
    """Nothing is in flight when a process is forked: Intel's runtime in the child would wait for it for ever."""
    _at_fork.append(_take_locks())


def _after_fork() -> None:
    for lock in _at_fork.pop():
        lock.release()


def _after_fork_in_child() -> None:
    global _forked
    _after_fork()
    forget_all()
    _forked = _forked or found_devices.cache_info().currsize > 0


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before_fork, after_in_parent=_after_fork, after_in_child=_after_fork_in_child)


@atexit.register
def _at_exit() -> None:
    """Wait for calls of daemon threads, and keep the locks: Python ends such threads amid their C++, which aborts.

    This thread can still make calls. Another's next call waits for a lock, which is a safe place to be ended in.
    """
    if not _forked:  # other threads did not come along
        _take_locks()


def devices(*, fresh: bool = False) -> list[Device]:
    """All OpenCL devices found, those that do not work included.

    Parameters
    ----------
    fresh : bool
        Test every device now and measure its speed, whatever earlier processes found.

    Returns
    -------
    list of Device
        In the loader's order. A device that was never tested before is tested now, which takes a second.

    Examples
    --------
    >>> import pyibr as ibr
    >>> any(device.works for device in ibr.devices())
    True
    """
    checked_bool("fresh", fresh)
    with _lock:
        doubted: Doubted = "all" if fresh else "broken"
        for found in found_devices() if fresh else ():
            forget_picture_time(found)
        return [describe(found, _examine(found, doubted, measure=fresh)) for found in found_devices()]


@contextmanager
def use_device(device: Device | int | str) -> Generator[Device, None, None]:
    """Work on a certain device inside the ``with`` block.

    Blocks nest. The choice holds for the current thread (or task); other threads keep theirs.

    Parameters
    ----------
    device : Device, int or str
        One of `devices`, its index there, or a part of its platform's or its own name, version or kind, such
        as ``"intel"``, ``"pocl"`` or ``"gpu"``; upper and lower case are the same. Platforms' names count first. Of
        several that match, the first that works is taken.

    Raises
    ------
    ArgumentError
        Nothing found matches.
    DeviceError
        What matches does not work; the message says why and what mends it.

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
    try:  # Ctrl-C may come once it is set, too, before anything else is done
        _chosen.set(device)
        yield
    finally:
        _chosen.set(before)


def current() -> Session:
    """The session of the device in use; opened on the first call, the same object after that.

    Raises
    ------
    DeviceError
        No device works, or the one asked for does not; or this process was forked from one that used OpenCL.
    ArgumentError
        ``$PYIBR_DEVICE`` matches nothing.
    """
    chosen = _chosen.get()
    session = None if chosen is None or _forked else _sessions.get(chosen.index)
    if session is not None:  # as amid a call
        return session
    if _forked:  # the runtime's threads stayed behind: its next kernel would wait for them for ever
        raise DeviceError(
            "OpenCL was in use when this process was forked and does not survive that; "
            "start worker processes with multiprocessing.get_context('spawn')"
        )
    if chosen is not None:
        return _session(chosen)
    return _default_session(os.environ.get(VARIABLE, ""))


@contextmanager
def one_call() -> Generator[Session, None, None]:
    """The session of the device in use, for one call alone: until it is done, its device stays the one in use.

    Memory that is short is an OutOfMemoryError, whatever ran out of it.
    """
    session, before = current(), _chosen.get()
    with session.call():
        try:
            _chosen.set(session.device)  # `current` need not look at the environment each time
            yield session
        except Exception as error:
            tell_shortage(error, session.device)
            raise
        finally:
            _chosen.set(before)


def explain() -> tuple[Device, str]:
    """The device that `current` uses here, and why that one."""
    device = current().device
    if _chosen.get() is not None:
        return device, "named by use_device"
    if os.environ.get(VARIABLE):
        return device, f"named by ${VARIABLE}"
    if device.kind == "gpu":
        return device, "the first GPU that works"
    rivals = [found_devices()[other.index] for other in devices() if other.works and other.kind == device.kind]
    if len(rivals) > 1 and device.kind == "cpu":
        times = ", ".join(f"{1e3 * picture_time(found):.1f} ms on {found.platform}" for found in rivals)
        return device, f"the fastest CPU runtime that works: a small warp and a small relief take {times}"
    return device, f"the {'first' if len(rivals) > 1 else 'only'} {device.kind} device that works"


@functools.cache
def _default_session(selector: str) -> Session:
    with _lock:
        found = found_devices()
        if selector:
            return _session(select(found, _examine_broken_again, selector, f"${VARIABLE}"))
        while True:
            try:
                device = choose(found, _examine, picture_time)
            except DeviceError:
                device = choose(found, _examine_broken_again, picture_time)
            try:
                return _session(device)
            except DeviceError:
                continue  # it counts as failed now, and the next best is chosen


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
    """Test a broken device again, once a process: what the disk says of it may be out of date."""
    return _examine(found, "broken")
