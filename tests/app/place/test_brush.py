"""The brush in a real Chromium: what one points at stays to be seen."""

from __future__ import annotations

import time

import numpy as np
import pytest

import pyibr as ibr
from pyibr.app.place.inset import inset_box
from pyibr.capture import models
from pyibr.capture.frusta import Frustum
from pyibr.images.metrics import psnr
from tests.app.browser import chromium, opened, rested, until

pytestmark = pytest.mark.thorough


def test_the_corner_is_not_coloured_while_the_brush_is_over_it():
    """viser colours what can be clicked, behind its faces."""
    frustum = Frustum.look_at((0, 0, 3), (0, 0, 0), (0, 1, 0), 64)
    with (
        chromium() as browser,
        ibr.place(models.donut(48), [frustum], size=64, up=(0, 0, 1), port=0) as pages,
        opened(browser, pages.url, (400, 300)) as tab,
    ):
        rested(tab)
        left, top, side = inset_box((400, 300))
        inside = np.s_[top + 4 : top + side - 4, left + 4 : left + side - 4]
        for step in range(4):
            tab.page.mouse.move(left + side // 2 + step, top + side // 2)
            time.sleep(0.5)  # for the browser to find what is there, and to draw what it colours
        # A slow browser may be behind; colour would stay. The last picture is the depth of the one before.
        until(lambda: psnr(tab.picture(-2)[inside], tab.canvas()[inside]) >= 35)
        assert tab.picture(-2)[inside].std() > 20
