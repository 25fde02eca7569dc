"""Results as a Zarr store: arrays from the command's NPY files, with one row and one chunk a task."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pyibr.app.batch.job import Task
from pyibr.core.errors import Error
from pyibr.core.optional import distributed, zarr

STORE = "frames.zarr"  # in the output
METADATA = "zarr.json"


def numbered(output: str, tasks: Sequence[Task]) -> list[Task]:
    """Return the tasks with their rows: rows that the store has, then new rows, for which it is enlarged."""
    store = zarr().open_group(f"{output}/{STORE}", mode="a")
    names = list(dict.fromkeys([*store.attrs.get("names", ()), *(task.name for task in tasks)]))
    store.attrs["names"] = names
    for _, array in store.arrays():
        array.resize((len(names), *array.shape[1:]))
    rows = {name: row for row, name in enumerate(names)}
    return [task._replace(row=rows[task.name], rows=len(rows)) for task in tasks]


def to_chunks(folder: Path, task: Task) -> None:
    """Turn a folder's NPY files into arrays of the same names that hold only the task's row."""
    for path in sorted(folder.glob("*")):
        if path.suffix != ".npy":
            raise Error(f"expected NPY files in {{zarr}}, got {path.name}")
        image = np.load(path)
        array = zarr().create_array(
            path.with_suffix(""),
            shape=(task.rows, *image.shape),
            chunks=(1, *image.shape),
            dtype=image.dtype,
            chunk_key_encoding={"name": "v2", "separator": "."},  # one file a row, without nested folders
            config={"write_empty_chunks": True},  # else an earlier run's chunk would stay
        )
        array[task.row] = image
        path.unlink()


def agree(files: Any, mine: Path, target: str, move: Callable[[Path, str], object]) -> None:
    """Move the first task's metadata of an array to the store; raise Error if another task's differ."""
    own = json.loads(mine.read_bytes())
    if not files.exists(target):
        with distributed().Lock(target):
            if not files.exists(target):
                move(mine, target)
    mine.unlink(missing_ok=True)
    first = json.loads(files.cat_file(target))
    if first != own:
        expected, got = (f"{one['data_type']} of shape {tuple(one['shape'][1:])}" for one in (first, own))
        raise Error(f"{mine.parent.name}: expected {expected} as in the store, got {got}")
