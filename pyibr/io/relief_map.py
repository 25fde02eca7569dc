"""Relief maps: pictures with a normal in red, green and blue, and a height in alpha, 8 bits each."""

from __future__ import annotations

import io
from os import PathLike
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import describe, one_of, plain_array
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import checked_path, reading, write_atomically
from pyibr.io import image

Green = Literal["down", "up"]


def read_relief_map(
    path: str | PathLike[str], *, green: Green = "down", alpha: Literal["height", "depth"] = "height"
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Read a relief map.

    Parameters
    ----------
    path : path
        PNG, TIFF, TGA, DDS or another format with alpha that Pillow reads.
    green : {"down", "up"}
        Whether green increases with v, down the picture, or against it. Texture tools use both.
    alpha : {"height", "depth"}
        With "depth", 0 is the surface and 255 the deepest, as in the papers on relief mapping.

    Returns
    -------
    normal_map : (h, w, 3) float32
        Unit normals in tangent space: x along u, y along v, z along the normal.
    height : (h, w) uint8

    Raises
    ------
    ArgumentError
        If `green` or `alpha` has another value.
    FileFormatError
        If the file is missing, truncated, or has no alpha channel.

    Examples
    --------
    >>> import numpy as np
    >>> from pyibr.io import read_relief_map, write_relief_map
    >>> write_relief_map("bricks.png", np.full((2, 3, 3), (0, 0, 1.0)), np.full((2, 3), 200, np.uint8))
    >>> normals, height = read_relief_map("bricks.png")
    >>> normals[0, 0].round(2).tolist(), int(height[0, 0])
    ([0.0, 0.0, 1.0], 200)
    """
    one_of("green", green, Green)
    one_of("alpha", alpha, Literal["height", "depth"])
    with reading(path, "relief map") as source, image.opened(source.read_bytes()) as picture:
        if picture.mode not in ("RGBA", "LA", "PA") and "transparency" not in picture.info:
            raise FileFormatError(f"{source}: expected normals and heights as RGBA, got {picture.mode}")
        rgba = np.asarray(picture.convert("RGBA"))
    normals = rgba[..., :3].astype(np.float32) / np.float32(127.5) - np.float32(1)
    normals[..., 1] *= np.float32(1 if green == "down" else -1)
    normals[..., 2] = np.maximum(normals[..., 2], np.float32(1e-3))  # z <= 0 is a rounding error
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    height = rgba[..., 3] if alpha == "height" else 255 - rgba[..., 3]
    return normals, np.ascontiguousarray(height)


def write_relief_map(
    path: str | PathLike[str], normal_map: NDArray[Any], height: NDArray[np.uint8], *, green: Green = "down"
) -> None:
    """Write a relief map for `read_relief_map`.

    Parameters
    ----------
    path : path
        In a format with alpha: PNG, TIFF, TGA.
    normal_map : (h, w, 3) float
        In tangent space, z > 0, of any length.
    height : (h, w) uint8
    green : {"down", "up"}

    Raises
    ------
    ArgumentError
        If the arrays do not fit together.
    FileFormatError
        If the file cannot be written.

    Examples
    --------
    >>> import numpy as np
    >>> from pyibr.io import write_relief_map
    >>> write_relief_map("flat.png", np.full((2, 3, 3), (0, 0, 1.0)), np.zeros((2, 3), np.uint8), green="up")
    """
    from PIL import Image

    one_of("green", green, Green)
    height = plain_array("height", height, "uint8 of shape (h, w)")
    normal_map = plain_array("normal_map", normal_map, f"floats of shape {(*height.shape, 3)}")
    if height.ndim != 2 or height.dtype != np.uint8 or not height.size:
        raise ArgumentError("height", "uint8 of shape (h, w)", describe(height))
    if normal_map.shape != (*height.shape, 3) or normal_map.dtype.kind != "f" or not np.isfinite(normal_map).all():
        raise ArgumentError("normal_map", f"floats of shape {(*height.shape, 3)}", describe(normal_map))
    if (normal_map[..., 2] <= 0).any():
        raise ArgumentError("normal_map", "normals with z > 0", f"{np.count_nonzero(normal_map[..., 2] <= 0)} without")
    suffix = checked_path(path).suffix.lower()
    unit = normal_map / np.linalg.norm(normal_map, axis=2, keepdims=True)
    unit = unit * np.array([1, 1 if green == "down" else -1, 1])
    rgb = np.rint((unit + 1) * 127.5).clip(0, 255).astype(np.uint8)
    stream = io.BytesIO()
    try:
        Image.fromarray(np.dstack([rgb, height])).save(stream, Image.registered_extensions()[suffix])
    except (OSError, ValueError, KeyError) as error:
        raise FileFormatError(f"{path}: cannot be written as a picture with alpha: {error}") from error
    write_atomically(path, stream.getvalue())
