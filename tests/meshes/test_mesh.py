"""Meshes: their arrays fit together, and errors name bad arrays and files."""

from __future__ import annotations

import gzip

import numpy as np
import pytest

import pyibr as ibr
from tests.data import shared

o3d = pytest.importorskip("open3d")

CORNERS = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
FACES = [[0, 1, 2], [0, 2, 3]]
UV = [[0, 1], [1, 1], [1, 0], [0, 0]]


def texture() -> np.ndarray:
    image = np.zeros((8, 16, 3), np.uint8)
    image[:4] = 250, 10, 20
    image[4:, :8] = 30, 240, 40
    return image


def test_what_is_kept():
    mesh = ibr.Mesh(CORNERS, FACES, uv=UV, normals=np.tile([0, 0, 3.0], (4, 1)), texture=texture())
    assert (mesh.vertices.dtype, mesh.faces.dtype, mesh.uv.dtype) == (np.float32, np.int32, np.float32)
    np.testing.assert_array_equal(mesh.normals, np.tile([0, 0, 1], (4, 1)))
    np.testing.assert_array_equal(mesh.bounds, [[0, 0, 0], [1, 1, 0]])
    assert repr(mesh) == "<Mesh 4 vertices, 2 triangles, texture 16x8>"
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertices[0] = 1


def test_uv_per_corner_splits_vertices_where_it_differs():
    per_corner = np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [0.5, 0.5], [0, 1]]])
    mesh = ibr.Mesh(CORNERS, FACES, uv=per_corner, colors=np.arange(12, dtype=np.uint8).reshape(4, 3))
    assert len(mesh.vertices) == 5  # vertex 2 has two different uv
    np.testing.assert_array_equal(mesh.uv[mesh.faces], per_corner)
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], np.array(CORNERS)[FACES])
    np.testing.assert_array_equal(mesh.colors[mesh.faces], np.arange(12).reshape(4, 3)[FACES])


def test_smooth_normals_are_those_of_a_sphere_and_cross_seams():
    sphere = o3d.geometry.TriangleMesh.create_sphere(1.0, 40)
    mesh = ibr.Mesh.from_open3d(sphere)
    # Triangles span an angle of pi / 40, and the mean normal around a vertex is off by at most that.
    assert (mesh.smooth_normals * mesh.vertices).sum(axis=1).min() >= np.cos(np.pi / 40)
    corners = np.random.default_rng(0).random((len(mesh.faces), 3, 2))
    split = ibr.Mesh(mesh.vertices, mesh.faces, uv=corners)
    np.testing.assert_allclose(split.smooth_normals[split.faces], mesh.smooth_normals[mesh.faces], atol=1e-6)


def test_normals_of_what_has_no_area():
    mesh = ibr.Mesh([[0, 0, 0], [1, 1, 1]], [[0, 0, 1]])
    np.testing.assert_array_equal(mesh.smooth_normals, np.tile([0, 0, 1], (2, 1)))


def test_open3d_there_and_back():
    made = ibr.Mesh(CORNERS, FACES, uv=UV, texture=texture())
    for mesh in (made.to_open3d(), made.to_open3d().to_legacy()):
        back = ibr.Mesh.from_open3d(mesh)
        np.testing.assert_allclose(back.uv[back.faces], made.uv[made.faces], atol=1e-6)
        np.testing.assert_array_equal(back.texture, made.texture)


@pytest.mark.thorough
def test_real_meshes():
    spot = ibr.Mesh.load(shared("meshes/spot/spot_triangulated.obj"))
    assert len(spot.faces) == 5856 and spot.uv is not None
    assert len(ibr.Mesh.load(shared("meshes/teapot.obj.gz")).faces) == 6320
    assert len(ibr.Mesh.load(shared("meshes/human_male_makehuman.obj.gz")).faces) == 26756


BAD = [
    ("vertices", {"vertices": [[0, 0], [1, 1], [2, 2]]}),
    ("vertices", {"vertices": [[0, 0, np.nan], [1, 1, 1], [2, 2, 2], [3, 3, 3]]}),
    ("faces", {"faces": [[0, 1, 4]]}),
    ("faces", {"faces": [[0, 1, -1]]}),
    ("faces", {"faces": [[0.0, 1.0, 2.0]]}),
    ("faces", {"faces": np.zeros((0, 3), int)}),
    ("uv", {"uv": [[0, 0]]}),
    ("uv", {"uv": np.zeros((3, 3, 2))}),
    ("uv", {"texture": np.zeros((2, 2, 3), np.uint8)}),
    ("normals", {"normals": np.zeros((4, 3))}),
    ("colors", {"colors": np.full((4, 3), 2.0, np.float32)}),
    ("colors", {"colors": np.zeros((3, 3), np.uint8)}),
    ("texture", {"uv": UV, "texture": np.zeros((2, 2), np.uint8)}),
    ("texture", {"uv": UV, "texture": np.zeros((0, 2, 3), np.uint8)}),
]


@pytest.mark.parametrize(("argument", "changes"), BAD)
def test_bad_arrays(argument, changes):
    with pytest.raises(ibr.ArgumentError, match=f"^{argument}: "):
        ibr.Mesh(**{"vertices": CORNERS, "faces": FACES, **changes})


def test_bad_files(tmp_path, capfd):
    (tmp_path / "empty.ply").touch()
    (tmp_path / "noise.obj").write_bytes(bytes(range(256)))
    (tmp_path / "noise.glb").write_bytes(bytes(range(256)))
    (tmp_path / "cut.ply").write_text("ply\nformat ascii 1.0\nelement vertex 9\nproperty float x\n")
    (tmp_path / "cut.ply.gz").write_bytes(gzip.compress(b"ply")[:-4])
    for name in ("missing.ply", "empty.ply", "noise.obj", "noise.glb", "cut.ply", "cut.ply.gz", "mesh.xyz"):
        with pytest.raises(ibr.FileFormatError, match=name):
            ibr.Mesh.load(tmp_path / name)
    textured = ibr.Mesh(CORNERS, FACES, uv=UV, texture=texture())
    with pytest.warns(UserWarning, match="square.ply: left out, as .ply cannot hold them: texture, uv"):
        textured.save(tmp_path / "square.ply")
    with pytest.raises(ibr.ArgumentError, match="ends in"):
        textured.save(tmp_path / "square.xyz")
    assert "Open3D" not in "".join(capfd.readouterr())


def test_attributes_go_through_open3d():
    heat = [[1.0], [2.0], [3.0]]
    mesh = ibr.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], attributes={"heat": heat})
    np.testing.assert_array_equal(ibr.Mesh.from_open3d(mesh.to_open3d()).attributes["heat"], heat)
    with pytest.raises(ibr.ArgumentError, match=r"attributes\['heat'\]: .*\(3,\)"):
        ibr.Mesh(mesh.vertices, mesh.faces, attributes={"heat": [1.0]})
