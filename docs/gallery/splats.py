"""Draws the splats of docs/howto/own-system.md by running the code on that page; pictures.py saves the result."""

from __future__ import annotations

import os
import re
import tempfile
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

import pyibr as ibr

PAGE = Path(__file__).resolve().parents[1] / "howto/own-system.md"
LARGER, DOTS = 3, 100  # enlargement of the picture on the page; dots per inch


def splats() -> Figure:
    """Draw a ball of splats on a mesh, lit, with its shadow."""
    names: dict[str, Any] = {"__name__": "__main__"}
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)  # the page writes its kernel into the current folder
        try:
            for source in re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL):
                exec(source, names)
            light, (width, height) = names["light"], (LARGER * side for side in names["camera"].size)
            lamp = ibr.Light(position=light.position, ambient=light.ambient, shadow_size=4 * light.shadow_size)
            larger = names["camera"].resized((width, height))
            image = ibr.render(names["scene"], larger, lamp, background=(255, 255, 255), samples=4).color
        finally:
            os.chdir(before)
    figure = plt.figure(figsize=(width / DOTS, height / DOTS), dpi=DOTS)
    figure.figimage(image)
    return figure
