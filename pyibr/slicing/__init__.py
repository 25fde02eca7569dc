"""Displacement mapping by slices, and objects from images (Kautz & Seidel 2001).

`SlicedSurface` displaces a mesh by a height map. `DepthObject` is the intersection of the volumes behind depth images,
`VisualHull` the intersection of silhouettes in space. `pyibr.render` draws them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import describe, instance_of
from pyibr.core.errors import ArgumentError
from pyibr.core.undistortion import check_no_lens
from pyibr.opencl.device import one_call
from pyibr.opencl.memory import zeros
from pyibr.picture.target import Target
from pyibr.slicing.drawing import draw_object
from pyibr.slicing.hull import VisualHull
from pyibr.slicing.object import DepthObject
from pyibr.slicing.solid import Solid
from pyibr.slicing.surface import SlicedSurface, draw_surface

__all__ = ["DepthObject", "SlicedSurface", "VisualHull", "alpha_tests"]


def alpha_tests(thing: SlicedSurface | DepthObject | VisualHull, camera: Camera) -> NDArray[np.int32]:
    """Count the alpha tests in a picture of one thing.

    Parameters
    ----------
    thing : SlicedSurface, DepthObject or VisualHull
        For a solid, each image that a point is tested against counts as one test. For a surface, each slice counts
        once, or twice where the ray meets it on the border of two triangles' prisms.
    camera : Camera

    Returns
    -------
    (H, W) int32
        Tests of each pixel.

    Raises
    ------
    ArgumentError
        If an argument has a wrong type.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> from pyibr.slicing import alpha_tests
    >>> corners, uv = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 0], [1, 0], [1, 1], [0, 1]]
    >>> square = ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3]], uv=uv)
    >>> height, color = np.full((4, 4), 0.48, np.float32), np.full((4, 4, 3), 200, np.uint8)
    >>> surface = ibr.SlicedSurface(square, height, color, scale=0.2, slices=20, slicing="surface")
    >>> camera = ibr.Camera.look_at((0.5, 0.5, 2), (0.5, 0.5, 0), (0, 1, 0), (9, 9), fov_y=20)
    >>> int(alpha_tests(surface, camera)[1, 6])  # slices 20, 19, ... 9, the first below the height of 9.6
    12
    """
    instance_of("camera", camera, Camera, "a pyibr.Camera")
    check_no_lens("camera", camera)
    with one_call():
        target = Target(camera, np.dtype(np.uint8))
        counters = zeros((camera.height, camera.width), np.int32)
        if isinstance(thing, SlicedSurface):
            draw_surface(target, thing, None, counters)
        elif isinstance(thing, Solid):  # pyright: ignore[reportUnnecessaryIsInstance]
            draw_object(target, thing, counters)
        else:
            raise ArgumentError("thing", "a SlicedSurface, DepthObject or VisualHull", describe(thing))
        return counters.to_host()
