"""Settings of `cases`: kinds of colours, sizes and poisoned structs; and a record of the kernels that have run."""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

import pyibr as ibr
from pyibr.core.camera import Projection
from pyibr.images import DepthImage
from pyibr.opencl.headers import kernels_folder
from pyibr.opencl.launch import Struct
from pyibr.opencl.watch import Watch
from tests.scenes import Size

Kind = Literal["uint8", "float32", "depth alone"]
KINDS: tuple[Kind, ...] = ("uint8", "float32", "depth alone")
POISONS = (np.nan, np.inf, -np.inf, 0.0, 1e-38, 1e-20, 1e9, -1e9, 1e38, -1e38)
_T = TypeVar("_T")
Ran = set[tuple[str, str]]
"""Pairs of a kernel's name and the kind of colours on which it ran; "" for kernels without colours."""


class Launches(Watch):
    """Records the kernels that run, with their kinds of colours."""

    def __init__(self) -> None:
        self.ran: Ran = set()

    def launch(self, kernel, grid, arguments, enqueue) -> None:
        enqueue(**arguments)
        color = arguments["color"] if knows_colors(kernel.name) else None
        self.ran.add((kernel.name, "" if color is None or not color.shape[-1] else str(color.dtype)))


class Poisoned(Launches):
    """Replaces numbers in half of the launches' structs by invalid ones; equal structs get the same numbers."""

    def __init__(self, seed: int) -> None:
        super().__init__()
        self.seed = seed

    def launch(self, kernel, grid, arguments, enqueue) -> None:
        super().launch(kernel, grid, {name: self.poisoned(value) for name, value in arguments.items()}, enqueue)

    def poisoned(self, value: Any) -> Any:
        if not isinstance(value, Struct):
            return value
        rng = np.random.default_rng((self.seed, zlib.crc32(value.values.tobytes())))
        values, share = value.values.copy(), rng.choice((0.0, 0.25))
        for name in values.dtype.names or ():
            if values[name].dtype.kind == "f":
                numbers = values[name]
                values[name] = np.where(rng.random(numbers.shape) < share, rng.choice(POISONS, numbers.shape), numbers)
        return Struct(value.name, values)


@cache
def signatures(folder: str = "*", suffix: str = ".cl") -> dict[str, str]:
    """Parameters of each kernel in `kernels/` or one of its folders, by name. Kernels in headers run only on GPUs."""
    texts = [path.read_text() for path in sorted(kernels_folder().glob(f"{folder}/*{suffix}"))]
    found = [pair for text in texts for pair in re.findall(r"^kernel void (\w+)\((.*?)\)\n\{", text, re.M | re.S)]
    return dict(found)


def knows_colors(name: str) -> bool:
    """Tell whether a kernel reads or writes colours, and so is built for each kind of them."""
    return re.search(r"\bchannel \*", signatures(suffix=".*")[name]) is not None


def kernels_of(folder: str) -> Ran:
    """Return the expected launches: every kernel of a folder, on both kinds of colours."""
    return {(name, kind) for name in signatures(folder) for kind in (KINDS[:2] if knows_colors(name) else ("",))}


@dataclass(frozen=True)
class Setting:
    """Settings of a case."""

    kind: Kind  #: kind of the colours
    amount: int  #: of sizes and maps; 0: the fewest that run every kernel, as Oclgrind is slow; 1: some; 2: all
    empty: Callable[[tuple[int, ...], DTypeLike], NDArray[Any]] = field(default=np.empty)  #: makes arrays for `out`

    def choose(self, least: _T, some: _T, everything: _T) -> _T:
        """Choose sizes or maps of a case by `amount`."""
        return (least, some, everything)[self.amount]

    def colors(self, image: NDArray[np.uint8]) -> NDArray[Any]:
        """Return an image in this kind of colours: bytes, or floats in [0, 1]."""
        return image / np.float32(255) if self.kind == "float32" else image

    def noise(self, width: int, height: int) -> NDArray[Any]:
        """Return an image of random pixels."""
        return self.colors(np.random.default_rng(1).integers(0, 256, (height, width, 3)).astype(np.uint8))

    def view(self, make: Callable[[Size, Projection], DepthImage], size: Size, projection: Projection) -> DepthImage:
        """Return a new depth image of a scene, which shares no buffers with others."""
        kept = make(size, projection)
        color = None if self.kind == "depth alone" else self.colors(kept.color)
        return DepthImage(color, kept.depth, kept.camera, far=kept.far)

    def frame(self, camera: ibr.Camera) -> ibr.Frame:
        """Return a frame of new arrays, for `out`."""
        shape = camera.height, camera.width
        channels, dtype = (0, "uint8") if self.kind == "depth alone" else (3, self.kind)
        color, depth = self.empty((*shape, channels), dtype), self.empty(shape, "float32")
        return ibr.Frame(color, depth, self.empty(shape, "bool"), camera)
