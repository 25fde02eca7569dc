"""Functions of kernels/lib/builtins.h return the bits of OpenCL's built-in functions, and are inlined in loops."""

from __future__ import annotations

import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyopencl as cl
import pytest

from pyibr.opencl.device import current
from pyibr.opencl.headers import kernels_folder
from tools.processes import run_within

INF, NAN = np.inf, np.nan
FLOATS = np.float32([0.0, -0.0, 1.0, -1.0, 1.5, 2e-38, -2e-38, 3e38, -3e38, INF, -INF, NAN, 7.25, -7.75, 0.5, 2**24])
INTS = np.int32([0, 1, -1, 7, -7, 2**31 - 1, -(2**31), 255])
ONE = {"fabs": "fabs(a)", "floor": "floor(a)", "ceil": "ceil(a)", "sqrt": "sqrt(a)"}
TWO = {name: f"{name}(a, b)" for name in ("fmin", "fmax", "min", "max")}
TWO |= {"fmin, a number": "fmin(a, b.s0)", "clamp": "clamp(a, -fabs(b), fabs(b))", "isnan": "isnan(a) ? b : a"}


def values_of(expressions: Sequence[str], type_: str, a: np.ndarray, b: np.ndarray, header: str) -> np.ndarray:
    """Evaluate expressions on vectors of 16: by OpenCL's built-in functions, or by the functions in `header`."""
    session = current()
    stores = "".join(f"vstore16({each}, {k} * get_global_size(0) + i, out);\n" for k, each in enumerate(expressions))
    with session.call():
        source = f"""{header}
        kernel void k(global const {type_} *all_a, global const {type_} *all_b, global {type_} *out)
        {{
            const size_t i = get_global_id(0);
            const {type_}16 a = vload16(i, all_a), b = vload16(i, all_b);
            {stores}
        }}"""
        options = ["-cl-std=CL1.2", "-cl-denorms-are-zero", "-DLANES=16"]
        program = cl.Program(session.context, source).build(options, cache_dir=False)
        flags = cl.mem_flags
        given = [cl.Buffer(session.context, flags.READ_ONLY | flags.COPY_HOST_PTR, hostbuf=v) for v in (a, b)]
        out = np.empty((len(expressions), a.size), a.dtype)
        result = cl.Buffer(session.context, flags.WRITE_ONLY, out.nbytes)
        program.k(session.queue, (a.size // 16,), None, *given, result)
        cl.enqueue_copy(session.queue, out, result)
    return out


HEADER = (kernels_folder() / "lib/builtins.h").read_text()


def by_both(expressions: Sequence[str], type_: str, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return values_of(expressions, type_, a, b, HEADER), values_of(expressions, type_, a, b, "")


def pairs_of(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All pairs of values. The number of values is a multiple of 16."""
    a, b = (np.ascontiguousarray(side.ravel()) for side in np.meshgrid(values, values))
    return a, b


@pytest.mark.parametrize("numbers", [False, True])
def test_floats_have_the_bits_of_the_built_ins(numbers):
    a, b = pairs_of(FLOATS)
    names = [name for name in (*ONE, *TWO) if (name in ("min", "max", "clamp")) == numbers]
    if numbers:  # undefined for NaN in OpenCL
        known = ~np.isnan(a) & ~np.isnan(b)
        a, b = np.where(known, a, 0).astype(np.float32), np.where(known, b, 1).astype(np.float32)
    for name, ours, own in zip(names, *by_both([{**ONE, **TWO}[name] for name in names], "float", a, b), strict=True):
        np.testing.assert_array_equal(np.isnan(ours), np.isnan(own), name)
        there = ~np.isnan(own)
        # OpenCL leaves open whether min and max return 0 or -0, which compare equal, so either is right.
        bits = [np.where(v == 0, 0, v.view(np.int32)) for v in (ours, own)] if name in TWO else [ours, own]
        np.testing.assert_array_equal(bits[0][there], bits[1][there], name)


def test_clamp_makes_the_least_of_nans():
    """The result may become an index, so it must not be NaN."""
    a, b = pairs_of(FLOATS)
    (ours,) = values_of(["clamp(a, -2.0f, 5.0f)"], "float", a, b, HEADER)
    np.testing.assert_array_equal(ours, np.where(np.isnan(a), -2, a.clip(-2, 5)))


def test_ints_are_those_of_the_built_ins():
    expressions = ["min(a, b)", "max(a, b)", "min(a, b.s0)", "clamp(a, min(b, 0), max(b, 0))"]
    np.testing.assert_array_equal(*by_both(expressions, "int", *pairs_of(INTS)))


def test_loads_are_those_of_the_built_ins():
    expressions = [
        "(float16)(vload4(i, all_a), vload2(i, all_a), vload2(3, all_a + 1), vload8(i, all_a + 3))",
        "(float16)(vload3(i, all_a), vload3(1, all_a + 1), vload8(0, all_b), vload2(0, all_b))",
    ]
    ours, own = by_both(expressions, "float", *pairs_of(FLOATS))
    assert ours.tobytes() == own.tobytes()


def test_kernels_build_for_processors_without_avx_512(tmp_path: Path):
    """On such processors, clang warns about vector arguments, and warnings are errors."""
    used = current().device.platform
    if "Portable Computing Language" not in used or platform.machine() not in ("x86_64", "AMD64"):
        pytest.skip("needs PoCL, which can build for another processor")
    program = """
from pyibr.opencl.device import current
from pyibr.opencl.program import kernel
kernel("warp/resolve.cl", "resolve", CHANNELS=3, COLOR_BYTES=1, ORIGINS=0)
print(current().device.name)
"""
    variables = {"POCL_KERNELLIB_NAME": "avx2", "PYIBR_CACHE": str(tmp_path), "PYIBR_DEVICE": used}
    done = run_within(100, [sys.executable, "-c", program], **variables)
    assert "haswell" in done.stdout, done.stderr


HOT = {
    "epipolar_sweep", "resolve", "draw_relief", "draw_surface", "draw_object", "draw_mesh", "draw_meshes", "smooth",
    "roughen", "prepare", "behind_lines", "activate",
}  # fmt: skip
"""The kernels that take most of the time of calls."""
LEFT = {"dot", "length", "fast_length", "exp2", "log2", "rint", "isfinite", "clz"}
"""Built-in functions that may stay calls, because they are outside of inner loops."""


LOADED = """
from pathlib import Path
from tools.everything import calls
for call in calls().values():
    call()
    print(Path("/proc/self/maps").read_text())
"""


@pytest.mark.thorough
def test_no_built_in_is_a_call_in_the_kernels_that_take_most_of_the_time():
    """Search all machine code that a process has loaded for calls."""
    used = current().device.platform
    if "Portable Computing Language" not in used or sys.platform != "linux" or shutil.which("objdump") is None:
        pytest.skip("needs PoCL, which keeps the machine code, Linux, which lists loaded files, and objdump")
    done = run_within(600, [sys.executable, "-c", LOADED])
    assert done.returncode == 0, done.stderr
    found: dict[str, set[str]] = {}
    for code in {Path(name) for name in re.findall(r"/.*\.so$", done.stdout, re.MULTILINE)}:
        if code.stem in HOT:
            text = subprocess.run(["objdump", "-d", str(code)], capture_output=True, text=True, check=True).stdout
            mangled = re.findall(r"call.*<_Z(\d+)(\w+)", text)
            found.setdefault(code.stem, set()).update(rest[: int(size)].removeprefix("_cl_") for size, rest in mangled)
    assert found.keys() == HOT
    assert {name: calls - LEFT for name, calls in found.items() if calls - LEFT} == {}
