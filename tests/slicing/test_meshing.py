"""Meshes of solids: they are closed, and their pictures show what pictures of the solids show."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import MeshScene, object_views
from pyibr.slicing import meshing
from tests.boxes import cuboid
from tests.one_lane import both_forms
from tests.slicing.solids import cup, looking, torus, views_of_torus

KINDS = (ibr.DepthObject, ibr.VisualHull)


def check_closed(mesh: ibr.Mesh) -> None:
    """Assert that each edge belongs to two triangles, which run along it in opposite directions."""
    edges = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    keys, back = (edges @ (len(mesh.vertices), 1), edges @ (1, len(mesh.vertices)))
    assert len(np.unique(keys)) == len(keys)
    np.testing.assert_array_equal(np.sort(keys), np.sort(back))


def volume(mesh: ibr.Mesh) -> float:
    a, b, c = mesh.vertices.astype(np.float64)[mesh.faces].transpose(1, 0, 2)
    return float((a * np.cross(b, c)).sum() / 6)


@pytest.mark.parametrize("make", KINDS)
@pytest.mark.parametrize("scene", [torus, cup])
def test_a_mesh_is_closed_and_shows_what_the_solid_does(make, scene):
    thing = make(object_views(scene(), 96), slices=256)
    mesh = thing.to_mesh(90)
    check_closed(mesh)
    for direction in ((0.5, 0.4, 1), (-1, 0.8, 0.2), (0.2, 1.5, 0.3)):
        camera = looking(scene(), direction, (160, 120))
        solid, drawn = ibr.render(thing, camera), ibr.render(mesh, camera)
        both = solid.valid & drawn.valid
        assert both.sum() >= 0.985 * (solid.valid | drawn.valid).sum()  # the mesh's cells are 1.5 pixels wide
        cell = float(thing.box.edges.max()) / 90
        assert np.quantile(np.abs(solid.depth - drawn.depth)[both], 0.9) <= 0.5 * cell
        # Where a hull is not the object's surface, its views saw different colours; a mesh weighs them differently.
        assert np.abs(solid.color.astype(int) - drawn.color)[both].mean() <= (4 if make is ibr.DepthObject else 6)


@pytest.mark.parametrize("resolution", [1, 2, 7, 40])
def test_a_box_has_its_volume(resolution, lanes):
    scene = MeshScene(*cuboid((-1, -1, -0.4), (1, 1, 0.4)))
    mesh = ibr.DepthObject(object_views(scene, 101)).to_mesh(resolution)
    check_closed(mesh)
    if resolution == 40:  # the mesh cuts edges off: 1/8 of a cell's area, and twice as much where cuts are slanted
        lost = 0.25 * (2 / resolution) ** 2 * (8 * 2 + 4 * 0.8)
        assert 3.2 - lost <= volume(mesh) <= 3.2 * 1.02  # the box is a hundred samples wide


def test_an_image_of_unknown_depth_leaves_a_closed_mesh():
    """Such an image limits nothing, so that the solid reaches the box, whose sides close the mesh."""
    views = views_of_torus("four")
    depth = np.where(views[0].valid, views[0].depth, np.nan).astype(np.float32)
    thing = ibr.DepthObject([ibr.DepthImage(views[0].color, depth, views[0].camera)], missing="unknown")
    check_closed(thing.to_mesh(20))


def test_thin_things_have_meshes():
    views = object_views(torus(), 48)
    check_closed(ibr.DepthObject(views, thin=True).to_mesh(30))


def test_the_log_tells_how_far_a_mesh_is(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture):
    monkeypatch.setattr(meshing, "_SILENT_MAX", 0.0)
    caplog.set_level("INFO", "pyibr")
    ibr.DepthObject(object_views(torus(), 48)).to_mesh(8)
    assert "100 % of its grid is tested" in caplog.text


@pytest.mark.parametrize("wrong", [0, -1, 1025, 2.5, "64", None, True])
def test_resolution_is_a_number(wrong):
    thing = ibr.DepthObject(views_of_torus("orthographic"))
    with pytest.raises(ibr.ArgumentError, match=r"^resolution: "):
        thing.to_mesh(wrong)


@pytest.mark.thorough
def test_both_forms_of_kernels_find_the_same_mesh():
    views = views_of_torus("nine, anywhere")
    wide, narrow = both_forms(lambda: ibr.DepthObject(views).to_mesh(31))
    assert len(wide.faces) > 1000
    assert abs(len(wide.faces) - len(narrow.faces)) <= 1e-3 * len(wide.faces)
    assert abs(volume(wide) / volume(narrow) - 1) <= 1e-4
