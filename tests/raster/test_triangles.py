"""The rasteriser compared with rays by Embree, and its guarantees: no cracks, no pixel twice, correct clipping."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from tests.data import shared
from tests.displaced import interior
from tests.embree import embree, rays_of
from tests.reference.raster import depths, edge_distances
from tests.scenes import pose

pytest.importorskip("open3d")

MESHES = ["meshes/dragon_vrip_res3.ply.gz", "meshes/teapot.obj.gz", "meshes/human_male_makehuman.obj.gz"]


def numbered(mesh: ibr.Mesh) -> ibr.Mesh:
    """The mesh's triangles without shared vertices, each in a colour that encodes its index."""
    number = np.arange(len(mesh.faces))
    color = np.stack([number & 255, number >> 8 & 255, number >> 16], axis=-1).astype(np.uint8)
    return ibr.Mesh(
        mesh.vertices[mesh.faces].reshape(-1, 3),
        np.arange(3 * len(mesh.faces)).reshape(-1, 3),
        colors=color.repeat(3, 0),
    )


def numbers_of(frame: ibr.Frame) -> np.ndarray:
    c = frame.color.astype(int)
    return np.where(frame.valid, c[..., 0] | c[..., 1] << 8 | c[..., 2] << 16, -1)


def cast(mesh: ibr.Mesh, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """True depth, inf where a ray hits nothing, and the index of the triangle that is hit, or -1."""
    hits, shape = embree(mesh).cast_rays(rays_of(camera).astype(np.float32)), (camera.height, camera.width)
    found = hits["primitive_ids"].numpy().reshape(shape).astype(np.int64)
    return hits["t_hit"].numpy().reshape(shape), np.where(found == 0xFFFFFFFF, -1, found)


def around(mesh: ibr.Mesh, projection: str, direction: tuple[float, float, float], size: tuple[int, int]) -> Camera:
    low, high = (corner.astype(float) for corner in mesh.bounds)
    middle, extent = 0.5 * (low + high), float(np.linalg.norm(high - low))
    away = np.array(direction) / np.linalg.norm(direction)
    up = (0, 1, 0) if abs(away[1]) < 0.9 else (0, 0, 1)
    camera = Camera.look_at(middle + 1.4 * extent * away, middle, up, size, fov_y=40)
    if projection == "perspective":
        return camera
    scale = min(size) / extent
    K = [[scale, 0, (size[0] - 1) / 2], [0, scale, (size[1] - 1) / 2], [0, 0, 1]]
    return Camera(K, size, camera.world_from_camera, projection="orthographic")


def corners(mesh: ibr.Mesh, number: np.ndarray) -> np.ndarray:
    """Corners (n, 3, 3) of triangles, in float64."""
    return mesh.vertices.astype(np.float64)[mesh.faces[number]]


def check_against_embree(mesh: ibr.Mesh, camera: Camera) -> None:
    depth, number = cast(mesh, camera)
    frame = ibr.render(numbered(mesh), camera)
    drawn = numbers_of(frame)
    extent = float(np.linalg.norm(mesh.bounds[1] - mesh.bounds[0]))
    inside = interior(depth, 0.02 * extent)
    assert inside.sum() > 1000
    same = inside & (drawn == number)
    assert same.sum() >= 0.995 * inside.sum()
    # 1e-4: float32 rounds positions of up to 1280 pixels, and triangles are as small as a pixel.
    np.testing.assert_allclose(frame.depth[same], depth[same], rtol=1e-4)
    assert (frame.valid != np.isfinite(depth)).mean() <= 1e-4  # 1 of 1000 outline pixels
    # At other pixels, an edge passes within 1/256 pixel, since corners are moved by 1/512, or depths are equal.
    y, x = np.nonzero((drawn != number) & (drawn >= 0) & (number >= 0))
    pixels = np.stack([x, y], axis=-1).astype(np.float64)
    one, other = corners(mesh, drawn[y, x]), corners(mesh, number[y, x])
    edge = np.minimum(*(np.abs(edge_distances(camera, c, pixels)).min(axis=1) for c in (one, other)))
    equal = np.abs(depths(camera, one, pixels) / depths(camera, other, pixels) - 1) < 1e-5
    assert ((edge < 1 / 256) | equal).all()
    assert (edge_distances(camera, one, pixels).min(axis=1) > -1 / 256).all()


@pytest.mark.thorough
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("name", MESHES)
def test_the_visible_triangle_is_embrees(name, projection):
    mesh = ibr.Mesh.load(shared(name))
    for direction in ((0.3, 0.4, 1), (-1, 0.1, -0.4), (0.1, 1, 0.2)):
        check_against_embree(mesh, around(mesh, projection, direction, (480, 360)))


@pytest.mark.thorough
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_the_visible_one_of_many_triangles_is_embrees(projection):
    """Triangles are as small as pixels. At half this resolution, 1 of 200 pixels would have an edge within 1/256."""
    mesh = ibr.Mesh.load(shared("meshes/dragon_vrip.ply.gz"))
    check_against_embree(mesh, around(mesh, projection, (0.3, 0.4, 1), (1280, 960)))


def split(columns: int, rows: int, rng: np.random.Generator) -> np.ndarray:
    """Faces of a grid of vertices; each cell is split along a random one of its diagonals."""
    i = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    flip = rng.random(len(i))[:, None] < 0.5
    a, b, c, d = i, i + 1, i + columns, i + columns + 1
    one = np.where(flip, np.stack([a, b, c], 1), np.stack([a, b, d], 1))
    two = np.where(flip, np.stack([b, d, c], 1), np.stack([a, d, c], 1))
    return np.concatenate([one, two])


def patchwork(projection: str, thin: float, seed: int = 0) -> tuple[ibr.Mesh, Camera]:
    """A grid of cells over pixels 3 to 43, whose corners are moved by multiples of half a pixel.

    So some corners and edges lie exactly on pixel centres. If given, every other row and column is `thin` pixels wide.
    """
    rng = np.random.default_rng(seed)
    n = 9
    y, x = np.mgrid[:n, :n] * 5.0 + 3
    x[1:-1, 1:-1] += rng.integers(-3, 4, (n - 2, n - 2)) * 0.5
    y[1:-1, 1:-1] += rng.integers(-3, 4, (n - 2, n - 2)) * 0.5
    if thin:
        place = np.repeat(np.arange(n), 2)[1:-1]
        moved = thin * (np.arange(len(place)) % 2 == 0)
        x = x[np.ix_(place, place)] + np.where((place > 0) & (place < n - 1), moved, 0)
        y = y[np.ix_(place, place)] + np.where((place > 0) & (place < n - 1), moved, 0)[:, None]
    camera = Camera([[40, 0, 3], [0, 40, 3], [0, 0, 1]], (47, 47), projection=projection)
    points = camera.unproject(np.stack([x, y], axis=-1).reshape(-1, 2), rng.uniform(2, 9, x.size))
    return ibr.Mesh(points, split(len(x), len(x), rng)), camera


def times_covered(mesh: ibr.Mesh, camera: Camera) -> np.ndarray:
    """(H, W) number of triangles that cover each pixel; each triangle is drawn alone."""
    covered = np.zeros((camera.height, camera.width), int)
    for face in mesh.faces:
        covered += ibr.render(ibr.Mesh(mesh.vertices, [face]), camera).valid
    return covered


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("thin", [0, 0.3, 1 / 100, 1 / 1000])
def test_no_crack_and_no_pixel_twice(projection, thin):
    mesh, camera = patchwork(projection, thin, seed=int(1000 * thin))
    covered = times_covered(mesh, camera)
    # Pixels 3 and 43 are on the mesh's border, where rounding of the projection decides.
    assert (covered[4:43, 4:43] == 1).all()
    assert covered.max() == 1
    assert ibr.render(mesh, camera).valid[4:43, 4:43].all()


def below(camera: Camera, mesh: ibr.Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Depth of the plane y = 1 at each pixel, and the pixels that see it at least 0.02 inside the mesh's bounds."""
    origin, ahead = np.split(rays_of(camera), 2, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = (1 - origin[:, 1]) / ahead[:, 1]
        met = origin + depth[:, None] * ahead
    low, high = mesh.bounds
    within = ((met > low + 0.02) & (met < high - 0.02))[:, [0, 2]].all(axis=1) & (depth > 0.01)
    shape = camera.height, camera.width
    return depth.reshape(shape), within.reshape(shape)


def floor_of(cells: int, sides: tuple[float, float], jitter: tuple[float, float], rng: np.random.Generator) -> ibr.Mesh:
    """A grid of `cells` x `cells` squares in the plane y = 1, around x = z = 0, with corners moved at random.

    sides: the cells' extent along x and z. jitter: largest move along x and z, as fractions of `sides`.
    """
    n = cells + 1
    z, x = np.mgrid[:n, :n] - cells / 2
    for along, part in ((x, jitter[0]), (z, jitter[1])):
        along[1:-1, 1:-1] += rng.uniform(-part, part, (n - 2, n - 2))
    x, z = x * sides[0], z * sides[1]
    return ibr.Mesh(np.stack([x, np.ones_like(x), z], axis=-1).reshape(-1, 3), split(n, n, rng))


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("pitch", [0, 40])
@pytest.mark.parametrize("jitter", [(0, 0), (0, 0.3), (0.3, 0.3)], ids=str)
@pytest.mark.usefixtures("lanes")
def test_no_crack_where_triangles_pass_the_camera(projection, pitch, jitter):
    """A floor reaches from behind the camera to in front of it.

    Without jitter, edges along z pass exactly through pixel centres; with jitter along z, they do up to rounding.
    """
    floor = floor_of(6, (0.5, 4), jitter, np.random.default_rng(1))
    f = 100.3 if projection == "perspective" else 40
    camera = Camera([[f, 0, 80], [0, f, 60], [0, 0, 1]], (161, 121), pose(pitch=-pitch), projection=projection)
    depth, within = below(camera, floor)
    assert within.sum() > 2000 or (pitch == 0 and projection == "orthographic")  # sees the floor edge-on
    frame, covered = ibr.render(floor, camera), times_covered(floor, camera)
    assert (covered[within] == 1).all()
    assert frame.valid[within].all()
    # 1e-4: planes in float32, of oblique triangles that reach 12 units behind the camera and to its side.
    np.testing.assert_allclose(frame.depth[within], depth[within], rtol=1e-4)
    assert not frame.valid[depth < 0].any()


@pytest.mark.parametrize("seed", [3, *(pytest.param(seed, marks=pytest.mark.thorough) for seed in (0, 1, 2, 4, 5))])
def test_no_crack_between_triangles_that_pass_the_camera_and_others(seed):
    """Only at few of 7 million pixels, an edge passes so close that its two triangles might both miss the centre."""
    floor = floor_of(12, (2, 2), (0.3, 0.3), np.random.default_rng(seed))
    camera = Camera([[600, 0, 640], [0, 600, 480], [0, 0, 1]], (1281, 961), pose(pitch=-60, roll=10 * seed))
    _, within = below(camera, floor)
    assert ibr.render(floor, camera).valid[within].all()


def test_the_floor_up_to_the_horizon():
    """Two triangles, with corners far behind the camera, have the depth of their plane."""
    floor = ibr.Mesh([[-500, 1, -50], [500, 1, -50], [500, 1, 50], [-500, 1, 50]], [[0, 1, 2], [0, 2, 3]])
    camera = Camera([[60, 0, 79.5], [0, 60, 59.5], [0, 0, 1]], (160, 120))
    frame = ibr.render(floor, camera)
    y = np.arange(120) - 59.5
    depth = np.where(y > 0, 60 / np.where(y > 0, y, 1), np.inf)
    seen = depth < 49  # the floor ends at 50
    np.testing.assert_allclose(frame.depth[seen], np.tile(depth[seen, None], (1, 160)), rtol=1e-4)
    assert not frame.valid[depth > 50].any()


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_slivers_stay_between_their_corners(projection):
    """Depth and colour of slivers, seen nearly edge-on, stay within the range of their corners'."""
    rng = np.random.default_rng(0)
    n = 3000
    camera = Camera([[400, 0, 160], [0, 400, 120], [0, 0, 1]], (320, 240), projection=projection)
    a, along, part = rng.uniform((0, 0), (320, 240), (n, 2)), rng.uniform(-60, 60, (n, 2)), rng.random((n, 1))
    place = np.stack([a, a + along, a + part * along + 0.01 * rng.normal(size=(n, 2))], axis=1)
    z = rng.uniform(2, 9, (n, 3))
    points = camera.unproject(place.reshape(-1, 2), z.ravel())
    # Red is 100 or 101 at each corner; green and blue encode the triangle's index.
    color = np.column_stack(
        [rng.integers(100, 102, 3 * n), *(np.arange(n).repeat(3) // (1, 256)[k] % 256 for k in (0, 1))]
    )
    frame = ibr.render(ibr.Mesh(points, np.arange(3 * n).reshape(-1, 3), colors=color.astype(np.uint8)), camera)
    red, green, blue = frame.color[frame.valid].T.astype(int)
    low, high = z.min(axis=1)[green + 256 * blue], z.max(axis=1)[green + 256 * blue]
    depth = frame.depth[frame.valid]
    assert len(depth) > 200
    assert ((depth > low * (1 - 1e-5)) & (depth < high * (1 + 1e-5))).all()
    assert ((red == 100) | (red == 101)).all()


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_what_lies_behind_the_camera_is_not_seen(projection):
    behind = ibr.Mesh([[-5, -5, -2], [5, -5, -2], [0, 5, -2]], [[0, 1, 2], [0, 2, 1]])
    camera = Camera([[20, 0, 30], [0, 20, 18], [0, 0, 1]], (61, 37), projection=projection)
    assert not ibr.render(behind, camera).valid.any()


DEGENERATE = {
    "a point": [[0, 0, 3]] * 3,
    "a line": [[-1, -1, 3], [0, 0, 3], [1, 1, 3]],
    "seen from its edge": [[0, 0, 2], [0, 0, 3], [0.3, 0.3, 4]],
}


@pytest.mark.parametrize("points", DEGENERATE.values(), ids=DEGENERATE)
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_degenerate_triangles_draw_nothing(points, projection):
    camera = Camera([[20, 0, 15], [0, 20, 15], [0, 0, 1]], (31, 31), projection=projection)
    wall = [[-1, -1, 5], [1, -1, 5], [0, 1, 5]]
    alone = ibr.render(ibr.Mesh(wall, [[0, 1, 2]]), camera)
    both = ibr.render(ibr.Mesh([*points, *wall], [[0, 1, 2], [0, 0, 1], [3, 4, 5]]), camera)
    assert alone.valid.any()
    np.testing.assert_array_equal(alone.depth, both.depth)
    assert not ibr.render(ibr.Mesh(points, [[0, 1, 2]]), camera).valid.any()


def test_culling():
    points, faces = [[0, 0, 3], [0, 1, 3], [1, 0, 3]], [[0, 1, 2]]  # the normal, -z, points towards the camera
    camera = Camera([[20, 0, 5], [0, 20, 5], [0, 0, 1]], (30, 30))
    for sides, seen in (("both", True), ("front", True), ("back", False)):
        assert ibr.render(ibr.Mesh(points, faces, sides=sides), camera).valid.any() == seen
    with pytest.raises(ibr.ArgumentError, match=r"^sides: "):
        ibr.Mesh(points, faces, sides="left")


def test_a_triangle_that_passes_the_camera_shows_one_of_its_sides():
    """Wherever its corners are, a triangle shows the side of its plane on which the camera lies."""
    camera = Camera([[20, 0, 15], [0, 20, 12], [0, 0, 1]], (31, 25))
    passing = 0
    for points in np.random.default_rng(0).uniform((-3, -3, -3), (3, 3, 4), (300, 3, 3)):
        frames = {s: ibr.render(ibr.Mesh(points, [[0, 1, 2]], sides=s), camera) for s in ("both", "front", "back")}
        normal = np.cross(points[1] - points[0], points[2] - points[0])
        seen = "front" if normal @ points[0] < 0 else "back"
        np.testing.assert_array_equal(frames[seen].depth, frames["both"].depth)
        assert not frames["back" if seen == "front" else "front"].valid.any()
        passing += frames["both"].valid.any() and points[:, 2].min() < 0
    assert passing > 50


def test_slivers_are_not_culled_away():
    """Rounding corners to subpixels may turn slivers over: binning, which rounds, must not decide which side shows."""
    rng = np.random.default_rng(0)
    camera = Camera([[800, 0, 640], [0, 800, 480], [0, 0, 1]], (1280, 960))
    for _ in range(8):
        start, end = (rng.uniform(0, (1280, 960), (400, 2)) for _ in range(2))
        beside = rng.normal(size=(400, 2)) * 10 ** rng.uniform(-4, 0, (400, 1))
        middle = start + (end - start) * rng.uniform(0.1, 0.9, (400, 1)) + beside
        pixel, depth = np.stack([start, end, middle], 1), rng.uniform(1, 20, (400, 3))
        points = camera.unproject(pixel.reshape(-1, 2), depth.ravel()).astype(np.float32)
        faces = np.arange(1200, dtype=np.int32).reshape(-1, 3)
        shown = {s: ibr.render(ibr.Mesh(points, faces, sides=s), camera).valid for s in ("both", "front", "back")}
        np.testing.assert_array_equal(shown["front"] | shown["back"], shown["both"])


def test_the_first_of_two_coincident_triangles_stays():
    points = np.array([[0, 0, 3], [1, 0, 3.5], [0, 1, 4]])
    color = np.repeat(np.array([[255, 0, 0], [0, 255, 0]], np.uint8), 3, axis=0)
    camera = Camera([[20, 0, 5], [0, 20, 5], [0, 0, 1]], (30, 30))
    both = ibr.render(ibr.Mesh(np.tile(points, (2, 1)), [[0, 1, 2], [3, 4, 5]], colors=color), camera)
    assert (both.color[both.valid] == (255, 0, 0)).all()


@pytest.mark.parametrize("size", [(1, 1), (7, 13), (61, 37), (64, 64)], ids=str)
def test_sizes_and_reproducible_bits(size):
    rng = np.random.default_rng(1)
    mesh = ibr.Mesh(rng.uniform((-1, -1, 2), (1, 1, 4), (300, 3)), rng.integers(0, 300, (500, 3)))
    camera = Camera([[size[0], 0, (size[0] - 1) / 2], [0, size[0], (size[1] - 1) / 2], [0, 0, 1]], size)
    first, second = ibr.render(mesh, camera), ibr.render(mesh, camera)
    assert first.valid.any()
    np.testing.assert_array_equal(first.depth, second.depth)
    np.testing.assert_array_equal(first.color, second.color)
    depth, _ = cast(mesh, camera)
    assert (first.valid != np.isfinite(depth)).sum() <= max(1, 2e-3 * first.valid.size)
