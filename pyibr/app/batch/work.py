"""The work of a batch's workers: commands, and the rows of a Zarr store that their NPY files become.

Arrays of the store have one row and one chunk a task.
"""

from __future__ import annotations

import contextlib
import functools
import io
import json
import os
import re
import shutil
import socket
import tempfile
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import typer
from typer.main import get_command

import pyibr as ibr
from pyibr.app.batch.job import Task
from pyibr.app.batch.manifest import PART, Entry, checksum
from pyibr.app.commands.capture import capture
from pyibr.app.commands.clean import clean
from pyibr.app.commands.command import expanded
from pyibr.app.commands.compare import compare
from pyibr.app.commands.convert import convert
from pyibr.app.commands.mesh import mesh
from pyibr.app.commands.orbit import orbit
from pyibr.app.commands.register import register
from pyibr.app.commands.reliefs import relief, slices
from pyibr.app.commands.rigs import quilt, stereo
from pyibr.app.commands.solids import hull, object_
from pyibr.app.commands.warp import warp
from pyibr.core.errors import Error
from pyibr.core.optional import distributed, fsspec, zarr
from pyibr.opencl.device import VARIABLE

_STORE = "frames.zarr"  # in the output
_METADATA = "zarr.json"

COMMANDS: dict[str, Callable[..., None]] = {
    "warp": warp,
    "stereo": stereo,
    "quilt": quilt,
    "orbit": orbit,
    "clean": clean,
    "register": register,
    "mesh": mesh,
    "capture": capture,
    "object": object_,
    "hull": hull,
    "compare": compare,
    "convert": convert,
    "relief": relief,
    "slices": slices,
}
"""The commands that read and write files."""


def run_task(template: Sequence[str], output: str, task: Task) -> Entry:
    """Run a task's command and move its complete files to the output; none if it fails."""
    _take_device()
    files, root = fsspec().url_to_fs(output)
    is_local = "file" in files.protocol
    worker = f"{PART}{socket.gethostname()}-{os.getpid()}-{threading.get_ident()}"
    place = Path(root if is_local else tempfile.gettempdir(), worker)  # kept: some file systems remove folders slowly
    out = place / "out"
    out.mkdir(parents=True, exist_ok=True)

    def move(path: Path, target: str) -> None:
        files.makedirs(files._parent(target), exist_ok=True)
        path.replace(target) if is_local else files.put_file(str(path), target)

    try:
        known = {name: _local(url, place / name) for name, url in task.inputs.items()}
        run_command([word.format(**known, out=out, zarr=out / _STORE, name=task.name) for word in template])
        if task.rows:
            _to_chunks(out / _STORE, task)
            for path in sorted(out.glob(f"{_STORE}/*/{_METADATA}")):
                _agree(files, path, f"{root}/{path.relative_to(out).as_posix()}", move)
        entry: Entry = {"name": task.name, "key": task.key, "files": {}}
        made = sorted(path for path in out.rglob("*") if path.is_file())
        if not made:
            raise Error("the command wrote nothing to {out}")
        for path in made:
            below = path.relative_to(out).as_posix()
            entry["files"][below] = path.stat().st_size, checksum(fsspec().filesystem("file"), str(path))
            move(path, f"{root}/{below}")
    finally:
        if not is_local or any(path != out for path in place.rglob("*")):
            shutil.rmtree(place)
    return entry


def run_command(words: Sequence[str]) -> None:
    """Run a command without output; raise its errors."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        status = _command(words[0]).main(list(words[1:]), f"pyibr {words[0]}", standalone_mode=False)
    if status:
        raise Error(said.getvalue().strip() or f"the command ended with status {status}")


@functools.cache
def _command(name: str) -> Any:
    app = typer.Typer(add_completion=False)
    app.command(name)(expanded(COMMANDS[name]))
    return get_command(app)


def _local(url: str, place: Path) -> Path:
    """The path of a local file or folder, or of a local copy of a remote one."""
    files, path = fsspec().url_to_fs(url)
    if "file" in files.protocol:
        return Path(path)
    place.mkdir()
    copy = place / Path(path).name
    files.get(path, str(copy), recursive=files.isdir(path))
    return copy


@functools.cache
def _take_device() -> None:
    """Select this worker's GPU by the number in its name, before any GPU is opened."""
    gpus = working_gpus()
    if len(gpus) > 1 and not os.environ.get(VARIABLE):
        number = re.search(r"\d+$", str(distributed().get_worker().name))
        os.environ[VARIABLE] = str(gpus[int(number.group()) % len(gpus) if number else 0].index)


def working_gpus() -> list[ibr.Device]:
    """The GPUs of this machine that work."""
    return [device for device in ibr.devices() if device.works and device.kind == "gpu"]


def numbered(output: str, tasks: Sequence[Task]) -> list[Task]:
    """Return the tasks with their rows: rows that the store has, then new rows, for which it is enlarged."""
    store = zarr().open_group(f"{output}/{_STORE}", mode="a")
    names = list(dict.fromkeys([*store.attrs.get("names", ()), *(task.name for task in tasks)]))
    store.attrs["names"] = names
    for _, array in store.arrays():
        array.resize((len(names), *array.shape[1:]))
    rows = {name: row for row, name in enumerate(names)}
    return [task._replace(row=rows[task.name], rows=len(rows)) for task in tasks]


def _to_chunks(folder: Path, task: Task) -> None:
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


def _agree(files: Any, mine: Path, target: str, move: Callable[[Path, str], object]) -> None:
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
