"""Functions as commands: their groups of options, and their report of written files."""

from __future__ import annotations

import functools
import json
import time
from collections.abc import Callable, Generator, Sequence
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
    """Return the command in the form that typer takes: named tuples of options become single options.

    Commands with a required output get --json, too.
    """
    parameters, groups, known = list[Parameter](), dict[str, Any](), signature(command, eval_str=True).parameters
    for own in known.values():
        fields = getattr(own.annotation, "_field_defaults", None)
        if fields is None:
            parameters.append(own.replace(kind=Parameter.KEYWORD_ONLY))
        else:
            groups[own.name], hints = own.annotation, get_type_hints(own.annotation, include_extras=True)
            single = [(name, hints[name], default) for name, default in fields.items()]
            parameters += [Parameter(n, Parameter.KEYWORD_ONLY, default=d, annotation=kind) for n, kind, d in single]

    tells = "output" in known and known["output"].default is Parameter.empty
    if tells:
        parameters.append(Parameter("as_json", Parameter.KEYWORD_ONLY, default=False, annotation=_Json))

    @functools.wraps(command)
    def called(**given: Any) -> None:
        as_json = tells and given.pop("as_json", False)
        made = {name: group(*(given.pop(field) for field in group._fields)) for name, group in groups.items()}
        with _reporting(as_json):
            command(**given, **made)

    called.__signature__ = Signature(parameters)  # pyright: ignore[reportAttributeAccessIssue]
    called.__annotations__ = {one.name: one.annotation for one in parameters}
    return called
