"""Open3D, which is imported only where it is used."""

from __future__ import annotations

from typing import Any

from pyibr.core.errors import MissingPackageError


def open3d() -> Any:
    """The module, or a MissingPackageError."""
    try:
        import open3d as o3d
    except ImportError as error:
        raise MissingPackageError(
            f"meshes' files and captures need Open3D: pip install open3d (importing it failed: {error})"
        ) from None
    return o3d
