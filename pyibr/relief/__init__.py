"""Relief mapping with true silhouettes on curved meshes (Oliveira & Policarpo 2005)."""

from __future__ import annotations

from pyibr.relief.surface import ReliefSurface, draw_relief

__all__ = ["ReliefSurface", "draw_relief"]
