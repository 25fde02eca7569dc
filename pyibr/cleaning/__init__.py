"""Depth as cameras deliver it, made fit for new views."""

from __future__ import annotations

from pyibr.cleaning.clean import CleanedDepth, clean_depth

__all__ = ["CleanedDepth", "clean_depth"]
