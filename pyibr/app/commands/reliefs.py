"""`pyibr relief` and `pyibr slices`: pictures and turntables of a mesh with a height map."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer

from pyibr.app.commands.exposure import Exposure
from pyibr.app.commands.heights import HEIGHT_HELP, MapOptions
from pyibr.app.commands.outputs import VideoOptions
from pyibr.app.commands.things import customary_up
from pyibr.app.commands.turntable import Turntable, TurntableOptions
from pyibr.app.options import DeviceName, ExposureOption, device_of
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError
from pyibr.meshes.heights import HeightMapped
from pyibr.meshes.mesh import Mesh
from pyibr.picture.light import Light
from pyibr.relief import ReliefSurface
from pyibr.relief.surface import Distance, Shadow, Silhouette
from pyibr.slicing import SlicedSurface
from pyibr.slicing.surface import Slicing

_MeshFile = Annotated[Path, typer.Argument(metavar="MESH", help="With uv: GLB, OBJ, PLY ...")]
_HeightFile = Annotated[Path, typer.Argument(metavar="HEIGHT", help=HEIGHT_HELP)]
_Output = Annotated[Path, typer.Option("--output", "-o", help="A picture; with --frames OUT_0000, ... or a video")]


class ShadingOptions(NamedTuple):
    """Options of the light on a surface, and of the filtering of its maps."""

    light: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y Z", help="Direction of the light in the camera's axes: right, down, forward"),
    ] = None
    lamp: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="X Y Z", help="Position of a lamp relative to the camera, in scene units; with --light a spot"
        ),
    ] = None
    ambient: Annotated[float, typer.Option(help="Share of ambient light, 0 to 1")] = 0.25
    shadows: Annotated[bool, typer.Option("--shadows/--no-shadows", help="Whether shadows are cast")] = True
    anisotropy: Annotated[int, typer.Option(help="Texture reads a pixel for oblique surfaces, 1 to 64")] = 8

    def light_before(self, camera: Camera) -> Light | None:
        """The light, if an option asks for one. It is fixed to this camera and does not turn with a turntable."""
        if self.light is None and self.lamp is None:
            return None
        turned = camera.world_from_camera[:3, :3]
        direction = None if self.light is None else turned @ self.light
        position = None if self.lamp is None else camera.center + turned @ self.lamp
        return Light(
            direction=direction, position=position, ambient=self.ambient, shadow_size=2048 if self.shadows else 0
        )


class SurfaceOptions(NamedTuple):
    """Options of pictures of a mesh with a height map."""

    maps: MapOptions = MapOptions()
    turn: TurntableOptions = TurntableOptions()
    shading: ShadingOptions = ShadingOptions()
    exposure: ExposureOption = 0.0
    video: VideoOptions = VideoOptions()
    device: DeviceName = None


def relief(
    mesh: _MeshFile,
    height: _HeightFile,
    output: _Output,
    *,
    silhouette: Annotated[
        Silhouette, typer.Option(help="Outline of the relief; none: the whole mesh is covered")
    ] = "quadric",
    distance: Annotated[Distance, typer.Option(help="Measure a ray's depth from the mesh, or from quadrics")] = (
        "exact"
    ),
    shadow: Annotated[Shadow, typer.Option(help="Shadows by a shadow map, or by a search of the relief")] = "map",
    options: SurfaceOptions,
) -> None:
    """Carve a height map into a mesh of few triangles, white at its surface and black below, and draw it."""
    how = {"silhouette": silhouette, "distance": distance, "shadow": shadow}
    if distance == "perpendicular":
        how["search"] = "linear"
    _draw(ReliefSurface, how, mesh, height, output, options)


def slices(
    mesh: _MeshFile,
    height: _HeightFile,
    output: _Output,
    *,
    slices: Annotated[
        str, typer.Option(metavar="N", help="Number of slices; view: as many as each picture needs, exact between them")
    ] = "view",
    slicing: Annotated[Slicing, typer.Option(help="Orientation of the slices")] = "orthogonal",
    options: SurfaceOptions,
) -> None:
    """Raise a mesh by a height map, black at its surface and white above, and draw it by slices."""
    if slices != "view" and not slices.isdecimal():
        raise ArgumentError("--slices", "a whole number, or view", slices)
    how = {"slices": int(slices) if slices.isdecimal() else slices, "slicing": slicing}
    _draw(SlicedSurface, how, mesh, height, output, options)


def _draw(
    kind: Callable[..., HeightMapped],
    how: dict[str, Any],
    mesh: Path,
    height: Path,
    output: Path,
    options: SurfaceOptions,
) -> None:
    maps, shading = options.maps, options.shading
    read = {"MESH": [mesh], "HEIGHT": [height], "--color": [maps.color] if maps.color else []}
    with device_of(options.device):
        table = Turntable(output, options.turn, options.video, read)
        base = Mesh.load(mesh)
        with Exposure(options.exposure) as exposed:
            surface = maps.displace(base, height, exposed)(kind, **how)
        points = base.vertices.astype(np.float64)
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        ball = middle, float(np.linalg.norm(points - middle, axis=1).max()) + surface.scale
        table.draw(surface, ball, up=customary_up(mesh), light=shading.light_before, anisotropy=shading.anisotropy)
