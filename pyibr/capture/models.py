"""The papers' models: a globe, a torus and a scanned dragon as depth images; a donut as a base for displacement.

After Schaufler and Priglinger, "Efficient Displacement Mapping by Image Warping" (1999), section 7: globe and torus
are displaced from depth images at one centre; sixteen depth images cover the dragon's head. The world axes are a
camera's axes: x right, y down, z forward, so that up is -y. Scanned meshes have +y up and are turned over on loading.
"""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyibr.capture.frusta import load_frusta
from pyibr.capture.globe import globe, in_bytes, load_earth
from pyibr.capture.raycast import MeshScene, cube_cameras, spread_directions
from pyibr.capture.rays import pixel_centers
from pyibr.core.camera import Camera
from pyibr.core.checks import Float64, describe, instance_of, integer_from, numbers, positive
from pyibr.core.errors import ArgumentError
from pyibr.images import DepthImage
from pyibr.meshes.mesh import Mesh
from pyibr.picture.light import light_for

Uint8 = NDArray[np.uint8]

__all__ = [
    "donut",
    "dragon",
    "dragon_head",
    "globe",
    "load_earth",
    "load_scene",
    "torus",
    "torus_from_outside",
    "torus_mesh",
    "view",
    "with_cylindrical_uv",
]

DRAGON_HEAD = Path(__file__).with_name("dragon-head.json")
"""Frusta of `dragon_head`, in the axes of the scan (+y is up)."""

TORUS = Path(__file__).with_name("torus.json")
"""Frusta of `torus_from_outside`."""

_UP = np.array([0.0, -1.0, 0.0])


def torus(size: int, *, layers: Sequence[str] = ("first", "last")) -> list[DepthImage]:
    """Make depth images of a bumpy torus about the origin, seen from the middle of its hole.

    From there a ray meets the tube twice: first its inner wall, last its outer wall. Each layer consists of six
    perspective depth images with one centre (see `cube_cameras`). The torus lies across the cube's diagonal, so that
    each image sees a part of it. Draw the images with `side="both"`: a viewer outside sees the back of the outer wall
    and, through the hole, the front of the inner wall. With `edges="connect"`, the two walls are joined at the rim,
    where a ray just touches the tube.

    Parameters
    ----------
    size : int
        Width and height of each image in pixels, at least 8.
    layers : sequence of "first" and "last"
        ("last",) selects the six images of the outer wall alone.

    Returns
    -------
    list of DepthImage
        Six images for each layer, in the order of `layers`.
    """
    if size < 8:
        raise ArgumentError("size", "at least 8 pixels", describe(size))
    if not layers or any(layer not in ("first", "last") for layer in layers):
        raise ArgumentError("layers", '"first", "last" or both', describe(layers))
    scene = MeshScene.from_mesh(torus_mesh())
    images: dict[str, list[DepthImage]] = {"first": [], "last": []}
    for camera in cube_cameras((0, 0, 0), size):
        first, last = scene.capture(camera, layer="first"), scene.capture(camera, layer="last")
        for layer, image in zip(("first", "last"), _joined_at_rim(first, last), strict=True):
            images[layer].append(image)
    return [image for layer in layers for image in images[layer]]


def torus_from_outside(size: int) -> list[DepthImage]:
    """Make the same torus from six frusta around it, which also see its inner wall.

    `propose_frusta(torus_mesh(), 6)` proposed these frusta; `torus.json` beside this file stores them.

    Parameters
    ----------
    size : int
        Width and height of each image in pixels.

    Returns
    -------
    list of 6 DepthImage
        Draw them with `edges="cut"`.

    Examples
    --------
    >>> from pyibr.capture import models
    >>> len(models.torus_from_outside(32))
    6
    """
    mesh = torus_mesh()
    return [frustum.resized(size).capture(mesh) for frustum in load_frusta(TORUS)[0]]


def torus_mesh() -> Mesh:
    """Make the surface of `torus`: radii 1 and about 0.42 across the diagonal (1, 1, 1), bumpy and striped.

    Returns
    -------
    Mesh
        With 589,824 triangles and colours.

    Examples
    --------
    >>> from pyibr.capture import models
    >>> models.torus_mesh()
    <Mesh 294912 vertices, 589824 triangles>
    """
    a, b = np.meshgrid(np.linspace(0, 2 * np.pi, 768, False), np.linspace(0, 2 * np.pi, 384, False))
    tube = 0.42 + 0.03 * np.sin(9 * a) * np.sin(5 * b) + 0.012 * np.cos(30 * a + 6 * b)
    ring = 1 + tube * np.cos(b)
    local = np.stack([ring * np.cos(a), tube * np.sin(b), ring * np.sin(a)], axis=-1).reshape(-1, 3)
    axis, across = np.ones(3) / np.sqrt(3), np.array([1, -1, 0]) / np.sqrt(2)
    vertices = local @ np.stack([across, axis, np.cross(across, axis)])
    stripe = 0.5 + 0.5 * np.tanh(4 * np.sin(6 * a + 3 * b))
    dent = ((tube - tube.min()) / np.ptp(tube))[..., None]
    colors = stripe[..., None] * np.array([215, 120, 60]) + (1 - stripe[..., None]) * np.array([50, 110, 160])
    number = np.arange(a.size).reshape(a.shape)
    right, down = np.roll(number, -1, axis=1), np.roll(number, -1, axis=0)
    diagonal = np.roll(right, -1, axis=0)
    faces = np.stack([np.stack([number, down, right], -1), np.stack([diagonal, right, down], -1)], axis=2)
    return Mesh(vertices, faces.reshape(-1, 3), colors=in_bytes(colors * (0.45 + 0.55 * dent)).reshape(-1, 3))


def dragon(mesh_path: str | PathLike[str], size: int, *, views: int = 16) -> list[DepthImage]:
    """Make depth images of a mesh from all around it; depth is infinite where there is no surface.

    Parameters
    ----------
    mesh_path : path
        Any file that `Mesh.load` reads; +y is up.
    size : int
        Width and height of each image in pixels.
    views : int
        Number of cameras, spread evenly over a sphere.

    Returns
    -------
    list of DepthImage

    Notes
    -----
    Neighbouring samples often lie on different parts of the surface. Draw the images with `edges="cut"`, the default,
    unless you want the rubber sheets of the paper's figures (`edges="connect"`).
    """
    if views < 1:
        raise ArgumentError("views", "at least 1", describe(views))
    scene = load_scene(mesh_path)
    low, high = scene.vertices.min(axis=0), scene.vertices.max(axis=0)
    center = (low + high) / 2
    radius = float(np.linalg.norm(scene.vertices - center, axis=1).max())
    around = spread_directions(views)
    return [scene.capture(_outside(center, radius, direction, (size, size))) for direction in around]


def dragon_head(mesh_path: str | PathLike[str], size: int) -> list[DepthImage]:
    """Make the sixteen depth images that cover the scanned dragon's head, as in the paper's figures 11 to 13.

    `pyibr place --auto 16 --within ...` proposed the frusta; other parts of the dragon in their images were painted
    empty by hand. `dragon-head.json` beside this file stores them, and `pyibr place --frusta` opens it, too.

    Parameters
    ----------
    mesh_path : path
        The Stanford dragon as scanned (`dragon_vrip.ply`, or a version with fewer triangles), also with `.gz`.
    size : int
        Width and height of each image in pixels.

    Returns
    -------
    list of DepthImage
        Lit from above. Draw the images with `edges="cut"`, like the images of `dragon`.
    """
    scanned = Mesh.load(mesh_path)
    light, turned = light_for(scanned, (0, 1, 0)), np.diag([1.0, -1.0, -1.0, 1.0])
    images = [frustum.resized(size).capture(scanned, light) for frustum in load_frusta(DRAGON_HEAD)[0]]
    cameras = [Camera(one.camera.K, one.camera.size, turned @ one.camera.world_from_camera) for one in images]
    return [DepthImage(one.color, one.depth, at, far=one.far) for one, at in zip(images, cameras, strict=True)]


def donut(sides: int = 25, *, radius: float = 1.0, tube: float = 0.4) -> Mesh:
    """Make a donut of sides x sides quadrilaterals about the z axis, the base mesh that Kautz and Seidel (2001)
    displace.

    Parameters
    ----------
    sides : int
        At least 3. The paper's donut has 25: 625 polygons, two triangles each.
    radius, tube : float
        Radii of the middle line and of the cross section, in scene units.

    Returns
    -------
    Mesh
        With exact normals; u runs around the axis, v around the tube, both from 0 to 1.

    Examples
    --------
    >>> from pyibr.capture import models
    >>> models.donut()
    <Mesh 676 vertices, 1250 triangles>
    """
    integer_from("sides", sides, 3, 1 << 14)
    positive("radius", radius)
    positive("tube", tube)
    a, b = np.meshgrid(*[np.arange(sides + 1) * (2 * np.pi / sides)] * 2)
    outwards = np.stack([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)], axis=-1)
    middle = np.stack([np.cos(a), np.sin(a), 0 * a], axis=-1)
    y, x = np.mgrid[:sides, :sides]
    i = (y * (sides + 1) + x).ravel()
    lower, upper = np.stack([i, i + 1, i + sides + 2], 1), np.stack([i, i + sides + 2, i + sides + 1], 1)
    return Mesh(
        (radius * middle + tube * outwards).reshape(-1, 3),
        np.concatenate([lower, upper]),
        uv=np.stack([a, b], axis=-1).reshape(-1, 2) / (2 * np.pi),
        normals=outwards.reshape(-1, 3),
    )


def with_cylindrical_uv(mesh: Mesh, *, axis: int = 1) -> Mesh:
    """Give a mesh cylindrical uv, as for a wrapped label: u is the angle about its middle axis, v runs along it.

    Parameters
    ----------
    mesh : Mesh
    axis : 0, 1 or 2
        x, y or z; v runs against the axis, from 0 at the top to 1.

    Returns
    -------
    Mesh
        The same surface and normals; vertices are split along the seam.

    Examples
    --------
    >>> from pyibr.capture import models
    >>> tube = models.with_cylindrical_uv(models.donut(), axis=2)
    >>> tube.uv.shape == (len(tube.vertices), 2)
    True
    """
    instance_of("mesh", mesh, Mesh, "a pyibr.Mesh")
    integer_from("axis", axis, 0, 2, "0, 1 or 2")
    low, high = (corner.astype(np.float64) for corner in mesh.bounds)
    away = mesh.vertices - 0.5 * (low + high)
    angle = np.arctan2(away[:, (axis + 1) % 3], away[:, (axis + 2) % 3]) / (2 * np.pi)
    down = (high[axis] - mesh.vertices[:, axis]) / max(high[axis] - low[axis], 1e-30)
    u = angle[mesh.faces]
    u += np.where(u.max(axis=1, keepdims=True) - u > 0.5, 1.0, 0.0)  # across the seam
    normals = mesh.normals if mesh.normals is not None else mesh.smooth_normals
    return Mesh(
        mesh.vertices,
        mesh.faces,
        uv=np.stack([u, down[mesh.faces]], axis=-1),
        normals=normals,
        texture=None,
        colors=mesh.colors,
    )


def view(
    images: Sequence[DepthImage],
    size: tuple[int, int],
    *,
    direction: ArrayLike = (0.45, -0.4, -1.0),
    distance: float = 3.0,
) -> Camera:
    """Make a camera that sees all of a model from outside.

    Parameters
    ----------
    images : sequence of DepthImage
        The model.
    size : (width, height)
    direction : array_like (3,)
        Direction from the model to the camera.
    distance : float
        Distance of the camera from the middle of the model, in radii of the sphere around the model.
    """
    points: list[Float64] = []
    for image in images:
        points.append(
            image.camera.unproject(pixel_centers(image.camera)[image.valid.ravel()], image.depth[image.valid])
        )
    every = np.concatenate(points)
    center = (every.min(axis=0) + every.max(axis=0)) / 2
    radius = float(np.linalg.norm(every - center, axis=1).max())
    return _outside(center, radius, numbers("direction", direction, (3,)), size, distance)


def load_scene(mesh_path: str | PathLike[str]) -> MeshScene:
    """Read a mesh file, also with `.gz`, as a `MeshScene`; up in the file (+y) becomes up here (-y)."""
    read, turn = Mesh.load(mesh_path), np.array([1.0, -1.0, -1.0])
    normals = None if read.normals is None else read.normals * turn
    turned = Mesh(
        read.vertices * turn, read.faces, uv=read.uv, normals=normals, texture=read.texture, colors=read.colors
    )
    return MeshScene.from_mesh(turned)


def _outside(
    center: Float64, radius: float, direction: Float64, size: tuple[int, int], distance: float = 3.0
) -> Camera:
    """Camera whose picture contains a sphere."""
    away = direction / np.linalg.norm(direction)
    up = _UP if abs(away @ _UP) < 0.99 else np.array([0.0, 0.0, 1.0])
    narrow = min(1.0, size[0] / size[1])
    fov = 2 * np.arctan(1.08 * np.tan(np.arcsin(1 / distance)) / narrow)
    return Camera.look_at(center + distance * radius * away, center, up, size, fov_y=float(np.degrees(fov)))


def _joined_at_rim(first: DepthImage, last: DepthImage) -> tuple[DepthImage, DepthImage]:
    """Close the gap of one pixel between the two walls of a solid, at the rim where rays stop hitting it.

    In both images, a missed pixel next to a hit pixel gets the mean of its neighbours' points midway between the walls.
    Otherwise both walls would end before the rim, where a ray touches the solid and the walls meet.
    """
    near, far = np.pad(first.depth, 1, constant_values=np.inf), np.pad(last.depth, 1, constant_values=np.inf)
    colors = [np.pad(image.color, ((1, 1), (1, 1), (0, 0))).astype(np.float64) for image in (first, last)]
    height, width = first.depth.shape
    count, middle = np.zeros((height, width)), np.zeros((height, width))
    mixed = np.zeros((height, width, 3))
    for dy in range(3):
        for dx in range(3):
            there = np.s_[dy : dy + height, dx : dx + width]
            hit = np.isfinite(near[there])
            count += hit
            middle[hit] += (near[there][hit] + far[there][hit]) / 2
            mixed[hit] += (colors[0][there][hit] + colors[1][there][hit]) / 2
    rim = ~first.valid & (count > 0)
    joined: list[DepthImage] = []
    for image in (first, last):
        depth, color = image.depth.copy(), np.array(image.color, np.uint8)
        depth[rim] = (middle[rim] / count[rim]).astype(np.float32)
        color[rim] = in_bytes(mixed[rim] / count[rim][:, None])
        joined.append(DepthImage(color, depth, image.camera))
    return joined[0], joined[1]
