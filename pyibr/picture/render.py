"""Any mix of things in one picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64, describe, instance_of, numbers, whole_from
from pyibr.core.errors import ArgumentError
from pyibr.images.depth_image import DepthImage
from pyibr.images.frame import Frame
from pyibr.meshes.mesh import Mesh
from pyibr.opencl.device import one_call
from pyibr.picture.antialiasing import averaged, checked_side, finer
from pyibr.picture.drawable import Drawable, Edges, Fill, Look, Sample, Side, as_drawable
from pyibr.picture.light import Light
from pyibr.picture.panes import joined, pane_cameras
from pyibr.picture.shadow import Lighting, lighting
from pyibr.picture.target import Target

Thing = DepthImage | Mesh | Drawable


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
    fill: Fill | None = None,
    thin: bool = False,
    samples: int = 1,
    anisotropy: int = 1,
) -> Frame:
    """Draw things of any kind into one picture with one depth buffer.

    Parameters
    ----------
    things : thing or sequence of things
        `DepthImage` (drawn by the epipolar warp), `Mesh`, `SlicedSurface`, `ReliefSurface`,
        `DepthObject`, `VisualHull`, `DepthMesh`, `DepthMeshObject`, their subclasses, and whatever else is a
        `Drawable`. Where two are equally far, the first one stays.
    camera : Camera
        Perspective or orthographic. With a lens, the picture is drawn without it and then read where the pixels' rays
        pass, with depth edges kept.
    light : Light, optional
        Shades what has normals; without it things show their own colours. Depth images, and what is made of images,
        are not shaded, since their colours hold the light that they were taken in; in shadow, and where a surface is
        turned away from it, they keep its ambient part. A light with `relight` shades them, too. All things cast
        shadows (`shadow_size=0`: none), a depth image from both its sides, with the `edges` that it is drawn with.
    background : (r, g, b)
        Colour where there is nothing, in the range of the frame's dtype.
    edges : {"cut", "connect"}
        Of the depth images among the things, as are the following: what they mean in `warp`.
    cut_ratio : float
    side : {"front", "back", "both"}
    sample : {"linear", "nearest"}
    fill : {None, "background", "smooth", "inpaint"}
        Holes are filled once the last depth image is drawn, before things that come after it, from what is in the
        picture by then. `valid` stays False there, and `background` is for what is not filled.
    thin : bool
        As in `warp`; thin things cast shadows as wide as they are drawn, too.
    samples : int
        A pixel, on a regular grid within it: 1, 4, 9, 16, 25, 36, 49 or 64. Several make silhouettes and depth edges
        smooth, at as many times the cost; `Frame.alpha` tells how much of each pixel the things cover.
    anisotropy : int
        1 to 64: how often the colours and normal maps of meshes, sliced surfaces and reliefs are read for a pixel at
        most, along what it covers of them. 1 reads once; 8 shows surfaces that are seen at 7 degrees or more without
        blur and moire, at 1.1 to 1.9 times the cost.

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
    look = Look(sample, edges, cut_ratio, side, fill, thin)
    drawables = _drawables(several, look)
    instance_of("camera", camera, Camera, "a pyibr.Camera")
    if light is not None and not isinstance(light, Light):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ArgumentError("light", "a pyibr.Light or None", describe(light))
    around = numbers("background", background, (3,))
    side_by_side = checked_side(samples)
    fine = finer(camera, side_by_side)
    readings = whole_from("anisotropy", anisotropy, 1, 64)

    in_float = any(isinstance(thing, DepthImage) and thing.color.dtype == np.float32 for thing in several)
    dtype = np.dtype(np.float32 if in_float else np.uint8)
    if (around < 0).any() or (around > (1 if in_float else 255)).any():
        raise ArgumentError("background", f"a colour in the range of {dtype}", describe(background))
    if not in_float and around.max() <= 1 and (around % 1).any():
        raise ArgumentError("background", "a colour from 0 to 255, as of the things", describe(background))
    with one_call():

        def draw_all(target: Target, lit: Lighting | None = None) -> None:
            for drawable in drawables:
                drawable.draw(target, lit)
            target.clear()  # if none has written anything

        bounds = [_bounds_of(one) for one in drawables]
        lit = None if light is None else lighting(light, several, look, bounds, draw_all, dtype)
        targets = [Target(one, dtype, anisotropy=readings) for one in pane_cameras(fine)]
        for target in targets:
            draw_all(target, lit)
        frame = averaged(joined(targets, fine, sample == "linear"), camera, side_by_side).frame()
    if around.any():
        _put_over(frame, around)
    return frame


def _put_over(frame: Frame, background: Float64) -> None:
    """Let a colour show where there is nothing."""
    color, dtype = frame.color, frame.color.dtype

    def stored(values: Float64) -> NDArray[Any]:
        return values.astype(dtype) if dtype == np.float32 else np.rint(values).clip(0, 255).astype(dtype)

    color[np.isnan(frame.depth)] = stored(background)
    if frame.alpha is not None:
        partly = (frame.alpha > 0) & (frame.alpha < 1)
        color[partly] = stored(color[partly] + (1 - frame.alpha[partly, None]) * background)


def _drawables(things: Sequence[Thing], look: Look) -> list[Drawable]:
    """Only the last of the depth images fills holes: what is made up hides nothing that another one sees."""
    last = max((number for number, thing in enumerate(things) if isinstance(thing, DepthImage)), default=-1)
    no_fill = replace(look, fill=None)
    return [as_drawable(thing, look if number == last else no_fill) for number, thing in enumerate(things)]


def _bounds_of(drawable: Drawable) -> tuple[Float64, Float64]:
    low, high = numbers(f"{type(drawable).__name__}.bounds", drawable.bounds, (2, 3))
    if (low > high).any():
        raise ArgumentError(f"{type(drawable).__name__}.bounds", "(low, high), low <= high", f"{low} and {high}")
    return low, high
