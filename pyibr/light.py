"""Lights of `pyibr.render`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyibr._check import numbers
from pyibr.errors import ArgumentError

_LIGHT = np.dtype([("vector", np.float32, 4), ("color", np.float32, 3), ("ambient", np.float32)])
"""The struct Light of kernels/lib/light.h."""


class Light:
    """A light: far away, or at a point. Surfaces follow Lambert's law.

    Parameters
    ----------
    direction : array_like (3,), optional
        Where the light goes, in the world; not zero. Either this or `position`.
    position : array_like (3,), optional
        Where it is, in the world. It does not fall off with distance.
    color : array_like (3,)
        Of what it lights straight on, >= 0; 1 is white.
    ambient : float
        The part of the light that comes from everywhere, 0 to 1.

    Raises
    ------
    ArgumentError
        If neither or both of direction and position are given, or a value is out of its range.

    Examples
    --------
    >>> import pyibr as ibr
    >>> ibr.Light(direction=(0, 0, 1))
    <Light direction (0, 0, 1)>
    """

    def __init__(
        self,
        direction: ArrayLike | None = None,
        position: ArrayLike | None = None,
        color: ArrayLike = (1.0, 1.0, 1.0),
        ambient: float = 0.25,
    ) -> None:
        if (direction is None) == (position is None):
            raise ArgumentError("direction", "either direction or position", "both" if position is not None else "none")
        self.direction = None if direction is None else numbers("direction", direction, (3,))
        self.position = None if position is None else numbers("position", position, (3,))
        self.color = numbers("color", color, (3,))
        self.ambient = float(numbers("ambient", ambient, ()))
        if self.direction is not None and not self.direction.any():
            raise ArgumentError("direction", "a direction that is not zero", "(0, 0, 0)")
        if (self.color < 0).any():
            raise ArgumentError("color", "numbers >= 0", str(self.color))
        if not 0 <= self.ambient <= 1:
            raise ArgumentError("ambient", "a number from 0 to 1", repr(ambient))

    def __repr__(self) -> str:
        name, vector = ("direction", self.direction) if self.position is None else ("position", self.position)
        return f"<Light {name} ({', '.join(f'{x:g}' for x in vector)})>" if vector is not None else "<Light>"

    @property
    def struct(self) -> NDArray[np.void]:
        """A record of the kernels' struct Light."""
        values = np.zeros((), _LIGHT)
        if self.position is not None:
            values["vector"] = (*self.position, 1.0)
        elif self.direction is not None:
            values["vector"] = (*(-self.direction / np.linalg.norm(self.direction)), 0.0)
        values["color"], values["ambient"] = self.color, self.ambient
        return values
