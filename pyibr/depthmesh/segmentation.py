"""Segmentation of a depth image's full grid into surface triangles and rubber sheets, which bridge two surfaces."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import describe, numbers, one_of
from pyibr.core.errors import ArgumentError
from pyibr.images import DepthImage
from pyibr.opencl.headers import constant, struct

NOISE_MAX = 1e18  # scene units: products of greater noise and depths may exceed single precision

Test = Literal["orthogonality", "connectedness", "disparity", "none"]


@dataclass(frozen=True)
class Segmentation:
    """Test that tells rubber sheets from surfaces.

    Parameters
    ----------
    test : {"orthogonality", "connectedness", "disparity", "none"}
        "orthogonality" removes a triangle that is seen edge-on and long in depth (equations 3 and 4 of the paper),
        unless its surface continues straight as "connectedness" tests it. "connectedness" removes a triangle with an
        edge that is long in depth and continues the line of samples at neither of its ends (after Mark, McMillan &
        Bishop 1997). "disparity" removes a triangle if the disparities of its corners differ too much (after Oliveira
        & Bishop 1998). "none" removes nothing.
    angle : float
        omega, degrees in (0, 90): "orthogonality" removes only triangles at a smaller angle to the line of sight.
    depth_range : float
        lambda, > 0: "orthogonality" removes only triangles whose depths differ by more than this fraction of their
        depth. In orthographic views, where depths have no fixed origin, it is a fraction of the samples' largest
        extent along x, y or z.
    gap : float
        > 0: for the other tests, the largest relative difference of disparities (1 / z) within a surface; in
        orthographic views the largest difference of depths, relative to the samples' largest extent.
    deviations : float
        >= 0: in all tests, differences of depth up to this many standard deviations of the view's noise do not count
        as steps. The noise is estimated from the samples (`DepthImage.noise`); 0 ignores it.

    Raises
    ------
    ArgumentError
        If a value is out of its range.

    Examples
    --------
    >>> from pyibr.depthmesh import Segmentation
    >>> Segmentation(angle=3)
    Segmentation(test='orthogonality', angle=3, depth_range=0.02, gap=0.02, deviations=4.0)
    """

    test: Test = "orthogonality"
    angle: float = 5.0
    depth_range: float = 0.02
    gap: float = 0.02
    deviations: float = 4.0

    def __post_init__(self) -> None:
        one_of("test", self.test, Test)
        if not 0 < float(numbers("angle", self.angle, ())) < 90:
            raise ArgumentError("angle", "degrees between 0 and 90", describe(self.angle))
        for name in ("depth_range", "gap"):
            if not float(numbers(name, getattr(self, name), ())) > 0:
                raise ArgumentError(name, "a number > 0", describe(getattr(self, name)))
        if not float(numbers("deviations", self.deviations, ())) >= 0:
            raise ArgumentError("deviations", "a number >= 0", describe(self.deviations))

    def record(self, view: DepthImage, depth_span: float) -> NDArray[np.void]:
        """Make a record of the kernels' struct Segmentation; `depth_span` is the range of the view's depths."""
        values = np.zeros((), struct("depthmesh/samples.cl", "Segmentation"))
        values["test"] = constant("depthmesh/samples.cl", f"TEST_{self.test.upper()}")
        values["sine"] = math.sin(math.radians(self.angle))
        values["depth_range"], values["gap"] = self.depth_range, self.gap
        if self.deviations > 0 and self.test != "none":
            values["noise"] = np.minimum(self.deviations * np.array(view.noise), NOISE_MAX)
        if view.camera.projection == "orthographic":
            values["extent"] = max(*_sides(view), depth_span)
        return values


def _sides(view: DepthImage) -> NDArray[np.float64]:
    """(2,) extents of an orthographic view's samples along x and y, in scene units."""
    y = np.flatnonzero(view.valid.any(axis=1))
    first, last = view.valid.argmax(axis=1)[y], view.camera.width - 1 - view.valid[:, ::-1].argmax(axis=1)[y]
    ends = np.stack([np.concatenate([first, last]), np.concatenate([y, y])])
    return np.ptp(np.linalg.inv(view.camera.K)[:2, :2] @ ends, axis=1)
