"""The render target that all systems draw into, with one depth buffer."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import check_lengths, check_pixels
from pyibr.images import Frame
from pyibr.opencl.device import current
from pyibr.opencl.headers import struct
from pyibr.opencl.launch import launch
from pyibr.opencl.memory import DeviceArray, begin_to_host, empty, output
from pyibr.opencl.memory_pool import rounded
from pyibr.opencl.program import kernel

_NEAR = 1e-5  # near plane, relative to the distance of the farthest point that is drawn
_NEAREST = 1e-30  # scene units: near plane for a point at the camera's centre


def color_defines(dtype: np.dtype[Any], channels: int) -> dict[str, int]:
    """Return the defines for a colour's type and channels (kernels/lib/channel.h)."""
    return {"COLOR_BYTES": dtype.itemsize, "CHANNELS": channels}


def clear(array: DeviceArray, value: float) -> None:
    """Set all elements of a float32 or uint32 array to one value, on all processors."""
    count, profile = math.prod(array.shape), current().profile
    name = "clear_uints" if array.dtype == np.uint32 else "clear"
    arguments = {"values": array, "count": count, "share": profile.share, "value": value}
    launch(kernel("picture/begin.cl", name), profile.shares(count), **arguments)


def in_words(features: NDArray[Any]) -> NDArray[Any]:
    """Return features as kernels take them: float16 as uint16."""
    return features.view(np.uint16) if features.dtype == np.float16 else features


class GBuffer:
    """The G-buffer (Saito & Takahashi 1990): geometry of the pixels that are lit after all things are drawn.

    The kernels that draw these things write the buffers (kernels/lib/gbuffer.h).

    Parameters
    ----------
    camera : Camera
        Camera of the picture.

    Attributes
    ----------
    depth, thing : (H, W) DeviceArray
        float32 and int32. Where the depth differs from the picture's depth, the pixel shows another thing.
    normal : (H, W, 3) float32 DeviceArray, or None
        None until a thing with normals is drawn.
    things : list of tuples
        Parameters of each thing for `light_things`.
    """

    def __init__(self, camera: Camera) -> None:
        shape = camera.height, camera.width
        self.depth, self.thing = empty(shape, np.float32), empty(shape, np.int32)
        self.depth.fill(np.nan)
        self.normal: DeviceArray | None = None
        self.things: list[tuple[float, int, float, bool]] = []


class Target:
    """Colour, depth and coverage on the current device.

    Parameters
    ----------
    camera : Camera
    dtype : dtype
        Type of the colour: uint8 or float32.
    channels : int
        Number of colour channels: 3, or 0 for depth alone.
    from_light : bool
        The target is a light's shadow map, and only depths count.
    out : Frame, optional
        Frame whose arrays are written, instead of new ones.
    origins : bool
        Whether the source view and the position in it are written for each pixel.
    classes : bool
        Whether pixel classes are written.
    anisotropy : int
        Maximum number of texture reads along a pixel's footprint; 1 treats each footprint as round.
    pool : dict, optional
        Scratch memory by size, for targets that are drawn one after the other.
    side : int
        Number of this target's pixels along each side of the final picture's pixels.
    background : (3,) array, optional
        Colour of empty pixels, in the range of the dtype.

    Attributes
    ----------
    alpha : (H, W) float32 DeviceArray, or None
        The opacity, with several samples per pixel (the fraction of samples that show a surface) or with things that
        are not opaque.
    features : (H, W, C) DeviceArray, or None
        Features of the surface, if the views have some; float16 as uint16.
    guesses : (H, W) float32 DeviceArray, or None
        Depths at which guessed surface was drawn, or None if there is none. A pixel shows guessed surface only if this
        depth equals the picture's depth.
    blank : bool
        Whether nothing has been written yet. The first thing writes every pixel; later things keep nearer pixels.
    filled : bool
        Whether holes have been filled: they then have colours and depths, but are not valid.
    guessed : bool
        Whether guesses are drawn in holes. Until `hide_guesses`, they count as surface.
    mixable : bool
        Whether colours may be interpolated on surfaces when this target becomes part of another picture. Things whose
        colours are labels set it to False.
    gbuffer : GBuffer, or None
        Pixels to light after all things are drawn, if there are any (`pyibr.picture.deferred`).
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
        side: int = 1,
        background: NDArray[np.float64] | None = None,
    ) -> None:
        check_pixels("camera", camera.size)
        shape = (camera.height, camera.width)
        self.camera = camera
        self.out = out
        self._pool: dict[tuple[int, int], DeviceArray] = {} if pool is None else pool
        if out is None:
            self.color = empty((*shape, channels), dtype)
            self.depth, self.valid = empty(shape, np.float32), empty(shape, np.uint8)
        else:
            self.color, self.depth, self.valid = output(out.color), output(out.depth), output(out.valid.view(np.uint8))
        self.source = empty((*shape, 2), np.float32) if origins else None
        self.source_view = empty(shape, np.int32) if origins else None
        self.classes = empty(shape, np.uint8) if classes else None
        self.alpha: DeviceArray | None = None
        self.features: DeviceArray | None = None
        self.guesses: DeviceArray | None = None
        self.blank = True
        self.filled = False
        self.guessed = False
        self.mixable = True
        self.from_light = from_light
        self.anisotropy = anisotropy
        self.side, self.background = side, background
        self.gbuffer: GBuffer | None = None

    def layer(self) -> Target:
        """Return a target of the same kind, for a part of this picture. It shares the buffer of classes."""
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
        """Return scratch memory of at least `count` float32, valid until the next request with the same number."""
        size = rounded(4 * count) // 4  # rounding lets views of similar sizes share it
        if (size, number) not in self._pool:
            self._pool[size, number] = empty((size,), np.float32)
        return self._pool[size, number]

    def clear(self) -> None:
        """Clear every pixel, if none is written yet. For systems that write only the pixels that they cover."""
        if self.blank:
            self.color.fill(0)
            self.depth.fill(np.nan)
            self.valid.fill(0)
            self.blank = False

    def hide_guesses(self) -> None:
        """Make guesses in holes invalid."""
        if self.guessed:
            self.filled, (width, height), profile = True, self.camera.size, current().profile
            grid = profile.packets(width, height, profile.strip)
            size = {"width": width, "height": height, "strip": profile.strip}
            launch(kernel("picture/guesses.cl", "hide_guesses"), grid, valid=self.valid, **size)

    def show_background(self) -> None:
        """Show the background where nothing is drawn, fills included."""
        if self.background is not None:
            self._launch("show_background", depth=self.depth, color=self.color, **self.background_arguments)

    def made_alpha(self) -> DeviceArray:
        """Return the opacities; if there are none, they are made from `valid`."""
        if self.alpha is None:
            self.alpha = empty(self.depth.shape, np.float32)
            self._launch("valid_to_alpha", valid=self.valid, alpha=self.alpha)
        return self.alpha

    def made_features(self, channels: int, dtype: np.dtype[Any]) -> DeviceArray:
        """Return the buffer of features; it is created, undefined, if there is none."""
        if self.features is None:
            out, shape = None if self.out is None else self.out.features, (*self.depth.shape, channels)
            kept = empty(shape, np.uint16 if dtype == np.float16 else dtype) if out is None else output(in_words(out))
            self.features = kept
        return self.features

    def _launch(self, name: str, **arguments: Any) -> None:
        (width, height), profile = self.camera.size, current().profile
        found = kernel("picture/behind.cl", name, **self.color_defines)
        launch(found, profile.packets(width, height, profile.strip), width=width, height=height, **arguments)

    @property
    def background_arguments(self) -> dict[str, float]:
        """The background, black if there is none, by the names of kernel arguments."""
        color = np.zeros(3) if self.background is None else self.background
        return dict(zip(("red", "green", "blue"), color.tolist(), strict=True))

    def outputs(self) -> dict[str, DeviceArray]:
        """Return the three buffers, by the names of kernel arguments."""
        return {"depth": self.depth, "color": self.color, "valid": self.valid}

    @property
    def origins(self) -> dict[str, DeviceArray]:
        """Buffers with the origins of pixels, by the names of kernel arguments; empty if there are none."""
        if self.source is None or self.source_view is None:
            return {}
        return {"source": self.source, "source_view": self.source_view}

    def made_guesses(self) -> DeviceArray:
        """Return the depths of guessed surface; the buffer is created, all NaN, if there is none."""
        if self.guesses is None:
            self.guesses = empty(self.depth.shape, np.float32)
            self.guesses.fill(np.nan)
        return self.guesses

    @property
    def color_defines(self) -> dict[str, int]:
        """Defines for the colour's type and channels (kernels/lib/channel.h)."""
        return color_defines(self.color.dtype, self.color.shape[-1])

    @property
    def filter_defines(self) -> dict[str, int]:
        """Defines for texture filtering (kernels/lib/footprint.h)."""
        return {"ANISOTROPIC": 1} if self.anisotropy > 1 else {}

    @property
    def filter_arguments(self) -> dict[str, int]:
        """Arguments of kernels that are built with `filter_defines`."""
        return {"anisotropy": self.anisotropy} if self.anisotropy > 1 else {}

    @cached_property
    def from_world(self) -> NDArray[np.float64]:
        """(4, 4) matrix from the world to homogeneous pixel space, see kernels/lib/pixelspace.h."""
        return self.camera.pixel_matrix @ self.camera.camera_from_world

    def near(self, bounds: tuple[NDArray[Any], NDArray[Any]]) -> float:
        """Return the near plane for a thing within a box, (low, high) in the world: the least homogeneous W."""
        low, high = (np.asarray(corner, np.float64) for corner in bounds)
        middle, eye = 0.5 * (low + high), self.camera.world_from_camera[:3, 3]
        far = float(np.linalg.norm(middle - eye) + 0.5 * np.linalg.norm(high - low))
        if far > 0:
            check_lengths("light" if self.from_light else "things", far, far, "a distance to a thing's farthest point")
        return 0.5 if self.camera.projection == "orthographic" else max(_NEAR * far, _NEAREST)  # W is 1, or z

    def screen(self, near: float, origin: NDArray[Any] | None = None) -> NDArray[np.void]:
        """Return a record of the kernels' struct Screen; points are relative to `origin`, (3,) in the world."""
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
        """Buffers of all per-pixel data, by the names of `Frame`; `guessed` holds the depths of guessed surface."""
        told = {
            "color": self.color,
            "depth": self.depth,
            "valid": self.valid,
            "source": self.source,
            "view": self.source_view,
            "classes": self.classes,
            "alpha": self.alpha,
            "guessed": self.guesses,
            "features": self.features,
        }
        return {name: array for name, array in told.items() if array is not None}

    def begin_frame(self) -> Callable[[], Frame]:
        """Begin to copy the picture to the host. After the session's wait, the returned function makes the frame."""
        names, arrays = zip(*self.on_device.items(), strict=True)
        values: dict[str, Any] = dict(zip(names, begin_to_host(arrays), strict=True))

        def finished() -> Frame:
            told = {**values, "valid": values["valid"].view(np.bool_)}
            if "guessed" in values:
                told["guessed"] = values["guessed"] == values["depth"]
            if "features" in values and values["features"].dtype == np.uint16:
                told["features"] = values["features"].view(np.float16)
            if self.out is not None:
                told |= {"color": self.out.color, "depth": self.out.depth, "valid": self.out.valid}
                if self.features is not None and self.out.features is not None:
                    told["features"] = self.out.features
            return Frame(camera=self.camera, **told)

        return finished

    def frame(self) -> Frame:
        """Wait for all launches and return the picture on the host."""
        finished = self.begin_frame()
        self.depth.session.wait()
        return finished()
