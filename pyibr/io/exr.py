"""OpenEXR images: half or float channels. Depth is channel Z, else V (Blender's values), else Y, else R."""

from __future__ import annotations

import io
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.errors import FileFormatError
from pyibr.core.files import check_unpacked, reading, write_atomically
from pyibr.core.optional import openexr


def read_color(path: str | PathLike[str]) -> NDArray[Any]:
    """Return (H, W, 3) of channels R, G, B, which may belong to a layer (`name.R`), or (H, W) of Y."""
    channels = _read(path)
    layers = [""] if {"R", "G", "B"} <= channels.keys() else []
    layers = layers or [key[:-1] for key in channels if key.endswith(".R")]
    layers = [layer for layer in layers if {layer + name for name in "RGB"} <= channels.keys()]
    if len(layers) > 1:
        raise FileFormatError(f"{path}: several layers with R, G, B: {', '.join(layer[:-1] for layer in layers)}")
    if layers:
        return np.stack([channels[layers[0] + name] for name in "RGB"], axis=-1)
    if not any(key.rpartition(".")[2] == "Y" for key in channels):
        raise FileFormatError(f"{path}: no channels R, G, B, nor Y, among {', '.join(channels) or 'none'}")
    return _pick(path, channels, "Y")


def read_depth(path: str | PathLike[str]) -> NDArray[Any]:
    """Return (H, W) of the depth channel, which may belong to a layer (`name.Z`)."""
    return _pick(path, _read(path), "Z", "V", "Y", "R")


def write_color(path: str | PathLike[str], color: NDArray[Any]) -> None:
    """Write (H, W, 3) as float channels R, G, B, uint8 divided by 255."""
    values = color / np.float32(255) if color.dtype == np.uint8 else color
    _write(path, {name: values[..., i] for i, name in enumerate("RGB")})


def write_depth(path: str | PathLike[str], depth: NDArray[Any]) -> None:
    """Write (H, W) as the float channel Z."""
    _write(path, {"Z": depth})


def check_output(path: str | PathLike[str]) -> None:
    """Raise MissingPackageError without OpenEXR."""
    openexr()


def _read(path: str | PathLike[str]) -> dict[str, NDArray[Any]]:
    exr = openexr()
    with reading(path, "OpenEXR") as source:
        data = source.read_bytes()  # OpenEXR opens no file whose name is no text
        with exr.File(io.BytesIO(data), header_only=True) as file:
            check_unpacked(sum(_size(part.header) for part in file.parts))
        with exr.File(io.BytesIO(data), separate_channels=True) as file:
            return {name: channel.pixels for part in file.parts for name, channel in part.channels.items()}


def _size(header: dict[str, Any]) -> int:
    """Bytes that a part's pixels take, if all are float32."""
    (left, top), (right, bottom) = (corner.tolist() for corner in header["dataWindow"])
    return 4 * (right - left + 1) * (bottom - top + 1) * len(header["channels"])


def _pick(path: str | PathLike[str], channels: dict[str, NDArray[Any]], *names: str) -> NDArray[Any]:
    for name in names:
        found = [key for key in channels if key.rpartition(".")[2] == name]
        if len(found) > 1 and name not in found:
            raise FileFormatError(f"{path}: several channels {name}: {', '.join(found)}")
        if found:
            return channels[name if name in found else found[0]]
    raise FileFormatError(f"{path}: no channel {' or '.join(names)} among {', '.join(channels) or 'none'}")


def _write(path: str | PathLike[str], channels: dict[str, NDArray[Any]]) -> None:
    exr = openexr()
    pixels = {name: np.ascontiguousarray(values, np.float32) for name, values in channels.items()}
    stream = io.BytesIO()
    exr.File({"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}, pixels).write(stream)
    write_atomically(path, stream.getvalue())
