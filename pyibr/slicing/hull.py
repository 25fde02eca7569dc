"""Visual hulls: the intersection of silhouettes in space (Kautz & Seidel 2001, section 5)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pyibr.images import DepthImage
from pyibr.images.silhouette import Silhouette, is_opposite
from pyibr.opencl.device import one_call
from pyibr.opencl.memory import DeviceArray
from pyibr.picture.target import Target
from pyibr.picture.undistort import undistorted, undistorted_silhouette
from pyibr.slicing.boxes import box_of_silhouettes
from pyibr.slicing.drawing import draw_object, joined
from pyibr.slicing.meshing import MeshableSolid
from pyibr.slicing.solid import SolidSlicing, Texture, View, checked_views, words_of
from pyibr.slicing.spacing import Slices

Float32 = NDArray[np.float32]

# For its colours a hull is drawn with few slices, whatever the slices of pictures, but as precisely as with 4,096.
_SLICES, _HALVINGS = 64, 6
_KINDS = {Silhouette: undistorted_silhouette, DepthImage: undistorted}


class VisualHull(MeshableSolid):
    """Visual hull: the largest solid that fits into all silhouettes.

    Parameters
    ----------
    views : sequence of Silhouette or DepthImage
        Any number, at any calibrated poses; depth images contribute only `valid` and colours. Each view must show the
        whole object: parts outside its frame are cut off.
    slices : int or "view"
        Number along the longest edge of the hull's box; other directions have the same spacing. "view": as for
        `DepthObject`.
    slicing : {"orthogonal", "screen"}
        As for `DepthObject`, but the box has the world's axes.
    texture : {"visible", "naive"}
        As for `DepthObject`. Outlines do not show which image saw a point. So for "visible" the hull is first drawn
        from each view, and a view gives no colour to points that the hull hides from it.
    halvings, only : int
        As for `DepthObject`.

    Raises
    ------
    ArgumentError
        If there are no views, or nothing lies within all silhouettes.

    Examples
    --------
    >>> import pyibr as ibr
    >>> from pyibr.capture import models
    >>> from pyibr.capture.raycast import object_views
    >>> hull = ibr.VisualHull(object_views(models.donut(), 64), slices=64)
    >>> hull.tested  # opposite views show one silhouette
    [0, 2, 4]
    """

    silhouettes = True

    def __init__(
        self,
        views: Sequence[Silhouette | DepthImage],
        *,
        slices: Slices = 128,
        slicing: SolidSlicing = "orthogonal",
        texture: Texture = "visible",
        halvings: int = 2,
        only: int | None = None,
    ) -> None:
        super().__init__(checked_views(views, _KINDS), slices, slicing, halvings, only, texture)
        self.box = box_of_silhouettes([self.views[number] for number in self.tested])

    @cached_property
    def outlines(self) -> list[int]:
        """For each view the index of the first view with its silhouette: opposite orthographic views share one."""
        firsts: list[int] = []
        for number, view in enumerate(self.views):
            same = (other for other in sorted(set(firsts)) if is_opposite(view, self.views[other]))
            firsts.append(next(same, number))
        return firsts

    @property
    def tested(self) -> list[int]:
        """Indices of the views with silhouettes of their own; each is tested once."""
        return sorted(set(self.outlines))

    @cached_property
    def masks(self) -> list[Float32]:
        """Masks of the views."""
        return [mask_of(view) for view in self.views]

    @cached_property
    def depths(self) -> list[Float32]:
        """Depth of the hull's surface in each view, (H, W), NaN beside it."""
        # The same data on the device, but other slices.
        drawn = object.__new__(VisualHull)
        drawn.__dict__.update(self.__dict__, device_cache=self.device_cache, texture="naive", only=None)
        drawn.__dict__.update(slices=_SLICES, halvings=_HALVINGS)
        with one_call() as session:
            targets = [Target(view.camera, np.dtype(np.uint8)) for view in self.views]
            for target in targets:
                draw_object(target, drawn)
            frames = [target.begin_frame() for target in targets]
            session.wait()
        return [finished().depth for finished in frames]

    @property
    def surfaces(self) -> list[DepthImage]:
        """The hull's surface as each view sees it, in the view's colours."""
        return [
            DepthImage(view.shown_color, depth, view.camera)
            for view, depth in zip(self.views, self.depths, strict=True)
        ]

    def maps(self) -> DeviceArray:
        """Upload the masks to the device."""
        return joined(self.masks)

    def with_views(self, views: Sequence[Silhouette | DepthImage]) -> VisualHull:
        """Return the same hull made from other views, for animations; see `DepthObject.with_views`.

        If an outline changes, the hull's box is searched again with all views; if only colours change, the box stays.

        Examples
        --------
        >>> import pyibr as ibr
        >>> from pyibr.capture import models
        >>> from pyibr.capture.raycast import object_views
        >>> first = ibr.VisualHull(object_views(models.donut(), 64), slices=64)
        >>> first.with_views(first.views[:4])
        <VisualHull 4 views, 64 slices>
        """
        given = checked_views(views, _KINDS)
        pairs = zip(given, self.views, strict=False)
        alike = (a is b or (a.camera == b.camera and np.array_equal(a.valid, b.valid)) for a, b in pairs)
        if len(given) == len(self.views) and all(alike):
            made = object.__new__(VisualHull)
            made.__dict__.update(self.__getstate__(), views=given)
        else:
            made = VisualHull(
                given,
                slices=self.slices,
                slicing=self.slicing,
                texture=self.texture,
                halvings=self.halvings,
                only=self.only,
            )
        made.__dict__["rgba"] = self.with_known(self.rgba, given, words_of)
        made.__dict__["masks"] = self.with_known(self.masks, given, mask_of)
        return made


def mask_of(view: View) -> Float32:
    """(H, W), 1 where a view shows the object."""
    return np.ascontiguousarray(view.valid, np.float32)
