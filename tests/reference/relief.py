"""Relief mapping in float64: a readable reference.

Each pixel's ray enters the relief at every triangle that it meets from the front. Below each of these triangles, the
relief is searched for along the ray. Its depth is measured from a quadric. The nearest hit is visible. If a search
finds nothing, it goes on to the next triangle that the ray meets from behind; depth is then below the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

import pyibr as ibr
from pyibr.core.camera import Camera
from pyibr.relief.quadrics import VertexFrames
from tests.embree import rays_of
from tests.reference.heights import bilinear_height

STEEPEST = 1e-3  # least cosine of the angle between an entering ray and the reversed, interpolated normal


@dataclass
class Rays:
    """n rays below a surface, each in the tangent frame of its entry point; t is the distance from that point."""

    uv: np.ndarray  # (n, 2) at the entry point
    duv: np.ndarray  # (n, 2) change of uv per t
    V: np.ndarray  # (n, 3) unit directions; x is along the gradient of u, z along the normal, y across both
    a: np.ndarray  # (n,) coefficients of the quadric z = a x^2 + b y^2 + c x y
    b: np.ndarray
    c: np.ndarray
    scale: float

    def some(self, which: np.ndarray) -> Rays:
        """Select rays."""
        each = (self.uv, self.duv, self.V, self.a, self.b, self.c)
        return Rays(*(values[which] for values in each), self.scale)

    def approximate(self, t: np.ndarray) -> np.ndarray:
        """Equation 7: depth of the point P = t V below the quadric, measured along z; 1 is the bottom."""
        x, y, z = (self.V * t[:, None]).T
        return -(z - (self.a * x**2 + self.b * y**2 + self.c * x * y)) / self.scale

    def perpendicular(self, t: np.ndarray) -> np.ndarray:
        """Equation 6: distance s for which R = P + s U lies on the quadric; equation 7 where there is no solution."""
        V, P = self.V, self.V * t[:, None]
        U = np.array([0.0, 0, 1]) - V[:, 2:] * V  # perpendicular to V, in the plane of V and the normal
        U /= np.linalg.norm(U, axis=1, keepdims=True)
        a, b, c = self.a, self.b, self.c
        (x, y, z), (px, py, pz) = U.T, P.T
        A = a * x**2 + b * y**2 + c * x * y
        B = 2 * a * px * x + 2 * b * py * y + c * (px * y + py * x) - z
        C = a * px**2 + b * py**2 + c * px * py - pz
        discriminant = B**2 - 4 * A * C
        with np.errstate(invalid="ignore", divide="ignore"):
            s = 2 * C / (-B + np.sqrt(discriminant))  # the root nearest to P; valid for A = 0, too
        return np.where((discriminant >= 0) & (s >= 0), s / self.scale, self.approximate(t))

    def ends(self, distance: str) -> tuple[np.ndarray, np.ndarray]:
        """Return t_max, at which rays leave the relief's layer, and whether they leave by its bottom (section 3.3)."""
        L = -self.V[:, 2] / self.scale
        x, y, _ = self.V.T
        K = (self.a * x**2 + self.b * y**2 + self.c * x * y) / self.scale
        with np.errstate(invalid="ignore", divide="ignore"):
            bottom, out = 2 / (L + np.sqrt(L**2 + 4 * K)), -L / K
        at_bottom = L**2 + 4 * K >= 0
        if distance == "approximate":
            return np.where(at_bottom, bottom, out), at_bottom
        depth = getattr(self, distance)
        # Take 64 steps up to the end by equation 7, find the first below the bottom, then halve its interval.
        far = np.where(K < 0, out, 4 * np.where(at_bottom, bottom, 0))
        after, reaches = far.copy(), np.zeros(len(far), bool)
        for i in range(1, 65):
            now = ~reaches & (depth(far * i / 64) >= 1)
            after, reaches = np.where(now, far * i / 64, after), reaches | now
        before = after - far / 64
        for _ in range(30):
            middle = 0.5 * (before + after)
            below = depth(middle) >= 1
            before, after = np.where(below, before, middle), np.where(below, middle, after)
        return np.where(reaches, after, np.where(K < 0, out, bottom)), reaches | (at_bottom & (K >= 0))

    def following_mesh(self, way: np.ndarray, slope: np.ndarray) -> tuple[Rays, np.ndarray, np.ndarray]:
        """Return rays whose equation 7 gives a parabola, and the t and the depth at which the parabola ends.

        A cubic of t approximates depth below the mesh: it is 0 where the ray enters and leaves, and has the slopes of
        the ray there. The parabola starts no steeper than the ray enters, and ends where the cubic first reaches the
        bottom or, if it never does, where it is deepest.
        """
        leaves, L = np.maximum(slope, 0) / self.scale, -self.V[:, 2] / self.scale
        part = np.arange(17)[:, None] / 16
        arc = way * part * (1 - part) * (L * (1 - part) + leaves * part)
        reaches = (arc >= 1).any(axis=0)
        i, n = np.where(reaches, (arc >= 1).argmax(axis=0), arc.argmax(axis=0)), np.arange(len(way))
        last, now = arc[np.maximum(i - 1, 0), n], arc[i, n]
        t = way / 16 * np.where(reaches, i - 1 + (1 - last) / np.where(reaches, now - last, 1), i)
        depth = np.minimum(now, 1)
        safe = np.maximum(t, 1e-300)
        rise = np.minimum(L, 2 * 1.001 * depth / safe)
        even = (1.001 * depth / safe - rise) / safe * self.scale / np.maximum(1 - self.V[:, 2] ** 2, 1e-300)
        V = np.column_stack([self.V[:, :2], -rise * self.scale])
        return replace(self, V=V, a=even, b=even, c=0 * even), t, depth


def searched(
    rays: Rays, height: np.ndarray, distance: str, steps: int, halvings: int, longest: np.ndarray | float = np.inf
) -> np.ndarray:
    """Return t, (n,), at which rays meet the relief, by steps and then halvings; inf where they miss it."""
    depth = getattr(rays, distance)
    end, at_bottom = rays.ends(distance)
    at_bottom = at_bottom & (end <= longest)
    end = np.minimum(end, longest)

    def below(t: np.ndarray) -> np.ndarray:
        u, v = (rays.uv + rays.duv * t[:, None]).T
        return depth(t) >= 1 - bilinear_height(height, u, v)

    met, going = end.copy(), np.ones(len(end), bool)
    for i in range(1, steps + 1):
        hits = going & below(end * i / steps)
        met = np.where(hits, end * i / steps, met)
        going &= ~hits
    before, after = met - end / steps, met.copy()
    for _ in range(halvings):
        middle = 0.5 * (before + after)
        hits = below(middle)
        before, after = np.where(hits, before, middle), np.where(hits, middle, after)
    return np.where(going, np.where(at_bottom, end, np.inf), after)


def relief_depth(
    base: ibr.Mesh,
    frames: VertexFrames,
    height: np.ndarray,
    scale: float,
    tiles: tuple[int, int],
    camera: Camera,
    distance: str = "approximate",
    steps: int = 32,
    halvings: int = 6,
) -> np.ndarray:
    """Planar depth (H, W) of a relief in a camera's picture; inf where the picture is empty."""
    origin, ray = np.split(rays_of(camera), 2, axis=1)
    length = np.linalg.norm(ray, axis=1)
    unit = ray / length[:, None]
    found = np.full(len(ray), np.inf)
    uv = np.asarray(base.uv, float) * tiles
    places = [_crossing(np.asarray(base.vertices[face], float), origin, ray) for face in base.faces]
    leaves, left_by, weights_there = _exits(places, len(ray))
    for face, (met, fronts, depth, weights) in zip(base.faces, places, strict=True):
        enters = met[fronts]
        if not len(enters):
            continue
        rays = _entered(weights[fronts], face, uv, frames, unit[enters], scale)
        t = searched(rays, height, distance, steps, halvings)
        found[enters] = np.minimum(found[enters], depth[fronts] + t / length[enters])
        leaving = np.array([(leaves[p] > d).any() for p, d in zip(enters, depth[fronts], strict=True)])
        lost = np.flatnonzero(~np.isfinite(t) & leaving)
        if not len(lost):
            continue
        pixel, at = enters[lost], depth[fronts][lost]
        following = [np.searchsorted(leaves[p], d, side="right") for p, d in zip(pixel, at, strict=True)]
        corners = base.faces[[left_by[p][i] for p, i in zip(pixel, following, strict=True)]]
        shares = np.array([weights_there[p][i] for p, i in zip(pixel, following, strict=True)])
        normals = np.einsum("nk,nkc->nc", shares, frames.normals[corners])
        slope = (unit[pixel] * normals).sum(axis=1) / np.linalg.norm(normals, axis=1)
        way = (np.array([leaves[p][i] for p, i in zip(pixel, following, strict=True)]) - at) * length[pixel]
        quadric = rays.some(lost)
        mesh, deepest, depth_there = quadric.following_mesh(way, slope)
        deeper = (deepest > 0) & (depth_there > getattr(quadric, distance)(deepest))
        t = np.where(deeper, searched(mesh, height, "approximate", steps, halvings, way), np.inf)
        found[pixel] = np.minimum(found[pixel], at + t / length[pixel])
    return found.reshape(camera.height, camera.width)


def _crossing(
    corners: np.ndarray, origin: np.ndarray, ray: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Intersect rays with a triangle.

    Returns the indices of rays that meet it, which of these meet it from the front, their depths and weights.
    """
    side, other = corners[1] - corners[0], corners[2] - corners[0]
    normal = np.cross(side, other)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = ((corners[0] - origin) @ normal) / (ray @ normal)
        point = origin + depth[:, None] * ray - corners[0]
        second = np.cross(point, other) @ normal / (normal @ normal)
        third = np.cross(side, point) @ normal / (normal @ normal)
    weights = np.column_stack([1 - second - third, second, third])
    met = np.flatnonzero((weights >= 0).all(axis=1) & (ray @ normal != 0) & (depth > 0))
    return met, (ray @ normal)[met] < 0, depth[met], weights[met]


def _exits(places: list[tuple[np.ndarray, ...]], count: int) -> tuple[list[np.ndarray], ...]:
    """For each ray, the depths at which it leaves the mesh, in order, with the triangles and their weights there."""
    backs = [~fronts for _, fronts, _, _ in places]
    pixel = np.concatenate([met[back] for (met, _, _, _), back in zip(places, backs, strict=True)])
    depth = np.concatenate([at[back] for (_, _, at, _), back in zip(places, backs, strict=True)])
    weights = np.concatenate([w[back] for (_, _, _, w), back in zip(places, backs, strict=True)])
    triangle = np.repeat(np.arange(len(places)), [back.sum() for back in backs])
    order = np.lexsort([depth, pixel])
    starts = np.searchsorted(pixel[order], np.arange(1, count))
    return tuple(np.split(values[order], starts) for values in (depth, triangle, weights))


def _entered(
    weights: np.ndarray, face: np.ndarray, uv: np.ndarray, frames: VertexFrames, d: np.ndarray, scale: float
) -> Rays:
    """Return rays in the tangent frames of their entry points, interpolated between a triangle's corners."""
    normal = weights @ frames.normals[face]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    gradients = np.einsum("nk,kic->nic", weights, frames.gradients[face])
    a, b, c = (weights @ frames.quadrics[face]).T
    duv = np.einsum("nic,nc->ni", gradients, d)
    cosine = (d * normal).sum(axis=1)
    x_axis = gradients[:, 0] / np.linalg.norm(gradients[:, 0], axis=1, keepdims=True)
    x, y = ((d * axis).sum(axis=1) for axis in (x_axis, np.cross(normal, x_axis)))
    return Rays(weights @ uv[face], duv, np.column_stack([x, y, np.minimum(cosine, -STEEPEST)]), a, b, c, scale)
