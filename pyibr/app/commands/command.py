"""Functions as commands: their groups of options, and their report of written files."""

from __future__ import annotations

import functools
import json
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from pyibr.app.options import printable_text

EMPTY = 3
"""Exit status of a command whose written pictures are all empty."""

_Json = Annotated[
    bool, typer.Option("--json", help="Report the output as JSON: files, frames, size, covered, triangles, seconds")
]

_report: ContextVar[dict[str, Any] | None] = ContextVar("report", default=None)


def tell_written(
    files: Sequence[Path],
    words: str,
    *,
    frames: int | None = None,
    size: tuple[int, int] | None = None,
    covered: float | None = None,
    triangles: int | None = None,
) -> None:
    """Report the files that a command has written; exit with status EMPTY if they are empty.

    Parameters
    ----------
    files : sequence of Path
        At least one.
    words : str
        Their content, for people.
    frames, size, covered, triangles
        Their content, for programs, where it applies: number of pictures, (width, height) of the pictures, fraction of
        the pixels that show something, and number of a mesh's triangles.
    """
    report = _report.get()
    if report is None:
        names = " to ".join(dict.fromkeys(printable_text(file) for file in (files[0], files[-1])))
        typer.echo(f"{names}: {words}")
    else:
        report["written"] = [str(file) for file in files]
        report |= {"frames": frames, "size": size, "covered": covered, "triangles": triangles}
    if covered == 0:
        raise typer.Exit(EMPTY)


@contextmanager
def _reporting(as_json: bool) -> Generator[None, None, None]:
    """Context that collects reports of files into one JSON object, printed at the end; else prints them immediately."""
    start, report = time.monotonic(), dict[str, Any]()
    token = _report.set(report if as_json else None)
    try:
        yield
    finally:
        _report.reset(token)
        if report:
            typer.echo(json.dumps({**report, "seconds": round(time.monotonic() - start, 3)}))


def expanded(command: Callable[..., None]) -> Callable[..., None]:
    """Return the command in the form that typer takes: named tuples of options become single options, also
    inside of other named tuples.

    Commands with a required output get --json, too.
    """
    known = signature(command, eval_str=True).parameters
    parameters = [one for own in known.values() for one in _options_of(own.name, own.annotation, own.default)]
    tells = "output" in known and known["output"].default is Parameter.empty
    if tells:
        parameters.append(Parameter("as_json", Parameter.KEYWORD_ONLY, default=False, annotation=_Json))

    @functools.wraps(command)
    def called(**given: Any) -> None:
        with _reporting(tells and given.get("as_json", False)):
            command(**{own.name: _value_of(own.name, own.annotation, given) for own in known.values()})

    called.__signature__ = Signature(parameters)  # pyright: ignore[reportAttributeAccessIssue]
    called.__annotations__ = {one.name: one.annotation for one in parameters}
    return called


def _options_of(name: str, kind: Any, default: object) -> list[Parameter]:
    """The parameter of an option, or the parameters of a group of options."""
    if not hasattr(kind, "_field_defaults"):
        return [Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=kind)]
    hints = get_type_hints(kind, include_extras=True)
    return [one for field, value in kind._field_defaults.items() for one in _options_of(field, hints[field], value)]


def _value_of(name: str, kind: Any, given: Mapping[str, Any]) -> Any:
    """The value of an option, or the group of the values of its options."""
    if not hasattr(kind, "_field_defaults"):
        return given[name]
    hints = get_type_hints(kind, include_extras=True)
    return kind(*(_value_of(field, hints[field], given) for field in kind._fields))
