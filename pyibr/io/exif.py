"""The focal length in a photograph's EXIF data."""

from __future__ import annotations

import math
from pathlib import Path

from pyibr.core.camera_geometry import FILM_DIAGONAL
from pyibr.core.files import reading

_EXIF, _FOCAL, _FOCAL_35MM = 0x8769, 0x920A, 0xA405
_PLANE_RESOLUTION, _PLANE_UNIT, _WIDTH = 0xA20E, 0xA210, 0xA002
_UNITS = {2: 25.4, 3: 10.0, 4: 1.0}  # in millimetres


def focal_35mm_of(path: Path, size: tuple[int, int]) -> float | None:
    """Return the focal length's 35 mm equivalent, in millimetres; None if the data lack it.

    It is stored directly, or follows from the focal length and the sensor's resolution. size: (width, height).
    """
    from PIL import Image, UnidentifiedImageError

    with reading(path, "image") as source:
        try:
            with Image.open(source) as picture:
                tags = picture.getexif().get_ifd(_EXIF)
        except UnidentifiedImageError:
            return None  # other formats have no EXIF
        told = float(tags.get(_FOCAL_35MM) or 0)
        if told > 0:
            return told
        focal, density = (float(tags.get(tag) or 0) for tag in (_FOCAL, _PLANE_RESOLUTION))
        unit = _UNITS.get(int(tags.get(_PLANE_UNIT) or 2), 0.0)
        taken = float(tags.get(_WIDTH) or size[0])
    if not (focal > 0 and density > 0 and unit > 0 and taken > 0):
        return None
    pixels = focal * density / unit * max(size) / max(taken, 1.0)
    return pixels / math.hypot(*size) * FILM_DIAGONAL
