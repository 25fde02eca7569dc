"""Depth images in pictures with other things, drawn by the epipolar warp."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pyibr.core.checks import Float64
from pyibr.core.pixelspace import PixelMap, camera_pair, pixel_size
from pyibr.images.depth_image import DepthImage
from pyibr.picture.drawable import Look, as_drawable
from pyibr.picture.normals import APART_MOST, grain_of_noise, showing_normals
from pyibr.picture.samples import Samples, samples_of
from pyibr.picture.shadow import Lighting, shadowed
from pyibr.picture.straighten import straightened
from pyibr.picture.target import Target
from pyibr.warp.filling import fill_holes
from pyibr.warp.launches import Options, look


def options_of(how: Look, search: bool = False) -> Options:
    """How views are to be looked at, in the kernels' terms."""
    cut_ratio = float(how.cut_ratio) if how.edges == "cut" else None
    return Options(search, how.sample == "linear", cut_ratio, how.side, how.fill, thin=how.thin)


@dataclass(frozen=True)
class WarpedImage:
    """A depth image as `render` draws it."""

    view: DepthImage
    options: Options

    @property
    def bounds(self) -> tuple[Float64, Float64]:
        """(low, high), each (3,), in the world: the box around the valid samples."""
        return self.view.bounds

    def draw(self, target: Target, lighting: Lighting | None) -> None:
        """Draw the view by the epipolar warp; into a light's map the surface itself, from both its sides."""
        options = self.options
        if target.from_light:
            options = Options(cut_ratio=options.cut_ratio, side="both", thin=options.thin)
        off, apart = self._grain(target, lighting)
        with shadowed(target, lighting, grain=off, apart=apart, draw_normals=lambda layer: self._look(layer, options)):
            seen = self._look(target, options)
        if options.fill is not None:
            fill_holes(target, [seen], options.fill)

    def _look(self, target: Target, options: Options) -> tuple[Samples, PixelMap]:
        view = self.view.in_float if target.color.dtype == np.float32 else self.view.in_color
        samples = samples_of(showing_normals(self.view) if target.of_normals else view)
        pixel_map = PixelMap(camera_pair(view.camera, target.camera), samples.low, samples.high)
        look(samples, pixel_map, target, options)
        return samples, pixel_map

    def _grain(self, target: Target, lighting: Lighting | None) -> tuple[float, int]:
        """Scene units by which samples lie off the surface, and pixels over which its slope shows; for a light."""
        if lighting is None:
            return 0.0, 1
        low, high = self.view.bounds
        middle = 0.5 * (low + high)
        noise, apart = grain_of_noise([self.view], target.camera, middle)
        if self.options.linear:
            return noise, apart
        grain, pixel = (pixel_size(camera, middle) for camera in (self.view.camera, target.camera))
        steps = math.ceil(min(4 * max(grain / pixel, 1), APART_MOST)) if pixel > 0 else APART_MOST
        return grain + noise, max(apart, steps)


@as_drawable.register
def _(thing: DepthImage, look: Look) -> WarpedImage:
    options = options_of(look)
    return WarpedImage(straightened(thing, cut_ratio=options.cut_ratio, linear=options.linear), options)
