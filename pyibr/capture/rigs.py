"""Rigs: cameras derived from one camera, and the frames that they draw of things."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Protocol, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import checked_size, instance_of
from pyibr.core.errors import ArgumentError
from pyibr.images import DepthImage, Frame
from pyibr.picture.light import Light
from pyibr.picture.render import Thing, render
from pyibr.warp.background import background_layer
from pyibr.warp.filling import Fill
from pyibr.warp.view import WarpedView
from pyibr.warp.warp import warp

if TYPE_CHECKING:
    from typing_extensions import Unpack

Things = Thing | Sequence[Thing]


class RenderOptions(TypedDict, total=False):
    """The options of `pyibr.render`."""

    light: Light | None
    background: ArrayLike
    samples: int
    anisotropy: int


class Rig(Protocol):
    """Cameras derived from one camera; they may depend on the depths of the scene."""

    def fitted(self, depths: Callable[[], NDArray[np.float32]]) -> Rig:
        """Return the rig for depths (N,), or itself if there are none; `depths` is called only where needed."""
        ...

    def cameras(self, camera: Camera) -> list[Camera]:
        """Return the rig's cameras around `camera`, without lenses."""
        ...


def frames_of(rig: Rig, things: Things, camera: Camera | None, fill: Fill | None, how: RenderOptions) -> list[Frame]:
    """Draw a frame with each camera of a rig around `camera`, or around the first depth image's camera."""
    known = gathered(things, fill)
    middle = first_camera(known, camera)
    cameras = rig.fitted(lambda: depths_seen(known, middle)).cameras(middle)
    return drawn(gathered(things, fill, cameras), cameras, **how)


def gathered(things: Things, fill: Fill | None, cameras: Sequence[Camera] = ()) -> list[Thing]:
    """Return the things; depth images among them become one `WarpedView` with this `fill`, for these cameras."""
    given = list(things) if isinstance(things, Sequence) else [things]
    views = [thing.in_color for thing in given if isinstance(thing, DepthImage)]
    views = with_background(views, cameras, fill)
    drawn_as: list[Thing] = [WarpedView(views, fill=fill)] if views else []
    return [*drawn_as, *(thing for thing in given if not isinstance(thing, DepthImage))]


def with_background(views: Sequence[DepthImage], cameras: Sequence[Camera], fill: Fill | None) -> list[DepthImage]:
    """Return the views; a single view that several cameras see gets a layer of background, so that holes agree."""
    if fill is None or len(views) != 1 or len(cameras) < 2 or not views[0].valid.any():
        return list(views)
    return [*views, background_layer(views[0], cameras, fill=fill)]


def first_camera(things: Iterable[Thing], camera: Camera | None) -> Camera:
    """Return `camera`, or by default the camera of the first depth image."""
    known = [thing.views[0].camera for thing in things if isinstance(thing, WarpedView)]
    return instance_of(
        "camera", camera or next(iter(known), None), Camera, "a pyibr.Camera (optional with depth images)"
    )


def framed(camera: Camera, size: tuple[int, int]) -> Camera:
    """Return the camera with another size: the same picture, cropped about its middle to that aspect ratio."""
    width, height = checked_size(size)
    scale = max(width / camera.width, height / camera.height)
    K = camera.K.copy()
    K[:2] *= scale
    K[:2, 2] += (scale - 1 + np.array([width, height]) - scale * np.array(camera.size)) / 2
    return Camera(K, (width, height), camera.world_from_camera, projection=camera.projection, lens=camera.lens)


def stepped(camera: Camera, steps: Iterable[float], nearness: float) -> list[Camera]:
    """Return cameras `steps` scene units to the right, with parallel image planes: no point moves up or down.

    Their principal points are shifted so that points at depth 1 / `nearness` keep their place. Lenses are dropped.
    """
    if camera.projection != "perspective":
        raise ArgumentError("camera", "a perspective camera", camera.projection)
    made: list[Camera] = []
    for step in steps:
        K = camera.K.copy()
        K[0, 2] += K[0, 0] * step * nearness
        made.append(Camera(K, camera.size, camera.moved(step, 0, 0).world_from_camera))
    return made


def drawn(things: Sequence[Thing], cameras: Sequence[Camera], **how: Unpack[RenderOptions]) -> list[Frame]:
    """Draw a frame with each camera; depth images alone are warped in one call."""
    if len(things) == 1 and isinstance(things[0], WarpedView) and how.keys() <= {"samples"}:
        return warp(things[0], cameras, samples=how.get("samples", 1))
    return [render(things, camera, **how) for camera in cameras]


def depths_seen(things: Sequence[Thing], camera: Camera) -> NDArray[np.float32]:
    """Depths (N,) of the first depth image, or of the scene as the camera sees it."""
    views = [thing.views[0] for thing in things if isinstance(thing, WarpedView)]
    frame = views[0] if views else drawn(things, [camera])[0]
    depths = frame.depth[frame.valid]
    if not depths.size:
        raise ArgumentError("things", "something that the camera sees", "nothing")
    return depths
