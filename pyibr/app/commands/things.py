"""Things that commands draw: meshes, folders of depth images, and single images with depth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import typer
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.app.commands.cameras import LensOptions
from pyibr.app.commands.exposure import Exposure
from pyibr.app.options import Cleaning, StoredDepth, default_depth_of, deviation_of, printable_text
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError
from pyibr.core.files import check_exists
from pyibr.images import DepthImage
from pyibr.images.depth_image import DefaultDepth
from pyibr.io.layouts import may_be_recording
from pyibr.meshes.files import is_mesh_file
from pyibr.meshes.mesh import Mesh

Up = Literal["x", "y", "z", "-x", "-y", "-z"]

ThingFiles = Annotated[
    list[Path],
    typer.Argument(metavar="THINGS...", help="Meshes; folders of depth images; or COLOR DEPTH, with --camera"),
]
StartCamera = Annotated[Path | None, typer.Option("--start", help="The initial camera: JSON")]
UpOption = Annotated[
    Up | None, typer.Option("--up", help="Up direction of the world; default for meshes: y, except GLB and GLTF")
]


class Things:
    """Reads the things named on the command line."""

    def __init__(
        self,
        camera: Path | None,
        lens: LensOptions,
        stored: StoredDepth,
        default_depth: str,
        cleaning: Cleaning | None,
        noise: tuple[float, float] | None,
        exposure: Exposure,
    ) -> None:
        self._exposure = exposure
        self._camera, self._lens, self._stored, self._cleaning = camera, lens, stored, cleaning
        self._noise = noise
        self._default_depth: float | DefaultDepth | None = default_depth_of(default_depth)

    def read(self, names: Sequence[Path]) -> tuple[list[DepthImage | Mesh], bool]:
        """The things, and whether all are meshes whose files define no up direction, so that y is up by custom."""
        things: list[DepthImage | Mesh] = []
        customary = True
        rest = list(names)
        while rest:
            name = rest.pop(0)
            check_exists(name)
            if may_be_recording(name):
                for view in self._stored.load(name, self._lens.camera_of_folder(name, self._camera)):
                    depth, told = self._cleaned(view.color, view.depth, view.camera)
                    made = DepthImage(view.color, depth, view.camera, far=view.far, normals=view.normals, noise=told)
                    things.append(made)
            elif is_mesh_file(name):
                things.append(Mesh.load(name))
            elif not rest:
                raise ArgumentError("THINGS", f"a depth file after the image {printable_text(name)}", "none")
            else:
                color = self._exposure.read(name)
                own, far = self._lens.camera_of(name, self._camera), self._stored.empty_from
                depth, told = self._cleaned(color, self._stored.read(rest.pop(0), own), own)
                things.append(DepthImage(color, depth, own, far=far, default_depth=self._default_depth, noise=told))
            customary &= is_mesh_file(name) and customary_up(name) is not None
        return things, customary

    def _cleaned(
        self, color: NDArray[Any], depth: NDArray[np.float32], camera: Camera
    ) -> tuple[NDArray[np.float32], float | None]:
        """The depth, and its noise if given; None after cleaning: the remaining noise is estimated."""
        how, told = self._cleaning, deviation_of(self._noise, camera)
        return (
            (depth, told) if how is None else (ibr.clean_depth(depth, color, noise=told, **how._asdict()).depth, None)
        )


def customary_up(mesh: Path) -> Up | None:
    """Customary up direction of a mesh file; None for GLB and GLTF, which define it."""
    return None if mesh.name.lower().endswith((".glb", ".gltf")) else "y"


def direction_of(up: Up | None) -> tuple[float, ...] | None:
    """Parse the value of --up."""
    if up is None:
        return None
    sign = -1.0 if up.startswith("-") else 1.0
    return tuple(sign * float(axis == up[-1]) for axis in "xyz")
