"""Conversion of files of Gaussians by gaussforge, in a process of its own.

gaussforge is native code. Some damaged files crash it; for others it would take all memory.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from pyibr.core.errors import MissingPackageError
from pyibr.core.optional import gaussforge

_CODE = """
import os, sys
folder, source, target, least, times = sys.argv[1:]
sys.path.append(folder)
import gaussforge
data = sys.stdin.buffer.read()
if sys.platform == "linux":  # other systems have no such limit, or another meaning of it
    import resource
    limits = [limit for limit in resource.getrlimit(resource.RLIMIT_AS) if limit >= 0]
    limit = min([int(least) + int(times) * len(data), *limits])
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
output = os.dup(1)
os.dup2(2, 1)  # gaussforge prints
made = gaussforge.GaussForge().convert(data, source, target)
if "error" in made:
    sys.exit(made["error"])
with os.fdopen(output, "wb") as stream:
    stream.write(made["data"])
"""
_LEAST, _TIMES = 1 << 29, 100  # limit of the process's memory: bytes, and in addition this many times the file's


def converted(data: bytes, source: str, target: str) -> bytes:
    """Convert a file's bytes from one format to another, such as "spz" to "ply"; ValueError if they are damaged."""
    folder = Path(gaussforge().__file__).parents[1]
    if not sys.executable or getattr(sys, "frozen", False):  # in a frozen application, it is the application
        raise MissingPackageError("Gaussians in .splat, .spz and .sog files need a Python interpreter, to convert them")
    command = [sys.executable, "-I", "-c", _CODE, str(folder.absolute()), source, target, str(_LEAST), str(_TIMES)]
    done = subprocess.run(command, input=data, capture_output=True)
    if done.returncode or not done.stdout:
        said = [line for line in done.stderr.decode(errors="replace").splitlines() if line.strip()]
        raise ValueError(said[-1] if said and done.returncode >= 0 else "values that are not possible in it")
    return done.stdout
