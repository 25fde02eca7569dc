"""Several things in one picture."""

from __future__ import annotations

import copy
import pickle
from itertools import permutations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import models, object_views
from pyibr.core.camera import Camera
from pyibr.opencl.watch import Traffic, watching
from tests import scenes
from tests.exact import same_bits

CAMERA = Camera([[60, 0, 40], [0, 60, 30], [0, 0, 1]], (81, 61))


def wall(z: float, half: float, color: tuple[int, int, int]) -> ibr.Mesh:
    corners = [[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]]
    return ibr.Mesh(corners, [[0, 2, 1], [0, 3, 2]], colors=np.tile(np.array(color, np.uint8), (4, 1)))


def view(z: float, dtype: type = np.uint8) -> ibr.DepthImage:
    color = np.full((61, 81, 3), 90 if dtype == np.uint8 else 0.5, dtype)
    return ibr.DepthImage(color, np.full((61, 81), z, np.float32), CAMERA)


def relief() -> ibr.SlicedSurface:
    base = ibr.Mesh([[-1, -1, 4], [1, -1, 4], [1, 1, 4], [-1, 1, 4]], [[0, 2, 1], [0, 3, 2]], uv=np.eye(4)[:, :2])
    return ibr.SlicedSurface(base, np.full((4, 4), 0.8, np.float32), np.full((2, 2, 3), 30, np.uint8), 0.5)


def test_one_depth_buffer_for_all_in_any_order():
    things = [wall(3, 0.5, (255, 0, 0)), view(5), wall(2, 0.2, (0, 255, 0)), relief()]
    pictures = [ibr.render(order, CAMERA) for order in permutations(things)]
    for other in pictures[1:]:
        np.testing.assert_array_equal(pictures[0].color, other.color)
        np.testing.assert_allclose(pictures[0].depth, other.depth, rtol=1e-6)
    frame = pictures[0]
    assert tuple(frame.color[30, 40]) == (0, 255, 0)
    assert tuple(frame.color[30, 48]) == (255, 0, 0)
    assert tuple(frame.color[30, 53]) == (30, 30, 30)
    assert tuple(frame.color[2, 2]) == (90, 90, 90)
    np.testing.assert_allclose([frame.depth[30, 40], frame.depth[30, 48], frame.depth[2, 2]], [2, 3, 5], rtol=1e-6)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"edges": "cut"},
        {"edges": "connect"},
        {"cut_ratio": 1.3},
        {"interpolation": "nearest"},
        {"side": "both", "edges": "connect"},
        {"side": "back", "edges": "connect"},
    ],
    ids=str,
)
@pytest.mark.filterwarnings("ignore:warp. the target camera sees nothing")
def test_a_depth_image_alone_is_the_warp(options, projection):
    source = scenes.stepped((64, 48), projection)
    target = source.camera.moved(0.5, 0.1, 0.1)
    if projection == "orthographic":  # parallel rays from the source's direction would show no steps
        target = source.camera.orbited(30, source.camera.center + 4 * source.camera.forward)
    if "side" in options:
        target = source.camera.orbited(160, source.camera.center + 4 * source.camera.forward)
    a, b = ibr.render(ibr.WarpedView(source, **options), target), ibr.warp(source, target, **options)
    np.testing.assert_array_equal(a.color, b.color)
    np.testing.assert_array_equal(a.depth, b.depth)
    assert a.valid.mean() > 0.3
    cut = ibr.warp(source, target, edges="cut")
    same = np.array_equal(a.depth, cut.depth, equal_nan=True)
    assert same == (options in ({}, {"edges": "cut"}))  # each of the other options changes the picture


def test_options_are_a_things_own():
    """Two depth images in one picture are each drawn with their own options."""
    views = [scenes.stepped((64, 48)), scenes.holed((64, 48))]
    target = views[0].camera.moved(0.5, 0.1, 0.1)
    options = {"edges": "connect", "side": "both", "interpolation": "nearest"}
    things = [ibr.WarpedView(view, **options) for view in views]
    a, b = ibr.render(things, target), ibr.warp(views, target, blend="nearest", **options)
    np.testing.assert_array_equal(a.color, b.color)
    np.testing.assert_array_equal(a.depth, b.depth)
    both = ibr.render([things[0], views[1]], target)
    one, other = ibr.warp(views[0], target, **options), ibr.warp(views[1], target)
    first = one.valid & ~(other.depth < one.depth)
    assert 500 < first.sum() < 0.95 * both.valid.sum()
    np.testing.assert_array_equal(both.color[first], one.color[first])
    np.testing.assert_array_equal(both.color[~first], other.color[~first])
    np.testing.assert_array_equal(both.depth, np.fmin(one.depth, other.depth))


def test_blended_views_stand_beside_a_mesh():
    a = scenes.stepped((64, 48))
    views = [a, ibr.DepthImage(a.color[:, ::-1], a.depth, a.camera.moved(0.1, 0, 0))]
    target = a.camera.moved(0.05, 0.02, 0.1)
    middle = float(np.median(a.depth[a.valid]))
    sheet = ibr.Mesh([[-9, -9, middle], [0, -9, middle], [0, 9, middle], [-9, 9, middle]], [[0, 2, 1], [0, 3, 2]])
    blended, mesh = ibr.warp(views, target), ibr.render(sheet, target)
    assert (blended.color != ibr.warp(views, target, blend="nearest").color).any()
    nearer = blended.valid & ~(mesh.depth <= blended.depth)
    for things in ([ibr.WarpedView(views), sheet], [sheet, ibr.WarpedView(views)]):
        frame = ibr.render(things, target)
        np.testing.assert_array_equal(frame.color[nearer], blended.color[nearer])
        np.testing.assert_array_equal(frame.color[mesh.valid & ~nearer], mesh.color[mesh.valid & ~nearer])
        np.testing.assert_array_equal(frame.depth, np.fmin(blended.depth, mesh.depth))
    assert min(nearer.sum(), (mesh.valid & ~nearer).sum()) > 100


def test_the_dtype_is_float_if_a_depth_images_is():
    assert ibr.render([view(5), wall(3, 0.5, (255, 0, 0))], CAMERA).color.dtype == np.uint8
    frame = ibr.render([view(5, np.float32), wall(3, 0.5, (255, 0, 0)), view(4)], CAMERA)
    assert frame.color.dtype == np.float32
    np.testing.assert_allclose(frame.color[30, 40], (1, 0, 0), atol=1e-6)
    np.testing.assert_allclose(frame.color[2, 2], 90 / 255, atol=1e-6)


def test_views_of_both_dtypes_are_uploaded_once():
    things = [view(5, np.float32), view(4)]
    first = ibr.render(things, CAMERA)
    with watching(Traffic()) as traffic:
        second = ibr.render(things, CAMERA)
    np.testing.assert_array_equal(second.color, first.color)
    assert traffic.count("launch")
    assert "to_nearness" not in {name for _, name, _ in traffic.of}  # the first kernel for a new image
    assert traffic.total("upload") < things[1].depth.nbytes


def test_objects_of_both_dtypes_are_made_once():
    views = object_views(models.donut(16), 32)
    mixed = [views[0].in_float, *views[1:]]
    thing, plain = ibr.DepthObject(mixed, slices=32), ibr.DepthObject(views, slices=32)
    camera = Camera.look_at((0, 1, 4), (0, 0, 0), (0, 1, 0), (41, 31), fov_y=45)
    frame = ibr.render(thing, camera)
    (kept,) = thing.device_cache.values()
    np.testing.assert_array_equal(frame.color, ibr.render(plain, camera).color)
    ibr.render(thing, camera)
    assert next(iter(thing.device_cache.values())) is kept


def test_a_float_picture_is_the_byte_one_unrounded():
    light = ibr.Light(direction=(0.4, 0.2, 1), color=(1, 0.9, 0.8), shadow_size=0)
    mesh = ibr.Mesh([[-1, -1, 3], [1, -1, 4], [1, 1, 5]], [[0, 2, 1]], colors=np.eye(3, dtype=np.float32))
    far = ibr.DepthImage(np.full((61, 81, 3), 0.5, np.float32), np.full((61, 81), 9, np.float32), CAMERA)
    frame, rounded = ibr.render([mesh, far], CAMERA, light), ibr.render(mesh, CAMERA, light)
    on = rounded.valid
    assert on.sum() > 300
    assert np.abs(255 * frame.color[on] - rounded.color[on]).max() <= 0.51
    assert (frame.color[~on] == 0.5).all()  # depth images are not shaded


@pytest.mark.parametrize("size", [(1, 1), (7, 13), (61, 37)], ids=str)
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_sizes_and_the_same_bits_again(size, projection):
    width, height = size
    f = width if projection == "perspective" else width / 4
    camera = Camera([[f, 0, (width - 1) / 2], [0, f, (height - 1) / 2], [0, 0, 1]], size, projection=projection)
    things = [view(5), wall(3, 0.4, (255, 0, 0)), relief(), wall(4.5, 9, (0, 0, 255))]
    frame, again = (ibr.render(things, camera, ibr.Light(direction=(0, 0.5, 1))) for _ in range(2))
    assert frame.color.shape == (height, width, 3)
    assert frame.camera is camera
    assert frame.valid.all()
    assert abs(frame.depth[height // 2, width // 2] - 3) < 1e-5
    same_bits(frame, again)


def test_copies_and_pickles_look_the_same():
    """Copies and pickles leave out buffers on the device, before and after a picture; their arrays stay read-only."""
    views = object_views(models.donut(20), 32)
    things = [
        models.donut(20),
        relief(),
        ibr.ReliefSurface(relief().base, np.full((4, 4), 0.8, np.float32), np.full((2, 2, 3), 30, np.uint8), 0.5),
        ibr.DepthObject(views, slices=16),
        ibr.VisualHull(views, slices=16),
        ibr.DepthMesh(views[4]),
        ibr.DepthMeshObject(views),
    ]
    camera = Camera.look_at((0.3, 0.2, 6), (0, 0, 0), (0, 1, 0), (61, 47), fov_y=40)
    for thing in things:
        early = pickle.loads(pickle.dumps(thing))
        frame = ibr.render(thing, camera)
        for other in (early, pickle.loads(pickle.dumps(thing)), copy.deepcopy(thing), copy.copy(thing)):
            same = ibr.render(other, camera)
            np.testing.assert_array_equal(same.color, frame.color)
            np.testing.assert_array_equal(same.depth, frame.depth)
    mesh = pickle.loads(pickle.dumps(things[0]))
    assert not mesh.vertices.flags.writeable


def test_backgrounds_are_rounded():
    """Background colours are rounded in the same way in empty and in partly covered pixels."""
    away = ibr.Camera(CAMERA.K, CAMERA.size, np.diag([-1.0, 1, -1, 1]))
    assert (ibr.render(wall(3, 0.5, (9, 9, 9)), away, background=(127.9, 0.9, 254.6)).color == (128, 1, 255)).all()


def test_background():
    frame = ibr.render(wall(3, 0.5, (255, 0, 0)), CAMERA, background=(10, 20, 30))
    assert (frame.color[~frame.valid] == (10, 20, 30)).all()
    assert (frame.color[frame.valid] == (255, 0, 0)).all()
    assert np.isnan(frame.depth[~frame.valid]).all()
    away = CAMERA.moved(50, 0, 0)
    assert (ibr.render(view(5, np.float32), away, background=(0.5, 0, 1)).color == np.float32((0.5, 0, 1))).all()


def test_partly_and_wholly_out_of_view():
    """A square of 21 pixels, 0.5 m to each side at 3 m, is moved out across each border."""
    for dx, dy in ((2, 0), (-2, 0), (0, 1.5), (0, -1.5), (-2, 1.5), (2.6, 0), (0, 30)):
        frame = ibr.render(wall(3, 0.51, (9, 9, 9)), CAMERA.moved(dx, dy, 0))
        y, x = np.mgrid[:61, :81]
        expected = (np.abs(x - 40 + 20 * dx) <= 10) & (np.abs(y - 30 + 20 * dy) <= 10)
        np.testing.assert_array_equal(frame.valid, expected)
        assert expected.any() == (dx < 2.6 and dy < 30)


BAD = [
    ("things", {"things": []}),
    ("things", {"things": 3}),
    ("things", {"things": ()}),
    ("things", {"things": None}),
    ("things", {"things": "mesh"}),
    ("things", {"things": [np.zeros((4, 4))]}),
    ("things", {"things": [wall(3, 1, (9, 9, 9)), None]}),
    ("camera", {"camera": None}),
    ("camera", {"camera": "front"}),
    ("camera", {"camera": ibr.Camera(np.eye(3), (1 << 15, 1 << 15))}),
    ("things", {"things": wall(1e11, 1e11, (9, 9, 9))}),
    ("things", {"things": wall(1e-11, 1e-11, (9, 9, 9))}),
    ("light", {"light": ibr.Light(position=(0, 0, -1e12))}),
    ("depth", {"things": ibr.DepthImage(view(5).color, view(5).depth * np.float32(1e20), view(5).camera)}),
    ("depth", {"things": ibr.DepthImage(view(5).color, view(5).depth * np.float32(1e-20), view(5).camera)}),
    ("light", {"light": (0, 0, 1)}),
    ("light", {"light": ibr.Light}),
    ("background", {"background": (0, 0)}),
    ("background", {"background": 0}),
    ("background", {"background": "black"}),
    ("background", {"background": (0, 0, 300)}),
    ("background", {"background": (0.5, 0.5, 1)}),
    ("background", {"background": (0, 0, -1)}),
    ("background", {"background": (0, 0, np.nan)}),
    ("background", {"things": view(5, np.float32), "background": (0, 0, 2)}),
]


@pytest.mark.parametrize(("argument", "changes"), BAD)
def test_bad_input(argument, changes):
    with pytest.raises(ibr.ArgumentError, match=f"^{argument}: expected .*, got .*$"):
        ibr.render(**{"things": wall(3, 1, (9, 9, 9)), "camera": CAMERA, **changes})


def test_a_view_that_is_made_already_has_options_of_its_own():
    made = ibr.WarpedView(view(5), edges="connect")
    np.testing.assert_array_equal(ibr.warp(made, CAMERA).depth, ibr.warp(view(5), CAMERA, edges="connect").depth)
    with pytest.raises(ibr.ArgumentError, match=r"^edges: expected none: a WarpedView has options of its own"):
        ibr.warp(made, CAMERA, edges="cut")
