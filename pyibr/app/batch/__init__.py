"""Run a command for thousands of frames or scenes with Dask, on this machine or on a cluster (an extra)."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import dataclass, field
from typing import Any

from pyibr.app.batch.job import Job, Task
from pyibr.app.batch.manifest import Manifest
from pyibr.app.batch.work import COMMANDS, numbered, run_task, working_gpus
from pyibr.core.checks import integer_from
from pyibr.core.errors import ArgumentError, DeviceError
from pyibr.core.optional import distributed

__all__ = ["Batch", "batch"]

_WAITING_MIN = 64  # least number of tasks that the scheduler holds
_WAITING_EACH = 8  # tasks held for each worker: none has to wait, and memory does not grow with the number of tasks
_OF_WORKERS = {"distributed.worker.profile.enabled": False}  # profiling costs some milliseconds a frame
_CONNECT_SECONDS = 60.0  # seconds to wait for the scheduler


@dataclass
class Batch:
    """Outcome of a batch.

    Attributes
    ----------
    done : list of str
        Names of the tasks that ran successfully.
    kept : list of str
        Names of the tasks whose results existed from earlier runs.
    failed : dict of str to str
        Errors of the failed tasks, by name.
    """

    done: list[str] = field(default_factory=list[str])
    kept: list[str] = field(default_factory=list[str])
    failed: dict[str, str] = field(default_factory=dict[str, str])


def batch(
    command: str,
    inputs: Mapping[str, str],
    output: str,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    retries: int = 2,
    verify: bool = False,
    progress: Callable[[int, int], object] | None = None,
    told: Callable[[str], object] | None = None,
) -> Batch:
    """Run one of pyibr's commands for each set of files that patterns match, in several processes.

    A manifest beside the results records finished tasks with checksums. Another call runs only tasks that are not
    finished, whose inputs have changed or whose results are missing. Scripts that call this function need
    ``if __name__ == "__main__":``, like all scripts that start processes.

    Parameters
    ----------
    command : str
        As on the command line, without ``pyibr``: ``"warp {color} {depth} --orbit 5 -o {out}/{name}.png"``. Braces
        hold the names of inputs, or ``{out}``, a folder for the results; ``{zarr}``, a folder whose NPY files, such as
        ``{zarr}/depth.npy``, become rows of arrays of the same names in the Zarr store ``frames.zarr``; or ``{name}``,
        the text that matches ``*`` in the patterns.
    inputs : mapping of str to str
        Paths or URLs of files or folders by name, on any file system that fsspec supports. Patterns with ``*`` give
        one task for each match; other inputs are shared by all tasks.
    output : str
        Folder, as path or URL, for the results of all tasks.
    scheduler : str, optional
        Address of a Dask scheduler, as ``"tcp://10.0.0.1:8786"``. By default a scheduler is started on loopback.
    workers : int, optional
        Number of processes to start here, each with one device. By default one for each GPU, or a single one on a CPU.
    retries : int
        How often a failed task is repeated.
    verify : bool
        Whether earlier results are compared by checksum, not only by size.
    progress : callable, optional
        Called with the number of ended tasks and the number of all tasks.
    told : callable, optional
        Called with the address of Dask's dashboard.

    Returns
    -------
    Batch
        Names of the finished, kept and failed tasks.

    Raises
    ------
    ArgumentError
        The command, a pattern or a number is wrong, or nothing matches.
    DeviceError
        The scheduler cannot be reached, or was lost and did not come back.
    MissingPackageError
        The extra `batch` is not installed.

    Examples
    --------
    >>> import pyibr as ibr
    >>> pairs = {"color": "scans/*/color.png", "depth": "scans/*/depth.png"}
    >>> command = "warp {color} {depth} --depth-scale 1000 --orbit 5 -o {out}/{name}.png"
    >>> ibr.batch(command, pairs, "new")  # doctest: +SKIP
    Batch(done=['desk', 'hall'], kept=[], failed={})
    """
    integer_from("retries", retries, 0, 100)
    if workers is not None:
        integer_from("workers", workers, 1, 10_000)
    dask, job = distributed(), Job(command, dict(inputs), output)
    if job.template[0] not in COMMANDS:
        raise ArgumentError("command", f"one of {', '.join(COMMANDS)}", repr(job.template[0]))
    tasks, lacking = job.tasks()
    tasks = numbered(output, tasks) if job.makes_rows else tasks
    manifest, outcome = Manifest(output), Batch(failed=lacking)
    todo: dict[str, Task] = {}
    for task in tasks:
        if manifest.has(task, verify):
            outcome.kept.append(task.name)
        else:
            todo[task.name] = task
    total = len(todo)
    while todo:
        with ExitStack() as stack:
            client = stack.enter_context(_client(dask, scheduler, workers, stack))
            stack.callback(manifest.flush)
            if told is not None:
                told(client.dashboard_link)
            for name, result in _results(dask, client, job, todo, retries):
                if result is None:  # the scheduler was lost
                    continue
                del todo[name]
                if isinstance(result, str):
                    outcome.failed[name] = result
                else:
                    manifest.add(result)
                    outcome.done.append(name)
                if progress is not None:
                    progress(total - len(todo), total)
    manifest.close(outcome.failed)
    return outcome


def _client(dask: Any, scheduler: str | None, workers: int | None, stack: ExitStack) -> AbstractContextManager[Any]:
    """A client of the scheduler, or of a local cluster that ends with the stack."""
    if scheduler is None:
        cluster = dask.LocalCluster(
            n_workers=workers or max(1, len(working_gpus())),
            threads_per_worker=1,
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
            config=_OF_WORKERS,
        )
        scheduler = stack.enter_context(cluster)
    try:
        return dask.Client(scheduler, timeout=_CONNECT_SECONDS)
    except OSError as error:
        raise DeviceError(f"no Dask scheduler answers at {scheduler}: {error}") from error


def _results(dask: Any, client: Any, job: Job, tasks: Mapping[str, Task], retries: int) -> Any:
    """Yield each task's name with its manifest entry, its error, or None if the scheduler was lost."""
    waiting, names = iter(list(tasks.values())), dict[str, str]()
    is_lost = False

    def submit() -> list[Any]:
        task = None if is_lost else next(waiting, None)
        if task is None:
            return []
        future = client.submit(run_task, job.template, job.output, task, retries=retries, pure=False)
        names[future.key] = task.name
        return [future]

    most = max(_WAITING_MIN, _WAITING_EACH * len(client.nthreads()))
    # With `with_results`, this would wait forever for a result that was lost together with the scheduler.
    running = dask.as_completed([one for _ in range(most) for one in submit()], raise_errors=False)
    for future in running:
        name, result = names.pop(future.key), None
        if future.status == "error":
            error = future.exception()
            result = f"{error or type(error).__name__}"
        elif future.status == "finished":
            with suppress(OSError, dask.CancelledError):
                result = future.result()
        is_lost |= result is None
        yield name, result
        for further in submit():
            running.add(further)
