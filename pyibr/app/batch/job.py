"""Tasks from a command and patterns of its inputs."""

from __future__ import annotations

import hashlib
import json
import re
import shlex
import string
from collections.abc import Mapping
from typing import Any, NamedTuple

import pyibr as ibr
from pyibr.core.checks import describe
from pyibr.core.errors import ArgumentError
from pyibr.core.optional import fsspec

_TIMES = ("mtime", "LastModified", "last_modified", "updated", "ETag", "etag", "md5Hash")  # change markers


class Task(NamedTuple):
    """One run of the command."""

    name: str
    inputs: dict[str, str]  # paths or URLs
    key: str  # checksum of the command and of its inputs' paths and change markers
    row: int = 0  # row in the arrays of a Zarr store
    rows: int = 0  # number of rows in these arrays


class Job:
    """One of pyibr's commands, and the inputs to run it for.

    Parameters
    ----------
    command, inputs, output
        As for `pyibr.batch`.
    """

    def __init__(self, command: str, inputs: dict[str, str], output: str) -> None:
        for argument, value in {"command": command, "output": output, **inputs}.items():
            if not isinstance(value, str):  # pyright: ignore[reportUnnecessaryIsInstance]
                raise ArgumentError(argument, "a str", describe(value))
        try:
            self.template = shlex.split(command)
            used = {field for word in self.template for _, field, _, _ in string.Formatter().parse(word) if field}
        except ValueError as error:
            raise ArgumentError("command", f"words with names in braces ({error})", repr(command)) from None
        known = {*inputs, "out", "zarr", "name"}
        if not used <= known or used.isdisjoint(("out", "zarr")):
            expected = f"{{out}} or {{zarr}}, and names of {', '.join(sorted(known))} in braces"
            raise ArgumentError("command", expected, repr(command))
        if not any("*" in url for url in inputs.values()):
            raise ArgumentError("inputs", "a pattern with *", f"{inputs}")
        self.inputs, self.output, self.makes_rows = inputs, output, "zarr" in used

    def tasks(self) -> tuple[list[Task], dict[str, str]]:
        """The tasks in order of their names, and errors by name for names that lack an input."""
        found = {name: _matches(url) for name, url in self.inputs.items()}
        several = {name: urls for name, urls in found.items() if "*" in self.inputs[name]}
        shared = {name: urls[""] for name, urls in found.items() if name not in several}
        tasks, lacking = list[Task](), dict[str, str]()
        for name in sorted({one for urls in several.values() for one in urls}):
            missing = [self.inputs[one] for one, urls in several.items() if name not in urls]
            if missing:
                lacking[name] = f"no file of this name matches {' or '.join(missing)}"
                continue
            own = shared | {one: urls[name] for one, urls in several.items()}
            told = json.dumps([self.template, own, ibr.__version__])
            tasks.append(
                Task(name, {one: url for one, (url, _) in own.items()}, hashlib.sha256(told.encode()).hexdigest())
            )
        if unmatched := [self.inputs[name] for name, urls in several.items() if not urls]:
            raise ArgumentError("inputs", "patterns that match files", f"{' and '.join(unmatched)}, which match none")
        if not tasks:
            first = ", ".join(f"{self.inputs[name]}: {min(urls)}" for name, urls in several.items())
            raise ArgumentError("inputs", "patterns whose * match the same names", first)
        return tasks, lacking


def _matches(url: str) -> dict[str, tuple[str, list[str]]]:
    """Files or folders that match a URL and their change markers, by name ("" without a pattern)."""
    files, path = fsspec().url_to_fs(url)
    whole = re.compile("([^/]*)".join(map(re.escape, path.split("*"))))
    found: Mapping[str, dict[str, Any]] = (
        files.glob(path, detail=True) if "*" in path else {path: _info(files, path, url)}
    )
    matched = [(whole.fullmatch(one.rstrip("/")), one, info) for one, info in found.items()]
    return {
        "_".join(match.groups()): (files.unstrip_protocol(one), [str(info.get(key)) for key in ("size", *_TIMES)])
        for match, one, info in matched
        if match is not None
    }


def _info(files: Any, path: str, url: str) -> dict[str, Any]:
    try:
        return files.info(path)
    except FileNotFoundError:
        raise ArgumentError("inputs", "existing files", url) from None
