"""Light on what is made of images, once all things are drawn (kernels/picture/deferred.cl)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pyibr.opencl.device import current
from pyibr.opencl.headers import constant
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, empty, upload
from pyibr.opencl.program import kernel
from pyibr.picture.gbuffer import GBuffer
from pyibr.picture.shadow import Lighting
from pyibr.picture.target import Target


@dataclass(frozen=True)
class Entry:
    """Defines and arguments of kernels that draw a thing which is lit afterwards; empty, if it is not lit.

    Attributes
    ----------
    normals : bool
        Whether the thing's normals are to be drawn, too.
    defines : dict
        For `pyibr.opencl.program.kernel`.
    arguments : dict
        For `pyibr.opencl.launch.launch`.
    """

    normals: bool = False
    defines: dict[str, int] = field(default_factory=dict[str, int])
    arguments: dict[str, Any] = field(default_factory=dict[str, Any])

    def with_arrays(self, **arrays: DeviceArray) -> Entry:
        """The same with further arguments, as the images of normals that are drawn."""
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
    """Enter a thing whose colours hold the light that they were taken in among those that are lit afterwards.

    It gets its shadows; or, by a light with `Light.relight`, all of the light.

    Parameters
    ----------
    target : Target
        That it is about to be drawn into.
    lighting : Lighting, optional
        Without one, or without its shadows if it does not relight, nothing happens.
    bias : float
        Scene units by which the thing may lie before its surface.
    apart : int
        Pixels between the depths that tell its normals.
    fade : float
        Cosine between light and normal from which it fades as it turns away; 0 for solids, whose fronts hide their
        backs. Relit, it fades by Lambert's law.
    normals : bool
        Whether it can draw normals of its own, for a light that relights; else the picture's depths tell them.

    Returns
    -------
    Entry
        For the kernels that draw it.
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
    """Light all that was entered while it was drawn into a target."""
    gbuffer = target.gbuffer
    if lighting is None or gbuffer is None:
        return
    target.gbuffer = None
    origin = target.camera.center  # float32 holds what is near 0 best
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
