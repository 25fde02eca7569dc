"""Times batches with one and two workers, and counts their results after killed processes and on a full disk.

``python -m benchmarks.app.batch`` prints the rows. Each worker's kernels use one core. Dask's processes are started on
loopback and ended by their process ids.
"""

from __future__ import annotations

import functools
import hashlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

import pyibr as ibr
from pyibr.app.batch import Batch, batch
from pyibr.app.batch.job import Job
from pyibr.app.batch.work import run_command

FRAMES, SIZE = 500, (320, 240)
ONE_CORE = {"POCL_MAX_PTHREAD_COUNT": "1", "POCL_CPU_MAX_CU_COUNT": "1", "POCL_AFFINITY": "0"}
_COMMAND = "warp {color} {depth} --camera {camera} --depth-scale 1000 --fill background --orbit 5 -o {out}/{name}.png"

_ROWS = _COMMAND.replace(
    "{out}/{name}.png", "{zarr}/color.npy --depth-out {zarr}/depth.npy --valid-out {zarr}/valid.npy"
)


def write_scans(folder: Path) -> dict[str, str]:
    """Write frames of moving waves; return the patterns of their files as inputs of the job."""
    width, height = SIZE
    y, x = np.mgrid[:height, :width]
    camera = ibr.Camera([[width, 0, width / 2], [0, width, height / 2], [0, 0, 1]], SIZE)
    folder.mkdir()
    camera.save(folder / "camera.json")
    for number in range(FRAMES):
        color = np.dstack([(x + number) % 200, y % 200, (x + y) % 180]).astype(np.uint8)
        ibr.write_color(folder / f"{number:04d}.color.png", color)
        depth = (2 + 0.2 * np.sin(x / 9 + number) + (x > 160)).astype(np.float32)
        ibr.write_depth(folder / f"{number:04d}.depth.png", depth, depth_scale=1000)
    return {"color": f"{folder}/*.color.png", "depth": f"{folder}/*.depth.png", "camera": f"{folder}/camera.json"}


def timed(run: Callable[..., Batch]) -> tuple[float, float]:
    """Measure seconds per frame, after the first twentieth of the frames, and seconds until the first frame."""
    times = list[float]()
    start = time.perf_counter()
    run(progress=lambda *counts: times.append(time.perf_counter()))
    first = len(times) // 20
    return (times[-1] - times[first]) / (len(times) - 1 - first), times[0] - start


def checksums(folder: Path) -> dict[str, str]:
    """SHA-256 of the pictures in a folder."""
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.glob("*.png"))}


def alone(inputs: dict[str, str], output: Path) -> float:
    """Measure the command's seconds per frame, when one process repeats it without a batch."""
    job = Job(_COMMAND, inputs, str(output))
    runs = [
        [word.format(**task.inputs, out=output, name=task.name).removeprefix("file://") for word in job.template]
        for task in job.tasks()[0][: FRAMES // 5]
    ]
    output.mkdir()
    run_command(runs[0])
    start = time.perf_counter()
    for words in runs:
        run_command(words)
    return (time.perf_counter() - start) / len(runs)


class Cluster:
    """Dask's scheduler and workers in separate processes on loopback, to be killed and restarted."""

    def __init__(self) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{port}"
        self._scheduler = ("scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
        self._worker = ("worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard")
        self._running: list[subprocess.Popen[bytes]] = []

    def __enter__(self) -> Cluster:
        for part in (self._scheduler, self._worker, self._worker):
            self._start(part)
        return self

    def __exit__(self, *error: object) -> None:
        for one in self._running:
            one.terminate()
            one.wait()

    def _start(self, part: Sequence[str]) -> None:
        command = (sys.executable, "-m", f"distributed.cli.dask_{part[0]}", *part[1:])
        self._running.append(subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))

    def kill_worker(self) -> None:
        """Kill the last worker without a replacement."""
        self._end(self._running[-1])

    def restart_scheduler(self) -> None:
        """Kill the scheduler, and start another at the same address with two workers, as a supervisor would."""
        self._end(self._running[0])
        self.__enter__()

    def _end(self, one: subprocess.Popen[bytes]) -> None:
        os.kill(one.pid, signal.SIGKILL)
        one.wait()
        self._running.remove(one)


def disturbed(inputs: dict[str, str], output: Path) -> Batch:
    """Run the job; kill a worker after a quarter and the scheduler after half of the tasks."""
    with Cluster() as cluster:

        def disturb(done: int, total: int) -> None:
            if done == total // 4:
                cluster.kill_worker()
            if done == total // 2:
                cluster.restart_scheduler()

        return batch(_COMMAND, inputs, str(output), scheduler=cluster.address, progress=disturb)


def on_full_disk(inputs: dict[str, str], output: Path, size: int) -> Batch | None:
    """Run the job on a disk of `size` bytes, and again once the disk is larger. Needs root."""
    output.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(output)]).returncode:
        return None
    try:
        first = batch(_COMMAND, inputs, str(output), workers=2, retries=0)
        subprocess.run(["mount", "-o", f"remount,size={10 * size}", str(output)], check=True)
        again = batch(_COMMAND, inputs, str(output), workers=2)
        print(f"and with more room: {len(again.kept)} kept, {len(again.done)} done, {len(again.failed)} failed")
        return first
    finally:
        subprocess.run(["umount", str(output)], check=True)


def main() -> None:
    """Print all rows."""
    os.environ.update(ONE_CORE)
    with tempfile.TemporaryDirectory() as place:
        inputs, outputs = write_scans(Path(place, "in")), Path(place)
        single = alone(inputs, outputs / "alone")
        print(f"the command alone: {1e3 * single:.1f} ms a frame")
        by_workers = dict[int, float]()
        for workers in (1, 2):
            run = functools.partial(batch, _COMMAND, inputs, str(outputs / f"{workers}"), workers=workers)
            by_workers[workers], first = timed(run)
            print(f"{workers} workers: {1e3 * by_workers[workers]:.1f} ms a frame, the first after {first:.1f} s")
        one, two = by_workers.values()
        print(f"overhead: {1e3 * (one - single):.1f} ms a frame; two workers {one / two:.2f} x")
        stored, _ = timed(functools.partial(batch, _ROWS, inputs, str(outputs / "rows"), workers=1))
        print(f"1 worker, into a Zarr store: {1e3 * stored:.1f} ms a frame")
        start = time.perf_counter()
        kept = batch(_COMMAND, inputs, str(outputs / "2"), workers=2)
        print(f"a second run: {len(kept.done)} done, {len(kept.kept)} kept, {time.perf_counter() - start:.1f} s")
        found, whole = disturbed(inputs, outputs / "disturbed"), checksums(outputs / "2")
        other = checksums(outputs / "disturbed")
        differ = sorted(name for name in whole | other if whole.get(name) != other.get(name))
        print(
            f"disturbed: {len(found.done)} done, {len(found.failed)} failed, pictures that differ: {differ or 'none'}"
        )
        Path(place, "in/0007.depth.png").unlink()
        half = sum(path.stat().st_size for path in (outputs / "2").glob("*.png")) // 2
        full = on_full_disk(inputs, outputs / "full", half)
        if full is not None:
            reasons = sorted({error.rpartition(":")[2] for error in full.failed.values()})
            print(f"full disk: {len(full.done)} done, {len(full.failed)} failed:{','.join(reasons)}")


if __name__ == "__main__":
    main()
