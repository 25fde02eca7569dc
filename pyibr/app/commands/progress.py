"""The progress of commands: finished work, rate, and remaining time."""

from __future__ import annotations

import threading
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from typing import TypeVar

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

_PATIENCE = 1.0  # seconds

_Thing = TypeVar("_Thing")


class _Rate(ProgressColumn):
    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text("" if speed is None else f"{speed:.3g}/s")


def progress() -> Progress:
    """Progress bars on standard error, with counts, rate and remaining time."""
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), _Rate()
    return Progress(*columns, TimeRemainingColumn(elapsed_when_finished=True), console=Console(stderr=True))


def with_progress(jobs: Iterable[_Thing], count: int, doing: str) -> Iterable[_Thing]:
    """Yield the jobs; show a progress bar if there are several."""
    if count == 1:
        yield from jobs
        return
    with progress() as bars:
        yield from bars.track(jobs, total=count, description=doing)


@contextmanager
def waiting(doing: str) -> Generator[None, None, None]:
    """Show a bar that moves, and the time, if the work within this block takes over a second."""
    columns = TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn()
    bars = Progress(*columns, console=Console(stderr=True), transient=True)
    bars.add_task(doing, total=None)
    timer = threading.Timer(_PATIENCE, bars.start)
    if bars.console.is_terminal:
        timer.start()
    try:
        yield
    finally:
        timer.cancel()
        if bars.console.is_terminal:
            timer.join()
            bars.stop()
