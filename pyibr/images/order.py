"""An order of views that depends on their content, not on their order in a list."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from pyibr.images.depth_image import DepthImage
from pyibr.images.silhouette import Silhouette

View = DepthImage | Silhouette


def order_of(views: Sequence[View]) -> list[int]:
    """Indices of the views, in an order that does not depend on the list's order, so that sums have the same bits.

    Views are sorted by camera; views with equal cameras, by content. Only identical views keep their relative order.
    """
    if len(views) < 2:  # fast path: most pictures have one view
        return list(range(len(views)))
    cameras = [_camera_key(view) for view in views]
    count = Counter(cameras)
    keys = [(key, _content_key(view) if count[key] > 1 else b"") for key, view in zip(cameras, views, strict=True)]
    return sorted(range(len(views)), key=keys.__getitem__)


def ranks_of(views: Sequence[View]) -> NDArray[np.intp]:
    """(views,) each view's rank in the order of `order_of`, to break ties between views."""
    return np.argsort(order_of(views))


def _camera_key(view: View) -> bytes:
    camera = view.camera
    kind = repr((camera.size, camera.projection)).encode()
    return b"".join([(camera.world_from_camera + 0.0).tobytes(), camera.K.tobytes(), kind])  # + 0.0 turns -0 into 0


_contents: WeakKeyDictionary[View, bytes] = WeakKeyDictionary()


def _content_key(view: View) -> bytes:
    if view not in _contents:
        digest = hashlib.blake2b()
        seen = view.valid if isinstance(view, Silhouette) else view.depth
        for array in (seen, view.color):
            digest.update(array.data if array.size else b"")
        if isinstance(view, DepthImage):
            digest.update(repr(view.far).encode() + b"guessed" * view.guessed)
        _contents[view] = digest.digest()
    return _contents[view]
