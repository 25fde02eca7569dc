"""Turntables: frames of a camera that goes round things, or swings to and fro in front of them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pyibr.capture.rigs import RenderOptions, Things, drawn, gathered
from pyibr.capture.standpoint import standpoint
from pyibr.core.camera import Camera
from pyibr.core.checks import integer_from, number_from
from pyibr.images import Frame
from pyibr.warp.filling import Fill

if TYPE_CHECKING:
    from typing_extensions import Unpack

FRAMES_MAX = 100_000


def turntable(
    things: Things,
    frames: int = 72,
    camera: Camera | None = None,
    *,
    turn: float = 360.0,
    swing: float | None = None,
    up: ArrayLike | None = None,
    fill: Fill | None = "background",
    **how: Unpack[RenderOptions],
) -> Iterator[Frame]:
    """Draw things from all round, frame by frame; `write_video` takes the frames' colours.

    Parameters
    ----------
    things : thing or sequence of things
        As for `render`; depth images among them form one `WarpedView`.
    frames : int
        1 to 100,000. The last frame is one step before the first, so that the film loops without a jump.
    camera : Camera, optional
        Camera of the first frame. By default the camera of the first depth image, or one that sees the whole scene.
    turn : float
        Degrees that the camera goes to the right about the point in the middle of its picture.
    swing : float, optional
        Degrees to either side. If given, the camera swings to and fro instead, which suits a single photograph.
    up : (3,), optional
        Axis, in the world. By default the up direction of the depth images, or -y.
    fill : {"background", "smooth", "inpaint", "exemplar", None}
        Content of regions that no depth image saw, as for `WarpedView`.
    **how
        Options of `render`: `light`, `background`, `samples`, `anisotropy`.

    Yields
    ------
    Frame

    Raises
    ------
    ArgumentError
        An argument has a wrong type or value.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> square = ibr.Mesh([[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]], [[0, 1, 2], [3, 2, 1]])
    >>> camera = ibr.Camera.look_at((0, 0, -4), (0, 0, 0), (0, -1, 0), (40, 30))
    >>> [bool(frame.valid[14, 19]) for frame in ibr.turntable(square, 4, camera)]
    [True, False, True, False]
    """
    cameras = turntable_cameras(things, frames, camera, turn=turn, swing=swing, up=up)
    known = gathered(things, fill, cameras)
    return (frame for one in cameras for frame in drawn(known, [one], **how))


def turntable_cameras(
    things: Things,
    frames: int,
    camera: Camera | None = None,
    *,
    turn: float = 360.0,
    swing: float | None = None,
    up: ArrayLike | None = None,
) -> list[Camera]:
    """Return the cameras of a turntable, from the arguments of `turntable`."""
    count = integer_from("frames", frames, 1, FRAMES_MAX)
    at = standpoint(things, camera, up)
    parts = np.arange(count) / count
    if swing is None:
        angles = number_from("turn", turn, -36e3, 36e3, "degrees") * parts
    else:
        angles = number_from("swing", swing, -180.0, 180.0, "degrees") * np.sin(2 * math.pi * parts)
    return [at.camera.orbited(float(angle), at.pivot, axis=at.up) for angle in angles]
