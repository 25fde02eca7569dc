"""Warping of depth images to new views (Schaufler & Priglinger 1999)."""

from __future__ import annotations

from pyibr.warp.background import background_layer
from pyibr.warp.register import RegisteredColor, register, register_color
from pyibr.warp.view import WarpedView
from pyibr.warp.warp import warp

__all__ = ["RegisteredColor", "WarpedView", "background_layer", "register", "register_color", "warp"]
