"""Times camera rigs step by step: a film with depth is drawn for two eyes, and a photograph as a quilt.

``python -m benchmarks.app.rigs [FRAMES]`` prints wall times, and processor times added over all cores. Two cores reach
20 frames per second if a frame takes 100 ms of processor time.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

import pyibr as ibr
from pyibr.app.batch.work import run_command
from pyibr.capture.quilt import QuiltRig, tiled
from pyibr.capture.stereo import StereoRig, joined
from pyibr.core.optional import pyav

SIZE, FPS, RATE = (1280, 720), 30, 44_100
QUILT, GRID = (512, 512), (8, 6)


def frames_of(size: tuple[int, int], count: int) -> Iterator[tuple[Any, Any]]:
    """Colours and depths of balls that drift in front of a wavy wall and a floor."""
    width, height = size
    y, x = np.mgrid[:height, :width].astype(np.float32)
    rng = np.random.default_rng(1)
    texture = rng.random((height // 8 + 2, width // 8 + 2, 3), dtype=np.float32).repeat(8, 0).repeat(8, 1)
    waves = np.dstack([np.sin(x / (23 + 9 * c) + y / (31 - 7 * c)) for c in range(3)]) * 50 + 120
    wall = (waves + 40 * texture[:height, :width]).astype(np.float32)
    floor = np.minimum(5 + 0.2 * np.sin(x / 90), 900 / np.maximum(y - 0.55 * height, 1))
    for number in range(count):
        color, depth = wall.copy(), floor.astype(np.float32)
        for ball in range(5):
            away = np.hypot(x - (200 + 190 * ball + 3 * number) % width, y - (150 + 80 * ball)) / (50 + 9 * ball)
            near = away < 1
            depth[near] = 2 + 0.3 * ball - 0.3 * np.sqrt(1 - away[near] ** 2)
            color[near] = (220 - 30 * ball, 60 + 35 * ball, 90) + 20 * texture[:height, :width][near]
        yield color.clip(0, 255).astype(np.uint8), depth


def write_film(folder: Path, count: int) -> None:
    """Write `film.mp4`, with a tone, and a folder `depth` of 16-bit PNG files in millimetres."""
    av = pyav()
    with av.open(str(folder / "film.mp4"), "w") as film:
        video, audio = film.add_stream("libx264", rate=FPS), film.add_stream("aac", rate=RATE)
        (video.width, video.height), video.pix_fmt = SIZE, "yuv420p"
        video.options = {"preset": "veryfast", "crf": "18"}
        for number, (color, depth) in enumerate(frames_of(SIZE, count)):
            film.mux(video.encode(av.VideoFrame.from_ndarray(color, format="rgb24")))
            ibr.write_depth(folder / f"depth/{number:05d}.png", depth, depth_scale=1000)
        film.mux(video.encode())
        times = np.arange(RATE * count // FPS) / RATE
        tone = av.AudioFrame.from_ndarray(np.sin(2764 * times).astype(np.float32)[None], format="fltp", layout="mono")
        tone.sample_rate, tone.time_base = RATE, Fraction(1, RATE)
        film.mux(audio.encode(tone))
        film.mux(audio.encode())


def timed(what: str, call: Callable[[], object], parts: int) -> None:
    """Print a call's wall time and its processor time over all cores, in milliseconds divided by `parts`."""
    wall, cores = time.perf_counter(), time.process_time()
    call()
    wall, cores = time.perf_counter() - wall, time.process_time() - cores
    print(f"{what:44} {wall * 1e3 / parts:8.1f} {cores * 1e3 / parts:8.1f}", flush=True)


def stereo_film(folder: Path, count: int) -> None:
    """Time the whole command and its separate parts."""
    write_film(folder, count)
    words = ["stereo", f"{folder}/film.mp4", f"{folder}/depth", "--depth-scale", "1000", "--fov", "60"]
    run_command([*words, "--take", "0:2", "-o", f"{folder}/first.mp4"])  # builds kernels
    timed(f"stereo, both eyes, {SIZE[0]} x {SIZE[1]}", lambda: run_command([*words, "-o", f"{folder}/a.mp4"]), count)
    one = [*words, "--synthetic-view", "right", "-o", f"{folder}/b.mp4"]
    timed("stereo, one eye at the camera", lambda: run_command(one), count)
    part = min(count, 20)
    colors = list(ibr.Video(folder / "film.mp4").frames(range(part)))
    files = sorted((folder / "depth").iterdir())[:part]
    depths = [ibr.read_depth(file, depth_scale=1000) for file in files]
    timed("  reading colours", lambda: list(ibr.Video(folder / "film.mp4").frames(range(part))), part)
    timed("  reading depth", lambda: [ibr.read_depth(file, depth_scale=1000) for file in files], part)
    camera = ibr.Camera.from_fov(SIZE, fov_x=60)
    eyes = StereoRig(depth_range=(1.7, 5.2)).cameras(camera)

    def drawn() -> Iterator[list[Any]]:
        for frame in zip(colors, depths, strict=True):
            yield [eye.color for eye in ibr.warp(ibr.DepthImage(*frame, camera), eyes, fill="background")]

    timed("  drawing", lambda: sum(len(frame) for frame in drawn()), part)  # no frame is kept, so memory is reused
    pictures = list(drawn())
    timed("  joining", lambda: [joined(frame, "full-sbs") for frame in pictures], part)
    whole = [joined(frame, "full-sbs") for frame in pictures]
    timed("  writing H.264", lambda: ibr.write_video(folder / "c.mp4", whole, FPS), part)


def quilt_picture(folder: Path) -> None:
    """Time a quilt, from arrays to PNG."""
    ((color, depth),) = frames_of(QUILT, 1)
    camera, name = ibr.Camera.from_fov(QUILT, fov_x=40), folder / "quilt.png"
    first, second, third = (ibr.DepthImage(color, depth, camera) for _ in range(3))

    def draw(view: ibr.DepthImage) -> None:
        ibr.write_color(name, ibr.quilt(view, grid=GRID))

    draw(first)  # builds kernels
    timed(f"quilt, {math.prod(GRID)} views of {QUILT[0]} x {QUILT[1]}", lambda: draw(second), 1)
    cameras = QuiltRig(GRID, focus=3).cameras(camera)
    timed("  drawing", lambda: ibr.warp(third, cameras, fill="background"), 1)
    views = [frame.color for frame in ibr.warp(third, cameras, fill="background")]
    timed("  joining", lambda: tiled(views, GRID), 1)
    whole = tiled(views, GRID)
    timed("  writing PNG", lambda: ibr.write_color(name, whole), 1)


def main(count: int) -> None:
    """Print all rows."""
    print(f"{'':44} {'ms':>8} {'all cores':>9}")
    with tempfile.TemporaryDirectory() as folder:
        stereo_film(Path(folder), count)
        quilt_picture(Path(folder))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 300)
