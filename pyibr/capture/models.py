"""Models to try things on: a bumpy torus and a donut, and cameras and texture coordinates for any model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from pyibr.core.camera import Camera
from pyibr.core.checks import instance_of, integer_from, numbers, positive
from pyibr.images import DepthImage
from pyibr.meshes.mesh import Mesh

_UP = np.array([0.0, -1.0, 0.0])


def torus_mesh() -> Mesh:
    """Make a torus of radii 1 and about 0.42 across the diagonal (1, 1, 1), bumpy and striped.

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
    colors = np.rint(colors * (0.45 + 0.55 * dent)).astype(np.uint8)
    number = np.arange(a.size).reshape(a.shape)
    right, down = np.roll(number, -1, axis=1), np.roll(number, -1, axis=0)
    diagonal = np.roll(right, -1, axis=0)
    faces = np.stack([np.stack([number, down, right], -1), np.stack([diagonal, right, down], -1)], axis=2)
    return Mesh(vertices, faces.reshape(-1, 3), colors=colors.reshape(-1, 3))


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
    points = np.concatenate([image.points for image in images])
    center = (points.min(axis=0) + points.max(axis=0)) / 2
    radius = float(np.linalg.norm(points - center, axis=1).max())
    away = numbers("direction", direction, (3,))
    away = away / np.linalg.norm(away)
    up = _UP if abs(away @ _UP) < 0.99 else np.array([0.0, 0.0, 1.0])
    narrow = min(1.0, size[0] / size[1])
    fov = 2 * np.arctan(1.08 * np.tan(np.arcsin(1 / distance)) / narrow)
    return Camera.look_at(center + distance * radius * away, center, up, size, fov_y=float(np.degrees(fov)))
