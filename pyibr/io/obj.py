"""Wavefront OBJ and its materials (MTL): the first texture, or the materials' colours without a texture."""

from __future__ import annotations

import hashlib
import re
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pyibr.core.files import utf8_of
from pyibr.images.srgb import in_bytes
from pyibr.io import image
from pyibr.io.mesh_arrays import MeshArrays, beside, texture_beside, texture_from
from pyibr.io.polygons import triangles

_OWN = re.compile(r"# pyibr: (\d{1,12}) vertices, (\d{1,12}) triangles\n")
"""First line of pyibr's files: OBJ has no counts, which would reveal a truncated file."""

_NO_SURFACES = {"p": "points", "l": "lines", "curv": "curves", "surf": "free-form surfaces"}


class _Material(NamedTuple):
    color: tuple[float, ...] | None = None
    texture: str | None = None


class _Lines:
    """Lines of a file, grouped by keyword."""

    def __init__(self, text: str) -> None:
        self.rows: dict[str, list[list[str]]] = {"v": [], "vt": [], "vn": []}
        self.counts: list[int] = []
        self.corners: list[str] = []
        self.libraries: list[str] = []
        self.materials: dict[str, int] = {}  # materials of faces, numbered in order of appearance
        self.of_faces: list[int] = []
        self.left_out: dict[str, None] = {}
        material = ""
        for line in text.split("\n"):
            if "#" in line:
                line = re.sub(r"(^|\s)#.*", "", line)
            keyword, _, rest = line.strip().partition(" ")
            if keyword in self.rows:
                self.rows[keyword].append(rest.split())
            elif keyword == "f":
                corners = rest.split()
                if "-" in rest:
                    corners = [self._from_the_start(corner) for corner in corners]
                self.counts.append(len(corners))
                self.corners += corners
                self.of_faces.append(self.materials.setdefault(material, len(self.materials)))
            elif keyword == "usemtl":
                material = rest.strip()
            elif keyword == "mtllib":
                self.libraries.append(rest.strip())
            elif keyword in _NO_SURFACES:
                self.left_out[_NO_SURFACES[keyword]] = None

    def _from_the_start(self, corner: str) -> str:
        """Resolve a corner's negative numbers, which count back from the last line so far."""
        so_far = (len(rows) for rows in self.rows.values())
        parts = zip(corner.split("/"), so_far, strict=False)
        return "/".join(str(count + 1 + int(part)) if part.startswith("-") else part for part, count in parts)


def read_mesh(data: bytes, folder: Path) -> MeshArrays:
    """Return the mesh in a file's bytes, with the first texture of its materials, or the materials' colours."""
    text = data.decode("utf-8", "surrogateescape").replace("\r\n", "\n").replace("\\\n", " ").replace("\t", " ")
    lines = _Lines(text)
    points, places, directions = (_numbers(lines.rows[name], least) for name, least in (("v", 3), ("vt", 2), ("vn", 3)))
    known, lost = _materials(lines.libraries, folder)
    used = [known.get(name, _Material()) for name in lines.materials]
    textures = list(dict.fromkeys(material.texture for material in used if material.texture))
    colors = _of_points(points)
    is_tinted = not textures and colors is None and any(material.color for material in used)
    counts = np.array(lines.counts, np.int64)
    tints: list[int] = np.repeat(lines.of_faces, counts).tolist() if is_tinted else [0] * len(lines.corners)
    numbered = dict[tuple[str, int], int]()
    keys = zip(lines.corners, tints, strict=True)
    corners = np.array([numbered.setdefault(key, len(numbered)) for key in keys], np.int64)
    table = _indices([corner for corner, _ in numbered], (len(points), len(places), len(directions)))
    faces = corners[triangles(counts, points[table[corners, 0], :3])]
    own = _OWN.match(text)
    if own and not ([len(points), len(faces)] == [int(count) for count in own.groups()] and text.endswith("\n")):
        raise ValueError(f"expected {own[1]} vertices and {own[2]} triangles, got {len(points)} and {len(faces)}")
    order = np.argsort(table[:, 0], kind="stable")
    if not is_tinted and _one_to_one(table, points, places, directions):
        vertex, uv, normals = slice(None), places if len(places) else None, directions if len(directions) else None
        faces = table[faces, 0]
    else:  # a vertex for each distinct corner, in the order of the points
        rank = np.empty_like(order)
        rank[order] = np.arange(len(order))
        vertex, of_uv, of_normal = table[order].T
        uv = np.where(of_uv[:, None] >= 0, places[of_uv, :2], 0) if (of_uv >= 0).any() else None
        normals = directions[of_normal] if (of_normal >= 0).all() else None
        faces = rank[faces]
    if is_tinted:
        painted = in_bytes(np.array([material.color or (1, 1, 1) for material in used]))
        colors = painted[np.array([tint for _, tint in numbered])[order]]
    elif colors is not None:
        colors = colors[vertex]
    if uv is not None:
        uv = np.column_stack([uv[:, 0], 1 - uv[:, 1]])
    if textures and any(material.color and not material.texture for material in used):
        lost.append("colours of materials without a texture")
    picture = texture_beside(folder, textures[0]) if textures else None
    return MeshArrays(
        points[vertex, :3],
        faces,
        uv,
        None if normals is None else normals[:, :3],
        colors,
        None if picture is None else texture_from(picture, textures[0]),
        (*lines.left_out, *lost, *textures[1:]),
    )


def mesh_files(mesh: MeshArrays, stem: str) -> tuple[bytes, dict[str, bytes]]:
    """Return an OBJ file, and its materials and texture as further files by name.

    The names contain a checksum of the texture. So they differ from the names of the files that belong to a replaced
    OBJ, which stays valid if the write fails, or to an OBJ written at the same time. The OBJ's own name is reduced to
    characters that are valid in a line: a line end, a backslash or a leading space would lose the texture.
    """
    head = f"# pyibr: {len(mesh.vertices)} vertices, {len(mesh.faces)} triangles\n"
    others = dict[str, bytes]()
    if mesh.texture is not None:
        texture = np.ascontiguousarray(mesh.texture)
        readable = re.sub(r"[^\w.() -]|^[ -]", "_", stem)
        name = f"{readable}-{hashlib.sha256(repr(texture.shape).encode() + texture.tobytes()).hexdigest()[:12]}"
        others[f"{name}.png"] = image.encoded(texture, ".png")
        others[f"{name}.mtl"] = f"newmtl texture\nKd 1 1 1\nmap_Kd {name}.png\n".encode("utf-8", "surrogateescape")
        head += f"mtllib {name}.mtl\nusemtl texture\n"
    row, values = "v %.9g %.9g %.9g\n", mesh.vertices
    if mesh.colors is not None:
        row, values = "v %.9g %.9g %.9g %.5f %.5f %.5f\n", np.hstack([mesh.vertices, mesh.colors / 255.0])
    parts = [head, _lines(row, values)]
    if mesh.uv is not None:
        turned = np.column_stack([mesh.uv[:, 0], 1 - mesh.uv[:, 1].astype(np.float64)])
        parts.append(_lines("vt %r %r\n", turned))
    if mesh.normals is not None:
        parts.append(_lines("vn %.9g %.9g %.9g\n", mesh.normals))
    corner = {(False, False): "{0}", (True, False): "{0}/{0}", (False, True): "{0}//{0}", (True, True): "{0}/{0}/{0}"}
    written = corner[mesh.uv is not None, mesh.normals is not None].replace("{0}", "%d")
    numbers = np.repeat(mesh.faces.reshape(-1, 1) + 1, written.count("%d"), axis=1)
    parts.append(_lines(f"f {written} {written} {written}\n", numbers.reshape(len(mesh.faces), -1)))
    return "".join(parts).encode("utf-8", "surrogateescape"), others


def _lines(row: str, values: NDArray[Any]) -> str:
    return row * len(values) % tuple(values.ravel().tolist())


def _numbers(rows: list[list[str]], least: int) -> NDArray[np.float64]:
    """The rows as an array, as wide as the shortest row."""
    width = min((len(row) for row in rows), default=least)
    if width < least:
        raise ValueError(f"a line of {width} numbers, expected at least {least}")
    words = chain.from_iterable(row[:width] for row in rows)
    return np.array([float(word) for word in words]).reshape(-1, width)


def _of_points(points: NDArray[np.float64]) -> NDArray[np.uint8] | None:
    """Colours after the points' coordinates, if there are any: up to 1, or up to 255."""
    if points.shape[1] not in (6, 7):
        return None
    stored = points[:, 3:6]
    return in_bytes(stored / (255 if stored.max(initial=0) > 1 else 1))


def _indices(corners: list[str], counts: tuple[int, int, int]) -> NDArray[np.int64]:
    """(U, 3) indices, from 0, of each corner's point, uv and normal; -1 for none."""
    parts = [[int(part or 0) for part in corner.split("/")] for corner in corners]
    table = np.array([[*part, 0, 0][:3] for part in parts], np.int64).reshape(-1, 3) - 1
    if (table >= counts).any() or (table < -1).any() or (table[:, 0] < 0).any():
        raise ValueError(f"a face with an index beyond {counts[0]} vertices, {counts[1]} uv or {counts[2]} normals")
    return table


def _one_to_one(table: NDArray[np.int64], points: NDArray[Any], *others: NDArray[Any]) -> bool:
    """Tell whether uv and normals, if there are any, have the vertices' indices."""
    for column, values in enumerate(others, start=1):
        same = len(values) == len(points) and (table[:, column] == table[:, 0]).all()
        if not same and len(values):
            return False
    return True


def _materials(libraries: list[str], folder: Path) -> tuple[dict[str, _Material], list[str]]:
    """The materials of libraries by name, and a list of missing libraries.

    A line names several libraries, separated by spaces, or one whose name contains spaces.
    """
    found, lost = dict[str, _Material](), list[str]()
    for line in libraries:
        whole = beside(folder, line, "file of materials")
        for name in line.split() if whole is None else [line]:
            data = beside(folder, name, "file of materials")
            if data is None:
                lost.append(f"materials of {name}, which is missing")
            else:
                found = _described(utf8_of(data).decode("utf-8", "surrogateescape")) | found
    return found, lost


def _described(text: str) -> dict[str, _Material]:
    found, name = dict[str, _Material](), ""
    for line in text.splitlines():
        keyword, _, rest = line.strip().replace("\t", " ").partition(" ")
        words = rest.split()
        if keyword == "newmtl":
            name = rest.strip()
            found[name] = _Material()
        elif keyword == "Kd" and name in found and words[0] not in ("spectral", "xyz"):
            found[name] = found[name]._replace(color=tuple(float(word) for word in words[:3]))
        elif keyword.lower() == "map_kd" and words and name in found:
            # Options precede the name, which then has no spaces.
            found[name] = found[name]._replace(texture=words[-1] if rest.lstrip().startswith("-") else rest.strip())
    return found
