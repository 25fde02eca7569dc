"""OpenEXR images: layers of half or float channels, in one part or several; colours are linear in light.

A channel's full name is its layer's name, a dot, and its own name: `ViewLayer.Depth.Z`. Pixels cover the display
window; pixels outside the data window are empty.
"""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.errors import FileFormatError
from pyibr.core.files import check_unpacked, reading, write_atomically
from pyibr.core.optional import openexr
from pyibr.io.arrays import CHOICE

_Path = str | PathLike[str]
_DEPTH = re.compile(r"depth|^p?z$|^zbuffer$", re.IGNORECASE)
_NO_DEPTH = re.compile(r"^(mist|fog)$", re.IGNORECASE)
_PICTURE = {"combined", "beauty", "rgb", "rgba", "color", "colour", "finalimage"}
_RGB = ("R", "G", "B")


@dataclass(frozen=True, eq=False)
class _Layer:
    """Channels of a part whose names differ only in their last word."""

    part: str
    name: str
    channels: dict[str, NDArray[Any]]
    windows: tuple[NDArray[np.int32], ...]
    """First and last pixel of the data window, and of the display window."""

    @property
    def title(self) -> str:
        """Name of the layer, or of the part if the layer has none."""
        return self.name.rpartition(".")[2] or self.part

    def label(self, channel: str = "") -> str:
        """Full name of the layer, or of one of its channels, as users give it."""
        return ".".join(filter(None, (self.name, channel)))

    def placed(self, channel: str, empty: float) -> NDArray[Any]:
        """(H, W) pixels of the display window."""
        pixels, (low, high, left, right) = self.channels[channel], self.windows
        if (low == left).all() and (high == right).all():
            return pixels
        found = np.full((right - left + 1)[::-1], empty if pixels.dtype.kind == "f" else 0, pixels.dtype)
        begin, end = np.maximum(low, left), np.minimum(high, right) + 1
        if (begin < end).all():
            (x, y), (to_x, to_y), (width, height) = begin - low, begin - left, end - begin
            found[to_y : to_y + height, to_x : to_x + width] = pixels[y : y + height, x : x + width]
        return found


def is_light(path: Path) -> bool:
    """Tell whether the colours in a file are linear in light."""
    return path.suffix.lower() == ".exr"


def read_color(path: _Path, channel: str | None = None, part: str | None = None) -> NDArray[Any]:
    """Return (H, W, 3) channels R, G, B of the picture's layer, or (H, W) of Y; linear in light.

    channel: name of a layer, or of one channel.
    """
    layers = _read(path, part)
    if channel is not None:
        for layer in layers:
            if layer.name == channel and set(_RGB) <= layer.channels.keys():
                return np.stack([layer.placed(name, 0) for name in _RGB], axis=-1)
        return _named(path, layers, channel, 0)
    colored = [layer for layer in layers if set(_RGB) <= layer.channels.keys()]
    of_picture = [layer for layer in colored if _PICTURE & set(re.split(r"[^a-z]+", layer.title.lower()))]
    if colored:
        layer = _only(path, of_picture or colored, "R, G, B")
        return np.stack([layer.placed(name, 0) for name in _RGB], axis=-1)
    gray = [layer for layer in layers if "Y" in layer.channels]
    if not gray:
        raise FileFormatError(f"{path}: no channels R, G, B, nor Y, among {_listed(layers)}")
    return _only(path, gray, "Y").placed("Y", 0)


def read_depth(path: _Path, channel: str | None = None, part: str | None = None) -> NDArray[Any]:
    """Return the (H, W) channel named depth or z, or in a layer of such a name; NaN for no depth.

    channel: name of another channel.
    """
    layers = _read(path, part)
    if channel is not None:
        return _named(path, layers, channel, np.nan)
    found = {layer: name for layer in layers if (name := _depth_of(layer)) is not None}
    if not found and len(layers) == 1:
        name = _gray(layers[0])
        found = {} if name is None else {layers[0]: name}
    if not found:
        raise FileFormatError(f"{path}: no channel called depth or Z among {_listed(layers)}; {CHOICE}")
    layer = _only(path, list(found), "depth")
    return layer.placed(found[layer], np.nan)


def write_color(path: _Path, color: NDArray[Any]) -> None:
    """Write (H, W, 3) as float channels R, G, B, uint8 divided by 255."""
    values = color / np.float32(255) if color.dtype == np.uint8 else color
    _write(path, {name: values[..., i] for i, name in enumerate(_RGB)})


def write_depth(path: _Path, depth: NDArray[Any]) -> None:
    """Write (H, W) as the float channel Z."""
    _write(path, {"Z": depth})


def check_output(path: _Path) -> None:
    """Raise MissingPackageError without OpenEXR."""
    openexr()


def _depth_of(layer: _Layer) -> str | None:
    """The channel of a layer that its own name, or the layer's, marks as depth."""
    if _DEPTH.search(layer.title):
        return "Z" if "Z" in layer.channels else _gray(layer)
    if {"X", "Y"} <= {name.upper() for name in layer.channels} or _NO_DEPTH.search(layer.title):
        return None
    return next((name for name in layer.channels if _DEPTH.search(name)), None)


def _gray(layer: _Layer) -> str | None:
    """The one channel that represents a layer: R if R, G and B are equal; None for X, Y and Z."""
    if set(_RGB) <= layer.channels.keys():
        equal = all(np.array_equal(layer.channels["R"], layer.channels[name], equal_nan=True) for name in "GB")
        return "R" if equal else None
    return None if "X" in layer.channels else next((name for name in "VYR" if name in layer.channels), None)


def _named(path: _Path, layers: list[_Layer], channel: str, empty: float) -> NDArray[Any]:
    found = [(layer, name) for layer in layers for name in layer.channels if layer.label(name) == channel]
    if not found:
        raise FileFormatError(f"{path}: no channel {channel!r} among {_listed(layers)}")
    layer = _only(path, [layer for layer, _ in found], channel)
    return layer.placed(next(name for one, name in found if one is layer), empty)


def _only(path: _Path, layers: list[_Layer], what: str) -> _Layer:
    """The single candidate: in the first part, and there preferably the unnamed layer."""
    first = [layer for layer in layers if layer.part == layers[0].part]
    chosen = [layer for layer in first if not layer.name] or first
    if len(chosen) > 1:
        names = ", ".join(layer.label() for layer in chosen)
        raise FileFormatError(f"{path}: several layers with {what}: {names}; {CHOICE}")
    return chosen[0]


def _listed(layers: list[_Layer]) -> str:
    """All channels, grouped by part."""
    parts = dict[str, list[str]]()
    for layer in layers:
        parts.setdefault(layer.part, []).extend(layer.label(name) for name in layer.channels)
    each = [(f"{part}: " if len(parts) > 1 else "") + ", ".join(sorted(names)) for part, names in parts.items()]
    return "; ".join(each) or "none"


def _read(path: _Path, part: str | None) -> list[_Layer]:
    exr = openexr()
    with reading(path, "OpenEXR") as source:
        data = source.read_bytes()  # OpenEXR opens no file with an undecodable name
        with exr.File(io.BytesIO(data), header_only=True) as file:
            check_unpacked(sum(_size(one.header) for one in file.parts))
        with exr.File(io.BytesIO(data), separate_channels=True) as file:
            parts = {str(one.header.get("name", number)): one for number, one in enumerate(file.parts)}
            if part is not None and part not in parts:
                raise FileFormatError(f"{path}: no part {part!r} among {', '.join(parts)}")
            layers = [layer for name, one in parts.items() if part in (None, name) for layer in _layers(name, one)]
    chroma = [layer.label(name) for layer in layers for name in ("RY", "BY") if name in layer.channels]
    if chroma:
        raise FileFormatError(f"{path}: colours as chroma ({', '.join(chroma)}) are not supported; save R, G, B")
    return layers


def _layers(part: str, content: Any) -> list[_Layer]:
    """The layers of a part, sorted by name."""
    windows, found = (*content.header["dataWindow"], *content.header["displayWindow"]), dict[str, _Layer]()
    for full, channel in content.channels.items():
        layer, _, name = full.rpartition(".")
        found.setdefault(layer, _Layer(part, layer, {}, windows)).channels[name] = channel.pixels
    return list(found.values())


def _size(header: dict[str, Any]) -> int:
    """Bytes of a part's pixels if all are float32."""
    size = 0
    for name in ("dataWindow", "displayWindow"):
        (left, top), (right, bottom) = (corner.tolist() for corner in header[name])
        size = max(size, 4 * (right - left + 1) * (bottom - top + 1) * len(header["channels"]))
    return size


def _write(path: _Path, channels: dict[str, NDArray[Any]]) -> None:
    exr = openexr()
    pixels = {name: np.ascontiguousarray(values, np.float32) for name, values in channels.items()}
    stream = io.BytesIO()
    exr.File({"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}, pixels).write(stream)
    write_atomically(path, stream.getvalue())
