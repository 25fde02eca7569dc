"""Restricted quadtree of a depth image in float64, a readable reference (Pajarola, Sainz & Meng 2003, section 3).

The tree consists of right-angled triangles. Each has its right angle at `apex`, and is split in two at `split`, the
middle of its longest side. These middles are the tree's vertices. A vertex's children are the splits of the triangles
that its own split makes. The tree covers a square, which may be larger than the image: vertices outside of the image
are moved to its last column or row.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np

from pyibr.core.camera import Camera
from pyibr.depthmesh import Segmentation
from pyibr.images import DepthImage

Corner = tuple[int, int]  # x, y

UNDRAWN, DRAWN = 1, 2
MARGIN = 0.01  # samples by which a vertex's bounding sphere reaches beyond its children's spheres
ROUNDING = 2**-22  # fraction of the sum of three points' depths: smaller errors of the middle point count as 0
NEAREST = 1e-15  # scene units: distance that a camera inside a sphere is taken to have
# UNSEEN: deviations of noise that errors may have without counting. REACH: deviations within which the mean of two
# opposite samples is averaged with the sample between them. RADIUS: samples around a sample that are averaged.
UNSEEN, REACH, RADIUS = 0.75, 4.5, 3
LOSS = 4.0  # error of a partly drawn triangle, as a multiple of its longest side


@dataclass(frozen=True)
class Triangle:
    start: Corner
    end: Corner
    apex: Corner

    @property
    def is_leaf(self) -> bool:
        """True if the triangle is half of a cell."""
        return abs(self.end[0] - self.start[0]) == 1

    @property
    def split(self) -> Corner:
        return (self.start[0] + self.end[0]) // 2, (self.start[1] + self.end[1]) // 2

    @property
    def halves(self) -> tuple[Triangle, Triangle]:
        return Triangle(self.apex, self.start, self.split), Triangle(self.end, self.apex, self.split)

    @property
    def is_a(self) -> bool:
        """True if the apex is above the longest side, or left of it."""
        (x, y), apex = np.add(self.start, self.end) / 2, self.apex
        return apex[1] < y or (apex[1] == y and apex[0] < x)

    @property
    def corners(self) -> tuple[Corner, Corner, Corner]:
        return self.start, self.apex, self.end


def halves_of_cell(x: int, y: int) -> list[list[Corner]]:
    """Corners of the two triangles of the cell whose upper left sample is (x, y)."""
    four = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)]
    skip = (2, 1) if (x + y) % 2 == 0 else (3, 0)  # indices of the corners that the two triangles lack
    return [[corner for k, corner in enumerate(four) if k != other] for other in skip]


@dataclass
class Vertex:
    sides: list[Triangle] = field(default_factory=list)
    own: float = 0.0
    below: float = 0.0
    error: float = -1.0
    radius: float = 0.0
    depth: float = 0.0
    states: dict[Triangle, int] = field(default_factory=dict)

    @property
    def children(self) -> list[Corner]:
        """Children in a fixed order: row by row, or above, right, below and left of a centre.

        A vertex without a sample gets the depth of the first child that has one.
        """
        found = {half.split for side in self.sides for half in side.halves if not half.is_leaf}
        ordered = sorted(found, key=lambda corner: corner[::-1])
        around = len(ordered) == 4 and ordered[1][1] == ordered[2][1]
        return [ordered[k] for k in (0, 2, 3, 1)] if around else ordered


class Tree:
    """The tree over a view's samples.

    `cells`: (H, W) states of each cell's two triangles; bits 0 and 1 hold the state of triangle A, the upper one. The
    error of a vertex is a bound for the surface without it and its descendants: the smaller of two sums, its own error
    plus the largest error of its children, or, for the worst child, the larger of both own errors plus the largest
    error of that child's children. With `largest` it is the largest of all own errors, as in the paper. Own errors are
    measured between drawn vertices of denoised samples.
    """

    def __init__(self, view: DepthImage, cells: np.ndarray, largest: bool = False) -> None:
        self.view, self.cells, self.largest = view, cells, largest
        self.depth = smoothed(view)
        self.ray_from_pixel = np.linalg.inv(view.camera.K)
        side = 1
        while side < max(view.camera.size) - 1:
            side *= 2
        first, last = (0, 0), (side, side)
        self.roots = Triangle(first, last, (side, 0)), Triangle(last, first, (0, side))
        self.vertices: defaultdict[Corner, Vertex] = defaultdict(Vertex)
        level = list(self.roots)
        levels: list[set[Corner]] = []
        while level and not level[0].is_leaf:
            for triangle in level:
                self.vertices[triangle.split].sides.append(triangle)
            levels.append({triangle.split for triangle in level})
            level = list(chain.from_iterable(triangle.halves for triangle in level))
        self.fine_to_coarse = list(chain.from_iterable(reversed(levels)))
        self.parents: defaultdict[Corner, list[Corner]] = defaultdict(list)
        for corner in self.fine_to_coarse:
            self._fill(corner, self.vertices[corner])
            for child in self.vertices[corner].children:
                self.parents[child].append(corner)

    def sample(self, corner: Corner) -> Corner:
        width, height = self.view.camera.size
        return min(corner[0], width - 1), min(corner[1], height - 1)

    def is_squeezed(self, corner: Corner) -> bool:
        """Tell whether a vertex is the centre of a block that is moved to the border, off the diagonal it bisects."""
        side = self.vertices[corner].sides[0]
        is_center = side.start[0] != side.end[0] and side.start[1] != side.end[1]
        return is_center and any(self.sample(end) != end for end in (side.start, side.end, side.apex))

    def is_sample(self, corner: Corner) -> bool:
        x, y = self.sample(corner)
        return bool(self.view.valid[y, x])

    def place(self, corner: Corner, z: float | None = None) -> np.ndarray:
        """Position in the camera's frame, at depth z or, by default, at the sample's denoised depth."""
        x, y = self.sample(corner)
        z = float(self.depth[y, x]) if z is None else z
        return self._point(x, y, z)

    def _point(self, x: float, y: float, z: float) -> np.ndarray:
        ray = self.ray_from_pixel @ (x, y, 1.0)
        return ray * z if self.view.camera.projection == "perspective" else np.array([ray[0], ray[1], z])

    def inverse(self, value: Any) -> Any:
        """Nearness at a depth, or depth at a nearness."""
        return 1 / value if self.view.camera.projection == "perspective" else -value

    @cached_property
    def joined(self) -> set[tuple[Corner, Corner]]:
        """Pairs of samples, in both orders, that are joined by an edge of a drawn triangle of the full grid."""
        found: set[tuple[Corner, Corner]] = set()
        for y, x in np.argwhere(self.cells[:-1, :-1]).tolist():
            for side, corners in enumerate(halves_of_cell(x, y)):
                if self.cells[y, x] >> 2 * side & 3 == DRAWN:
                    found |= {(a, b) for a in corners for b in corners}
        return found

    def drawn_at(self, corner: Corner, depth: np.ndarray | None = None) -> np.ndarray:
        """Place where a vertex is drawn, (3,): pixel x and y, and nearness; for border samples, half a pixel outside.

        The nearness continues the line from inside through the border sample.
        """
        x, y = corner = self.sample(corner)
        width, height = self.view.camera.size
        depth = self.view.depth if depth is None else depth
        nearness = self.inverse(float(depth[y, x]))
        dx, dy = (int(at == 0) - int(at == count - 1) for at, count in ((x, width), (y, height)))
        place, within, found = (x - 0.5 * dx, y - 0.5 * dy), (x + dx, y + dy), nearness
        if (dx or dy) and (corner, within) in self.joined:
            found = nearness + 0.5 * (nearness - self.inverse(float(depth[within[::-1]])))
        elif dx and dy and (corner, (x + dx, y)) in self.joined:  # image corner without a diagonal edge
            plane = np.array([(x, y, nearness), *(self.drawn_at(at, depth) for at in ((x + dx, y), (x, y + dy)))])
            rows = np.column_stack([plane[:, :2], np.ones(3)])
            found = float(np.linalg.solve(rows, plane[:, 2]) @ (*place, 1.0))
        least, most = sorted((0.5 * nearness, 1.5 * nearness))
        return np.array([*place, min(max(found, least), most)])

    def drawn_place(self, corner: Corner, depth: np.ndarray | None = None) -> np.ndarray:
        """Position in the camera's frame at which the vertex is drawn."""
        x, y, n = self.drawn_at(corner, depth)
        return self._point(x, y, self.inverse(n))

    def state(self, triangle: Triangle) -> int:
        """Return a triangle's state: DRAWN, UNDRAWN, both (3) if it is partly drawn, or 0 outside of the image."""
        if not triangle.is_leaf:
            return self.vertices[triangle.split].states[triangle]
        x, y = np.min(triangle.corners, axis=0)
        if x >= self.view.camera.width - 1 or y >= self.view.camera.height - 1:
            return 0
        return int(self.cells[y, x] if triangle.is_a else self.cells[y, x] >> 2) & 3

    def _fill(self, corner: Corner, vertex: Vertex) -> None:
        for side in vertex.sides:
            vertex.states[side] = self.state(side.halves[0]) | self.state(side.halves[1])
        if self.is_squeezed(corner):  # moved to the border, a cell may leave its half of the block
            vertex.states = dict.fromkeys(vertex.sides, vertex.states[vertex.sides[0]] | vertex.states[vertex.sides[1]])
        low = np.min([side.corners for side in vertex.sides], axis=(0, 1))
        if (low >= np.subtract(self.view.camera.size, 1)).any():
            return  # no triangle of the vertex reaches the image
        children = {child: self.vertices[child] for child in vertex.children}
        below = max([-1.0, *(child.error for child in children.values())])
        known = [child.depth for child in children.values() if child.error >= 0]
        vertex.depth = (
            float(self.drawn_place(corner, self.depth)[2]) if self.is_sample(corner) else next(iter(known), 0.0)
        )
        vertex.error, vertex.below = below, max(below, 0.0)
        if any(state & DRAWN for state in vertex.states.values()):
            noise = float(np.polyval(self.view.noise, vertex.depth))
            vertex.own = max(self.own_error(corner) - UNSEEN * noise, 0.0)
            in_pairs = max([vertex.own, *(max(vertex.own, child.own) + child.below for child in children.values())])
            vertex.error = max(below, vertex.own if self.largest else min(vertex.own + max(below, 0.0), in_pairs))
            if UNDRAWN | DRAWN in vertex.states.values():
                vertex.error = max(vertex.error, LOSS * self.length(corner))
        if not vertex.children and self.is_sample(corner):
            ends = [end for triangle in vertex.sides for end in triangle.corners if self.is_sample(end)] + [corner]
            center = self.place(corner, vertex.depth)
            vertex.radius = max(float(np.linalg.norm(self.drawn_place(end) - center)) for end in ends)
        for place, child in children.items():
            if child.error >= 0:
                away = np.linalg.norm(self.place(place, child.depth) - self.place(corner, vertex.depth))
                reach = float(away) + child.radius + MARGIN * self.sample_size(corner)
                vertex.radius = max(vertex.radius, reach)

    def own_error(self, corner: Corner) -> float:
        """Error of a vertex: its distance from the edge that it bisects.

        It is the distance of equation 2 for centres of blocks. For other vertices, equation 1, it is measured in the
        plane of the edge's axis, x or y, and z. For blocks at the border, whose centres may lie off their diagonals, it
        is the larger distance from the planes of the triangles on both sides.
        """
        sides = self.vertices[corner].sides
        start, end = sides[0].start, sides[0].end
        if not (self.is_sample(start) and self.is_sample(end) and self.is_sample(corner)):
            return 0.0
        a, b, p = (self.drawn_place(at, self.depth) for at in (start, end, corner))
        corners = np.array([self.sample(at) for side in sides for at in side.corners])
        at_border = (corners == 0) | (corners == np.subtract(self.view.camera.size, 1))
        if at_border.any() and start[0] != end[0] and start[1] != end[1]:
            planes = [
                np.cross(b - a, self.drawn_place(side.apex, self.depth) - a)
                for side in sides
                if self.is_sample(side.apex)
            ]
            off = max([0.0, *(float(abs((p - a) @ normal) / np.linalg.norm(normal)) for normal in planes)])
            return off if off > 2 * ROUNDING * (abs(a[-1]) + abs(b[-1]) + abs(p[-1])) else 0.0
        if start[0] == end[0] or start[1] == end[1]:
            a, b, p = (np.delete(point, 1 if start[1] == end[1] else 0) for point in (a, b, p))
        along = (b - a) / np.linalg.norm(b - a)
        off = float(np.linalg.norm((p - a) - ((p - a) @ along) * along))
        return off if off > ROUNDING * (abs(a[-1]) + abs(b[-1]) + abs(p[-1])) else 0.0

    def drawn_at_pixel(self, corner: Corner) -> np.ndarray:
        x, y = self.sample(corner)
        beyond = [0.5 * (int(at == n - 1) - int(at == 0)) for at, n in zip((x, y), self.view.camera.size, strict=True)]
        return np.array([x + beyond[0], y + beyond[1]])

    def samples_within(self, triangle: Triangle) -> list[Corner]:
        x, y = np.meshgrid(*map(np.arange, self.view.camera.size))
        corners = np.column_stack([[self.drawn_at_pixel(corner) for corner in triangle.corners], np.ones(3)])
        weight = np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(corners)
        rows, columns = np.nonzero((weight > -1e-9).all(axis=-1))
        return list(zip(columns.tolist(), rows.tolist(), strict=True))

    def length(self, corner: Corner) -> float:
        """Length of the edge that a vertex bisects, as if the edge were parallel to the image."""
        side = self.vertices[corner].sides[0]
        return float(np.linalg.norm(np.subtract(side.end, side.start))) * self.sample_size(corner)

    def sample_size(self, corner: Corner) -> float:
        """Distance between samples, in scene units, at the depth of a vertex."""
        camera = self.view.camera
        scale = self.vertices[corner].depth if camera.projection == "perspective" else 1.0
        return scale / min(camera.K[0, 0], camera.K[1, 1])

    def needed(self, camera: Camera, tolerance: float) -> set[Corner]:
        """Vertices within a camera's view whose error in pixels, at their sphere's nearest point, reaches `tolerance`.

        This is equation 5, with the stretch of the picture at the sphere's largest angle from the axis.
        """
        found: set[Corner] = set()
        there = self.view.camera.world_from_camera
        for corner, vertex in self.vertices.items():
            if vertex.error < 0:
                continue
            center = there[:3, :3] @ self.place(corner, vertex.depth) + there[:3, 3]
            distance = 1.0
            if camera.projection == "perspective":
                distance = max(float(np.linalg.norm(center - camera.center)) - vertex.radius, NEAREST)
            seen = (outside(camera, center) <= vertex.radius).all()
            pixels = vertex.error * np.linalg.norm(camera.K[:2, :2], 2) * stretch(camera, center, vertex.radius)
            if seen and pixels >= tolerance * distance:
                found.add(corner)
        return found

    def simplified(self, max_error: float) -> set[Corner]:
        """Vertices whose triangles must be split: unsplit, their depth is off by over `max_error` at some sample.

        The search begins with the coarsest triangles. A split requires the splits at all its parents.
        """
        found: set[Corner] = set()
        while True:
            wanted = set()
            for triangle in self.left(found):
                state = 0 if triangle.is_leaf else self.state(triangle)
                if state == UNDRAWN | DRAWN or (state == DRAWN and self.departure(triangle) > max_error):
                    wanted.add(triangle.split)
            if not wanted:
                return found
            while wanted:
                found |= wanted
                wanted = {parent for corner in wanted for parent in self.parents[corner]} - found

    def departure(self, triangle: Triangle) -> float:
        """Largest difference in depth between the samples in a triangle and the triangle as it is drawn."""
        drawn = np.array([self.drawn_at(c) for c in triangle.corners])
        inside = np.array(self.samples_within(triangle))
        weight = np.column_stack([inside, np.ones(len(inside))]) @ np.linalg.inv(
            np.column_stack([drawn[:, :2], np.ones(3)])
        )
        plane = weight @ drawn[:, 2]
        depth = self.view.depth.astype(np.float64)[inside[:, 1], inside[:, 0]]
        return float(np.abs(self.inverse(plane) - depth).max())

    def left(self, active: set[Corner]) -> Iterator[Triangle]:
        """Triangles that remain after splitting, from the roots down, every triangle whose split is active."""
        below = list(self.roots)
        while below:
            triangle = below.pop()
            if not triangle.is_leaf and triangle.split in active:
                below += triangle.halves
            else:
                yield triangle

    def triangles(self, active: set[Corner]) -> Iterator[tuple[Corner, Corner, Corner]]:
        """Corners, as samples, of the remaining triangles that are drawn."""
        for triangle in self.left(active):
            if self.state(triangle) == DRAWN:
                start, apex, end = map(self.sample, triangle.corners)
                yield start, apex, end


def outside(camera: Camera, point: np.ndarray) -> np.ndarray:
    """(5,) distances by which a point lies outside of a frustum's four sides and behind the camera's plane z = 0."""
    here = camera.camera_from_world[:3, :3] @ point + camera.camera_from_world[:3, 3]
    one = np.array([0, 0, 1.0, 0] if camera.projection == "perspective" else [0, 0, 0, 1.0])
    found = []
    for axis, size in enumerate(camera.size):
        pixel = np.array([*camera.K[axis, :2], 0, 0]) + camera.K[axis, 2] * one  # plane of pixel coordinate 0
        for plane in (pixel + 0.5 * one, (size - 0.5) * one - pixel):
            found.append(-(plane[:3] @ here + plane[3]) / np.linalg.norm(plane[:3]))
    return np.array([*found, -here[2]])


def stretch(camera: Camera, center: np.ndarray, radius: float) -> float:
    """Largest 1 / cos^2 t of the angles t between the camera's axis and the points of a sphere, within the picture."""
    if camera.projection == "orthographic":
        return 1.0
    pixels = np.array([[x - 0.5, y - 0.5, 1] for x in (0, camera.width) for y in (0, camera.height)])
    widest = max(angle_between(ray, np.array([0, 0, 1.0])) for ray in pixels @ np.linalg.inv(camera.K).T)
    way = center - camera.center
    wide = np.arcsin(min(radius / max(np.linalg.norm(way), NEAREST), 1.0))
    return float(1 / np.cos(min(angle_between(way, camera.forward) + wide, widest)) ** 2)


def angle_between(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.arccos(np.clip(a @ b / max(np.linalg.norm(a) * np.linalg.norm(b), NEAREST), -1, 1)))


def smoothed(view: DepthImage) -> np.ndarray:
    """Denoised depth (H, W), float64: weighted means of nearness over pairs of opposite samples around each sample."""
    if not any(view.noise):
        return view.depth.astype(np.float64)
    perspective = view.camera.projection == "perspective"
    depth = np.where(view.valid, view.depth, np.nan).astype(np.float64)
    near = 1 / depth if perspective else -depth
    reach = REACH * np.polyval(view.noise, depth) * (near**2 if perspective else 1)
    wide = np.pad(near, RADIUS, constant_values=np.nan)
    total, weights = np.zeros(near.shape), np.ones(near.shape)
    for dy in range(RADIUS + 1):
        for dx in range(-RADIUS if dy else 1, RADIUS + 1):
            a, b = (
                wide[RADIUS + y :, RADIUS + x :][: near.shape[0], : near.shape[1]] for x, y in ((dx, dy), (-dx, -dy))
            )
            off = 0.5 * (a + b) - near
            weight = np.where(np.abs(off) < reach, 2 - 2 * (off / reach) ** 2, 0)
            total, weights = total + np.where(weight > 0, weight * off, 0), weights + weight
    found = near + total / weights
    return 1 / found if perspective else -found


# --- segmentation --------------------------------------------------------------------------------------------------


def segmented(view: DepthImage, rule: Segmentation) -> np.ndarray:
    """(H, W) states of each cell's two triangles: DRAWN if the three samples are valid and bridge no gap."""
    width, height = view.camera.size
    tree = Tree(view, np.zeros((height, width), np.uint8))
    depth = view.depth.astype(np.float64)
    perspective = view.camera.projection == "perspective"
    extent = np.ptp([tree.place((x, y), float(depth[y, x])) for y, x in np.argwhere(view.valid)], axis=0).max()

    def explained(z: float) -> float:
        """Difference in depth, at depth z, that two samples of one surface may have by noise."""
        a, b, c = view.noise if rule.deviations else (0.0, 0.0, 0.0)
        return rule.deviations * (a * z * z + b * z + c)

    def explained_nearness(n: float) -> float:
        return explained(1 / n) * n * n if perspective else explained(-n)

    def orthogonality(corners: list[Corner]) -> bool:
        p, q, r = (tree.place(corner, float(depth[corner[::-1]])) for corner in corners)
        normal = np.cross(q - p, r - p)
        sight = p + q + r if perspective else np.array([0, 0, 1.0])
        sine = abs(normal @ sight) / np.linalg.norm(normal) / np.linalg.norm(sight)
        z = [p[2], q[2], r[2]]
        scale = np.mean(z) if perspective else extent
        is_long = np.ptp(z) > max(rule.depth_range * scale, explained(float(np.mean(z))))
        return sine < np.sin(np.radians(rule.angle)) and is_long and connectedness(corners)

    def nearness(corner: Corner) -> float:
        return tree.inverse(depth[corner[::-1]])

    def disparity(corners: list[Corner]) -> bool:
        n = [nearness(corner) for corner in corners]
        return np.ptp(n) > max(rule.gap * (max(n) if perspective else extent), explained_nearness(max(n)))

    def connected(a: Corner, b: Corner) -> bool:
        """Tell whether the step from a to b is small, or similar to the step before or after it on the same line."""
        step = np.subtract(b, a)
        change = nearness(b) - nearness(a)
        off = [abs(change)]
        for end, sign in ((tuple(a - step), 1), (tuple(b + step), -1)):
            if min(end) >= 0 and tree.sample(end) == end and tree.is_sample(end):
                other = nearness(a) - nearness(end) if sign > 0 else nearness(end) - nearness(b)
                off.append(abs(change - other))
        scale = max(abs(nearness(a)), abs(nearness(b))) if perspective else extent
        gap = rule.gap * (0.1 if rule.test == "orthogonality" else 1.0)
        return min(off) <= max(gap * scale, explained_nearness(max(nearness(a), nearness(b))))

    def connectedness(corners: list[Corner]) -> bool:
        sides = [(a, b) for a in corners for b in corners if a < b and (a[0] == b[0] or a[1] == b[1])]
        return not all(connected(a, b) for a, b in sides)

    tests = {"orthogonality": orthogonality, "disparity": disparity, "connectedness": connectedness}
    bridges = tests.get(rule.test, lambda corners: False)
    cells = np.zeros((height, width), np.uint8)
    for y in range(height - 1):
        for x in range(width - 1):
            for side, corners in enumerate(halves_of_cell(x, y)):
                drawn = all(map(tree.is_sample, corners)) and not bridges(corners)
                cells[y, x] |= (DRAWN if drawn else UNDRAWN) << 2 * side
    return cells


def normals(view: DepthImage, cells: np.ndarray) -> np.ndarray:
    """Normals (H, W, 3), camera's frame: perpendicular to the steps to neighbours joined by a drawn triangle."""
    width, height = view.camera.size
    tree = Tree(view, cells)
    found = np.tile((0.0, 0.0, -1.0), (height, width, 1))
    for y, x in np.argwhere(view.valid):
        here = tree.place((x, y), float(view.depth[y, x]))
        sums = []
        for dx, dy in ((1, 0), (0, 1)):
            ends = [(sign, (x + sign * dx, y + sign * dy)) for sign in (-1, 1)]
            steps = [
                sign * (tree.place(end, float(view.depth[end[::-1]])) - here)
                for sign, end in ends
                if ((x, y), end) in tree.joined
            ]
            sums.append(np.sum(steps, axis=0) if steps else np.array([dx, dy, 0.0]))
        normal = np.cross(sums[1], sums[0])
        found[y, x] = normal / np.linalg.norm(normal)
    return found
