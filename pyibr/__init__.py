"""New views from images with depth, on any OpenCL device.

Importing this package touches no device, and loads neither pyopencl nor OpenCV. `slicing`, `relief`, `depthmesh`,
`gaussians` and the pages are loaded on first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from pyibr.cleaning import CleanedDepth, clean_depth, sharpen_depth
from pyibr.core.camera import Camera
from pyibr.core.errors import (
    ArgumentError,
    BuildError,
    DeviceError,
    Error,
    FileFormatError,
    MissingPackageError,
    OutOfMemoryError,
)
from pyibr.core.lens import Lens
from pyibr.images import DepthImage, Frame, PixelClass
from pyibr.images import metrics as metrics
from pyibr.images.converters import (
    depth_from_disparity,
    depth_from_euclidean,
    depth_from_mpeg,
    depth_from_relative,
    depth_from_uint16,
    depth_from_zbuffer,
    disparity_from_depth,
    euclidean_from_depth,
    mpeg_from_depth,
    uint16_from_depth,
    zbuffer_from_depth,
)
from pyibr.images.noise import disparity_noise
from pyibr.images.silhouette import Silhouette
from pyibr.io import read_color, read_depth, write_color, write_depth, write_mask
from pyibr.meshes.mesh import Mesh
from pyibr.opencl.device import Device, devices, use_device
from pyibr.picture.drawable import Drawable
from pyibr.picture.light import Light
from pyibr.picture.render import render
from pyibr.picture.undistort import undistorted
from pyibr.warp import (  # the function `warp` replaces its package as an attribute
    RegisteredColor,
    WarpedView,
    background_layer,
    register,
    register_color,
    warp,
)

import_module("pyibr.raster")  # registers the drawing of meshes

if TYPE_CHECKING:
    from pyibr import torch as torch
    from pyibr.app.batch import batch
    from pyibr.app.place import place
    from pyibr.app.view import view
    from pyibr.capture.quilt import quilt
    from pyibr.capture.sets import load, save
    from pyibr.capture.stereo import stereo
    from pyibr.capture.turntable import turntable
    from pyibr.depthmesh import DepthMesh, DepthMeshObject
    from pyibr.gaussians import Gaussians
    from pyibr.io.video import Video
    from pyibr.io.video_writing import write_video
    from pyibr.relief import ReliefSurface
    from pyibr.slicing import DepthObject, SlicedSurface, VisualHull

__version__ = "0.1.0"

_LATER = {
    "app.batch": ("batch",),
    "app.place": ("place",),
    "app.view": ("view",),
    "capture.quilt": ("quilt",),
    "capture.sets": ("load", "save"),
    "capture.stereo": ("stereo",),
    "capture.turntable": ("turntable",),
    "depthmesh": ("DepthMesh", "DepthMeshObject"),
    "gaussians": ("Gaussians",),
    "io.video": ("Video",),
    "io.video_writing": ("write_video",),
    "relief": ("ReliefSurface",),
    "slicing": ("DepthObject", "SlicedSurface", "VisualHull"),
    "torch": (),
}

__all__ = [
    "ArgumentError",
    "BuildError",
    "Camera",
    "CleanedDepth",
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
    "Gaussians",
    "Lens",
    "Light",
    "Mesh",
    "MissingPackageError",
    "OutOfMemoryError",
    "PixelClass",
    "RegisteredColor",
    "ReliefSurface",
    "Silhouette",
    "SlicedSurface",
    "Video",
    "VisualHull",
    "WarpedView",
    "__version__",
    "background_layer",
    "batch",
    "clean_depth",
    "depth_from_disparity",
    "depth_from_euclidean",
    "depth_from_mpeg",
    "depth_from_relative",
    "depth_from_uint16",
    "depth_from_zbuffer",
    "devices",
    "disparity_from_depth",
    "disparity_noise",
    "euclidean_from_depth",
    "load",
    "mpeg_from_depth",
    "place",
    "quilt",
    "read_color",
    "read_depth",
    "register",
    "register_color",
    "render",
    "save",
    "sharpen_depth",
    "stereo",
    "turntable",
    "uint16_from_depth",
    "undistorted",
    "use_device",
    "view",
    "warp",
    "write_color",
    "write_depth",
    "write_mask",
    "write_video",
    "zbuffer_from_depth",
]


def __getattr__(name: str) -> object:
    for room, names in _LATER.items():
        if name == room or name in names:
            module = import_module(f"{__name__}.{room}")
            value = globals()[name] = module if name == room else getattr(module, name)
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *(room for room in _LATER if "." not in room), *__all__})
