"""Excessive counts in headers, and small files that unpack to large ones, are refused before they use memory."""

from __future__ import annotations

import gzip
import io
import json
import resource
import struct
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core import files
from pyibr.io import read_range_grid, read_relief_map

MOST = 1 << 20
"""Limit in these tests on the unpacked size of files, in bytes."""


@pytest.fixture(autouse=True)
def _bounds(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(files, "UNPACKED_MAX", MOST)
    before = resource.getrlimit(resource.RLIMIT_DATA)
    with Path("/proc/self/status").open() as status:
        used = next(int(line.split()[1]) for line in status if line.startswith("VmData")) * 1024
    resource.setrlimit(resource.RLIMIT_DATA, (used + (256 << 20), before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_DATA, before)


def npy(shape: str, descr: str = "<f4", content: bytes = bytes(96)) -> bytes:
    header = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + content


def npz(content: bytes) -> bytes:
    packed = io.BytesIO()
    with ZipFile(packed, "w", ZIP_DEFLATED) as file:
        file.writestr("depth.npy", content)
    return packed.getvalue()


def png(width: int, height: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(bytes(99))) + chunk(b"IEND", b"")


def glb(**parts: Any) -> bytes:
    binary = bytes(36)
    scene: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": len(binary)}],
        "buffers": [{"byteLength": len(binary)}],
    }
    text = json.dumps(scene | parts).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


PLY = b"ply\nformat %s 1.0\nelement vertex %s\nproperty float x\nproperty float y\nproperty float z\n"
PLY += b"element face 1\nproperty list int int vertex_indices\nend_header\n"
GRID = b"ply\nformat ascii 1.0\nobj_info num_cols %s\nobj_info num_rows 1\nelement vertex 1\nproperty float x\n"
GRID += b"property float y\nproperty float z\nelement range_grid %s\nproperty list uchar int n\nend_header\n1 2 3\n"
GRID += b"1 0\n"
LONG = b"9" * 5000
CORNERS = PLY % (b"binary_little_endian", b"3") + bytes(36) + struct.pack("<4i", 0x7FFFFFFF, 0, 1, 2)
CONCAVE = b"OFF\n9999 1 0\n" + b"".join(b"%d %d 0\n" % (i, i * i % 7) for i in range(9999))
CONCAVE += b"9999 " + b" ".join(b"%d" % i for i in range(9999))
ZEROS = {"componentType": 5126, "count": 10**12, "type": "VEC3"}
FEWER_ZEROS = ZEROS | {"count": 10**5}

BOMBS: dict[str, tuple[str, bytes, Callable[[Path], Any]]] = {
    "PFM: large": ("d.pfm", b"Pf\n999999999 999999999\n-1.0\n" + bytes(24), ibr.read_depth),
    "PFM: long": ("d.pfm", b"Pf\n" + LONG + b" 3\n-1.0\n" + bytes(24), ibr.read_depth),
    "PFM: long scale": ("d.pfm", b"Pf\n2 3\n" + b"1" * 1_000_000 + b"x", ibr.read_depth),
    "COLMAP: large": ("d.bin", b"999999999&999999999&1&" + bytes(24), ibr.read_depth),
    "COLMAP: long": ("d.bin", LONG + b"&3&1&" + bytes(24), ibr.read_depth),
    "NPY: large": ("d.npy", npy("(99999999, 999)"), ibr.read_depth),
    "NPY: larger than any number": ("d.npy", npy(f"({1 << 62}, {1 << 62})"), ibr.read_depth),
    "NPY: negative": ("d.npy", npy("(-3, -8)"), ibr.read_depth),
    "NPY: long": ("d.npy", npy(f"({LONG.decode()}, 2)"), ibr.read_depth),
    "NPY: of nothing": ("d.npy", npy("(9, 9)", "|V0"), ibr.read_depth),
    "NPZ: header": ("d.npz", npz(npy("(99999999, 999)")), ibr.read_depth),
    "NPZ: content": ("d.npz", npz(npy("(1024, 1024)", content=bytes(4 << 20))), ibr.read_depth),
    "gzip": ("g.ply.gz", gzip.compress(bytes(64 << 20)), read_range_grid),
    "gzip of a mesh": ("m.ply.gz", gzip.compress(PLY % (b"ascii", b"3") + b"0 " * (8 << 20)), ibr.Mesh.load),
    "range grid: large": ("g.ply", GRID % (b"999999999", b"999999999"), read_range_grid),
    "range grid: long": ("g.ply", GRID % (LONG, LONG), read_range_grid),
    "PNG: depth": ("d.png", png(1 << 20, 1 << 20), lambda path: ibr.read_depth(path, depth_scale=1000)),
    "PNG: colour": ("c.png", png(60_000, 60_000), ibr.read_color),
    "PNG: relief": ("r.png", png(60_000, 60_000), read_relief_map),
    "PLY: vertices": ("m.ply", PLY % (b"ascii", b"999999999") + b"0 0 0\n", ibr.Mesh.load),
    "PLY: many bytes": ("m.ply", PLY % (b"binary_little_endian", b"999999999999") + bytes(99), ibr.Mesh.load),
    "PLY: long": ("m.ply", PLY % (b"ascii", LONG) + b"0 0 0\n", ibr.Mesh.load),
    "PLY: corners": ("m.ply", CORNERS, ibr.Mesh.load),
    "PLY: corners below none": ("m.ply", PLY % (b"ascii", b"1") + b"0 0 0\n-3 0 0 0\n", ibr.Mesh.load),
    "OFF": ("m.off", b"OFF\n3 999999999 0\n0 0 0\n0 0 1\n0 1 0\n3 0 1 2\n", ibr.Mesh.load),
    "OFF: long": ("m.off", b"OFF\n3 " + LONG + b" 0\n0 0 0\n", ibr.Mesh.load),
    "STL": ("m.stl", bytes(80) + b"\xff\xff\xff\xff" + bytes(50), ibr.Mesh.load),
    "OFF: a concave polygon": ("m.off", CONCAVE, ibr.Mesh.load),
    "OBJ": ("m.obj", b"v 0 0 0\nv 0 0 1\nv 0 1 0\nf 1 2 " + LONG + b"\n", ibr.Mesh.load),
    "GLB: entries": ("m.glb", glb(accessors=[{"bufferView": 0} | ZEROS]), ibr.Mesh.load),
    "GLB: zeros": ("m.glb", glb(accessors=[ZEROS]), ibr.Mesh.load),
    "GLB: zeros of nothing": ("m.glb", glb(accessors=[FEWER_ZEROS], bufferViews=[], buffers=[]), ibr.Mesh.load),
    "GLB: places": ("m.glb", glb(nodes=[{"mesh": 0}] * 40_000, scenes=[{"nodes": list(range(40_000))}]), ibr.Mesh.load),
    "GLB: a circle": ("m.glb", glb(nodes=[{"mesh": 0, "children": [0]}], scenes=[{"nodes": [0]}]), ibr.Mesh.load),
    "camera: deep": ("c.json", b"[" * 200_000, ibr.Camera.load),
    "YAML: deep brackets": ("c.yaml", b"a: " + b"[" * 200_000, ibr.Camera.load),
    "YAML: deep lists": ("c.yaml", b"- " * 200_000 + b"a", ibr.Camera.load),
    "YAML: a circle": ("c.yaml", b"a: &a [*a]\n", ibr.Camera.load),
    "camera: long": ("c.json", b'{"width": ' + LONG + b"}", ibr.Camera.load),
    "camera: too wide": ("c.json", b'{"width": 1e999, "height": 3, "K": [[1,0,0],[0,1,0],[0,0,1]]}', ibr.Camera.load),
}


@pytest.mark.parametrize("name", BOMBS)
def test_what_promises_more_than_it_holds_is_refused(tmp_path: Path, name):
    file, content, read = BOMBS[name]
    (tmp_path / file).write_bytes(content)
    start = time.process_time()
    with pytest.raises(ibr.FileFormatError, match=file) as caught:
        read(tmp_path / file)
    assert time.process_time() - start < 2 and "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["m.off.gz", "m.obj.gz", "m.ply.gz", "m.stl.gz"])
def test_packed_text_takes_no_more_memory_than_its_file_allows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name):
    """Packed text has a lower limit, because parsed text takes many times its size in memory."""
    monkeypatch.setattr(files, "UNPACKED_MAX", 1 << 30)
    (tmp_path / name).write_bytes(gzip.compress(b"v 0 0 0\n" * 5_000_000, 1))
    with pytest.raises(ibr.FileFormatError, match="unpacks to more than 16777216 bytes, more than 50 times"):
        ibr.Mesh.load(tmp_path / name)


def test_exr_larger_than_any_that_is_read(tmp_path: Path):
    pytest.importorskip("OpenEXR")
    ibr.write_depth(tmp_path / "d.exr", np.ones((600, 600), np.float32))
    with pytest.raises(ibr.FileFormatError, match=r"takes 1440000 bytes; up to 1048576 are read"):
        ibr.read_depth(tmp_path / "d.exr")


def test_what_is_packed_within_the_bound_is_read(tmp_path: Path):
    depth = np.ones((500, 500), np.float32)
    ibr.write_depth(tmp_path / "d.npz", depth)
    assert (tmp_path / "d.npz").stat().st_size < 5000
    np.testing.assert_array_equal(ibr.read_depth(tmp_path / "d.npz"), depth)


def test_postscript_is_not_run(tmp_path: Path):
    (tmp_path / "c.png").write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\nshowpage\n")
    for read in (ibr.read_color, read_relief_map):
        with pytest.raises(ibr.FileFormatError, match="PostScript"):
            read(tmp_path / "c.png")
