"""Things that commands draw: meshes, 3D Gaussians, folders of depth images, and single images with depth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import typer
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.app.commands.cameras import LensOptions
from pyibr.app.commands.exposure import Exposure
from pyibr.app.commands.progress import waiting
from pyibr.app.options import (
    CameraFile,
    CleaningOptions,
    DefaultDepthText,
    ExposureOption,
    StoredDepth,
    default_depth_of,
    deviation_of,
    print_note,
    printable_text,
)
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError
from pyibr.core.files import check_exists
from pyibr.core.rotations import upright_axes
from pyibr.gaussians import Gaussians
from pyibr.images import DepthImage
from pyibr.io.gaussian_files import is_gaussian_file
from pyibr.io.layouts import may_be_recording
from pyibr.meshes.files import is_mesh_file
from pyibr.meshes.mesh import Mesh

Loaded = DepthImage | Mesh | Gaussians
Up = Literal["x", "y", "z", "-x", "-y", "-z"]
_WORLD_UP = (0.0, -1.0, 0.0)  # in pyibr's world, and in GLB files as they are read

ThingFiles = Annotated[
    list[Path],
    typer.Argument(
        metavar="THINGS...", help="Meshes; 3D Gaussians; folders of depth images; or COLOR DEPTH, with --camera"
    ),
]
StartCamera = Annotated[Path | None, typer.Option("--start", help="The initial camera: JSON")]
UpOption = Annotated[
    Up | None, typer.Option("--up", help="Up direction of the world; default for meshes: y, except GLB and GLTF")
]


class ImageOptions(NamedTuple):
    """Options for reading images with depth."""

    camera: CameraFile = None
    lens: LensOptions = LensOptions()
    stored: StoredDepth = StoredDepth()
    exposure: ExposureOption = 0.0
    default_depth: DefaultDepthText = "none"
    cleaning: CleaningOptions = CleaningOptions()

    def things(self, names: Sequence[Path], exposure: Exposure) -> tuple[list[Loaded], Up | None]:
        """The things of these names, and y if all are meshes whose files define no up direction."""
        self.cleaning.checked()  # wrong options are errors for meshes, too
        default_depth_of(self.default_depth)
        ups = set[Up | None]()
        things, rest, channel = list[Loaded](), list(names), self.stored.how.get("channel")
        while rest:
            name = rest.pop(0)
            check_exists(name)
            if may_be_recording(name, channel):
                for view in self.stored.load(name, self.lens.camera_of_folder(name, self.camera, channel)):
                    depth, noise = self._cleaned(view.color, view.depth, view.camera)
                    made = DepthImage(view.color, depth, view.camera, far=view.far, normals=view.normals, noise=noise)
                    things.append(made)
            elif is_gaussian_file(name) or is_mesh_file(name):
                things.append(load_thing(name))
                ups.add(customary_up(name) if isinstance(things[-1], Mesh) else None)
            elif not rest:
                raise ArgumentError("THINGS", f"a depth file after the image {printable_text(name)}", "none")
            else:
                things.append(self.image(name, rest.pop(0), exposure))
        if len(ups) > 1:
            print_note(
                "THINGS: y is up in OBJ, PLY, OFF and STL meshes, -y in GLB and Gaussians: convert meshes to GLB"
            )
        return things, "y" if ups == {"y"} and len(things) == len(names) else None

    def image(self, color: Path, depth: Path, exposure: Exposure) -> DepthImage:
        """An image with depth."""
        camera = self.lens.camera_of(color, self.camera)
        shown, far, behind = exposure.read(color), self.stored.empty_from, default_depth_of(self.default_depth)
        depths, noise = self._cleaned(shown, self.stored.read(depth, camera), camera)
        return DepthImage(shown, depths, camera, far=far, default_depth=behind, noise=noise)

    def _cleaned(
        self, color: NDArray[Any], depth: NDArray[np.float32], camera: Camera
    ) -> tuple[NDArray[np.float32], float | None]:
        """The depth, and its noise if given; None after cleaning: the remaining noise is estimated."""
        how, told = self.cleaning.checked()
        noise = deviation_of(told, camera)
        if how is None:
            return depth, noise
        return ibr.clean_depth(depth, color, noise=noise, **how._asdict()).depth, None


def load_thing(path: Path) -> Mesh | Gaussians:
    """Load a file of a mesh or of 3D Gaussians."""
    with waiting(f"Loading {printable_text(path.name)}"):
        return Gaussians.load(path) if is_gaussian_file(path) else Mesh.load(path)


def customary_up(mesh: Path) -> Up | None:
    """Customary up direction of a mesh file; None for GLB and GLTF, which define it."""
    return None if mesh.name.lower().removesuffix(".gz").endswith((".glb", ".gltf")) else "y"


def direction_of(up: Up | None) -> tuple[float, ...] | None:
    """Parse the value of --up."""
    if up is None:
        return None
    sign = -1.0 if up.startswith("-") else 1.0
    return tuple(sign * float(axis == up[-1]) for axis in "xyz")


def upward_of(mesh: Path, up: Up | None) -> tuple[float, ...]:
    """Up direction of a file of a mesh or of Gaussians in pyibr's world, by --up or by custom."""
    return direction_of(up or (None if is_gaussian_file(mesh) else customary_up(mesh))) or _WORLD_UP


def check_up(up: Up | None, *files: Path) -> None:
    """Raise ArgumentError if --up is given for mesh files that it does not change."""
    if up and [customary_up(file) for file in files].count(None) != 1:
        got = " and ".join(printable_text(file) for file in files)
        raise ArgumentError("--up", "a .glb, which has an up direction, on one side", got)


def save_upright(mesh: Mesh, path: Path, up: Up | None, source: Path | None = None) -> str:
    """Write a mesh, upright in GLB; return a remark on its up direction.

    source: the file of the mesh, read with glTF's axes. up: up direction in files other than GLB; by default y in
    `source`, and -y in the world of cameras.
    """
    to_gltf, of_gltf = (file is not None and customary_up(file) is None for file in (path, source))
    known, remark = up or ("-y" if source is None else "y"), ""
    if to_gltf != of_gltf:
        axes = upright_axes(direction_of(known) or _WORLD_UP)
        axes = axes.T if of_gltf else axes
        normals = None if mesh.normals is None else mesh.normals @ axes
        mesh = mesh.replaced(vertices=mesh.vertices @ axes + 0.0, normals=normals)  # no -0
        remark = "" if source is None else f"; {known} is up in {printable_text((source if to_gltf else path).name)}"
    elif source is None:
        remark = f"; in other commands, --up {known} shows it upright"
    mesh.save(path, axes="gltf")
    return remark
