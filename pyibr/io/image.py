"""PNG, JPEG, TIFF, BMP and other images, read through Pillow, and the focal length in their EXIF data."""

from __future__ import annotations

import io
import math
import re
import struct
import sys
import warnings
import zlib
from importlib import import_module
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera_geometry import FILM_DIAGONAL
from pyibr.core.checks import describe
from pyibr.core.errors import FileFormatError
from pyibr.core.files import checked_path, like, reading, write_atomically
from pyibr.images.srgb import in_bytes

if TYPE_CHECKING:
    from PIL.Image import Image

try:
    _deflate: Any = import_module("isal.isal_zlib")
except ImportError:  # some processors have no wheels of it
    _deflate = zlib

_OTHER_COLORS = ("CMYK", "YCbCr", "LAB", "HSV")
_WRITABLE = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".ppm")
# TIFF's byte orders, fields and kinds of numbers, and the kinds that Pillow does not read
_ORDERS = {b"II*\0": "<", b"MM\0*": ">"}
_COLUMNS, _BITS, _ORIENTATION, _SAMPLES, _TILE_COLUMNS, _KIND = 256, 258, 274, 277, 322, 339
_CODES = {3: "H", 4: "I"}  # types of fields with one number
_UNSIGNED, _SIGNED, _FLOAT = 1, 2, 3
_UNKNOWN = {(_UNSIGNED, 32): "u4", (_FLOAT, 16): "f2", (_FLOAT, 64): "f8"}
_OTHER_ORDER = {"B": "L", "L": "B", "N": "B" if sys.byteorder == "little" else "L"}  # of Pillow's raw modes
_TINTS = 8, 64  # mean and largest difference of R, G, B that lossy compression causes in gray of 8 bits
_TO_THE_LEFT = 1  # filter of a PNG's row: differences to the left neighbour
_PNG_COLORS = {3: 2, 4: 6}  # a PNG's kinds of colour by channels
_EXIF, _FOCAL, _FOCAL_35MM = 0x8769, 0x920A, 0xA405
_PLANE_RESOLUTION, _PLANE_UNIT, _WIDTH = 0xA20E, 0xA210, 0xA002
_UNITS = {2: 25.4, 3: 10.0, 4: 1.0}  # in millimetres


def read_color(path: str | PathLike[str]) -> NDArray[Any]:
    """Return the file's first image as stored: (H, W) or (H, W, C)."""
    with reading(path, "image") as source:
        return decoded(source.read_bytes())


def read_mask(path: str | PathLike[str], *, of_alpha: bool = False) -> NDArray[np.bool_]:
    """(H, W) bool: where the file's first image has alpha of a half or more; without alpha, where it is not black.

    of_alpha: raise FileFormatError if there is no alpha.
    """
    with reading(path, "mask") as source, opened(source.read_bytes()) as picture:
        if picture.mode in ("RGBA", "LA", "PA") or "transparency" in picture.info:
            return np.asarray(picture.convert("RGBA"))[..., 3] >= 128
        if of_alpha:
            raise FileFormatError(f"{source}: expected a picture with alpha, or masks beside it, got {picture.mode}")
        values: NDArray[Any] = np.atleast_3d(np.asarray(picture.convert("RGB") if picture.mode == "P" else picture))
        return (values > 0).max(axis=2)


def decoded(data: bytes) -> NDArray[Any]:
    """The first image of a file's bytes, as stored; raises Pillow's errors, also for extremely large images.

    Colours are unchanged, except that CMYK, YCbCr, L*a*b* and HSV become RGB.
    """
    known, numbers = _as_known(data)
    with opened(known) as picture:
        if picture.mode in _OTHER_COLORS:
            return np.array(picture.convert("RGB"))
        if picture.mode in ("P", "RGB") and "transparency" in picture.info:
            return np.array(picture.convert("RGBA"))
        if picture.mode == "P" and picture.palette is not None:
            return np.array(picture.convert(picture.palette.mode))
        if picture.mode in ("RGB", "RGBA") and (wide := _of_16_bits(picture, known)) is not None:
            return wide
        if picture.mode == "I" and picture.format in ("PNG", "PPM"):  # 16 bits, widened by Pillow
            return np.array(picture.convert("I;16"))
        return _as_they_are(np.array(picture), numbers)


def _of_16_bits(picture: Any, data: bytes) -> NDArray[np.uint16] | None:
    """(H, W, 3 or 4), or None for 8 bits. Pillow keeps the upper byte, and in the other byte order the lower one."""
    from PIL import Image

    kinds = [(tile.args,) if isinstance(tile.args, str) else (*(tile.args or ("",)),) for tile in picture.tile]
    if not kinds or not all(re.fullmatch(r"RGB\w?;16[BLN]", str(kind[0])) for kind in kinds):
        if getattr(picture, "tag_v2", {}).get(_BITS, (8,))[0] > 8:
            raise ValueError("R, G, B of more than 8 bits are read if they are stored pixel by pixel")
        return None
    args = [(kind[0][:-1] + _OTHER_ORDER[kind[0][-1]], *kind[1:]) for kind in kinds]
    with Image.open(io.BytesIO(data)) as lower:
        lower.tile = [tile._replace(args=own) for tile, own in zip(lower.tile, args, strict=True)]
        return np.bitwise_or(np.array(picture, np.uint16) << 8, np.array(lower), dtype=np.uint16)


def gray_of(stored: NDArray[Any], name: str | PathLike[str]) -> NDArray[Any]:
    """(H, W) of gray that is stored as R, G, B, maybe with tints, which are reported; other images unchanged."""
    colors = stored[..., :3]
    if stored.ndim != 3 or stored.shape[2] not in (3, 4) or (colors == colors[..., :1]).all():
        return colors[..., 0] if stored.ndim == 3 else stored
    tints = np.ptp(colors, axis=2)
    if stored.dtype != np.uint8 or tints.mean() > _TINTS[0] or tints.max() > _TINTS[1]:
        return stored
    warnings.warn(f"{like(name)}: gray with the tints of lossy compression; its brightness is read", stacklevel=2)
    return np.rint(colors @ np.array([0.299, 0.587, 0.114])).astype(np.uint8)


def without_alpha(image: NDArray[Any], name: object = None) -> NDArray[Any]:
    """Colours (..., 1 or 3) without alpha; if `name` is given, warns when any pixel is not opaque."""
    if image.shape[-1] in (1, 3):
        return image
    alpha = image[..., -1]
    if name is not None and (alpha < (1 if alpha.dtype.kind in "fb" else np.iinfo(alpha.dtype).max)).any():
        remedy = "to hide pixels, set their depth to NaN or pass a mask"
        warnings.warn(f"{name}: transparency is ignored, all pixels are drawn as opaque; {remedy}", stacklevel=3)
    return image[..., :-1]


def opened(data: bytes) -> Image:
    """Pillow's picture of these bytes, as stored."""
    from PIL import Image

    data, _ = _as_known(data)
    with Image.open(io.BytesIO(data)) as picture:
        if picture.format == "EPS":  # PostScript is a program, which Pillow would run
            raise ValueError("PostScript is no picture")
        picture.verify()  # checks a PNG's checksums, which decoding skips
    return Image.open(io.BytesIO(data))


def read_depth(path: str | PathLike[str]) -> NDArray[Any]:
    """Return the stored (H, W): floats, or integers of an unknown unit, 0 for no depth."""
    stored = read_color(path)
    stored = gray_of(stored, path) if stored.shape[2:] == (3,) else stored
    if stored.ndim != 2 or stored.dtype.kind not in "uif":
        expected = "gray of 8 or 16 bits, or floats, for depth"
        raise FileFormatError(f"{path}: expected {expected}, got {describe(stored)} (colours or alpha are no depth)")
    return stored


def encoded(image: NDArray[Any], suffix: str) -> bytes:
    """The bytes of a file. Libraries that write files themselves may not report a full disk."""
    if suffix == ".png":
        return _png(image)
    from PIL import Image

    options = {"quality": 95} if suffix in (".jpg", ".jpeg", ".webp") else {}
    written = io.BytesIO()
    Image.fromarray(image).save(written, Image.registered_extensions()[suffix], **options)
    return written.getvalue()


def _png(image: NDArray[Any]) -> bytes:
    """A file for an (H, W) or (H, W, 3 or 4) image in uint8 or uint16; isal deflates it in one call, if installed."""
    height, width = image.shape[:2]
    stored = np.ascontiguousarray(image, image.dtype.newbyteorder(">")).view(np.uint8).reshape(height, -1)
    pixel = stored.shape[1] // width
    rows = np.empty((height, 1 + stored.shape[1]), np.uint8)
    rows[:, 0], rows[:, 1 : 1 + pixel] = _TO_THE_LEFT, stored[:, :pixel]
    np.subtract(stored[:, pixel:], stored[:, :-pixel], out=rows[:, 1 + pixel :])
    kind = 0 if image.ndim == 2 else _PNG_COLORS[image.shape[2]]
    head = struct.pack(">IIBBBBB", width, height, 8 * image.itemsize, kind, 0, 0, 0)
    chunks = _chunk(b"IHDR", head), _chunk(b"IDAT", _deflate.compress(rows.data, 1)), _chunk(b"IEND", b"")
    return b"".join((b"\x89PNG\r\n\x1a\n", *chunks))


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(data, zlib.crc32(kind)))


def check_output(path: str | PathLike[str]) -> None:
    """Raise FileFormatError unless pictures can be written with this suffix."""
    suffix = checked_path(path).suffix.lower()
    if suffix not in _WRITABLE:
        raise FileFormatError(
            f"{path}: no image format {suffix or 'without a suffix'}; known are {', '.join(_WRITABLE)}"
        )


def write_color(path: str | PathLike[str], color: NDArray[Any]) -> None:
    """Write an (H, W) or (H, W, 3) image, float and bool as 8 bit."""
    check_output(path)
    if color.dtype == np.bool_:
        color = color.astype(np.uint8) * np.uint8(255)
    if color.dtype.kind == "f":
        color = in_bytes(color)
    write_atomically(path, encoded(color, checked_path(path).suffix.lower()))


def write_depth(path: str | PathLike[str], depth: NDArray[Any]) -> None:
    """Write (H, W): uint16 as PNG, float32 as TIFF."""
    check_output(path)
    write_atomically(path, encoded(depth, checked_path(path).suffix.lower()))


def focal_35mm_of(path: str | PathLike[str], size: tuple[int, int]) -> float | None:
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


def _as_known(data: bytes) -> tuple[bytes, str]:
    """Return a file that Pillow reads, and its numbers' type for `_as_they_are`; other formats stay unchanged."""
    order = _ORDERS.get(data[:4])
    if order is None:
        return data, ""
    changed, fields = bytearray(data), dict[int, tuple[int, str]]()
    (first,) = struct.unpack_from(f"{order}I", data, 4)
    (count,) = struct.unpack_from(f"{order}H", data, first)
    for place in range(first + 2, first + 2 + 12 * count, 12):
        tag, kind, numbers = struct.unpack_from(f"{order}HHI", data, place)
        if numbers == 1 and kind in _CODES:
            fields[tag] = place + 8, order + _CODES[kind]

    def value(tag: int, otherwise: int) -> int:
        return struct.unpack_from(fields[tag][1], data, fields[tag][0])[0] if tag in fields else otherwise

    def put(tag: int, number: int) -> None:
        if tag in fields:
            struct.pack_into(fields[tag][1], changed, fields[tag][0], number)

    put(_ORIENTATION, 1)
    numbers = _UNKNOWN.get((value(_KIND, _UNSIGNED), value(_BITS, 1)), "") if value(_SAMPLES, 1) == 1 else ""
    if numbers:
        words = 2 if numbers == "f8" else 1
        put(_KIND, _UNSIGNED if numbers == "f2" else _SIGNED)
        put(_BITS, 16 if numbers == "f2" else 32)
        for tag in (_COLUMNS, _TILE_COLUMNS):
            put(tag, words * value(tag, 0))
    return bytes(changed), numbers and order + numbers


def _as_they_are(stored: NDArray[np.generic], numbers: str) -> NDArray[np.generic]:
    """Return the integers from Pillow as numbers of the file's type, in native byte order."""
    native = np.ascontiguousarray(stored, stored.dtype.newbyteorder("="))
    if not numbers:
        return native
    if numbers == ">f8":  # its halves are in reverse order
        native = np.ascontiguousarray(native.reshape(len(native), -1, 2)[..., ::-1]).reshape(native.shape)
    return native.view(numbers[1:])
