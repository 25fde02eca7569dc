"""`pyibr view` and `pyibr place`: inputs, errors, and sets of views that are made without a page."""

from __future__ import annotations

import sys
from pathlib import Path
from urllib.request import urlopen

import numpy as np
import pytest
from PIL import Image

import pyibr as ibr
from pyibr.app.live.pages import Pages
from pyibr.capture import models
from pyibr.capture.coverage import surface_of, unseen_share
from pyibr.capture.frusta import load_frusta, save_frusta
from pyibr.io import write_relief_map
from tests.app.commands import assert_one_line, run, succeeded
from tests.io.layouts import SPECIMENS


@pytest.fixture
def folder(folder: Path) -> Path:
    """A folder with meshes, with and without uv, a height map, an image with depth, and a folder of frames."""
    models.donut(24).save("donut.glb")
    bare = models.donut(24)
    ibr.Mesh(bare.vertices, bare.faces).save("donut.ply")
    rng = np.random.default_rng(0)
    ibr.write_color("height.png", rng.integers(0, 255, (8, 8, 3)).astype(np.uint8))
    camera = ibr.Camera([[50, 0, 30], [0, 50, 18], [0, 0, 1]], (61, 37))
    camera.save("camera.json")
    camera.save("room/camera.json")
    color, depth = rng.integers(0, 255, (37, 61, 3)).astype(np.uint8), np.full((37, 61), 2, np.float32)
    for name in ("color.png", "room/a.color.png", "room/b.color.png"):
        ibr.write_color(name, color)
    for name in ("depth.npy", "room/a.depth.npy", "room/b.depth.npy"):
        ibr.write_depth(name, depth)
    return folder


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list:
    """A list of the arguments of all calls of `ibr.view`; each page is closed at once."""
    asked: list = []
    whole = ibr.view

    def once(*arguments, **options):
        asked.append((*arguments, *options.values()))
        return whole(*arguments, **options)

    monkeypatch.setattr(ibr, "view", once)
    monkeypatch.setattr(Pages, "wait", Pages.close)
    return asked


def test_each_kind_of_thing_is_shown(folder, seen):
    def shown(*words: object):
        assert succeeded(run("view", *words, "--port", 0)).startswith("http://127.0.0.1:")
        return seen.pop()

    things, start, up, _ = shown("donut.glb")
    assert [type(thing) for thing in things] == [ibr.Mesh]
    assert (start, up) == (None, None)  # a GLB file's axes are known: up is -y here
    assert shown("donut.ply")[2] == (0.0, 1.0, 0.0)
    assert shown("donut.ply", "--up", "-z")[2] == (0.0, 0.0, -1.0)
    (photo,), *_ = shown("color.png", "depth.npy", "--fov", 90)
    assert photo.camera == ibr.Camera.from_fov(photo.camera.size, fov_x=90)
    assert shown("room", "--fov", 90)[0][1].camera == photo.camera
    SPECIMENS["depth_anything"][0](Path("scan"))  # its confidence is 5 everywhere
    assert not any(thing.valid.any() for thing in shown("scan", "--min-confidence", 6)[0])
    relative = shown("scan", "--depth-is", "relative", "--near", 2, "--far", 4)[0]
    assert all(np.ptp(thing.depth) == 2 and np.isinf(thing.far) for thing in relative)
    things, start, up, _ = shown("room", "--start", "camera.json")
    assert [type(thing) for thing in things] == [ibr.DepthImage] * 2
    assert start == ibr.Camera.load("camera.json")
    things = shown("color.png", "depth.npy", "--camera", "camera.json", "--far", "9", "donut.ply")[0]
    assert [type(thing) for thing in things] == [ibr.DepthImage, ibr.Mesh] and things[0].far == 9
    with_noise = shown("color.png", "depth.npy", "--camera", "camera.json", "--clean")[0]
    assert [type(thing) for thing in with_noise] == [ibr.DepthImage]
    told = shown("color.png", "depth.npy", "room", "--camera", "camera.json", "--noise", 2, "--baseline", 0.1)[0]
    noise = (ibr.disparity_noise(2, ibr.Camera.load("camera.json").K[0, 0], 0.1), 0, 0)
    assert [thing.noise for thing in told] == [noise] * 3
    ibr.write_video("color.mkv", np.full((3, 37, 61, 3), 90, np.uint8), 30)
    ibr.write_video("depth.mkv", np.full((3, 37, 61), 1500, np.uint16), 30, bits=16)
    (first,), *_ = shown("color.mkv", "depth.mkv", "--depth-scale", 1000, "--fov", 60)  # frames without poses
    assert (first.color == 90).all() and (first.depth == 1.5).all()
    halves = [things[0], *shown("room", "--depth-kind", "inverse")[0]]
    things = shown("color.png", "depth.npy", "--camera", "camera.json", "--depth-kind", "inverse")[0]
    for thing, depth in zip((*things, *halves), (0.5, 2, 0.5, 0.5), strict=True):
        assert (thing.depth == depth).all()
    displaced = ("donut.glb", "--height", "height.png", "--scale", "0.1")
    named = shown(*displaced, "--color", "color.png", "--tiles", "3", "2")[0]
    assert [type(named[name]) for name in ("relief", "slices")] == [ibr.ReliefSurface, ibr.SlicedSurface]
    assert named["slices"].tiles == (3, 2)
    for wrap, both in (("clamp", ("clamp", "clamp")), ("repeat,clamp", ("repeat", "clamp"))):
        assert [thing.wrap for thing in shown(*displaced, "--wrap", wrap)[0].values()] == [both] * 2


def test_heights_of_a_relief_map_are_its_alpha(folder, seen):
    """The map's red is the normal's x, not a height. A constant alpha has no heights. The mesh gives the colours."""
    rng = np.random.default_rng(1)
    normals, heights = rng.normal(0, 0.2, (8, 8, 3)) + np.array([0, 0, 1]), rng.integers(0, 256, (8, 8), dtype=np.uint8)
    own = rng.integers(0, 256, (4, 4, 3), dtype=np.uint8)
    mesh = models.donut(24)
    ibr.Mesh(mesh.vertices, mesh.faces, uv=mesh.uv, texture=own).save("painted.glb")
    write_relief_map("relief.png", normals, heights)
    write_relief_map("opaque.png", normals, np.full((8, 8), 255, np.uint8))
    Image.fromarray(np.dstack([heights] * 3 + [255 - heights])).save("gray.png")
    red = ibr.read_color("opaque.png")[..., 0]
    for name, expected in (("relief.png", heights), ("opaque.png", red), ("gray.png", heights)):
        succeeded(run("view", "painted.glb", "--height", name, "--scale", "0.1", "--port", 0))
        for thing in seen.pop()[0].values():
            np.testing.assert_allclose(thing.height, expected / 255, atol=1e-6)
            np.testing.assert_array_equal(thing.color, own)
            assert (thing.normal_map is not None) == (name == "relief.png")


def test_what_is_wrong_is_said_in_one_line(folder):
    for words, said in (
        (("color.png", "--camera", "camera.json"), ("THINGS", "a depth file after")),
        (("nowhere.ply",), ("nowhere.ply", "no such file")),
        (("donut.glb", "--height", "height.png"), ("--scale",)),
        (("donut.glb", "--height", "height.png", "--scale", "-1"), ("--scale", "> 0")),
        (("donut.ply", "--height", "height.png", "--scale", "0.1"), ("base", "uv")),
        (("room", "--height", "height.png", "--scale", "0.1"), ("--height", "one mesh")),
        (("donut.glb", "--scale", "0.1"), ("--scale", "--height")),
        (("donut.glb", "--port", "70000"), ("port", "65535")),
    ):
        assert_one_line(run("view", *words), *said)
    assert_one_line(run("place", "donut.ply", "--no-page"), "--output")
    assert_one_line(run("place", "donut.ply", "--frusta", "camera.json", "--port", "0"), "camera.json", "views")


def test_without_viser_the_package_is_named(folder, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    assert_one_line(run("view", "donut.ply"), "viser", "pip install 'pyibr-opencl[view]'")


def test_a_set_is_proposed_and_saved_without_a_page(folder, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(surface_of.__kwdefaults__, "count", 4000)  # a tenth of the points
    words = ("--auto", 3, "--size", 64, "--no-page", "-o", "set")
    out = succeeded(run("place", "donut.ply", *words))
    frusta, about = load_frusta("set")
    assert about == {"side": "front"} and len(frusta) == len(ibr.load("set")) == 3
    mesh = ibr.Mesh.load("donut.ply")
    surface = surface_of(mesh)
    share = unseen_share(surface, [surface.seen(one.capture(mesh)) for one in frusta])
    assert f"set: 3 frusta, {share:.1%} of the surface unseen" in out
    save_frusta("two.json", frusta[:2], side="both")
    more = ("--frusta", "two.json", "--auto", 1, "--size", 32, "--no-page", "-o", "more")
    succeeded(run("place", "donut.ply", *more))
    again, about = load_frusta("more")
    assert about == {"side": "both"} and again[:2] == [one.resized(32) for one in frusta[:2]]
    assert len(again) == 3


@pytest.mark.thorough
def test_a_part_is_covered_and_the_set_says_which(folder):
    words = ("--auto", 2, "--size", 32, "--no-page", "-o")
    box = (-2.0, -2.0, 2.0, 0.0, 2.0, -2.0)  # two corners, in any order
    out = succeeded(run("place", "donut.ply", *words, "half", "--within", *box))
    frusta, about = load_frusta("half")
    assert about == {"side": "front", "within": [[-2.0, -2.0, -2.0], [0.0, 2.0, 2.0]]}
    mesh = ibr.Mesh.load("donut.ply")
    surface = surface_of(mesh, within=about["within"])
    share = unseen_share(surface, [surface.seen(one.capture(mesh)) for one in frusta])
    assert f"half: 2 frusta, {share:.1%} of the surface unseen" in out
    succeeded(run("place", "donut.ply", "--frusta", "half", *words, "more"))
    assert load_frusta("more")[1] == about
    result = run("place", "donut.ply", *words, "no", "--within", 5, 5, 5, 6, 6, 6)
    assert_one_line(result, "within", "some of the surface")
    with ibr.place(mesh, "half", size=32, port=0) as pages:
        assert pages.closed is False


def test_in_a_notebook_pages_show_themselves():
    with ibr.view(models.donut(12), port=0) as pages:
        assert f'<iframe src="{pages.url}"' in pages._repr_html_()
        assert repr(pages) == f"<Pages {pages.url}>"
    assert pages.closed and "iframe" not in pages._repr_html_()
    pages.close()


@pytest.fixture
def shell():
    """Yield a shell that runs cells as a notebook does."""
    shells = pytest.importorskip("IPython.core.interactiveshell", reason="needs IPython")
    quiet = pytest.importorskip("traitlets.config").Config(HistoryManager={"enabled": False})
    made = shells.InteractiveShell.instance(config=quiet, user_ns={"ibr": ibr, "mesh": models.donut(6)})
    made.kernel = None  # as in a notebook
    yield made
    shells.InteractiveShell.clear_instance()


def test_cells_of_a_notebook_show_pages_and_things_and_go_on_beside_them(shell):
    capture = pytest.importorskip("IPython.utils.capture")

    def cell(code: str) -> list[dict[str, str]]:
        with capture.capture_output() as shown:
            shell.run_cell(code).raise_error()
        return [output.data for output in shown.outputs]

    page, mesh = cell("pages = ibr.view(mesh, port=0)\ndisplay(pages, mesh)")
    url = shell.user_ns["pages"].url
    assert f'<iframe src="{url}"' in page["text/html"]
    assert mesh == {"image/png": models.donut(6)._repr_png_(), "text/plain": repr(models.donut(6))}
    assert cell("mesh.show()") == [mesh]
    assert urlopen(url).status == 200
    assert cell("pages.close()\ndisplay(pages)")[0]["text/plain"] == f"<Pages {url}, closed>"
