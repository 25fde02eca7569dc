"""Wavefront OBJ, with its materials (MTL) as far as they name a texture."""

from __future__ import annotations

import hashlib
import re
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.io import image
from pyibr.io.mesh_arrays import MeshArrays, beside, color_bytes, fans, texture_beside

_OWN = re.compile(r"# pyibr: (\d{1,12}) vertices, (\d{1,12}) triangles\n")
"""What files of ours open with, as the format has no counts that tell a whole file from a part."""


class _Lines:
    """Lines of a file, sorted by their keywords."""

    def __init__(self, text: str) -> None:
        self.rows: dict[str, list[list[str]]] = {"v": [], "vt": [], "vn": []}
        self.counts: list[int] = []
        self.corners: list[str] = []
        self.libraries: list[str] = []
        self.materials: dict[str, None] = {}  # those of faces, in their order
        material = ""
        for line in text.split("\n"):
            keyword, _, rest = line.strip().partition(" ")
            if keyword in self.rows:
                self.rows[keyword].append(rest.split())
            elif keyword == "f":
                corners = rest.split()
                if "-" in rest:
                    corners = [self._from_the_start(corner) for corner in corners]
                self.counts.append(len(corners))
                self.corners += corners
                self.materials[material] = None
            elif keyword == "usemtl":
                material = rest.strip()
            elif keyword == "mtllib":
                self.libraries.append(rest.strip())

    def _from_the_start(self, corner: str) -> str:
        """A corner whose negative numbers count back from the last line so far."""
        so_far = (len(rows) for rows in self.rows.values())
        parts = zip(corner.split("/"), so_far, strict=False)
        return "/".join(str(count + 1 + int(part)) if part.startswith("-") else part for part, count in parts)


def read_mesh(data: bytes, folder: Path) -> MeshArrays:
    """Return the mesh that a file's bytes hold, with the first texture that its materials name."""
    text = data.decode("utf-8", "surrogateescape").replace("\r\n", "\n").replace("\\\n", " ").replace("\t", " ")
    lines = _Lines(text)
    points, places, directions = (_numbers(lines.rows[name], least) for name, least in (("v", 3), ("vt", 2), ("vn", 3)))
    numbered = dict[str, int]()
    corners = np.array([numbered.setdefault(corner, len(numbered)) for corner in lines.corners], np.int64)
    faces = fans(np.array(lines.counts, np.int64), corners)
    own = _OWN.match(text)
    if own and not ([len(points), len(faces)] == [int(count) for count in own.groups()] and text.endswith("\n")):
        raise ValueError(f"expected {own[1]} vertices and {own[2]} triangles, got {len(points)} and {len(faces)}")
    table = _indices(list(numbered), (len(points), len(places), len(directions)))
    colors = points[:, 3:6] if points.shape[1] in (6, 7) else None
    if _one_to_one(table, points, places, directions):
        vertex, uv, normals = slice(None), places if len(places) else None, directions if len(directions) else None
        faces = table[faces, 0]
    else:  # a vertex for each different corner, in the order of the points
        order = np.argsort(table[:, 0], kind="stable")
        rank = np.empty_like(order)
        rank[order] = np.arange(len(order))
        vertex, of_uv, of_normal = table[order].T
        uv = np.where(of_uv[:, None] >= 0, places[of_uv, :2], 0) if (of_uv >= 0).any() else None
        normals = directions[of_normal] if (of_normal >= 0).all() else None
        faces = rank[faces]
    if uv is not None:
        uv = np.column_stack([uv[:, 0], 1 - uv[:, 1]])
    return MeshArrays(
        points[vertex, :3],
        faces,
        uv,
        None if normals is None else normals[:, :3],
        None if colors is None else color_bytes(colors[vertex] / (255 if colors.max(initial=0) > 1 else 1)),
        _texture(lines, folder),
    )


def mesh_files(mesh: MeshArrays, stem: str) -> tuple[bytes, dict[str, bytes]]:
    """Return an OBJ file, and by their names those that belong beside it: its materials and its texture.

    Their names hold a sum of the texture. So what another OBJ file names is never changed: neither the one that this
    one takes the place of, should it not come to that, nor one that was written at the same time. Of its own name they
    have what can stand in a line: a line's end, a backslash or a space before it would lose the texture.
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
    """The rows as an array, as wide as the shortest."""
    width = min((len(row) for row in rows), default=least)
    if width < least:
        raise ValueError(f"a line of {width} numbers, where {least} belong")
    words = chain.from_iterable(row[:width] for row in rows)
    return np.array([float(word) for word in words]).reshape(-1, width)


def _indices(corners: list[str], counts: tuple[int, int, int]) -> NDArray[np.int64]:
    """(U, 3) numbers from 0 of each corner's point, uv and normal; -1 where there is none."""
    parts = [[int(part or 0) for part in corner.split("/")] for corner in corners]
    table = np.array([[*part, 0, 0][:3] for part in parts], np.int64).reshape(-1, 3) - 1
    if (table >= counts).any() or (table < -1).any() or (table[:, 0] < 0).any():
        raise ValueError(
            f"a face of what is not there, among {counts[0]} vertices, {counts[1]} uv, {counts[2]} normals"
        )
    return table


def _one_to_one(table: NDArray[np.int64], points: NDArray[Any], *others: NDArray[Any]) -> bool:
    """Tell whether uv and normals are those of the vertices, or are none."""
    for column, values in enumerate(others, start=1):
        same = len(values) == len(points) and (table[:, column] == table[:, 0]).all()
        if not same and len(values):
            return False
    return True


def _texture(lines: _Lines, folder: Path) -> NDArray[np.uint8] | None:
    """The texture of the first material of a face that has one."""
    named = dict[str, str]()
    for library in lines.libraries:
        found = beside(folder, library, "file of materials")
        material = ""
        for line in (found or b"").decode("utf-8", "surrogateescape").splitlines():
            keyword, _, rest = line.strip().replace("\t", " ").partition(" ")
            if keyword == "newmtl":
                material = rest.strip()
            elif keyword.lower() == "map_kd" and rest.strip():
                # Options stand before the name, which then has no spaces.
                named[material] = rest.split()[-1] if rest.lstrip().startswith("-") else rest.strip()
    for material in lines.materials:
        if material in named:
            return texture_beside(folder, named[material])
    return None
