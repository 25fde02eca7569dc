"""Pictures of depth meshes, made by pictures.py."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from objects import by_rays, knot
from reliefs import show, wires

import pyibr as ibr
from pyibr.capture import object_views
from pyibr.depthmesh import Segmentation

WHITE = (255, 255, 255)
EXPOSURES = (1.0, 0.72, 0.86, 1.12, 0.78, 0.94)


def seen_from(*eye: float, size: tuple[int, int] = (420, 400)) -> ibr.Camera:
    return ibr.Camera.look_at(eye, (0, 0, 0), (0, 0, 1), size, fov_y=42)


def segmentation() -> Figure:
    """Draw the depth mesh of one view of a knot from the side: with and without rubber sheets, and its triangles."""
    view = object_views(knot(), 512, projection="perspective")[5]  # from above
    camera = seen_from(4.5, -5.5, 6.5)
    mesh = ibr.DepthMesh(view, tolerance=2)
    stretched = ibr.DepthMesh(view, tolerance=2, segmentation=Segmentation("none"))
    figure, row = plt.subplots(1, 4, figsize=(14, 3.6), layout="constrained")
    show(row[0], np.where(view.valid[..., None], view.color, 255), "the view, with depth")
    show(row[1], ibr.render(stretched, camera, background=WHITE, samples=4).color, "rubber sheets")
    frame = ibr.render(mesh, camera, background=WHITE, samples=4)
    show(row[2], frame.color, "segmented")
    triangles = mesh.triangulate(camera)
    show(row[3], (255 - (255 - frame.color) * 0.35).astype(np.uint8), f"{len(triangles.faces):,} triangles, 2 px")
    wires(row[3], triangles, camera)
    return figure


def blending() -> Figure:
    """Draw a mesh, three blends of six views with different exposures, and the views that colour each pixel."""
    scene = knot()
    views = [
        ibr.DepthImage((view.color * (exposure / 1.12)).astype(np.uint8), view.depth, view.camera)
        for view, exposure in zip(object_views(scene, 512, projection="perspective"), EXPOSURES, strict=True)
    ]
    camera = seen_from(5.1, -4.7, 6.2)
    meshes = [ibr.DepthMesh(view) for view in views]
    figure, row = plt.subplots(1, 5, figsize=(17.2, 3.6), layout="constrained")
    show(row[0], by_rays(scene, camera), "the mesh")
    for axes, blend in zip(row[1:4], ("nearest", "position", "quality"), strict=True):
        thing = ibr.DepthMeshObject(meshes, blend=blend)
        show(axes, ibr.render(thing, camera, background=WHITE, samples=4).color, f'blend="{blend}"')
    thing = ibr.DepthMeshObject(meshes)
    occupancy = thing.occupancy(camera)
    picture = np.full((*occupancy.shape, 3), 255, np.uint8)
    primaries = np.stack([occupancy >> number & 1 for number in np.flatnonzero(thing.weights(camera))], axis=-1)
    picture[occupancy > 0] = (225 * primaries[occupancy > 0]).astype(np.uint8)
    show(row[4], picture, "occupancy")
    return figure


def unseen() -> Figure:
    """Draw a knot from six depth images, seen from directions between them."""
    thing = ibr.DepthMeshObject(object_views(knot(), 512), blended=6)
    eyes = [(7.5, -5.5, 4), (-6, -6, 6), (-3.5, 7.5, -5), (6, 6, 6)]
    figure, row = plt.subplots(1, 4, figsize=(14, 3.4), layout="constrained")
    for axes, eye in zip(row, eyes, strict=True):
        camera = seen_from(*eye)
        count = sum(len(mesh.triangulate(camera, tolerance=thing.tolerance / 2).faces) for mesh in thing.meshes)
        show(axes, ibr.render(thing, camera, background=WHITE, samples=4).color, f"{count:,} triangles of six views")
    return figure


def stages() -> Figure:
    """Draw the data of a view, the pictures of three views, and the new picture that blends them."""
    views = object_views(knot(), 257)
    camera = seen_from(5.1, -4.7, 6.2)
    thing = ibr.DepthMeshObject(views)
    weights = thing.weights(camera)
    chosen = np.argsort(-weights)[:3]
    figure, grid = plt.subplots(2, 5, figsize=(13, 5.4), layout="constrained")
    _prepared(grid[0], thing.meshes[chosen[0]], camera)
    for axes, number in zip(grid[1], chosen, strict=False):
        mesh = ibr.DepthMesh(views[number], tolerance=thing.tolerance / 2)
        picture = ibr.render(mesh, camera, background=WHITE, samples=4).color
        show(axes, picture, f"view {number}, weight {weights[number]:.2f}")
    frame = ibr.render(thing, camera, background=WHITE, samples=4)
    show(grid[1, 3], _gray(frame.depth), "the nearest depth")
    show(grid[1, 4], frame.color, "blended")
    return figure


def _prepared(row: np.ndarray, mesh: ibr.DepthMesh, camera: ibr.Camera) -> None:
    """Draw a view's depth, errors of vertices, rubber sheets and quality, and its triangles for a camera."""
    view, tree = mesh.view, mesh.tree
    height, width = view.valid.shape
    show(row[0], _gray(view.depth), "a view's depth")
    errors = tree.errors["errors"].to_host()[:height, :width]
    show(row[1], plt.get_cmap("magma_r")(np.log10(np.maximum(errors, 1e-4) / 1e-4) / 5), "error of each vertex")
    upper, lower = tree.drawn_cells()
    drawn = upper & lower & view.valid[1:, 1:]
    sheet = view.valid[1:, 1:] & view.valid[:-1, :-1] & view.valid[1:, :-1] & view.valid[:-1, 1:] & ~(upper & lower)
    picture = np.where(drawn[..., None], (223, 231, 238), 255)
    picture[sheet] = (230, 0, 126)
    show(row[2], picture, "rubber sheets")
    show(row[3], np.where(view.valid, mesh.quality, np.nan), "quality")
    triangles = mesh.triangulate(camera)
    show(row[4], np.full((camera.height, camera.width, 3), 255, np.uint8), f"{len(triangles.faces):,} triangles")
    wires(row[4], triangles, camera)


def _gray(depth: np.ndarray) -> np.ndarray:
    """Return depths as gray on white; the nearest depth is lightest."""
    known = np.isfinite(depth)
    low, high = depth[known].min(), depth[known].max()
    return np.where(known, 235 - 190 * (depth - low) / (high - low), 255)[..., None].repeat(3, axis=2).astype(np.uint8)
