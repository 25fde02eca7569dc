"""Rules for kernel files: they compile alone, document their defines, and have no long functions."""

from __future__ import annotations

import itertools
import re
import warnings
from collections import Counter
from pathlib import Path

import pyopencl as cl
import pytest

from pyibr.opencl.device import current
from pyibr.opencl.headers import kernels_folder
from tests.one_lane import skip_where_unused

FOLDER = kernels_folder()
FILES = sorted(path.relative_to(FOLDER).as_posix() for path in FOLDER.glob("*/*"))
LONGEST = 100
CONTRACT = {"Context", "Primitives", "set_up", "cover"}  # raster/fragment.h: each fragment program defines them
DEFAULT = re.compile(r"^#ifndef (\w+)\n#define \1 \S+(.*)\n#endif", re.MULTILINE)
GUARD = re.compile(r"\A#ifndef (\w+)\n#define \1\n")
INCLUDE = re.compile(r'^#include "(.+)"$', re.MULTILINE)


def text_of(file: str) -> str:
    return (FOLDER / file).read_text()


def included_by(file: str) -> set[str]:
    """Names of a file and of all files that it includes, directly or not."""
    found, open_ones = set(), [file]
    while open_ones:
        one = open_ones.pop()
        if one not in found:
            found.add(one)
            open_ones += INCLUDE.findall(text_of(one))
    return found


def function_lengths(file: str) -> dict[str, int]:
    """Number of lines of each function, from its first line to its closing brace."""
    lengths: dict[str, int] = {}
    first = None
    for number, line in enumerate(text_of(file).splitlines()):
        if first is None and re.match(r"(?!typedef)\w[^;]*\(", line):
            first = (line, number)
        elif line == "}":
            assert first is not None, f"{file}:{number + 1} closes nothing"
            lengths[first[0]] = number - first[1] + 1
            first = None
    return lengths


# Other tests build the kernel files. Only this test notices a header that lacks an include. The first header of a file
# stands alone if that file does.
FIRST = re.compile(r'\A(?:\s|/\*.*?\*/|//[^\n]*\n|#ifndef (\w+)\n#define \1\n)*#include "(.+?)"', re.DOTALL)
STARTS = {match.group(2) for match in map(FIRST.match, map(text_of, FILES)) if match}
ALONE = [
    file if file.endswith(".h") else pytest.param(file, marks=pytest.mark.thorough)
    for file in FILES
    if file not in STARTS
]


@pytest.mark.thorough
@pytest.mark.parametrize("lanes", [1, 16])
@pytest.mark.parametrize("file", ALONE)
def test_a_file_compiles_alone_with_the_defaults(file, lanes):
    skip_where_unused(lanes)
    options = ["-I", str(FOLDER), f"-DLANES={lanes}", "-cl-std=CL1.2", "-Werror"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cl.CompilerWarning)
        cl.Program(current().context, f'#include "{file}"\n').build(options, cache_dir=False)


@pytest.mark.parametrize("file", [file for file in FILES if file.endswith(".h")])
def test_a_header_is_guarded_by_its_name(file):
    guard = GUARD.match(text_of(file))
    assert guard is not None
    assert guard.group(1) == re.sub(r"\W", "_", file).upper()


@pytest.mark.parametrize("file", FILES)
def test_a_define_has_one_default_and_a_meaning(file):
    texts = [text_of(one) for one in included_by(file)]
    defaults = [match for text in texts for match in DEFAULT.finditer(text)]
    twice = [name for name, count in Counter(match.group(1) for match in defaults).items() if count > 1]
    assert not twice
    assert [match.group(1) for match in defaults if "/*" not in match.group(2)] == []
    assert not [text for text in texts if re.search(r"^#ifdef (?!__)", text, re.MULTILINE)]  # defined as 0 or 1
    known = {match.group(1) for match in defaults}
    own = set(re.findall(r"^#define (\w+)", "\n".join(texts), re.MULTILINE))
    conditions = " ".join(re.findall(r"^#(?:if|elif) (.*)$", text_of(file), re.MULTILINE))
    asked = set(re.findall(r"\b[A-Z][A-Z_]*\b", conditions))
    assert asked <= known | own | {"__ENDIAN_LITTLE__"}


@pytest.mark.parametrize("file", FILES)
def test_no_function_is_too_long_to_be_read(file):
    assert {name: length for name, length in function_lengths(file).items() if length > LONGEST} == {}


NAMED = re.compile(r"\s*#define (\w+)|\} (\w+);$|(?!typedef|return|else)(?:\w+ )+\*?(\w+)\([^;]*$")


def definitions(text: str) -> list[tuple[str, list[list[int]]]]:
    """List the names that a file defines, except defaults (#ifndef), each with the #if branches around it.

    Macros, structs and functions have names. A branch is a pair: the line of its #if, and its number there.
    """
    code = re.sub(r"/\*.*?\*/", lambda match: re.sub(r"[^\n]", " ", match.group()), text, flags=re.DOTALL)
    found: list[tuple[str, list[list[int]]]] = []
    branches: list[list[int]] = []
    absent: list[str] = []  # for each open condition, the name of its #ifndef
    for number, line in enumerate(GUARD.sub("", code).splitlines()):
        if opens := re.match(r"\s*#(if|ifdef|ifndef) (\w+)", line):
            branches.append([number, 0])
            absent.append(opens.group(2) if opens.group(1) == "ifndef" else "")
        elif re.match(r"\s*#el(se|if)\b", line):
            branches[-1][1] += 1
        elif re.match(r"\s*#endif", line) and branches:  # the last #endif belongs to the guard
            branches.pop()
            absent.pop()
        elif named := NAMED.match(line):
            name = next(filter(None, named.groups()))
            if name not in absent:
                found.append((name, [[*branch] for branch in branches]))
    return found


def exclude(a: list[list[int]], b: list[list[int]]) -> bool:
    """Tell whether two places are in different branches of one #if."""
    return any(one[0] == other[0] and one[1] != other[1] for one, other in zip(a, b, strict=False))


def test_a_name_means_one_thing():
    """No name is defined twice, except in different branches of one #if, or as a setting with a default."""
    settings = {match.group(1) for file in FILES for match in DEFAULT.finditer(text_of(file))}
    places: dict[str, list[tuple[str, list[list[int]]]]] = {}
    for file in FILES:
        for name, branches in definitions(text_of(file)):
            places.setdefault(name, []).append((file, branches))
    assert {"select_lanes", "Taps", "draw_mesh", *CONTRACT} <= {*places} and len(places) > 700
    for name in settings | CONTRACT:
        places.pop(name, None)
    assert [
        (name, one[0], other[0])
        for name, found in places.items()
        for one, other in itertools.combinations(found, 2)
        if one[0] != other[0] or not exclude(one[1], other[1])
    ] == []


def test_every_file_is_a_source():
    assert {Path(file).suffix for file in FILES} == {".cl", ".h"}


ONE_GROUP = "picture/noise.cl"  # launched as a single group, which is never split


@pytest.mark.parametrize("file", [file for file in FILES if file != ONE_GROUP])
def test_a_kernel_knows_nothing_of_the_launch_but_its_place(file):
    """Kernels must not depend on groups: pieces of a launch have other groups, and devices other limits of groups."""
    assert not re.search(
        r"\bget_(?:global_size|local|num_groups|group|work)|\bbarrier\(|^ *(?:__)?local ", text_of(file), re.M
    )
