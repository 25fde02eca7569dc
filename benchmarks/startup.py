"""Costs of a process: the import, the first frame, and memory, each measured in separate processes."""

from __future__ import annotations

import functools
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.cases import Plan
from benchmarks.results import Record, Skip
from benchmarks.runner import Case, Work

BARS = {"import": 200.0, "first frame": 400.0, "peak memory": 3.0}
"""Upper limits.

Milliseconds of `import pyibr`; milliseconds from a process's start to its first frame, if the kernels are in the cache;
and memory that the largest warp adds to the process, inputs and outputs included, divided by inputs and outputs.
"""

IMPORT = """
from time import perf_counter
start = perf_counter()
import numpy
numpy_ms = 1e3 * (perf_counter() - start)
import pyibr
import_ms = 1e3 * (perf_counter() - start)
import json
print(json.dumps({"import_ms": import_ms, "numpy_ms": numpy_ms}))
"""


def cases(plan: Plan) -> Iterator[Case]:
    """Imports, first frames, and memory by size."""
    yield Case({"what": "import"}, functools.partial(_imports, plan.startup_repeats))
    yield Case({"what": "first frame"}, functools.partial(_frames, plan.startup_repeats, plan.startup_empty_cache))
    for n in plan.memory:
        yield Case({"what": "memory", "size": n}, functools.partial(_memory, n))


def _imports(repeats: int) -> Work:
    def read() -> Iterator[Record]:
        python("-c", IMPORT)  # not timed: writes bytecode, and brings files into memory
        runs = [python("-c", IMPORT) for _ in range(repeats)]
        yield Record("import pyibr", "import", "ms", {}, [run["import_ms"] for run in runs])
        yield Record("import pyibr", "of that NumPy", "ms", {}, [run["numpy_ms"] for run in runs])

    return Work(read=read)


def _frames(repeats: int, empty_cache: bool) -> Work:
    def read() -> Iterator[Record]:
        with tempfile.TemporaryDirectory() as folder:
            # PoCL keeps built kernels in a cache, too.
            caches = {"PYIBR_CACHE": f"{folder}/pyibr", "POCL_CACHE_DIR": f"{folder}/pocl"} if empty_cache else {}
            first = child("frame", settings=caches)
            if empty_cache:
                yield Record("first process ever", "whole process", "ms", {}, [first["process_ms"]])
                for name, built in first["kernels_ms"].items():
                    yield Record(name, "build", "ms", {}, [built])
            runs = [child("frame", settings=caches) for _ in range(repeats)]
        yield Record("second process", "whole process", "ms", {}, [run["process_ms"] for run in runs])
        yield Record("second process", "import to frame", "ms", {}, [run["frame_ms"] for run in runs])
        for name in runs[0]["kernels_ms"]:
            yield Record(name, "load", "ms", {}, [run["kernels_ms"][name] for run in runs])

    return Work(read=read)


def _memory(n: int) -> Work | Skip:
    if not Path("/proc/self/clear_refs").exists():
        return Skip("peak memory", "this system does not report a process's peak memory in /proc")

    def read() -> Iterator[Record]:
        found = child("memory", str(n))
        arrays = found["inputs"] + found["outputs"]
        parameters: dict[str, Any] = {"size": n}
        for name in ("inputs", "outputs", "added", "process"):
            yield Record(name, "memory", "bytes", parameters, [found[name]])
        yield Record("peak memory", "of inputs and outputs", "share", parameters, [found["added"] / arrays])
        yield Record("whole process", "of inputs and outputs", "share", parameters, [found["process"] / arrays])

    return Work(read=read)


def child(*arguments: str, settings: dict[str, str] | None = None) -> dict[str, Any]:
    """Run ``python -m benchmarks.child``, and return its report."""
    return python("-m", "benchmarks.child", *arguments, settings=settings)


def python(*arguments: str, settings: dict[str, str] | None = None) -> dict[str, Any]:
    """Run Python; return the JSON that it prints, and the milliseconds of the whole process."""
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=Path(__file__).parent.parent,
        env={**os.environ, **(settings or {})},
        capture_output=True,
        text=True,
    )
    took = 1e3 * (time.perf_counter() - start)
    if done.returncode:
        raise RuntimeError(f"python {' '.join(arguments)} failed:\n{done.stderr}")
    return {"process_ms": took, **json.loads(done.stdout)}
