"""A mesh displaced along its normals by a height map, by slices (Kautz & Seidel 2001, section 3)."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import check_tiled, checked_bool, one_of, positive
from pyibr.core.pixelspace import pixel_size
from pyibr.meshes.heights import HeightMapped, Heights, Wrap, Wraps, checked_height, height_pairs
from pyibr.meshes.mesh import Mesh
from pyibr.opencl.ahead import build_ahead
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.headers import constant
from pyibr.opencl.launch import launch
from pyibr.opencl.memory import DeviceArray, upload
from pyibr.opencl.program import kernel
from pyibr.picture.shadow import Lighting
from pyibr.picture.target import Target
from pyibr.raster.bins import bin_defines, bin_primitives, project
from pyibr.raster.height_mapped import color_arguments, map_buffers, normal_arguments, wrap_defines
from pyibr.slicing.prisms import Volume, extruded
from pyibr.slicing.spacing import SLICES_MAX, Slices, checked_halvings, checked_slices, slices_text

Slicing = Literal["surface", "orthogonal", "screen"]
AlphaTest = Literal["inside", "at_least", "band"]

_READ = ("corners", "points", "uv", "frames", "tilts", "ends", "gradients", "heights", "colors")  # read by each picture


class SlicedSurface(HeightMapped):
    """A mesh displaced along its normals by a height map, drawn by slices.

    Parameters
    ----------
    base : Mesh
        With uv; a single polygon or any surface. Vertices move along their normals, or along smooth normals if the
        mesh has none. Vertices at one place with several normals, as at hard edges, move along the mean normal, so that
        the surface stays closed. Light uses the base's own normals.
    height : (h, w) float32 in [0, 1], or uint8, uint16
        0 is the base, which only `test="at_least"` draws; 1 is `scale` above it. Heights are bilinear between texel
        centres, and are kept in 16 bits.
    color : (h', w', 3) uint8, or float32 in [0, 1]
        Over the same uv.
    scale : float
        The displacement of height 1, in scene units.
    tiles : (int, int)
        Number of repetitions of height and colour along u and v.
    slices : int or "view"
        Number over the displacement volume's height. Slices across the surface and parallel to the screen have the same
        spacing, `scale / slices` (section 3.4). "view": as many as the picture needs over each triangle. Where the
        map's texels are larger than pixels, and where it takes no longer, there are no slices: the ray is intersected
        with the surface in each cell of the map, which misses no part of it, however thin. Elsewhere slices are a
        pixel's width apart. If fewer than 256 slices fit, they are closer, by up to a factor of twelve. `halvings` then
        bring points within an eighth of a pixel of the surface, and within 1/512 of `scale`. The test "band" always
        has slices, at least half a texel apart.
    slicing : {"orthogonal", "surface", "screen"}
        "surface": parallel to the base only (section 3.1), with gaps when seen from the side; "orthogonal":
        along the normal or one of two directions in the surface, whichever faces the viewer most (section 3.2), for
        each triangle and bin of pixels; "screen": parallel to the view plane (section 3.3).
    test : {"inside", "at_least", "band"}
        Where a slice at height h is drawn. "inside": where the map's height is more than h, so that 0 masks the surface
        out; "at_least": where it is at least h (Dietrich), which also draws the base; "band": where it is at least h
        and less than h + `band` (Schaufler), which opens gaps between neighbours of very different heights.
    normal_map : (h'', w'', 3) float32 or uint8, optional
        Unit normals in tangent space, for lights: x along u, y along v (down the image), z along the normal. Bytes
        are decoded as x / 127.5 - 1; if the map's green grows upwards, pass 255 - green (`pyibr.io.read_relief_map`
        does so). Without a map, normals follow from the slopes of the heights.
    clipped : bool
        False lets slices parallel to the screen also test points outside the displacement volume, like the paper's
        simplest variant (section 3.3): the same picture with more alpha tests, for comparison.
    halvings : int
        Number of halvings of the interval between a ray's first slice that passes the test and the slice before, to
        approach the surface; 0 leaves points on the slices, as in the paper.
    band : float, optional
        Thickness of the band of the test "band", as a height: gaps open between neighbours that differ by more. By
        default one slice spacing, which misses nothing of flat regions; a thinner band leaves gaps there.
    wrap : {"repeat", "clamp"}, or a pair of these
        How heights, colours and normals continue beyond the centres of the outermost texels. "repeat" continues on the
        other side of the map; "clamp" continues with the values at the border, for maps that do not tile, and needs
        `tiles` of 1. A pair sets u and v separately: ("repeat", "clamp") for maps of a globe.

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
    >>> height, color = np.full((4, 4), 0.48, np.float32), np.full((4, 4, 3), 200, np.uint8)
    >>> surface = ibr.SlicedSurface(square, height, color, scale=0.2, slices=20, slicing="surface")
    >>> camera = ibr.Camera.look_at((0.5, 0.5, 2), (0.5, 0.5, 0), (0, 1, 0), (9, 9), fov_y=20)
    >>> round(float(ibr.render(surface, camera).depth[4, 4]), 3)  # the highest slice below 0.096 is at 0.09
    1.91
    """

    def __init__(
        self,
        base: Mesh,
        height: NDArray[Any],
        color: NDArray[Any],
        scale: float,
        *,
        tiles: tuple[int, int] = (1, 1),
        slices: Slices = 64,
        slicing: Slicing = "orthogonal",
        test: AlphaTest = "inside",
        normal_map: NDArray[Any] | None = None,
        clipped: bool = True,
        halvings: int = 0,
        band: float | None = None,
        wrap: Wrap | Wraps = "repeat",
    ) -> None:
        super().__init__(base, height, color, scale, tiles, normal_map, wrap)
        self.slices: Slices = checked_slices(slices)
        self.slicing: Slicing = one_of("slicing", slicing, Slicing)
        self.test: AlphaTest = one_of("test", test, AlphaTest)
        self.clipped = checked_bool("clipped", clipped)
        self.halvings = checked_halvings(halvings)
        self.band = None if band is None else positive("band", band)

    def __repr__(self) -> str:
        h, w = self.height.shape
        return f"<SlicedSurface {len(self.base.faces)} triangles, heights {w}x{h}, {slices_text(self.slices)}>"

    def with_height(self, height: NDArray[Any]) -> SlicedSurface:
        """Return the same surface with other heights, for animations; everything else is shared, on the device too."""
        made = object.__new__(SlicedSurface)
        other = Heights(checked_height(height))
        assert self.base.uv is not None
        check_tiled(self.base.uv, self.tiles, other.values)
        made.__dict__.update(self.__dict__, volume=self.volume, device_cache=self.device_cache, heights=other)
        return made

    @property
    def bounds(self) -> tuple[NDArray[Any], NDArray[Any]]:
        """(low, high), each (3,), in the world: the box around the displacement volume."""
        return self.volume.bounds

    def draw(self, target: Target, lighting: Lighting | None) -> None:
        """Draw the slices, lit by their normals."""
        draw_surface(target, self, lighting)

    @cached_property
    def volume(self) -> Volume:
        """The displacement volume."""
        return extruded(self.base, self.scale, self.tiles)


def draw_surface(
    target: Target, surface: SlicedSurface, lit: Lighting | None, counters: DeviceArray | None = None
) -> None:
    """Draw a sliced surface into the target; `counters`, (H, W) int32, gains the alpha tests of each pixel."""
    buffers = {
        **cached_on_device(surface, "volume", lambda: _volume_buffers(surface)),
        "heights": cached_on_device(
            surface.heights, "pairs", lambda: upload(height_pairs(surface.height, surface.wrap))
        ),
    }
    near = target.near(surface.volume.bounds)
    projected = project(target, buffers["points"], near, corners=6)
    slices = _slices_in(surface, target.camera)
    defines = bin_defines(6) | target.color_defines | target.filter_defines | wrap_defines(surface.wrap)
    more: dict[str, Any] = dict(target.filter_arguments)
    if lit is not None:
        defines |= lit.defines
        more |= {
            **normal_arguments(surface, buffers, buffers["gradients"]),
            **lit.arguments(bias=1.5 * surface.scale / slices),
        }
        more["normals"] = buffers["normals"]
    if not surface.clipped and surface.slicing == "screen":
        defines["UNCLIPPED"] = 1
    if counters is not None:
        defines["COUNTERS"] = 1
        more["counters"] = counters
    build_ahead("slicing/surface.cl", "draw_surface", compiled=True, **defines)
    bins = bin_primitives(target, buffers["corners"], projected, near, sort=True)
    launch(
        kernel("slicing/surface.cl", "draw_surface", **defines),
        bins.grid,
        **{name: buffers[name] for name in _READ},
        spacing=surface.scale / slices,
        slices=slices,
        by_view=surface.slices == "view",
        halvings=surface.halvings,
        slicing=constant("slicing/prisms.h", surface.slicing.upper()),
        test=constant("slicing/prisms.h", surface.test.upper()),
        band=surface.band or 0.0,
        map_width=surface.height.shape[1],
        map_height=surface.height.shape[0],
        **color_arguments(surface, target.camera),
        blank=target.blank,
        **bins.arguments,
        **target.outputs(),
        **more,
    )
    target.blank = False


def _slices_in(surface: SlicedSurface, camera: Camera) -> int:
    """Return the number of slices over the displacement; with "view", the number for the middle of the volume."""
    if surface.slices != "view":
        return surface.slices
    low, high = surface.volume.bounds
    pixel = pixel_size(camera, 0.5 * (low.astype(np.float64) + high))
    return int(np.clip(surface.scale / max(pixel, 1e-30), 1, SLICES_MAX))


def _volume_buffers(surface: SlicedSurface) -> dict[str, DeviceArray]:
    """Upload the surface without its heights to the current device."""
    names = ("points", "uv", "corners", "frames", "tilts", "ends", "gradients", "normals")
    return {name: upload(getattr(surface.volume, name)) for name in names} | map_buffers(surface)
