"""Each control of the page of `ibr.view` changes the setting of the same name."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.app.live.panel import Panel
from pyibr.app.live.server import start_server, stop_server
from pyibr.app.view.controls import Controls
from pyibr.app.view.scene import scene_of
from pyibr.capture import models

pytest.importorskip("viser")


@pytest.fixture
def controls():
    server = start_server(0, "test")
    yield Controls(Panel(server.gui), scene_of({"a": models.donut(6), "b": models.donut(8)}), lambda: None)
    stop_server(server)


def light_of(controls: Controls) -> dict[str, Any]:
    light = controls.style().light
    return {name: getattr(light, name) for name in inspect.signature(ibr.Light).parameters}


def test_every_option_of_a_light_has_its_control(controls):
    turned = {
        "_above": (-20, {"direction"}),
        "_around": (100, {"direction"}),
        "_distance": (2.0, {"direction", "position"}),
        "_spot": (60, {"direction", "angle"}),
        "_color": ((255, 0, 127), {"color"}),
        "_ambient": (0.5, {"ambient"}),
        "_specular": (1.0, {"specular"}),
        "_shininess": (8, {"shininess"}),
        "_shadows": ("0", {"shadow_size"}),
        "_relights": (True, {"relight"}),
    }
    assert set().union(*(changes for _, changes in turned.values())) == set(inspect.signature(ibr.Light).parameters)
    for handle, (value, changes) in turned.items():
        before = light_of(controls)
        assert controls.style().light is controls.style().light  # the same light, so that its shadow maps are kept
        getattr(controls, handle).value = value
        after = light_of(controls)
        assert {name for name in after if not np.array_equal(before[name], after[name])} == changes, handle
    spot, scene = controls.style().light, controls._scene
    towards = (spot.position - scene.pivot) / np.linalg.norm(spot.position - scene.pivot)
    np.testing.assert_allclose(towards, -spot.direction, atol=1e-12)
    controls._lit.value = False
    assert controls.style().light is None


def test_every_option_of_a_picture_has_its_control(controls):
    controls._samples.value, controls._anisotropy.value, controls._background.value = "4", 8, (9, 8, 7)
    style = controls.style()
    assert (style.samples, style.anisotropy, style.background) == (4, 8, (9, 8, 7))
    options = set(inspect.signature(ibr.render).parameters) - {"things", "camera"}
    assert options == {"samples", "anisotropy", "background", "light"}


def test_what_is_typed_is_a_number_a_word_or_nothing(controls):
    view = ibr.DepthImage(None, np.ones((6, 6), np.float32), ibr.Camera.from_fov((6, 6), fov_y=40))
    solid = ibr.DepthObject([view], slices="view")
    typed = Controls(Panel(controls._panel.gui), scene_of(solid), lambda: None)
    values = dict(typed.style().parameters)
    assert (values["slices"], values["only"]) == ("view", None)
    typed._parameters["slices"][1].value, typed._parameters["only"][1].value = " 32", "0"
    values = dict(typed.style().parameters)
    assert (values["slices"], values["only"]) == (32, 0)
