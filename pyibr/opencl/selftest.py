"""Test of one device with tiny kernels: whether it works, and how fast it is."""

from __future__ import annotations

import json
import mmap
import re
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from pyibr.opencl.runtimes import found_devices, new_context

if TYPE_CHECKING:
    import pyopencl as cl

READY = "ready to test"
"""First line that `main` prints."""

_SOURCE = """
/* out[i] = 3 * in[i] + i. Mesa's rusticl 25 loses structs that are copied in unrolled loops. */
typedef struct { uint value; } Held;
kernel void check(global const uint *in, global uint *out, uint n) {
    const uint i = get_global_id(0);
    uint sum = i;
    for (int k = 0; k < 3; ++k) {
        const Held held = {in[min(i, n - 1)]}, copied = held;
        sum += copied.value;
    }
    if (i < n) { out[i] = sum; }
}

#if WIDE
/* clang builtins of kernels for CPUs (kernels/lib/lanes.h). Mesa's llvmpipe has clang, but ends the process here. */
kernel void foresee(global const int16 *in, global int *out) {
#ifdef __has_builtin
#if __has_builtin(__builtin_prefetch) && __has_builtin(__builtin_reduce_or)
    __builtin_prefetch((const void *)(uintptr_t)(in + 1));
    out[0] = __builtin_reduce_or(in[0]);
#endif
#endif
}
#endif

kernel void copy(global const float16 *in, global float16 *out) {
    out[get_global_id(0)] = in[get_global_id(0)];
}

kernel void multiply_add(global float16 *out, float slope) {
    float16 a = (float16)((float)get_global_id(0)), b = a + 1.0f, c = a + 2.0f, d = a + 3.0f;
    for (int i = 0; i < 256; ++i) {
        a = mad(a, slope, 0.5f);
        b = mad(b, slope, 0.5f);
        c = mad(c, slope, 0.5f);
        d = mad(d, slope, 0.5f);
    }
    out[get_global_id(0)] = a + b + c + d;
}
"""


@dataclass(frozen=True)
class Speed:
    """Speed from measurements of a fraction of a second: a hint, not a benchmark."""

    copy: float
    """GB/s, the sum of bytes read and bytes written."""
    mad: float
    """Gflop/s of 16-wide float32 multiply-adds."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of one device's test."""

    works: bool
    reason: str = ""
    speed: Speed | None = None

    def to_json(self) -> str:
        """Return the outcome as one line of text."""
        return json.dumps(asdict(self))

    @staticmethod
    def from_json(text: str) -> Outcome | None:
        """Invert `to_json`; None if the text is damaged or from another version."""
        try:
            raw = cast("dict[str, object]", json.loads(text))
            speed = cast("dict[str, float] | None", raw["speed"])
            return Outcome(raw["works"] is True, str(raw["reason"]), None if speed is None else Speed(**speed))
        except (ValueError, TypeError, KeyError):
            return None


def test(device: cl.Device, measure: bool, context: cl.Context | None = None) -> Outcome:
    """Build and run the kernels here, in this process.

    measure: also measure the device's speed, in under a second. context: the device's context, if it is open: in
    another context, PoCL's compiler would start again.
    """
    import pyopencl as cl

    try:
        context = context or new_context(device)
        queue = cl.CommandQueue(context)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # compiler output
            # False turns off pyopencl's cache, since a cached binary would prove nothing; its annotation lacks False.
            uncached = cast("str", False)
            options = ["-cl-std=CL1.2", f"-DWIDE={int(bool(device.type & cl.device_type.CPU))}"]
            program = cl.Program(context, _SOURCE).build(options, cache_dir=uncached)
        if not _is_right(queue, program):
            return Outcome(False, "a tiny kernel runs but its results are wrong")
        if device.type & cl.device_type.CPU and not _is_in_place(queue, program):
            return Outcome(False, "its kernels do not work in the host's own memory")
        return Outcome(True, speed=_speed(queue, program) if measure else None)
    except (cl.Error, RuntimeError) as error:
        return Outcome(False, _readable(str(error)))


def _is_right(queue: cl.CommandQueue, program: cl.Program) -> bool:
    import pyopencl as cl

    n = 1000
    given = np.arange(n, dtype=np.uint32)[::-1].copy()
    flags = cl.mem_flags
    source = cl.Buffer(queue.context, flags.READ_ONLY | flags.COPY_HOST_PTR, hostbuf=given)
    target = cl.Buffer(queue.context, flags.WRITE_ONLY, given.nbytes)
    cl.Kernel(program, "check")(queue, (1024,), None, source, target, np.uint32(n))
    got = np.empty_like(given)
    cl.enqueue_copy(queue, got, target)
    return np.array_equal(got, given * 3 + np.arange(n, dtype=np.uint32))


def _is_in_place(queue: cl.CommandQueue, program: cl.Program) -> bool:
    """Tell whether kernels and the host share whole pages of memory without a copy."""
    import pyopencl as cl

    n = mmap.PAGESIZE // 4
    given, made = (np.frombuffer(mmap.mmap(-1, mmap.PAGESIZE), np.uint32) for _ in range(2))
    flags = cl.mem_flags.READ_WRITE | cl.mem_flags.USE_HOST_PTR
    source, target = (cl.Buffer(queue.context, flags, hostbuf=memory) for memory in (given, made))
    given[:] = np.arange(n)[::-1]
    cl.Kernel(program, "check")(queue, (n,), None, source, target, np.uint32(n))
    queue.finish()
    return np.array_equal(made, given * 3 + np.arange(n, dtype=np.uint32))


def _speed(queue: cl.CommandQueue, program: cl.Program) -> Speed:
    import pyopencl as cl

    width = 2048
    flags = cl.mem_flags
    given = np.ones((width, width), dtype=np.float32)
    a = cl.Buffer(queue.context, flags.READ_WRITE | flags.COPY_HOST_PTR, hostbuf=given)
    b = cl.Buffer(queue.context, flags.READ_WRITE, given.nbytes)
    copy, mad = (cl.Kernel(program, name) for name in ("copy", "multiply_add"))

    def seconds(run: Callable[[], object]) -> float:
        times: list[float] = []
        end = time.perf_counter() + 0.15
        while len(times) < 3 or (time.perf_counter() < end and len(times) < 50):
            start = time.perf_counter()
            run()
            queue.finish()
            times.append(time.perf_counter() - start)
        return min(times[1:])  # the first run may include compilation

    items = width * width // 16
    copying = seconds(lambda: copy(queue, (items,), None, a, b))
    adding = seconds(lambda: mad(queue, (items // 8,), None, b, np.float32(0.5)))
    return Speed(copy=2 * given.nbytes / copying / 1e9, mad=items // 8 * 256 * 4 * 16 * 2 / adding / 1e9)


def _readable(message: str) -> str:
    """The line of a build log or status that names the error."""
    lines = [line.strip() for line in message.splitlines() if line.strip()]
    for line in lines:
        if re.search(r"\berror:", line, re.IGNORECASE):
            return f"every build fails: {line[line.lower().index('error:') + 6 :].strip()}"
    return lines[0] if lines else "no message"


def main(key: str, what: str) -> None:
    """Print that this process has started, and the outcome for the device with this key as JSON (for `probe`)."""
    everything = found_devices()
    print("\n" + READY, flush=True)
    for found in everything:
        if found.key == key:
            print("\n" + test(found.handle, measure=what == "speed").to_json())
            return
    sys.exit("another process does not find this device")
