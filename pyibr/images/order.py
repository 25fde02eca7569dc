"""An order of views that depends on what they are alone, not on how they are listed."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from weakref import WeakKeyDictionary

from pyibr.images.depth_image import DepthImage


def order_of(views: Sequence[DepthImage]) -> list[int]:
    """The views' numbers, in an order that is the same however the views are listed: sums in it are, to the bit.

    By their cameras; views of one camera by what they hold. Only views that are the same in all keep their places.
    """
    if len(views) < 2:  # most pictures are of one view
        return list(range(len(views)))
    cameras = [_camera_key(view) for view in views]
    count = Counter(cameras)
    keys = [(key, _content_key(view) if count[key] > 1 else b"") for key, view in zip(cameras, views, strict=True)]
    return sorted(range(len(views)), key=keys.__getitem__)


def _camera_key(view: DepthImage) -> bytes:
    camera = view.camera
    kind = repr((camera.size, camera.projection)).encode()
    return b"".join([(camera.world_from_camera + 0.0).tobytes(), camera.K.tobytes(), kind])  # 0 is -0


_contents: WeakKeyDictionary[DepthImage, bytes] = WeakKeyDictionary()


def _content_key(view: DepthImage) -> bytes:
    if view not in _contents:
        digest = hashlib.blake2b(repr(view.far).encode())
        for array in (view.depth, view.color):
            digest.update(array.data if array.size else b"")
        _contents[view] = digest.digest()
    return _contents[view]
