"""Contents of mesh files as plain arrays, and functions shared by the formats.

A format's module has `read_mesh(data, folder)`, which takes a file's bytes and its folder, and `mesh_bytes` or
`mesh_files`, which return the bytes to write. Readers may raise any exception for bytes that they cannot read.
"""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.files import reading
from pyibr.io import image


@dataclass(frozen=True)
class MeshArrays:
    """Triangles with their vertices' attributes, unchecked."""

    vertices: NDArray[Any]  # (N, 3) floats
    faces: NDArray[Any]  # (M, 3) integers
    uv: NDArray[Any] | None = None  # (N, 2) floats, or (M, 3, 2) for the corners; v runs down the texture's rows
    normals: NDArray[Any] | None = None  # (N, 3) floats
    colors: NDArray[np.uint8] | None = None  # (N, 3)
    texture: NDArray[np.uint8] | None = None  # (h, w, 3)
    left_out: tuple[str, ...] = ()  # contents of the file that these arrays cannot hold


def whole(values: NDArray[Any]) -> NDArray[np.int64]:
    """Return integers that are stored as other numbers; ValueError if one is not an integer."""
    with np.errstate(invalid="ignore"):
        integers = values.astype(np.int64)
    if (integers != values).any():
        raise ValueError("a count or a vertex index is no integer")
    return integers


def count_of(text: str, maximum: int) -> int:
    """A count from a header; ValueError beyond `maximum`, the size of the content."""
    count = int(text) if len(text) <= 18 else maximum + 1
    if not 0 <= count <= maximum:
        raise ValueError(f"the header counts {text[:40]}, which is more than the file holds")
    return count


def texture_from(data: bytes, name: str | None = None) -> NDArray[np.uint8]:
    """A picture's bytes as (h, w, 3) uint8; with `name`, a warning if it is not opaque."""
    stored = image.decoded(data)
    texture = image.without_alpha(stored[..., None] if stored.ndim == 2 else stored, name)
    texture = texture if texture.shape[2] == 3 else np.repeat(texture, 3, axis=2)
    if texture.dtype == np.uint16:
        return (texture >> 8).astype(np.uint8)
    if texture.dtype == np.bool_:
        return texture.astype(np.uint8) * np.uint8(255)
    if texture.dtype != np.uint8:
        raise ValueError(f"a texture of {texture.dtype}")
    return np.ascontiguousarray(texture)


def texture_beside(folder: Path, name: str) -> bytes | None:
    """The texture that a mesh file names; None, with a warning, if it is missing."""
    data = beside(folder, name, "texture")
    if data is None:
        warnings.warn(
            f"{name}, a mesh's texture, is not in {folder}: the mesh is read without it", UserWarning, stacklevel=2
        )
    return data


def beside(folder: Path, name: str, kind: str) -> bytes | None:
    """The bytes of another file that a mesh file names, or None if it is missing."""
    path = folder / name.replace("\\", "/")
    if not os.path.isfile(path):  # noqa: PTH113 - False for odd names
        return None
    with reading(path, kind) as source:
        return source.read_bytes()
