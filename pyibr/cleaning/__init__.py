"""Depth as cameras deliver it, made fit for new views."""

from __future__ import annotations

from pyibr.cleaning.clean import CleanedDepth, clean_depth
from pyibr.cleaning.sharpen import sharpen_depth

__all__ = ["CleanedDepth", "clean_depth", "sharpen_depth"]
