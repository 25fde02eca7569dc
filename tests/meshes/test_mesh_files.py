"""Mesh files: exchange with other programs, directions of axes, and several files for one mesh."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from pyibr.io import gltf
from tests.data import shared
from tests.io.others_meshes import SQUARE, accessor, write_gltf
from tests.io.specimens import COLORED, FACES, NORMALS, OTHERS, RNG, TEXTURED, VERTICES, WRITERS
from tools.processes import run_python

NAMES = ("vertices", "faces", "uv", "normals", "colors", "texture")


def assert_equal(one: ibr.Mesh, other: ibr.Mesh, *but: str) -> None:
    for name in set(NAMES) - set(but):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


@pytest.mark.parametrize("axes", ["opencv", "gltf"])
@pytest.mark.parametrize("name", ["textured.glb", "textured.obj", "c.glb", "c.obj", "c.ply", "c.off"])
def test_what_is_saved_is_loaded_to_the_bit(tmp_path: Path, name, axes):
    mesh = TEXTURED if name.startswith("textured") else COLORED
    mesh.save(tmp_path / "new" / "folder" / name, axes=axes)
    again = ibr.Mesh.load(tmp_path / "new" / "folder" / name, axes=axes)
    assert_equal(again, mesh, "normals")
    if not name.endswith(".off"):  # which has no normals
        np.testing.assert_allclose(again.normals, mesh.normals, atol=1e-7)  # normals are normalised again


def test_glb_has_gltf_axes_and_others_have_the_mesh_s_own(tmp_path: Path):
    """An object that is upright in OpenCV's world, whose y points down, is upright in a GLB file, whose y points up."""
    mesh = ibr.Mesh([[0, 0, 5], [1, 0, 5], [0, -2, 5]], [[0, 1, 2]], normals=[[0, 0, -1]] * 3)
    mesh.save(tmp_path / "m.glb")
    stored = gltf.read_mesh((tmp_path / "m.glb").read_bytes(), tmp_path)
    np.testing.assert_array_equal(stored.vertices, [[0, 0, -5], [1, 0, -5], [0, 2, -5]])
    np.testing.assert_array_equal(stored.normals, [[0, 0, 1]] * 3)
    assert_equal(ibr.Mesh.load(tmp_path / "m.glb"), mesh)
    own = ibr.Mesh(stored.vertices, mesh.faces)  # a mesh in a world with y up
    own.save(tmp_path / "own.glb", axes="gltf")
    assert_equal(ibr.Mesh.load(tmp_path / "own.glb", axes="gltf"), own)
    np.testing.assert_array_equal(ibr.Mesh.load(tmp_path / "own.glb").vertices, mesh.vertices)
    for suffix in (".ply", ".obj", ".off", ".stl"):
        for axes in ("opencv", "gltf"):
            mesh.save(tmp_path / f"m{suffix}", axes=axes)
            np.testing.assert_array_equal(ibr.Mesh.load(tmp_path / f"m{suffix}").vertices, mesh.vertices)
    for use in (lambda: mesh.save(tmp_path / "m.glb", axes="up"), lambda: ibr.Mesh.load(tmp_path / "m.glb", axes="up")):
        with pytest.raises(ibr.ArgumentError, match=r"^axes: "):
            use()


@pytest.mark.parametrize("suffix", [".glb", ".obj", ".ply", ".off", ".stl"])
def test_open3d_reads_the_same(tmp_path: Path, suffix):
    o3d = pytest.importorskip("open3d")
    mesh = COLORED if suffix in (".ply", ".off") else TEXTURED if suffix != ".stl" else ibr.Mesh(VERTICES, FACES)
    mesh.save(tmp_path / f"m{suffix}", axes="gltf")
    theirs = o3d.io.read_triangle_mesh(str(tmp_path / f"m{suffix}"), enable_post_processing=False)
    corners = np.asarray(theirs.vertices)[np.asarray(theirs.triangles)]
    np.testing.assert_allclose(corners, mesh.vertices[mesh.faces], atol=1e-6)
    if mesh is COLORED:
        np.testing.assert_allclose(np.asarray(theirs.vertex_colors) * 255, mesh.colors, atol=0.51)
    if mesh is TEXTURED:
        uv = np.asarray(theirs.triangle_uvs) * (1, -1) + (0, 1)
        np.testing.assert_allclose(uv, mesh.uv[mesh.faces].reshape(-1, 2), atol=1e-6)


def test_meshes_need_no_open3d(tmp_path: Path):
    code = "import sys; sys.modules['open3d'] = None\nimport pyibr as ibr\nfrom tests.io.specimens import *\n"
    code += "from pathlib import Path\nfor suffix in ('.glb', '.obj', '.ply', '.off'):\n"
    code += "    path = Path(sys.argv[1], 'm' + suffix); COLORED.save(path); print(len(ibr.Mesh.load(path).faces))"
    done = run_python("-c", code, tmp_path)
    assert done.stdout.split() == ["40"] * 4, done.stderr


# ---- PLY


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_of_polygons_with_other_columns_and_tables(tmp_path: Path, form):
    head = f"ply\r\nformat {form} 1.0\r\ncomment any\r\nelement vertex 4\r\nproperty double x\r\nproperty double y\r\n"
    head += "property uchar flag\r\nproperty double z\r\nproperty float red\r\nproperty float green\r\n"
    head += "property float blue\r\nelement face 2\r\nproperty uchar material\r\n"
    head += "property list uchar int vertex_index\r\nproperty list uchar float texcoord\r\n"
    head += "element edge 1\r\nproperty int from\r\nend_header\r\n"
    vertices = [(*point[:2], 7, point[2], 0, 0.5, 1) for point in SQUARE]
    faces = [(1, 4, 0, 1, 2, 3, 2, 0.5, 0.25), (2, 3, 0, 2, 3, 0)]
    if form == "ascii":
        body = "".join(" ".join(map(str, row)) + "\r\n" for row in (*vertices, *faces, (5,))).encode()
    else:
        order = "<" if "little" in form else ">"
        kinds = ["f8", "f8", "u1", "f8", "f4", "f4", "f4"]
        body = np.array(vertices, [(str(i), order + kind) for i, kind in enumerate(kinds)]).tobytes()
        kinds = ["u1", "u1", *["i4"] * 4, "u1", "f4", "f4"]
        body += np.array(faces[:1], [(str(i), order + kind) for i, kind in enumerate(kinds)]).tobytes()
        kinds = ["u1", "u1", *["i4"] * 3, "u1"]
        body += np.array(faces[1:], [(str(i), order + kind) for i, kind in enumerate(kinds)]).tobytes()
        body += np.array([5], order + "i4").tobytes()
    (tmp_path / "m.ply").write_bytes(head.encode() + body)
    with pytest.warns(UserWarning, match=r"m\.ply: left out: uv of faces"):
        mesh = ibr.Mesh.load(tmp_path / "m.ply")
    np.testing.assert_array_equal(mesh.vertices, SQUARE)
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 2, 3], [0, 2, 3]])
    np.testing.assert_array_equal(mesh.colors, [[0, 128, 255]] * 4)


# ---- OFF and STL


@pytest.mark.parametrize(
    "text",
    [
        "OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n",
        "# made by hand\nOFF 4 2 5\n\n0 0 0\n1 0 0 # right\n1 1 0\n0 1 0\n3 0 1 2 # first\n3 0 2 3",
        "OFF4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n",
        "COFF\n4 1\n0 0 0 1.0 0 0 1\n1 0 0 1.0 0 0 1\n1 1 0 1.0 0 0 1\n0 1 0 1.0 0 0 1\n4 0 1 2 3\n",
        "NOFF\n4 1 0\n0 0 0 0 0 1\n1 0 0 0 0 1\n1 1 0 0 0 1\n0 1 0 0 0 1\n4 0 1 2 3\n",
    ],
)
def test_off_of_others(tmp_path: Path, text):
    (tmp_path / "m.off").write_text(text)
    mesh = ibr.Mesh.load(tmp_path / "m.off")
    np.testing.assert_array_equal(mesh.vertices, SQUARE)
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 2, 3]])
    assert (mesh.colors is None) == ("COFF" not in text)
    assert mesh.colors is None or (mesh.colors == [255, 0, 0]).all()
    assert (mesh.normals is None) == ("NOFF" not in text)


CUT = [("text.ply", 1), ("text.ply", 17), ("colored.off", 1), ("text.stl", 4), ("colored.obj", 3)]


@pytest.mark.parametrize(("name", "lines"), CUT)
def test_a_part_of_a_file_is_no_smaller_mesh(tmp_path: Path, name, lines):
    file = tmp_path / name
    (WRITERS | OTHERS)[name](file)
    ibr.Mesh.load(file)
    file.write_text("".join(file.read_text().splitlines(keepends=True)[:-lines]))
    with pytest.raises(ibr.FileFormatError, match=name):
        ibr.Mesh.load(file)


# ---- OBJ


def test_obj_of_others(tmp_path: Path):
    (tmp_path / "m.obj").write_text(
        "mtllib the materials.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt 0.5 0.5\n"
        "vn 0 0 1\ng one\nusemtl bare\nf 1/1/1 2/2/1 3/3/1\nusemtl shown\nf -4/-5/-1 \\\n-2/-3/-1 -1/-1/-1\n"
    )
    (tmp_path / "the materials.mtl").write_text("newmtl bare\nKd 1 0 0\nnewmtl shown\nmap_Kd -s 1 1 1 folder\\t.png\n")
    (tmp_path / "folder").mkdir()
    ibr.write_color(tmp_path / "folder" / "t.png", TEXTURED.texture)
    with pytest.warns(UserWarning, match=r"m\.obj: left out: colours of materials without a texture"):
        mesh = ibr.Mesh.load(tmp_path / "m.obj")
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], np.array(SQUARE, float)[[[0, 1, 2], [0, 2, 3]]])
    np.testing.assert_array_equal(mesh.uv[mesh.faces], [[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0.5, 0.5]]])
    np.testing.assert_array_equal(mesh.normals, [[0, 0, 1]] * len(mesh.vertices))
    np.testing.assert_array_equal(mesh.texture, TEXTURED.texture)
    (tmp_path / "folder" / "t.png").write_bytes(b"damaged")
    with pytest.raises(ibr.FileFormatError, match=r"m\.obj"):
        ibr.Mesh.load(tmp_path / "m.obj")
    (tmp_path / "folder" / "t.png").unlink()
    with pytest.warns(UserWarning, match="the mesh is read without it|left out"):
        assert ibr.Mesh.load(tmp_path / "m.obj").texture is None


def test_the_files_of_an_obj_belong_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Wherever saving a second mesh is interrupted, the files together hold the first mesh or the second."""
    file = tmp_path / "m.obj"
    other = ibr.Mesh(VERTICES + 1, FACES, uv=TEXTURED.uv, normals=NORMALS, texture=255 - TEXTURED.texture)
    replace = Path.replace
    for renames in range(4):
        TEXTURED.save(file)
        left = [renames]

        def counted(self: Path, target: Path, left: list[int] = left) -> Path:
            left[0] -= 1
            if left[0] < 0:
                raise OSError("the power failed")
            return replace(self, target)

        with monkeypatch.context() as patch:
            patch.setattr(Path, "replace", counted)
            if renames < 3:
                with pytest.raises(ibr.FileFormatError, match="power"):
                    other.save(file)
            else:
                other.save(file)
        assert_equal(ibr.Mesh.load(file), other if renames == 3 else TEXTURED, "normals")
        for path in tmp_path.iterdir():
            path.unlink()


def test_a_texture_is_not_written_over_another_picture_of_it(tmp_path: Path):
    """That file may be the input of `pyibr mesh`, a better compressed texture of an earlier mesh."""
    from PIL import Image

    TEXTURED.save(tmp_path / "m.obj")
    texture = next(tmp_path.glob("m-*.png"))
    Image.open(texture).save(texture, optimize=True, compress_level=1)
    packed = texture.read_bytes()
    TEXTURED.save(tmp_path / "m.obj")
    assert texture.read_bytes() == packed


@pytest.mark.parametrize(
    "stem", ["a b", "  a ", "new\nline", "\rv 1 2 3", "a\\b", "-s 1", "#a", "\x85a", "\u2028", "\N{SNOWMAN}", "\udcff"]
)
def test_obj_files_of_any_name_have_their_texture(tmp_path: Path, stem):
    TEXTURED.save(tmp_path / f"{stem}.obj")
    assert_equal(ibr.Mesh.load(tmp_path / f"{stem}.obj"), TEXTURED, "normals")


# ---- glTF


@pytest.mark.parametrize("inline", [True, False])
def test_gltf_scene_of_several_primitives_in_their_places(tmp_path: Path, inline):
    points, strip = np.array(SQUARE, np.float32), np.array([0, 1, 3, 2], np.uint16)
    interleaved = np.hstack([points, np.tile(np.float32([0, 0, 1]), (4, 1))])
    arrays = [interleaved, strip, np.array([0, 1, 2, 3], np.uint8)]
    half = np.sqrt(0.5)
    given = {"attributes": {"POSITION": 0, "NORMAL": 1}}
    write_gltf(
        tmp_path / "m.gltf",
        arrays,
        inline,
        stride=24,
        accessors=[
            *(accessor(0, points, "VEC3"), accessor(0, points, "VEC3", byteOffset=12)),
            *(accessor(1, strip, "SCALAR"), accessor(2, arrays[2], "SCALAR")),
        ],
        meshes=[
            {"primitives": [given | {"indices": 2, "mode": 5}]},
            {"primitives": [given | {"indices": 3, "mode": 6}, given | {"mode": 0}]},
        ],
        nodes=[
            {"children": [1, 2], "translation": [10, 0, 0]},
            {"mesh": 0, "rotation": [0, 0, half, half]},  # a quarter turn about z, from x to y
            {"mesh": 1, "matrix": [-2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 5, 1]},  # column by column; mirrors x
        ],
        scene=0,
        scenes=[{"nodes": [0]}],
    )
    with pytest.warns(UserWarning, match="left out: points and lines"):
        mesh = ibr.Mesh.load(tmp_path / "m.gltf", axes="gltf")
    corners = mesh.vertices[mesh.faces]
    turned, mirrored = points[:, [1, 0, 2]] * [-1, 1, 1] + [10, 0, 0], points * [-2, 1, 1] + [10, 0, 5]
    np.testing.assert_allclose(corners[:2], turned[[[0, 1, 3], [3, 1, 2]]], atol=1e-6)
    np.testing.assert_allclose(corners[2:], mirrored[[[2, 1, 0], [3, 2, 0]]], atol=1e-6)
    np.testing.assert_allclose(mesh.normals, [[0, 0, 1]] * 8, atol=1e-6)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (across[:, 2] > 0).all()


def test_gltf_small_numbers_sparse_ones_and_moved_textures(tmp_path: Path):
    points = np.array([[0, 0, 0], [127, 0, 0], [127, 127, 0], [0, 127, 0]], np.int8)
    padded = np.hstack([points, np.zeros((4, 1), np.int8)])  # glTF aligns entries to 4 bytes
    uv = np.array([[0, 0], [65535, 0], [65535, 65535], [0, 65535]], np.uint16)
    places, others = np.array([2], np.uint8), np.array([[64, 64, 0, 0]], np.int8)
    texture = np.frombuffer(gltf.image.encoded(TEXTURED.texture, ".png"), np.uint8)
    sparse = {"count": 1, "indices": {"bufferView": 2, "componentType": 5121}, "values": {"bufferView": 3}}
    moved = {"offset": [0.5, 0.25], "rotation": np.pi / 2, "scale": [0.5, 2]}
    painted = {"index": 0, "texCoord": 1, "extensions": {"KHR_texture_transform": moved}}
    write_gltf(
        tmp_path / "m.gltf",
        [padded, uv, places, others[:, :3], texture],
        stride=4,
        extensionsRequired=["KHR_mesh_quantization", "KHR_texture_transform"],
        accessors=[
            accessor(0, padded, "VEC3", normalized=True, sparse=sparse),
            accessor(1, uv, "VEC2", normalized=True),
            accessor(0, padded, "SCALAR"),
        ],
        meshes=[{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_1": 1}, "material": 0, "mode": 6}]}],
        nodes=[{"mesh": 0}],
        materials=[{"pbrMetallicRoughness": {"baseColorTexture": painted}}],
        textures=[{"source": 0}],
        images=[{"bufferView": 4, "mimeType": "image/png"}],
    )
    mesh = ibr.Mesh.load(tmp_path / "m.gltf", axes="gltf")
    np.testing.assert_allclose(mesh.vertices, [[0, 0, 0], [1, 0, 0], [64 / 127, 64 / 127, 0], [0, 1, 0]], atol=1e-6)
    # The texture is turned counter-clockwise by a quarter. As v grows downwards, this takes u to -v and v to u.
    np.testing.assert_allclose(mesh.uv, [[0.5, 0.25], [0.5, -0.25], [2.5, -0.25], [2.5, 0.25]], atol=1e-6)
    np.testing.assert_array_equal(mesh.texture, TEXTURED.texture)


def test_gltf_vertex_colours_are_linear_in_light(tmp_path: Path):
    """In sRGB, 188 is half as much light as 255."""
    colors = np.array([[0, 188, 255]] * 3, np.uint8)
    ibr.Mesh(SQUARE[:3], [[0, 1, 2]], colors=colors).save(tmp_path / "m.glb")
    data = (tmp_path / "m.glb").read_bytes()
    length = int.from_bytes(data[12:16], "little")
    scene = json.loads(data[20 : 20 + length])
    colored = scene["accessors"][scene["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"]]
    view = scene["bufferViews"][colored["bufferView"]]
    stored = np.frombuffer(data, "<f4", 9, 28 + length + view["byteOffset"]).reshape(3, 3)
    np.testing.assert_allclose(stored, [[0, 0.5, 1]] * 3, atol=0.003)
    every = np.repeat(np.arange(256, dtype=np.uint8), 3).reshape(256, 3)
    ibr.Mesh(RNG.random((256, 3)), [[0, 1, 2]], colors=every).save(tmp_path / "m.glb")
    np.testing.assert_array_equal(ibr.Mesh.load(tmp_path / "m.glb").colors, every)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "KHR_draco_mesh_compression"),
        ({"asset": {"version": "1.0"}}, "glTF 2.0"),
        ({"buffers": [{"byteLength": 48, "uri": "all%20gone.bin"}]}, r"all%20gone\.bin is missing"),
        ({"nodes": []}, "no triangles"),
        ({"nodes": [{"mesh": -1}]}, r"meshes\[-1\]"),
        ({"nodes": [{"mesh": 0, "children": [0]}], "scenes": [{"nodes": [0]}]}, "occurs twice"),
    ],
)
def test_gltf_that_is_refused(tmp_path: Path, changes, reason):
    points = np.array(SQUARE, np.float32)
    scene = {
        "accessors": [accessor(0, points, "VEC3")],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 6}]}],
        "nodes": [{"mesh": 0}],
    }
    write_gltf(tmp_path / "m.gltf", [points], **(scene | changes))
    with pytest.raises(ibr.FileFormatError, match=rf"m\.gltf: .*{reason}"):
        ibr.Mesh.load(tmp_path / "m.gltf")


@pytest.mark.thorough
def test_a_real_glb():
    duck = ibr.Mesh.load(shared("formats/gltf/Duck_three_exporter.glb"))
    assert (len(duck.faces), duck.texture.shape) == (4212, (512, 512, 3))
    low, high = duck.bounds
    assert low[1] < -1 < 0 <= high[1] + 0.1  # low y is up, where the head is
