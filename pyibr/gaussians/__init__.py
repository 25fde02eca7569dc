"""3D Gaussians (Kerbl et al. 2023), blended in one picture with everything else."""

from __future__ import annotations

from pyibr.gaussians.cloud import Gaussians

__all__ = ["Gaussians"]
