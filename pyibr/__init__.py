"""New views from images with depth, on any OpenCL device.

Importing this touches no device, and loads neither pyopencl nor OpenCV.
"""

from __future__ import annotations

from pyibr.core.camera import Camera
from pyibr.core.errors import (
    ArgumentError,
    BuildError,
    DeviceError,
    Error,
    FileFormatError,
    MissingPackageError,
)
from pyibr.depthmesh import DepthMesh, DepthMeshObject
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
from pyibr.images.silhouette import Silhouette
from pyibr.io import read_color, read_depth, write_color, write_depth, write_mask
from pyibr.meshes.mesh import Mesh
from pyibr.opencl.device import Device, devices, use_device
from pyibr.picture.drawable import Drawable
from pyibr.picture.light import Light
from pyibr.picture.render import render
from pyibr.relief import ReliefSurface
from pyibr.slicing import DepthObject, SlicedSurface, VisualHull
from pyibr.warp import warp  # takes its package's place as an attribute

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
    "Drawable",
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
