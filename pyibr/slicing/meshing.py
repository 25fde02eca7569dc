"""Solids as triangle meshes: their surface between the points of a grid, in the views' colours.

Each cube of the grid is cut into six tetrahedra, the same way everywhere. If a tetrahedron has corners on both sides of
the surface, the surface crosses its edges in three or four places, which are found by bisection. Neighbours share these
places, so the mesh is closed without a table of cases.
"""

from __future__ import annotations

import itertools
import logging
import time

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64, integer_from
from pyibr.core.errors import ArgumentError
from pyibr.meshes.mesh import Mesh
from pyibr.opencl.device import current, one_call
from pyibr.opencl.launch import launch
from pyibr.opencl.memory import empty, upload
from pyibr.opencl.program import kernel
from pyibr.picture.shadow import Lighting
from pyibr.picture.target import Target
from pyibr.slicing.drawing import buffers_of, draw_in_light, outline_of, ribbons_on_device
from pyibr.slicing.solid import Solid

_log = logging.getLogger("pyibr")

Mask = NDArray[np.bool_]
Int64 = NDArray[np.int64]

RESOLUTION_MAX = 1024
_SILENT_MAX = 1.0  # seconds between progress messages in the log
_AT_ONCE = 1 << 18  # points tested together: each takes a few bytes for each view
_PACKET = 16  # points are tested in whole packets, whatever the device
_BISECTIONS = 8  # bisections of an edge of the grid
_MARGIN = 1 / 256  # fraction of an edge: crossings keep this far from its ends, so that triangles have an area
_FACING = 0.05  # cosine: views hardly colour surfaces that they see more obliquely
_UNSEEN = 1e-6  # relative weight of views that did not see a point, for points that no view saw
_HIDDEN = 4.0  # sample distances: a point that lies farther behind a view's surface is occluded in this view


class MeshableSolid(Solid):
    """Solid that can be drawn, and converted to a mesh."""

    def draw(self, target: Target, lighting: Lighting | None) -> None:
        """Draw the object in its views' colours, which include their light, unless a light relights them."""
        draw_in_light(target, self, lighting)

    def to_mesh(self, resolution: int = 128) -> Mesh:
        """Return the solid as a closed mesh, in its views' colours.

        Parameters
        ----------
        resolution : int
            Cells of a grid along the longest edge of the box, up to 1024. Parts thinner than a cell may be lost; time
            and memory grow with the cube of the resolution.

        Returns
        -------
        Mesh
            Every edge has two triangles, which face outwards. The colour of a vertex comes from the views that saw it,
            weighted by how squarely they did.

        Raises
        ------
        ArgumentError
            If the solid is so thin that no point of the grid lies in it.

        Examples
        --------
        >>> import pyibr as ibr
        >>> from pyibr.capture import models
        >>> from pyibr.capture.raycast import object_views
        >>> mesh = ibr.DepthObject(object_views(models.donut(), 64)).to_mesh(48)
        >>> mesh.save("donut.glb")
        >>> (mesh.bounds[1] - mesh.bounds[0]).round().tolist()
        [3.0, 3.0, 1.0]
        >>> ibr.VisualHull(object_views(models.donut(), 64)).to_mesh(48).save("hull.glb")
        """
        integer_from("resolution", resolution, 1, RESOLUTION_MAX)
        box = self.box
        cell = float(box.edges.max()) / resolution
        # Points are the centres of cells. One more layer of cells all round lies beyond the box, outside the solid.
        shape = tuple(int(n) for n in np.ceil(box.edges / cell - 1e-6).astype(int) + 2)
        origin = 0.5 * (box.low + box.high) - 0.5 * cell * (np.array(shape) - 1)

        def places(nodes: Int64) -> Float64:
            return (origin + cell * np.stack(np.unravel_index(nodes, shape), axis=-1)) @ box.axes

        inside = np.zeros(shape, np.bool_)
        inner = np.arange(inside.size).reshape(shape)[1:-1, 1:-1, 1:-1].ravel()
        told = time.monotonic()
        for first in range(0, len(inner), _AT_ONCE):
            some = inner[first : first + _AT_ONCE]
            inside.ravel()[some] = contains(self, places(some))
            if time.monotonic() - told > _SILENT_MAX:
                told = time.monotonic()
                _log.info("making a mesh: %.0f %% of its grid is tested", 100 * (first + len(some)) / len(inner))
        if not inside.any():
            got = f"{resolution}, with no grid point inside"
            raise ArgumentError("resolution", "a resolution fine enough for the object", got)
        ends, faces = _crossed(inside)
        within, without = places(ends[:, 0]), places(ends[:, 1])
        low, high = np.zeros(len(ends)), np.ones(len(ends))
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            held = contains(self, within + middle[:, None] * (without - within))
            low, high = np.where(held, middle, low), np.where(held, high, middle)
        part = np.clip(0.5 * (low + high), _MARGIN, 1 - _MARGIN)[:, None]
        points = within + part * (without - within)
        normals = Mesh(points, faces).smooth_normals.astype(np.float64)
        return Mesh(points, faces, colors=colors_of(self, points, normals))


def contains(thing: Solid, points: Float64) -> Mask:
    """Tell which of the (N, 3) points of the world are in a solid."""
    order = np.unique(np.array(thing.outlines)).astype(np.int32)
    with one_call():
        buffers = {name: held for name, held in buffers_of(thing).items() if name != "colors"}
        defines = {"SILHOUETTES": int(thing.silhouettes)}
        if thing.thin:
            defines["RIBBONS"] = 1
            buffers |= ribbons_on_device(thing)
        count = -(-len(points) // _PACKET) * _PACKET
        near = np.zeros((3, count), np.float32)
        near[:, : len(points)] = (points - thing.box.center).T
        found = empty((count,), np.uint8)
        launch(
            kernel("slicing/contains.cl", "find_inside", **defines),
            current().profile.packets(count, 1)[:1],
            points=upload(near),
            inside=found,
            order=upload(order),
            view_count=len(order),
            unknown=thing.missing == "unknown",
            outline=outline_of(len(order)),
            count=count,
            **buffers,
        )
        return found.to_host()[: len(points)].astype(np.bool_)


def _crossed(inside: Mask) -> tuple[Int64, NDArray[np.int32]]:
    """Return the edges that the surface crosses, (N, 2) nodes inside and outside, and (M, 3) triangles of edges."""
    strides = np.array(inside.strides) // inside.itemsize
    mixed = np.zeros(np.array(inside.shape) - 1, np.int8)
    for corner in itertools.product((0, 1), repeat=3):
        mixed += inside[tuple(slice(c, c - 1 or None) for c in corner)]
    cubes = np.stack(np.nonzero((mixed > 0) & (mixed < 8)), axis=-1) @ strides
    steps = [np.cumsum([0, *strides[list(axes)]]) for axes in itertools.permutations(range(3))]
    corners = (cubes[:, None, None] + np.array(steps)).reshape(-1, 4)
    flags = inside.ravel()[corners]
    count = flags.sum(axis=1)
    crossed = (count > 0) & (count < 4)
    corners, flags, count = corners[crossed], flags[crossed], count[crossed]
    corners = np.take_along_axis(corners, np.argsort(~flags, axis=1, kind="stable"), axis=1)  # inner corners first
    triangles = list[Int64]()
    for held, shapes in _TRIANGLES.items():
        some = corners[count == held]
        triangles += [
            _outwards(np.stack([some[:, edge] for edge in shape], axis=1), some, held, inside.shape) for shape in shapes
        ]
    edges = np.concatenate(triangles).reshape(-1, 2)
    _, first, number = np.unique(edges[:, 0] * inside.size + edges[:, 1], return_index=True, return_inverse=True)
    return edges[first], number.reshape(-1, 3).astype(np.int32)


# Triangles of a tetrahedron with 1, 2 or 3 inner corners, which come first; each joins the crossings of three edges
_TRIANGLES = {
    1: [([0, 1], [0, 2], [0, 3])],
    2: [([0, 2], [0, 3], [1, 3]), ([0, 2], [1, 3], [1, 2])],
    3: [([0, 3], [1, 3], [2, 3])],
}


def _outwards(triangles: Int64, corners: Int64, held: int, shape: tuple[int, ...]) -> Int64:
    """Return (n, 3, 2) edges, ordered so that their triangles face the outer corners of the tetrahedra."""
    at = np.stack(np.unravel_index(triangles, shape), axis=-1).sum(axis=2)  # twice the edges' middles
    ends = np.stack(np.unravel_index(corners, shape), axis=-1).astype(np.float64)
    way = ends[:, held:].mean(axis=1) - ends[:, :held].mean(axis=1)
    facing = (np.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]) * way).sum(axis=1)
    return np.where((facing < 0)[:, None, None], triangles[:, ::-1], triangles)


def colors_of(thing: Solid, points: Float64, normals: Float64) -> NDArray[np.uint8]:
    """Return (N, 3) colours of points on a solid's surface, from views that see them, weighted by how squarely."""
    total, weights = np.zeros((len(points), 3)), np.full(len(points), 1e-30)
    for view in thing.surfaces:
        camera = view.camera
        pixels, z = camera.project(points)
        width, height = camera.size
        x, y = (np.clip(np.nan_to_num(pixels[:, k]), 0, size - 1) for k, size in enumerate((width, height)))
        towards = camera.center - points if camera.projection == "perspective" else -camera.forward[None]
        cosine = (normals * towards).sum(axis=1) / np.linalg.norm(towards, axis=1)
        squarely = np.maximum(cosine, 0) ** 2 + _FACING**2 * np.exp(cosine)
        sample = (z if camera.projection == "perspective" else 1.0) / min(camera.K[0, 0], camera.K[1, 1])
        left, top = np.floor(x).astype(int), np.floor(y).astype(int)
        shown = view.shown_color
        scale = 1.0 if shown.dtype == np.uint8 else 255.0
        part_sum, color, hidden = np.zeros(len(points)), np.zeros((len(points), 3)), np.ones(len(points), np.bool_)
        for across, down in itertools.product((0, 1), repeat=2):
            u, v = np.minimum(left + across, width - 1), np.minimum(top + down, height - 1)
            part = (x - left if across else 1 - x + left) * (y - top if down else 1 - y + top) + 1e-9
            part *= view.valid[v, u] & (z > 0)
            behind = (z - np.where(view.valid[v, u], view.depth[v, u], 0)) / sample
            part /= 1 + (behind / _HIDDEN) ** 2
            hidden &= behind > _HIDDEN
            part_sum += part
            color += part[:, None] * (scale * shown[v, u].astype(np.float64))
        share = squarely * np.where(hidden | (cosine < -_FACING), _UNSEEN, 1) / np.maximum(part_sum, 1e-30)
        total += share[:, None] * color
        weights += share * part_sum
    return np.rint(np.clip(total / weights[:, None], 0, 255)).astype(np.uint8)
