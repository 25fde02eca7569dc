"""Depth images that `render` draws, by the warp of Schaufler & Priglinger (1999)."""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any, Literal, TypedDict, cast

import numpy as np

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64, Immutable, checked_bool, cut_ratio_from, describe, number_from, one_of
from pyibr.core.errors import ArgumentError
from pyibr.core.optional import opencv
from pyibr.core.pixelspace import PixelMap, Rectangle, camera_pair, pixel_size
from pyibr.images.depth_image import DepthImage, Features, Side
from pyibr.images.exposure import exposure_gains
from pyibr.images.frame import PixelClass
from pyibr.images.order import order_of
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.memory import DeviceArray, upload
from pyibr.picture.deferred import NO_ENTRY, Entry, entry_for
from pyibr.picture.drawable import as_drawable
from pyibr.picture.normals import NEIGHBOUR_OFFSET_MAX, noise_bias, showing_normals
from pyibr.picture.samples import Samples, samples_of
from pyibr.picture.shadow import Lighting
from pyibr.picture.surface import Surface, surface_of
from pyibr.picture.target import Target, color_defines
from pyibr.picture.undistort import Interpolation, undistorted
from pyibr.warp.blending import Blend, Layer, blend
from pyibr.warp.features import find_corners, gather_features
from pyibr.warp.filling import Fill, fill_holes
from pyibr.warp.launches import Options, Pass, build_ahead_of_warp, defines_of, forward_warp
from pyibr.warp.looked_through import surfaces_of

Method = Literal["epipolar", "search", "forward"]
Edges = Literal["connect", "cut"]

_SPLAT_MAX = 64.0
_LENS_CUT_RATIO = 1.05  # undistortion does not interpolate between neighbours whose depths have a greater ratio


class WarpOptions(TypedDict, total=False):
    """Options of a `WarpedView`, which `pyibr.warp` accepts, too."""

    method: Method
    interpolation: Interpolation
    edges: Edges
    cut_ratio: float | None
    side: Side
    fill: Fill | None
    thin: bool
    splat: float
    blend: Blend


class WarpedView(Immutable):
    """One or several depth images, drawn by the warp.

    A depth image defines a surface: the grid of its samples, extended to the borders of the outermost pixels. Each
    cell is split from its upper right to its lower left corner. A target pixel shows the first surface on its ray.
    `pyibr.warp` draws one such object alone; `pyibr.render` draws it together with other objects, and draws a
    `DepthImage` as a `WarpedView` with default options.

    Parameters
    ----------
    views : DepthImage or sequence of DepthImage
        The sources, perspective or orthographic, with colours of one dtype, or all without colours. Their buffers stay
        on the device, so that drawing the same object again is cheaper.
    method : {"epipolar", "search", "forward"}
        "epipolar" sweeps whole epipolar lines: O(n^2) for n x n pixels (section 4 of the paper). "search" lets each
        pixel search its own epipolar segment: O(n^3). "forward" moves each sample as a point, which leaves gaps where
        the target sees the surface larger than the source did; it ignores `interpolation`, `edges` and `side`.
    interpolation : {"linear", "nearest"}
        Interpolate depth and colour between the samples, or take both from the sample nearest to the ray's hit.
    edges : {"cut", "connect"}
        "cut": the surface is open at depth edges, as at the borders of objects in scenes. At edges it extends by half a
        sample, and steep rises are bridged, except where another view has looked through. "connect": neighbouring
        samples are one surface, however far apart, as in displacement maps; other views change nothing.
    cut_ratio : float, optional
        By default, neighbours are one surface if the surface faces the camera or continues straight (in 1 / depth) on
        either side, or if noise explains the difference (`DepthImage.noise`). So receding floors are whole, and small
        steps are edges. Greater than 1: neighbours are cut apart if their depths have a greater ratio. Depths of an
        orthographic view have no origin for a ratio: such a view is cut where depths differ by more than (`cut_ratio` -
        1) times the longer side of the area that its camera sees. With a ratio, other views tear no bridges.
    side : {"front", "back", "both"}
        Visible side of the surface: the side that faces the source's camera, the other side (of a solid that is
        displaced from a centre inside it and seen from outside), or both. A pixel whose ray first meets a hidden side
        is a hole.
    fill : {None, "background", "smooth", "inpaint", "exemplar"}
        How holes are filled; `valid` stays False there, and depth is filled, too. Holes are filled after all objects
        have been drawn, so that invented colour hides nothing that was seen. "background" continues the farther surface
        around a hole into it; nearer surface at the hole's rim has a fifth of the weight. Where a view has a colour but
        no depth, the hole gets this colour (black counts as none). Pixels that show empty space (infinite depth, or
        depth of `far` and more) stay empty. "smooth" continues all surroundings, weighted by
        distance. "inpaint" continues colours by OpenCV (Telea 2004), which is slower. "exemplar" fills as
        "background" does, and then continues texture (wallpaper, wood, cloth) by patches of the same surface. Where
        no patches predict the surroundings of a hole, as in clutter, the background's colours stay. It takes some 0.2 s
        for 70,000 pixels of holes on two cores, and guesses of neighbouring frames differ more: for films, fill a
        `background_layer` once.
    thin : bool
        Draw oblique objects one sample thin (wires, leaves, bars) whole, as wide as their samples; otherwise their
        samples' pixels form steps that meet only at their corners. Each sample that is part of no whole cell is drawn
        as a square of its own size, swept to the neighbours that it is connected with. Shadows have the same width. Not
        with "forward", which draws samples as squares (see `forward_warp`).
    splat : float
        With "forward": side of the square of target pixels that a sample covers, 1 to 64.
    blend : {"quality", "nearest"}
        How several views become one picture. "quality": all views whose surfaces are no farther apart than their noise
        explains are averaged. A view's weight depends on its resolution (up to the target's) and on the angle between
        its ray and the target's, and falls near its holes and depth edges. At steep steps, where cells may be rubber
        sheets between two surfaces, a view counts only where no other view saw better. Depths are blended, too.
        Exposures are matched: gains make the views' colours agree where they show one surface, and the median gain is
        1. The gains are found once for all views and are the same in every picture. "nearest": each pixel shows the
        view with the nearest surface. Neither depends on the order of the views.

    Attributes
    ----------
    views : tuple of DepthImage
    method, interpolation, edges, cut_ratio, side, fill, thin, splat, blend
        As given.

    Raises
    ------
    ArgumentError
        An argument has a wrong type or value.
    MissingPackageError
        OpenCV is not installed (`fill="inpaint"`).

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> camera = ibr.Camera([[100, 0, 31.5], [0, 100, 31.5], [0, 0, 1]], (64, 64))
    >>> view = ibr.DepthImage(np.full((64, 64, 3), 200, np.uint8), np.full((64, 64), 2.0, np.float32), camera)
    >>> floor = ibr.Mesh([[-9, 0.2, 0], [9, 0.2, 0], [0, 0.2, 9]], [[0, 2, 1]])
    >>> frame = ibr.render([ibr.WarpedView(view, edges="connect"), floor], camera.moved(0.2, 0, 0))
    >>> frame.valid.shape
    (64, 64)
    """

    def __init__(
        self,
        views: DepthImage | Sequence[DepthImage],
        *,
        method: Method = "epipolar",
        interpolation: Interpolation = "linear",
        edges: Edges = "cut",
        cut_ratio: float | None = None,
        side: Side = "front",
        fill: Fill | None = None,
        thin: bool = False,
        splat: float = 1.0,
        blend: Blend = "quality",
    ) -> None:
        self.views = _checked_views(views)
        one_of("method", method, Method)
        self.method: Method = method
        one_of("interpolation", interpolation, Interpolation)
        self.interpolation: Interpolation = interpolation
        one_of("edges", edges, Edges)
        self.edges: Edges = edges
        self.cut_ratio = None if cut_ratio is None else cut_ratio_from(cut_ratio)
        one_of("side", side, Side)
        self.side: Side = side
        if fill is not None:
            one_of("fill", fill, Fill, " or None")
        if fill == "inpaint":
            opencv('fill="inpaint"', "inpaint")  # before anything is drawn
        self.fill: Fill | None = fill
        self.thin = checked_bool("thin", thin)
        if method == "forward" and self.channels:
            raise ArgumentError("method", '"epipolar" or "search" with views that have features', '"forward"')
        if thin and method == "forward":
            raise ArgumentError("thin", 'False with method="forward", which draws each sample as a square', "True")
        self.splat = number_from("splat", splat, 1.0, _SPLAT_MAX, f"1 to {_SPLAT_MAX:g} pixels")
        one_of("blend", blend, Blend)
        self.blend: Blend = blend

    def __repr__(self) -> str:
        return f"<WarpedView {len(self.views)} view{'s' * (len(self.views) != 1)}, {self.method}>"

    @property
    def bounds(self) -> tuple[Float64, Float64]:
        """(low, high), each (3,), in the world: the box around the views' surfaces."""
        boxes = np.array([view.surface_bounds for view in self.sources])
        return boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)

    @property
    def color_dtype(self) -> np.dtype[Any]:
        """The dtype of the views' colours."""
        return self.views[0].color.dtype

    @cached_property
    def sources(self) -> list[DepthImage]:
        """The views without their lenses."""
        cut_ratio = None if self.edges == "connect" else self.cut_ratio or _LENS_CUT_RATIO
        return [undistorted(view, cut_ratio=cut_ratio, interpolation=self.interpolation) for view in self.views]

    @cached_property
    def channels(self) -> int:
        """Number of channels of the views' features, 0 without features. Guessed views have none."""
        return max(0 if view.features is None else view.features.shape[2] for view in self.views)

    def carry_features(self, target: Target) -> None:
        """Add the views' features to a finished picture, which has the origins of its pixels."""
        for number in self._seen:
            features = self.sources[number].features
            assert features is not None
            gather_features(self.corners(target, number), features, target, first=target.features is None)

    def corners(self, target: Target, number: int) -> DeviceArray:
        """Return the result of `find_corners` for a view's pixels of a finished picture."""
        surface, pixel_map = self._surface_of(number, target)
        return find_corners(target, surface, pixel_map.pair, number, self.interpolation == "linear")

    def begin(self, camera: Camera, *, origins: bool = False, classes: bool = False) -> None:
        """Start preparing the views' surfaces, and building the programs for a camera's picture of them."""
        if self.method == "forward":
            return
        color = self.views[0].color
        defines = {"ORIGINS": int(origins) + int(classes), **color_defines(color.dtype, color.shape[2])}
        build_ahead_of_warp(camera_pair(self.sources[0].camera, camera), self._options, defines)
        for view in self.sources:
            surface_of(view, self.cut_ratio, view.guessed or self.edges == "connect")

    def draw(self, target: Target, lighting: Lighting | None) -> None:
        """Draw the views; into a light's map, draw their surfaces from both sides."""
        if target.from_light:
            self._draw_surfaces(target, self._options.from_both_sides())
            return
        if self.interpolation == "nearest":
            target.mixable = False
        if target.classes is not None:
            target.classes.fill(PixelClass.OUTSIDE)
        self._draw_views(target, lighting)
        target.clear()  # if all views are guesses
        if target.classes is not None:
            for number in self._seen:
                Pass(*self._surface_of(number, target), target, self._options).classify()

    def guess(self, target: Target, lighting: Lighting | None) -> None:
        """Draw guessed views into holes."""
        for number in self._guessed:
            entry = self._entry(target, lighting)
            if entry.normals:
                entry = entry.with_arrays(normals=_normals_of(self.sources[number]))
            Pass(*self._surface_of(number, target), target, self._options, number, entry).draw_under()

    def finish(self, target: Target) -> None:
        """Fill holes, if `fill` is set, from the views and the finished drawing."""
        if self.fill is not None and self._seen:
            views = [self.sources[number] for number in self._seen]
            fill_holes(target, [(view, *_placed(view, target)) for view in views], self.fill)

    @cached_property
    def _options(self) -> Options:
        """The options in the form that `Pass` takes."""
        return Options(self.method == "search", self.interpolation == "linear", self.edges == "connect", self.side)

    def _entry(self, target: Target, lighting: Lighting | None) -> Entry:
        bias, apart = (0.0, 1) if lighting is None else self._bias(target)
        return entry_for(target, lighting, bias=bias, apart=apart, normals=True)

    def _draw_views(self, target: Target, lighting: Lighting | None) -> None:
        entry = self._entry(target, lighting)
        if len(self._seen) < 2 or self.blend == "nearest":
            self._draw_surfaces(target, self._options, entry=entry)
            return
        own = target.layer()
        own_entry = entry_for(own, lighting, normals=True) if entry.normals else NO_ENTRY
        layers = [self._layer(number, target) for number in self._seen]
        # If no layer is visible, one of them writes the empty picture.
        shown = [layer for layer in layers if not layer.area.empty] or layers[:1]
        blend(shown, target, functools.partial(self._draw_layer, entry=own_entry), own, entry)

    @cached_property
    def _seen(self) -> list[int]:
        """Indices of the views that are not guessed, in an order that does not depend on the order of the list."""
        return [number for number in order_of(self.sources) if not self.sources[number].guessed]

    @cached_property
    def _guessed(self) -> list[int]:
        """Indices of the guessed views, in the same order."""
        return [number for number in order_of(self.sources) if self.sources[number].guessed]

    @cached_property
    def _gains(self) -> dict[int, Float64]:
        """(3,) factors of the views' colours that make their exposures agree, by index."""
        numbers = sorted(self._seen)
        return dict(zip(numbers, exposure_gains([self.sources[number] for number in numbers]), strict=True))

    def _layer(self, number: int, target: Target) -> Layer:
        """Layer of a view in the target."""
        view = self.sources[number]
        surface, pixel_map = self._surface_of(number, target)
        gains = self._gains[number] if target.color.shape[2] else np.ones(3)
        whole = self.thin or self.method == "forward"  # both also draw pixels beyond the surface
        area = Rectangle(0, target.camera.width, 0, target.camera.height) if whole else pixel_map.reach
        return Layer(number, view, pixel_map, area, surface, gains)

    def _draw_layer(self, layer: Layer, own: Target, entry: Entry) -> None:
        """Draw a view alone, over the previous content."""
        own.blank = True
        self._draw_surface(layer.number, own, self._options, entry, in_reach=not self.thin)

    def _draw_surfaces(self, target: Target, options: Options, entry: Entry = NO_ENTRY) -> None:
        """Draw all views into the target: the nearest surface wins, among equally near ones the first in order."""
        for number in self._seen:
            self._draw_surface(number, target, options, entry)

    def _draw_surface(
        self, number: int, target: Target, options: Options, entry: Entry, *, in_reach: bool = False
    ) -> None:
        """Draw a view into the target, or into a layer of its own."""
        view = self.sources[number]
        if entry.normals:
            entry = entry.with_arrays(normals=_normals_of(view))
        if self.method == "forward" and not target.from_light:
            forward_warp(*_placed(view, target), target, self.splat, entry)
            return
        build_ahead_of_warp(camera_pair(view.camera, target.camera), options, defines_of(target, entry))
        drawn = Pass(*self._surface_of(number, target), target, options, number, entry)
        drawn.draw(in_reach=in_reach)
        if self.thin:
            drawn.draw_thin()

    def _surface_of(self, number: int, target: Target) -> tuple[Surface, PixelMap]:
        """Return a view's surface, with colours in the target's format, and the view's map into the target."""
        view = self.sources[number]
        if view.guessed or len(self._seen) == 1 or self.edges == "connect" or self.method == "forward":
            surface = surface_of(_shown(view, target), self.cut_ratio, view.guessed or self.edges == "connect")
        else:
            shown_as = min(target.color.shape[2], 1), target.color.dtype
            surface = cached_on_device(self, "surfaces", lambda: self._surfaces(target), shown_as)[number]
        return surface, PixelMap(camera_pair(view.camera, target.camera), surface)

    def _surfaces(self, target: Target) -> dict[int, Surface]:
        """The views' surfaces by index, without the parts that another view has looked through."""
        views = [_shown(self.sources[number], target) for number in self._seen]
        return dict(zip(self._seen, surfaces_of(views, self.cut_ratio), strict=True))

    def _bias(self, target: Target) -> tuple[float, int]:
        """Return `bias` (in scene units) and `apart` (in pixels of the picture) for `entry_for`."""
        low, high = self.bounds
        middle = 0.5 * (low + high)
        noise, apart = noise_bias(self.sources, target.camera, middle)
        if self.interpolation == "linear" and self.method != "forward":
            return noise, apart
        sample = max(pixel_size(view.camera, middle) for view in self.sources)
        if self.interpolation == "linear":  # the method is "forward": squares have the depths of their samples
            return sample + noise, apart
        pixel = pixel_size(target.camera, middle)
        steps = math.ceil(min(4 * max(sample / pixel, 1), NEIGHBOUR_OFFSET_MAX)) if pixel > 0 else NEIGHBOUR_OFFSET_MAX
        return sample + noise, max(apart, steps)


OPTIONS = [one for one in inspect.signature(WarpedView).parameters.values() if one.kind is one.KEYWORD_ONLY]
"""The options as parameters, in their order, for code that shows or passes on all of them."""


@as_drawable.register
def _(thing: DepthImage) -> WarpedView:
    return WarpedView(thing)


def _placed(view: DepthImage, target: Target) -> tuple[Samples, PixelMap]:
    """Return the samples of a view, with colours in the target's format, and the view's map into the target."""
    samples = samples_of(_shown(view, target))
    return samples, PixelMap(camera_pair(view.camera, target.camera), samples)


def _normals_of(view: DepthImage) -> DeviceArray:
    """(H, W, 3) float32 normals of the view's samples, as stored by `showing_normals`."""
    return cached_on_device(view, "normals", lambda: upload(showing_normals(view).color))


def _shown(view: DepthImage, target: Target) -> DepthImage:
    """The view with colours in the target's format."""
    if target.color.shape[2] == 0:
        return view
    return view.in_float if target.color.dtype == np.float32 else view.in_color


def _checked_views(views: DepthImage | Sequence[DepthImage]) -> tuple[DepthImage, ...]:
    several = tuple(cast("Sequence[DepthImage]", views if isinstance(views, Sequence) else [views]))
    if not several:
        raise ArgumentError("views", "at least one DepthImage", "an empty sequence")
    has_features = False
    for view in several:
        if not isinstance(view, DepthImage):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ArgumentError("views", "a DepthImage or a sequence of them", describe(view))
        if view.has_color != several[0].has_color:
            raise ArgumentError("views", "views that all have colours, or none", "some of depth alone")
        if view.color.dtype != several[0].color.dtype:
            raise ArgumentError("views", "colours of one dtype", f"{several[0].color.dtype} and {view.color.dtype}")
        has_features |= view.features is not None
    if has_features and len(kinds := {_kind_of(view.features): 0 for view in several if not view.guessed}) > 1:
        raise ArgumentError("views", "features of one dtype and number of channels, or none", " and ".join(kinds))
    return several


def _kind_of(features: Features | None) -> str:
    return "none" if features is None else f"{features.dtype} with {features.shape[2]} channels"
