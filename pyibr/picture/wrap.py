"""Wrap modes of textures outside uv from 0 to 1, as defines of kernels (kernels/lib/wrap.h)."""

from __future__ import annotations

from pyibr.meshes.heights import Wraps


def wrap_defines(wrap: Wraps) -> dict[str, int]:
    """Return the defines for axes that clamp; without a define, an axis repeats."""
    return {name: 1 for name, how in zip(("CLAMPED_U", "CLAMPED_V"), wrap, strict=True) if how == "clamp"}
