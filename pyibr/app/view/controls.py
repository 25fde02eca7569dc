"""The controls of a page for looking around, and the style that they select."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from decimal import Decimal
from functools import lru_cache
from threading import Lock
from typing import TYPE_CHECKING, Any, cast, get_args

import numpy as np

from pyibr.app.live.panel import Panel
from pyibr.app.view.methods import Layout, Show, Style
from pyibr.app.view.parameters import Parameter, Value
from pyibr.app.view.scene import Scene
from pyibr.core.checks import Float64
from pyibr.core.errors import Error
from pyibr.picture.light import Light

if TYPE_CHECKING:
    from viser import GuiInputHandle

_NOTHING = "nothing"
_SAMPLES, _SHADOWS = ("1", "4", "9", "16"), ("0", "512", "1024", "2048", "4096")
LABELS: dict[Show, str] = {
    "color": "colors",
    "depth": "depth",
    "classes": "pixel classes",
    "view": "source views",
}
"""Labels of the shown quantities in their control."""


class Controls:
    """A page's controls; `changed` is called when a control has changed.

    Attributes
    ----------
    frusta, times : handles of checkboxes
        Whether the sources' frusta are shown, and whether kernels are timed.
    """

    def __init__(self, panel: Panel, scene: Scene, changed: Callable[[], None]) -> None:
        self._panel, self._gui, self._scene, self._changed = panel, panel.gui, scene, changed
        self._parameters: dict[str, tuple[Parameter, Any]] = {}
        self._parameter_folder: Any = None
        self._lock = Lock()  # two threads may handle changes of the method
        with panel.controls:
            self._add_picture()
            self._add_light()
            with self._gui.add_folder("Page", expand_by_default=False, order=7):
                self.frusta = self._watched(self._gui.add_checkbox("Sources", True, visible=bool(scene.sources)))
                self.times = self._watched(self._gui.add_checkbox("Kernel times", False))
                panel.add_dark()
        self._add_parameters()

    def style(self) -> Style:
        """Return the style that the controls select now."""
        shows: dict[str, Show] = {text: name for name, text in LABELS.items()}
        other = self._other.value
        return Style(
            self._method.value,
            None if other == _NOTHING else other,
            cast("Layout", self._layout.value),
            self._swipe.value,
            self._gain.value,
            shows[self._show.value],
            self._light(),
            cast("tuple[int, int, int]", tuple(self._background.value)),
            tuple((name, _value(parameter, handle)) for name, (parameter, handle) in self._parameters.items()),
            int(self._samples.value),
            int(self._anisotropy.value),
        )

    # ---- controls

    def _add_picture(self) -> None:
        gui, methods = self._gui, list(self._scene.methods)
        explains = any(method.explains for method in self._scene.methods.values())
        shown = [text for name, text in LABELS.items() if explains or name in ("color", "depth")]
        with gui.add_folder("Picture", order=1):
            self._method = self._watched(gui.add_dropdown("Method", methods))
            self._show = self._watched(gui.add_dropdown("Show", shown))
            self._other = self._watched(gui.add_dropdown("Compare with", [_NOTHING, *methods]))
            layouts = [one for one in get_args(Layout) if one != "one"]
            self._layout = self._watched(gui.add_dropdown("As", layouts, visible=False))
            self._swipe = self._watched(gui.add_slider("Line", 0.0, 1.0, 0.01, 0.5, visible=False))
            self._gain = self._watched(gui.add_slider("Difference times", 1.0, 32.0, 1.0, 4.0, visible=False))
            self._background = self._watched(gui.add_rgb("Background", (0, 0, 0)))
            self._samples = self._watched(gui.add_dropdown("Samples a pixel", list(_SAMPLES)))
            self._anisotropy = self._watched(gui.add_slider("Anisotropy", 1, 16, 1, 1))

        @self._other.on_update
        @self._layout.on_update
        def _(_: Any) -> None:
            compared = self._other.value != _NOTHING
            self._layout.visible = compared
            self._swipe.visible = compared and self._layout.value == "swipe"
            self._gain.visible = compared and self._layout.value != "swipe"

        @self._method.on_update
        def _(_: Any) -> None:
            self._add_parameters()

    def _add_parameters(self) -> None:
        """Add controls for the parameters of the selected method's things."""
        with self._lock, self._panel.controls:
            if self._parameter_folder is not None:
                self._parameter_folder.remove()
                self._parameter_folder, self._parameters = None, {}
            try:
                parameters = self._scene.methods[self._method.value].parameters
            except Error:  # its things cannot be made; the page shows this error when it draws them
                return
            if not parameters:
                return
            self._parameter_folder = self._gui.add_folder("Things", expand_by_default=False, order=3)
            with self._parameter_folder:
                self._parameters = {
                    name: (parameter, self._watched(self._handle_of(parameter)))
                    for name, parameter in parameters.items()
                }

    def _handle_of(self, parameter: Parameter) -> Any:
        label = parameter.name.replace("_", " ").replace(".", " ").capitalize()
        if parameter.kind is str and not parameter.choices:
            text = "" if parameter.value is None else str(parameter.value)
            return self._gui.add_text(label, text, hint="A number, a word, or empty")
        if parameter.kind is str:
            words = [_NOTHING if choice is None else choice for choice in parameter.choices]
            return self._gui.add_dropdown(
                label, words, initial_value=_NOTHING if parameter.value is None else str(parameter.value)
            )
        if parameter.kind is bool:
            return self._gui.add_checkbox(label, bool(parameter.value))
        if parameter.kind is int:
            return self._gui.add_number(label, int(parameter.value or 0), step=1)
        return self._gui.add_number(label, float(parameter.value or 0), step=_step(float(parameter.value or 0)))

    def _add_light(self) -> None:
        gui = self._gui
        with gui.add_folder("Light", expand_by_default=False, order=4):
            self._lit = self._watched(gui.add_checkbox("On", self._scene.plain))
            self._around = self._watched(gui.add_slider("Around", -180, 180, 1, 30))
            self._above = self._watched(gui.add_slider("Above", -90, 90, 1, 45))
            self._distance = self._watched(gui.add_slider("Away (0: far)", 0.0, 4.0, 0.05, 0.0))
            self._spot = self._watched(gui.add_slider("Spot (0: none)", 0, 179, 1, 0))
            self._color = self._watched(gui.add_rgb("Color", (255, 255, 255)))
            self._ambient = self._watched(gui.add_slider("Ambient", 0.0, 1.0, 0.05, 0.25))
            self._specular = self._watched(gui.add_slider("Specular", 0.0, 2.0, 0.05, 0.0))
            self._shininess = self._watched(gui.add_slider("Shininess", 1, 200, 1, 32))
            self._shadows = self._watched(gui.add_dropdown("Shadow map", list(_SHADOWS), initial_value="1024"))
            self._relights = self._watched(gui.add_checkbox("Relight images", False))

    # ---- values

    def _light(self) -> Light | None:
        if not self._lit.value:
            return None
        scene, away = self._scene, self._distance.value
        towards = _direction(scene.up, np.radians(self._around.value), np.radians(self._above.value))
        radius = float(np.linalg.norm(scene.start.center - scene.pivot))
        return _light_from(
            direction=None if away and not self._spot.value else tuple(-towards),
            position=tuple(scene.pivot + away * radius * towards) if away else None,
            color=tuple(np.array(self._color.value) / 255),
            ambient=self._ambient.value,
            angle=self._spot.value or 90.0,
            specular=self._specular.value,
            shininess=self._shininess.value,
            shadow_size=int(self._shadows.value),
            relight=self._relights.value,
        )

    def _watched(self, handle: GuiInputHandle[Any]) -> Any:
        handle.on_update(lambda _: self._changed())
        return handle


def _value(parameter: Parameter, handle: Any) -> Value:
    if parameter.kind is str and not parameter.choices:
        return _typed(handle.value.strip())
    is_none = handle.value == _NOTHING if None in parameter.choices else parameter.may_be_none and not handle.value
    return None if is_none else parameter.kind(handle.value)


def _typed(text: str) -> Value:
    """Parse a number or a word; None for an empty text."""
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text or None


def _step(value: float) -> float:
    """The step of a control for a number of this size: a tenth of it, or its last digit."""
    if not value:
        return 0.01
    exponent = cast("int", Decimal(repr(value)).normalize().as_tuple().exponent)
    return float(10.0 ** min(np.floor(np.log10(abs(value)) - 1), max(exponent, -3)))


@lru_cache(maxsize=8)
def _light_from(**settings: Any) -> Light:
    """Return the same light for the same settings, so that it keeps its shadow maps."""
    return Light(**settings)


def _direction(up: Float64, around: float, above: float) -> Float64:
    """Direction of a light from its two angles."""
    side = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    side /= np.linalg.norm(side)
    level = np.cos(around) * side + np.sin(around) * np.cross(up, side)
    made: Float64 = np.cos(above) * level + np.sin(above) * up
    return made
