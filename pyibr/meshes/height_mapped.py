"""A height map over a mesh's uv: the base of sliced surfaces and reliefs."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from pyibr.core.checks import Immutable, check_tiled, checked_colors, instance_of, locked, positive
from pyibr.core.errors import ArgumentError
from pyibr.meshes.heights import Float32, Wrap, Wraps, checked_height, checked_normal_map, checked_tiles, checked_wrap
from pyibr.meshes.mesh import Mesh


class Heights(Immutable):
    """Heights of a surface, the part that an animation replaces."""

    def __init__(self, values: Float32) -> None:
        self.values = values


class HeightMapped(Immutable):
    """A mesh with heights, colours and optional normals over its uv.

    Parameters
    ----------
    base, height, color, scale, tiles, normal_map, wrap
        As in `pyibr.SlicedSurface` and `pyibr.ReliefSurface`.

    Raises
    ------
    ArgumentError
        If an argument has a wrong shape, type or range, or the mesh has no uv.
    """

    def __init__(
        self,
        base: Mesh,
        height: NDArray[Any],
        color: NDArray[Any],
        scale: float,
        tiles: tuple[int, int],
        normal_map: NDArray[Any] | None,
        wrap: Wrap | Wraps,
    ) -> None:
        instance_of("base", base, Mesh, "a pyibr.Mesh")
        if base.uv is None:
            raise ArgumentError("base", "a mesh with uv", f"{base!r} without")
        self.base = base
        self.heights = Heights(checked_height(height))
        self.color = locked(checked_colors("color", color, (None, None, 3)))
        self.scale = positive("scale", scale)
        self.wrap: Wraps = checked_wrap(wrap)
        self.tiles = checked_tiles(tiles, self.wrap)
        self.normal_map = None if normal_map is None else checked_normal_map(normal_map)
        check_tiled(base.uv, self.tiles, self.height, self.color, self.normal_map)

    @property
    def height(self) -> Float32:
        """(h, w) heights in [0, 1]."""
        return self.heights.values
