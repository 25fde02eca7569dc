"""Frames, depth images, meshes and cameras shown in notebooks, or saved as pictures."""

from __future__ import annotations

import io
import sys
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image, ImageShow

import pyibr as ibr
from pyibr.core.shown import picture_of
from pyibr.images.pictures import depth_colors

CAMERA = ibr.Camera([[50, 0, 30], [0, 50, 18], [0, 0, 1]], (61, 37))


@cache
def view() -> ibr.DepthImage:
    """A view of a slope, without depth in its first column, and with depth beyond `far` in its last column."""
    depth = np.tile(np.linspace(1, 9, 61, dtype=np.float32), (37, 1))
    depth[:, 0] = np.nan
    color = np.random.default_rng(0).integers(0, 256, (37, 61, 3), dtype=np.uint8)
    return ibr.DepthImage(color, depth, CAMERA, far=8.9)


def frame_of(color: np.ndarray) -> ibr.Frame:
    return ibr.Frame(color, view().known_depth, view().valid, CAMERA)


def decoded(thing: object) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(thing._repr_png_())))  # pyright: ignore[reportAttributeAccessIssue]


def test_colours_stand_beside_the_depths():
    in_float = view().in_float
    for thing in (view(), in_float, frame_of(view().color), frame_of(in_float.color)):
        shown = decoded(thing)
        np.testing.assert_array_equal(shown[:, :61], view().color)
        np.testing.assert_array_equal(shown[:, 61:], depth_colors(view()))
    assert (depth_colors(view(), (1, 2, 3))[:, [0, 60]] == (1, 2, 3)).all()  # no depth
    bare = ibr.DepthImage(None, view().depth, CAMERA, far=8.9)
    np.testing.assert_array_equal(decoded(bare), depth_colors(view()))


def test_depth_grows_darker_with_the_distance_for_both_kinds_of_cameras():
    flat = ibr.Camera([[20, 0, 30], [0, 20, 20], [0, 0, 1]], (61, 37), projection="orthographic")
    straight = ibr.Camera([[20, 0, 30], [0, 20, 20], [0, 0, 1]], (61, 37))
    depth = np.full((37, 61), np.nan, np.float32)
    depth[:, 5:] = np.linspace(1, 9, 56, dtype=np.float32)
    for camera in (flat, straight):
        frame = ibr.Frame(np.zeros((37, 61, 3), np.uint8), depth, np.isfinite(depth), camera)
        shown = depth_colors(frame, (1, 2, 3))
        assert (shown[:, :5] == (1, 2, 3)).all()
        light = shown[3, 5:].astype(int).sum(axis=1)
        assert (np.diff(light) <= 0).all() and light[0] > 600
        assert light[-1] < 150


def test_large_pictures_are_shown_smaller():
    camera = CAMERA.resized((3000, 20))
    wide = ibr.DepthImage(np.zeros((20, 3000, 3), np.uint8), np.ones((20, 3000), np.float32), camera)
    assert decoded(wide).shape[1] == 1600


def test_a_mesh_is_seen_whole():
    corners, faces = [[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]], [[0, 1, 2], [3, 2, 1]]
    colors = np.full((4, 3), (200, 30, 30), np.uint8)
    for mesh in (ibr.Mesh(corners, faces), ibr.Mesh(corners, faces, colors=colors)):
        shown = decoded(mesh)
        seen = (shown != 255).any(axis=2)
        assert 0.05 < seen.mean() < 0.6
        assert not (seen[0].any() or seen[-1].any() or seen[:, 0].any() or seen[:, -1].any())
        assert (shown[seen].std(axis=0) < 1).all()  # a plane is equally bright everywhere
    point = ibr.Mesh([[5, 5, 5]] * 3, [[0, 1, 2]])
    assert (decoded(point) == 255).all()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", ["wide", "narrow", "fisheye", "nothing at the border", "orthographic"])
def test_a_camera_is_drawn_whole_whatever_it_is(kind):
    around = ibr.Lens.from_opencv([0.0, 0.0, 0.0, 0.0], fisheye=True)
    camera = {
        "wide": ibr.Camera.from_fov((640, 480), fov_x=140),
        "narrow": ibr.Camera.from_fov((640, 480), fov_x=5),
        "fisheye": ibr.Camera([[250, 0, 320], [0, 250, 240], [0, 0, 1]], (640, 480), lens=around),
        "nothing at the border": ibr.Camera([[50, 0, 320], [0, 50, 240], [0, 0, 1]], (640, 480), lens=around),
        "orthographic": ibr.Camera([[9, 0, 30], [0, 9, 18], [0, 0, 1]], (61, 37), projection="orthographic"),
    }[kind]
    shown = decoded(camera.moved(1, 2, 3))
    inked = (shown != 255).any(axis=2)
    assert shown.shape == (240, 320, 3) and 100 < inked.sum() < 0.1 * inked.size
    assert not (inked[0].any() or inked[-1].any() or inked[:, 0].any() or inked[:, -1].any())


def test_each_saves_what_the_suffix_can_hold(tmp_path: Path):
    for thing in (view(), frame_of(view().color)):
        for name in ("a.png", "a.npy", "a.tiff", "a.npz", "a.json"):
            thing.save(tmp_path / name)
        np.testing.assert_array_equal(ibr.read_color(tmp_path / "a.png"), view().color)
        for name in ("a.npy", "a.tiff", "a.npz"):
            np.testing.assert_array_equal(ibr.read_depth(tmp_path / name), view().known_depth)
        assert ibr.Camera.load(tmp_path / "a.json") == CAMERA
        with pytest.raises(ibr.FileFormatError, match=r"no image format \.ply; known are \.png"):
            thing.save(tmp_path / "a.ply")
    with pytest.raises(ibr.ArgumentError, match=r"path: expected a depth file \(\.npy, .*as there is no colour"):
        ibr.DepthImage(None, view().depth, CAMERA).save(tmp_path / "b.png")


def test_what_has_no_picture_is_named():
    with pytest.raises(ibr.ArgumentError, match="thing: expected something that has a picture"):
        picture_of(3)


def test_outside_of_notebooks_the_systems_viewer_shows_it(monkeypatch: pytest.MonkeyPatch):
    shown: list[Image.Image] = []
    monkeypatch.setattr(ImageShow, "show", lambda image, title: not shown.append(image))
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delitem(sys.modules, "IPython", raising=False)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(ibr.Error, match="no display"):
        view().show()
    monkeypatch.setenv("WAYLAND_DISPLAY", "wayland-0")
    view().show()
    np.testing.assert_array_equal(np.asarray(shown.pop()), picture_of(view()))
    monkeypatch.setattr(ImageShow, "show", lambda image, title: False)  # there is no viewer
    with pytest.raises(ibr.Error, match="no display"):
        view().show()


def test_within_a_notebook_show_shows_it_below_the_cell(monkeypatch: pytest.MonkeyPatch):
    displayed: list[object] = []
    kernel = SimpleNamespace(kernel=None)
    display = SimpleNamespace(display=displayed.append)
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: kernel, display=display))  # pyright: ignore[reportArgumentType]
    CAMERA.show()
    assert displayed == [CAMERA]
