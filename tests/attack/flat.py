"""Checks that memory does not grow over 10,000 warps and 2,000 calls of each other kind: `-m tests.attack.flat`."""

from __future__ import annotations

import argparse
import gc
import sys
import time

from benchmarks.child import memory
from pyibr.opencl.device import current
from tools.everything import Call, calls

MOST = 0.01
"""Largest permitted growth of the process's memory after a tenth of the calls, as a fraction."""


def growth(call: Call, count: int) -> float:
    """Make the calls; returns by which fraction resident memory grows after a tenth of them."""
    for _ in range(count // 10):
        call()
    gc.collect()
    before = memory("VmRSS")
    for _ in range(count - count // 10):
        call()
    gc.collect()
    return memory("VmRSS") / before - 1


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.attack.flat", description=__doc__)
    parser.add_argument("--count", type=int, default=2000, help="calls of each kind; warps: five times as many")
    parser.add_argument("names", nargs="*", help="kinds of calls (default: all)")
    given = parser.parse_args()
    made, worst = calls(), 0.0
    for name in given.names or made:
        count, start = given.count * (5 if name == "sweep" else 1), time.monotonic()
        grown = growth(made[name], count)
        worst = max(worst, grown)
        device = current().room.taken / 2**20
        print(
            f"{name}: {count} calls in {time.monotonic() - start:.0f} s, {100 * grown:+.2f} % of"
            f" {memory('VmRSS') / 2**20:.0f} MiB, on the device {device:.1f} MiB",
            flush=True,
        )
    return worst > MOST


if __name__ == "__main__":
    sys.exit(main())
