"""Batches run each task once, even if workers are killed, inputs are missing, or results exist already."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.app.batch import _results, batch
from pyibr.app.batch.job import Job, Task
from pyibr.app.batch.manifest import Manifest
from pyibr.app.batch.work import COMMANDS, run_task
from tools.processes import run_within

distributed = pytest.importorskip("distributed")
fsspec = pytest.importorskip("fsspec")

SIZE = 24, 16
WARP = "warp {color} {depth} --camera {camera} --depth-scale 1000 --move 0.1 0 0 -o {out}/{name}.png"


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50) as local:
        yield local


def scans(folder: Path, count: int = 3) -> dict[str, str]:
    """Write small views, each into its own folder; return the patterns of their files as inputs of a batch."""
    camera = ibr.Camera([[20, 0, 11.5], [0, 20, 7.5], [0, 0, 1]], SIZE)
    for number in range(count):
        place = folder / f"scan {number}"
        place.mkdir(parents=True)
        ibr.write_color(place / "color.png", np.full((*SIZE[::-1], 3), 50 + number, np.uint8))
        ibr.write_depth(place / "depth.png", np.full(SIZE[::-1], 2 + number, np.float32), depth_scale=1000)
    camera.save(folder / "camera.json")
    each = {name: f"{folder}/scan */{name}.png" for name in ("color", "depth")}
    return each | {"camera": f"{folder}/camera.json"}


def test_each_task_is_done_once(cluster: Any, tmp_path: Path):
    """Results equal the results of the command alone. If complete and of the same inputs, they are not made again."""
    inputs, output, told = scans(tmp_path / "in"), tmp_path / "out", list[tuple[int, int]]()

    def run(command: str = WARP, **more: Any) -> Any:
        return batch(command, inputs, str(output), scheduler=cluster.scheduler_address, **more)

    first = run(progress=lambda *counts: told.append(counts))
    assert (sorted(first.done), first.kept, first.failed) == (["0", "1", "2"], [], {})
    assert told == [(1, 3), (2, 3), (3, 3)]
    view = ibr.read_color(tmp_path / "in/scan 1/color.png")
    camera = ibr.Camera.load(tmp_path / "in/camera.json")
    alone = ibr.warp(ibr.DepthImage(view, np.full(SIZE[::-1], 3, np.float32), camera), camera.moved(0.1, 0, 0))
    np.testing.assert_array_equal(ibr.read_color(output / "1.png")[..., :3], alone.color)
    times = {path: path.stat().st_mtime_ns for path in output.rglob("*.png")}
    assert run(verify=True).kept == ["0", "1", "2"]
    assert times == {path: path.stat().st_mtime_ns for path in output.rglob("*.png")}

    whole = (output / "0.png").read_bytes()
    (output / "0.png").write_bytes(whole[:-1] + b"?")
    (output / "1.png").unlink()
    os.utime(tmp_path / "in/scan 2/depth.png", (1, 1))
    assert (sorted(run().done), (output / "0.png").read_bytes()[-1:]) == (["1", "2"], b"?"), "its size is the same"
    again = run(verify=True)
    assert (again.done, again.kept, (output / "0.png").read_bytes()) == (["0"], ["1", "2"], whole)
    assert sorted(run(WARP.replace("0.1", "0.2")).done) == ["0", "1", "2"]
    assert not list(output.glob(".part-*"))


def test_what_fails_is_told_and_the_rest_is_done(cluster: Any, tmp_path: Path):
    inputs, output = scans(tmp_path / "in", 4), tmp_path / "out"
    (tmp_path / "in/scan 1/depth.png").unlink()
    (tmp_path / "in/scan 2/depth.png").write_bytes(b"no image")
    found = batch(WARP, inputs, str(output), scheduler=cluster.scheduler_address, retries=1)
    assert sorted(found.done) == ["0", "3"] and sorted(found.failed) == ["1", "2"]
    assert "no file of this name matches" in found.failed["1"] and "not a readable image" in found.failed["2"]
    assert json.loads((output / "manifest/failed.json").read_text()) == found.failed
    assert sorted(path.name for path in output.iterdir()) == ["0.png", "3.png", "manifest"]


def test_a_killed_worker_loses_nothing(cluster: Any, tmp_path: Path):
    inputs, output = scans(tmp_path / "in", 12), tmp_path / "out"
    with distributed.Client(cluster) as client:
        victim = next(iter(client.run(os.getpid).values()))
    killed = threading.Event()

    def kill(done: int, total: int) -> None:
        if done >= 2 and not killed.is_set():
            killed.set()
            os.kill(victim, signal.SIGKILL)

    found = batch(WARP, inputs, str(output), scheduler=cluster.scheduler_address, progress=kill)
    assert killed.is_set() and len(set(found.done)) == 12 and not found.failed
    assert len(list(output.glob("*.png"))) == 12 and not list(output.glob(".part-*"))


def test_inputs_and_outputs_by_url(cluster: Any, tmp_path: Path):
    """Files are copied from and to remote file systems. A line of the manifest that a crash has cut is skipped."""
    inputs, output = scans(tmp_path / "in"), tmp_path / "out"
    urls = {name: f"file://{path}" for name, path in inputs.items()}
    urls["camera"] = f"simplecache::{urls['camera']}"
    (output / "manifest").mkdir(parents=True)
    odd = ["[]", "null", "3", "{}", '"word"', '{"name": [], "key": "", "files": {}}']
    odd += ['{"name": "0", "key": "", "files": 3}']
    odd += ['{"name": "0", "key": "", "files": {"0.png": 5}}', "[" * 99_999, '{"name": "0", "ke']
    (output / "manifest/0.jsonl").write_text("\n".join(odd))
    assert sorted(batch(WARP, urls, f"file://{output}", scheduler=cluster.scheduler_address).done) == ["0", "1", "2"]


@pytest.mark.parametrize(
    ("command", "colors", "message"),
    [
        ("warp {color} -o new.png", "*.png", "command: expected {out} or {zarr}, and names of color, name, out, zarr "),
        ("warp {colour} -o {out}/new.png", "*.png", "command: expected {out} or {zarr}, and names of"),
        ("warp {color -o {out}/new.png", "*.png", "command: expected words with names in braces"),
        ("view {color} {out}", "*.png", f"command: expected one of {', '.join(COMMANDS)}, got 'view'"),
        ("warp {color} -o {out}/new.png", "one.png", "inputs: expected a pattern with *"),
        ("warp {color} -o {out}/new.png", "none-*.png", "inputs: expected patterns that match files"),
    ],
)
def test_jobs_that_are_none(command: str, colors: str, message: str, tmp_path: Path, monkeypatch: Any):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ibr.ArgumentError) as caught:
        batch(command, {"color": colors}, "out")
    assert str(caught.value).startswith(message) and not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("depth", "got"),
    [
        ("depht/*.png", "patterns that match files, got depht/*.png, which match none"),
        ("*.txt", "patterns whose * match the same names, got one*.png: -1, *.txt: note"),
    ],
)
def test_patterns_without_a_task_are_one_error(depth: str, got: str, tmp_path: Path, monkeypatch: Any):
    monkeypatch.chdir(tmp_path)
    for name in ("one-1.png", "note.txt"):
        (tmp_path / name).touch()
    with pytest.raises(ibr.ArgumentError) as caught:
        Job("warp {color} {depth} -o {out}/new.png", {"color": "one*.png", "depth": depth}, "out").tasks()
    assert str(caught.value) == f"inputs: expected {got}"


def test_names_are_what_the_stars_stand_for(tmp_path: Path):
    for path in ("a/1/c.png", "b/2/c.png", "a/1/d.png", "b/2/d.png"):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).touch()
        os.utime(tmp_path / path, (1, 1))  # a copy or an archive may give all files the same time
    job = Job("mesh {c} {d} -o {out}/x.glb", {"c": f"{tmp_path}/*/*/c.png", "d": f"{tmp_path}/*/*/d.png"}, "out")
    tasks, lacking = job.tasks()
    assert [task.name for task in tasks] == ["a_1", "b_2"] and not lacking
    assert tasks[0].inputs["d"].endswith("a/1/d.png") and tasks[0].key != tasks[1].key


@pytest.mark.thorough
def test_the_command_starts_a_cluster_of_its_own(tmp_path: Path):
    inputs = scans(tmp_path / "in", 2)
    job = tmp_path / "job.toml"
    table = "\n".join(f'{name} = "{path}"' for name, path in inputs.items())
    job.write_text(f'command = "{WARP}"\noutput = "{tmp_path}/out"\n[inputs]\n{table}\n')
    command = ("-m", "pyibr", "batch", str(job))

    for counts in ("2 done, 0 kept from earlier runs, 0 failed", "0 done, 2 kept from earlier runs, 0 failed"):
        done = run_within(120, (sys.executable, *command))
        assert done.returncode == 0 and done.stdout == f"{tmp_path}/out: {counts}\n", done.stderr


def test_commands_that_end_early_or_write_elsewhere_fail(tmp_path: Path):
    inputs, output = scans(tmp_path, 1), str(tmp_path / "out")
    (task,), _ = Job(WARP, inputs, output).tasks()
    elsewhere, mistyped = WARP.replace("{out}", str(tmp_path)), WARP.replace("--move", "--mov")
    for command, message in ((elsewhere, "wrote nothing"), (mistyped, "No such option")):
        with pytest.raises(Exception, match=message):
            run_task(command.split(), output, task)
    assert not list(Path(output).rglob("*.png"))


def test_results_go_to_any_file_system(tmp_path: Path):
    inputs, output = scans(tmp_path, 1), "memory://batches/out"
    (task,), _ = Job(WARP, inputs, output).tasks()
    manifest = Manifest(output)
    assert not manifest.has(task, verify=False)
    manifest.add(run_task(WARP.split(), output, task))
    manifest.close({})
    assert Manifest(output).has(task, verify=True)
    files = fsspec.filesystem("memory")
    files.pipe_file("/batches/out/0.png", files.cat_file("/batches/out/0.png")[::-1])
    assert Manifest(output).has(task, verify=False) and not Manifest(output).has(task, verify=True)


def test_rows_of_a_zarr_store(cluster: Any, tmp_path: Path):
    """A frame's row holds the arrays of the command's files. The row stays the same if frames come, change or go."""
    zarr = pytest.importorskip("zarr")
    inputs, output = scans(tmp_path / "in", 3), tmp_path / "out"
    (tmp_path / "in/scan 0").rename(tmp_path / "in/scan 9")
    files = "{zarr}/color.npy --depth-out {zarr}/depth.npy --valid-out {zarr}/valid.npy"
    command = f"warp {{color}} {{depth}} --fov 60 --depth-scale 1000 --move 0.1 0 0 -o {files}"

    def run() -> Any:
        return batch(command, inputs, str(output), scheduler=cluster.scheduler_address, retries=0, verify=True)

    assert sorted(run().done) == ["1", "2", "9"]
    shutil.copytree(tmp_path / "in/scan 1", tmp_path / "in/scan 0")
    ibr.write_color(tmp_path / "in/scan 2/color.png", np.zeros((*SIZE[::-1], 3), np.uint8))
    (output / "frames.zarr/color/2.0.0.0").unlink()
    (tmp_path / "in/scan 3").mkdir()
    ibr.write_color(tmp_path / "in/scan 3/color.png", np.ones((8, 9, 3), np.uint8))
    ibr.write_depth(tmp_path / "in/scan 3/depth.png", np.ones((8, 9), np.float32), depth_scale=1000)
    found = run()
    assert (sorted(found.done), found.kept) == (["0", "2", "9"], ["1"])
    size = "(16, 24, 3) as in the store, got uint8 of shape (8, 9, 3)"
    assert found.failed == {"3": f"color: expected uint8 of shape {size}"}

    store, camera = zarr.open(output / "frames.zarr"), ibr.Camera.from_fov(SIZE, fov_x=60)
    assert store.attrs["names"] == ["1", "2", "9", "0", "3"] and not store["valid"][4].any()
    for row, (color, depth) in enumerate([(51, 3), (0, 4), (50, 2), (51, 3)]):
        view = np.full((*SIZE[::-1], 3), color, np.uint8), np.full(SIZE[::-1], depth, np.float32)
        alone = ibr.warp(ibr.DepthImage(*view, camera), camera.moved(0.1, 0, 0))
        np.testing.assert_array_equal(store["color"][row], alone.color)
        np.testing.assert_array_equal(store["valid"][row], alone.valid)
        np.testing.assert_array_equal(store["depth"][row], alone.depth * np.float32(1000))


class Lost(list[Any]):
    """Stands in for Dask; the scheduler is lost after a task's end, before its result is fetched."""

    key, status, CancelledError = "one", "finished", RuntimeError

    def nthreads(self) -> dict[str, int]:
        return {}

    def submit(self, *_: object, **__: object) -> Lost:
        return self

    def as_completed(self, futures: list[Any], raise_errors: bool) -> Lost:
        self.extend(futures)
        return self

    def result(self) -> None:
        raise ConnectionResetError


def test_a_result_that_went_with_its_scheduler_is_none():
    dask, task = Lost(), Task("0007", {}, "")
    job = Job("warp {a} -o {out}", {"a": "*.png"}, ".")
    assert list(_results(dask, dask, job, {"0007": task}, 0)) == [("0007", None)]
