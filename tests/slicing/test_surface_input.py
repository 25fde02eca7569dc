"""Sliced surfaces with wrong arguments, and on degenerate or irregular meshes."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from tests.boxes import box, facets
from tests.displaced import square
from tests.slicing.test_surfaces import SCALE, camera, heights, surface


def test_other_heights_are_checked_as_the_first_ones():
    first = surface(32, "orthogonal")
    for bad in (np.zeros((1, 3 << 20), np.uint8), np.full((4, 4), 2.0), np.zeros((4, 4), int), None):
        messages: list[str] = []
        takers = (first.with_height, lambda height: ibr.SlicedSurface(first.base, height, first.color, SCALE))
        for take in takers:
            with pytest.raises(ibr.ArgumentError) as caught:
                take(bad)
            messages.append(str(caught.value))
        assert messages[0] == messages[1]


BAD = [
    ("height", {"height": np.full((4, 4), 1.5, np.float32)}, "height"),
    ("negative height", {"height": np.full((4, 4), -0.1, np.float32)}, "height"),
    ("NaN height", {"height": np.full((4, 4), np.nan, np.float32)}, "height"),
    ("empty height", {"height": np.zeros((0, 4), np.float32)}, "height"),
    ("height of strings", {"height": np.array([["a"]])}, "height"),
    ("gray colour", {"color": np.zeros((4, 4), np.uint8)}, "color"),
    ("scale 0", {"scale": 0.0}, "scale"),
    ("scale NaN", {"scale": float("nan")}, "scale"),
    ("tiles 0", {"tiles": (0, 1)}, "tiles"),
    ("tiles 1.5", {"tiles": (1.5, 1)}, "tiles"),
    ("more tiles than floats count", {"tiles": (10**6, 1)}, "uv"),
    ("slices 0", {"slices": 0}, "slices"),
    ("slices 2.5", {"slices": 2.5}, "slices"),
    ("slicing", {"slicing": "sideways"}, "slicing"),
    ("test", {"test": "maybe"}, "test"),
    ("band 0", {"band": 0}, "band"),
    ("band NaN", {"band": float("nan")}, "band"),
    ("band of words", {"band": "thick"}, "band"),
    ("normal map", {"normal_map": np.zeros((4, 4, 3), np.float32)}, "normal_map"),
    ("black normal map", {"normal_map": np.zeros((4, 4, 3), np.uint8)}, "normal_map"),
    ("normal map of int", {"normal_map": np.full((4, 4, 3), 200, np.int32)}, "normal_map"),
    ("NaN normal map", {"normal_map": np.full((4, 4, 3), np.nan, np.float32)}, "normal_map"),
    ("empty normal map", {"normal_map": np.zeros((0, 4, 3), np.uint8)}, "normal_map"),
    ("no mesh", {"base": 3}, "base"),
    ("no uv", {"base": ibr.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])}, "base"),
]


@pytest.mark.parametrize(("what", "changes", "argument"), BAD, ids=[case[0] for case in BAD])
def test_bad_input(what, changes, argument):
    good = {"base": square(), "height": heights(), "color": np.zeros((2, 2, 3), np.uint8), "scale": 1.0}
    with pytest.raises(ibr.ArgumentError, match=f"^{argument}: "):
        ibr.SlicedSurface(**{**good, **changes})


def test_degenerate_triangles_and_flat_uv_are_drawn_or_not_but_do_no_harm():
    corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 2, 2]]
    mesh = ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3], [0, 0, 1], [4, 4, 4]], uv=np.zeros((5, 2)))
    thing = ibr.SlicedSurface(mesh, heights(), np.full((2, 2, 3), 9, np.uint8), 0.1)
    for elevation in (90, 20):
        frame = ibr.render(thing, camera(elevation, 30, (61, 37)))
        assert np.isfinite(frame.depth[frame.valid]).all()
        assert frame.valid.any()


@pytest.mark.parametrize("slicing", ["surface", "orthogonal", "screen"])
@pytest.mark.parametrize("shape", ["cone", "sphere"])
def test_coincident_vertices_at_a_tip_or_a_pole_draw_nothing(shape, slicing):
    """Modellers make such meshes: at the tip there is a vertex for each u, and triangles between these vertices."""
    u, v = np.meshgrid(np.linspace(0, 1, 49), np.linspace(0, 1, 13))
    a, ring = 2 * np.pi * u, (1 - v if shape == "cone" else np.sin(np.pi * v).round(9))
    z = 1.5 * v if shape == "cone" else -np.cos(np.pi * v)
    vertices = np.stack([ring * np.cos(a), ring * np.sin(a), z], axis=-1).reshape(-1, 3)
    i = (np.arange(12)[:, None] * 49 + np.arange(48)).ravel()
    faces = np.concatenate([np.stack([i, i + 1, i + 50], 1), np.stack([i, i + 50, i + 49], 1)])
    corner = vertices[faces]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    assert (area < 1e-9).any()
    uv, cam = (
        np.stack([u, v], -1).reshape(-1, 2),
        Camera.look_at((2.5, -3, 2), (0, 0, 0.3), (0, 0, 1), (161, 121), fov_y=45),
    )
    height, color = np.full((4, 4), 0.5, np.float32), np.full((1, 1, 3), 255, np.uint8)
    frames = [
        ibr.render(ibr.SlicedSurface(ibr.Mesh(vertices, kept, uv=uv), height, color, 0.3, slicing=slicing), cam)
        for kept in (faces, faces[area > 1e-9])
    ]
    assert frames[0].valid.sum() > 2000
    np.testing.assert_array_equal(frames[0].valid, frames[1].valid)
    np.testing.assert_array_equal(frames[0].depth, frames[1].depth)


def test_what_is_made_cannot_be_changed():
    made = surface(8, "screen")
    for name in ("color", "height", "scale", "slices"):
        with pytest.raises(AttributeError, match="make a new one"):
            setattr(made, name, getattr(made, name))


@pytest.mark.parametrize("kind", [ibr.SlicedSurface, ibr.ReliefSurface])
def test_vertices_that_nothing_uses_change_nothing(kind):
    """No drawn triangle uses the added vertices: copies of a box's corners, a triangle without area, one far away."""
    base, height = facets(box()), np.full((4, 4), 0.5, np.float32)
    camera, light = (
        Camera.look_at((2.5, -2.1, 3.4), (0, 0, 0), (0, 0, 1), (96, 80), fov_y=42),
        ibr.Light(direction=(-0.4, 0.5, -1)),
    )
    corners, uv, faces = base.vertices, np.asarray(base.uv), base.faces
    middle = np.array([corners[0], corners[1], 0.5 * (corners[0] + corners[1])])
    flat = np.concatenate([faces, len(corners) + np.arange(3)[None]])

    def drawn(more: np.ndarray, faces: np.ndarray) -> tuple[ibr.Frame, np.ndarray]:
        there = np.concatenate([uv, np.zeros((len(more), 2))])
        mesh = ibr.Mesh(np.concatenate([corners, more]), faces, uv=there)
        made = kind(mesh, height, np.full((1, 1, 3), 255, np.uint8), 0.1)
        return ibr.render(made, camera, light), np.array(made.bounds)

    expected, bounds = drawn(np.empty((0, 3)), faces)
    assert expected.valid.sum() > 1000
    for more, those in ((corners[:8], faces), (middle, flat), (np.array([[2000.0, 0, 0]]), faces)):
        found, around = drawn(more, those)
        np.testing.assert_array_equal(found.valid, expected.valid)
        np.testing.assert_allclose(found.depth, expected.depth, rtol=1e-5)
        np.testing.assert_allclose(found.color.astype(int), expected.color.astype(int), atol=1)
        np.testing.assert_allclose(around, bounds, rtol=1e-6)


def test_seams_by_rounded_sines_are_closed():
    """A displaced sphere is whole at its seam, although the sine of two pi, where u ends, is not quite 0 in floats."""
    v, u = np.mgrid[:11, :17]
    polar, around = np.pi * v / 10, 2 * np.pi * u / 16
    points = [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)]
    first = (v * 17 + u)[:-1, :-1].ravel()
    faces = np.concatenate(
        [np.stack([first, first + 17, first + 1], 1), np.stack([first + 1, first + 17, first + 18], 1)]
    )
    exact = [np.where(np.abs(part) < 1e-12, 0, part) for part in points]
    camera = Camera.look_at((3, 0.3, 0.4), (0, 0, 0), (0, 0, 1), (96, 80), fov_y=42)  # the seam is in front
    depths = [
        ibr.render(
            ibr.SlicedSurface(
                ibr.Mesh(np.stack(form, -1).reshape(-1, 3), faces, uv=np.stack([u / 16, v / 10], -1).reshape(-1, 2)),
                np.full((4, 4), 0.5, np.float32),
                np.full((1, 1, 3), 255, np.uint8),
                0.2,
            ),
            camera,
        ).depth
        for form in (points, exact)
    ]
    np.testing.assert_allclose(depths[0], depths[1], atol=1e-4)
