"""Runs commands in this process, and checks their output."""

from __future__ import annotations

from typing import Any

from typer.testing import CliRunner, Result

from pyibr.app.cli import app


def run(
    command: str, *words: object, camera: object = None, scale: object = None, output: object = None, **how: Any
) -> Result:
    """Run a command with words, and with the options that are not empty."""
    options = {"--camera": camera, "--depth-scale": scale, "-o": output}
    given = [part for name, value in options.items() if value for part in (name, value)]
    return CliRunner().invoke(app, [command, *map(str, given), *map(str, words)], **how)


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
