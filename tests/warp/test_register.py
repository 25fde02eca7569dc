"""Registration compared with exact depths: a box in front of a slanted wall, seen by two cameras."""

from __future__ import annotations

import warnings

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

import pyibr as ibr
from pyibr.app.cli import app
from tests.embree import pixels_of, rays_of
from tests.exact import KEPT_ULP

LENS = ibr.Lens("brown_conrady", [-0.12, 0.03, 0.001, -0.0005, 0.0])
TURNED = np.eye(4)
TURNED[:3, :3] = cv2.Rodrigues(np.array([0.01, -0.02, 0.015]))[0]
TURNED[:3, 3] = 0.16, 0.004, -0.01
DEPTH = ibr.Camera([[210, 0, 96.2], [0, 211, 70.9], [0, 0, 1]], (193, 141))
COLOR = ibr.Camera([[240, 0, 109.5], [0, 240, 81.3], [0, 0, 1]], (219, 163), TURNED)
CAMERAS = {"pinholes": (DEPTH, COLOR)}
CAMERAS["lenses"] = tuple(ibr.Camera(c.K, c.size, c.world_from_camera, lens=LENS) for c in (DEPTH, COLOR))

WALL = np.array([0.1, 0.05, 1.0]), 2.6  # normal n and offset d of the plane n . X = d
LOW, HIGH, FRONT = (-0.35, -0.25), (0.3, 0.2), 1.4  # the box's front: least and greatest x and y, and z; no sides


def seen_along(origin: np.ndarray, ways: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances to the scene, (N,), in lengths of the directions `ways`, and the mask of rays that meet the box."""
    far = (WALL[1] - origin @ WALL[0]) / (ways @ WALL[0])
    near = (FRONT - origin[2]) / ways[:, 2]
    at = origin[:2] + near[:, None] * ways[:, :2]
    box = ((at > LOW) & (at < HIGH)).all(axis=1) & (near > 1e-9)
    return np.where(box, near, far), box


def seen_by(camera: ibr.Camera) -> tuple[np.ndarray, np.ndarray]:
    """(H, W) planar depth, and the mask of pixels that show the box."""
    far, box = seen_along(camera.center, rays_of(camera)[:, 3:])
    return (part.reshape(camera.height, camera.width) for part in (far.astype(np.float32), box))


def within(mask: np.ndarray, pixels: int) -> np.ndarray:
    """(H, W) bool: pixels at most `pixels` pixels from a change of the mask."""
    kernel = np.ones((2 * pixels + 1, 2 * pixels + 1))
    return cv2.dilate(mask.astype(np.uint8), kernel) != cv2.erode(mask.astype(np.uint8), kernel)


@pytest.mark.parametrize("cameras", CAMERAS.values(), ids=list(CAMERAS))
@pytest.mark.parametrize("dtype", [np.float32, np.uint16])
def test_depth_in_the_colour_camera(cameras, dtype):
    depth_camera, color_camera = cameras
    given, _ = seen_by(depth_camera)
    truth, box = seen_by(color_camera)
    if dtype == np.uint16:
        registered = ibr.register(np.rint(given * 10000).astype(dtype), *cameras, depth_scale=10000)
        assert registered.dtype == np.uint16
        found = np.where(registered > 0, registered / 10000, np.nan)
    else:
        found = ibr.register(given, *cameras)
        assert found.dtype == np.float32
    # Pixels count if both cameras see their points, at least two pixels from silhouettes and from the image's border.
    points = color_camera.unproject(pixels_of(color_camera), truth.ravel())
    back = depth_camera.project(points)[0]
    first, _ = seen_along(depth_camera.center, points - depth_camera.center)
    sees = (np.abs(first - 1) < 1e-6) & ((back > 1) & (back < np.array(depth_camera.size) - 2)).all(axis=1)
    sees = sees.reshape(truth.shape)
    sure = cv2.erode(sees.astype(np.uint8), np.ones((5, 5))).astype(bool) & ~within(box, 2)
    assert sure.mean() > 0.6
    assert np.isfinite(found[sure]).all(), "no gaps where a surface is visible"
    # The tolerance is a thousandth of the depth. Depth in 16 bits has steps of 1e-4, and half a step is added.
    assert (np.abs(found - truth) < 1e-3 * truth + (5e-5 if dtype == np.uint16 else 0))[sure].all()


@pytest.mark.parametrize("cameras", CAMERAS.values(), ids=list(CAMERAS))
@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_colours_for_the_depth_samples(cameras, dtype):
    depth_camera, color_camera = cameras
    given, own_box = seen_by(depth_camera)
    _, box = seen_by(color_camera)
    color = np.where(box[..., None], (200, 40, 40), (40, 40, 200)).astype(np.uint8)
    if dtype == np.float32:
        color = (color / np.float32(255)).astype(np.float32)
    found = ibr.register_color(given, *cameras, color)
    assert found.color.dtype == dtype
    points = depth_camera.unproject(pixels_of(depth_camera), given.ravel())
    pixels = color_camera.project(points)[0]
    first, _ = seen_along(color_camera.center, points - color_camera.center)
    inside = ((pixels >= -0.5) & (pixels <= np.array(color_camera.size) - 0.5)).all(axis=1)
    truly = ((first > 1 - 1e-6) & inside).reshape(given.shape)
    # `sure` pixels are at least three pixels from silhouettes of both cameras, and from the colour image's border.
    sure = ~(within(truly, 3) | within(own_box, 3))
    assert (truly & sure).any() and (~truly & sure).any()
    assert found.seen[sure & truly].all(), "every visible sample has a colour"
    assert not found.seen[sure & ~truly].any(), "no hidden sample has a colour"
    most = 255 if dtype == np.uint8 else 1.0
    red = found.color[..., 0] > 0.5 * most
    np.testing.assert_array_equal(red[found.seen & sure], own_box[found.seen & sure])
    assert not found.color[~found.seen].any()


def test_noise_hides_nothing_and_shows_nothing_hidden():
    """Depth has the noise of a structured-light camera: a tenth of a pixel of disparity."""
    given, own_box = seen_by(DEPTH)
    rng = np.random.default_rng(1)
    noisy = (1 / (1 / given + rng.normal(0, 0.1 / (210 * 0.075), given.shape))).astype(np.float32)
    _, box = seen_by(COLOR)
    color = np.full((*box.shape, 3), 90, np.uint8)
    clean, found = (ibr.register_color(depth, DEPTH, COLOR, color).seen for depth in (given, noisy))
    assert (clean != found)[~(within(clean, 3) | within(own_box, 3))].mean() < 1e-3


def test_the_same_camera_gives_the_depth_back():
    given, _ = seen_by(DEPTH)
    given[20:30, 40:60] = np.nan
    np.testing.assert_array_max_ulp(ibr.register(given, DEPTH, DEPTH), given, KEPT_ULP)
    color = np.random.default_rng(2).integers(0, 256, (*given.shape, 3), dtype=np.uint8)
    found = ibr.register_color(given, DEPTH, DEPTH, color)
    np.testing.assert_array_equal(found.seen, np.isfinite(given))
    np.testing.assert_array_equal(found.color[found.seen], color[found.seen])


def test_counts_are_those_of_the_same_depth():
    """All 16-bit depths come back exactly: float32 rounds by 2^-24, and a step is 2^-16 of the largest depth."""
    camera = ibr.Camera([[300, 0, 127.5], [0, 300, 127.5], [0, 0, 1]], (257, 255))  # a size that vectors do not divide
    counts = np.arange(257 * 255, dtype=np.uint16).reshape(255, 257)
    for scale in (1000, 5000.0, 0.25, 123.4):
        np.testing.assert_array_equal(ibr.register(counts, camera, camera, depth_scale=scale), counts)
    turned = counts.astype(counts.dtype.newbyteorder())  # the other byte order, as in some files
    np.testing.assert_array_equal(ibr.register(turned, camera, camera, depth_scale=1000), counts)
    hidden = np.zeros(counts.shape, bool)
    hidden[30:50, 101:190] = True
    masked = np.ma.MaskedArray(counts, hidden)
    np.testing.assert_array_equal(ibr.register(masked, camera, camera, depth_scale=1000), np.where(hidden, 0, counts))
    strided = np.repeat(counts, 2, axis=1)[:, ::2]
    np.testing.assert_array_equal(ibr.register(strided, camera, camera, depth_scale=1000), counts)


def test_counts_beyond_16_bits_are_none():
    """A wall 65 m away, seen from half a metre farther back, and from a metre farther back, beyond 16 bits."""
    camera = ibr.Camera([[100, 0, 15.5], [0, 100, 15.5], [0, 0, 1]], (32, 32))
    wall = np.full((32, 32), 65000, np.uint16)
    for back, expected in ((0.5, 65500), (1.0, 0)):
        registered = ibr.register(wall, camera, camera.moved(0, 0, -back), depth_scale=1000)
        assert set(np.unique(registered[4:-4, 4:-4]).tolist()) == {expected}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"color": np.zeros((3, 4, 3), np.uint8)}, "color: expected uint8"),
        ({"color": None}, "color: expected uint8"),
        ({"depth": np.ones((141, 193), np.uint16)}, "depth_scale: expected stored units per scene unit"),
        ({"depth": np.ones((3, 4), np.uint16), "depth_scale": 1000}, "depth: expected float32 or uint16 of shape"),
        ({"depth_scale": 1000}, "depth_scale: expected none for float32"),
        ({"color_camera": None}, "color_camera: expected a pyibr.Camera"),
    ],
)
def test_wrong_arguments(options, message):
    arguments = {"depth": np.ones((141, 193), np.float32), "depth_camera": DEPTH, "color_camera": COLOR, **options}
    with pytest.raises(ibr.ArgumentError, match=message):
        (ibr.register_color if "color" in arguments else ibr.register)(**arguments)


def test_command_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    given, _ = seen_by(DEPTH)
    _, box = seen_by(COLOR)
    DEPTH.save("depth.json")
    COLOR.save("color.json")
    ibr.write_depth("depth.png", given, depth_scale=1000)
    ibr.write_color("color.png", np.where(box[..., None], (200, 40, 40), (40, 40, 200)).astype(np.uint8))
    run = CliRunner().invoke
    cameras = ["--depth-camera", "depth.json", "--color-camera", "color.json", "--depth-scale", "1000"]
    done = run(app, ["register", "depth.png", *cameras, "-o", "registered.png"])
    assert done.exit_code == 0 and "219x163" in done.output
    stored = ibr.read_depth("depth.png", depth_scale=1000)
    expected = ibr.uint16_from_depth(ibr.register(stored, DEPTH, COLOR), 1000)
    np.testing.assert_array_equal(
        ibr.read_depth("registered.png", depth_scale=1000), ibr.depth_from_uint16(expected, 1000)
    )
    done = run(app, ["register", "depth.png", *cameras, "--color", "color.png", "-o", "colors.png"])
    assert done.exit_code == 0 and "193x141" in done.output
    found = ibr.register_color(stored, DEPTH, COLOR, ibr.read_color("color.png"))
    np.testing.assert_array_equal(ibr.read_color("colors.png"), found.color)


def test_different_cameras_at_one_place_give_a_warning():
    depth = np.full((141, 193), 2, np.float32)
    there = ibr.Camera(COLOR.K, COLOR.size)
    with pytest.warns(UserWarning, match="differ, but both stand at the origin; .* set the depth camera's world_from_"):
        ibr.register(depth, DEPTH, there)
    with pytest.warns(UserWarning, match="both stand at the origin"):
        ibr.register_color(depth, DEPTH, ibr.Camera(DEPTH.K, DEPTH.size, lens=LENS), np.zeros((141, 193, 3), np.uint8))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ibr.register(depth, DEPTH, COLOR)
        ibr.register(depth, DEPTH, DEPTH.resized((386, 282)))  # as of a phone: one viewpoint
