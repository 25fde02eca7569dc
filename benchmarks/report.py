"""``python -m benchmarks.report DIR``: tables and plots, from the JSON files in DIR alone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchmarks.results import Result
from benchmarks.sections import SECTIONS
from benchmarks.tables import origin, skipped

FILE = "report.md"
HEAD = """# Benchmarks

`python -m benchmarks` measures, and `python -m benchmarks.report` made this page from the JSON files beside it.
Times are medians, with quartiles in brackets. Subjects run once before they are timed, except slow searches.
"""


def write(folder: Path) -> Path:
    """Write the report of all results in ``folder``, and return its path.

    Raises
    ------
    FileNotFoundError
        If the folder has no results.
    ValueError
        If a file is not a result.
    """
    results = [Result.load(folder / f"{name}.json") for name in SECTIONS if (folder / f"{name}.json").exists()]
    if not results:
        raise FileNotFoundError(f"{folder}: none of {', '.join(f'{name}.json' for name in SECTIONS)} is here")
    parts = [HEAD]
    for result in results:
        parts += [
            *SECTIONS[result.benchmark](result, folder),
            *skipped(result.skipped),
            origin(result.environment),
        ]
    path = folder / FILE
    path.write_text("\n".join(part for part in parts if part))
    return path


def main(
    folder: Annotated[Path, typer.Argument(help="Folder of the JSON files; the report is written there, too.")],
) -> None:
    """Make tables and plots of measured results."""
    print(f"written: {write(folder)}")


if __name__ == "__main__":
    typer.run(main)
