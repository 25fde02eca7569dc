"""New views from images with depth, on any OpenCL device.

Importing this touches no device: names that need OpenCL are loaded when they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from pyibr.camera import Camera
from pyibr.depthmesh import DepthMesh, DepthMeshObject
from pyibr.errors import (
    ArgumentError,
    BuildError,
    DeviceError,
    Error,
    FileFormatError,
    MissingPackageError,
)
from pyibr.images import (
    DepthImage,
    Frame,
    PixelClass,
    depth_from_disparity,
    depth_from_euclidean,
    depth_from_mpeg,
    depth_from_uint16,
    disparity_from_depth,
    euclidean_from_depth,
    mpeg_from_depth,
    uint16_from_depth,
    undistort,
)
from pyibr.io import read_color, read_depth, write_color, write_depth, write_mask
from pyibr.light import Light
from pyibr.mesh import Mesh
from pyibr.relief import ReliefSurface

# The functions take the place of their modules as the package's attributes, on the first import and for good.
from pyibr.render import render
from pyibr.silhouette import Silhouette
from pyibr.slicing import DepthObject, SlicedSurface, VisualHull
from pyibr.warp import warp

if TYPE_CHECKING:
    from pyibr.opencl.device import Device, devices, use_device

__version__ = "0.1.0"

__all__ = [
    "ArgumentError",
    "BuildError",
    "Camera",
    "DepthImage",
    "DepthMesh",
    "DepthMeshObject",
    "DepthObject",
    "Device",
    "DeviceError",
    "Error",
    "FileFormatError",
    "Frame",
    "Light",
    "Mesh",
    "MissingPackageError",
    "PixelClass",
    "ReliefSurface",
    "Silhouette",
    "SlicedSurface",
    "VisualHull",
    "__version__",
    "depth_from_disparity",
    "depth_from_euclidean",
    "depth_from_mpeg",
    "depth_from_uint16",
    "devices",
    "disparity_from_depth",
    "euclidean_from_depth",
    "mpeg_from_depth",
    "read_color",
    "read_depth",
    "render",
    "uint16_from_depth",
    "undistort",
    "use_device",
    "warp",
    "write_color",
    "write_depth",
    "write_mask",
]

_LAZY = {name: "pyibr.opencl.device" for name in ("Device", "devices", "use_device")}


def __getattr__(name: str) -> object:
    if name not in _LAZY:
        raise AttributeError(f"module 'pyibr' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_LAZY[name]), name)
    return value


def __dir__() -> list[str]:
    return __all__
