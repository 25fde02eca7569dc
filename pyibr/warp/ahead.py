"""Programs of the warp, built beside a process that draws its first picture."""

from __future__ import annotations

from pyibr.core.pixelspace import CameraPair
from pyibr.opencl.ahead import build_ahead
from pyibr.opencl.headers import constant
from pyibr.picture.deferred import Entry
from pyibr.picture.target import Target
from pyibr.warp.launches import Options


def build_ahead_of_warp(pair: CameraPair, target: Target, options: Options, entry: Entry) -> None:
    """Have the programs built that drawing a view needs (`inverse_warp`), in their order, beside this process."""
    build_ahead("picture/begin.cl", "find_edges")
    if not options.search:
        on_samples = pair.aligned and pair.off_samples < constant("lib/surface.h", "ON_SAMPLES")
        exact = not (on_samples if pair.aligned else not options.connected)
        build_ahead("warp/epipolar.cl", "epipolar_sweep", ALIGNED=int(pair.aligned), EDGES=int(exact))
    origins = len(target.origins) and 1 + (target.classes is not None)
    defines = {"ORIGINS": origins, **target.color_defines, **entry.defines}
    build_ahead("warp/resolve.cl", "resolve", compiled=True, **defines)
