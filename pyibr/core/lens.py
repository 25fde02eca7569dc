"""Lens distortion: the map from a pinhole's image positions to the lens's, and its inverse.

Positions are normalised, (X/Z, Y/Z) of a point in the camera's frame. A pinhole sees the point at the ideal position,
the lens at the distorted position. K maps distorted positions to pixels.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from pyibr.core.checks import Float64, checked_bool, numbers, one_of, positive_or_infinite
from pyibr.core.errors import ArgumentError

LensModel = Literal[
    "brown_conrady", "rational", "tilted", "inverse_brown_conrady", "modified_brown_conrady", "kannala_brandt"
]

_COEFFICIENT_MAX = 1e50  # coefficients below 1e-50 become 0: products of a few then fit into double precision
_COEFFICIENT_COUNTS: dict[str, tuple[int, ...]] = {
    "brown_conrady": (4, 5),
    "rational": (8,),
    "tilted": (12, 14),
    "inverse_brown_conrady": (4, 5),
    "modified_brown_conrady": (4, 5),
    "kannala_brandt": (4,),
}
_ANGLE_MAX = 0.4999 * math.pi  # radians from the axis: a pinhole sees at most half of the world
_TABLE_ENTRIES = 4096  # in the radius table, which gives starting values for the search
_SLOPE_MAX = 4.0  # largest derivative of distorted by ideal distance for a lens with a pole
_NEWTON_STEPS = 20  # limit; a handful suffices except at the border of the lens's view
_TOLERANCE = 1e-12  # for distances between positions
_CHUNK = 1 << 14  # points at a time


@dataclass(frozen=True, init=False, repr=False)
class Lens:
    """A lens that bends straight lines. Immutable.

    Parameters
    ----------
    model : str
        - "brown_conrady": k1 k2 p1 p2 [k3] of OpenCV, ROS's `plumb_bob` and Kalibr's `radtan`.
        - "rational": k1 k2 p1 p2 k3 k4 k5 k6 of OpenCV and ROS's `rational_polynomial`.
        - "tilted": the same, s1 s2 s3 s4 of a thin prism and [tx ty] in radians of a tilted sensor; OpenCV, DepthAI.
        - "modified_brown_conrady": k1 k2 p1 p2 [k3] of RealSense; the tangential part is applied after the radial part.
        - "inverse_brown_conrady": k1 k2 p1 p2 [k3] of RealSense. As in RealSense's library, it is computed like the
          modified model in both directions.
        - "kannala_brandt": k1 k2 k3 k4 of a fisheye, in `cv2.fisheye` and in ROS's and Kalibr's `equidistant`.
    coefficients : array_like
        The model's coefficients, in the order above.
    radius : float
        Largest ideal distance from the axis that the lens sees, > 0: the range of the calibration, if known (the metric
        radius of an Azure Kinect).

    Raises
    ------
    ArgumentError
        If the model is unknown, or the number of coefficients is wrong.

    Examples
    --------
    >>> import pyibr as ibr
    >>> lens = ibr.Lens("brown_conrady", [-0.2, 0, 0, 0])
    >>> seen = lens.distort([[0.5, 0.0], [2.0, 0.0]])
    >>> seen.tolist()  # from 1.29 on, what is farther out would be seen farther in
    [[0.475, 0.0], [nan, nan]]
    >>> lens.undistort(seen).round(12).tolist()
    [[0.5, 0.0], [nan, nan]]
    """

    model: LensModel
    coefficients: tuple[float, ...]
    radius: float

    def __init__(self, model: LensModel, coefficients: ArrayLike, *, radius: float = math.inf) -> None:
        one_of("model", model, LensModel)
        values, counts = numbers("coefficients", coefficients, (None,)), _COEFFICIENT_COUNTS[model]
        if len(values) not in counts:
            expected = f"{' or '.join(map(str, counts))} coefficients for {model}"
            raise ArgumentError("coefficients", expected, str(len(values)))
        if (largest := np.abs(values).max()) > _COEFFICIENT_MAX:
            raise ArgumentError("coefficients", f"numbers up to {_COEFFICIENT_MAX:g}", f"{largest:g}")
        padded = np.zeros(counts[-1])
        padded[: len(values)] = values
        reach = positive_or_infinite("radius", radius, "a distance > 0")
        for name, value in (("model", model), ("coefficients", tuple(padded.tolist())), ("radius", reach)):
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        radius = "" if self.radius == math.inf else f" radius={self.radius:g}"
        return f"<Lens {self.model} {' '.join(f'{value:g}' for value in self.coefficients)}{radius}>"

    @property
    def bends(self) -> bool:
        """Tell whether the lens distorts at all; a fisheye does with any coefficients."""
        return self.model == "kannala_brandt" or any(self.coefficients) or self.radius < math.inf

    @classmethod
    def from_opencv(cls, distortion: ArrayLike, *, fisheye: bool = False) -> Lens:
        """Make a lens from OpenCV's `distCoeffs` (4, 5, 8, 12 or 14 numbers), or from the 4 of `cv2.fisheye`.

        Raises
        ------
        ArgumentError
            If their number is wrong.
        """
        values = numbers("distortion", distortion, None).ravel()
        if len(values) not in ((4,) if fisheye else (4, 5, 8, 12, 14)):
            expected = "4 numbers of a fisheye" if fisheye else "4, 5, 8, 12 or 14 numbers"
            raise ArgumentError("distortion", expected, str(len(values)))
        if checked_bool("fisheye", fisheye):
            return cls("kannala_brandt", values)
        if values[8:].any():
            return cls("tilted", values)
        return cls("rational", values[:8]) if values[5:].any() else cls("brown_conrady", values[:5])

    def to_opencv(self) -> Float64:
        """Return `distCoeffs` of OpenCV (5, 8 or 14 numbers), or of `cv2.fisheye` (4) for "kannala_brandt".

        Raises
        ------
        ArgumentError
            If the model is one of RealSense's with a tangential part.
        """
        if self.model in ("inverse_brown_conrady", "modified_brown_conrady") and any(self.coefficients[2:4]):
            raise ArgumentError("lens", "a lens that OpenCV supports: p1 = p2 = 0, or another model", self.model)
        return np.array(self.coefficients)

    def distort(self, points: ArrayLike) -> Float64:
        """Return the distorted positions (N, 2) of ideal ones.

        NaN where the lens sees nothing: beyond the distance at which the model folds back, and beyond `radius`.
        """
        return _in_parts(self._distorted, numbers("points", points, (None, 2), finite=False))

    def undistort(self, points: ArrayLike) -> Float64:
        """Return the ideal positions of distorted ones (N, 2), NaN where the lens sees nothing. Inverts `distort`."""
        return _in_parts(self._undistorted, numbers("points", points, (None, 2), finite=False))

    @cached_property
    def reach(self) -> float:
        """Largest ideal distance from the axis that the lens sees; the distorted distance increases up to there."""
        if self.model == "kannala_brandt":
            k1, k2, k3, k4 = self.coefficients
            angle = math.sqrt(_first_root(Polynomial([1, 3 * k1, 5 * k2, 7 * k3, 9 * k4])))
            return min(math.tan(min(angle, _ANGLE_MAX)), self.radius)
        top, bottom = (Polynomial(part) for part in self._fraction)
        one = Polynomial([0, 1])
        rises = (top + 2 * one * top.deriv()) * bottom - 2 * one * top * bottom.deriv()  # by bottom^2: the slope
        square = _first_root(rises)
        if _first_root(bottom) < math.inf:  # calibrations become wrong well before a pole
            square = min(square, _first_root(_SLOPE_MAX * bottom * bottom - rises))
        return min(math.sqrt(square), math.tan(_ANGLE_MAX), self.radius)

    @property
    def _fraction(self) -> tuple[Float64, Float64]:
        """Coefficients of the radial factor's two polynomials in the squared distance from the axis."""
        k1, k2, _, _, k3, *below = self.coefficients[:8]
        return np.array([1.0, k1, k2, k3]), np.array([1.0, *below])

    def _factor(self, square: Float64) -> tuple[Float64, Float64]:
        """Ratio of distorted to ideal distance from the axis for squared ideal distances, and its derivative."""
        if self.model == "kannala_brandt":
            return self._fisheye_factor(square)
        (top, top_slope), (bottom, bottom_slope) = (_value_and_slope(part, square) for part in self._fraction)
        return top / bottom, (top_slope * bottom - top * bottom_slope) / (bottom * bottom)

    def _fisheye_factor(self, square: Float64) -> tuple[Float64, Float64]:
        radius = np.sqrt(square)
        angle = np.arctan(radius)
        series, slope = _value_and_slope(np.array([1.0, *self.coefficients]), angle * angle)
        distorted, steep = angle * series, (series + 2 * angle * angle * slope) / (1 + square)
        near = radius < 1e-4  # near the axis the quotients round too much: use the first terms of their series
        by = np.where(near, 1.0, radius)
        k1 = self.coefficients[0]
        factor = np.where(near, 1 + (k1 - 1 / 3) * square, distorted / by)
        return factor, np.where(near, k1 - 1 / 3, (steep - factor) / (2 * by * by))

    def _map(self, points: Float64) -> tuple[Float64, Float64]:
        """Distorted positions, (n, 2), and their derivatives by the ideal ones, (n, 2, 2)."""
        x, y = points.T
        square = x * x + y * y
        factor, slope = self._factor(square)
        (xx, xy), yy = 2 * slope * x * np.array([x, y]) + [factor, 0 * x], factor + 2 * slope * y * y
        if self.model == "kannala_brandt":
            return np.stack([x * factor, y * factor], 1), np.array([[xx, xy], [xy, yy]]).transpose(2, 0, 1)
        p1, p2 = self.coefficients[2:4]
        u, v = x * factor, y * factor
        if self.model in ("brown_conrady", "rational", "tilted"):  # tangential part at the ideal position
            du = xx + 2 * p1 * y + 6 * p2 * x, xy + 2 * p1 * x + 2 * p2 * y
            dv = xy + 2 * p2 * y + 2 * p1 * x, yy + 2 * p2 * x + 6 * p1 * y
            a, b = x, y
        else:  # tangential part at the radially moved position, with the ideal distance from the axis
            along, across = 1 + 2 * p1 * v + 4 * p2 * u, 1 + 2 * p2 * u + 4 * p1 * v
            du = xx * along + 2 * p1 * u * xy + 2 * p2 * x, xy * along + 2 * p1 * u * yy + 2 * p2 * y
            dv = xy * across + 2 * p2 * v * xx + 2 * p1 * x, yy * across + 2 * p2 * v * xy + 2 * p1 * y
            a, b = u, v
        moved_x = u + 2 * p1 * a * b + p2 * (square + 2 * a * a)
        moved_y = v + 2 * p2 * a * b + p1 * (square + 2 * b * b)
        if self.model == "tilted":  # a thin prism
            s1, s2, s3, s4 = self.coefficients[8:12]
            moved_x, moved_y = moved_x + square * (s1 + s2 * square), moved_y + square * (s3 + s4 * square)
            steep_x, steep_y = 2 * (s1 + 2 * s2 * square), 2 * (s3 + 2 * s4 * square)
            du, dv = (du[0] + steep_x * x, du[1] + steep_x * y), (dv[0] + steep_y * x, dv[1] + steep_y * y)
        return np.stack([moved_x, moved_y], 1), np.array([du, dv]).transpose(2, 0, 1)

    def _sees(self, points: Float64, slopes: Float64) -> Float64:
        """(n, 1) bool: whether the lens sees ideal positions and does not fold there."""
        inside = np.hypot(*points.T) < self.reach
        return (inside & (_determinant(slopes) > 0))[:, None]

    def _distorted(self, points: Float64) -> Float64:
        distorted, slopes = self._map(points)
        return np.where(self._sees(points, slopes), self._on_sensor(distorted), np.nan)

    def _on_sensor(self, points: Float64, back: bool = False) -> Float64:
        """Positions on a tilted sensor of positions (n, 2) on an upright one; `back`: the inverse."""
        if self.model != "tilted":
            return points
        matrix = np.linalg.inv(self.tilt) if back else self.tilt
        moved = points @ matrix[:, :2].T + matrix[:, 2]
        return moved[:, :2] / np.where(moved[:, 2:] > 0, moved[:, 2:], np.nan)

    @property
    def tilt(self) -> Float64:
        """(3, 3) homography from an upright sensor to a tilted one, as in OpenCV; the identity for other models."""
        tx, ty = self.coefficients[12:] or (0.0, 0.0)
        about_x = np.array([[1, 0, 0], [0, math.cos(tx), math.sin(tx)], [0, -math.sin(tx), math.cos(tx)]])
        about_y = np.array([[math.cos(ty), 0, -math.sin(ty)], [0, 1, 0], [math.sin(ty), 0, math.cos(ty)]])
        R = about_y @ about_x
        return np.array([[R[2, 2], 0, -R[0, 2]], [0, R[2, 2], -R[1, 2]], [0, 0, 1]]) @ R

    def _undistorted(self, points: Float64) -> Float64:
        """Newton's method, started at the inverse of the radial part."""
        points = self._on_sensor(points, back=True)
        away = np.hypot(*points.T)
        ideal, distorted = self._radii
        start = np.asarray(np.interp(away, distorted, ideal), np.float64)
        found = points * np.where(away > 0, start / np.where(away > 0, away, 1), 1)[:, None]
        left = np.flatnonzero(away <= distorted[-1] + self._aside)
        done = np.zeros(len(points), np.bool_)
        for _ in range(_NEWTON_STEPS):
            here = found[left]
            seen, slopes = self._map(here)
            off = points[left] - seen
            close = np.hypot(*off.T) <= _TOLERANCE * (1 + away[left])
            done[left[close]] = self._sees(here[close], slopes[close])[:, 0]
            left, off, slopes, here = left[~close], off[~close], slopes[~close], here[~close]
            if not len(left):
                break
            (xx, xy), (yx, yy) = slopes.transpose(1, 2, 0)
            step = np.stack([yy * off[:, 0] - xy * off[:, 1], xx * off[:, 1] - yx * off[:, 0]], 1)
            found[left] = here + step / _determinant(slopes)[:, None]
        return np.where(done[:, None], found, np.nan)

    @cached_property
    def _radii(self) -> tuple[Float64, Float64]:
        """Ideal distances from the axis and their distorted distances by the radial part, both increasing."""
        ideal = np.tan(np.linspace(0, math.atan(self.reach), _TABLE_ENTRIES))
        return ideal, np.maximum.accumulate(ideal * self._factor(ideal * ideal)[0])

    @property
    def _aside(self) -> float:
        """Bound on the displacement of a position by the tangential part and the prism."""
        if self.model == "kannala_brandt":
            return 0.0
        p1, p2 = self.coefficients[2:4]
        s1, s2, s3, s4 = self.coefficients[8:12] or (0.0, 0.0, 0.0, 0.0)
        by_prism = (abs(s1) + abs(s3)) * self.reach**2 + (abs(s2) + abs(s4)) * self.reach**4
        return 3 * (abs(p1) + abs(p2)) * self.reach**2 + by_prism


def _in_parts(function: Callable[[Float64], Float64], points: Float64) -> Float64:
    made = np.empty_like(points)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for first in range(0, len(points), _CHUNK):
            made[first : first + _CHUNK] = function(points[first : first + _CHUNK])
    return made


def _value_and_slope(coefficients: Float64, at: Float64) -> tuple[Float64, Float64]:
    """Value and slope of a polynomial; the constant coefficient comes first."""
    value, slope = np.full_like(at, coefficients[-1]), np.zeros_like(at)
    for coefficient in coefficients[-2::-1]:
        slope = slope * at + value
        value = value * at + coefficient
    return value, slope


def _determinant(slopes: Float64) -> Float64:
    return slopes[:, 0, 0] * slopes[:, 1, 1] - slopes[:, 0, 1] * slopes[:, 1, 0]


def _first_root(polynomial: Polynomial) -> float:
    """The smallest positive real root, or infinity."""
    roots = np.asarray(polynomial.trim(1 / _COEFFICIENT_MAX).roots(), np.complex128)
    real = roots.real[(np.abs(roots.imag) <= 1e-9 * np.abs(roots)) & (roots.real > 0)]
    return float(real.min()) if len(real) else math.inf
