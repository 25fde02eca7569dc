"""Files of several images' cameras: lists and folders of JSON files, COLMAP's models, scenes."""

from __future__ import annotations

import json
import random
import struct
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture.sets import write_set
from pyibr.io import read_cameras, write_cameras
from pyibr.io.layouts import recording_in
from tests.core.test_calibrations import same
from tests.data import shared
from tests.io.damages import damaged

LENS = ibr.Lens("brown_conrady", [-0.2, 0.05, 0.001, 0])
K, OTHER_K = [[50, 0, 30], [0, 51, 18], [0, 0, 1]], [[70, 0, 20], [0, 70, 30], [0, 0, 1]]
CAMERAS = {
    "image_9.jpg": ibr.Camera(K, (61, 37)).moved(1, 2, 3),
    "image_10.jpg": ibr.Camera(K, (61, 37), lens=LENS).orbited(30, (0, 0, 2)),
    "with space.png": ibr.Camera(OTHER_K, (41, 61)).orbited(-170, (0, 1, 2), axis=(1, 1, 0)),
}


def model(folder: Path, kind: str, of: dict[str, ibr.Camera] = CAMERAS) -> None:
    """Write a COLMAP model with a camera of its own for each image, as text or binary."""
    folder.mkdir(parents=True)
    numbers = {"PINHOLE": 1, "OPENCV": 4}
    cameras, images = ["# cameras"], ["# images"]
    packed = [struct.pack("<Q", len(of)), struct.pack("<Q", len(of))]
    for number, (name, camera) in enumerate(of.items(), 5):
        form, params, qvec, tvec = camera.to_colmap()
        cameras.append(f"{number} {form} {camera.width} {camera.height} " + " ".join(map(repr, params.tolist())))
        images.append(f"{number + 7} " + " ".join(map(repr, [*qvec.tolist(), *tvec.tolist()])) + f" {number} {name}")
        images.append("" if number == 5 else "1.5 2.5 -1 3.5 4.5 17")
        packed[0] += struct.pack("<iiQQ", number, numbers[form], *camera.size) + params.tobytes()
        points = b"" if number == 5 else bytes(48)
        packed[1] += struct.pack("<i7di", number + 7, *qvec, *tvec, number) + name.encode() + b"\0"
        packed[1] += struct.pack("<Q", len(points) // 24) + points
    if kind == "text":
        (folder / "cameras.txt").write_text("\n".join(cameras) + "\n")
        (folder / "images.txt").write_text("\n".join(images) + "\n")
    else:
        (folder / "cameras.bin").write_bytes(packed[0])
        (folder / "images.bin").write_bytes(packed[1])


@pytest.mark.parametrize("kind", ["text", "binary"])
@pytest.mark.parametrize("place", ["", "0"])
def test_colmap(tmp_path: Path, kind, place):
    model(tmp_path / "sparse" / place, kind)
    found = read_cameras(tmp_path / "sparse")
    assert list(found) == sorted(CAMERAS)
    for name, camera in CAMERAS.items():
        same(found[name], camera)


@pytest.mark.thorough
def test_real_colmap_models_as_text_and_binary_are_one():
    text, binary = (read_cameras(shared(f"formats/colmap_{name}")) for name in ("text", "dense_binary/sparse"))
    assert len(text) == 3 and len(binary) == 28
    for name, camera in text.items():
        same(camera, binary[name])


def test_json_of_one_and_of_a_list(tmp_path: Path):
    for name, camera in CAMERAS.items():
        camera.save(tmp_path / name.replace(".jpg", ".json").replace(".png", ".json"))
    named = read_cameras(tmp_path)
    assert list(named) == ["image_9", "image_10", "with space"]  # 9 before 10, by number
    for one, other in zip(named.values(), CAMERAS.values(), strict=True):
        assert one == other
    assert read_cameras(tmp_path / "image_9.json") == {"0": CAMERAS["image_9.jpg"]}
    listed = [json.loads((tmp_path / f"{name}.json").read_text()) for name in named]
    (tmp_path / "all.json").write_text(json.dumps(listed))
    assert list(read_cameras(tmp_path / "all.json").values()) == list(named.values())


def test_a_matrix_needs_the_size_of_the_images(tmp_path: Path):
    camera = CAMERAS["image_9.jpg"]
    np.savetxt(tmp_path / "K.txt", camera.K)
    same(read_cameras(tmp_path / "K.txt", size=(61, 37))["0"], ibr.Camera(camera.K, (61, 37)))
    said = r"^size: expected the \(width, height\) of the images whose K is in .*K\.txt"
    with pytest.raises(ibr.ArgumentError, match=said):
        read_cameras(tmp_path / "K.txt")
    for text, message in (("1 2 3", "K.txt: K: expected"), ("words", "K.txt: no camera in it: expected K")):
        (tmp_path / "K.txt").write_text(text)
        with pytest.raises(ibr.FileFormatError, match=message):
            read_cameras(tmp_path / "K.txt", size=(61, 37))


def test_sets_have_cameras(tmp_path: Path):
    depth = np.full((37, 61), 2, np.float32)
    views = [ibr.DepthImage(np.zeros((37, 61, 3), np.uint8), depth, CAMERAS[f"image_{k}.jpg"]) for k in (9, 10)]
    write_set(tmp_path, views)
    assert list(read_cameras(tmp_path / "frusta.json").values()) == [view.camera for view in views]
    assert recording_in(tmp_path).cameras == (tmp_path / "frusta.json",)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]", "expected cameras, got an empty list"),
        ("[3]", "camera 0: expected a JSON object, got int"),
        ('[{"width": 3}]', "camera 0: has no height, fx"),
        ('[{"width": 3, "height": 2, "fx": -1, "fy": 1, "cx": 0, "cy": 0}]', "camera 0: K"),
        ("7", "expected a JSON object, got int"),
        ('{"views": 3}', "expected a JSON object, got int"),
        ('{"views": [3]}', "camera 0: expected a JSON object, got int"),
        ('{"views": [{}]}', "camera 0: expected a JSON object, got NoneType"),
        ("[", "not a readable camera JSON file"),
    ],
)
def test_what_is_no_list_of_cameras(tmp_path: Path, text, message):
    (tmp_path / "c.json").write_text(text)
    with pytest.raises(ibr.FileFormatError, match=f"c.json: {message}"):
        read_cameras(tmp_path / "c.json")


def test_folders_without_cameras(tmp_path: Path):
    with pytest.raises(ibr.FileFormatError, match="no cameras in it"):
        read_cameras(tmp_path)
    with pytest.raises(ibr.FileFormatError, match="no such file"):
        read_cameras(tmp_path / "none")
    model(tmp_path / "a", "text")
    (tmp_path / "a/images.txt").unlink()
    with pytest.raises(ibr.FileFormatError, match=r"images.txt: no such file"):
        read_cameras(tmp_path / "a")
    for text, said in (
        ("1 1 0 0 0 0 0 0 99 x.png\n\n", "x.png has camera 99, which .*cameras.txt lacks"),
        ("1 0 0 0 0 0 0 0 5 x.png\n\n", "x.png: qvec"),
        ("# none\n", "holds no image"),
    ):
        (tmp_path / "a/images.txt").write_text(text)
        with pytest.raises(ibr.FileFormatError, match=said):
            read_cameras(tmp_path / "a")


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin"])
def test_damaged_binary_models(tmp_path: Path, name):
    model(tmp_path / "a", "binary")
    whole, rng = (tmp_path / "a" / name).read_bytes(), random.Random(name)
    for number in range(400):
        (tmp_path / "a" / name).write_bytes(damaged(whole, rng, number))
        try:
            read_cameras(tmp_path / "a")
        except ibr.FileFormatError as error:
            assert name in str(error) or "images.bin" in str(error)


def test_cameras_of_a_gltf_scene(tmp_path):
    """A camera's node is rotated by 90 degrees about y, so that it looks along its parent's -x; the parent is moved."""
    lens = {"type": "perspective", "perspective": {"yfov": 2 * np.arctan(0.5), "znear": 0.1}}
    flat = {"type": "orthographic", "orthographic": {"xmag": 2, "ymag": 1, "znear": 0.1, "zfar": 9}}
    turned = {"name": "a", "camera": 0, "rotation": [0, np.sqrt(0.5), 0, np.sqrt(0.5)], "scale": [2, 2, 2]}
    nodes = [{"translation": [5, 0, 0], "children": [1, 2]}, turned, {"camera": 1}]
    told = {"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": nodes, "cameras": [lens, flat]}
    (tmp_path / "scene.gltf").write_text(json.dumps(told))
    found = read_cameras(tmp_path / "scene.gltf", size=(64, 32))
    assert list(found) == ["a", "2"]
    np.testing.assert_allclose(found["a"].K, [[32, 0, 31.5], [0, 32, 15.5], [0, 0, 1]], atol=1e-12)
    pixels, depth = found["a"].project([[3.0, 1.0, 0.0]])  # a point 2 units in front of the camera, 1 above its axis
    np.testing.assert_allclose(pixels, [[31.5, -0.5]], atol=1e-9)
    np.testing.assert_allclose(depth, [2], atol=1e-12)
    pixels, _ = found["2"].project([[7.0, -1.0, -4.0]])  # a point at the image's right and lower borders
    np.testing.assert_allclose(pixels, [[63.5, 31.5]], atol=1e-9)
    with pytest.raises(ibr.ArgumentError, match="size: expected"):
        read_cameras(tmp_path / "scene.gltf")


def test_parameters_of_several_views(tmp_path):
    camera = ibr.Camera([[60, 0, 30], [0, 62, 24], [0, 0, 1]], (64, 48)).moved(0.3, 0.1, 0).orbited(20, (0, 0, 2))
    pose = camera.camera_from_world
    row = " ".join(map(repr, [*camera.K.ravel().tolist(), *pose[:3, :3].ravel().tolist(), *pose[:3, 3].tolist()]))
    (tmp_path / "thing_par.txt").write_text(f"2\nthing01.png {row}\nthing02.png {row}\n")
    found = read_cameras(tmp_path / "thing_par.txt", size=(64, 48))
    assert list(found) == ["thing01.png", "thing02.png"]
    np.testing.assert_allclose(found["thing02.png"].world_from_camera, camera.world_from_camera, atol=1e-12)
    np.testing.assert_array_equal(found["thing01.png"].K, camera.K)


BENT = ibr.Lens("kannala_brandt", [0.1, -0.02, 0.003, 0.001])


@pytest.mark.parametrize("form", ["pyibr", "colmap", "nerfstudio", "open3d"])
def test_what_is_written_is_read(tmp_path: Path, form):
    cameras = dict(CAMERAS) if form != "nerfstudio" else {"images/a.png": CAMERAS["image_9.jpg"], **CAMERAS}
    if form == "open3d":
        cameras = {name: camera for name, camera in CAMERAS.items() if camera.lens is None}
    elif form != "nerfstudio":  # Nerfstudio's frames are all perspective, or all fisheye
        cameras["fish.png"] = ibr.Camera(CAMERAS["image_9.jpg"].K, (61, 37), lens=BENT)
    path = tmp_path / ("model" if form == "colmap" else "transforms.json")
    write_cameras(path, cameras, form)
    found = read_cameras(path)
    named = {name.removeprefix("images/"): camera for name, camera in cameras.items()}
    expected = named if form in ("colmap", "nerfstudio") else dict(zip(found, cameras.values(), strict=True))
    assert found.keys() == expected.keys()
    for name, camera in expected.items():
        same(found[name], camera)
        if camera.lens is not None and found[name].lens is not None:
            np.testing.assert_allclose(found[name].lens.coefficients[:4], camera.lens.coefficients[:4], rtol=1e-12)
    if form == "colmap":  # equal intrinsics are stored once
        assert len((path / "cameras.txt").read_text().splitlines()) == 4


@pytest.mark.parametrize("form", ["colmap", "nerfstudio", "open3d"])
def test_what_a_form_cannot_tell_is_refused(tmp_path: Path, form):
    flat = ibr.Camera([[50, 0, 30], [0, 50, 18], [0, 0, 1]], (61, 37), projection="orthographic")
    with pytest.raises(ibr.ArgumentError, match="camera"):
        write_cameras(tmp_path / "out", {"a.png": flat}, form)
    with pytest.raises(ibr.ArgumentError, match="cameras: expected one or more"):
        write_cameras(tmp_path / "out", {}, form)
    assert not list(tmp_path.iterdir())
