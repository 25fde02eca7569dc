"""Scenes whose depth and depth edges are known exactly, like scenes before depth cameras, in renderers and in games.

Lengths are in metres; x points right, y down and z forward. Random numbers with fixed seeds place the parts, so that
each scene is always the same.
"""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import pyibr as ibr
from benchmarks.warp import solids
from benchmarks.warp.solids import Ball, Cone, Polytope, Relief, Rod, Sheet, Squares, Thing, box

Array = NDArray[Any]
Things = list[Thing]

_FOCAL = 0.9  # focal length in image widths: 58 degrees across
_FEWEST_SAMPLES = 3.0  # least samples per pitch of a pattern, against aliasing


@dataclass(frozen=True)
class Scene:
    """Objects, and the camera that sees them.

    Attributes
    ----------
    name : str
    build : callable
        Returns the scene's objects.
    eye, target : (3,)
        Position of the camera, and a point that it looks at.
    across : float
        Width of the picture of an orthographic camera in metres; 0 for a perspective camera.
    pitch : float
        Distance (x/z in the camera) between neighbouring bars or squares of a pattern; infinite without one.
    """

    name: str
    build: Callable[[], Things]
    eye: tuple[float, float, float] = (0, 0, 0)
    target: tuple[float, float, float] = (0, 0, 1)
    across: float = 0.0
    pitch: float = np.inf

    def camera(self, width: int, height: int) -> ibr.Camera:
        """Make the camera of an image of this size."""
        focal = width / self.across if self.across else _FOCAL * width
        pose = ibr.Camera.look_at(self.eye, self.target, (0, -1, 0), (width, height), fov_y=50).world_from_camera
        K = [[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]]
        return ibr.Camera(K, (width, height), pose, projection="orthographic" if self.across else "perspective")

    def is_resolved(self, width: int) -> bool:
        """Tell whether an image of this width has enough samples for the pattern."""
        return self.pitch * _FOCAL * width >= _FEWEST_SAMPLES

    def sampled(self, width: int, height: int) -> tuple[Array, Array, Array]:
        """Exact depth, and whether each sample and its right or lower neighbour are one surface (`solids.sampled`)."""
        return solids.sampled(self.build(), self.camera(width, height))


def _point(*xyz: float) -> Array:
    return np.array(xyz, float)


def _rng(name: str) -> np.random.Generator:
    return np.random.default_rng(zlib.crc32(name.encode()))


def _turn(x: float, y: float, z: float = 0.0) -> Array:
    """Rotation by degrees about x, then y, then z."""
    made = np.eye(3)
    for axis, angle in enumerate(np.radians([x, y, z])):
        one, c, s = np.eye(3), np.cos(angle), np.sin(angle)
        a, b = (axis + 1) % 3, (axis + 2) % 3
        one[[a, a, b, b], [a, b, a, b]] = c, -s, s, c
        made = one @ made
    return made


def _behind(point: ArrayLike, normal: ArrayLike) -> Polytope:
    """A body that fills all space behind a plane, whose normal points towards the viewer."""
    normal = np.asarray(normal, float)
    return Polytope(normal[None], np.array([normal @ np.asarray(point, float)]))


def _wall(z: float) -> Thing:
    return [_behind((0, 0, z), (0, 0, -1))]


def _floor(y: float) -> Thing:
    return [_behind((0, y, 0), (0, -1, 0))]


def _tube(points: Array, radius: float) -> Thing:
    """A body of rods with round ends that join the points in order."""
    return [Rod(a, b, radius, round_ends=True) for a, b in itertools.pairwise(points)]


def _rods(name: str, count: int, radius: float) -> Things:
    rng = _rng(name)
    rods: Things = []
    for _ in range(count):
        middle = _point(*rng.uniform((-0.9, -0.6, 1.5), (0.9, 0.6, 2.5)))
        angle, lean = rng.uniform(0, np.pi), rng.uniform(-0.3, 0.3)
        axis = 2 * _point(np.cos(angle), np.sin(angle), lean)
        rods.append([Rod(middle - axis, middle + axis, radius)])
    return [*rods, _wall(3.5)]


def _fence(pitch: float, width: float) -> Things:
    """Upright slats 2 m away, in front of a wall at 4 m."""
    places = pitch * np.arange(-np.ceil(1.3 / pitch), np.ceil(1.3 / pitch) + 1)
    return [*([box((x - width / 2, -3, 2), (x + width / 2, 3, 2.02))] for x in places), _wall(4)]


def _wires(pitch: float, radius: float, angles: tuple[float, ...]) -> Things:
    """Crossed wires in an oblique plane some 2 m away, in front of a wall at 4 m."""
    wires: Things = []
    for angle in np.radians(angles):
        s, c = np.sin(angle), np.cos(angle)
        along, across = _point(-s, c, -0.15 * s), _point(c, s, 0.15 * c)
        for n in np.arange(-np.ceil(1.6 / pitch), np.ceil(1.6 / pitch) + 1):
            middle = _point(0, 0, 2) + n * pitch * across
            wires.append([Rod(middle - 3 * along, middle + 3 * along, radius)])
    return [*wires, _wall(4)]


def _chequer(side: float, near: float, far: float, turn: tuple[float, float] = (0, 0)) -> Things:
    """Squares at depth `near` in front of a plane at depth `far`; both are turned about the point (0, 0, near)."""
    frame, middle = _turn(*turn), _point(0, 0, near)
    return [[Squares(middle, frame.T, side)], [_behind(middle + (far - near) * frame[:, 2], -frame[:, 2])]]


def _terraces(step: float) -> Things:
    """Plates behind one another: each depth is (1 + step) times the depth before."""
    depths = 2 * (1 + step) ** np.arange(8)
    ends = zip(depths, np.linspace(-0.4, 0.4, len(depths)), strict=True)
    return [*([box((-9, -9, z), (x * z, 9, z + 0.001))] for z, x in ends), _wall(4)]


def _stairs(tread: float) -> Thing:
    """Ten stairs that go up and away: solid down to the floor y = 0, or planks of thickness `tread` if it is not 0."""
    return [box((-1, -0.18 * (n + 1), 1.5 + 0.28 * n), (1, tread - 0.18 * (n + 1) if tread else 0, 1.78 + 0.28 * n))
            for n in range(10)]  # fmt: skip


def _balls(radius: float) -> Things:
    """Balls that touch one another, in front of a wall."""
    step, places = 2 * radius, range(-3, 4)
    balls: Things = [
        [Ball(_point(step * (i + j % 2 / 2), step * j * np.sqrt(0.75), 2.2 + 0.02 * i), radius)]
        for i in places
        for j in places
    ]
    return [*balls, _wall(2.2 + radius)]


def _cylinders() -> Things:
    axes = ((0.3, 0.2, 1), (-0.2, 0.4, 1), (0.8, -0.1, 0.6))
    starts = ((-0.6, -0.2, 1.2), (0.4, -0.5, 1.4), (-0.6, 0.6, 1.6))
    things: Things = [
        [Rod(_point(*start), _point(*start) + 1.5 * _point(*axis), radius)]
        for start, axis, radius in zip(starts, axes, (0.2, 0.3, 0.15), strict=True)
    ]
    return [*things, _wall(4)]


def _ridge(degrees: float, valley: bool) -> Things:
    """Two planes that meet in a line, each turned away from the camera by `degrees`."""
    s, c = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    if valley:
        normals = np.array([[s, 0.1, c], [-s, 0.1, c]])
        return [[Polytope(normals, normals @ _point(0.1, 0, 3.5), hollow=True)]]
    normals = np.array([[s, 0.1, -c], [-s, 0.1, -c]])
    return [[Polytope(normals, normals @ _point(0.1, 0, 0.9))], _wall(3.5)]


def _waves(amplitude: float, across: float, down: float) -> Things:
    """A surface whose depth is 3 times the exponential of a sine wave over the image.

    Its largest angle to a plane that faces the camera has the tangent amplitude * |(across, down)|.
    """
    return [[Relief(lambda x, y: 3 * np.exp(amplitude * np.sin(across * x + down * y)))]]


def _leaves() -> Things:
    rng = _rng("leaves")
    leaves: Things = []
    for _ in range(160):
        middle = rng.uniform((-0.9, -0.7, 1.2), (0.9, 0.7, 2.4))
        frame = _turn(rng.uniform(-60, 60), rng.uniform(-60, 60), rng.uniform(0, 180))
        size = rng.uniform(0.04, 0.1)
        leaves.append([Sheet(middle, size * frame[:, 0], 0.6 * size * frame[:, 1])])
    return [*leaves, _wall(3)]


def _corridor(pillars: bool) -> Things:
    things: Things = [[box((-1, -1.2, -1), (1, 1.2, 12), hollow=True)]]
    if pillars:
        things += [[box((x, -1.2, z), (x + 0.2, 1.2, z + 0.2))] for z in (2, 3.5, 6) for x in (-0.8, 0.6)]
    return things


def _floor_with_box() -> Things:
    """A box on the floor y = 0, in front of a wall 8 m away."""
    return [_floor(0), _wall(8), [box((-0.25, -0.25, 1.9), (0.25, 0, 2.4), _turn(0, 30))]]


def _ring(turn: Array) -> Thing:
    angles = np.linspace(0, 2 * np.pi, 73)
    points = 0.5 * np.stack([np.cos(angles), np.sin(angles), 0 * angles], -1)
    return _tube(points @ turn.T + _point(0, 0, 2), 0.17)


def _knot() -> Thing:
    t = np.linspace(0, 2 * np.pi, 121)
    shape = np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], -1)
    return _tube(0.25 * shape @ _turn(25, 35).T + _point(0, 0, 2.2), 0.11)


def _spring() -> Thing:
    t = np.linspace(0, 12 * np.pi, 145)
    shape = np.stack([0.3 * np.cos(t), t / 25 - 0.75, 0.3 * np.sin(t)], -1)
    return _tube(shape @ _turn(20, 0, 30).T + _point(0, 0, 1.8), 0.045)


def _room() -> Things:
    """A room with plates 0.1 m in front of its back wall, and a box against a side wall."""
    plates: Things = [
        [box((x, y, 3.9), (x + side, y + side, 3.92))]
        for x, y, side in ((-1.4, -0.9, 0.6), (-0.4, -0.6, 0.9), (0.9, -1, 0.4), (-1.2, 0.1, 0.3), (0.8, 0.2, 0.7))
    ]
    return [[box((-2, -1.3, -1), (2, 1.3, 4), hollow=True)], *plates, [box((1.4, 0.5, 2.4), (2, 1.3, 3.2))]]


def _grass() -> Things:
    rng = _rng("grass")
    blades: Things = []
    for x in np.linspace(-1.2, 1.2, 120):
        foot = _point(x, 0.6, rng.uniform(1.2, 2.2))
        tip = _point(rng.uniform(-0.25, 0.25), -rng.uniform(0.4, 1.1), rng.uniform(-0.2, 0.2))
        blades.append([Sheet(foot, tip, _point(rng.uniform(0.01, 0.025), 0, rng.uniform(-0.01, 0.01)), blade=True)])
    return [*blades, _floor(0.6), _wall(3)]


def _twigs() -> Things:
    rng = _rng("twigs")
    twigs: list[Rod] = []

    def grow(foot: Array, axis: Array, radius: float) -> None:
        twigs.append(Rod(foot, foot + axis, radius, round_ends=True))
        if radius > 0.008:
            for side in (-1, 1):
                turn = _turn(rng.uniform(-25, 25), rng.uniform(-25, 25), side * rng.uniform(15, 45))
                grow(foot + axis, rng.uniform(0.65, 0.85) * turn @ axis, 0.7 * radius)

    grow(_point(0, 0.9, 1.9), _point(0.05, -0.5, 0), 0.04)
    return [twigs, _wall(3)]


def _cones() -> Things:
    cones: Things = [
        [Cone(_point(0.6 * x, 0.6 * y, 1.3), _point(0.9 * x, 0.9 * y, 3), 0.32)]
        for x in (-1, 0, 1)
        for y in (-0.6, 0.6)
    ]
    return [*cones, _wall(3)]


def _open_box() -> Things:
    """A box without a lid: one body of five plates."""
    frame, middle, half, thick = _turn(-40, 30, 10), _point(0, 0, 1.8), 0.5, 0.02
    plates: list[Polytope] = []
    for axis, sign in ((0, -1), (0, 1), (1, -1), (1, 1), (2, 1)):
        at, size = np.zeros(3), np.full(3, half)
        at[axis], size[axis] = sign * (half - thick), thick
        center = middle + frame @ at
        plates.append(box(center - size, center + size, frame))
    return [plates, _wall(3.5)]


def _house() -> Things:
    """A house with a gable roof, on the floor."""
    walls = box((-0.8, -0.9, 3), (0.8, 0, 4.2), _turn(0, 35))
    roof = np.array([[0, -1, 1], [0, -1, -1], [0, 1, 0], [1, 0, 0], [-1, 0, 0]]) @ _turn(0, 35).T
    return [
        [walls, Polytope(roof, roof @ _point(0, -0.9, 3.6) + (0.75, 0.75, 0, 0.9, 0.9))],
        _floor(0),
        _wall(8),
    ]


def _corrugated() -> Things:
    """Parallel rods, half sunk into an oblique plate; each rod hides a part of its neighbour."""
    turn, middle = _turn(0, 50), _point(0, 0, 2.5)
    rods = [
        Rod(middle + turn @ _point(x, -3, 0), middle + turn @ _point(x, 3, 0), 0.1) for x in np.arange(-2.4, 2.5, 0.25)
    ]
    return [[*rods, _behind(middle, turn @ _point(0, 0, -1))]]


def _table() -> Things:
    legs = [box((x, -0.72, z), (x + 0.05, 0, z + 0.05)) for x in (-0.6, 0.55) for z in (2, 2.75)]
    top = box((-0.65, -0.75, 1.95), (0.65, -0.72, 2.85))
    return [[top, *legs], [Ball(_point(0.2, -0.87, 2.3), 0.12)], _floor(0), _wall(3.6)]


_STANDING = (0, -1.5, 0), (0, -1.0, 3)  # a viewpoint at the height of eyes, and a point ahead to look at

SCENES: tuple[Scene, ...] = (
    Scene("thin rods", lambda: _rods("thin rods", 12, 0.008)),
    Scene("thick rods", lambda: _rods("thick rods", 6, 0.06)),
    Scene("narrow fence", lambda: _fence(0.05, 0.02), pitch=0.025),
    Scene("wide fence", lambda: _fence(0.2, 0.05), pitch=0.1),
    Scene("crossed wires", lambda: _wires(0.14, 0.009, (31, -31)), pitch=0.07),
    Scene("grid", lambda: _wires(0.3, 0.02, (0, 90)), pitch=0.15),
    Scene("chequer", lambda: _chequer(0.12, 2, 2.4), pitch=0.06),
    Scene("fine chequer", lambda: _chequer(0.04, 2, 3), pitch=0.02),
    Scene("stairs", lambda: [_stairs(0), _floor(0), _wall(5)], (0, -1.6, 0), (0, -0.9, 3)),
    Scene("stairs aslant", lambda: [_stairs(0), _floor(0), _wall(5)], (-1.8, -2.4, 0.8), (0.2, -0.8, 2.8)),
    Scene("open stairs", lambda: [_stairs(0.04), _floor(0), _wall(5)], (0.5, -0.9, 0), (0, -0.9, 3)),
    Scene("touching balls", lambda: _balls(0.25)),
    Scene("ball before a wall", lambda: [[Ball(_point(0.1, 0, 2), 0.6)], _wall(3)]),
    Scene("cylinders aslant", _cylinders),
    Scene("steps of 1 %", lambda: _chequer(0.3, 2, 2.02), pitch=0.15),
    Scene("steps of 2 % aslant", lambda: _chequer(0.3, 2, 2.04, (15, 25)), pitch=0.15),
    Scene("steps of 3 %", lambda: _terraces(0.03)),
    Scene("ridge", lambda: _ridge(70, valley=False)),
    Scene("valley", lambda: _ridge(65, valley=True)),
    Scene("gentle waves", lambda: _waves(0.05, 14, 9)),
    Scene("steep waves", lambda: _waves(0.6, 11, 7.5)),
    Scene("leaves", _leaves),
    Scene("corridor", lambda: _corridor(pillars=False), (0.3, 0.2, 0), (0.1, 0.1, 3)),
    Scene("corridor with pillars", lambda: _corridor(pillars=True), (0.1, 0.2, 0), (0, 0, 3)),
    Scene("floor from 1.5 m", _floor_with_box, *_STANDING),
    Scene("floor from 0.3 m", _floor_with_box, (0, -0.3, 0), (0, -0.3, 3)),
    Scene("ring", lambda: [_ring(_turn(55, 20))]),
    Scene("knot", lambda: [_knot(), _wall(4)]),
    Scene("spring", lambda: [_spring(), _wall(3)]),
    Scene("room", _room),
    Scene("grass", _grass),
    Scene("twigs", _twigs),
    Scene("cones", _cones),
    Scene("open box", _open_box),
    Scene("house", _house, (0, -2.2, 0), (0, -0.6, 3.6)),
    Scene("corrugated sheet", _corrugated),
    Scene("table", _table, *_STANDING),
    Scene("fence, orthographic", lambda: _wires(0.2, 0.02, (20,)), across=2.4, pitch=0.2 / 2.4 / _FOCAL),
    Scene("stairs, orthographic", lambda: [_stairs(0), _floor(0), _wall(5)], (-2, -3, 0), (0, -0.8, 2.8), across=3),
    Scene("balls, orthographic", lambda: _balls(0.25), across=3),
    Scene("knot, orthographic", lambda: [_knot(), _wall(4)], across=2.6),
)
"""All scenes: wires and fences, steps, round objects, slopes, rooms and plants."""
