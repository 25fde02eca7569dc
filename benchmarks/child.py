"""One measurement in a separate process, which prints JSON. Called through `benchmarks.startup.child`."""

from __future__ import annotations

import time

START = time.perf_counter()

import json  # noqa: E402 - the clock starts before the imports
import sys  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

KERNEL_RUNS = 7


def elapsed(start: float) -> float:
    return 1e3 * (time.perf_counter() - start)


def measure_frame() -> dict[str, Any]:
    """Measure the time from the process's start to a first, small picture."""
    from benchmarks import scenes
    from benchmarks.launches import build_times

    view, target = scenes.view(256), scenes.target_camera(256, "F", "forward")
    import pyibr as ibr

    with build_times() as kernels:
        ibr.warp(view, target)
    return {"frame_ms": elapsed(START), "kernels_ms": kernels}


def measure_memory(n: int) -> dict[str, Any]:
    """Measure the peak memory of a warp, in all and beyond the memory before its inputs were made."""
    import pyibr as ibr
    from benchmarks import scenes

    ibr.warp(scenes.view(16), scenes.target_camera(16, "F", "forward"))  # loads the runtime and the kernels
    target = scenes.target_camera(n, "F", "forward")
    before = memory("VmRSS")
    color, depth = scenes.relief(n)
    Path("/proc/self/clear_refs").write_text("5")  # resets the peak
    frame = ibr.warp(ibr.DepthImage(color, depth, scenes.source_camera(n)), target)
    peak = memory("VmHWM")
    return {
        "inputs": color.nbytes + depth.nbytes,
        "outputs": frame.color.nbytes + frame.depth.nbytes + frame.valid.nbytes,
        "added": peak - before,
        "process": peak,
    }


def measure_kernels(scene: str, width: int, height: int, noise: float) -> dict[str, Any]:
    """Time a warp's kernels, after a warm-up run, on as many threads as environment variables allow."""
    from benchmarks.launches import kernel_times
    from benchmarks.warp.rgbd import kernel_work
    from pyibr.opencl.device import current

    times: dict[str, list[float]] = {}
    for turn in range(KERNEL_RUNS + 1):
        with kernel_times() as launches:
            kernel_work(scene, (width, height), noise)
        for kernel, values in launches.items() if turn else ():
            times.setdefault(kernel, []).append(sum(values))
    return {"kernels_ms": times, "threads": current().context.devices[0].max_compute_units}


def memory(name: str) -> int:
    """Read an entry of /proc/self/status, such as VmRSS, in bytes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(1024 * int(line.split()[1]) for line in lines if line.startswith(name + ":"))


if __name__ == "__main__":
    what, *rest = sys.argv[1:]
    measures = {"frame": measure_frame, "memory": measure_memory, "kernels": measure_kernels}
    found = measures[what](*map(json.loads, rest))
    print(json.dumps(found))
