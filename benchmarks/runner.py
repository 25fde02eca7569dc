"""Runs the cases of a benchmark: in each, times the subjects in turns, then makes the other measurements."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from benchmarks.environment import environment
from benchmarks.results import Parameter, Record, Result, Skip

Subject = Callable[[], object]


@dataclass(frozen=True)
class Work:
    """A prepared case.

    Attributes
    ----------
    timed : dict
        Subjects that run in turns (A B C A B C ...).
    repeats : int
        Number of turns.
    read : callable, optional
        Makes other measurements, after the turns.
    warm : bool
        Whether to run each subject once before, without timing it.
    """

    timed: dict[str, Subject] = field(default_factory=dict[str, Subject])
    repeats: int = 1
    read: Callable[[], Iterable[Record]] | None = None
    warm: bool = True


@dataclass(frozen=True)
class Case:
    """Parameters of a case, as in the results, and the function that prepares its work when its turn comes."""

    parameters: dict[str, Parameter]
    prepare: Callable[[], Work | Skip]


def run(benchmark: str, cases: Iterable[Case]) -> Result:
    """Runs all cases of a benchmark with a progress bar."""
    start = time.perf_counter()
    todo = list(cases)
    result = Result(benchmark, environment())
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    with Progress(*columns) as progress:
        task = progress.add_task(benchmark, total=len(todo))
        for case in todo:
            shown = " ".join(str(value) for value in case.parameters.values())
            progress.update(task, description=f"{benchmark} {shown}")
            work = case.prepare()
            if isinstance(work, Skip):
                if work not in result.skipped:
                    result.skipped.append(work)
            else:
                result.records += run_case(case.parameters, work)
            del work
            progress.advance(task)
        progress.update(task, description=benchmark)
    result.environment["seconds"] = round(time.perf_counter() - start)
    return result


def run_case(parameters: dict[str, Parameter], work: Work) -> list[Record]:
    """Run one case, and return its records."""
    times = in_turns(work.timed, work.repeats, work.warm)
    records = [Record(name, "end to end", "ms", parameters, values) for name, values in times.items()]
    return records + list(work.read() if work.read else [])


def in_turns(subjects: dict[str, Subject], repeats: int, warm: bool = True) -> dict[str, list[float]]:
    """Time each subject once in each turn, in milliseconds; freeing a result is not timed."""
    for subject in subjects.values() if warm else ():
        subject()
    times: dict[str, list[float]] = {name: [] for name in subjects}
    gc.collect()
    gc.disable()
    try:
        for _ in range(repeats):
            for name, subject in subjects.items():
                start = time.perf_counter()
                made = subject()
                times[name].append(1e3 * (time.perf_counter() - start))
                del made
    finally:
        gc.enable()
    return times
