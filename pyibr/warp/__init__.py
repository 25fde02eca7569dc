"""Depth images to new views (Schaufler & Priglinger 1999)."""

from __future__ import annotations

from pyibr.warp.warp import warp

__all__ = ["warp"]
