"""Rigs of cameras: things with one camera to start from, others beside it, and their frames."""

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
    """Cameras beside one, which may depend on how far things are."""

    def fitted(self, depths: Callable[[], NDArray[np.float32]]) -> Rig:
        """The rig for things at these depths, (N,), which are asked for only where it needs them; of none itself."""
        ...

    def cameras(self, camera: Camera) -> list[Camera]:
        """Its cameras beside this one, without lenses."""
        ...


def frames_of(rig: Rig, things: Things, camera: Camera | None, fill: Fill | None, how: RenderOptions) -> list[Frame]:
    """A frame of things for each camera of a rig beside `camera`, or beside the first depth image's."""
    known = gathered(things, fill)
    middle = first_camera(known, camera)
    return drawn(known, rig.fitted(lambda: depths_seen(known, middle)).cameras(middle), **how)


def gathered(things: Things, fill: Fill | None) -> list[Thing]:
    """The things, of which the depth images are one `WarpedView` whose holes are filled so."""
    given = list(things) if isinstance(things, Sequence) else [things]
    views = [thing.in_color for thing in given if isinstance(thing, DepthImage)]
    drawn_as: list[Thing] = [WarpedView(views, fill=fill)] if views else []
    return [*drawn_as, *(thing for thing in given if not isinstance(thing, DepthImage))]


def first_camera(things: Iterable[Thing], camera: Camera | None) -> Camera:
    """The camera that is given, or the first depth image's."""
    known = [thing.views[0].camera for thing in things if isinstance(thing, WarpedView)]
    return instance_of("camera", camera or next(iter(known), None), Camera, "a pyibr.Camera for what has none")


def framed(camera: Camera, size: tuple[int, int]) -> Camera:
    """The camera of a picture of another size: as much of what it sees as has that form, about the same middle."""
    width, height = checked_size(size)
    scale = max(width / camera.width, height / camera.height)
    K = camera.K.copy()
    K[:2] *= scale
    K[:2, 2] += (scale - 1 + np.array([width, height]) - scale * np.array(camera.size)) / 2
    return Camera(K, (width, height), camera.world_from_camera, projection=camera.projection, lens=camera.lens)


def stepped(camera: Camera, steps: Iterable[float], nearness: float) -> list[Camera]:
    """Cameras so many scene units to the right, whose image planes stay parallel, so that nothing moves up or down.

    They are turned off their axes: what is at depth 1 / `nearness` keeps its place. A lens is left out.
    """
    if camera.projection != "perspective":
        raise ArgumentError("camera", "a perspective one", camera.projection)
    made: list[Camera] = []
    for step in steps:
        K = camera.K.copy()
        K[0, 2] += K[0, 0] * step * nearness
        made.append(Camera(K, camera.size, camera.moved(step, 0, 0).world_from_camera))
    return made


def drawn(things: Sequence[Thing], cameras: Sequence[Camera], **how: Unpack[RenderOptions]) -> list[Frame]:
    """A frame for each camera; of depth images alone in one call."""
    if len(things) == 1 and isinstance(things[0], WarpedView) and how.keys() <= {"samples"}:
        return warp(things[0], cameras, samples=how.get("samples", 1))
    return [render(things, camera, **how) for camera in cameras]


def depths_seen(things: Sequence[Thing], camera: Camera) -> NDArray[np.float32]:
    """(N,) depths of what is there: of the first depth image, or as the camera sees the things."""
    views = [thing.views[0] for thing in things if isinstance(thing, WarpedView)]
    frame = views[0] if views else drawn(things, [camera])[0]
    depths = frame.depth[frame.valid]
    if not depths.size:
        raise ArgumentError("things", "something that the camera sees", "nothing")
    return depths
