"""Any mix of things in one picture."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from pyibr._check import describe, numbers
from pyibr.camera import Camera
from pyibr.depthmesh import DepthMesh, DepthMeshObject
from pyibr.errors import ArgumentError
from pyibr.images import DepthImage, Frame
from pyibr.light import Light
from pyibr.mesh import Mesh
from pyibr.pixelspace import pixel_size
from pyibr.relief import ReliefSurface
from pyibr.shadow import Lighting, darken, lighting
from pyibr.slicing import DepthObject, SlicedSurface, VisualHull
from pyibr.target import Target
from pyibr.warp import Edges, Sample, Side, draw, looks
from pyibr.warp_launches import Options

_APART_MOST = 64  # pixels between the depths that tell the normals of nearest samples

Thing = DepthImage | Mesh | SlicedSurface | ReliefSurface | DepthObject | VisualHull | DepthMesh | DepthMeshObject

if TYPE_CHECKING:
    from pyibr.opencl.memory import DeviceArray

    _Draw = Callable[[Target, Any, Lighting | None], None]


def render(
    things: Thing | Sequence[Thing],
    camera: Camera,
    light: Light | None = None,
    background: ArrayLike = (0, 0, 0),
    *,
    edges: Edges = "cut",
    cut_ratio: float = 1.05,
    side: Side = "front",
    sample: Sample = "linear",
) -> Frame:
    """Draw things of any kind into one picture with one depth buffer.

    Parameters
    ----------
    things : thing or sequence of things
        `DepthImage` (drawn by the epipolar warp), `Mesh`, `SlicedSurface`, `ReliefSurface`,
        `DepthObject`, `VisualHull`, `DepthMesh`, `DepthMeshObject`, and their subclasses. Where two are equally far,
        the first one stays.
    camera : Camera
        Perspective or orthographic.
    light : Light, optional
        Shades what has normals; without it things show their own colours. Depth images, and what is made of images,
        are not shaded, since their colours hold the light that they were taken in; in shadow, and where a surface is
        turned away from it, they keep its ambient part. All things cast shadows (`shadow_size=0`: none), a depth image
        from both its sides, with the `edges` that it is drawn with.
    background : (r, g, b)
        Colour where there is nothing, in the range of the frame's dtype.
    edges : {"cut", "connect"}
        Of the depth images among the things, as are the following: what they mean in `warp`.
    cut_ratio : float
    side : {"front", "back", "both"}
    sample : {"linear", "nearest"}

    Returns
    -------
    Frame
        float32 if a depth image has float32 colours, else uint8. Depth is planar z.

    Raises
    ------
    ArgumentError
        An argument has a wrong type or value.
    DeviceError
        No OpenCL device works.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> square = ibr.Mesh([[-1, -1, 3], [1, -1, 3], [-1, 1, 3], [1, 1, 3]], [[0, 1, 2], [3, 2, 1]])
    >>> frame = ibr.render(square, ibr.Camera([[20, 0, 5], [0, 20, 5], [0, 0, 1]], (11, 11)))
    >>> float(frame.depth[5, 5])
    3.0
    """
    several = list(things) if isinstance(things, Sequence) else [things]
    if not several:
        raise ArgumentError("things", "at least one thing", "an empty sequence")
    draw_view = functools.partial(_draw_depth_image, looks(sample, edges, cut_ratio, side))
    drawn = [_drawn_by(thing, draw_view) for thing in several]
    if not isinstance(camera, Camera):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ArgumentError("camera", "a pyibr.Camera", describe(camera))
    if light is not None and not isinstance(light, Light):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ArgumentError("light", "a pyibr.Light or None", describe(light))
    around = numbers("background", background, (3,))

    from pyibr.opencl.device import one_call

    in_float = any(isinstance(thing, DepthImage) and thing.color.dtype == np.float32 for thing in several)
    dtype = np.dtype(np.float32 if in_float else np.uint8)
    if (around < 0).any() or (around > (1 if in_float else 255)).any():
        raise ArgumentError("background", f"a colour in the range of {dtype}", describe(background))
    with one_call():

        def draw_all(target: Target, lit: Lighting | None = None) -> None:
            for draws, thing in zip(drawn, several, strict=True):
                draws(target, thing, lit)

        lit = None if light is None else lighting(light, [thing.bounds for thing in several], draw_all, dtype)
        target = Target(camera, dtype)
        draw_all(target, lit)
        frame = target.frame()
    if around.any():
        frame.color[~frame.valid] = around.astype(dtype)
    return frame


def _drawn_by(thing: object, draw_view: _Draw) -> _Draw:
    if isinstance(thing, DepthImage):
        return draw_view
    for kind, draws in _DRAWN.items():
        if isinstance(thing, kind):
            return draws
    kinds = ", ".join(kind.__name__ for kind in (DepthImage, *_DRAWN))
    raise ArgumentError("things", f"things of these kinds: {kinds}", describe(thing))


def _draw_depth_image(options: Options, target: Target, view: DepthImage, lit: Lighting | None) -> None:
    before = _depths_before(target, lit)
    draw(target, view.in_float if target.color.dtype == np.float32 else view, options)
    if lit is None:
        return
    grain, apart = 0.0, 1
    if not options.linear:  # in steps, less than a sample off the surface, whose slope shows over several samples
        low, high = view.bounds
        grain, pixel = (pixel_size(camera, 0.5 * (low + high)) for camera in (view.camera, target.camera))
        apart = math.ceil(min(4 * max(grain / pixel, 1), _APART_MOST)) if pixel > 0 else _APART_MOST
    darken(target, before, lit, grain=grain, apart=apart)


def _depths_before(target: Target, lit: Lighting | None) -> DeviceArray | None:
    """A copy of the depths so far, if there will be shadows on what is drawn next and there is something already."""
    from pyibr.opencl.memory import upload

    if lit is None or lit.maps is None or target.blank:
        return None
    return upload(target.depth.to_host().copy())


def _draw_mesh(target: Target, mesh: Mesh, lit: Lighting | None) -> None:
    from pyibr.raster import draw_mesh

    draw_mesh(target, mesh, lit)


def _draw_surface(target: Target, surface: SlicedSurface, lit: Lighting | None) -> None:
    from pyibr.slicing import draw_surface

    draw_surface(target, surface, lit)


def _draw_relief(target: Target, surface: ReliefSurface, lit: Lighting | None) -> None:
    from pyibr.relief import draw_relief

    draw_relief(target, surface, lit)


def _draw_object(target: Target, thing: DepthObject | VisualHull, lit: Lighting | None) -> None:
    from pyibr.slicing import draw_object

    before = _depths_before(target, lit)
    draw_object(target, thing)
    if lit is not None:
        spacing = float(thing.box.edges.max()) / thing.slices
        darken(target, before, lit, grain=spacing, apart=4, fade=0)


def _draw_depth_mesh(target: Target, thing: DepthMesh | DepthMeshObject, lit: Lighting | None) -> None:
    from pyibr.depthmesh import draw_depth_mesh

    before = _depths_before(target, lit)
    draw_depth_mesh(target, thing)
    if lit is not None:  # lights see other triangles, which may lie before these by the tolerance
        low, high = thing.bounds
        darken(target, before, lit, grain=thing.tolerance * pixel_size(target.camera, 0.5 * (low + high)))


_DRAWN: dict[type, _Draw] = {
    Mesh: _draw_mesh,
    SlicedSurface: _draw_surface,
    ReliefSurface: _draw_relief,
    DepthObject: _draw_object,
    VisualHull: _draw_object,
    DepthMesh: _draw_depth_mesh,
    DepthMeshObject: _draw_depth_mesh,
}
