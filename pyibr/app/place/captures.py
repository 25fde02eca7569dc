"""Images of the frusta of a placement, captured on request and kept while in use."""

from __future__ import annotations

from collections.abc import Sequence
from threading import RLock

import numpy as np

from pyibr.capture.coverage import Mask, Surface, unseen_share
from pyibr.capture.frusta import Frustum
from pyibr.core.camera import Camera
from pyibr.images import DepthImage
from pyibr.images.depth_image import Side
from pyibr.picture.light import Light


class Captures:
    """Depth images of a surface's mesh, captured from frusta, with a light for their colours."""

    def __init__(self, surface: Surface, light: Light | None) -> None:
        self.surface, self.light = surface, light
        self._views: dict[Frustum, DepthImage] = {}
        self._bare: dict[tuple[Camera, float], DepthImage] = {}
        self._seen: dict[tuple[Frustum, Side], Mask] = {}
        self._lock = RLock()  # pictures are drawn on one thread, and sets saved on others

    def views(self, frusta: Sequence[Frustum]) -> list[DepthImage]:
        """The depth images of some frusta; drops the images of all others."""
        cameras = {(one.camera, one.far) for one in frusta}
        with self._lock:
            self._bare = {key: view for key, view in self._bare.items() if key in cameras}
            self._views = {one: view for one, view in self._views.items() if one in frusta}
            self._seen = {key: mask for key, mask in self._seen.items() if key[0] in frusta}
            return [self.view(one) for one in frusta]

    def view(self, frustum: Frustum) -> DepthImage:
        """The depth image of a frustum."""
        with self._lock:
            if frustum not in self._views:
                key = frustum.camera, frustum.far
                if key not in self._bare:  # another stroke needs no new capture
                    bare = Frustum(frustum.camera, frustum.far)
                    self._bare[key] = bare.capture(self.surface.mesh, self.light)
                bare_view = self._bare[key]
                depth = np.where(frustum.mask, np.float32(np.inf), bare_view.depth)
                self._views[frustum] = DepthImage(bare_view.color, depth, frustum.camera, far=frustum.far)
            return self._views[frustum]

    def nearest(self, frustum: Frustum) -> float | None:
        """The smallest depth in a frustum's image; None if it is not captured yet, or empty."""
        view = self._views.get(frustum)
        return float(view.depth[view.valid].min()) if view is not None and view.valid.any() else None

    def unseen(self, frusta: Sequence[Frustum], side: Side) -> float:
        """The fraction of the surface visible from outside that no frustum sees."""
        with self._lock:
            return unseen_share(self.surface, [self._mask(one, side) for one in frusta])

    def _mask(self, frustum: Frustum, side: Side) -> Mask:
        key = frustum, side
        if key not in self._seen:
            self._seen[key] = self.surface.seen(self.view(frustum), side=side)
        return self._seen[key]
