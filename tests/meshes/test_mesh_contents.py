"""Contents of mesh files other than triangles: material colours, textures and skins, and warnings about the rest."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import pyibr as ibr
from tests.io.others_meshes import SQUARE, TRIANGLE, accessor, write_gltf, write_skinned
from tests.io.specimens import TEXTURED

CORNERS = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n"


def test_obj_colours_of_materials_are_their_vertices(tmp_path: Path):
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 1 0 0\n")
    (tmp_path / "b.mtl").write_text("newmtl none\nKs 1 1 1\nnewmtl half\nKd 0 0.5 0 # half of it\n")
    lines = "usemtl red\nf 1 2 3 # shares its side\nusemtl half\nf 1 3 4\nusemtl none\nf 2 3 4\n"
    (tmp_path / "m.obj").write_text("mtllib a.mtl b.mtl\n" + CORNERS + lines)
    mesh = ibr.Mesh.load(tmp_path / "m.obj")
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], np.array(SQUARE)[[[0, 1, 2], [0, 2, 3], [1, 2, 3]]])
    colors = [[255, 0, 0], [0, 128, 0], [255, 255, 255]]
    np.testing.assert_array_equal(mesh.colors[mesh.faces], np.repeat(np.array(colors)[:, None], 3, axis=1))


def test_obj_with_what_is_not_there_or_not_read(tmp_path: Path):
    for name in ("t.png", "other.png"):
        ibr.write_color(tmp_path / name, TEXTURED.texture)
    (tmp_path / "a.mtl").write_text("newmtl a\nmap_Kd t.png\nnewmtl b\nmap_Kd other.png\n")
    lines = "usemtl a\nf 1/1 2/2 3/3\nusemtl b\nf 1/1 2/2 3/3\nl 1 2\n"
    (tmp_path / "m.obj").write_text("mtllib none.mtl a.mtl\n" + CORNERS + lines)
    words = r"m\.obj: left out: lines, materials of none\.mtl, which is missing, other\.png"
    with pytest.warns(UserWarning, match=words):
        np.testing.assert_array_equal(ibr.Mesh.load(tmp_path / "m.obj").texture, TEXTURED.texture)


def test_obj_with_a_texture_that_is_not_opaque(tmp_path: Path):
    rgba = np.dstack([TEXTURED.texture, np.full(TEXTURED.texture.shape[:2], 200, np.uint8)])
    Image.fromarray(rgba).save(tmp_path / "t.png")
    (tmp_path / "a.mtl").write_text("newmtl a\nmap_Kd t.png\n")
    (tmp_path / "m.obj").write_text("mtllib a.mtl\n" + CORNERS + "usemtl a\nf 1/1 2/2 3/3\n")
    with pytest.warns(UserWarning, match=r"t\.png: transparency is ignored"):
        np.testing.assert_array_equal(ibr.Mesh.load(tmp_path / "m.obj").texture, TEXTURED.texture)


@pytest.mark.parametrize("names", ["s t", "u v", "texture_u texture_v", ""])
def test_ply_with_a_texture(tmp_path: Path, names):
    """PLY files have uv for vertices or, if MeshLab wrote them, for the faces' corners; v grows upwards."""
    ibr.write_color(tmp_path / "the texture.png", TEXTURED.texture)
    uv, rows = [(0, 0), (1, 0), (1, 0.25), (0, 1)], [" ".join(map(str, point)) for point in SQUARE]
    head = "ply\nformat ascii 1.0\ncomment TextureFile the texture.png\nelement vertex 4\n"
    head += "".join(f"property float {name}\n" for name in ["x", "y", "z", *names.split()])
    head += "element face 1\nproperty list uchar int vertex_indices\n"
    if names:
        rows, face = [f"{row} {u} {v}" for row, (u, v) in zip(rows, uv, strict=True)], "4 0 1 2 3"
    else:
        head += "property list uchar float texcoord\n"
        face = "4 0 1 2 3 8 " + " ".join(f"{u} {v}" for u, v in uv)
    (tmp_path / "m.ply").write_text(head + "end_header\n" + "\n".join([*rows, face]) + "\n")
    mesh = ibr.Mesh.load(tmp_path / "m.ply")
    expected = np.column_stack([np.array(uv)[:, 0], 1 - np.array(uv)[:, 1]])[[[0, 1, 2], [0, 2, 3]]]
    np.testing.assert_allclose(mesh.uv[mesh.faces], expected)
    np.testing.assert_array_equal(mesh.texture, TEXTURED.texture)


def test_gltf_factors_are_linear_and_multiply_the_vertices_colours(tmp_path: Path):
    """In sRGB, 188 is half as much light as 255."""
    halves = np.full((3, 4), [0.5, 1, 1, 1], np.float32)
    surfaces = [{"baseColorFactor": [1, 0.5, 0, 1]}, {}]
    primitives = [{"attributes": {"POSITION": 0}, "material": number} for number in (0, 0, 1)]
    primitives[1]["attributes"] = {"POSITION": 0, "COLOR_0": 1}
    write_gltf(
        tmp_path / "m.gltf",
        [TRIANGLE, halves],
        accessors=[accessor(0, TRIANGLE, "VEC3"), accessor(1, halves, "VEC4")],
        meshes=[{"primitives": primitives}],
        nodes=[{"mesh": 0}],
        materials=[{"pbrMetallicRoughness": surface} for surface in surfaces],
    )
    colors = ibr.Mesh.load(tmp_path / "m.gltf").colors.reshape(3, 3, 3)
    assert (colors == colors[:, :1]).all()
    assert colors[:, 0].tolist() == [[255, 188, 0], [188, 188, 0], [255, 255, 255]]


def test_gltf_skins_are_applied(tmp_path: Path):
    write_skinned(tmp_path / "m.gltf")
    mesh = ibr.Mesh.load(tmp_path / "m.gltf", axes="gltf")
    (a, b, c) = TRIANGLE
    step = np.array([5, 2, 0])
    moved, turned = c + step, c[[1, 0, 2]] * [-1, 1, 1]
    expected = [a + step, b[[1, 0, 2]] * [-1, 1, 1], (moved + turned) / 2]
    np.testing.assert_allclose(mesh.vertices, expected, atol=1e-6)
    np.testing.assert_allclose(mesh.normals[:2], [[1, 0, 0], [0, 1, 0]], atol=1e-6)


def test_gltf_of_a_joint_that_is_not_there_is_refused(tmp_path: Path):
    write_skinned(tmp_path / "m.gltf", skins=[{"joints": [1, 7], "inverseBindMatrices": 3}])
    with pytest.raises(ibr.FileFormatError, match=r"m\.gltf"):
        ibr.Mesh.load(tmp_path / "m.gltf")


def test_gltf_tells_what_is_left_out(tmp_path: Path):
    write_skinned(tmp_path / "m.gltf")
    scene = json.loads((tmp_path / "m.gltf").read_text())
    scene["nodes"][0]["weights"] = [0.5]
    scene["materials"] = [{"alphaMode": "BLEND"}]  # without alphaMode, alpha is ignored
    scene["meshes"][0]["primitives"][0]["material"] = 0
    (tmp_path / "m.gltf").write_text(json.dumps(scene))
    with pytest.warns(UserWarning, match=r"m\.gltf: left out: morph targets, transparency"):
        ibr.Mesh.load(tmp_path / "m.gltf")
