"""PLY: a header that describes tables, then their rows as text or binary: vertices with attributes, and faces.

Files of 3D Gaussians hold vertices alone. A comment names the texture, as MeshLab and others write it; v runs up there.
The points of a range grid lie in rows and columns, as in the scans of Stanford's repository.
"""

from __future__ import annotations

import gzip
import re
import zlib
from os import PathLike
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pyibr.core.files import read_bytes, reading
from pyibr.images.srgb import in_bytes
from pyibr.io.mesh_arrays import MeshArrays, count_of, texture_beside, texture_from, whole
from pyibr.io.polygons import triangles

_KINDS = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_NAMES: dict[str, Literal["little", "big"]] = {"<": "little", ">": "big"}
_HEADER_MAX = 1 << 16  # bytes
_LIST_MAX = 64  # longest lists that are read as a table
_OF_GAUSSIANS = re.compile(rb"^property \S+ (f_dc_0|packed_position)\s*$", re.MULTILINE)
_UV = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
_TEXTURE = re.compile(r"^comment\s+TextureFile\s+(.+?)\s*$", re.MULTILINE)
_COLORS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"))


class _Property(NamedTuple):
    name: str
    kind: str
    counted: str = ""
    """The type of a list's leading count; empty for a scalar."""


class _Element(NamedTuple):
    name: str
    rows: int
    properties: list[_Property]


_List = tuple[NDArray[Any], NDArray[Any]]
"""The number of entries in each row, and the entries of all rows in sequence."""


class _Text:
    """Rows as numbers in text."""

    def __init__(self, body: bytes) -> None:
        text = body.decode("ascii")
        self._numbers: NDArray[np.float64] = np.fromstring(text, sep=" ") if text.strip() else np.empty(0)
        self.at = 0

    def table(self, kinds: list[str], count: int) -> list[NDArray[Any]]:
        part = self._numbers[self.at : self.at + count * len(kinds)]
        self.skip("", count * len(kinds))
        return list(part.reshape(count, len(kinds)).T)

    def count(self, kind: str) -> int:
        self.skip(kind, 1)
        count = self._numbers.item(self.at - 1)
        if not float(count).is_integer():
            raise ValueError("a list whose length is no whole number")
        return int(count)

    def skip(self, kind: str, count: int) -> None:
        self.at += count
        if self.at > len(self._numbers):
            raise ValueError("fewer numbers than the header counts")

    def entries(self, kind: str, starts: NDArray[np.int64], counts: NDArray[np.int64]) -> NDArray[Any]:
        return self._numbers[_places(starts, counts, 1)]

    def left(self) -> int:
        return len(self._numbers) - self.at


class _Binary:
    """Rows as bytes."""

    def __init__(self, body: bytes, order: str) -> None:
        self._body, self._order = body, order
        self.at = 0

    def table(self, kinds: list[str], count: int) -> list[NDArray[Any]]:
        row = np.dtype([(str(number), self._order + kind) for number, kind in enumerate(kinds)])
        if len(self._body) - self.at < row.itemsize * count:
            raise ValueError("fewer bytes than the header counts")
        rows = np.frombuffer(self._body, row, count, self.at)
        self.at += rows.nbytes
        return [rows[str(number)] for number in range(len(kinds))]

    def count(self, kind: str) -> int:
        first = self.at
        self.skip(kind, 1)
        if kind[0] == "f":
            return int(whole(np.frombuffer(self._body, self._order + kind, 1, first))[0])
        return int.from_bytes(self._body[first : self.at], _NAMES[self._order], signed=kind[0] == "i")

    def skip(self, kind: str, count: int) -> None:
        self.at += count * int(kind[1])
        if self.at > len(self._body):
            raise ValueError("fewer bytes than the header counts")

    def entries(self, kind: str, starts: NDArray[np.int64], counts: NDArray[np.int64]) -> NDArray[Any]:
        body, size = np.frombuffer(self._body, np.uint8), int(kind[1])
        places = _places(starts, counts, size)
        found = np.stack([body[places + byte] for byte in range(size)], axis=1)
        return found.view(self._order + kind).ravel()

    def left(self) -> int:
        return len(self._body[self.at :].strip())


def read_mesh(data: bytes, folder: Path) -> MeshArrays:
    """Return the mesh in a file's bytes."""
    found, textures = _tables(data)
    element, vertex = found["vertex"]
    _, face = found["face"]
    counts, corners = face["vertex_indices"] if "vertex_indices" in face else face["vertex_index"]
    normals = np.column_stack([vertex[name] for name in ("nx", "ny", "nz")]) if "nx" in vertex else None
    colors = None
    for names in _COLORS:
        if names[0] in vertex:
            kind = next(item.kind for item in element.properties if item.name == names[0])
            stored = np.column_stack([vertex[name] for name in names])
            white = 1.0 if kind[0] == "f" else float(np.iinfo(kind).max)
            colors = in_bytes(stored / white)
    points = np.column_stack([vertex[name] for name in "xyz"])
    numbers = whole(corners)
    chosen = triangles(whole(counts), points[numbers])
    uv = next((np.column_stack([vertex[name] for name in names]) for names in _UV if names[0] in vertex), None)
    lengths, of_corners = face.get("texcoord", (None, None))
    if uv is None and lengths is not None and np.array_equal(lengths, 2 * counts):
        uv = of_corners.reshape(-1, 2)[chosen]
    picture = texture_beside(folder, textures[0]) if textures and uv is not None else None
    texture = None if picture is None else texture_from(picture, textures[0])
    lost = (
        *textures[1:],
        *("colours of faces",) * ("red" in face),
        *("uv of faces",) * ("texcoord" in face and uv is None),
    )
    return MeshArrays(
        points,
        numbers[chosen],
        None if uv is None else np.stack([uv[..., 0], 1 - uv[..., 1].astype(np.float64)], axis=-1),
        normals,
        colors,
        texture,
        lost,
    )


def holds_gaussians(path: Path) -> bool:
    """Tell whether a file's header, also packed by gzip, describes 3D Gaussians; False if there is no such file."""
    try:
        with gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb") as stream:
            header = stream.read(_HEADER_MAX).partition(b"end_header")[0]
    except (OSError, EOFError, zlib.error):
        return False
    return header.startswith(b"ply") and _OF_GAUSSIANS.search(header) is not None


def read_columns(data: bytes) -> dict[str, dict[str, NDArray[Any]]]:
    """Return the columns of a file's tables, such as its vertices, by the names of both, without lists."""
    found, _ = _tables(data)
    return {
        name: {item.name: columns[item.name] for item in element.properties if not item.counted}
        for name, (element, columns) in found.items()
    }


def column_bytes(tables: dict[str, dict[str, NDArray[Any]]]) -> bytes:
    """Return a binary file of these tables: bytes, uint32, and all other columns as float32."""
    header, contents = list[str](), list[memoryview]()
    for name, columns in tables.items():
        kinds = {"B": "uchar", "I": "uint"}
        described = [(kinds.get(values.dtype.char, "float"), key, values) for key, values in columns.items()]
        lines, rows = _table_of(name, described)
        header += lines
        contents.append(rows.data)
    return b"".join([_opening(header), *contents])


def _tables(data: bytes) -> tuple[dict[str, tuple[_Element, dict[str, Any]]], list[str]]:
    """A file's tables with their columns, by name, and the textures' names."""
    elements, order, body, textures = _header(data)
    source = _Binary(body, order) if order else _Text(body)
    found = {element.name: (element, _columns(element, source)) for element in elements}
    if source.left():
        raise ValueError("more content than the header counts")
    return found, textures


def mesh_bytes(mesh: MeshArrays) -> bytes:
    """Return a binary file with vertices, normals and colours, without uv and texture."""
    columns = [("float", name, mesh.vertices[:, axis]) for axis, name in enumerate("xyz")]
    if mesh.normals is not None:
        columns += [("float", f"n{name}", mesh.normals[:, axis]) for axis, name in enumerate("xyz")]
    if mesh.colors is not None:
        columns += [("uchar", name, mesh.colors[:, channel]) for channel, name in enumerate(_COLORS[0])]
    header, vertices = _table_of("vertex", columns)
    faces = np.empty(len(mesh.faces), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    return _opening(header) + vertices.tobytes() + faces.tobytes()


def _opening(tables: list[str]) -> bytes:
    """The header of a binary file, with the lines that describe its tables."""
    return "\n".join(["ply", "format binary_little_endian 1.0", *tables, "end_header", ""]).encode("ascii")


def _table_of(element: str, columns: list[tuple[str, str, NDArray[Any]]]) -> tuple[list[str], NDArray[Any]]:
    """The header's lines and the rows of a table with columns (kind, name, values)."""
    rows = np.empty(len(columns[0][2]), [(name, "<" + _KINDS[kind]) for kind, name, _ in columns])
    for _, name, values in columns:
        rows[name] = values
    return [f"element {element} {len(rows)}", *(f"property {kind} {name}" for kind, name, _ in columns)], rows


def _header(data: bytes) -> tuple[list[_Element], str, bytes, list[str]]:
    """The tables, the byte order (empty for text), the content after the header, and the textures' names."""
    end = data.find(b"end_header", 0, _HEADER_MAX)
    text = data[: max(end, 0)].decode("utf-8", "surrogateescape")
    lines = text.splitlines()
    if end < 0 or lines[0].strip() != "ply":
        raise ValueError("no header that opens with ply and ends with end_header")
    length = len(b"end_header") + (2 if data[end:].startswith(b"end_header\r\n") else 1)
    body, order, elements = data[end + length :], None, list[_Element]()
    for words in (line.split() for line in lines[1:]):
        if words[:1] == ["format"]:
            order = _ORDERS[words[1]]
        elif words[:1] == ["element"]:
            elements.append(_Element(words[1], count_of(words[2], len(body)), []))
        elif words[:2] == ["property", "list"]:
            elements[-1].properties.append(_Property(words[4], _KINDS[words[3]], _KINDS[words[2]]))
        elif words[:1] == ["property"]:
            elements[-1].properties.append(_Property(words[2], _KINDS[words[1]]))
        elif words and words[0] not in ("comment", "obj_info"):
            raise ValueError(f"{words[0][:40]!r} in the header")
    if order is None:
        raise ValueError("no format in the header")
    names = [(element.name, item.name) for element in elements for item in element.properties]
    if len(set(names)) < len(names) or len({element.name for element in elements}) < len(elements):
        raise ValueError("the header names something twice")
    return elements, order, body, _TEXTURE.findall(text)


def _columns(element: _Element, source: _Text | _Binary) -> dict[str, Any]:
    """An element's columns by name; lists as `_List`."""
    start = source.at
    lengths = [int(counts[0]) for counts, _ in _rows(element, source, 1)[1].values()] if element.rows else []
    source.at = start
    if max(lengths, default=0) <= _LIST_MAX:
        found = _table(element, source, lengths)
        if found is not None:
            return found
    source.at = start
    plain, lists = _rows(element, source, element.rows)
    return plain | lists


def _table(element: _Element, source: _Text | _Binary, lengths: list[int]) -> dict[str, Any] | None:
    """The columns if all lists are as long as in the first row, which is usual; else None."""
    spans, kinds, waiting = list[tuple[_Property, int, int]](), list[str](), iter(lengths)
    for item in element.properties:
        if item.counted:
            kinds.append(item.counted)
        length = next(waiting, 0) if item.counted else 1
        spans.append((item, len(kinds), length))
        kinds += [item.kind] * length
    try:
        columns = source.table(kinds, element.rows)
    except ValueError:
        return None
    found = dict[str, Any]()
    for item, first, length in spans:
        if not item.counted:
            found[item.name] = columns[first]
        elif (columns[first - 1] != length).any():
            return None
        else:
            entries = np.column_stack(columns[first : first + length]).ravel() if length else np.empty(0)
            found[item.name] = columns[first - 1], entries
    return found


def _rows(element: _Element, source: _Text | _Binary, count: int) -> tuple[dict[str, NDArray[Any]], dict[str, _List]]:
    """Read row by row: the scalar columns, and the lists."""
    starts = [list[int]() for _ in element.properties]
    lengths = [list[int]() for _ in element.properties]
    columns = list(zip(element.properties, starts, lengths, strict=True))
    for _ in range(count):
        for item, start, length in columns:
            entries = source.count(item.counted) if item.counted else 1
            if entries < 0:
                raise ValueError("a list of a negative length")
            start.append(source.at)
            length.append(entries)
            source.skip(item.kind, entries)
    plain, lists = dict[str, NDArray[Any]](), dict[str, _List]()
    for item, start, length in columns:
        counts = np.array(length, np.int64)
        entries = source.entries(item.kind, np.array(start, np.int64), counts)
        if item.counted:
            lists[item.name] = counts, entries
        else:
            plain[item.name] = entries
    return plain, lists


def _places(starts: NDArray[np.int64], counts: NDArray[np.int64], step: int) -> NDArray[np.int64]:
    """Indices of the entries of lists that begin at `starts`; entries are `step` apart."""
    before = np.cumsum(counts) - counts
    places: NDArray[np.int64] = np.repeat(starts - step * before, counts)
    return places + step * np.arange(len(places))


def read_range_grid(path: str | PathLike[str]) -> NDArray[np.float32]:
    """Read a scan: an ASCII PLY file with an element ``range_grid``, also packed by gzip.

    Parameters
    ----------
    path : path
        A file that ends in .ply, or .ply.gz.

    Returns
    -------
    (rows, columns, 3) float32
        Points in the scanner's frame, in the file's unit; NaN where the scanner measured nothing.

    Raises
    ------
    FileFormatError
        If the file is missing, truncated, or no range grid.

    Examples
    --------
    >>> from pathlib import Path
    >>> from pyibr.io import read_range_grid
    >>> header = "ply\\nformat ascii 1.0\\nobj_info num_cols 2\\nobj_info num_rows 1\\nelement vertex 1\\n"
    >>> header += "property float x\\nproperty float y\\nproperty float z\\nelement range_grid 2\\n"
    >>> header += "property list uchar int vertex_indices\\nend_header\\n"
    >>> _ = Path("scan.ply").write_text(header + "1 2 3\\n1 0\\n0\\n")
    >>> read_range_grid("scan.ply").tolist()
    [[[1.0, 2.0, 3.0], [nan, nan, nan]]]
    """
    with reading(path, "range grid") as source:
        data = read_bytes(source).replace(b"\r\n", b"\n")
        head, separator, body = data.partition(b"end_header\n")
        lines = head.decode("ascii").splitlines()
        words = [line.split() for line in lines]
        if not separator or words[:1] != [["ply"]] or ["format", "ascii", "1.0"] not in words:
            raise ValueError("expected an ASCII PLY file")
        named = {tuple(line[:2]): line[2:] for line in words if len(line) >= 3}
        try:
            columns, rows = (int(named["obj_info", name][0]) for name in ("num_cols", "num_rows"))
            count, cells = (int(named["element", name][0]) for name in ("vertex", "range_grid"))
        except KeyError as error:
            raise ValueError(f"no {' '.join(error.args[0])} in the header") from None
        properties = words[words.index(["element", "vertex", str(count)]) + 1 :]
        if [line[-1] for line in properties[:3]] != ["x", "y", "z"] or cells != rows * columns:
            raise ValueError("expected vertices that start with x y z, and a cell for each row and column")
        text = body.decode("ascii").splitlines()
        if len(text) < count + cells:
            raise ValueError(f"expected {count} vertices and {cells} cells, got {len(text)} lines")
        points = np.array([line.split()[:3] for line in text[:count]], np.float32).reshape(count, 3)
        grid = np.full((cells, 3), np.nan, np.float32)
        # A cell is "0", or "1" and the index of its vertex.
        number = np.array([int(line[2:]) if line[:2] == "1 " else -1 for line in text[count : count + cells]])
        if number.max(initial=-1) >= count:
            raise ValueError(f"a cell with vertex {number.max()}, of only {count} vertices")
        grid[number >= 0] = points[number[number >= 0]]
        return grid.reshape(rows, columns, 3)
