"""Programs: sources, errors of failed builds, and damaged binaries in the cache."""

from __future__ import annotations

import logging
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pyibr.app.cli import telling
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError, BuildError
from pyibr.opencl import program
from pyibr.opencl.device import current
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import empty
from pyibr.opencl.runtimes import found_devices, runtime_of
from pyibr.picture.target import Target

CAMERA = Camera([[9, 0, 3], [0, 9, 2], [0, 0, 1]], (7, 5))


def test_a_folder_with_a_space(folder):
    assert program.kernel("picture/nearness.cl", "to_nearness").name == "to_nearness"


def test_a_failed_build_names_file_options_and_log(folder):
    (folder / "picture/nearness.cl").write_text("kernel void to_nearness(global float *a) { a[0] = missing; }")
    with pytest.raises(BuildError, match=r"picture/nearness\.cl failed to build with .*-DLANES=") as raised:
        program.kernel("picture/nearness.cl", "to_nearness")
    assert "missing" in str(raised.value)


@pytest.mark.parametrize("binary", [b"", b"not a program", b"\x7fELF"])
def test_what_the_runtime_does_not_take_is_built_anew(folder, binaries, monkeypatch, binary):
    first = program.kernel("picture/nearness.cl", "to_nearness")
    load = program._load
    signatures = b'{"to_nearness": []}\n'
    monkeypatch.setattr(program, "_load", lambda session, kept: load(session, signatures + binary))
    current().kernels.clear()
    assert program.kernel("picture/nearness.cl", "to_nearness").arguments == first.arguments


def test_launch_checks_names_and_types(folder):
    kernel = program.kernel("picture/nearness.cl", "to_nearness")
    with pytest.raises(ArgumentError, match=r"to_nearness\(\).*missing .*'far'.*unknown \['fur'\]"):
        launch(kernel, (1,), fur=1.0)
    values: dict[str, float] = {argument.name: 1.0 for argument in kernel.arguments}
    with pytest.raises(ArgumentError, match=r"to_nearness\(depth\): expected a device array of float, got float"):
        launch(kernel, (1,), **values)


def test_kernels_of_the_cache_compute_as_fresh_ones_do(folder, binaries):
    """Binaries do not store the option that sets denormals to zero."""
    (folder / "picture/nearness.cl").write_text(
        "kernel void halve(global float *a, float b) { a[0] = b * 0.5f; a[1] = a[0] * 4.0f; }"
    )
    found = []
    for _ in ("fresh", "cached"):
        current().kernels.clear()
        made = empty((2,), np.float32)
        launch(program.kernel("picture/nearness.cl", "halve"), (1,), a=made, b=float(np.finfo(np.float32).tiny))
        found.append(made.to_host().tolist())
    assert found[0] == found[1]


OWN = """
#include "lib/screen.h" /* pyibr's, which includes lib/lanes.h */

#include "size.h" // its own
kernel void write(global int *out, Screen screen) { out[0] = SIZE + VALUE; }
"""


@pytest.fixture
def own(tmp_path: Path, own_cache: Path, binaries: None) -> Path:
    """A user's kernel with a header in the same folder."""
    file = tmp_path / "a b" / "own.cl"
    file.parent.mkdir()
    file.write_text(OWN)
    (file.parent / "size.h").write_text("#define SIZE 7\n")
    return file


def written_by(file: Path | str, value: int = 0) -> int:
    """Launch the kernel `write`; returns the value that it writes."""
    kernel, out = program.kernel(file, "write", VALUE=value), empty((1,), np.int32)
    more = {} if len(kernel.arguments) == 1 else {"screen": Struct("Screen", Target(CAMERA, np.dtype("u1")).screen(1))}
    launch(kernel, (1,), out=out, **more)
    return int(out.to_host()[0])


def test_a_users_file_includes_its_own_headers_and_pyibrs(own, monkeypatch):
    assert written_by(own) == written_by(str(own)) == 7
    assert written_by(own, value=3) == 10
    assert program.kernel(own, "write", VALUE=0) is program.kernel(str(own), "write", VALUE=0)
    monkeypatch.chdir(own.parent)
    assert program.kernel(Path("own.cl"), "write", VALUE=0) is program.kernel(own, "write", VALUE=0)


def test_a_users_headers_come_before_pyibrs_but_not_in_pyibrs_files(own):
    (own.parent / "lib").mkdir()
    (own.parent / "lib/lanes.h").write_text("#error this is not for lib/screen.h\n")
    assert written_by(own) == 7
    (own.parent / "lib/screen.h").write_text("#define SHADED 20\n")
    own.write_text('#include "lib/screen.h"\nkernel void write(global int *out) { out[0] = SHADED + VALUE; }')
    os.utime(own, ns=(1, 1))
    assert written_by(own) == 20


def test_a_users_file_that_changed_is_built_anew(own):
    assert written_by(own) == 7
    own.write_text("kernel void write(global int *out) { out[0] = 100; }")
    os.utime(own, ns=(2, 2))
    assert written_by(own) == 100


def test_a_log_names_lines_of_the_users_file(own):
    own.write_text(OWN.replace("SIZE +", "missing +"))
    with pytest.raises(BuildError, match=f"^{own} failed to build with .*-DVALUE=1") as raised:
        program.kernel(own, "write", VALUE=1)
    assert "own.cl:5" in str(raised.value)
    (own.parent / "size.h").write_text("\n#define SIZE 7\nint f() { return missing; }\n")
    own.write_text(OWN)
    with pytest.raises(BuildError) as raised:
        program.kernel(own, "write", VALUE=1)
    assert "size.h:3" in str(raised.value)


def test_a_file_is_built_once_for_all_its_kernels(own_cache: Path, monkeypatch: pytest.MonkeyPatch):
    current().kernels.clear()
    built: list[object] = []
    compiled = program._compiled
    monkeypatch.setattr(program, "_compiled", lambda *given: built.append(given) or compiled(*given))
    for name in ("clear", "clear_uints", "to_nearness", "to_bridged_nearness"):
        assert program.kernel("picture/begin.cl", name).name == name
    assert len(built) == 1
    made = empty((4,), np.uint32)
    launch(program.kernel("picture/begin.cl", "clear_uints"), (1,), values=made, count=4, share=4, value=7)
    assert made.to_host().tolist() == [7] * 4


def test_binaries_that_take_long_are_kept_on_request(own_cache: Path):
    def kept() -> int:
        current().kernels.clear()
        program.kernel("lib/clear.cl", "clear")
        return len(list(own_cache.glob("programs/*")))

    assert kept() == (not runtime_of(found_devices()[current().device.index]).compiles_for_binaries)
    with program.keeping_binaries():
        assert kept() == 1


def test_users_are_told_once_that_kernels_are_built(caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch):
    def build(seconds: float) -> None:
        times = iter((0.0, seconds))
        monkeypatch.setattr(program, "time", SimpleNamespace(perf_counter=lambda: next(times)))
        with program._told("warp/resolve.cl"):
            pass

    monkeypatch.setattr(program, "_spent", 0.0)
    said: list[str] = []
    with caplog.at_level(logging.INFO, logger="pyibr"), telling(said.append):
        build(program._LONG / 2)
        assert not said
        build(program._LONG)
        build(program._LONG)
    assert said == [record.getMessage() for record in caplog.records] and len(said) == 1
    assert "doctor --build" in said[0]
    program._spent = 0.0
    build(9.0)
    assert len(said) == 1, "no messages after the end of the block"


def test_what_is_not_there_is_said_in_one_sentence(own):
    with pytest.raises(ArgumentError, match=r"^file: expected a file of kernels, got .*none\.cl: No such file"):
        program.kernel(own.with_name("none.cl"), "write")
    with pytest.raises(ArgumentError, match=r"^file: expected a file below .*kernels, or the absolute .* 'own.cl'$"):
        program.kernel("own.cl", "write")
    with pytest.raises(ArgumentError, match=r"^name: expected a kernel of .*own\.cl: write, got 'wrote'$"):
        program.kernel(own, "wrote", VALUE=0)
    with pytest.raises(ArgumentError, match=r"^file: expected a file of kernels, got .*: embedded null "):
        program.kernel(own.with_name("a\0b.cl"), "write")
    own.write_text('#include "lib/sreen.h"\nkernel void write(global int *out) {}')
    with pytest.raises(BuildError, match=r'own\.cl includes "lib/sreen\.h", which is not in .*a b or .*kernels$'):
        program.kernel(own, "write")
