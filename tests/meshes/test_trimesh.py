"""Meshes made from trimesh's meshes, and from other objects with the same attributes."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

import pyibr as ibr

VERTICES = np.array([[-1, -1, 3], [1, -1, 3], [-1, 1, 3], [1, 1, 3]], np.float64)
FACES = np.array([[0, 1, 2], [3, 2, 1]])
UV = np.array([[0, 1], [1, 1], [0, 0], [1, 0]], np.float64)  # v grows upwards
TEXTURE = np.array([[[200, 0, 0], [0, 200, 0]], [[0, 0, 200], [90, 90, 90]]], np.uint8)
CAMERA = ibr.Camera([[20, 0, 5], [0, 20, 5], [0, 0, 1]], (11, 11))


def like(**visual) -> SimpleNamespace:
    return SimpleNamespace(vertices=VERTICES, faces=FACES, visual=SimpleNamespace(**visual))


def opaque(colors) -> np.ndarray:
    return np.column_stack([colors, np.full(len(colors), 255)]).astype(np.uint8)


def test_a_mesh_without_colours():
    for mesh in (SimpleNamespace(vertices=VERTICES, faces=FACES), like(kind=None)):
        made = ibr.Mesh.from_trimesh(mesh)
        np.testing.assert_array_equal(made.vertices, VERTICES)
        np.testing.assert_array_equal(made.faces, FACES)
        assert made.colors is None and made.texture is None


def test_colours_of_vertices_and_of_faces():
    colors = np.array([[9, 0, 0], [0, 9, 0], [0, 0, 9], [9, 9, 9]])
    made = ibr.Mesh.from_trimesh(like(kind="vertex", vertex_colors=opaque(colors)))
    np.testing.assert_array_equal(made.colors, colors)
    made = ibr.Mesh.from_trimesh(like(kind="face", face_colors=opaque(colors[:2] * 20)))
    frame = ibr.render(made, CAMERA)
    assert {tuple(color) for color in frame.color.reshape(-1, 3)} == {(180, 0, 0), (0, 180, 0)}


@pytest.mark.parametrize("name", ["image", "baseColorTexture"])
def test_a_texture_stands_upright(name):
    material = SimpleNamespace(**{name: Image.fromarray(TEXTURE).convert("RGBA")})
    made = ibr.Mesh.from_trimesh(like(kind="texture", uv=UV, material=material))
    np.testing.assert_array_equal(made.texture, TEXTURE)
    upper_left, upper_right, lower_left = ibr.render(made, CAMERA).color[[3, 3, -4], [3, -4, 3]]
    assert (upper_left.argmax(), upper_right.argmax(), lower_left.argmax()) == (0, 1, 2)


def test_another_texture_and_a_material_of_one_colour():
    plain = like(kind="texture", uv=UV, material=SimpleNamespace(main_color=np.array([1, 2, 3, 255], np.uint8)))
    np.testing.assert_array_equal(ibr.Mesh.from_trimesh(plain).colors, [[1, 2, 3]] * 4)
    textured = like(kind="texture", uv=UV, material=SimpleNamespace(image=Image.new("L", (3, 2))))
    np.testing.assert_array_equal(ibr.Mesh.from_trimesh(textured, texture=TEXTURE).texture, TEXTURE)


def test_transparency_is_told():
    see_through = np.dstack([TEXTURE, np.full(TEXTURE.shape[:2], 9, np.uint8)])
    textured = like(kind="texture", uv=UV, material=SimpleNamespace(image=Image.fromarray(see_through)))
    for mesh in (textured, like(kind="vertex", vertex_colors=np.full((4, 4), 9, np.uint8))):
        with pytest.warns(UserWarning, match="transparency is ignored"):
            ibr.Mesh.from_trimesh(mesh)


def test_what_is_no_mesh_is_named():
    for wrong in ("mesh.dae", SimpleNamespace(geometry={})):
        with pytest.raises(ibr.ArgumentError, match=r"^mesh: expected a mesh with vertices and faces"):
            ibr.Mesh.from_trimesh(wrong)
    with pytest.raises(ibr.ArgumentError, match=r"^faces: "):
        ibr.Mesh.from_trimesh(SimpleNamespace(vertices=VERTICES, faces=FACES + 2))
    with pytest.raises(ibr.ArgumentError, match=r"^uv: "):
        ibr.Mesh.from_trimesh(like(kind=None), texture=TEXTURE)


@pytest.mark.filterwarnings("ignore:.*transparency")
def test_trimesh_itself():
    trimesh = pytest.importorskip("trimesh")
    visual = trimesh.visual.TextureVisuals(uv=UV, image=Image.fromarray(TEXTURE))
    textured = trimesh.Trimesh(VERTICES, FACES, visual=visual, process=False)
    made = ibr.Mesh.from_trimesh(textured)
    by_hand = ibr.Mesh(VERTICES, FACES, uv=UV * (1, -1) + (0, 1), texture=TEXTURE)
    np.testing.assert_array_equal(ibr.render(made, CAMERA).color, ibr.render(by_hand, CAMERA).color)
    for kind, colors in (("vertex_colors", np.arange(16)), ("face_colors", np.arange(8))):
        tinted = trimesh.Trimesh(VERTICES, FACES, process=False, **{kind: colors.reshape(-1, 4).astype(np.uint8)})
        each = 1 if kind == "vertex_colors" else 3
        made = ibr.Mesh.from_trimesh(tinted)
        np.testing.assert_array_equal(made.colors[::each], colors.reshape(-1, 4)[:, :3])
    with pytest.raises(ibr.ArgumentError, match="to_mesh"):
        ibr.Mesh.from_trimesh(trimesh.Scene())
