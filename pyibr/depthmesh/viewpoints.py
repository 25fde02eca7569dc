"""Viewpoints of an object's views: their closeness to a camera, and the choice of the views to draw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64
from pyibr.core.pixelspace import frustum
from pyibr.images.depth_image import DepthImage
from pyibr.images.order import ranks_of

_OPPOSITE = 1e-3  # remaining weight of views that look the opposite way


@dataclass(frozen=True)
class DrawnViews:
    """Indices of the views whose meshes are drawn.

    The back sides of the views `around` indicate surface that no view saw. These views are: `others`; as many of the
    farthest views, which see the object from behind; chosen views whose back sides the camera may see, as in a cup.
    """

    chosen: Sequence[int]  # the closest views, which are blended
    others: Sequence[int] = ()  # their meshes show in holes: the next closest views, or chosen ones with rubber sheets
    around: Sequence[int] = ()
    sheets: Sequence[int] = ()  # their rubber sheets are drawn to find rays that pass between surfaces


class Viewpoints:
    """Viewpoints of an object's views; for orthographic views see `DepthMeshObject.weights`.

    `boxes`, (views, 2, 3), are the low and high corners of the box around each view's surface, in the world.
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

        With `facing`, among views that are about as close, views from the same side of the object come first.

        Returns
        -------
        (views,) float64
            Closeness, in 1 / scene units: the weights of `DepthMeshObject.weights`, but not normalised.
        list of int
            Indices of the views, best first; ties are broken by `ranks_of`.
        """
        ahead = camera.forward
        cosines = np.array([forward @ ahead for forward in self._forwards])
        distances = np.linalg.norm(self._points - self._viewpoint(camera), axis=1)
        ties = 1 + 1e-9 * np.arccos(np.clip(cosines, -1, 1))
        closeness: Float64 = 1.0 / (np.maximum(distances, 1e-6 * max(self.extent, self._distance)) * ties)
        planes = frustum(camera)
        low, high = self._boxes[:, None, 0], self._boxes[:, None, 1]
        farthest = np.where(planes[:, :3] > 0, high, low)  # (views, planes, 3) corners farthest inside each plane
        inside = np.asarray(np.einsum("vpc,pc->vp", farthest, planes[:, :3]) + planes[:, 3]) >= 0
        closeness = closeness * np.where(inside.all(axis=1), 1.0, 1e-9)
        worth = closeness * (1 + _OPPOSITE + cosines) if facing else closeness
        return closeness, np.lexsort((self._ranks, -worth)).tolist()

    def drawn(self, camera: Camera, order: list[int], count: int, closed: Literal["sheets"] | bool) -> DrawnViews:
        """Choose the views to draw: the first `count` of `order` and, to close their holes, further ones."""
        rank = self._ranks.tolist().__getitem__
        chosen = sorted(order[:count], key=rank)  # a fixed order of summation keeps results identical to the bit
        if not closed:
            return DrawnViews(chosen)
        if closed == "sheets":
            return DrawnViews(chosen, chosen)
        others = sorted(order[count : 2 * count], key=rank)
        # A camera may see back sides unless it lies in front of the whole object, along the view's direction.
        forward, center = camera.forward, camera.center
        if camera.projection == "orthographic":
            backs = [number for number in chosen if forward @ self._forwards[number] <= 0]
        else:
            backs = [number for number in chosen if center @ self._forwards[number] >= self._nearest[number]]
        around = sorted({*others, *order[-count:], *backs}, key=rank)
        return DrawnViews(chosen, others, around, [*chosen, *others])
