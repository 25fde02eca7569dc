"""`pyibr batch`: runs a command for thousands of frames or scenes."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer

from pyibr.app.batch import batch as run_batch
from pyibr.app.commands.progress import progress
from pyibr.app.options import print_note, printable_text
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import reading

_SHOWN = 20  # failures that are printed individually


def batch(
    job: Annotated[Path, typer.Argument(metavar="JOB.toml", help="The command, its inputs and its output")],
    scheduler: Annotated[
        str | None, typer.Option(metavar="tcp://...", help="Dask scheduler of a cluster; default: a local one")
    ] = None,
    workers: Annotated[int | None, typer.Option(help="Processes on this machine; default: one a GPU, or one")] = None,
    retries: Annotated[int, typer.Option(help="How often a failed task is repeated")] = 2,
    verify: Annotated[bool, typer.Option("--verify", help="Compare earlier results with their checksums")] = False,
) -> None:
    """Run a command for each set of files that patterns match, in several processes with Dask.

    Results are recorded with checksums, so that an interrupted job resumes. Paths are relative to the current folder.
    """
    read = _read(job)
    with progress() as bar:
        shown = bar.add_task("Running", total=None, visible=False)
        outcome = run_batch(
            read["command"],
            read["inputs"],
            read["output"],
            scheduler=scheduler,
            workers=workers,
            retries=retries,
            verify=verify,
            progress=lambda done, total: bar.update(shown, completed=done, total=total, visible=True),
            told=lambda link: bar.console.print(f"dashboard: {link}"),
        )
    for name, error in list(outcome.failed.items())[:_SHOWN]:
        print_note(f"{printable_text(name)} failed: {printable_text(error)}")
    counts = f"{len(outcome.done)} done, {len(outcome.kept)} kept from earlier runs, {len(outcome.failed)} failed"
    typer.echo(f"{printable_text(read['output'])}: {counts}")
    if outcome.failed:
        raise typer.Exit(1)


def _read(job: Path) -> dict[str, Any]:
    toml: Any = import_module("tomllib" if sys.version_info >= (3, 11) else "tomli")
    with reading(job, "TOML") as source:
        try:
            read = toml.loads(source.read_text("utf-8"))
        except ValueError as error:
            raise FileFormatError(f"{job}: not a TOML file: {error}") from None
    if read.keys() != {"command", "inputs", "output"} or not isinstance(read["inputs"], dict):
        raise ArgumentError("JOB.toml", "command, output and a table of inputs", ", ".join(read) or "none")
    return read
