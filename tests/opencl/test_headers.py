"""The host reads structs and constants from the kernels' sources, and checks the arguments of launches by them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from pyibr.core.errors import ArgumentError, BuildError
from pyibr.images import PixelClass
from pyibr.opencl.device import current
from pyibr.opencl.headers import SCALARS, constant, expanded, kernels_folder, struct, structs
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import empty, upload
from pyibr.opencl.program import Kernel, kernel

FILES = sorted(str(path.relative_to(kernels_folder())) for path in kernels_folder().glob("*/*.*"))

PARTS = """/* typedef struct { int not_this; } Parts; */
#ifndef PARTS_H
#define PARTS_H
#include "lib/light.h"
#define TWO 2 // and no more
#define FOUR 4
typedef struct Tagged {
    int first, second[3]; /* one; and
        three */
    float rows[5][FOUR]; // of a matrix
    float maps[FOUR * TWO * 3],
          last;
    uchar four_bytes[4];
    short a, b;
} Parts;
#endif
"""
PARTS_MEMBERS = [
    ("first", np.int32),
    ("second", np.int32, 3),
    ("rows", np.float32, (5, 4)),
    ("maps", np.float32, 24),
    ("last", np.float32),
    ("four_bytes", np.uint8, 4),
    ("a", np.int16),
    ("b", np.int16),
]

THING = """typedef struct {
    int first;
    float values[3];
    uint last;
} Thing;
typedef struct {
    int first;
    float values[3];
    uint last;
} Other;

kernel void take(Thing one, global const Thing *many, global float *sums)
{
    const int i = get_global_id(0);
    sums[i] = one.first + one.values[1] + many[i].values[2] + many[i].last;
}
"""
FIRST, VALUES, LAST = ("first", np.int32), ("values", np.float32, 3), ("last", np.uint32)
APART = {"names": ["first", "values", "last"], "formats": ["i4", "3f4", "u4"], "offsets": [0, 4, 20]}


def test_a_struct_is_read_as_c_lays_it_out(folder):
    (folder / "parts.h").write_text(PARTS)
    assert struct("parts.h", "Parts") == np.dtype(PARTS_MEMBERS)
    assert struct("parts.h", "Light") is struct("lib/light.h", "Light")


@pytest.mark.parametrize(
    ("body", "wrong"),
    [
        ("floatl x;", "holds 'floatl x'"),
        ("float3 x;", "holds 'float3 x'"),
        ("global const float *x;", "holds 'global const float"),
        ("float *x;", "holds 'float"),
        ("unsigned int x;", "holds 'unsigned int x'"),
        ("int x : 3;", "holds 'int x : 3'"),
        ("int;", "holds 'int'"),
        ("int x;\n#ifdef LIT\nfloat y;\n#endif", "holds '#ifdef LIT float y'"),
        ("uchar x; int y;", "padding before y"),
        ("int x; ulong y;", "padding before y"),
        ("int x; uchar y;", "padding at its end"),
        ("int x[SOME];", "SOME is defined nowhere"),
        ("int x[SIDE];", "SIDE is defined as 1 and as 4"),
        ("int x[SIZE];", "SIZE is defined as \\(1 [+] 2\\), which is no number"),
        ("int x[0];", "an array of 0"),
        ("int x[HALF];", "an array of HALF"),
        ("int x[-1];", "nowhere"),
    ],
)
def test_what_the_host_cannot_lay_out_is_refused(folder, body, wrong):
    defines = "#ifdef A\n#define SIDE 4\n#else\n#define SIDE 1\n#endif\n#define SIZE (1 + 2)\n#define HALF 0.5f\n"
    (folder / "wrong.h").write_text(f"{defines}typedef struct {{\n{body}\n}} Wrong;\n")
    with pytest.raises(BuildError, match=rf"^kernels/wrong\.h: the host cannot lay out the struct Wrong: .*{wrong}"):
        struct("wrong.h", "Wrong")


def test_structs_that_are_not_one_are_refused(folder):
    (folder / "two.h").write_text(
        "typedef struct { int a; } Two;\ntypedef struct { int b; } Two;\n"
        "typedef struct { int a; } Same;\ntypedef struct { int a; } Same;\n"
        "typedef struct __attribute__((packed)) { uchar a; int b; } Packed;\n"
    )
    assert struct("two.h", "Same").names == ("a",)
    for name, wrong in (("Two", "defined twice"), ("Packed", "attributes"), ("None", "no struct None")):
        with pytest.raises(BuildError, match=rf"kernels/two\.h: .*{wrong}"):
            struct("two.h", name)


NUMBERS = {"3": 3, "-1 /* less */": -1, "(-2)": -2, "0x1Fu": 31, "0": 0}
NUMBERS |= {"-3e38f // nothing": -3e38, "1e-3f": 1e-3, "( 12.0f )": 12.0, ".5": 0.5, "2.": 2.0}


@pytest.mark.parametrize(("text", "value"), NUMBERS.items())
def test_a_constant_is_what_is_written(folder, text, value):
    (folder / "c.h").write_text(f"#define OTHER 7\n#define C_OF(x) 8\n  # define  C  {text}\n#define CC 9\n")
    found = constant("c.h", "C")
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("", "C is defined nowhere"),
        ("#define C", "C is defined nowhere"),
        ("#define C(x) 1", "C is defined nowhere"),
        ("/* #define C 1 */", "C is defined nowhere"),
        ("#define C 1\n#define C 2", "C is defined as 1 and as 2"),
        ("#define C OTHER", "C is defined as OTHER, which is no number"),
        ("#define C 010", "C is defined as 010, which is no number"),
        ("#define C 1 + 1", "which is no number"),
    ],
)
def test_what_is_no_constant_is_refused(folder, text, wrong):
    (folder / "c.h").write_text(f"{text}\n")
    with pytest.raises(BuildError, match=rf"^kernels/c\.h: .*{re.escape(wrong)}"):
        constant("c.h", "C")


def _structs_of(file: str) -> list[str]:
    return re.findall(r"^} (\w+);", (kernels_folder() / file).read_text(), re.MULTILINE)


def _readable(file: str) -> list[str]:
    """List the structs of a file that the host can fill, because they contain only numbers."""
    found: list[str] = []
    for name in _structs_of(file):
        try:
            struct(file, name)
        except BuildError as error:
            assert re.search(
                rf"struct {name}: (it (has attributes|holds '(\w+l|\w+\d|[A-Z]\w+|global|const|#if).*')"
                "|STRIP is defined as 1 and as 32)$",
                str(error),
            )
        else:
            found.append(name)
    return found


@pytest.mark.parametrize("file", [file for file in FILES if _structs_of(file)])
def test_every_struct_is_read_or_is_of_the_kernels_alone(file):
    arguments = " ".join(re.findall(r"kernel void \w+\((.*?)\)\s*\{", _whole(file), re.DOTALL))
    needed = {name for name in _structs_of(file) if re.search(rf"\b{name}\b", arguments)}
    assert needed <= {*_readable(file)}


def _whole(file: str) -> str:
    folder = kernels_folder()
    texts = [path.read_text() for path in folder.glob("*/*.*")]
    return "\n".join(texts) if file.endswith(".h") else (folder / file).read_text()


@pytest.mark.thorough
@pytest.mark.parametrize("file", [file for file in FILES if _readable(file)])
def test_every_struct_lies_as_the_compiler_lays_it(folder, file):
    kinds = structs(file, expanded(file), _readable(file), {"LANES": current().profile.lanes})
    texts, expected = list[str](), list[int]()
    for name, kind in kinds.items():
        texts += [f"sizeof({name})", *(f"(int)(uintptr_t)&(({name} *)0)->{member}" for member in kind.names)]
        expected += [kind.itemsize, *(kind.fields[member][1] for member in kind.names)]
    lines = [f"found[{i}] = {text};" for i, text in enumerate(texts)]
    text = f'#include "{file}"\nkernel void lay(global int *found)\n{{\n' + "\n".join(lines) + "\n}\n"
    (folder / "lay.cl").write_text(text)
    found = empty((len(lines),), np.int32)
    launch(kernel("lay.cl", "lay"), (1,), found=found)
    assert found.to_host().tolist() == expected


@pytest.fixture
def take(folder: Path, binaries: None) -> Kernel:
    (folder / "take.cl").write_text(THING)
    return kernel("take.cl", "take")


def test_a_launch_takes_the_struct_that_is_declared(take):
    kind = struct("take.cl", "Thing")
    assert [argument.dtype is kind for argument in take.arguments] == [True, True, False]
    sums = empty((2,), np.float32)
    many = np.array([(0, (1, 2, 3), 4), (5, (6, 7, 8), 9)], kind)
    launch(take, (2,), one=Struct("Thing", np.array((10, (20, 30, 40), 50), kind)), many=upload(many), sums=sums)
    assert sums.to_host().tolist() == [47, 57]
    alike = np.dtype([FIRST, VALUES, LAST])  # an equal dtype, but another object
    launch(take, (2,), one=Struct("Thing", np.zeros((), alike)), many=upload(many.astype(alike)), sums=sums)
    assert sums.to_host().tolist() == [7, 17]


@pytest.mark.parametrize("from_disk", [False, True])
@pytest.mark.parametrize(
    ("members", "wrong"),
    [
        ([FIRST, VALUES], "members missing ['last'], unknown []"),
        ([FIRST, VALUES, ("final", np.uint32)], "members missing ['last'], unknown ['final']"),
        ([FIRST, VALUES, LAST, ("more", np.int32)], "members missing [], unknown ['more']"),
        ([VALUES, FIRST, LAST], "the member values where first belongs"),
        ([FIRST, VALUES, ("last", np.int32)], "'int last' instead of 'uint last'"),
        ([FIRST, ("values", np.float64, 3), LAST], "'float64 values[3]' instead of 'float values[3]'"),
        ([FIRST, ("values", np.float32, 4), LAST], "'float values[4]' instead of 'float values[3]'"),
        ([FIRST, ("values", np.float32), LAST], "'float values' instead of 'float values[3]'"),
        (APART, "24 bytes instead of 20"),
    ],
)
def test_a_launch_refuses_what_lies_otherwise(take, members, wrong, from_disk):
    if from_disk:
        current().kernels.clear()
        take = kernel("take.cl", "take")
    kind, other = struct("take.cl", "Thing"), np.dtype(members)
    good = {"one": Struct("Thing", np.zeros((), kind)), "many": upload(np.zeros(2, kind)), "sums": empty((2,), "f4")}
    for name, bad, expected in (
        ("one", Struct("Thing", np.zeros((), other)), "a Thing"),
        ("many", upload(np.zeros(2, other)), "a device array of Thing"),
    ):
        with pytest.raises(ArgumentError) as raised:
            launch(take, (2,), **{**good, name: bad})
        assert str(raised.value) == f"take({name}): expected {expected}, got {wrong}"


def test_a_launch_refuses_other_structs_and_numbers(take):
    kind = struct("take.cl", "Thing")
    good = {"one": Struct("Thing", np.zeros((), kind)), "many": upload(np.zeros(2, kind)), "sums": empty((2,), "f4")}
    for name, bad, wrong in (
        ("one", Struct("Other", np.zeros((), kind)), "a Thing, got a Other"),
        ("one", 1.0, "a Thing, got float"),
        ("many", empty((2,), np.float32), "a device array of Thing, got float32"),
        ("many", Struct("Thing", np.zeros((), kind)), "a device array of Thing, got Struct"),
        ("sums", upload(np.zeros(2, kind)), "a device array of float, got void160"),
        ("sums", empty((2,), np.float64), "a device array of float, got float64"),
        ("sums", upload(np.zeros(2, "f4")), "a writable device array, got a read-only one from `upload`"),
    ):
        with pytest.raises(ArgumentError, match=re.escape(f"take({name}): expected {wrong}")):
            launch(take, (2,), **{**good, name: bad})


def test_pointers_to_what_the_host_does_not_know_take_nothing(folder):
    (folder / "wide.cl").write_text("kernel void wide(global float4 *x) { x[0] = 1.0f; }")
    for kind in (np.float32, np.float64):
        with pytest.raises(ArgumentError, match=r"wide\(x\): expected a device array of float4, got float"):
            launch(kernel("wide.cl", "wide"), (1,), x=empty((4,), kind))


def test_sizes_may_be_defined_by_a_build(folder):
    (folder / "sized.cl").write_text(
        "#ifndef COUNT\n#define COUNT 2\n#endif\ntypedef struct { int values[COUNT]; } Sized;\n"
        "kernel void sized(Sized s, global int *x) { x[0] = s.values[COUNT - 1]; }\n"
    )
    two = struct("sized.cl", "Sized")
    assert two["values"].shape == (2,)
    given = {"s": Struct("Sized", np.array(((3, 4),), two)), "x": empty((1,), np.int32)}
    launch(kernel("sized.cl", "sized"), (1,), **given)
    assert given["x"].to_host().tolist() == [4]
    with pytest.raises(ArgumentError, match=r"'int values\[2\]' instead of 'int values\[3\]'"):
        launch(kernel("sized.cl", "sized", COUNT=3), (1,), **given)


def test_scalars_are_as_wide_as_in_c(folder):
    sizes = ", ".join(f"sizeof({name})" for name in SCALARS)
    (folder / "sizes.cl").write_text(
        f"kernel void sizes(global int *x) {{ const int all[] = {{{sizes}}}, i = get_global_id(0); x[i] = all[i]; }}"
    )
    found = empty((len(SCALARS),), np.int32)
    launch(kernel("sizes.cl", "sizes"), found.shape, x=found)
    assert found.to_host().tolist() == [kind.itemsize for kind in SCALARS.values()]


def test_public_classes_are_the_kernels():
    for one in PixelClass:
        assert constant("warp/classes.h", f"CLASS_{one.name}") == one
