"""Objects one sample wide, compared with rays cast at their models, and wires at special positions."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import MeshScene
from tests import truth
from tests.exact import KEPT_ULP, same_bits
from tests.one_lane import both_forms

pytest.importorskip("open3d")
cv2 = pytest.importorskip("cv2")

SIZE = (61, 47)
FOCAL = 60.0
CAMERA = ibr.Camera([[FOCAL, 0, 30], [0, FOCAL, 23], [0, 0, 1]], SIZE)
WALL = 4.0
MOVES = ((0, 0, 0), (0.13, 0, 0), (0, 0.09, 0), (0.1, 0.1, 0), (0.1, 0.07, 0), (0.05, -0.04, 0.3))


def strip(at, degrees: float, length: float, ends: tuple[float, float] = (2.0, 2.0)) -> np.ndarray:
    """(4, 3) world corners of a strip one sample wide and `length` samples long; `ends`: the depths of its ends."""
    along = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    across = 0.5 * np.array([-along[1], along[0]])
    pixels = [np.array(at) + 0.5 * s * length * along + t * across for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return CAMERA.unproject(pixels, np.repeat(ends, 2)[[0, 2, 3, 1]])


def strips(*corners: np.ndarray, wall: bool = True) -> MeshScene:
    """Orange strips, and a grey wall behind them."""
    if wall:
        far = CAMERA.unproject([[-400, -400], [400, -400], [400, 400], [-400, 400]], np.full(4, WALL))
        corners = (*corners, far)
    faces = [[4 * i + k for k in face] for i in range(len(corners)) for face in ((0, 1, 2), (0, 2, 3))]
    colors = np.full((4 * len(corners), 3), 120, np.uint8)
    colors[: 4 * (len(corners) - wall)] = 230, 120, 20
    return MeshScene(np.concatenate(corners), faces, colors=colors)


def magnified(zoom: int, move=(0, 0, 0), size=(244, 188)) -> ibr.Camera:
    """The moved camera, with `zoom` pixels per sample, and with the scene still in the middle of the image."""
    size = min(SIZE[0] * zoom, size[0]), min(SIZE[1] * zoom, size[1])
    middle = (np.array(size) - 1) / 2 + 0.5 * FOCAL * zoom * np.array(move[:2])
    K = [[FOCAL * zoom, 0, middle[0]], [0, FOCAL * zoom, middle[1]], [0, 0, 1]]
    return ibr.Camera(K, size, CAMERA.moved(*move).world_from_camera)


def compared(seen: ibr.DepthImage, frame: ibr.Frame, zoom: float) -> tuple[float, float]:
    """Fraction of the strips' pixels whose depth is right to 1 %, and how far drawn pixels lie outside of the strips.

    That is the largest distance in samples, along rows or columns, whichever is greater. One pixel is subtracted, since
    the centres of a strip's outermost pixels lie up to one pixel inside its border.
    """
    thin = seen.depth < 3
    with np.errstate(invalid="ignore"):
        drawn = frame.valid & (frame.depth < 3)
        right = drawn & (np.abs(frame.depth / seen.depth - 1) < 0.01)
    away = cv2.distanceTransform((~thin).astype(np.uint8), cv2.DIST_C, 3)
    return right[thin].mean(), max((away[drawn].max(initial=0) - 1) / zoom, 0)


CASES = {
    "row": [strip((30, 23), 0, 41)],
    "column": [strip((30, 23), 90, 31)],
    "falling diagonal": [strip((30, 23), 45, 30)],
    "rising diagonal": [strip((30, 23), -45, 30)],
    **{
        f"slanted by {degrees}": [strip((30.2, 23.3), degrees, 35)]
        for degrees in (3, 10, 20, 30, 38, -10, -30, 60, 80, -75)
    },
    "a row that recedes": [strip((30, 23), 0, 41, (1.6, 2.6))],
    "slanted, and recedes": [strip((30.2, 23.3), 20, 35, (1.6, 2.4))],
    "dots": [strip((x, y), 0, 1) for x in range(5, 60, 7) for y in range(5, 45, 7)],
}


@pytest.mark.parametrize(("name", "wall"), [(name, bool(number % 2)) for number, name in enumerate(CASES)])
@pytest.mark.filterwarnings("ignore:warp")
def test_wires_are_covered_and_little_more(name, wall):
    scene = strips(*CASES[name], wall=wall)
    view = scene.capture(CAMERA)
    for zoom in (2, 8):
        # Without `thin`, the samples' squares cover wires along rows and columns, but slanted wires only in part.
        straight = name in ("row", "column", "dots", "a row that recedes")
        truths = [scene.capture(magnified(zoom, move)) for move in MOVES]
        for thin, least in ((True, 0.95), (False, 0.95 if straight else 0.6))[: 2 if zoom == 2 else 1]:
            covered = []
            for move, seen in zip(MOVES, truths, strict=True):
                frame = ibr.warp(view, seen.camera, thin=thin)
                share, beyond = compared(seen, frame, zoom * 2 / (2 - move[2]))
                assert beyond <= 0.5, (zoom, move, thin)
                covered.append(share)
            assert np.mean(covered) >= least, (zoom, covered, thin)


def test_the_search_draws_the_same():
    view = strips(*CASES["slanted by 20"]).capture(CAMERA)
    camera = magnified(4, MOVES[4])
    swept, searched = (ibr.warp(view, camera, thin=True, method=method) for method in ("epipolar", "search"))
    near = [frame.depth < 3 for frame in (swept, searched)]
    np.testing.assert_array_equal(*near)
    assert near[0].sum() > 300
    np.testing.assert_array_equal(swept.depth[near[0]], searched.depth[near[0]])


SHAPES = {
    "a dot": ["#"],
    "a bar": ["#######"],
    "a frame": ["#####", "#...#", "#...#", "#####"],
    "a cross": ["..#..", "..#..", "#####", "..#..", "..#.."],
    "a tee": ["#####", "..#..", "..#..", "..#.."],
    "a comb": ["#.#.#", "#.#.#", "#####"],
    "a stair of long steps": ["#####....", "....#....", "....#####"],
}


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("shape", SHAPES)
def test_what_runs_along_rows_and_columns_is_its_samples_squares(shape, projection):
    pattern = np.array([[letter == "#" for letter in row] for row in SHAPES[shape]])
    for margin in (0, 2):
        mask = np.pad(pattern, margin)
        height, width = mask.shape
        K = np.array([[20, 0, 3], [0, 20, 2], [0, 0, 1.0]])
        camera = ibr.Camera(K, (width, height), projection=projection)
        view = ibr.DepthImage(
            np.full((height, width, 3), 77, np.uint8), np.where(mask, np.float32(2), np.float32(np.nan)), camera
        )
        fine = np.diag([8.0, 8, 1]) @ K
        fine[:2, 2] += 3.5  # eight pixels per sample, and half a sample beyond the outermost samples
        frame = ibr.warp(view, ibr.Camera(fine, (8 * width, 8 * height), projection=projection), thin=True)
        np.testing.assert_array_equal(frame.valid, mask.repeat(8, 0).repeat(8, 1))
        two = np.full(frame.valid.sum(), 2, np.float32)
        np.testing.assert_array_max_ulp(frame.depth[frame.valid], two, KEPT_ULP)
        assert (frame.color[frame.valid] == 77).all()


def test_a_bar_on_a_block_leaves_no_gap_and_does_not_widen_the_block():
    depth = np.full((15, 21), np.nan, np.float32)
    depth[3:12, 2:9] = 2
    depth[7, 9:18] = 2
    camera = ibr.Camera([[20, 0, 10], [0, 20, 7], [0, 0, 1]], (21, 15))
    view = ibr.DepthImage(np.zeros((15, 21, 3), np.uint8), depth, camera)
    fine = ibr.Camera([[160, 0, 83.5], [0, 160, 59.5], [0, 0, 1]], (168, 120))
    plain, frame = ibr.warp(view, fine), ibr.warp(view, fine, thin=True)
    bar = np.zeros((120, 168), bool)
    bar[56:64, 67:144] = True  # begins at the block's last samples
    np.testing.assert_array_equal(frame.valid, plain.valid | bar)


def crossing_wires(projection: str, behind: float, dtype: type = np.uint8) -> ibr.DepthImage:
    """A view of wires with many slopes, some crossing or receding, of staircases, dots and a block, and of gaps."""
    width, height = SIZE[0], 37
    y, x = np.mgrid[:height, :width].astype(float)
    rng = np.random.default_rng(1)
    depth = np.full((height, width), behind)
    for off, near in (
        (x - 5 - 0.3 * y, 2.0),
        (x - 20 - 0.7 * y, 1.9 + 0.01 * y),
        (x + y - 58, 2.5),
        (x - y - 22, 1.5),
        (y - 30 + 0.2 * x, 2.2),
    ):
        depth = np.where(np.abs(off) < 0.5, near, depth)
    step = np.arange(20)
    depth[9 + step // 2, 34 + (step + 1) // 2] = 2 + 0.004 * step
    depth[3:9, 30:34] = 2.0
    depth[rng.random(depth.shape) < 0.01] = 1.7
    depth[20:23, 2:6] = np.nan
    color = rng.integers(1, 256, (height, width, 3), np.uint8)
    if dtype is np.float32:
        color = color / np.float32(255)
    camera = ibr.Camera([[55, 0, 30.3], [0, 55, 17.8], [0, 0, 1]], (width, height), projection=projection)
    return ibr.DepthImage(color, depth.astype(np.float32), camera)


@pytest.mark.parametrize("method", ["epipolar", "search"])
@pytest.mark.parametrize("sample", ["linear", "nearest"])
@pytest.mark.parametrize("cut_ratio", [1.05, None], ids=["cut", "connect"])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.filterwarnings("ignore:warp")
def test_a_view_from_its_own_camera_is_its_image(method, sample, cut_ratio, projection):
    options = {"method": method, "interpolation": sample, "edges": "cut" if cut_ratio else "connect"}
    kinds = (4.0, np.uint8), (np.nan, np.uint8), (np.nan, np.float32)
    for behind, dtype in kinds[: 3 if method == "epipolar" else 2]:
        view = crossing_wires(projection, behind, dtype)
        for side, fill, blend in (
            ("front", None, "quality"),
            ("both", "background", "nearest"),
            ("back", "smooth", "quality"),
        ):
            more = {**options, "cut_ratio": cut_ratio, "side": side, "fill": fill, "blend": blend}
            plain, frame = (ibr.warp(view, view.camera, thin=thin, **more) for thin in (False, True))
            same_bits(plain, frame)
            if side == "back":
                continue
            np.testing.assert_array_equal(frame.valid, view.valid)
            np.testing.assert_array_max_ulp(frame.depth[view.valid], view.depth[view.valid], KEPT_ULP)
            atol = 0 if dtype is np.uint8 else 4 * 2**-24  # four roundings
            np.testing.assert_allclose(frame.color[view.valid], view.color[view.valid], rtol=0, atol=atol)


@pytest.mark.parametrize("behind", [4.0, np.nan])
@pytest.mark.parametrize("zoom", [1, 2, 3])
@pytest.mark.parametrize("aside", [0, 1e-6, 1e-3, 0.03])
def test_rays_through_samples_show_them(behind, zoom, aside):
    """Rays that pass close beside samples show the same, so that nothing jumps when the camera moves slightly."""
    view = crossing_wires("perspective", behind)
    K = np.diag([zoom, zoom, 1.0]) @ view.camera.K
    for way in ((1, 0), (0, 1), (-0.7, 0.7)):
        K[:2, 2] = zoom * (view.camera.K[:2, 2] + aside * np.array(way))
        size = zoom * SIZE[0], zoom * 37
        frame = ibr.warp(view, ibr.Camera(K, size), thin=True, cut_ratio=1.05)
        plain = ibr.warp(view, ibr.Camera(K, size), cut_ratio=1.05)
        at = np.s_[::zoom, ::zoom]
        np.testing.assert_array_equal(frame.valid[at], plain.valid[at])
        np.testing.assert_array_equal(frame.depth[at] < 3, view.depth < 3)
        seen = plain.valid[at]
        # Along a wire, depth changes by at most 5 % from sample to sample, since larger steps are cut.
        np.testing.assert_allclose(frame.depth[at][seen], plain.depth[at][seen], rtol=0.05 * aside + 1e-6)
        if zoom > 1:  # between samples wires are wider than their samples' pixels
            assert (frame.depth < 3).sum() >= (plain.depth < 3).sum()


@pytest.mark.parametrize("slope", [0.3, 0.7, 1.0])
def test_wires_widen_where_the_target_looks_between_samples(slope):
    """In each row the wire is one or two pixels wide, and one where the target's rays pass through samples."""
    y, x = np.mgrid[:37, :61].astype(float)
    wire = np.abs(x - 12.13 - slope * y) < 0.5
    camera = ibr.Camera([[55, 0, 30], [0, 55, 18], [0, 0, 1]], (61, 37))
    view = ibr.DepthImage(None, np.where(wire, np.float32(2), np.float32(4)), camera)
    for aside in np.linspace(0, 1, 11):
        moved = ibr.Camera([[55, 0, 30 + aside], [0, 55, 18], [0, 0, 1]], (61, 37))
        rows = (ibr.warp(view, moved, thin=True, cut_ratio=1.05).depth < 3).sum(axis=1)
        assert (rows >= 1).all()
        assert (rows <= 2).all()
        if aside in (0, 1):
            assert (rows == 1).all()


def test_nearer_things_hide_thin_ones_and_are_hidden_by_them():
    scene = strips(strip((20, 23), 0, 25), strip((34, 14), 0, 31, (1.5, 1.5)))
    view = scene.capture(CAMERA)
    block = np.full(SIZE[::-1], np.nan, np.float32)
    block[10:35, 5:20] = 1.8
    before = ibr.DepthImage(np.zeros((*SIZE[::-1], 3), np.uint8), block, CAMERA)
    alone = ibr.warp(view, magnified(2), thin=True).depth
    assert np.isclose(alone, 2).sum() > 4 * 20
    assert np.isclose(alone, 1.5).sum() == 4 * 31  # four pixels per sample
    for blend, views in (("nearest", [view, before]), ("nearest", [before, view]), ("quality", [view, before])):
        frame = ibr.warp(views, magnified(2), thin=True, blend=blend)
        hidden = ibr.warp([before, before], magnified(2), blend=blend).valid
        hidden[46:48, 39] = False  # margin beside the block, removed: the other view has looked through it
        np.testing.assert_array_equal(np.isclose(frame.depth, 2), np.isclose(alone, 2) & ~hidden)
        shown = np.isclose(alone, 1.5)
        if blend == "quality":  # margin at the strip's end, removed likewise
            shown[28:30, 38] = False
        np.testing.assert_array_equal(np.isclose(frame.depth, 1.5), shown)


def test_a_surface_without_thin_things_is_the_same_to_the_bit():
    y, x = np.mgrid[:37, :53]
    depth = (3 + 0.2 * np.sin(x / 7) * np.cos(y / 5)).astype(np.float32)
    depth[10:20, 12:30] -= 1
    depth[25:27, 30:32] = np.nan
    color = np.random.default_rng(1).integers(0, 256, (37, 53, 3), np.uint8)
    view = ibr.DepthImage(color, depth, ibr.Camera([[50, 0, 26], [0, 50, 18], [0, 0, 1]], (53, 37)))
    for edges in ("cut", "connect"):
        for camera in (view.camera.moved(0.2, 0.1, 0.3), view.camera.moved(0.2, 0, 0)):
            plain, frame = (ibr.warp(view, camera, edges=edges, thin=thin) for thin in (False, True))
            same_bits(plain, frame)


def test_labels_are_carried_over_from_thin_things_not_from_beside_them():
    view = strips(*CASES["slanted by 20"], *CASES["falling diagonal"]).capture(CAMERA)
    labels = view.depth < 3
    frame = ibr.warp(view, magnified(8, MOVES[4]), thin=True, classes=True)
    near = frame.depth < 3
    x, y = np.rint(frame.source[near]).astype(int).T
    assert near.sum() > 1000
    assert labels[y, x].all()
    assert (frame.view[near] == 0).all()
    assert (frame.classes[near] == ibr.PixelClass.SEEN).all()


@pytest.mark.parametrize("sample", ["linear", "nearest"])
def test_colours_and_depths_run_along_wires(sample):
    depth, color = np.full((9, 12), np.nan, np.float32), np.zeros((9, 12, 3), np.uint8)
    depth[4, 2:10] = 1 / np.linspace(0.5, 0.45, 8)  # nearness is an affine function of x
    color[4, 2:10, 0] = np.arange(8) * 30
    camera = ibr.Camera([[20, 0, 5.5], [0, 20, 4], [0, 0, 1]], (12, 9))
    fine = ibr.Camera([[200, 0, 59.5], [0, 200, 44.5], [0, 0, 1]], (120, 90))
    frame = ibr.warp(ibr.DepthImage(color, depth, camera), fine, thin=True, interpolation=sample)
    assert (frame.valid.sum(axis=1) == np.repeat([0, 80, 0], [40, 10, 40])).all()
    x = (np.arange(20, 100) + 0.5) / 10 - 0.5 - 2  # in samples, from the wire's first one
    at = np.clip(x if sample == "linear" else np.rint(x), 0, 7)
    np.testing.assert_allclose(frame.color[45, 20:100, 0], at * 30, atol=0.51)
    # The wire continues straight over the outer halves of its first and last samples. The surface's margin covers the
    # same halves at constant nearness, and shows where it is nearer.
    along = np.minimum(x, 7) if sample == "linear" else at
    np.testing.assert_allclose(frame.depth[45, 20:100], 1 / (0.5 - 0.05 * along / 7), rtol=1e-5)


def test_backs_of_thin_things_are_shown_if_asked_for():
    view = strips(*CASES["row"], wall=False).capture(CAMERA)
    behind = ibr.Camera.look_at((0.2, 0.1, 4.2), (0, 0, 2), (0, 1, 0), (122, 94), fov_y=45)
    with pytest.warns(UserWarning, match="sees nothing"):
        assert not ibr.warp(view, behind, thin=True).valid.any()
    both = ibr.warp(view, behind, thin=True, side="both")
    expected = strips(*CASES["row"], wall=False).capture(behind).valid
    assert both.valid[expected].mean() > 0.97
    assert not both.valid[~truth.dilate(expected, 1)].any()


@pytest.mark.thorough
def test_one_lane_draws_the_same():
    view = strips(*CASES["slanted by 20"], *CASES["dots"]).capture(CAMERA)
    camera = magnified(4, MOVES[4])
    depths = both_forms(lambda: ibr.warp(ibr.DepthImage(view.color, view.depth, CAMERA), camera, thin=True).depth)
    wide, one = (np.where(depth < 3, depth, 0) for depth in depths)
    assert (~np.isclose(wide, one, rtol=1e-5)).sum() <= 2  # rounding at borders of pixels


def test_thin_things_in_pictures_of_anything_and_in_their_shadows():
    view = strips(*CASES["slanted by 20"]).capture(CAMERA)
    camera = magnified(4, MOVES[4])
    drawn, warped = ibr.render(ibr.WarpedView(view, thin=True), camera), ibr.warp(view, camera, thin=True)
    np.testing.assert_array_equal(drawn.depth, warped.depth)
    np.testing.assert_array_equal(drawn.color, warped.color)
    alone = strips(*CASES["slanted by 20"], wall=False).capture(CAMERA)
    floor = ibr.Mesh([[-4, -4, 4], [4, -4, 4], [-4, 4, 4], [4, 4, 4]], [[0, 1, 2], [3, 2, 1]])
    light = ibr.Light(direction=(0.3, 0.2, 1), ambient=0.2)
    lit = ibr.render(floor, CAMERA, light).color.astype(int)
    shaded = []
    for thin in (False, True):
        frame = ibr.render([floor, ibr.WarpedView(alone, thin=thin)], CAMERA, light)
        shaded.append(((frame.depth > 3) & (frame.color.sum(axis=2) < lit.sum(axis=2) - 30)).sum())
    assert shaded[1] >= shaded[0] > 8


def test_through_lenses():
    """A picture through a lens is undistorted first, which moves thin objects by at most half a sample."""
    lens = ibr.Lens("brown_conrady", [-0.15, 0.02, 0, 0])
    scene = strips(*CASES["row"], strip((30, 10), 20, 30))
    bent = ibr.Camera(CAMERA.K, SIZE, lens=lens)
    view = scene.capture(bent)
    for camera, source, least in ((magnified(2, MOVES[4]), view, 0.5), (bent, scene.capture(CAMERA), 0.85)):
        frame = ibr.warp(source, camera, thin=True)
        wires = scene.capture(camera).depth < 3
        found = frame.depth < 3
        assert found[wires].mean() > least
        assert not found[~truth.dilate(wires, 2)].any()
