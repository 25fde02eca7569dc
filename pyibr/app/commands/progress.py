"""The progress of commands: finished work, rate, and remaining time."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

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
