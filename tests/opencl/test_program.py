"""Programs: where their sources lie, what a failed build says, and binaries that are not what they should be."""

from __future__ import annotations

import json

import pytest

from pyibr.core.errors import ArgumentError, BuildError
from pyibr.opencl import program
from pyibr.opencl.device import current
from pyibr.opencl.launch import launch


def test_a_folder_with_a_space(folder):
    assert program.kernel("lib/nearness.cl", "to_nearness").name == "to_nearness"


def test_a_failed_build_names_file_options_and_log(folder):
    (folder / "lib/nearness.cl").write_text("kernel void to_nearness(global float *a) { a[0] = missing; }")
    with pytest.raises(BuildError, match=r"lib/nearness\.cl failed to build with .*-DLANES=") as raised:
        program.kernel("lib/nearness.cl", "to_nearness")
    assert "missing" in str(raised.value)


@pytest.mark.parametrize("content", ["{}", "[]", "null", "not json", json.dumps({"another": []})])
def test_a_stale_description_is_built_anew(folder, tmp_path, content):
    first = program.kernel("lib/nearness.cl", "to_nearness")
    (described,) = (tmp_path / "cache" / "programs").glob("*.json")
    described.write_text(content)
    current().kernels.clear()
    assert program.kernel("lib/nearness.cl", "to_nearness").arguments == first.arguments


def test_launch_checks_names_and_types(folder):
    kernel = program.kernel("lib/nearness.cl", "to_nearness")
    with pytest.raises(ArgumentError, match=r"to_nearness\(\).*missing .*'far'.*unknown \['fur'\]"):
        launch(kernel, (1,), fur=1.0)
    values: dict[str, float] = {argument.name: 1.0 for argument in kernel.arguments}
    with pytest.raises(ArgumentError, match=r"to_nearness\(depth\): expected a device array of float, got float"):
        launch(kernel, (1,), **values)
