"""The picture in the making: what every system draws into, one depth buffer for all."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import check_lengths, check_pixels
from pyibr.images import Frame
from pyibr.opencl.headers import struct
from pyibr.opencl.memory import DeviceArray, begin_to_host, empty, output
from pyibr.opencl.memory_pool import rounded
from pyibr.picture.gbuffer import GBuffer

_NEAR = 1e-5  # of the distance to the farthest point of a thing: what lies nearer than that is not drawn

_NEAREST = 1e-30  # scene units: of a point that the camera stands in


def color_defines(dtype: np.dtype[Any], channels: int) -> dict[str, int]:
    """Defines of the colour's type and channels (kernels/lib/channel.h)."""
    return {"COLOR_BYTES": dtype.itemsize, "CHANNELS": channels}


class Target:
    """Colour, depth and coverage on the current device.

    Parameters
    ----------
    camera : Camera
    dtype : dtype
        Of the colour: uint8 or float32.
    channels : int
        Of the colour: 3, or 0 for depth alone.
    from_light : bool
        Only its depths count: they are a light's map of what casts shadows.
    out : Frame, optional
        Its arrays are written, instead of new ones.
    origins : bool
        Where in which view each pixel comes from is written, too.
    classes : bool
        What each pixel is, is written, too.
    anisotropy : int
        How often a map is read along a pixel's footprint at most; 1: once, as if that were as long as wide.
    pool : dict, optional
        Scratch memory by size, for targets that are drawn one after the other.

    Attributes
    ----------
    alpha : (H, W) float32 DeviceArray, or None
        Of several samples a pixel: the share of them that show something.
    guesses : (H, W) float32 DeviceArray, or None
        Depths at which guessed surface was drawn, once a thing that guesses was: a pixel shows it only as long as that
        is the picture's depth.
    blank : bool
        Nothing has been written yet: who draws first writes every pixel, who draws later keeps what is nearer.
    filled : bool
        Its holes have been filled: they have colours and depths, though they are not valid.
    mixable : bool
        Whether its colours may be mixed on surfaces, where it is a part of another picture: things whose colours stand
        for something, as labels, say that they may not.
    gbuffer : GBuffer, or None
        What is lit once all things are drawn, if anything is (`pyibr.picture.deferred`).
    """

    def __init__(
        self,
        camera: Camera,
        dtype: np.dtype[Any],
        from_light: bool = False,
        out: Frame | None = None,
        origins: bool = False,
        classes: bool = False,
        pool: dict[tuple[int, int], DeviceArray] | None = None,
        channels: int = 3,
        anisotropy: int = 1,
    ) -> None:
        check_pixels("camera", camera.size)
        shape = (camera.height, camera.width)
        self.camera = camera
        self.out = out
        self._pool: dict[tuple[int, int], DeviceArray] = {} if pool is None else pool
        if out is None:
            self.color, self.depth, self.valid = (
                empty((*shape, channels), dtype),
                empty(shape, np.float32),
                empty(shape, np.uint8),
            )
        else:
            self.color, self.depth, self.valid = output(out.color), output(out.depth), output(out.valid.view(np.uint8))
        self.source = empty((*shape, 2), np.float32) if origins else None
        self.source_view = empty(shape, np.int32) if origins else None
        self.classes = empty(shape, np.uint8) if classes else None
        self.alpha: DeviceArray | None = None
        self.guesses: DeviceArray | None = None
        self.blank = True
        self.filled = False
        self.mixable = True
        self.from_light = from_light
        self.anisotropy = anisotropy
        self.gbuffer: GBuffer | None = None

    def layer(self) -> Target:
        """A target of the same kind, for a part of what is to be seen in this one: with its classes."""
        layer = Target(
            self.camera,
            self.color.dtype,
            origins=self.source is not None,
            pool=self._pool,
            channels=self.color.shape[-1],
            anisotropy=self.anisotropy,
        )
        layer.classes = self.classes
        return layer

    def scratch(self, count: int, number: int = 0) -> DeviceArray:
        """(count,) float32, or some more, that launches may use until the next who asks for this number does."""
        size = rounded(4 * count) // 4  # views ask for much the same, each for its own
        if (size, number) not in self._pool:
            self._pool[size, number] = empty((size,), np.float32)
        return self._pool[size, number]

    def clear(self) -> None:
        """Write every pixel, if none is written yet: nothing there. For systems that then write only what they see."""
        if self.blank:
            self.color.fill(0)
            self.depth.fill(np.nan)
            self.valid.fill(0)
            self.blank = False

    def outputs(self) -> dict[str, DeviceArray]:
        """The three buffers by their kernels' names."""
        return {"depth": self.depth, "color": self.color, "valid": self.valid}

    @property
    def origins(self) -> dict[str, DeviceArray]:
        """The buffers that tell where pixels come from by their kernels' names, if there are any."""
        if self.source is None or self.source_view is None:
            return {}
        return {"source": self.source, "source_view": self.source_view}

    def made_guesses(self) -> DeviceArray:
        """The depths of guessed surface, of which there is none yet if nothing that guesses was drawn before."""
        if self.guesses is None:
            self.guesses = empty(self.depth.shape, np.float32)
            self.guesses.fill(np.nan)
        return self.guesses

    @property
    def color_defines(self) -> dict[str, int]:
        """Defines of the colour's type and channels (kernels/lib/channel.h)."""
        return color_defines(self.color.dtype, self.color.shape[-1])

    @property
    def filter_defines(self) -> dict[str, int]:
        """Defines of how maps are filtered (kernels/lib/footprint.h)."""
        return {"ANISOTROPIC": 1} if self.anisotropy > 1 else {}

    @property
    def filter_arguments(self) -> dict[str, int]:
        """Of kernels that are built with `filter_defines`."""
        return {"anisotropy": self.anisotropy} if self.anisotropy > 1 else {}

    @cached_property
    def from_world(self) -> NDArray[np.float64]:
        """(4, 4) homogeneous pixel space over the world, see kernels/lib/pixelspace.h."""
        return self.camera.pixel_matrix @ self.camera.camera_from_world

    def near(self, bounds: tuple[NDArray[Any], NDArray[Any]]) -> float:
        """Least homogeneous W that a thing within a box, (low, high) in the world, is drawn at: its near plane."""
        low, high = (np.asarray(corner, np.float64) for corner in bounds)
        middle, eye = 0.5 * (low + high), self.camera.world_from_camera[:3, 3]
        far = float(np.linalg.norm(middle - eye) + 0.5 * np.linalg.norm(high - low))
        if far > 0:
            check_lengths(
                "light" if self.from_light else "things", far, far, "a distance to the farthest of a thing's points"
            )
        return 0.5 if self.camera.projection == "orthographic" else max(_NEAR * far, _NEAREST)  # W is 1, or z

    def screen(self, near: float, origin: NDArray[Any] | None = None) -> NDArray[np.void]:
        """A record of the kernels' struct Screen; with an `origin`, (3,) in the world, for points relative to it."""
        from_world = self.from_world
        if origin is not None:
            shift = np.eye(4)
            shift[:3, 3] = origin
            from_world = from_world @ shift
        values = np.zeros((), struct("lib/screen.h", "Screen"))
        values["from_world"] = from_world.ravel()
        values["to_world"] = np.linalg.inv(from_world).ravel()
        values["width"], values["height"] = self.camera.size
        perspective = self.camera.projection == "perspective"
        values["perspective"] = perspective
        values["nearest"] = 1.0 / near if perspective else 0.0
        return values

    @property
    def on_device(self) -> dict[str, DeviceArray]:
        """Buffers of all that its frame tells of pixels, by the frame's names; of `guessed` the guesses' depths."""
        told = {
            "color": self.color,
            "depth": self.depth,
            "valid": self.valid,
            "source": self.source,
            "view": self.source_view,
            "classes": self.classes,
            "alpha": self.alpha,
            "guessed": self.guesses,
        }
        return {name: array for name, array in told.items() if array is not None}

    def begin_frame(self) -> Callable[[], Frame]:
        """Begin to copy the picture to the host; once its session was waited for, what is returned makes the frame."""
        names, arrays = zip(*self.on_device.items(), strict=True)
        values: dict[str, Any] = dict(zip(names, begin_to_host(arrays), strict=True))

        def finished() -> Frame:
            told = {**values, "valid": values["valid"].view(np.bool_)}
            if "guessed" in values:
                told["guessed"] = values["guessed"] == values["depth"]
            if self.out is not None:
                told |= {"color": self.out.color, "depth": self.out.depth, "valid": self.out.valid}
            return Frame(camera=self.camera, **told)

        return finished

    def frame(self) -> Frame:
        """The picture on the host, once all launches are done."""
        finished = self.begin_frame()
        self.depth.session.wait()
        return finished()
