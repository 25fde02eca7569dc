from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import MeshScene, capture, cube_cameras, object_views
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError
from pyibr.meshes.mesh import Mesh
from tests.boxes import cuboid
from tests.embree import rays_of
from tools.processes import run_python

o3d = pytest.importorskip("open3d")


def sphere(radius: float = 1.0, resolution: int = 200):
    mesh = o3d.geometry.TriangleMesh.create_sphere(radius, resolution)
    mesh.rotate(mesh.get_rotation_matrix_from_xyz((0.3, 0.5, 0.2)), center=(0, 0, 0))
    return mesh


def sphere_depth(camera: Camera, layer: str, radius: float = 1.0):
    """Depth of a sphere about the origin, in closed form; NaN where rays miss it."""
    origin, direction = np.split(rays_of(camera), 2, axis=1)
    a = np.sum(direction * direction, axis=-1)
    b = np.sum(origin * direction, axis=-1)
    c = np.sum(origin * origin, axis=-1) - radius**2
    root = np.sqrt(np.where(b * b - a * c < 0, np.nan, b * b - a * c))
    z = (-b - root) / a if layer == "first" else (-b + root) / a
    return z.reshape(camera.height, camera.width)


@pytest.mark.parametrize("layer", ["first", "last"])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_a_sphere_has_its_closed_form_depth(projection, layer):
    how = {"projection": projection, "height": 2.6} if projection == "orthographic" else {"fov_y": 45}
    camera = Camera.look_at((1, -2, -2.5), (0, 0.1, 0), (0, -1, 0), (61, 47), **how)
    view = capture(sphere(), camera, layer=layer)
    expected = sphere_depth(camera, layer)
    flat = np.nan_to_num(sphere_depth(camera, "last") - sphere_depth(camera, "first"))
    inside = flat > 0.3  # away from the silhouette, where the mesh's facets matter
    assert inside.mean() > 0.25
    np.testing.assert_allclose(view.depth[inside], expected[inside], rtol=3e-4)
    assert np.count_nonzero(view.valid != np.isfinite(expected)) <= 0.01 * view.valid.size
    assert (view.depth[~view.valid] == np.inf).all()


def test_a_plane_is_exact():
    vertices = np.array([[-9, -9, 2.0], [9, -9, 3.0], [-9, 9, 2.5], [9, 9, 3.5]])
    camera = Camera.look_at((0.3, 0.2, -4), (0, 0, 2.7), (0, -1, 0), (37, 29))
    view = MeshScene(vertices, [[0, 1, 2], [3, 2, 1]]).capture(camera)
    direction = rays_of(camera)[:, 3:]
    normal = np.cross(vertices[1] - vertices[0], vertices[2] - vertices[0])
    expected = ((vertices[0] - camera.center) @ normal) / (direction @ normal)
    np.testing.assert_allclose(view.depth.ravel(), expected, rtol=1e-7)


@pytest.mark.parametrize("kind", ["legacy", "tensor"])
def test_a_texture_is_read_as_open3d_reads_it(kind, tmp_path):
    texture = np.zeros((8, 8, 3), np.uint8)
    texture[:4, :4], texture[:4, 4:], texture[4:, :4] = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    o3d.io.write_image(str(tmp_path / "t.png"), o3d.geometry.Image(texture))
    (tmp_path / "a.mtl").write_text("newmtl m\nKd 1 1 1\nmap_Kd t.png\n")
    corners = "v 0 0 2\nv 8 0 2\nv 0 8 2\nv 8 8 2\nvt 0 1\nvt 1 1\nvt 0 0\nvt 1 0\n"
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\n{corners}usemtl m\nf 1/1 2/2 3/3\nf 4/4 3/3 2/2\n")
    path = str(tmp_path / "a.obj")
    mesh = o3d.io.read_triangle_mesh(path, True) if kind == "legacy" else o3d.t.io.read_triangle_mesh(path)
    # Pixel centres fall on texel centres; y runs down here, and v = 1 is an OBJ texture's top row.
    camera = Camera([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]], (8, 8), projection="orthographic")
    np.testing.assert_array_equal(capture(mesh, camera).color, texture)


def test_textures_and_vertex_colours_are_interpolated():
    vertices = [[0, 0, 2], [4, 0, 2], [0, 4, 2], [4, 4, 2]]
    faces = [[0, 1, 2], [3, 2, 1]]
    camera = Camera([[1, 0, 0], [0, 1, 0], [0, 0, 1]], (5, 5), projection="orthographic")
    ramp = np.array([[0, 0, 0], [200, 0, 0], [0, 100, 0], [200, 100, 0]], np.uint8)
    y, x = np.mgrid[:5, :5]
    expected = np.stack([50 * x, 25 * y, 0 * x], -1)
    np.testing.assert_array_equal(MeshScene(vertices, faces, colors=ramp).capture(camera).color, expected)
    np.testing.assert_array_equal(MeshScene(vertices, faces, colors=ramp / 255).capture(camera).color, expected)
    # A 2 x 2 texture, read between its texel centres at u, v = 0.25 and 0.75.
    uv = np.array([[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]])
    textured = MeshScene(vertices, faces, uv=uv, texture=ramp.reshape(2, 2, 3)).capture(camera)
    np.testing.assert_array_equal(textured.color, expected)
    per_corner = MeshScene(vertices, faces, uv=uv[np.array(faces)], texture=ramp.reshape(2, 2, 3))
    np.testing.assert_array_equal(per_corner.capture(camera).color, expected)


def test_background_and_shading():
    camera = Camera.look_at((0, 0, -4), (0, 0, 0), (0, -1, 0), (40, 30))
    view = capture(sphere(), camera, background=(10, 20, 30))
    assert (view.color[~view.valid] == (10, 20, 30)).all()
    top, bottom = view.color[8, 20].astype(int).sum(), view.color[21, 20].astype(int).sum()
    assert top > bottom + 100  # the light comes from above


def test_cube_cameras_share_their_edges():
    size = 9
    cameras = cube_cameras((1, 2, 3), size)
    index = np.arange(size)
    edges = {}
    for camera in cameras:
        for border in ([0, 1], [size - 1, 1], [1, 0], [1, size - 1]):
            x = index if border[1] != 1 else np.full(size, border[0])
            y = np.full(size, border[1]) if border[1] != 1 else index
            points = camera.unproject(np.stack([x, y], -1), np.ones(size)) - [1, 2, 3]
            np.testing.assert_array_equal(np.abs(points).max(axis=1), 1)
            edges.setdefault(tuple(sorted(map(tuple, points.tolist()))), []).append(camera)
    assert len(edges) == 12
    assert all(len(shared) == 2 for shared in edges.values())


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"vertices": [[0, 0]]}, "vertices"),
        ({"faces": [[0, 1, 3]]}, "faces"),
        ({"faces": [[0.0, 1.0, 2.0]]}, "faces"),
        ({"faces": np.zeros((0, 3), int)}, "faces"),
        ({"colors": [[0, 0, 0]]}, "colors"),
        ({"uv": [[0, 0]] * 3}, "uv"),
        ({"uv": [[0, 0]] * 4, "texture": np.zeros((2, 2, 3), np.uint8)}, "uv"),
        ({"uv": [[0, 0]] * 3, "texture": np.zeros((2, 2), np.uint8)}, "texture"),
    ],
)
def test_wrong_arrays_are_named(arguments, name):
    whole = {"vertices": [[0, 0, 1], [1, 0, 1], [0, 1, 1]], "faces": [[0, 1, 2]], **arguments}
    with pytest.raises(ArgumentError) as error:
        MeshScene(**whole)
    assert error.value.argument == name


def test_a_camera_that_sees_nothing_is_an_error():
    scene = MeshScene([[0, 0, 1], [1, 0, 1], [0, 1, 1]], [[0, 1, 2]])
    behind = Camera([[9, 0, 4], [0, 9, 4], [0, 0, 1]], (9, 9), np.diag([1.0, -1, -1, 1]))
    for how, word in (
        ({}, "camera"),
        ({"layer": "middle"}, "layer"),
        ({"layer": np.zeros(2)}, "layer"),
        ({"background": (300, 0, 0)}, "background"),
        ({"background": (-1, 0, 0)}, "background"),
        ({"background": (0, 0)}, "background"),
        ({"camera": behind.K}, "camera"),
    ):
        with pytest.raises(ArgumentError, match=word):
            scene.capture(**{"camera": behind} | how)
    with pytest.raises(ArgumentError, match="mesh"):
        capture("mesh.ply", behind)
    with pytest.raises(ArgumentError, match="size"):
        cube_cameras((0, 0, 0), 1)


@pytest.mark.thorough
def test_captures_and_proposals_need_no_open3d():
    code = """
import sys
sys.modules["open3d"] = None
from pyibr.capture import models, object_views
from pyibr.capture.proposal import propose_frusta
assert len(object_views(models.donut(), 32)) == 6
assert len(propose_frusta(models.donut(), 2, 32)) == 2
"""
    done = run_python("-c", code)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_six_views_see_a_box_from_its_six_sides(projection):
    mesh, size, margin = Mesh(*cuboid((1, 2, 3), (3, 3, 7))), 100, 0.05
    views = object_views(mesh, size, projection=projection, margin=margin)
    extents, middle = np.array([2.0, 1, 4]), np.array([2, 2.5, 5])
    edge = 4 * (1 + 2 * margin)
    assert len(views) == 6
    for number, view in enumerate(views):
        axis, sign = divmod(number, 2)
        expected = np.eye(3)[axis] * (1 if sign == 0 else -1)
        np.testing.assert_allclose(view.camera.forward, expected, atol=1e-12)
        assert view.camera.projection == projection
        # In the picture's middle, the front face is half an extent nearer than the object's middle. All of it is seen.
        z = np.dot(middle - view.camera.center, expected) - 0.5 * extents[axis]
        assert view.depth[size // 2, size // 2] == pytest.approx(z, rel=1e-6)
        across = np.delete(extents, axis)
        seen = np.sort([np.any(view.valid, axis=k).sum() for k in (0, 1)])
        if projection == "orthographic":
            np.testing.assert_allclose(seen, np.sort(across) / edge * size, atol=1.5)
        assert seen.max() <= size * (1 - margin)
        assert np.isinf(view.depth[~view.valid]).all()


@pytest.mark.parametrize(("argument", "value"), [("projection", "fisheye"), ("margin", -0.1), ("size", 0)])
def test_six_views_of_wrong_arguments(argument, value):
    with pytest.raises(ArgumentError, match=f"^{argument}: "):
        object_views(Mesh(*cuboid((0, 0, 0), (1, 1, 1))), **({"size": 8} | {argument: value}))


def test_a_mesh_is_captured_with_its_own_colours():
    camera = Camera([[20, 0, 5], [0, 20, 5], [0, 0, 1]], (11, 11))
    square = [[-1, -1, 3], [1, -1, 3], [-1, 1, 3], [1, 1, 3]]
    faces, uv = [[0, 1, 2], [3, 2, 1]], [[0, 0], [1, 0], [0, 1], [1, 1]]
    texture = np.full((2, 2, 3), (0.2, 0.4, 0.6), np.float32)
    tinted = Mesh(square, faces, colors=np.full((4, 3), (10, 20, 30), np.uint8))
    textured = Mesh(square, faces, uv=uv, texture=texture, colors=np.zeros((4, 3), np.uint8))
    np.testing.assert_array_equal(MeshScene.from_mesh(tinted).capture(camera).color[5, 5], (10, 20, 30))
    np.testing.assert_array_equal(MeshScene.from_mesh(textured).capture(camera).color[5, 5], (51, 102, 153))
    assert MeshScene.from_mesh(Mesh(square, faces, uv=uv)).capture(camera).valid.any()


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
@pytest.mark.parametrize("thickness", [0, 0.01])
def test_an_object_too_thin_for_six_views(projection, thickness):
    """A thin plate seen edge-on lies between two rows of pixels."""
    plate = Mesh(*cuboid((0, 0, 0), (1, 1, thickness)))
    with pytest.raises(ArgumentError, match=r"^mesh: expected .*thicker than a pixel.* got extents of 1, 1, "):
        object_views(plate, 64, projection=projection)
    if thickness:
        assert len(object_views(plate, 256, projection=projection)) == 6


def test_a_texture_repeats_as_it_does_when_the_mesh_is_drawn():
    texture = np.random.default_rng(0).integers(0, 256, (8, 8, 3), dtype=np.uint8)
    corners = [[-1, -1, 2], [1, -1, 2], [1, 1, 2], [-1, 1, 2]]
    uv = np.array([[-0.7, 0.2], [1.6, 0.2], [1.6, 2.4], [-0.7, 2.4]])
    mesh = Mesh(corners, [[0, 1, 2], [0, 2, 3]], uv=uv, texture=texture)
    camera = Camera([[100, 0, 60], [0, 100, 60], [0, 0, 1]], (121, 121))
    taken, drawn = capture(mesh, camera), ibr.render(mesh, camera)
    both = taken.valid & drawn.valid
    assert both.mean() > 0.6
    assert np.abs(taken.color.astype(int) - drawn.color)[both].max() <= 1


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_the_border_of_a_mesh_is_seen(projection):
    """Rays exactly at the outermost edges, some of which the ray caster lets slip through."""
    y, x = np.mgrid[:5, :5]
    first = (y[:-1, :-1] * 5 + x[:-1, :-1]).ravel()
    faces = np.concatenate([np.stack([first, first + 1, first + 5], 1), np.stack([first + 1, first + 6, first + 5], 1)])
    square = MeshScene(np.stack([x / 2 - 1, y / 2 - 1, 0 * x + 2.0], -1).reshape(-1, 3), faces)
    for size in (17, 33, 30):
        focal = (size - 5) / 2 * (2 if projection == "perspective" else 1)
        K = [[focal, 0, (size - 1) / 2], [0, focal, (size - 1) / 2], [0, 0, 1]]
        camera = Camera(K, (size, size), projection=projection)
        assert square.capture(camera).valid.sum() == (size - 4) ** 2
