"""Gaussians blended one after the other, in float64 (kernels/gaussians)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr

SHARP, PLANE_SIGMAS = 0.01, 3.5  # as in kernels/gaussians/project.cl
Float64 = NDArray[np.float64]


def harmonics(d: Float64) -> Float64:
    """(N, 16) values of the harmonics of 3D Gaussian Splatting for unit directions (N, 3)."""
    x, y, z = d.T
    xx, yy, zz = x * x, y * y, z * z
    bands = [np.full(len(d), 0.28209479177387814), -0.4886025119029199 * y, 0.4886025119029199 * z]
    bands += [-0.4886025119029199 * x, 1.0925484305920792 * x * y, -1.0925484305920792 * y * z]
    bands += [0.31539156525252005 * (2 * zz - xx - yy), -1.0925484305920792 * x * z, 0.5462742152960396 * (xx - yy)]
    bands += [-0.5900435899266435 * y * (3 * xx - yy), 2.890611442640554 * x * y * z]
    bands += [-0.4570457994644658 * y * (4 * zz - xx - yy), 0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy)]
    bands += [-0.4570457994644658 * x * (4 * zz - xx - yy), 1.445305721320277 * z * (xx - yy)]
    bands += [-0.5900435899266435 * x * (xx - 3 * yy)]
    return np.stack(bands, axis=1)


def axes_of(rotations: Float64) -> Float64:
    """(N, 3, 3) rotations of quaternions (w, x, y, z); the columns are the Gaussians' axes."""
    w, x, y, z = (rotations / np.linalg.norm(rotations, axis=1, keepdims=True)).T
    rows = [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)]
    rows += [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)]
    rows += [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]
    return np.stack(rows, axis=1).reshape(-1, 3, 3)


def projected(cloud: ibr.Gaussians, camera: ibr.Camera) -> list[tuple[float, ...]]:
    """(distance, u, v, covariance uu uv vv, opacity, gradient of nearness, its bounds, colour) of those drawn."""
    K, (width, height), perspective = camera.K, camera.size, camera.projection == "perspective"
    turn, shift = camera.camera_from_world[:3, :3], camera.camera_from_world[:3, 3]
    x, y, z = (cloud.means.astype(np.float64) @ turn.T + shift).T
    half = turn @ axes_of(cloud.rotations.astype(np.float64)) * cloud.scales[:, None].astype(np.float64)
    J, by, nearness = (
        np.zeros((len(cloud), 3, 3)),
        (z if perspective else np.ones(len(z))),
        (1 / z if perspective else -z),
    )
    u, v = (K[0, 0] * x + K[0, 1] * y) / by + K[0, 2], K[1, 1] * y / by + K[1, 2]
    J[:, :2, :2], J[:, 2, 2] = K[:2, :2] / by[:, None, None], -1 / by**2
    if perspective:
        J[:, 0, 2] = (K[0, 2] - np.clip(u, -0.5 - 0.15 * width, 1.15 * width - 0.5)) / z
        J[:, 1, 2] = (K[1, 2] - np.clip(v, -0.5 - 0.15 * height, 1.15 * height - 0.5)) / z
    flat = J @ half @ half.transpose(0, 2, 1) @ J.transpose(0, 2, 1)
    d = cloud.means - camera.world_from_camera[:3, 3] if perspective else np.tile(turn[2], (len(cloud), 1))
    far = np.linalg.norm(d, axis=1)
    basis = harmonics(d / far[:, None])[:, : cloud.sh.shape[1]]
    color = np.maximum((basis[..., None] * cloud.sh.astype(np.float64)).sum(axis=1) + 0.5, 0)
    deep = PLANE_SIGMAS * np.sqrt(flat[:, 2, 2]) * by**2
    ends = z + deep, np.maximum(z - deep, cloud.near)
    slope = np.linalg.solve(flat[:, :2, :2] + SHARP * np.eye(2), flat[:, :2, 2:])[..., 0]
    covariance = (flat[:, :2, :2] + cloud.low_pass * np.eye(2)).reshape(-1, 4)[:, [0, 1, 3]]
    opacities, bounds = cloud.opacities.astype(np.float64), (1 / end if perspective else -end for end in ends)
    if cloud.antialiased:
        before = np.linalg.det(flat[:, :2, :2])
        opacities *= np.sqrt(before / np.linalg.det(covariance[:, [0, 1, 1, 2]].reshape(-1, 2, 2)))
    made = (far if perspective else z, u, v, *covariance.T, opacities, nearness, *slope.T, *bounds, *color.T)
    drawn = (z > cloud.near) & (opacities > 1 / 255)
    return [tuple(one) for one in np.stack(made, axis=1)[drawn]]


def blended(
    clouds: Sequence[ibr.Gaussians],
    camera: ibr.Camera,
    surface: Float64 | None = None,
    behind: Float64 | None = None,
    planes: bool = True,
) -> tuple[Float64, Float64, Float64]:
    """Colour (H, W, 3) from 0 to 1, alpha and depth (H, W) of a picture.

    surface: depth of opaque things, NaN where there are none; behind: their colours, from 0 to 1;
    planes: whether depth is that of the Gaussians' planes, not of their centres.
    """
    shape = camera.height, camera.width
    depth = np.full(shape, np.nan) if surface is None else surface.astype(np.float64)
    perspective = camera.projection == "perspective"
    limit = np.where(np.isnan(depth), -np.inf, 1 / depth if perspective else -depth)
    left, color, median = np.ones(shape), np.zeros((*shape, 3)), np.full(shape, np.nan)
    for one in sorted(one for cloud in clouds for one in projected(cloud, camera)):
        _, u, v, uu, uv, vv, opacity, nearness, gx, gy, least, most, *own = one
        reach = 2 * np.log(255 * opacity)
        rx, ry = np.sqrt(reach * uu), np.sqrt(reach * vv)
        x0, x1 = max(int(np.ceil(u - rx)), 0), min(int(np.floor(u + rx)), camera.width - 1)
        y0, y1 = max(int(np.ceil(v - ry)), 0), min(int(np.floor(v + ry)), camera.height - 1)
        if x0 > x1 or y0 > y1:
            continue
        part = np.s_[y0 : y1 + 1, x0 : x1 + 1]
        dx, dy = np.arange(x0, x1 + 1) - u, (np.arange(y0, y1 + 1) - v)[:, None]
        power = 0.5 * (vv * dx**2 - 2 * uv * dx * dy + uu * dy**2) / (uu * vv - uv**2)
        plane = np.clip(nearness + planes * (gx * dx + gy * dy), least, most)
        a, before = opacity * np.exp(-power), left[part]
        a = np.where((a > 1 / 255) & (before > 1e-4) & (plane > limit[part]), np.minimum(a, 0.99), 0)
        after = before * (1 - a)
        color[part] += (before * a)[..., None] * np.array(own)
        halved = (before > 0.5) & (after <= 0.5)
        median[part] = np.where(halved, plane, median[part])
        left[part] = after
    if behind is not None:
        color += left[..., None] * behind
    alpha = np.where(np.isnan(depth), 1 - left, 1)
    found = 1 / median if perspective else -median
    return np.minimum(color, 1), alpha, np.where(np.isnan(median), depth, found)
