"""`pyibr capture`: depth images of a mesh or of 3D Gaussians, which all other commands read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import ArrayLike

from pyibr.app.commands.command import tell_written
from pyibr.app.commands.outputs import check_outputs
from pyibr.app.commands.progress import with_progress
from pyibr.app.commands.things import UpOption, direction_of, load_thing, upward_of
from pyibr.app.options import DeviceName, device_of, print_note, printable_text
from pyibr.capture.clouds import CloudScene
from pyibr.capture.frusta import load_frusta, save_set
from pyibr.capture.raycast import Layer, MeshScene, as_scene, object_cameras
from pyibr.capture.sets import SET_FILE, save
from pyibr.core.camera import Camera, Projection
from pyibr.core.errors import ArgumentError
from pyibr.gaussians import Gaussians
from pyibr.images import DepthImage
from pyibr.io import read_cameras
from pyibr.meshes.mesh import Mesh
from pyibr.picture.light import light_for

_SIZE = 256  # pixels a side, if neither cameras nor frusta give a size
_AXES: tuple[str, ...] = "x", "-x", "y", "-y", "z", "-z"  # view directions of the six images from all round


def capture(
    mesh: Annotated[Path, typer.Argument(metavar="MESH", help="GLB, OBJ, PLY ...; or 3D Gaussians")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the set, for `object`, `warp` ...")],
    camera: Annotated[
        Path | None,
        typer.Option(help="The cameras: a list, a folder, a set, a COLMAP model; default: six from all round"),
    ] = None,
    frusta: Annotated[Path | None, typer.Option(help="The frusta of a set: its folder, or a JSON file")] = None,
    size: Annotated[int | None, typer.Option(min=2, max=8192, help="Pixels a side of the images")] = None,
    projection: Annotated[
        Projection, typer.Option(help="Projection of the six images from all round")
    ] = "orthographic",
    layer: Annotated[Layer, typer.Option(help="With --camera: the nearest or the farthest surface on a ray")] = "first",
    up: UpOption = None,
    device: DeviceName = None,
) -> None:
    """Capture depth images of a mesh or of Gaussians: six from all round, or from cameras, or from a set's frusta."""
    if camera and frusta:
        raise ArgumentError("--frusta", "none together with --camera", str(frusta))
    for option, given, needed in (
        ("--layer", layer != "first", camera is not None),
        ("--projection", projection != "orthographic", not (camera or frusta)),
        ("--size", size is not None, camera is None),
    ):
        if given and not needed:
            raise ArgumentError(option, "none with --camera, which sets it" if camera else "--camera with it", "one")
    read = {"MESH": [mesh], "--camera": [camera] if camera else [], "--frusta": [frusta] if frusta else []}
    check_outputs(read, {"--output": [output / SET_FILE]})
    known = load_thing(mesh)
    with device_of(device):
        if frusta:
            views = _of_frusta(known, frusta, size, output, direction_of(up))
        else:
            scene = as_scene(known)
            scene.up = upward_of(mesh, up)
            whole = object_cameras(scene, size or _SIZE, projection=projection)
            cameras = read_cameras(camera) if camera else dict(zip(_AXES, whole, strict=True))
            views = _of_cameras(scene, cameras, layer)
            save(views, output)
    covered = [float(view.valid.mean()) for view in views]
    if empty := covered.count(0.0):
        print_note(f"{empty} of {len(views)} images of {printable_text(output)} are empty: the scene is out of view")
    width, height = views[0].camera.size
    share = float(np.mean(covered))
    words = f"{len(views)} depth images, {width}x{height}, {share:.1%} covered"
    tell_written([output], words, frames=len(views), size=(width, height), covered=share)


def _of_frusta(
    thing: Mesh | Gaussians, path: Path, size: int | None, output: Path, up: ArrayLike | None
) -> list[DepthImage]:
    """The images of the frusta, saved together with their painted masks."""
    found, about = load_frusta(path)
    frusta = [one if size is None else one.resized(size) for one in found]
    light = light_for(thing, -frusta[0].camera.world_from_camera[:3, 1] if up is None else up)
    views = [one.capture(thing, light) for one in with_progress(frusta, len(frusta), "Capturing")]
    save_set(output, frusta, views, **about)
    return views


def _of_cameras(scene: MeshScene | CloudScene, cameras: Mapping[str, Camera], layer: Layer) -> list[DepthImage]:
    """The images of all cameras that see the scene."""
    views = list[DepthImage]()
    for name, one in with_progress(cameras.items(), len(cameras), "Capturing"):
        try:
            views.append(scene.capture(one, layer=layer))
        except ArgumentError as error:
            if error.argument != "camera":
                raise
            print_note(f"camera {printable_text(name)} does not see the scene; left out")
    if not views:
        raise ArgumentError("--camera", "cameras that see the scene", f"{len(cameras)} that do not")
    return views
