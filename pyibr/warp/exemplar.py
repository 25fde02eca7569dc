"""Texture continued into filled holes by patches of the same surface, by kernels/warp/exemplar.cl."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np

from pyibr.core.pixelspace import longer_side
from pyibr.opencl.device import current
from pyibr.opencl.headers import constant
from pyibr.opencl.launch import launch
from pyibr.opencl.memory import copy, empty
from pyibr.opencl.program import kernel
from pyibr.picture.target import Target

_LEVELS = 3
_SIDE_MIN = 32  # pixels: pictures with a shorter side are not halved
_EDGE = 2  # pixels of the picture along a depth jump whose colours may be mixed
_RADIUS = 8  # pixels of the random search below the coarsest level
_JUMPS = 3, 1  # pixels to the neighbours whose matches are tried
_PASSES = 1, 1, 2  # of the search between two votes, fine to coarse


class _Level:
    """A picture of one resolution, and the matches of its pixels."""

    def __init__(self, width: int, height: int, target: Target) -> None:
        pad = int(constant("warp/exemplar.cl", "PAD"))
        self.width, self.height, self.defines = width, height, target.color_defines
        self.pitch, self.rows = -(-width // 16) * 16 + 2 * pad, height + 2 * pad  # whole packets, whatever LANES is
        shape = self.rows, self.pitch
        self.image, self.planes = empty((*shape, 4), np.float32), empty((5, *shape), np.float32)
        self.filled = self.image
        self.field, self.spare = (empty(shape, np.int32) for _ in range(2))
        for field in (self.field, self.spare):
            field.fill(int(constant("warp/exemplar.cl", "NO_TARGET")))

    def launch(self, name: str, **arguments: Any) -> None:
        profile, begins = current().profile, name in ("begin_level", "halve_level")  # these write the padding, too
        grid = profile.packets(*((self.pitch, self.rows) if begins else (self.width, self.height)), profile.strip)
        found = kernel("warp/exemplar.cl", name, **self.defines)
        given = {"image": self.image, "planes": self.planes, "width": self.width, "height": self.height}
        own = {each: value for each, value in given.items() if each in found.names}
        launch(found, grid, pitch=self.pitch, strip=profile.strip, **own, **arguments)

    def search(self, number: int, jump: int, radius: int) -> None:
        """Improve all matches."""
        guide = 0.0 if self.filled is self.image else constant("warp/exemplar.cl", "FILLED_WEIGHT")
        fields = {"from": self.field, "to": self.spare}
        self.launch(
            "search_patches", filled=self.filled, guide=guide, jump=jump, radius=radius, number=number, **fields
        )
        self.field, self.spare = self.spare, self.field


def continue_texture(target: Target, spread: Callable[[Target], None]) -> None:
    """Replace the colours of filled holes by patches of the same surface, where patches predict the surroundings.

    spread: fills the holes of a picture in the same way as the target's holes.
    """
    levels, number = _levels_of(target), itertools.count()
    for step, level in reversed([*enumerate(levels)]):
        level.launch("find_targets", edge=_EDGE >> step, field=level.field)
        radius = max(level.width, level.height) // 2
        if level is not levels[-1]:
            above, radius = levels[step + 1], _RADIUS
            level.launch("refine_matches", coarse=above.field, coarse_pitch=above.pitch, field=level.field)
            level.launch("vote", field=level.field)
        for _ in range(3**step):
            for jump in _PASSES[step] * _JUMPS:
                level.search(next(number), jump, radius)
            level.launch("vote", field=level.field)
    marked = Target(target.camera, np.dtype(np.uint8))
    copy(target.depth, marked.depth)
    copy(target.valid, marked.valid)
    levels[0].launch("mark_matches", field=levels[0].field, marks=marked.color)
    spread(marked)
    levels[0].launch("show_patches", marks=marked.color, color=target.color)


def _levels_of(target: Target) -> list[_Level]:
    """The picture, and pictures of half the resolution, a quarter and so on."""
    perspective = target.camera.projection == "perspective"
    levels = [_Level(*target.camera.size, target)]
    per_depth = 1.0 if perspective else 1 / longer_side(target.camera)
    levels[0].launch("begin_level", perspective=int(perspective), per_depth=per_depth, **target.outputs())
    while len(levels) < _LEVELS and min(levels[-1].width, levels[-1].height) >= _SIDE_MIN:
        fine = levels[-1]
        level = _Level(fine.width // 2, fine.height // 2, target)
        level.launch("halve_level", fine_image=fine.image, fine_planes=fine.planes, fine_pitch=fine.pitch)
        level.filled = empty(level.image.shape, np.float32)
        copy(level.image, level.filled)
        levels.append(level)
    return levels
