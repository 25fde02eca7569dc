"""Process that tests a device, and then builds programs for the process that started it (`builder`)."""

from __future__ import annotations

import json
import os
import sys
import threading
from collections import deque
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pyibr.core.errors import DeviceError
from pyibr.opencl import selftest
from pyibr.opencl.device import current, use_device
from pyibr.opencl.probe import remember
from pyibr.opencl.program import Argument, Kernel, kernel
from pyibr.opencl.runtimes import found_devices
from pyibr.opencl.selftest import Outcome

if TYPE_CHECKING:
    import pyopencl as cl

_IDLE = 5.0  # seconds without a request after which the process ends
_ZEROS = np.zeros(1 << 17)  # content of the buffer that kernels get in launches that only compile them


class _Request(NamedTuple):
    answer: str
    file: str
    name: str
    defines: dict[str, int]
    compiled: bool


class _Requests:
    """Requests from standard input, read by a thread."""

    def __init__(self) -> None:
        self._programs, self._kernels = deque[_Request](), deque[_Request]()
        self._changed = threading.Condition()
        threading.Thread(target=self._read, daemon=True).start()

    def next(self) -> _Request | None:
        """Return the next request, programs before kernels; None if there is none for `_IDLE` seconds."""
        with self._changed:
            if not self._changed.wait_for(lambda: len(self._programs) + len(self._kernels) > 0, _IDLE):
                return None
            return (self._programs or self._kernels).popleft()

    def _read(self) -> None:
        for line in sys.stdin:
            request = _Request(*json.loads(line))
            with self._changed:
                if request.compiled:
                    self._kernels.append(request)
                    request = request._replace(answer="", compiled=False)
                self._programs.append(request)
                self._changed.notify()
        os._exit(0)  # the parent process has ended


def main(key: str, _: str) -> None:
    """Print that this process has started, and the outcome for the device with this key as JSON; then build."""
    os.environ.setdefault("POCL_AFFINITY", "0")  # threads are not pinned, so that they compile on idle processors
    everything = found_devices()
    print("\n" + selftest.READY, flush=True)
    found = next((found for found in everything if found.key == key), None)
    if found is None:
        sys.exit("another process does not find this device")
    remember(found, Outcome(True))  # so that it is opened before its test
    with use_device(found.index):
        outcome = selftest.test(found.handle, measure=False, context=_context())
        print("\n" + outcome.to_json(), flush=True)
        if outcome.works:
            _serve()


def _context() -> cl.Context | None:
    try:
        return current().context
    except DeviceError:  # it cannot be opened, which the test reports
        return None


def _serve() -> None:
    requests, memory = _Requests(), zeros()
    while (request := requests.next()) is not None:
        built = kernel(request.file, request.name, **request.defines)
        if request.compiled:
            compile_for_launches(built, memory)
        if request.answer:
            print(f"\n{request.answer}", flush=True)
    os._exit(0)


def zeros() -> cl.Buffer:
    """Return a buffer of zeros on the current device."""
    import pyopencl as cl

    flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
    return cl.Buffer(current().context, flags, hostbuf=_ZEROS)


def compile_for_launches(built: Kernel, memory: cl.Buffer) -> None:
    """Compile a kernel by a launch of one work-item without work: all sizes are 0.

    PoCL compiles a kernel for a work-group size only when it is launched with this size. All arrays are the same
    `memory` of zeros, which does not change.
    """
    import pyopencl as cl

    session = built.session

    def nothing(argument: Argument) -> Any:
        if argument.kind == "pointer":
            return memory
        return np.zeros((), argument.dtype)[()] if argument.kind == "struct" else 0

    built.handle.set_args(*map(nothing, built.arguments))
    cl.enqueue_nd_range_kernel(session.queue, built.handle, (1, 1, 1), (1, 1, 1), (0, 0, 1))
    session.wait()
