"""Height maps on meshes: their options, and the surfaces made from both."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar, cast

import numpy as np
import typer
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.app.commands.exposure import Exposure
from pyibr.core.checks import positive
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.io import read_relief_map
from pyibr.meshes.heights import Wrap, Wraps, checked_tiles, checked_wrap
from pyibr.meshes.mesh import Mesh

_Surface = TypeVar("_Surface")

HEIGHT_HELP = "A height map over the mesh's uv: gray, white is high; or a relief map with heights in its alpha"


class MapOptions(NamedTuple):
    """Options of the maps on a mesh."""

    color: Annotated[Path | None, typer.Option(help="An image over the same uv; default: the mesh's own")] = None
    scale: Annotated[float | None, typer.Option(help="The displacement of height 1, in scene units")] = None
    tiles: Annotated[
        tuple[int, int], typer.Option(metavar="U V", help="Repetitions of the height map, and of --color")
    ] = (1, 1)
    color_tiles: Annotated[
        tuple[int, int] | None,
        typer.Option(metavar="U V", help="Repetitions of the colours; default: --tiles with --color, else 1 1"),
    ] = None
    wrap: Annotated[
        str,
        typer.Option(
            metavar="HOW", help="Height and color outside uv 0 to 1: repeat or clamp; repeat,clamp for u and v"
        ),
    ] = "repeat"
    deep: Annotated[bool, typer.Option("--deep", help="White in the height map is deep, not high")] = False

    def displace(self, mesh: Mesh, height: Path, exposure: Exposure) -> Callable[..., Any]:
        """Read the maps; return a function that makes a surface from its class and the class's options."""
        if self.scale is None:
            across = float(np.ptp(mesh.vertices, axis=0).max())
            expected = f"the displacement of height 1 in scene units (the mesh is {across:.3g} across)"
            raise ArgumentError("--scale", expected, "none")
        positive("--scale", self.scale)
        first, *second = self.wrap.split(",", 1)
        wrap: Wraps = checked_wrap((cast("Wrap", first), cast("Wrap", second[0] if second else first)))
        heights, normals = _heights(height)
        if self.deep:
            heights = (1 if heights.dtype.kind == "f" else np.iinfo(heights.dtype).max) - heights
        color = np.full((1, 1, 3), 200, np.uint8) if mesh.texture is None else mesh.texture
        if self.color is not None:
            color = exposure.read(self.color)
        tiles, is_own = checked_tiles(self.tiles, wrap), self.color is None and mesh.texture is not None
        of_color = checked_tiles(self.color_tiles or ((1, 1) if is_own else tiles), wrap, "--color-tiles")
        common = np.gcd(tiles, of_color)  # repetitions of all maps; the rest is in the images

        def repeated(image: NDArray[Any], times: tuple[int, int]) -> NDArray[Any]:
            return np.tile(image, (times[1] // common[1], times[0] // common[0], 1)[: image.ndim])

        shown, raised = repeated(color, of_color), repeated(heights, tiles)
        bumps = None if normals is None else repeated(normals, tiles)

        def made(kind: Callable[..., _Surface], **how: Any) -> _Surface:
            about = {"tiles": tuple(common.tolist()), "normal_map": bumps, "wrap": wrap}
            return kind(mesh, raised, shown, self.scale, **about, **how)

        return made


def _heights(path: Path) -> tuple[NDArray[Any], NDArray[np.float32] | None]:
    """The heights of a gray picture; or the heights in a relief map's alpha and the normals in its colours."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # alpha of a relief map is height, not transparency
        stored = ibr.read_color(path)
    if (stored == stored[..., :1]).all():
        return stored[..., 0], None
    try:
        normals, heights = read_relief_map(path)
    except FileFormatError:  # it has no alpha
        return stored[..., 0], None
    return (heights, normals) if np.ptp(heights) else (stored[..., 0], None)
