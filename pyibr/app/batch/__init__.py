"""A command over thousands of frames or scenes, by Dask: on this machine's cores, or on a cluster (an extra)."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import dataclass, field
from typing import Any

from pyibr.app.batch.job import Job, Task
from pyibr.app.batch.manifest import Manifest
from pyibr.app.batch.rows import numbered
from pyibr.app.batch.work import COMMANDS, run_task, working_gpus
from pyibr.core.checks import integer_from
from pyibr.core.errors import ArgumentError, DeviceError
from pyibr.core.optional import distributed

__all__ = ["Batch", "batch"]

_WAITING_MIN = 64  # tasks that the scheduler holds at least,
_WAITING_EACH = 8  # and for each worker: enough that none waits for one, few enough for any number of tasks
_OF_WORKERS = {"distributed.worker.profile.enabled": False}  # it takes some milliseconds a frame
_CONNECT_SECONDS = 60.0  # seconds that a scheduler may be away


@dataclass
class Batch:
    """Outcome of a batch.

    Attributes
    ----------
    done : list of str
        Names of the tasks that were run.
    kept : list of str
        Those whose results were there from before.
    failed : dict of str to str
        Those that failed, and why.
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

    What was done is noted beside the results, with checksums: called again, it does what is missing, whose inputs have
    changed or whose results are gone. Scripts that call this need ``if __name__ == "__main__":``, as all do that start
    processes.

    Parameters
    ----------
    command : str
        As on the command line, without ``pyibr``: ``"warp {color} {depth} --orbit 5 -o {out}/{name}.png"``. In braces
        stand inputs; ``{out}``, a folder for the results; ``{zarr}``, one whose NPY files, as ``{zarr}/depth.npy``,
        become a row of arrays of their names in the Zarr store ``frames.zarr``; ``{name}``, what the patterns' ``*``
        stand for.
    inputs : mapping of str to str
        Paths or URLs by name, files' or folders', of any file system that fsspec knows. Those with ``*`` make a task
        of each name; the others are the same for all.
    output : str
        Folder, path or URL, where each task's results go.
    scheduler : str, optional
        Address of a Dask scheduler, as ``"tcp://10.0.0.1:8786"``. By default one is started here, on loopback.
    workers : int, optional
        Processes to start here, each with one device: by default one a GPU, or one in all on a CPU.
    retries : int
        How often a task that failed is tried again.
    verify : bool
        Whether results from before are read and compared with their checksums, not only their sizes.
    progress : callable, optional
        Told how many tasks are over, and of how many.
    told : callable, optional
        Told where Dask's dashboard is.

    Returns
    -------
    Batch
        Names of what was done, was there, and failed, with the errors.

    Raises
    ------
    ArgumentError
        The command, a pattern or a number is wrong, or nothing matches.
    DeviceError
        The scheduler is not reached, or was lost and did not come back.
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
    """A client of the scheduler, or of a cluster of this machine that ends with the stack."""
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
    """Yield each task's name with its entry of the manifest, its error, or None where the scheduler was lost."""
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
    # Asked for results, too, it would for ever wait for one that a scheduler took along.
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
