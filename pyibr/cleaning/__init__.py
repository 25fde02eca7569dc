"""Cleaning of depth from cameras and networks, for use in view synthesis."""

from __future__ import annotations

from pyibr.cleaning.clean import CleanedDepth, clean_depth, sharpen_depth

__all__ = ["CleanedDepth", "clean_depth", "sharpen_depth"]
