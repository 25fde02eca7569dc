"""Mesh files: the formats, their contents, and their axes."""

from __future__ import annotations

import warnings
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import one_of
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import check_writable, checked_path, read_bytes, reading, write_atomically, written_together
from pyibr.io import gltf, obj, off, ply, stl
from pyibr.io.gaussian_files import refuse_gaussians
from pyibr.io.mesh_arrays import MeshArrays, texture_from

Axes = Literal["opencv", "gltf"]

_READERS = {".glb": gltf, ".gltf": gltf, ".obj": obj, ".off": off, ".ply": ply, ".stl": stl}
_WRITTEN = (".glb", ".obj", ".off", ".ply", ".stl")
_LACKED = {
    ".ply": ("texture", "uv"),
    ".off": ("texture", "uv", "normals"),
    ".stl": ("texture", "uv", "normals", "colors"),
}
_OF_GLTF = (".glb", ".gltf")


def is_mesh_file(path: str | PathLike[str]) -> bool:
    """Tell whether a file has the suffix of a mesh."""
    return _suffix(checked_path(path)) in _READERS


def read_mesh(path: str | PathLike[str], axes: Axes) -> MeshArrays:
    """Return a mesh file's content in a world with these axes; FileFormatError if the file is unreadable."""
    one_of("axes", axes, Axes)
    file = checked_path(path)
    kind = _suffix(file)
    refuse_gaussians(file, "a mesh")
    if kind not in _READERS:
        raise FileFormatError(f"{file}: a mesh file ends in one of {', '.join(_READERS)} (or .gz after it)")
    with reading(file, f"{kind[1:].upper()} mesh") as source:
        found = _READERS[kind].read_mesh(read_bytes(source), file.parent)
        if not len(found.faces):
            raise FileFormatError(f"{file}: no triangles in it, or truncated")
        if found.left_out:
            warnings.warn(f"{file}: left out: {', '.join(found.left_out)}"[:400], UserWarning, stacklevel=3)
        normals = found.normals
        if normals is not None and not (np.isfinite(normals).all() and normals.any(axis=1).all()):
            found = replace(found, normals=None)
        return _turned(found) if axes == "opencv" and kind in _OF_GLTF else found


def write_mesh(path: str | PathLike[str], mesh: MeshArrays, axes: Axes, double_sided: bool) -> None:
    """Write a mesh from a world with these axes: either all its files, or none."""
    check_mesh_file(path)
    one_of("axes", axes, Axes)
    file = checked_path(path)
    kind = file.suffix.lower()
    lost = [name for name in _LACKED.get(kind, ()) if getattr(mesh, name) is not None]
    shown = replace(mesh, **dict.fromkeys(lost))
    if shown.colors is None and lost:  # else colours stand for the texture
        warnings.warn(f"{file}: left out, as {kind} cannot hold them: {', '.join(lost)}", stacklevel=3)
    if shown.texture is not None:
        shown = replace(shown, colors=None)  # other programs would multiply the two
    if kind == ".glb":
        write_atomically(file, gltf.mesh_bytes(_turned(shown) if axes == "opencv" else shown, double_sided))
    elif kind == ".obj":
        content, others = obj.mesh_files(shown, file.stem)
        with written_together():
            for name, data in others.items():
                _write_once(file.with_name(name), data)
            write_atomically(file, content)  # last: this file names the others
    else:
        module = {".off": off, ".ply": ply, ".stl": stl}[kind]
        write_atomically(file, module.mesh_bytes(shown))


def check_mesh_file(path: str | PathLike[str]) -> None:
    """Raise the errors of `write_mesh` for this name; nothing is written."""
    file = checked_path(path)
    kind = file.suffix.lower()
    if kind not in _WRITTEN:
        raise ArgumentError("path", f"a file that ends in one of {', '.join(_WRITTEN)}", str(file))
    check_writable(file)


def _write_once(file: Path, data: bytes) -> None:
    """Write a file that is named by its content, unless it exists, even with another compression."""
    try:
        old = file.read_bytes()
        there = old == data or (file.suffix == ".png" and np.array_equal(texture_from(old), texture_from(data)))
    except Exception:  # an unreadable file is replaced
        there = False
    if not there:
        write_atomically(file, data)


def _suffix(file: Path) -> str:
    packed = file.suffix.lower() == ".gz"
    return (Path(file.stem) if packed else file).suffix.lower()


def _turned(mesh: MeshArrays) -> MeshArrays:
    """Convert from OpenCV's axes to glTF's, or back: a half turn about x."""

    def turned(rows: NDArray[Any]) -> NDArray[Any]:
        return rows * np.array([1, -1, -1], rows.dtype) + 0  # no -0

    return replace(mesh, vertices=turned(mesh.vertices), normals=None if mesh.normals is None else turned(mesh.normals))
