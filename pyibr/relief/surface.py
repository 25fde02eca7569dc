"""A mesh with a relief carved into it (Oliveira & Policarpo 2005): its data for the kernels, and its drawing."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import instance_of, integer_from, one_of
from pyibr.core.errors import ArgumentError
from pyibr.core.undistortion import check_no_lens
from pyibr.meshes.heights import Float32, HeightMapped, Wrap, Wraps, height_at
from pyibr.meshes.mesh import Mesh
from pyibr.opencl.ahead import build_ahead
from pyibr.opencl.device import one_call
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.headers import constant
from pyibr.opencl.launch import launch
from pyibr.opencl.memory import DeviceArray, empty, upload
from pyibr.opencl.program import kernel
from pyibr.picture.shadow import Lighting
from pyibr.picture.target import Target, clear
from pyibr.raster.bins import bin_defines, bin_primitives, project
from pyibr.raster.height_mapped import color_arguments, map_buffers, normal_arguments, wrap_defines
from pyibr.relief.interior import Interior, InteriorPoint
from pyibr.relief.levels import HeightLevels, height_levels
from pyibr.relief.neighbours import mitred, sides_beside
from pyibr.relief.quadrics import VertexFrames, is_flat, juts_out, split_at_edges, split_at_mirrors, vertex_frames

Silhouette = Literal["quadric", "none"]
Distance = Literal["approximate", "exact", "perpendicular"]
Search = Literal["safe", "linear"]
Shadow = Literal["map", "search"]

_STEPS_MAX = 65536
_READ = ("vertices", "prisms", "texels", "bounds", "levels", "colors")  # buffers that the kernel reads
_SHADOWS = {"map": "MAPPED", "search": "SEARCHED"}  # the kernel's names


class ReliefSurface(HeightMapped):
    """A mesh with a relief carved into it: its triangles are drawn, and rays are searched below them.

    Parameters
    ----------
    base : Mesh
        With uv. The relief lies below the fronts of its triangles; a perspective camera may be inside the relief.
    height : (h, w) float32 in [0, 1], or uint8, uint16
        1 is the base, 0 is `scale` below it. Bilinear between texel centres; uint8 is kept in 8 bits, others in 16.
    color, tiles, normal_map, wrap
        As for `SlicedSurface`.
    scale : float
        The depth of height 0, in scene units.
    silhouette : {"quadric", "none"}
        "quadric": the relief follows a quadric fitted to each vertex's neighbours, so that rays at silhouettes come out
        again; "none": each ray finds a flat relief, as in earlier relief mapping, and the whole mesh is covered.
    distance : {"approximate", "exact", "perpendicular"}
        Measure of a ray's depth. "approximate": below the quadric, along the normal where the ray enters (equation 7).
        "exact": below the mesh itself, whose normals turn from corner to corner, so that outlines and depths equal
        those of the displaced mesh at any depth, also on creased and coarse meshes, up to a tenth of a texel; it takes
        1.4 to 2.5 times as long where the mesh bends or has edges. "perpendicular": the distance to the quadric at
        right angles to the ray (equation 6), which exceeds the depth where a ray runs into the surface; only for the
        linear search, because this measure has no bounds.
    search : {"safe", "linear"}
        "safe" misses nothing, by bounds of the heights; "linear" takes even steps, then halvings, as in the paper.
    steps, halvings : int
        Numbers for the linear search.
    shadow : {"map", "search"}
        How a light's occlusion is found. "map": with the light's shadow map, and a search of the relief where the map's
        surface differs from the picture's, as on curved bases and next to a box's edges. "search": with the paper's
        second search from each point towards the light, and the map beyond this relief. The search reads no shadow
        texels, so small tiles show no moire. But each pixel takes another search, and other things within the relief,
        below the base, cast no shadow on it.

    Raises
    ------
    ArgumentError
        If an argument has a wrong shape, type or range, or the mesh has no uv.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> corners, uv = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 0], [1, 0], [1, 1], [0, 1]]
    >>> square = ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3]], uv=uv)
    >>> height, color = np.full((4, 4), 0.25, np.float32), np.full((4, 4, 3), 200, np.uint8)
    >>> camera = ibr.Camera.look_at((0.5, 0.5, 2), (0.5, 0.5, 0), (0, 1, 0), (9, 9), fov_y=20)
    >>> frame = ibr.render(ibr.ReliefSurface(square, height, color, scale=0.2), camera)
    >>> round(float(frame.depth[4, 4]), 3)  # 0.75 * 0.2 below the square
    2.15
    """

    def __init__(
        self,
        base: Mesh,
        height: NDArray[Any],
        color: NDArray[Any],
        scale: float,
        *,
        tiles: tuple[int, int] = (1, 1),
        normal_map: NDArray[Any] | None = None,
        silhouette: Silhouette = "quadric",
        distance: Distance = "exact",
        search: Search = "safe",
        steps: int = 32,
        halvings: int = 6,
        shadow: Shadow = "map",
        wrap: Wrap | Wraps = "repeat",
    ) -> None:
        super().__init__(base, height, color, scale, tiles, normal_map, wrap)
        self._height_bytes = 1 if getattr(height, "dtype", None) == np.uint8 else 2
        self.silhouette: Silhouette = one_of("silhouette", silhouette, Silhouette)
        self.distance: Distance = one_of("distance", distance, Distance)
        self.search: Search = one_of("search", search, Search)
        if distance == "perpendicular" and search == "safe":
            raise ArgumentError("search", '"linear" with distance="perpendicular", which has no bounds', '"safe"')
        self.shadow: Shadow = one_of("shadow", shadow, Shadow)
        self.steps = integer_from("steps", steps, 1, _STEPS_MAX)
        self.halvings = integer_from("halvings", halvings, 0, _STEPS_MAX)

    def __repr__(self) -> str:
        h, w = self.height.shape
        return f"<ReliefSurface {len(self.base.faces)} triangles, heights {w}x{h}>"

    @property
    def bounds(self) -> tuple[NDArray[Any], NDArray[Any]]:
        """(low, high), each (3,), in the world: the box around the relief.

        Rays that continue below an open border of the base may hit the relief outside this box.
        """
        low, high = self.base.bounds
        reach = np.abs(self.offsets).max(axis=0)
        return low - reach, high + reach

    def draw(self, target: Target, lighting: Lighting | None) -> None:
        """Draw the relief, lit by its normals."""
        draw_relief(target, self, lighting)

    @cached_property
    def drawn(self) -> Mesh:
        """The base, with vertices doubled at hard edges and where mirrored uv meet; the base's vertices come first."""
        return split_at_mirrors(split_at_edges(self.base))

    @cached_property
    def frames(self) -> VertexFrames:
        """The drawn vertices' frames and quadrics."""
        return vertex_frames(self.drawn, self.tiles)

    @property
    def bends(self) -> bool:
        """Tell whether rays follow curved quadrics, or walk from triangle to triangle around edges."""
        return self.silhouette == "quadric" and (
            bool(self.frames.quadrics.any()) or (self.distance == "exact" and not self.is_flat)
        )

    @cached_property
    def is_flat(self) -> bool:
        """Tell whether the base has neither curvature nor hard edges that jut out."""
        normals = self.frames.normals
        return is_flat(self.drawn, normals) and not juts_out(self.drawn, normals)

    @cached_property
    def vertex_rows(self) -> NDArray[np.float32]:
        """(N, VERTEX_FLOATS) data of each drawn vertex for the kernels (kernels/relief/entry.h)."""
        frames = self.frames
        parts = [self._uv, frames.normals, frames.gradients.reshape(-1, 6), frames.quadrics]
        values = np.concatenate(parts, axis=1, dtype=np.float32)
        unused = int(constant("relief/entry.h", "VERTEX_FLOATS")) - values.shape[1]
        return np.pad(values, ((0, 0), (0, unused)))

    @property
    def _uv(self) -> NDArray[np.float64]:
        """(N, 2) uv of the drawn vertices, tiles included."""
        return np.asarray(self.drawn.uv, np.float64) * self.tiles

    @cached_property
    def beside(self) -> NDArray[np.int32]:
        """(M, 3) for each side of the drawn triangles the neighbouring triangle's side; see `sides_beside`."""
        return sides_beside(self.drawn.vertices.astype(np.float64), self.drawn.faces)

    @cached_property
    def offsets(self) -> NDArray[np.float64]:
        """(N, 3) vectors from the relief's bottom below the drawn vertices to the vertices."""
        return self.scale * mitred(self.drawn.vertices.astype(np.float64), self.frames.normals, self.drawn.faces)

    @cached_property
    def prism_rows(self) -> NDArray[np.float32]:
        """(M, PRISM_FLOATS) data of each drawn triangle for walks (kernels/relief/walk.h)."""
        mesh = self.drawn
        corners = np.concatenate([mesh.vertices, self.offsets, self._uv], axis=1, dtype=np.float32)
        rows = np.zeros((len(mesh.faces), int(constant("relief/walk.h", "PRISM_FLOATS"))), np.float32)
        rows[:, :24] = corners[mesh.faces].reshape(-1, 24)
        rows[:, 24:27] = self.beside.view(np.float32)
        return rows

    @cached_property
    def interior(self) -> Interior:
        """Searches for the point of the base above a point within the relief."""
        return Interior(self.drawn.vertices, self.offsets, self._uv, self.drawn.faces, self.beside)

    def interior_point(self, camera: Camera) -> InteriorPoint | None:
        """Locate a camera's eye within the relief, below the base and above the relief's surface.

        Returns None if the eye is outside, or the camera is orthographic.
        """
        eye, (low, high) = camera.center, self.bounds
        if camera.projection == "orthographic" or (eye < low).any() or (eye > high).any():
            return None
        place = self.interior.interior_point(eye)
        return place if place and place.depth < 1 - height_at(self.height, place.uv, self.wrap) else None

    @property
    def planar_vertices(self) -> int:
        """Number of vertices whose neighbours determine no quadric: there the relief is flat."""
        return int(self.frames.planar[: len(self.base.vertices)].sum())

    @cached_property
    def levels(self) -> HeightLevels:
        """Levels and bounds of the heights."""
        return height_levels(self.height, self._height_bytes, self.wrap)

    def tile_coordinates(self, camera: Camera) -> Float32:
        """Compute the tile coordinates of the relief for each pixel of a camera's picture.

        Returns
        -------
        (H, W, 2) float32
            u and v in [0, 1], tiles included, in the picture that `render` makes of this relief alone. NaN where there
            is nothing. Beyond a clamped map, the coordinates of its border.
        """
        instance_of("camera", camera, Camera, "a pyibr.Camera")
        check_no_lens("camera", camera)

        with one_call():
            places = empty((camera.height, camera.width, 2), np.float32)
            clear(places, math.nan)
            draw_relief(Target(camera, np.dtype(np.uint8)), self, None, places=places)
            return places.to_host()


def draw_relief(
    target: Target,
    surface: ReliefSurface,
    lit: Lighting | None,
    counters: DeviceArray | None = None,
    places: DeviceArray | None = None,
) -> None:
    """Draw a relief into the target.

    `counters`, (H, W, 2) int32, count each pixel's searches, and their steps and halvings (safe searches: cells).
    `places`, (H, W, 2) float32, receive u and v in the tile, for a blank target.
    """
    buffers = cached_on_device(surface, "buffers", lambda: _buffers(surface))
    near = target.near(surface.base.bounds)
    place = None if target.from_light else surface.interior_point(target.camera)
    bends = surface.bends or place is not None
    faces, projected = buffers["faces"], project(target, buffers["points"], near)
    backs = target.from_light or (bends and surface.distance != "exact")  # rays leave the relief at back sides
    defines = bin_defines(3) | target.color_defines | target.filter_defines
    defines |= _defines_of(surface, walks=target.from_light or place is not None)
    more: dict[str, Any] = dict(target.filter_arguments)
    if lit is not None:
        defines |= lit.defines
        more |= {**normal_arguments(surface, buffers, buffers["vertices"]), **lit.arguments()}
        if lit.maps is not None:
            more |= {"hidden_by": constant("relief/shadows.h", _SHADOWS[surface.shadow]), "flat_base": surface.is_flat}
    if target.from_light:
        defines["DEPTH_ALONE"] = 1
    if place is not None:
        defines["WITHIN"] = 1
        more |= {"eye_triangle": place.triangle, "eye_depth": place.depth}
    if counters is not None:
        defines["COUNTERS"] = 1
        more["counters"] = counters
    if places is not None:
        defines["UV_WRITTEN"] = 1
        more["uvs"] = places
    build_ahead("relief/relief.cl", "draw_relief", compiled=True, **defines)
    bins = bin_primitives(target, faces, projected, near, "both" if backs else "front")
    launch(
        kernel("relief/relief.cl", "draw_relief", **defines),
        bins.grid,
        faces=faces,
        **{name: buffers[name] for name in _READ},
        level_count=len(surface.levels.table),
        **color_arguments(surface, target.camera),
        scale=surface.scale,
        quadric=bends,
        search=constant("relief/entry.h", surface.search.upper()),
        steps=surface.steps,
        halvings=surface.halvings,
        blank=target.blank,
        **bins.arguments,
        **target.outputs(),
        **more,
    )
    target.blank = False


def _defines_of(surface: ReliefSurface, walks: bool) -> dict[str, int]:
    """Return the kernels' defines for a surface's distance (exact if rays walk), bytes per height, and wrap modes."""
    distance = int(constant("relief/ray.h", "EXACT" if walks else surface.distance.upper()))
    defines = {"DISTANCE": distance, "HEIGHT_BYTES": surface.levels.height_bytes}
    if "clamp" in surface.wrap:
        return defines | wrap_defines(surface.wrap)
    return defines | {"POWERS_OF_TWO": int(all(n & (n - 1) == 0 for n in surface.height.shape))}


def _buffers(surface: ReliefSurface) -> dict[str, DeviceArray]:
    """Upload the surface to the current device."""
    base, levels = surface.drawn, surface.levels
    made = {
        "points": upload(base.vertices),
        "faces": upload(base.faces),
        "prisms": upload(surface.prism_rows),
        "vertices": upload(surface.vertex_rows),
        "texels": upload(levels.texels),
        "bounds": upload(levels.bounds.view(np.uint32)),
        "levels": upload(levels.table),
    }
    return made | map_buffers(surface)
