"""Wrong arguments of reliefs, which errors name, and base meshes with odd triangles."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from tests.displaced import square

WHITE = np.full((2, 2, 3), 200, np.uint8)
RAMP = np.linspace(0, 1, 64, dtype=np.float32).reshape(8, 8)
CAMERA = Camera.look_at((0.5, -0.6, 0.9), (0.5, 0.5, 0), (0, 0, 1), (61, 37), fov_y=50)


@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("base", "mesh"),
        ("base", ibr.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])),
        ("height", RAMP * 2),
        ("height", RAMP - 0.5),
        ("height", np.full((4, 4), np.nan, np.float32)),
        ("height", np.zeros((4, 4), np.int32)),
        ("height", np.zeros((4, 4, 1), np.float32)),
        ("height", np.zeros((0, 4), np.float32)),
        ("color", np.zeros((4, 4), np.uint8)),
        ("color", np.full((4, 4, 3), 200.0)),
        ("scale", 0),
        ("scale", -1.0),
        ("scale", np.inf),
        ("tiles", (0, 1)),
        ("tiles", (1.5, 1)),
        ("tiles", 2),
        ("normal_map", np.zeros((4, 4, 3), np.float32)),
        ("normal_map", np.zeros((4, 4), np.float32)),
        ("silhouette", "true"),
        ("distance", "equation 6"),
        ("search", "cone"),
        ("shadow", "soft"),
        ("steps", 0),
        ("steps", 2.5),
        ("halvings", -1),
        ("halvings", True),
    ],
)
def test_wrong_arguments_are_named(argument, value):
    good = {"base": square(), "height": RAMP, "color": WHITE, "scale": 0.1}
    with pytest.raises(ibr.ArgumentError, match=rf"^{argument}: "):
        ibr.ReliefSurface(**(good | {argument: value}))


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 13), (61, 37), (64, 64)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_maps_of_any_size_and_kind(shape, dtype):
    most = 1 if dtype == np.float32 else np.iinfo(dtype).max
    height = (np.random.default_rng(0).random(shape) * most).astype(dtype)
    frame = ibr.render(ibr.ReliefSurface(square(), height, WHITE, 0.1, tiles=(3, 2)), CAMERA)
    plain = ibr.render(square(), CAMERA)
    np.testing.assert_array_equal(frame.valid, plain.valid)
    assert (frame.depth >= plain.depth - 1e-5)[frame.valid].all()


@pytest.mark.parametrize("width", [32768, 40001, 1 << 21])
def test_wide_maps(width):
    height = np.linspace(0, 255, width).astype(np.uint8)[None]
    surface = ibr.ReliefSurface(square(), height, WHITE, 0.1, normal_map=np.full((1, width, 3), 200, np.uint8))
    assert ibr.render(surface, CAMERA).valid.any()


def test_maps_that_are_too_wide():
    with pytest.raises(ibr.ArgumentError, match=r"^uv: .* of a map of 2097153x1$"):
        ibr.ReliefSurface(square(), np.zeros((1, (1 << 21) + 1), np.uint8), WHITE, 0.1)


def test_bytes_and_floats_are_one_map():
    height = np.random.default_rng(0).integers(0, 256, (16, 16)).astype(np.uint8)
    a = ibr.render(ibr.ReliefSurface(square(), height, WHITE, 0.1), CAMERA)
    b = ibr.render(ibr.ReliefSurface(square(), height / np.float32(255), WHITE, 0.1), CAMERA)
    np.testing.assert_array_equal(a.valid, b.valid)
    assert np.isclose(a.depth, b.depth, rtol=1e-4)[a.valid].mean() >= 0.995  # a ray may meet a neighbouring cell


def test_triangles_whose_uv_has_no_area_show_one_height():
    """Constant uv gives a constant height: the relief is a plane at the depth of one texel."""
    mesh = square()
    still = ibr.Mesh(mesh.vertices, mesh.faces, uv=np.full((4, 2), 0.5))
    height = np.full((4, 4), 0.25, np.float32)
    frame = ibr.render(ibr.ReliefSurface(still, height, WHITE, 0.2), CAMERA)
    expected = ibr.render(ibr.Mesh(mesh.vertices - (0, 0, 0.15), mesh.faces), CAMERA)
    both = frame.valid & expected.valid
    assert both.sum() > 300
    np.testing.assert_allclose(frame.depth[both], expected.depth[both], rtol=1e-4)


def test_degenerate_triangles_draw_nothing():
    mesh = square()
    more = ibr.Mesh(mesh.vertices, [*mesh.faces.tolist(), [0, 0, 1], [2, 2, 2]], uv=mesh.uv)
    a, b = (ibr.render(ibr.ReliefSurface(base, RAMP, WHITE, 0.1), CAMERA) for base in (mesh, more))
    np.testing.assert_array_equal(a.depth, b.depth)


def test_backs_are_not_drawn():
    below = Camera.look_at((0.5, -0.6, -0.9), (0.5, 0.5, 0), (0, 0, 1), (61, 37), fov_y=50)
    assert not ibr.render(ibr.ReliefSurface(square(), RAMP, WHITE, 0.1), below).valid.any()


def test_planar_vertices_are_counted():
    corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]]  # the last corner has no triangle
    base = ibr.Mesh(corners, [[0, 1, 2]], uv=np.zeros((4, 2)))
    assert ibr.ReliefSurface(base, RAMP, WHITE, 1).planar_vertices == 1
