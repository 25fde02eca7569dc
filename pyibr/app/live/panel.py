"""The panel of a page: text and controls, beside the picture or, in a narrow window, collapsed below it."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from pyibr.core.errors import Error, FileFormatError

if TYPE_CHECKING:
    from collections.abc import Callable

    from viser import GuiApi

_BAR = 8, 180  # pixels from the upper left corner, and its width


def set_theme(gui: GuiApi, dark: bool = False) -> None:
    """Make a page light or dark; switch off viser's sharing through servers on the internet."""
    gui.configure_theme(dark_mode=dark, show_logo=False, show_share_button=False)


def told(error: Exception) -> str:
    """Message of an error, preceded by its type if it is not an error of pyibr."""
    return str(error) if isinstance(error, Error) else f"{type(error).__name__}: {error}"


def uploaded(file: Any) -> object:
    """Data of a JSON file that a user has uploaded."""
    try:
        return json.loads(file.content.decode("utf-8"))
    except ValueError:
        raise FileFormatError(f"{file.name}: not a readable JSON file") from None


class Panel:
    """A separate panel; viser collapses it in narrow windows, unlike its main panel.

    The main panel only holds the first line of the page's text. In a wide window it is a bar that shows the state of
    the connection.

    Attributes
    ----------
    gui : GuiApi
    controls : GuiTabHandle
        Context in which controls are added to `gui`.
    """

    def __init__(self, gui: GuiApi) -> None:
        self.gui = gui
        self._picture = self._answer = ""
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
        """Text of the page, as Markdown."""
        return self._text.content

    def add_dark(self) -> None:
        """Add a control that makes the page dark."""
        dark = self.gui.add_checkbox("Dark", False)

        @dark.on_update
        def _(_: Any) -> None:
            set_theme(self.gui, dark.value)

    def say(self, text: str) -> None:
        """Replace the text about the picture."""
        self._picture = text
        self._show()

    def answer(self, text: str) -> None:
        """Show the result of a user's action above the text about the picture, until the next action."""
        self._answer = text
        self._show()

    def attempt(self, act: Callable[[], object]) -> None:
        """Run a user's action, or show its error."""
        self.answer("")
        try:
            act()
        except (Error, OSError) as error:
            self.answer(f"**Not done:** {told(error)}")

    def _show(self) -> None:
        text = "\n\n".join(filter(None, (self._answer, self._picture)))
        self._text.content, self._line.content = text, text.split("\n")[0]
