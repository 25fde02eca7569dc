"""PNG, JPEG, TIFF, BMP and other images, through imageio."""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.errors import FileFormatError
from pyibr.core.files import atomic_path, checked_path, reading

_WRITABLE = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".ppm")


def read_color(path: str | PathLike[str]) -> NDArray[Any]:
    """Return the file's first image as stored: (H, W) or (H, W, C)."""
    iio = _imageio()
    with reading(path, "image") as source:
        return iio.imread(source, index=0, plugin="pillow")


def write_color(path: str | PathLike[str], color: NDArray[Any]) -> None:
    """Write an (H, W) or (H, W, 3) image, float as 8 bit."""
    iio = _imageio()
    if color.dtype.kind == "f":
        color = np.rint(np.clip(np.nan_to_num(color), 0, 1) * 255).astype(np.uint8)
    suffix = checked_path(path).suffix.lower()
    if suffix not in _WRITABLE:
        raise FileFormatError(f"{path}: no image format {suffix or 'without a suffix'} to write")
    options = {"quality": 95} if suffix in (".jpg", ".jpeg", ".webp") else {}
    with atomic_path(path) as temporary:
        iio.imwrite(temporary, color, plugin="pillow", **options)


def _imageio() -> Any:
    import imageio.v3

    return imageio.v3
