"""The panel of a page: what it says, and its controls, beside the picture or, in a narrow window, closed below it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from viser import GuiApi

_BAR = 8, 180  # pixels from the upper left corner, and its width


def set_theme(gui: GuiApi, dark: bool = False) -> None:
    """Make a page light or dark; nothing of it can be shared through servers on the internet."""
    gui.configure_theme(dark_mode=dark, show_logo=False, show_share_button=False)


class Panel:
    """A panel of its own, since viser closes such in narrow windows, and its main one never.

    The main one is left with the first line of what the page says. In a wide window it is a bar that tells whether the
    page is connected.

    Attributes
    ----------
    gui : GuiApi
    controls : GuiTabHandle
        A context, within which controls are added to `gui`.
    """

    def __init__(self, gui: GuiApi) -> None:
        self.gui = gui
        gui.main_panel.float(x=_BAR[0], y=_BAR[0], width=_BAR[1])
        gui.main_panel.minimize()
        self._line = gui.add_markdown("")
        own = gui.add_panel()
        own.dock_right()
        self.controls = own.add_tab("Controls")
        with self.controls:
            self._text = gui.add_markdown("", order=0)

    @property
    def text(self) -> str:
        """Text that the page says, as Markdown."""
        return self._text.content

    def add_dark(self) -> None:
        """Add a control that makes the page dark."""
        dark = self.gui.add_checkbox("Dark", False)

        @dark.on_update
        def _(_: Any) -> None:
            set_theme(self.gui, dark.value)

    def say(self, text: str) -> None:
        """Say something instead."""
        self._text.content, self._line.content = text, text.split("\n")[0]
