"""Open3D draws Gaussians on Mesa's software Vulkan driver (lavapipe), in a process of its own, for comparison."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from benchmarks.results import Skip

NAME = "Open3D on lavapipe"
_DRIVERS, _DRIVER = Path("/usr/share/vulkan/icd.d"), "lvp_icd*.json"
_PROJECT = Path(__file__).parents[2]
_LONGEST = 300  # seconds
_CLOUD, _CAMERAS, _DRAWN = "cloud.ply", "cameras.npz", "drawn.npz"


@dataclass(frozen=True)
class Drawn:
    """Pictures (N, H, W, 3) uint8, the milliseconds and the processor's milliseconds of each; the first is also new."""

    pictures: NDArray[np.uint8]
    wall: list[float]
    processor: list[float]


def drawn(cloud: ibr.Gaussians, cameras: list[ibr.Camera]) -> Drawn | Skip:
    """Draw a cloud from each camera, or say why this does not work here."""
    driver = next(iter(sorted(_DRIVERS.glob(_DRIVER))), None)
    if driver is None:
        return Skip(NAME, f"there is no {_DRIVER} in {_DRIVERS} (Debian: apt install mesa-vulkan-drivers)")
    with TemporaryDirectory() as name:
        folder = Path(name)
        cloud.save(folder / _CLOUD)
        poses = [camera.camera_from_world for camera in cameras]
        np.savez(folder / _CAMERAS, K=cameras[0].K, size=cameras[0].size, poses=poses)
        command = [sys.executable, "-m", "benchmarks.gaussians.lavapipe", name]
        environment = {**os.environ, "VK_ICD_FILENAMES": str(driver), "VK_DRIVER_FILES": str(driver)}
        try:
            done = subprocess.run(
                command, cwd=_PROJECT, env=environment, capture_output=True, text=True, timeout=_LONGEST
            )
        except subprocess.TimeoutExpired:
            return Skip(NAME, f"{len(cameras)} pictures of {len(cloud)} Gaussians take more than {_LONGEST} s")
        if not (folder / _DRAWN).exists():
            said = (done.stderr.strip() or done.stdout.strip() or "nothing was printed").splitlines()[-1]
            return Skip(NAME, f"it ended with status {done.returncode}: {said}")
        with np.load(folder / _DRAWN) as found:
            return Drawn(found["pictures"], found["wall"].tolist(), found["processor"].tolist())


def _draw(folder: Path) -> None:
    """Draw the cloud of a folder from the cameras of the folder; save the pictures and times."""
    import open3d
    from open3d.visualization import rendering

    with np.load(folder / _CAMERAS) as given:
        K, (width, height), poses = given["K"], given["size"].tolist(), given["poses"]
    read: Any = open3d.t.io.read_point_cloud  # its types forbid strings
    points = read(str(folder / _CLOUD))
    renderer: Any = rendering.OffscreenRenderer(width, height)
    look = rendering.MaterialRecord()
    if not hasattr(look, "gaussian_splat_sh_degree"):
        sys.exit(f"Open3D {open3d.__version__} draws no Gaussians; version 0.20 does")
    look.shader = "gaussianSplat"
    renderer.scene.view.set_post_processing(False)
    renderer.scene.set_background([0, 0, 0, 1])
    renderer.scene.add_geometry("cloud", points, look)
    middle = K[0, 2] + 0.5, K[1, 2] + 0.5  # Open3D's pixel centres are at halves
    view = open3d.camera.PinholeCameraIntrinsic(width, height, K[0, 0], K[1, 1], *middle)
    pictures, wall, processor = list[Any](), list[float](), list[float]()
    for pose in poses:
        start, used = time.perf_counter(), time.process_time()
        renderer.setup_camera(view, pose)
        pictures.append(np.asarray(renderer.render_to_image()))
        wall.append(1e3 * (time.perf_counter() - start))
        processor.append(1e3 * (time.process_time() - used))
    np.savez(folder / _DRAWN, pictures=pictures, wall=wall, processor=processor)


if __name__ == "__main__":
    _draw(Path(sys.argv[1]))
