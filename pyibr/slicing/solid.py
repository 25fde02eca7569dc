"""Solids from images all round: views, slices and box of depth objects and visual hulls."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, Literal, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64, Immutable, describe, one_of
from pyibr.core.errors import ArgumentError
from pyibr.images import DepthImage
from pyibr.images.depth_image import check_seen
from pyibr.images.silhouette import Silhouette
from pyibr.meshes.textures import rgba_words
from pyibr.opencl.memory import DeviceArray
from pyibr.slicing.boxes import Box
from pyibr.slicing.spacing import Slices, checked_halvings, checked_only, checked_slices, slices_text

_SAMPLES_MAX = 1 << 30  # in all views: kernels index two values per sample with 32 bits

SolidSlicing = Literal["orthogonal", "screen"]
Texture = Literal["visible", "naive"]
Missing = Literal["empty", "unknown"]
View = DepthImage | Silhouette

_Known = TypeVar("_Known")


class Solid(Immutable):
    """Solid that is the intersection of images from all sides, drawn by slices; for its options see `DepthObject`."""

    views: list[Any]  # DepthImage or Silhouette objects, without lenses
    box: Box
    missing: Missing = "empty"
    thin: bool = False
    silhouettes: bool = False  # views test points with masks, not with nearness

    def __init__(
        self,
        views: list[Any],
        slices: Slices,
        slicing: SolidSlicing,
        halvings: int,
        only: int | None,
        texture: Texture,
    ) -> None:
        self.views = views
        self.halvings = checked_halvings(halvings)
        self.slices: Slices = checked_slices(slices)
        self.only = checked_only(only, self.slices)
        self.slicing: SolidSlicing = one_of("slicing", slicing, SolidSlicing)
        self.texture: Texture = one_of("texture", texture, Texture)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {len(self.views)} views, {slices_text(self.slices)}>"

    @property
    def bounds(self) -> tuple[Float64, Float64]:
        """(low, high), each (3,), in the world: the box around the object."""
        return self.box.bounds

    @cached_property
    def outlines(self) -> list[int]:
        """For each view the index of the first view with the same test; each test is made once."""
        return list(range(len(self.views)))

    def maps(self) -> DeviceArray:
        """Upload the images that the views test points with, one after the other, to the current device.

        Each is nearness and cells, (2, H, W), or a mask, (H, W), 0 or 1.
        """
        raise NotImplementedError

    @property
    def surfaces(self) -> list[DepthImage]:
        """The solid's surface as each view sees it, in the view's colours: which points a view saw."""
        raise NotImplementedError

    @cached_property
    def rgba(self) -> list[NDArray[np.uint32]]:
        """Colours of the views, with A 255 on the object."""
        return [words_of(view) for view in self.views]

    def with_known(self, values: list[_Known], views: Sequence[Any], make: Callable[[Any], _Known]) -> list[_Known]:
        """Return a value for each of some views: from `values` if this solid has the view, else made anew."""
        known = {id(view): value for view, value in zip(self.views, values, strict=True)}
        return [known[id(view)] if id(view) in known else make(view) for view in views]


def words_of(view: View) -> NDArray[np.uint32]:
    """RGBA words of a view, with A 255 on the object."""
    return rgba_words(view.shown_color, view.valid)


def checked_views(views: object, kinds: Mapping[type[View], Callable[[Any], View]]) -> list[Any]:
    """Return views without their lenses, undistorted by the function for their kind, or raise ArgumentError."""
    if not isinstance(views, Sequence) or not views:
        raise ArgumentError("views", "a sequence of at least one view", describe(cast("object", views)))
    straight: list[Any] = []
    for number, view in enumerate(cast("Sequence[object]", views)):
        made = next((without_lens(view) for kind, without_lens in kinds.items() if isinstance(view, kind)), None)
        if made is None:
            names = " or ".join(f"pyibr.{kind.__name__}" for kind in kinds)
            raise ArgumentError("views", f"a sequence of {names}", f"{describe(view)} as view {number}")
        if not made.valid.any():
            raise ArgumentError("views", "views with valid depth", f"none in view {number}")
        if isinstance(made, DepthImage):
            check_seen(made, number)
        straight.append(made)
    if (total := sum(view.valid.size for view in straight)) > _SAMPLES_MAX:
        raise ArgumentError("views", f"at most {_SAMPLES_MAX} samples in all", str(total))
    return straight
