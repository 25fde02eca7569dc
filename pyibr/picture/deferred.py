"""Lighting of surfaces made from images, after all things are drawn (kernels/picture/deferred.cl)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pyibr.opencl.device import current
from pyibr.opencl.headers import constant
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, empty, upload
from pyibr.opencl.program import kernel
from pyibr.picture.shadow import Lighting
from pyibr.picture.target import GBuffer, Target


@dataclass(frozen=True)
class Entry:
    """Defines and arguments of kernels that draw a thing with deferred lighting; empty without it.

    Attributes
    ----------
    normals : bool
        Whether the kernels also draw the thing's normals.
    defines : dict
        Defines for `pyibr.opencl.program.kernel`.
    arguments : dict
        Arguments for `pyibr.opencl.launch.launch`.
    """

    normals: bool = False
    defines: dict[str, int] = field(default_factory=dict[str, int])
    arguments: dict[str, Any] = field(default_factory=dict[str, Any])

    def with_arrays(self, **arrays: DeviceArray) -> Entry:
        """Return the same with further arguments, such as normal images."""
        return replace(self, arguments=self.arguments | arrays)


NO_ENTRY = Entry()


def entry_for(
    target: Target,
    lighting: Lighting | None,
    *,
    bias: float = 0.0,
    apart: int = 1,
    fade: float = 0.1,
    normals: bool = False,
) -> Entry:
    """Register a thing for deferred lighting, because its colours already contain light.

    The thing then receives shadows; a light with `Light.relight` shades it completely.

    Parameters
    ----------
    target : Target
        Target that the thing is about to be drawn into.
    lighting : Lighting, optional
        Without a light, or without both shadows and `relight`, nothing happens.
    bias : float
        Shadow bias in scene units: how far drawn points may lie in front of the true surface.
    apart : int
        Distance in pixels from a pixel to the neighbours whose depths, with its own, give its normal.
    fade : float
        Cosine between light and normal below which direct light fades out; 0 for solids, whose fronts shadow their
        backs. With `relight`, Lambert's law applies instead.
    normals : bool
        Whether the thing's kernels can draw normals, for `relight`; otherwise they are computed from the picture's
        depths.

    Returns
    -------
    Entry
        For the kernels that draw the thing.
    """
    if lighting is None or not (lighting.light.relight or lighting.maps is not None):
        return NO_ENTRY
    if target.gbuffer is None:
        target.gbuffer = GBuffer(target.camera)
    made, draws = target.gbuffer, normals and lighting.light.relight
    arguments: dict[str, Any] = {"gbuffer_depth": made.depth, "gbuffer_thing": made.thing, "thing": len(made.things)}
    made.things.append((bias, apart, fade, draws))
    if not draws:
        return Entry(False, {"GBUFFER": 1}, arguments)
    if made.normal is None:
        made.normal = empty((*made.depth.shape, 3), np.float32)
    return Entry(True, {"GBUFFER": 2}, arguments | {"gbuffer_normal": made.normal})


def light_things(target: Target, lighting: Lighting | None) -> None:
    """Light all registered things in a target."""
    gbuffer = target.gbuffer
    if lighting is None or gbuffer is None:
        return
    target.gbuffer = None
    origin = target.camera.center  # float32 is most accurate near 0
    relit = lighting.light.relight
    more = {"normals": gbuffer.depth if gbuffer.normal is None else gbuffer.normal} if relit else {}
    records = np.array(gbuffer.things, np.float64).clip(0, np.finfo(np.float32).max).astype(np.float32)
    assert records.shape[1] == constant("picture/deferred.cl", "THING")
    launch(
        kernel("picture/deferred.cl", "light_things", RELIT=int(relit), **lighting.defines, **target.color_defines),
        current().profile.packets(*target.camera.size),
        entered=gbuffer.depth,
        numbers=gbuffer.thing,
        things=upload(records),
        screen=Struct("Screen", target.screen(0.5, origin)),
        depth=target.depth,
        color=target.color,
        **lighting.arguments(origin=origin),
        **more,
    )
