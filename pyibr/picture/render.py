"""Rendering of things of any kind into one picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64, describe, instance_of, integer_from, numbers
from pyibr.core.errors import ArgumentError
from pyibr.images.depth_image import DepthImage
from pyibr.images.frame import Frame
from pyibr.meshes.mesh import Mesh
from pyibr.opencl.device import one_call
from pyibr.picture.deferred import light_things
from pyibr.picture.drawable import Drawable, Finishing, Guessing, as_drawable, blend_things, color_dtype_of
from pyibr.picture.light import Light
from pyibr.picture.picture import PictureParts
from pyibr.picture.shadow import lighting
from pyibr.picture.target import Target

Thing = DepthImage | Mesh | Drawable


def render(
    things: Thing | Sequence[Thing],
    camera: Camera,
    light: Light | None = None,
    background: ArrayLike = (0, 0, 0),
    *,
    samples: int = 1,
    anisotropy: int = 1,
) -> Frame:
    """Draw things of any kind into one picture with one depth buffer.

    Parameters
    ----------
    things : thing or sequence of things
        `DepthImage` (drawn as a `WarpedView` with default options), `WarpedView`, `Mesh`, `SlicedSurface`,
        `ReliefSurface`, `DepthObject`, `VisualHull`, `DepthMesh`, `DepthMeshObject`, `Gaussians`, their subclasses, and
        any other `Drawable`. Each thing has its own options. At equal depth, the first thing wins. Holes are filled
        after all things are drawn. Gaussians are blended last, all together.
    camera : Camera
        Perspective or orthographic. With a lens, the picture is drawn without distortion and then resampled along the
        pixels' rays, with depth edges kept.
    light : Light, optional
        Shades things with normals; without a light, things show their own colours. Depth images, and surfaces made from
        images, are not shaded, since their colours contain the light of the scene; in shadow, and where they face away
        from the light, they keep the ambient part. A light with `relight` shades them, too. All things cast shadows,
        unless `shadow_size` is 0. Depth images block light from both sides, with the `edges` that they are drawn with.
    background : (r, g, b)
        Colour of empty pixels, in the range of the frame's dtype.
    samples : int
        Samples per pixel, on a regular grid: 1, 4, 9, 16, 25, 36, 49 or 64. Several samples make silhouettes and depth
        edges smooth, and multiply the cost; `Frame.alpha` is the coverage of each pixel.
    anisotropy : int
        Maximum number of reads, 1 to 64, along a pixel's footprint in the colours and normal maps of meshes, sliced
        surfaces and reliefs. 1 reads once; 8 avoids blur and moire on surfaces seen at 7 degrees or more, at 1.1 to 1.9
        times the cost.

    Returns
    -------
    Frame
        The colour is float32 if a depth image has float32 colours, else uint8. Depth is planar z. `guessed` marks
        pixels that show surface which no view saw, if a closed `DepthMeshObject` is among the things.

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
    drawables = [as_drawable(thing) for thing in several]
    instance_of("camera", camera, Camera, "a pyibr.Camera")
    if light is not None and not isinstance(light, Light):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ArgumentError("light", "a pyibr.Light or None", describe(light))
    parts = PictureParts(camera, samples)
    readings = integer_from("anisotropy", anisotropy, 1, 64)
    dtype = color_dtype_of(drawables)
    around = _checked_background(background, dtype)
    with one_call():
        bounds = [_bounds_of(one) for one in drawables] if light else []  # which may take longer than the picture
        blended = [one for one in drawables if hasattr(one, "blend_together")]

        def draw_for_light(target: Target) -> None:
            for drawable in drawables:
                drawable.draw(target, None)
            target.clear()  # if nothing was drawn

        def blend_for_light(target: Target) -> None:
            blend_things(blended, target, None)

        casters = draw_for_light, blend_for_light if blended else None
        lit = None if light is None else lighting(light, several, bounds, *casters, dtype)

        def draw_all(target: Target) -> None:
            for drawable in drawables:
                drawable.draw(target, lit)
            target.clear()
            for drawable in drawables:
                if hasattr(drawable, "guess"):  # `isinstance` takes twenty times as long
                    cast("Guessing", drawable).guess(target, lit)
            light_things(target, lit)
            for drawable in drawables:
                if hasattr(drawable, "finish"):
                    cast("Finishing", drawable).finish(target)
            target.hide_guesses()
            target.show_background()
            blend_things(blended, target, lit)

        return parts.drawn(draw_all, dtype=dtype, anisotropy=readings, background=around).frame()


def _checked_background(background: ArrayLike, dtype: np.dtype[Any]) -> Float64 | None:
    """Return the colour as stored, None if it is black, or raise ArgumentError."""
    around = numbers("background", background, (3,))
    if not around.any():
        return None
    in_float = dtype == np.float32
    if (around < 0).any() or (around > (1 if in_float else 255)).any():
        raise ArgumentError("background", f"a colour in the range of {dtype}", describe(background))
    if not in_float and around.max() <= 1 and (around % 1).any():
        raise ArgumentError("background", "a colour from 0 to 255, since colours are uint8", describe(background))
    return around if in_float else np.rint(around)


def _bounds_of(drawable: Drawable) -> tuple[Float64, Float64]:
    low, high = numbers(f"{type(drawable).__name__}.bounds", drawable.bounds, (2, 3))
    if (low > high).any():
        raise ArgumentError(f"{type(drawable).__name__}.bounds", "(low, high), low <= high", f"{low} and {high}")
    return low, high
