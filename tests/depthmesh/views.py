"""Depth images for tests of depth meshes, and helpers that compare triangulations with the grid of samples."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import pyibr as ibr
from pyibr.core.camera import Camera
from pyibr.depthmesh import Segmentation
from pyibr.images import DepthImage
from tests import scenes
from tests.slicing.solids import looking, torus, views_of_torus

PROJECTIONS = ("perspective", "orthographic")
TESTS = ("orthogonality", "connectedness", "disparity", "none")  # values of `Segmentation.test`
SIZE = (120, 100)
DIRECTIONS = ((0.5, 0.4, 1), (-1, 0.3, 0.2), (0.2, -1, -0.5))


def rough_depth(rng: np.random.Generator, size: scenes.Size, noise: float = 0.02, holes: float = 0.0) -> np.ndarray:
    """(H, W) float32 depths around 4, with waves and noise; `holes`: fraction of missing samples."""
    a, b = scenes.image_coordinates(size)
    phase = rng.uniform(0, 6, 2)
    depth = 4 + 0.4 * np.sin(3 * a + phase[0]) + 0.4 * np.cos(4 * b + phase[1]) + rng.normal(0, noise, a.shape)
    return np.where(rng.random(a.shape) < holes, np.nan, depth).astype(np.float32)


def rough(
    rng: np.random.Generator, size: scenes.Size, projection: str, noise: float = 0.02, holes: float = 0.0
) -> DepthImage:
    depth = rough_depth(rng, size, noise, holes)
    color = scenes.texture(*scenes.image_coordinates(size))
    return DepthImage(color, depth, scenes.source_camera(size, projection))


def cells_of(thing: ibr.DepthMesh) -> np.ndarray:
    """(H - 1, W - 1, 2) bool: whether each cell's upper and lower triangle are drawn."""
    width, height = thing.view.camera.size
    states = thing.tree.cells.to_host()[: height - 1, : width - 1]
    return np.stack([states & 3, states >> 2 & 3], -1) == 2


def samples_for(thing: ibr.DepthMesh, camera: Camera, tolerance: float) -> np.ndarray:
    """(T, 3, 2) corners, as x and y of samples, of a camera's triangles; the second corner has the right angle."""
    samples, faces = thing._triangles_for(camera, tolerance)
    return corners_of(samples[faces], thing)


def samples_within(thing: ibr.DepthMesh, max_error: float) -> np.ndarray:
    """(T, 3, 2) corners, as x and y of samples, of the triangles that `simplify` returns."""
    mesh = thing.simplify(max_error)
    return samples_of(mesh, thing.view.camera)[mesh.faces]


def samples_of(mesh: ibr.Mesh, camera: Camera) -> np.ndarray:
    """(N, 2) x and y of vertices' samples; vertices of border samples lie half a pixel outside of them."""
    assert mesh.uv is not None
    return np.clip(np.rint(mesh.uv * camera.size - 0.5), 0, np.subtract(camera.size, 1)).astype(np.int64)


def drawn_pixels(samples: np.ndarray, size: scenes.Size) -> np.ndarray:
    """(..., 2) pixels at which samples (..., 2) are drawn as vertices: half a pixel farther out at the border."""
    return samples - 0.5 * (samples == 0) + 0.5 * (samples == np.subtract(size, 1))


def corners_of(samples: np.ndarray, thing: ibr.DepthMesh) -> np.ndarray:
    return np.stack(np.divmod(samples, thing.view.camera.width)[::-1], -1).astype(np.int64)


def six() -> list[ibr.DepthImage]:
    return views_of_torus("orthographic")


def target(direction: tuple[float, ...] = DIRECTIONS[0], projection: str = "perspective") -> Camera:
    return looking(torus(), direction, SIZE, projection)


def weights_in(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(T, k, 3) barycentric weights of points (T, k, 2) in triangles (T, 3, 2)."""
    a, b, c = (corners[:, None, k] for k in range(3))

    def twice_area(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
        u, v = q - p, r - p
        return u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]

    parts = twice_area(points, b, c), twice_area(a, points, c), twice_area(a, b, points)
    return np.stack(parts, -1) / twice_area(a, b, c)[..., None]


def by_extent(corners: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Groups of triangles (n, 3, 2) with bounding boxes of one size, each with the samples (n, k, 2) in the boxes."""
    low, extent = corners.min(axis=1), np.ptp(corners, axis=1)
    for width, height in np.unique(extent, axis=0):
        same = (extent == (width, height)).all(axis=1)
        x, y = np.meshgrid(np.arange(width + 1), np.arange(height + 1))
        yield corners[same], low[same][:, None] + np.stack([x.ravel(), y.ravel()], -1)


def leaf_middles(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centres of a cell's upper and lower triangle; diagonals alternate from cell to cell."""
    main = (x + y) % 2 == 0
    upper = np.stack([x + np.where(main, 2, 1) / 3, y + 1 / 3], -1)
    return upper, np.stack([x + np.where(main, 1, 2) / 3, y + 2 / 3], -1)


def coverage(corners: np.ndarray, size: scenes.Size) -> np.ndarray:
    """(H - 1, W - 1, 2) number of given triangles that cover a point inside each cell's upper and lower triangle."""
    count = np.zeros((size[1] - 1, size[0] - 1, 2), np.int64)
    for some, points in by_extent(corners):
        x, y = points[..., 0], points[..., 1]
        for side, middle in enumerate(leaf_middles(x, y)):
            within = (weights_in(some, np.add(middle, (1.234e-4, -2.71e-4))) > 0).all(axis=-1)
            np.add.at(count, (y[within], x[within], side), 1)
    return count


def check_crack_free(corners: np.ndarray, size: scenes.Size) -> np.ndarray:
    """Assert that triangles which meet share whole edges; return as a mask which halves of cells they cover."""
    edge1, edge2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = edge1[:, 0] * edge2[:, 1] - edge1[:, 1] * edge2[:, 0]
    assert (areas < 0).all()  # counter-clockwise as seen by the camera, whose y axis points down
    covered = coverage(corners, size)
    assert covered.max() <= 1
    number = corners[..., 1] * size[0] + corners[..., 0]
    edges = np.concatenate([number[:, [0, 1]], number[:, [1, 2]], number[:, [2, 0]]])
    there, back = edges[:, 0] * size[0] * size[1] + edges[:, 1], edges[:, 1] * size[0] * size[1] + edges[:, 0]
    assert len(np.unique(there)) == len(there)
    lone = edges[~np.isin(there, back)]
    start, end = (np.stack([e % size[0], e // size[0]], -1) for e in lone.T)
    run, rise = (end - start).T
    cell = (
        np.minimum(start[:, 0], end[:, 0])
        + np.where(run * rise > 0, 0, -1)
        + np.where(run * rise > 0, np.minimum(start[:, 1], end[:, 1]), np.maximum(start[:, 1], end[:, 1]))
    )
    diagonal = (np.abs(run) == np.abs(rise)) & ((cell % 2 == 0) == (run * rise > 0))
    aslant = (run != 0) & (rise != 0) & ~diagonal
    if aslant.any():  # beside a dropped degenerate triangle: no other triangle may lie there
        along = (end - start)[aslant] / np.linalg.norm((end - start)[aslant], axis=1, keepdims=True)
        beyond = 0.5 * (end + start)[aslant] + 0.01 * np.stack([-along[:, 1], along[:, 0]], -1)
        assert not (weights_in(corners, np.broadcast_to(beyond, (len(corners), *beyond.shape))) > 0).all(axis=-1).any()
    else:
        assert covered.sum() == -areas.sum()
    start, end = start[~aslant], end[~aslant]
    steps = np.abs(end - start).max(axis=1)
    unit = (end - start) // steps[:, None]
    # Edges with one triangle: no triangle may lie just beyond any part of such an edge.
    number = np.repeat(np.arange(len(start)), steps)
    along = np.arange(len(number)) - np.repeat(np.cumsum(steps) - steps, steps) + 0.5
    right = np.stack([-unit[:, 1], unit[:, 0]], -1)  # to the right of the edge, as y points down
    beyond = start[number] + along[:, None] * unit[number] + 0.1 * right[number]
    cell = np.floor(beyond).astype(int)
    inside = ((cell >= 0) & (cell < np.subtract(size, 1))).all(axis=1)
    (x, y), (fx, fy) = cell[inside].T, (beyond - cell)[inside].T
    lower = np.where((x + y) % 2 == 0, fy > fx, fx + fy > 1)
    assert not covered[y, x, lower.astype(int)].any()
    return covered.astype(bool)


def some_mesh(rng: np.random.Generator, number: int) -> ibr.DepthMesh:
    """Random depth mesh number `number`: each third one has holes, and the segmentation tests take turns."""
    size = tuple(int(n) for n in rng.integers(2, 64, 2))
    noise, holes = rng.choice([0, 0.02, 0.3]), 0.01 * (number % 3 == 0)
    view = rough(rng, size, PROJECTIONS[number % 2], noise, holes)
    return ibr.DepthMesh(view, segmentation=Segmentation(TESTS[number // 2 % 4], gap=0.05))


def some_camera(rng: np.random.Generator, view: ibr.DepthImage) -> Camera:
    """Random camera near, in or behind the surface, which looks at a point near the surface."""
    low, high = view.bounds
    extent = np.maximum(high - low, 0.5)
    eye, at = rng.uniform(low - extent, high + extent), rng.uniform(low, high)
    if rng.random() < 0.25:  # on the surface
        eye = view.points[rng.integers(len(view.points))]
    if rng.random() < 0.25:
        return Camera.look_at(eye, at, (0, -1, 0.1), (200, 150), projection="orthographic", height=rng.uniform(0.5, 9))
    return Camera.look_at(eye, at, (0, -1, 0.1), (200, 150), fov_y=rng.uniform(10, 110))
