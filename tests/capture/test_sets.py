"""Folders of depth images: their layouts are recognised, and errors name the bad file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture.sets import load, read_set, write_set
from tests.data import shared

SIZE = (7, 13)
BROWN = ibr.Lens("brown_conrady", [-0.01, 0.002, 0.001, -0.001, 0.0005])


def camera(x: float = 0.0, lens: ibr.Lens | None = None) -> ibr.Camera:
    return ibr.Camera([[50, 0, 3], [0, 50, 6], [0, 0, 1]], SIZE, lens=lens).moved(x, 0.1, 0).orbited(5, (0, 0, 2))


def view(x: float = 0.0, **how) -> ibr.DepthImage:
    rng = np.random.default_rng(int(10 * x))
    depth = rng.uniform(1, 3, SIZE[::-1]).astype(np.float32)
    depth[0, :3] = np.nan, np.inf, 0
    return ibr.DepthImage(rng.integers(0, 255, (*SIZE[::-1], 3)).astype(np.uint8), depth, camera(x), **how)


def assert_same(found: ibr.DepthImage, expected: ibr.DepthImage) -> None:
    np.testing.assert_array_equal(found.color, expected.color)
    np.testing.assert_array_equal(found.depth, expected.depth)
    assert found.camera == expected.camera
    assert found.far == expected.far


def test_a_set_is_read_as_it_was_written(tmp_path):
    views = [view(0.0), view(1.0, far=2.5), view(2.0).in_float]
    write_set(tmp_path / "set", views, [{"strokes": []}, {}, {}], side="back")
    for found, expected in zip(load(tmp_path / "set"), views, strict=True):
        assert_same(found, expected)
    entries, about = read_set(tmp_path / "set")
    assert about == {"side": "back"}
    assert entries[0].more == {"strokes": []}


def test_a_set_that_cannot_be_written_leaves_the_former_one(tmp_path):
    """Otherwise the old list would name pictures of the new set as its own."""
    views = [view(0.0), view(1.0)]
    write_set(tmp_path, views)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(TypeError, match="not JSON serializable"):
        write_set(tmp_path, [view(2.0), view(3.0)], side=object())
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize("layout", ["names", "folders", "rgb"])
@pytest.mark.parametrize("cameras", ["own", "pose", "matrix"])
def test_frames_are_read_in_the_order_of_their_names(tmp_path, layout, cameras):
    views = {"b": view(1.0), "a": view(0.0), "c": view(2.0)}

    def path(name: str, kind: str, ending: str) -> Path:
        if layout == "names":
            return tmp_path / f"{name}.{kind}{ending}"
        made = tmp_path / ("rgb" if layout == "rgb" and kind == "color" else kind) / f"{name}{ending}"
        made.parent.mkdir(exist_ok=True)
        return made

    for name, one in views.items():
        ibr.write_color(path(name, "color", ".png"), one.color)
        ibr.write_depth(path(name, "depth", ".npy"), one.depth)
        if cameras == "own":
            one.camera.save(tmp_path / f"{name}.json" if layout == "names" else path(name, "camera", ".json"))
        else:
            np.savetxt(path(name, "pose", ".txt"), one.camera.world_from_camera, fmt="%.17g")
    if cameras == "pose":
        camera().save(tmp_path / "camera.json")
    elif cameras == "matrix":
        np.savetxt(tmp_path / "camera-intrinsics.txt", camera().K)
    for found, name in zip(load(tmp_path), "abc", strict=True):
        assert_same(found, views[name])


def test_the_camera_of_all_frames_keeps_its_lens(tmp_path):
    lens = ibr.Lens("brown_conrady", [-0.2, 0.02, 0, 0])
    camera(lens=lens).save(tmp_path / "camera.json")
    ibr.write_color(tmp_path / "a.color.png", view().color)
    ibr.write_depth(tmp_path / "a.depth.npy", view().depth)
    np.savetxt(tmp_path / "a.pose.txt", np.eye(4))
    assert load(tmp_path)[0].camera.lens == lens


def write(folder, name: str, content: object) -> None:
    (folder / name).write_text(content if isinstance(content, str) else json.dumps(content))


def test_what_is_wrong_is_said_by_name(tmp_path):
    with pytest.raises(ibr.FileFormatError, match=r"nowhere: no such folder"):
        load(tmp_path / "nowhere")
    with pytest.raises(ibr.FileFormatError, match=r"found neither frusta\.json nor frames of colour and depth"):
        load(tmp_path)
    one = {"camera": camera().to_json()}
    for content, said in (
        ("[", "not a readable frusta JSON file"),
        ({"views": 3}, "expected a JSON object with a list of views"),
        ({"views": [3]}, "expected views with a camera each, got int 3"),
        ({"views": [{"camera": {}}]}, "has no width"),
        ({"views": [one | {"far": -1}]}, "far: expected a depth > 0"),
        ({"views": [one | {"color": "../x.png"}]}, "expected the name of a file beside it"),
        ({"views": [one]}, "has only cameras"),
        ({"views": [one | {"color": "none.png", "depth": "none.npy"}]}, "none.png: no such file"),
    ):
        write(tmp_path, "frusta.json", content)
        with pytest.raises(ibr.FileFormatError) as raised:
            load(tmp_path)
        assert said in str(raised.value), said
    (tmp_path / "frusta.json").unlink()
    ibr.write_color(tmp_path / "a.color.png", view().color)
    ibr.write_depth(tmp_path / "a.depth.npy", view().depth)
    with pytest.raises(ibr.FileFormatError, match=r"neither a\.json nor camera\.json"):
        load(tmp_path)
    camera().save(tmp_path / "camera.json")
    for pose in ("1 2 3", "a b", "\n".join(["2 0 0 0"] * 4)):
        write(tmp_path, "a.pose.txt", pose)
        with pytest.raises(ibr.FileFormatError, match=r"a\.pose\.txt: "):
            load(tmp_path)
    (tmp_path / "a.pose.txt").unlink()
    ibr.write_depth(tmp_path / "a.depth.npy", view().depth[:5])
    with pytest.raises(ibr.FileFormatError, match=r"a\.depth\.npy: depth: expected"):
        load(tmp_path)
    ibr.write_depth(tmp_path / "a.depth.png", np.ones(SIZE[::-1], np.float32), depth_scale=1000)
    with pytest.raises(ibr.ArgumentError, match="scale"):
        load(tmp_path)


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "count"), [("rgbd_realsense_shelf", 9), ("formats/7scenes_tsdf_fusion", 5)])
def test_real_folders_are_read_as_they_are(name, count):
    views = load(shared(name), depth_scale=1000)
    assert len(views) >= count
    # Neighbouring frames see the same room: warped to the next frame's camera, depth agrees with that frame.
    one, other = views[0], views[1]
    frame = ibr.warp(one, other.camera)
    both = frame.valid & other.valid
    assert both.mean() > 0.02
    assert np.median(np.abs(frame.depth - other.depth)[both]) < 0.01


def test_saved_views_are_read_back_and_read_by_others(tmp_path):
    """Read by pyibr's list, views keep their bits; by transforms.json alone, depth agrees to a stored unit."""
    views = [view(0.0), view(1.0, far=2.5), ibr.DepthImage(view().color, view().depth, camera(lens=BROWN))]
    ibr.save(views, tmp_path)
    for found, expected in zip(load(tmp_path), views, strict=True):
        assert_same(found, expected)
    (tmp_path / "frusta.json").unlink()
    for found, expected in zip(load(tmp_path), views, strict=True):
        np.testing.assert_array_equal(found.color, expected.color)
        np.testing.assert_array_equal(found.valid, expected.valid)
        np.testing.assert_allclose(found.depth[found.valid], expected.depth[found.valid], atol=0.00051)
        np.testing.assert_allclose(found.camera.K, expected.camera.K, rtol=1e-12)
        np.testing.assert_allclose(found.camera.world_from_camera, expected.camera.world_from_camera, atol=1e-12)
        assert found.camera.lens == expected.camera.lens


def test_what_transforms_json_cannot_tell_is_saved_for_pyibr_alone(tmp_path):
    flat = ibr.Camera([[2, 0, 3], [0, 2, 6], [0, 0, 1]], SIZE, projection="orthographic")
    ibr.save(ibr.DepthImage(view().color, view().depth, flat), tmp_path)
    assert load(tmp_path)[0].camera == flat and not (tmp_path / "transforms.json").exists()
    with pytest.raises(ibr.ArgumentError, match="views: expected depth images"):
        ibr.save([camera()], tmp_path)
