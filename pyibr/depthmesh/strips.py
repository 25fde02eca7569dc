"""Triangle strips of a quadtree's triangles (Pajarola 1998; Pajarola, Sainz & Meng 2003, figure 6)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.meshes.mesh import Mesh

Int32 = NDArray[np.int32]


def strips_of(samples: Int32, faces: Int32, size: tuple[int, int], side: int) -> list[Int32]:
    """Join a quadtree's triangles into the strips of `DepthMesh.strips`, in the order of a Sierpinski curve.

    `samples`, (T, 3), are y * width + x of each triangle's corners, of which the second has the right angle; `faces`,
    (T, 3), the same corners, as the vertex numbers that strips hold; `size` the image's width and height; `side` the
    number of cells along the tree's side. A number that is repeated after one other number turns the strip.
    """
    ordered = faces[np.argsort(_along_curve(samples, size, side), kind="stable")].tolist()
    strips: list[Int32] = []
    run: list[list[int]] = []
    for face in ordered:
        if run and not _may_follow(run, face):
            strips.append(_strip(run))
            run = []
        run.append(face)
    if run:
        strips.append(_strip(run))
    return strips


def with_normals(strips: list[Int32], mesh: Mesh, color: np.dtype[Any]) -> list[NDArray[np.void]]:
    """Replace vertex numbers in strips by packed records: number, position, normal and color."""
    fields = [("number", np.int32), ("position", np.float32, 3), ("normal", np.float32, 3), ("color", color, 3)]
    records = np.empty(len(mesh.vertices), fields)
    records["number"] = np.arange(len(records))
    records["position"], records["normal"], records["color"] = mesh.vertices, mesh.normals, mesh.colors
    return [records[strip] for strip in strips]


def _along_curve(samples: Int32, size: tuple[int, int], side: int) -> NDArray[np.int64]:
    """Position of each triangle on the curve: a binary digit for each choice on the way down the tree."""
    last = np.subtract(size, 1)  # last column and row, where the padding lies (kernels/depthmesh/tree.h)
    corners = np.stack(np.divmod(samples, size[0])[::-1], -1).astype(np.float64)
    middle = corners.mean(axis=1)
    upper = _turns(np.zeros(2), last, middle) < 0  # the root's diagonal runs to the lower right
    # The curve runs from `start` to `end`, the ends of a triangle's longest side, past its `right_angle`.
    start = np.where(upper[:, None], side, 0) * np.ones(2)
    end = side - start
    right_angle = np.where(upper[:, None], (side, 0), (0, side)).astype(np.float64)
    key = upper.astype(np.int64)
    for _ in range(2 * side.bit_length() - 1):
        split = 0.5 * (start + end)
        beside = _turns(np.minimum(right_angle, last), np.minimum(split, last), middle)
        second = beside * _turns(right_angle, split, end) > 0
        start, end = np.where(second[:, None], right_angle, start), np.where(second[:, None], end, right_angle)
        right_angle = split
        key = 2 * key + second
    return key


def _turns(a: NDArray[Any], b: NDArray[Any], c: NDArray[Any]) -> NDArray[Any]:
    """Twice the signed area of the triangle a, b, c; the sign is the direction of the turn at b."""
    u, v = b - a, c - a
    return u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]


def _may_follow(run: list[list[int]], face: list[int]) -> bool:
    """Tell whether a triangle shares a side with the last triangle of a run, other than the side it was entered by."""
    shared = set(run[-1]) & set(face)
    return len(shared) == 2 and (len(run) == 1 or not shared <= set(run[-2]))


def _strip(run: list[list[int]]) -> Int32:
    """Make the strip of a run, in which each triangle shares a side with the next one."""
    first = run[0]
    if len(run) == 1:
        return np.array(first, np.int32)
    alone = next(k for k in range(3) if first[k] not in run[1])
    strip = [*first[alone:], *first[:alone]]  # same winding; the strip leaves the triangle by its last two corners
    for face, following in zip(run[1:], [*run[2:], None], strict=True):
        old, last = strip[-2:]
        new = next(corner for corner in face if corner not in (old, last))
        if following is not None and last not in following:
            strip.append(old)  # turn: the strip leaves by the side of `old` and `new`
        strip.append(new)
    return np.array(strip, np.int32)
