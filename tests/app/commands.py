"""Runs commands in this process, and checks their output."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from typer.testing import CliRunner, Result

from pyibr.app.cli import app


def run(*words: object, **how: Any) -> Result:
    return CliRunner().invoke(app, [str(word) for word in words], **how)


def places(folder: Path, words: Iterable[object]) -> list[str]:
    """Replace words that name files in the folder by the files' paths."""
    return [str(folder / str(word)) if (folder / str(word)).exists() else str(word) for word in words]


def succeeded(result: Result) -> str:
    assert result.exit_code == 0, result.output
    return result.stdout


def assert_refused(result: Result, *words: str) -> None:
    """Assert that a command fails with a message that holds these words, in one line or in a box of several lines."""
    assert result.exit_code == 2 and "Traceback" not in result.stderr, result.output
    assert all(word in result.stderr for word in words), result.stderr


def assert_one_line(result: Result, *words: str, progress: str | None = None) -> None:
    """Assert that a command fails with one line on standard error, at most below a progress bar with this name."""
    assert result.exit_code == 2, result.output
    *above, line = result.stderr.strip().splitlines()
    assert line.startswith("pyibr: "), result.stderr
    assert not above or (progress is not None and all(progress in one for one in above)), result.stderr
    for word in words:
        assert word in line, result.stderr
