"""Viewpoints of an object's views: how close a camera is to each, and which views are drawn for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64
from pyibr.core.pixelspace import frustum
from pyibr.images.depth_image import DepthImage
from pyibr.images.order import ranks_of

_OPPOSITE = 1e-3  # that views which look the opposite way still count for


@dataclass(frozen=True)
class DrawnViews:
    """Numbers of the views whose meshes are drawn.

    Attributes
    ----------
    chosen : list of int
        The closest ones, which are blended.
    others : list of int
        Those that show in their holes: the next closest, or the same with their rubber sheets.
    around : list of int
        Those whose backs tell of surface that nobody saw: the others, as many of the farthest, which see the thing from
        behind, and of the closest those that the camera may see the backs of, as of the wall of a cup that it is in.
    sheets : list of int
        Those whose meshes are drawn over what segmentation took out of them, too.
    """

    chosen: list[int]
    others: list[int] = field(default_factory=list["int"])
    around: list[int] = field(default_factory=list["int"])
    sheets: list[int] = field(default_factory=list["int"])


class Viewpoints:
    """Viewpoints of the views of an object.

    Those of orthographic cameras lie before the object's middle, as far from it as the perspective views' do on
    average, or twice its extent.

    Parameters
    ----------
    views : sequence of DepthImage
    boxes : (views, 2, 3) float64
        Low and high of each view's surface in the world.
    """

    def __init__(self, views: Sequence[DepthImage], boxes: Float64) -> None:
        cameras, self._ranks = [view.camera for view in views], ranks_of(views)
        self.bounds = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
        self.extent = float((self.bounds[1] - self.bounds[0]).max())
        self._boxes = boxes
        self._middle = 0.5 * (self.bounds[0] + self.bounds[1])
        away = [
            np.linalg.norm(camera.center - self._middle) for camera in cameras if camera.projection == "perspective"
        ]
        self._distance = float(np.mean(away)) if away else 2 * self.extent
        self._forwards = [camera.forward for camera in cameras]
        low, high = self.bounds
        self._nearest = [np.minimum(low * forward, high * forward).sum() for forward in self._forwards]
        self._points = np.array([self._viewpoint(camera) for camera in cameras])

    def _viewpoint(self, camera: Camera) -> Float64:
        return camera.center if camera.projection == "perspective" else self._middle - self._distance * camera.forward

    def ranked(self, camera: Camera, facing: bool) -> tuple[Float64, list[int]]:
        """Rank the views for a camera without a lens.

        Parameters
        ----------
        camera : Camera
        facing : bool
            Of views that are about as close, those come first that see the thing from the same side.

        Returns
        -------
        (views,) float64
            Closeness: inverse distances of the viewpoints from the camera's, in 1 / scene units. Of viewpoints that are
            one, those that look the same way are closest; views of what the camera does not see have next to none.
        list of int
            The views' numbers, those first that are to be drawn; ties are broken by `order_of`.
        """
        ahead = camera.forward
        cosines = np.array([forward @ ahead for forward in self._forwards])
        distances = np.linalg.norm(self._points - self._viewpoint(camera), axis=1)
        ties = 1 + 1e-9 * np.arccos(np.clip(cosines, -1, 1))
        closeness: Float64 = 1.0 / (np.maximum(distances, 1e-6 * max(self.extent, self._distance)) * ties)
        planes = frustum(camera)
        low, high = self._boxes[:, None, 0], self._boxes[:, None, 1]
        farthest = np.where(planes[:, :3] > 0, high, low)  # (views, planes, 3) the corner furthest inside
        inside = np.asarray(np.einsum("vpc,pc->vp", farthest, planes[:, :3]) + planes[:, 3]) >= 0
        closeness = closeness * np.where(inside.all(axis=1), 1.0, 1e-9)
        worth = closeness * (1 + _OPPOSITE + cosines) if facing else closeness
        return closeness, np.lexsort((self._ranks, -worth)).tolist()

    def drawn(self, camera: Camera, order: list[int], count: int, closed: Literal["sheets"] | bool) -> DrawnViews:
        """Choose the views that are drawn: the first `count` of them and, to close their holes, more."""
        rank = self._ranks.tolist().__getitem__
        chosen = sorted(order[:count], key=rank)  # sums in this order are the same, to the bit
        if not closed:
            return DrawnViews(chosen)
        if closed == "sheets":
            return DrawnViews(chosen, chosen)
        others = sorted(order[count : 2 * count], key=rank)
        # A camera may see the back of what it is not before, along the view's direction.
        forward, center = camera.forward, camera.center
        if camera.projection == "orthographic":
            backs = [number for number in chosen if forward @ self._forwards[number] <= 0]
        else:
            backs = [number for number in chosen if center @ self._forwards[number] >= self._nearest[number]]
        around = sorted({*others, *order[-count:], *backs}, key=rank)
        return DrawnViews(chosen, others, around, [*chosen, *others])
