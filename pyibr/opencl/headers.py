"""Declarations read from the kernels' sources, so that the host need not repeat structs and constants."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pyibr.core.checks import describe
from pyibr.core.errors import ArgumentError, BuildError

_CODES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "ulong": "u8"}
SCALARS: dict[str, np.dtype[Any]] = {name: np.dtype(code) for name, code in [*_CODES.items(), ("float", "f4")]}
"""dtypes of numbers by their names in C."""

_INCLUDE = re.compile(r'^\s*#include "([^"]+)"', re.MULTILINE)
_COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)
_DEFINE = re.compile(r"^[ \t]*#[ \t]*define[ \t]+(\w+)[ \t]+(\S.*?)[ \t]*$", re.MULTILINE)
_STRUCT = re.compile(r"typedef\s+struct\b([^{;]*)\{([^{}]*)\}\s*(\w+)\s*;")
_MEMBER = re.compile(r"(\w+)\s*((?:\[[^\]]*\]\s*)*)")
_WHOLE = re.compile(r"([-+]?(?:0[xX][\da-fA-F]+|0|[1-9]\d*))[uUlL]*")
_REAL = re.compile(r"([-+]?(?:\d+\.\d*|\.\d+|\d+(?=[eE]))(?:[eE][-+]?\d+)?)[fF]?")


def kernels_folder() -> Path:
    """Return the folder of the OpenCL sources: inside the installed package, or next to it in a checkout."""
    package = Path(__file__).parent.parent
    installed = package / "kernels"
    return installed if installed.is_dir() else package.parent / "kernels"


def display_name(file: str | Path) -> str:
    """Return the name of a file for messages."""
    return str(file) if isinstance(file, Path) else f"kernels/{file}"


def expanded(file: str | Path) -> str:
    """Return the source with each ``#include "..."`` replaced by the file's text, once per file.

    The cache of binaries identifies a program by this text.

    Parameters
    ----------
    file : str or Path
        Path below the kernels' folder, whose files include each other; or the absolute path of a user's file, which may
        also include files in its own folder.
    """
    kernels = kernels_folder()
    seen: set[Path] = set()

    def text_of(path: Path, folders: list[Path]) -> str:
        if path in seen:
            return ""
        seen.add(path)
        try:
            text = _own_text(path) if folders == [kernels] else path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            raise ArgumentError("file", "a file of text in UTF-8 that can be read", str(path)) from None

        def included(match: re.Match[str]) -> str:
            name = match.group(1)
            for number, folder in enumerate(folders):
                path_of_it = folder / name
                if path_of_it in seen or path_of_it.is_file():
                    inside = text_of(path_of_it, folders[number:])
                    if not isinstance(file, Path):
                        return inside
                    line = text.count("\n", 0, match.end()) + 2  # for line numbers in compiler logs
                    return f'\n#line 1 "{name}"\n{inside}\n#line {line} "{path.name}"'
            places = " or ".join(map(str, folders))
            raise BuildError(f'{path} includes "{name}", which is not in {places}')

        return _INCLUDE.sub(included, text)

    if isinstance(file, Path):
        return f'#line 1 "{file.name}"\n{text_of(file, [file.parent, kernels])}'
    if not (kernels / file).is_file():
        raise ArgumentError("file", f"a file below {kernels}, or the absolute path of your own file", describe(file))
    return text_of(kernels / file, [kernels])


@functools.cache
def _own_text(path: Path) -> str:
    """Text of one of pyibr's kernel files."""
    return path.read_text(encoding="utf-8")


@functools.cache
def struct(file: str, name: str) -> np.dtype[np.void]:
    """Return the dtype of a C struct that ``kernels/<file>`` or its includes define.

    Structs with equal members share one dtype object.

    Raises
    ------
    BuildError
        If there is no such struct, or the host cannot lay it out: see `structs`.
    """
    found = structs(file, _source(file), [name])
    if not found:
        raise BuildError(f"kernels/{file}: no struct {name} is defined")
    return found[name]


@functools.cache
def constant(file: str, name: str) -> int | float:
    """Return the number that ``kernels/<file>`` or its includes ``#define`` under this name.

    Raises
    ------
    BuildError
        If the name is not defined, is defined differently in two places, or is not a single number.
    """
    try:
        return _number_of(_COMMENT.sub(" ", _source(file)), name)
    except ValueError as error:
        raise BuildError(f"kernels/{file}: {error}") from None


def structs(
    file: str | Path, source: str, names: Collection[str], defines: Mapping[str, int] | None = None
) -> dict[str, np.dtype[np.void]]:
    """Return the memory layouts of the structs of a file that are in `names`; `source` is the file's expanded text.

    Members are C numbers and arrays of them. Array sizes are numbers, defined numbers, or products of both.

    Raises
    ------
    BuildError
        If a member has another type, C would insert padding, or the source defines different structs of one name.
    """
    code = _COMMENT.sub(" ", source)
    found: dict[str, np.dtype[np.void]] = {}
    for head, body, name in _STRUCT.findall(code):
        if name in names:
            try:
                made = _layout_of(head, body, code, defines or {})
                if found.setdefault(name, made) != made:
                    raise ValueError("it is defined twice, differently")
            except ValueError as error:
                raise BuildError(f"{display_name(file)}: the host cannot lay out the struct {name}: {error}") from None
    return found


def difference(declared: np.dtype[Any], given: np.dtype[Any]) -> str:
    """Describe how a dtype differs from the declared dtype."""
    if declared.names is None or given.names is None:
        return given.name
    missing, unknown = sorted({*declared.names} - {*given.names}), sorted({*given.names} - {*declared.names})
    if missing or unknown:
        return f"members missing {missing}, unknown {unknown}"
    for expected, name in zip(declared.names, given.names, strict=True):
        if name != expected:
            return f"the member {name} where {expected} belongs"
        if given[name] != declared[name]:
            return f"{_written(name, given[name])!r} instead of {_written(name, declared[name])!r}"
    return f"{given.itemsize} bytes instead of {declared.itemsize}"


def _written(name: str, kind: np.dtype[Any]) -> str:
    """Declaration of a member in C."""
    scalar = next((c for c, known in SCALARS.items() if known == kind.base), kind.base.name)
    return f"{scalar} {name}" + "".join(f"[{size}]" for size in kind.shape)


_source = functools.cache(expanded)


def _number_of(code: str, name: str) -> int | float:
    values = {value for defined, value in _DEFINE.findall(code) if defined == name}
    if len(values) != 1:
        raise ValueError(f"{name} is defined {'as ' + ' and as '.join(sorted(values)) if values else 'nowhere'}")
    (text,) = values
    bare = text[1:-1].strip() if text[0] + text[-1] == "()" else text
    if whole := _WHOLE.fullmatch(bare):
        return int(whole[1], 0)
    if real := _REAL.fullmatch(bare):
        return float(real[1])
    raise ValueError(f"{name} is defined as {text}, which is no number")


def _layout_of(head: str, body: str, code: str, defines: Mapping[str, int]) -> np.dtype[np.void]:
    if "__attribute__" in head:
        raise ValueError("it has attributes")
    members: list[tuple[str, np.dtype[Any], tuple[int, ...]]] = []
    end = 0
    for statement in filter(None, map(str.strip, body.split(";"))):
        kind, *names = re.split(r"\s+", statement, maxsplit=1)
        for declared in ",".join(names).split(","):
            member = _MEMBER.fullmatch(declared.strip())
            if kind not in SCALARS or member is None:
                raise ValueError(f"it holds {' '.join(statement.split())!r}")
            sizes = re.findall(r"\[([^\]]*)\]", member[2])
            members.append((member[1], SCALARS[kind], tuple(_size_of(size, code, defines) for size in sizes)))
            if end % SCALARS[kind].itemsize:
                raise ValueError(f"it has padding before {member[1]}")
            end += SCALARS[kind].itemsize * math.prod(members[-1][2])
    if end % max((kind.itemsize for _, kind, _ in members), default=1):
        raise ValueError("it has padding at its end")
    return _dtype_of(tuple(members))


def _size_of(text: str, code: str, defines: Mapping[str, int]) -> int:
    """Size of an array, a product of numbers. Defines of the build override the source."""
    size = 1
    for factor in map(str.strip, text.split("*")):
        number = int(factor) if factor.isdecimal() else defines.get(factor) or _number_of(code, factor)
        if not isinstance(number, int) or number < 1:
            raise ValueError(f"it has an array of {text}")
        size *= number
    return size


@functools.cache
def _dtype_of(members: tuple[tuple[str, np.dtype[Any], tuple[int, ...]], ...]) -> np.dtype[np.void]:
    return np.dtype(list(members))
