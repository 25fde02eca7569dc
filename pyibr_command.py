"""The command `pyibr`, outside of the package, so that Ctrl-C is also quiet while the package is imported."""

from __future__ import annotations

import os
import signal
from typing import NoReturn


def main() -> None:
    """Run the command line; until a command begins, Ctrl-C ends the process immediately."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)
    from pyibr.app.cli import app

    app(prog_name="pyibr")


def _end(number: int, _: object) -> NoReturn:
    os._exit(128 + number)  # exit status as in shells
