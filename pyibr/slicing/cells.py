"""Surfaces of depth images between their samples, on the device (kernels/slicing/cells.cl)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pyibr.images import DepthImage
from pyibr.opencl.device import current
from pyibr.opencl.headers import constant, struct
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, empty, upload
from pyibr.opencl.program import kernel
from pyibr.slicing.boxes import Box, depth_extent_of

_CELLS = "slicing/cells.cl"


def maps_of(views: Sequence[DepthImage], box: Box, missing_is_empty: bool) -> DeviceArray:
    """Return nearness of the views' samples and their cells, one view after the other (kernels/slicing/records.h).

    Empty samples count as far as the far end of the box, unknown samples as near as its near end.
    """
    maps = empty((2 * sum(view.depth.size for view in views),), np.float32)
    start, strip = 0, current().profile.strip
    for view in views:
        width, height = view.camera.size
        z = view.camera.camera_from_world[2, :3] @ box.corners.T + view.camera.camera_from_world[2, 3]
        perspective = view.camera.projection == "perspective"
        far = max(float(z.max()), depth_extent_of(view).farthest)
        near = max(float(z.min()), 1e-3 * far) if perspective else float(z.min())
        image = np.zeros((), struct(_CELLS, "CellImage"))
        image["width"], image["height"], image["perspective"] = width, height, perspective
        image["far"], image["missing_is_empty"], image["per_sample"] = view.far, missing_is_empty, _per_sample(view)
        image["empty"], image["unknown"] = (1 / far, 1 / near) if perspective else (-far, -near)
        launch(
            kernel(_CELLS, "find_cells"),
            current().profile.packets(width, height, strip),
            depth=upload(view.depth),
            maps=maps,
            start=start,
            image=Struct("CellImage", image),
        )
        start += 2 * width * height
    return maps


def _per_sample(view: DepthImage) -> float:
    """Return the change of nearness if depth changes by a sample's width; in perspective views at nearness 1."""
    return 1 / float(min(view.camera.K[0, 0], view.camera.K[1, 1]))


def reaches_of(views: Sequence[DepthImage]) -> DeviceArray:
    """Return for each view the greatest difference in nearness between its surface and the nearest samples around."""
    made: list[float] = []
    for view in views:
        nearest = 1 / depth_extent_of(view).least if view.camera.projection == "perspective" else 1.0
        made.append(1.001 * constant(_CELLS, "RISE_MAX") * _per_sample(view) * nearest)
    return upload(np.array(made, np.float32))
