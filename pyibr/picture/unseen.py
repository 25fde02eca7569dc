"""Marks on the parts of a thing that no depth image has seen (kernels/picture/unseen.cl)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64, one_of
from pyibr.core.undistortion import check_no_lens
from pyibr.images.depth_image import DepthImage, Side
from pyibr.opencl.device import current
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.headers import constant, struct
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, copy, empty, upload
from pyibr.opencl.program import kernel
from pyibr.picture.deferred import light_things
from pyibr.picture.drawable import Drawable
from pyibr.picture.shadow import Lighting
from pyibr.picture.target import Target

_SHARE = 0.6  # weight of the mark in a pixel's colour


class MarkedUnseen:
    """A thing with a mark on surface that none of the given depth images has seen.

    Parameters
    ----------
    thing : Drawable
    views : sequence of DepthImage
        Views without lenses.
    side : {"front", "back", "both"}
        Side of the surface from which an image must have seen it: the side of the picture's camera ("front"), or the
        other side, as from the middle of a globe ("back").
    color : (r, g, b)
        Colour of the mark, 0 to 255.
    within : (2, 3), optional
        A box, (low, high) in the world. Only surface inside the box is marked.

    Raises
    ------
    ArgumentError
        If a view has a lens, or `side` is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> from pyibr.picture.drawable import as_drawable
    >>> from pyibr.picture.unseen import MarkedUnseen
    >>> wall = ibr.Mesh([[-9, -9, 3], [9, -9, 3], [0, 9, 3]], [[0, 1, 2]])
    >>> camera = ibr.Camera([[20, 0, 5], [0, 20, 5], [0, 0, 1]], (11, 11))
    >>> half = np.where(np.arange(11) < 5, np.float32(3), np.float32(np.inf)) * np.ones((11, 1), np.float32)
    >>> marked = MarkedUnseen(as_drawable(wall), [ibr.DepthImage(None, half, camera)])
    >>> ibr.render(marked, camera).color[5, [2, 8]].tolist()
    [[204, 204, 204], [220, 106, 106]]
    """

    def __init__(
        self,
        thing: Drawable,
        views: Sequence[DepthImage],
        side: Side = "front",
        color: tuple[int, int, int] = (230, 40, 40),
        within: Float64 | None = None,
    ) -> None:
        one_of("side", side, Side)
        for view in views:
            check_no_lens("views", view.camera)
        self.thing, self.views, self.side, self.color = thing, list(views), side, color
        self.within = np.array([[-np.inf] * 3, [np.inf] * 3]) if within is None else within

    @property
    def bounds(self) -> tuple[NDArray[Any], NDArray[Any]]:
        """(low, high), each (3,): the thing's bounds in the world."""
        return self.thing.bounds

    def draw(self, target: Target, lighting: Lighting | None) -> None:
        """Draw the thing, and mark it."""
        if target.from_light:
            self.thing.draw(target, lighting)
            return
        own = target.layer()
        self.thing.draw(own, lighting)
        own.clear()  # if nothing was drawn
        light_things(own, lighting)
        origin = target.camera.center  # float32 is most accurate near 0
        maps, records, places = _on_device(self.views, origin)
        part = np.zeros((), struct("picture/unseen.cl", "Bounds"))
        part["low"], part["high"] = self.within - origin
        scale = 1.0 if target.color.dtype == np.uint8 else 1 / 255
        launch(
            kernel("picture/unseen.cl", "draw_marked", **target.color_defines),
            current().profile.packets(*target.camera.size),
            own_depth=own.depth,
            own_color=own.color,
            screen=Struct("Screen", target.screen(0.5, origin)),
            blank=target.blank,
            maps=maps,
            views=records,
            places=places,
            count=len(self.views),
            bounds=Struct("Bounds", part),
            fronts=self.side in ("front", "both"),
            backs=self.side in ("back", "both"),
            red=scale * self.color[0],
            green=scale * self.color[1],
            blue=scale * self.color[2],
            share=_SHARE,
            **target.outputs(),
        )
        target.blank, target.mixable = False, target.mixable and own.mixable


def _on_device(views: Sequence[DepthImage], origin: Float64) -> tuple[DeviceArray, DeviceArray, DeviceArray]:
    """Upload the kernel's `maps`, `views` and `places`, for points relative to an origin."""
    floats, ints = (int(constant("picture/unseen.cl", name)) for name in ("VIEW_FLOATS", "VIEW_INTS"))
    records, places = np.zeros((max(len(views), 1), floats), np.float32), np.zeros((max(len(views), 1), ints), np.int32)
    maps = empty((max(sum(view.depth.size for view in views), 1),), np.float32)
    shift, start = np.eye(4), 0
    shift[:3, 3] = origin
    for number, view in enumerate(views):
        camera = view.camera
        from_origin = camera.camera_from_world @ shift
        perspective = camera.projection == "perspective"
        records[number, :16] = (camera.pixel_matrix @ from_origin).ravel()
        records[number, 16:20] = from_origin[2]
        records[number, 20:24] = [*(camera.center - origin), 1] if perspective else [*-camera.forward, 0]
        records[number, 24] = max(1 / camera.K[0, 0], 1 / camera.K[1, 1])
        places[number] = *camera.size, start
        depths = np.where(view.valid, view.depth, np.float32(0))
        copy(cached_on_device(view, "seen", lambda depths=depths: upload(depths)), maps, start)
        start += view.depth.size
    return maps, upload(records), upload(places)
