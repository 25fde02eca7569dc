"""Files of arrays: NumPy's NPY; NPZ and HDF5 (such as Hypersim's and BlenderProc's) of one array, or by its name."""

from __future__ import annotations

import io
import math
from os import PathLike
from typing import IO, Any
from zipfile import ZipFile, ZipInfo

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from pyibr.core.errors import FileFormatError
from pyibr.core.files import check_unpacked, checked_path, read_at_most, reading, write_atomically
from pyibr.core.optional import h5py

_Path = str | PathLike[str]

CHOICE = "name one (channel=; --depth-channel)"


def read_color(path: _Path, channel: str | None = None) -> NDArray[Any]:
    """Return the stored array; channel: its name in an NPZ or HDF5."""
    return read_array(path, "color", channel) if _is_numpy(path) else read_hdf5(path, channel, "colors", "color", "rgb")


def read_depth(path: _Path, channel: str | None = None) -> NDArray[Any]:
    """Return the stored array; channel: its name in an NPZ or HDF5."""
    return read_array(path, "depth", channel) if _is_numpy(path) else read_hdf5(path, channel, "depth")


def write_color(path: _Path, color: NDArray[Any]) -> None:
    """Write the array unchanged, as NPY or NPZ."""
    _write(path, "color", color)


def write_depth(path: _Path, depth: NDArray[Any]) -> None:
    """Write the array unchanged, as NPY or NPZ."""
    check_output(path)
    _write(path, "depth", depth)


def check_output(path: _Path) -> None:
    """Raise FileFormatError for HDF5, which is only read."""
    if not _is_numpy(path):
        raise FileFormatError(f"{path}: HDF5 files are only read")


def _is_numpy(path: _Path) -> bool:
    return checked_path(path).suffix.lower() in (".npy", ".npz")


def read_hdf5(path: _Path, channel: str | None = None, *usual: str) -> NDArray[Any]:
    """Return the array `channel`; by default the first of "dataset" and the usual names, or the only array."""
    library, names = h5py(), list[str]()

    def note(name: str, one: Any) -> None:
        if isinstance(one, library.Dataset):
            names.append(name)

    with reading(path, "HDF5") as source, library.File(source, "r") as file:
        file.visititems(note)
        wanted = ("dataset", *usual) if channel is None else (channel.strip("/"),)
        name = next((name for name in wanted if name in names), names[0] if len(names) == 1 and not channel else None)
        if name is None:
            raise FileFormatError(f"{path}: no array {wanted[-1]!r} among {', '.join(names) or 'none'}; {CHOICE}")
        check_unpacked(int(file[name].size) * int(file[name].dtype.itemsize))
        return np.array(file[name])


def read_array(path: _Path, name: str, channel: str | None = None) -> NDArray[Any]:
    """Return an NPY file's array, or an NPZ's array `channel`, by default the one called `name`, or the only one."""
    with reading(path, "NumPy") as source:
        data = source.read_bytes()
        if data[:2] != b"PK":
            return _array_of(data)
        with ZipFile(io.BytesIO(data)) as packed:
            member = member_of(path, packed, name, channel)
            check_unpacked(member.file_size)
            with packed.open(member) as stream:
                return _array_of(read_at_most(stream))


def names_in(path: _Path) -> list[str]:
    """Names of an NPZ's arrays."""
    with reading(path, "NumPy") as source, ZipFile(source) as packed:
        return [name.removesuffix(".npy") for name in packed.namelist()]


def member_of(path: _Path, packed: ZipFile, name: str, channel: str | None) -> ZipInfo:
    """The member of an NPZ that `read_array` reads."""
    arrays = {member.filename.removesuffix(".npy"): member for member in packed.infolist()}
    wanted = channel or name
    if wanted not in arrays and (channel or len(arrays) != 1):
        raise FileFormatError(f"{path}: no array {wanted!r} among {', '.join(arrays) or 'none'}; {CHOICE}")
    return arrays.get(wanted) or next(iter(arrays.values()))


def header_of(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """The shape of an NPY file's array, whether it has Fortran order, and its dtype."""
    header = npy.read_array_header_1_0 if npy.read_magic(stream) == (1, 0) else npy.read_array_header_2_0
    shape, by_columns, dtype = header(stream)
    if dtype.hasobject or min(shape, default=0) < 0:
        raise ValueError(f"expected numbers, got {dtype} of shape {shape}")
    return shape, by_columns, dtype


def _array_of(data: bytes) -> NDArray[Any]:
    """The array of an NPY file. NumPy's own reader would allocate as much as the header asks for."""
    stream = io.BytesIO(data)
    shape, by_columns, dtype = header_of(stream)
    expected, got = math.prod(shape) * dtype.itemsize, len(data) - stream.tell()
    if got < expected:
        raise ValueError(f"expected {expected} bytes after the header, got {got}")
    values = np.frombuffer(data, dtype, math.prod(shape), stream.tell())
    return values.reshape(shape, order="F" if by_columns else "C").copy()


def _write(path: _Path, name: str, array: NDArray[Any]) -> None:
    stream = io.BytesIO()
    if checked_path(path).suffix.lower() == ".npz":
        np.savez_compressed(stream, allow_pickle=False, **{name: array})
    else:
        np.save(stream, array, allow_pickle=False)
    write_atomically(path, stream.getvalue())
