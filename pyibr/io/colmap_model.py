"""COLMAP's sparse models: cameras and images, as text or binary; points are skipped."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, NamedTuple

from pyibr.core.camera import Camera
from pyibr.core.conventions import COLMAP_MODELS
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import read_text, reading

_POINT_BYTES = 24  # per point of an image in binary form: x, y, the point's number


class _Intrinsics(NamedTuple):
    model: str
    size: tuple[int, int]
    params: list[float]


class _Image(NamedTuple):
    name: str
    camera: int
    qvec: list[float]
    tvec: list[float]


def model_in(folder: Path) -> Path | None:
    """The folder of a model: this one, or its subfolder 0."""
    files = [place / f"cameras{suffix}" for place in (folder, folder / "0") for suffix in (".bin", ".txt")]
    return next((file.parent for file in files if file.is_file()), None)


def read_model(folder: Path) -> dict[str, Camera]:
    """The camera of each image of a model, with its lens, by the image's name; sorted by name."""
    suffix = ".bin" if (folder / "cameras.bin").is_file() else ".txt"
    cameras, images = folder / f"cameras{suffix}", folder / f"images{suffix}"
    with reading(cameras, "COLMAP cameras") as source:
        intrinsics = _binary_cameras(source.read_bytes()) if suffix == ".bin" else _text_cameras(read_text(source))
    with reading(images, "COLMAP images") as source:
        found = _binary_images(source.read_bytes()) if suffix == ".bin" else _text_images(read_text(source))
    made: dict[str, Camera] = {}
    for image in sorted(found, key=lambda image: image.name):
        if image.camera not in intrinsics:
            raise FileFormatError(f"{images}: {image.name} has camera {image.camera}, which {cameras} lacks")
        model, size, params = intrinsics[image.camera]
        try:
            made[image.name] = Camera.from_colmap(model, params, image.qvec, image.tvec, size)
        except ArgumentError as error:
            raise FileFormatError(f"{images}: {image.name}: {error}") from error
    if not made:
        raise FileFormatError(f"{images}: holds no image")
    return made


def _text_cameras(text: str) -> dict[int, _Intrinsics]:
    words = [line.split() for line in text.splitlines() if line.strip() and not line.startswith("#")]
    return {int(w[0]): _Intrinsics(w[1], (int(w[2]), int(w[3])), [float(v) for v in w[4:]]) for w in words}


def _text_images(text: str) -> list[_Image]:
    """Images as pairs of lines; the second line, the points', may be empty."""
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    while lines and not lines[0].strip():
        del lines[0]
    found: list[_Image] = []
    for line in lines[::2]:
        if line.strip():
            words = line.split(maxsplit=9)
            values = [float(word) for word in words[1:8]]
            found.append(_Image(words[9].strip(), int(words[8]), values[:4], values[4:]))
    return found


class _Bytes:
    """Sequential reader of numbers in bytes; struct.error beyond the end."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def take(self, form: str) -> tuple[Any, ...]:
        values = struct.unpack_from("<" + form, self._data, self._at)
        self._at += struct.calcsize("<" + form)
        return values

    def word(self) -> str:
        end = self._data.index(b"\0", self._at)
        word = self._data[self._at : end].decode("utf-8")
        self._at = end + 1
        return word

    def skip(self, count: int) -> None:
        if count > len(self._data) - self._at:
            raise ValueError("it ends within an image's points")
        self._at += count


def _binary_cameras(data: bytes) -> dict[int, _Intrinsics]:
    source = _Bytes(data)
    found: dict[int, _Intrinsics] = {}
    for _ in range(min(source.take("Q")[0], len(data))):
        number, kind, width, height = source.take("iiQQ")
        if not 0 <= kind < len(COLMAP_MODELS):
            raise ValueError(f"camera {number} has an unknown model {kind}")
        name = list(COLMAP_MODELS)[int(kind)]
        found[number] = _Intrinsics(name, (width, height), list(source.take(f"{sum(COLMAP_MODELS[name])}d")))
    return found


def _binary_images(data: bytes) -> list[_Image]:
    source = _Bytes(data)
    found: list[_Image] = []
    for _ in range(min(source.take("Q")[0], len(data))):
        _, *pose, camera = source.take("i7di")
        found.append(_Image(source.word(), camera, pose[:4], pose[4:]))
        source.skip(_POINT_BYTES * source.take("Q")[0])
    return found
