"""Lights of `pyibr.render`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyibr.core.checks import Float64, Immutable, checked_bool, describe, integer_from, numbers, read_only
from pyibr.core.errors import ArgumentError
from pyibr.meshes.mesh import Mesh
from pyibr.opencl.headers import struct

_SHADOW_MAX = 16384
_FADE = 0.02  # a spot's light fades over this last part of its angle
_ANGLE_MIN = 1e-3  # degrees: in single precision, the cosine of a smaller angle is 1
_BRIGHTNESS_MAX = 1e6  # products of greater brightnesses may exceed single precision
_DISTANCE_MAX = 1e15  # scene units: greatest coordinate of a light's position


class Light(Immutable):
    """A directional light, point light or spot. Shading is Lambert's law with highlights; surfaces cast shadows.

    A light is immutable, and keeps its shadow maps for further pictures of the same things.

    Parameters
    ----------
    direction : array_like (3,), optional
        Direction in which the light travels, in the world; not zero. Without a position, the light is far away.
    position : array_like (3,), optional
        Position of the light, in the world. Light does not fall off with distance. Without a direction, it shines in
        all directions; with a direction, it is a spot.
    color : array_like (3,)
        Colour of the light, 0 to 1e6; 1 is white.
    ambient : float
        Ambient part of the light, 0 to 1.
    angle : float
        Full opening angle of a spot's cone, from 0.001 to less than 180 degrees. The light fades over the last 2 %.
    specular : float
        Strength of highlights, 0 to 1e6.
    shininess : float
        Exponent of the cosine between the normal and the halfway vector, > 0, up to 1e6; higher for narrower
        highlights.
    shadow_size : int
        Texels per side of the shadow map; 0 for no shadows.
    relight : bool
        Whether depth images, and surfaces made from images, are shaded like meshes, by given normals or by normals
        from their depths. Their colours must then be the surface's colours without light; photographs would be lit
        twice.

    Raises
    ------
    ArgumentError
        If neither direction nor position is given, or a value is out of range.

    Examples
    --------
    >>> import pyibr as ibr
    >>> ibr.Light(direction=(0, 0, 1))
    <Light direction (0, 0, 1)>
    """

    def __init__(
        self,
        *,
        direction: ArrayLike | None = None,
        position: ArrayLike | None = None,
        color: ArrayLike = (1.0, 1.0, 1.0),
        ambient: float = 0.25,
        angle: float = 90.0,
        specular: float = 0.0,
        shininess: float = 32.0,
        shadow_size: int = 1024,
        relight: bool = False,
    ) -> None:
        if direction is None and position is None:
            raise ArgumentError("direction", "a direction, a position, or both for a spot", "none")
        self.direction = None if direction is None else read_only(numbers("direction", direction, (3,)))
        self.position = None if position is None else read_only(numbers("position", position, (3,)))
        self.color = read_only(numbers("color", color, (3,)))
        self.ambient = _in_range("ambient", ambient, 0, 1)
        self.angle = float(numbers("angle", angle, ()))
        self.specular = _in_range("specular", specular, 0, _BRIGHTNESS_MAX)
        self.shininess = float(numbers("shininess", shininess, ()))
        if self.direction is not None and not self.direction.any():
            raise ArgumentError("direction", "a direction that is not zero", "(0, 0, 0)")
        if self.position is not None and np.abs(self.position).max() > _DISTANCE_MAX:
            raise ArgumentError(
                "position", f"numbers up to {_DISTANCE_MAX:g} (use a direction for farther lights)", describe(position)
            )
        if (self.color < 0).any() or (self.color > _BRIGHTNESS_MAX).any():
            raise ArgumentError("color", f"numbers from 0 to {_BRIGHTNESS_MAX:g}", describe(color))
        if not _ANGLE_MIN <= self.angle < 180:
            raise ArgumentError("angle", f"degrees from {_ANGLE_MIN:g} on and < 180", describe(angle))
        if not 0 < self.shininess <= _BRIGHTNESS_MAX:
            raise ArgumentError("shininess", f"a number > 0 and <= {_BRIGHTNESS_MAX:g}", describe(shininess))
        expected = f"0, or a whole number from 2 to {_SHADOW_MAX}"
        self.shadow_size = integer_from("shadow_size", shadow_size, 0, _SHADOW_MAX, expected)
        if self.shadow_size == 1:
            raise ArgumentError("shadow_size", expected, describe(shadow_size))
        self.relight = checked_bool("relight", relight)

    def __repr__(self) -> str:
        known = {"position": self.position, "direction": self.direction}
        parts = [f"{name} ({', '.join(f'{x:g}' for x in v)})" for name, v in known.items() if v is not None]
        return f"<Light {' '.join(parts)}>"

    def struct(self, origin: Float64) -> NDArray[np.void]:
        """Return a record of the kernels' struct Light, for points relative to an origin, (3,) in the world."""
        values = np.zeros((), struct("lib/light.h", "Light"))
        axis = np.zeros(3) if self.direction is None else _unit(self.direction)
        if self.position is None:
            values["vector"] = (*-axis, 0.0)
            values["axis"], values["cone_rise"] = (0, 0, 0, -2), 1
        else:
            values["vector"] = (*(self.position - origin), 1.0)
            half = np.radians(self.angle / 2)
            edge, full = (-2.0, -1.0) if self.direction is None else (np.cos(half), np.cos((1 - _FADE) * half))
            values["axis"], values["cone_rise"] = (*axis, edge), 1 / (full - edge)
        values["color"], values["ambient"] = self.color, self.ambient
        values["specular"], values["shininess"] = self.specular, self.shininess
        return values


def _unit(direction: Float64) -> Float64:
    """A direction at unit length, computed without overflow of its square."""
    near_1 = direction / np.abs(direction).max()
    return near_1 / np.linalg.norm(near_1)


def _in_range(argument: str, value: float, low: float, high: float) -> float:
    number = float(numbers(argument, value, ()))
    if not low <= number <= high:
        raise ArgumentError(
            argument, f"a number from {low:g} to {high:g}" if high < np.inf else f"a number >= {low:g}", repr(value)
        )
    return number


def light_for(thing: object, up: ArrayLike) -> Light | None:
    """Return a light from above for a mesh without colours; None for all other things."""
    if not isinstance(thing, Mesh) or thing.colors is not None or thing.texture is not None:
        return None
    upward = numbers("up", up, (3,))
    aside = np.cross(upward, np.eye(3)[np.abs(upward).argmin()])
    return Light(direction=-(upward + 0.6 * aside + 0.4 * np.cross(upward, aside)), ambient=0.3, shadow_size=0)
