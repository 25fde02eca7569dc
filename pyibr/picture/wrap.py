"""Wrap modes of maps beyond uv of 0 to 1, as defines of kernels (kernels/lib/wrap.h)."""

from __future__ import annotations

from pyibr.meshes.heights import Wraps


def wrap_defines(wrap: Wraps) -> dict[str, int]:
    """The defines that are not what they are without."""
    return {name: 1 for name, how in zip(("CLAMPED_U", "CLAMPED_V"), wrap, strict=True) if how == "clamp"}
