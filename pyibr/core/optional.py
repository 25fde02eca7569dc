"""Packages that only some things need: imported where they are used, and named with the extra that brings them."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from pyibr.core.errors import MissingPackageError


def open3d() -> Any:
    """Open3D, or a MissingPackageError."""
    libraries = "on Debian and Ubuntu: apt install libegl1 libgl1 libgomp1 libusb-1.0-0 libx11-6"
    return _imported("open3d", "Open3D's meshes need Open3D", "open3d", libraries)


def opencv(user: str, *names: str) -> Any:
    """OpenCV, whichever build is installed, or a MissingPackageError: `user`, a word, needs these names of it."""
    libraries = "on Debian and Ubuntu: apt install libgl1 libglib2.0-0 (a headless build needs neither)"
    cv2 = _imported("cv2", f"{user} needs OpenCV", "opencv", libraries)
    lacking = [name for name in names if not hasattr(cv2, name)]
    if lacking:
        version = getattr(cv2, "__version__", "")
        found = f"OpenCV {version} as installed lacks it" if version else "only a folder is left of the installed one"
        raise MissingPackageError(
            f"{user} needs cv2.{' and cv2.'.join(lacking)}, and {found}; to mend it: "
            "pip install --force-reinstall opencv-contrib-python (or the build that you had)"
        )
    return cv2


def pyav() -> Any:
    """PyAV, FFmpeg's libraries, or a MissingPackageError."""
    return _imported("av", "videos need PyAV", "video", "pip install --force-reinstall av")


def openexr() -> Any:
    """OpenEXR, or a MissingPackageError."""
    return _imported("OpenEXR", "EXR files need OpenEXR", "exr", "pip install --force-reinstall OpenEXR")


def h5py() -> Any:
    """h5py, or a MissingPackageError."""
    return _imported("h5py", "HDF5 files need h5py", "hdf5", "pip install --force-reinstall h5py")


def scikit_image() -> Any:
    """scikit-image's metrics, or a MissingPackageError."""
    remedy = "pip install --force-reinstall scikit-image"
    return _imported("skimage.metrics", "SSIM needs scikit-image", "metrics", remedy)


def flip_evaluator() -> Any:
    """flip-evaluator, or a MissingPackageError."""
    return _imported(
        "flip_evaluator", "FLIP needs flip-evaluator", "metrics", "pip install --force-reinstall flip-evaluator"
    )


def lzfse() -> Any:
    """lzfse, Apple's way of packing, or a MissingPackageError."""
    return _imported("lzfse", "depth in .r3d files needs lzfse", "r3d", "pip install --force-reinstall lzfse")


def rosbags() -> tuple[Any, Any]:
    """rosbags' readers and its types of messages, or a MissingPackageError."""
    remedy = "pip install --force-reinstall rosbags"
    names = ("rosbags.highlevel", "rosbags.typesys")
    highlevel, typesys = (_imported(name, "ROS bags need rosbags", "ros", remedy) for name in names)
    return highlevel, typesys


def viser() -> Any:
    """viser, which serves pages, or a MissingPackageError."""
    return _imported("viser", "pages in the browser need viser", "view", "pip install --force-reinstall viser")


def distributed() -> Any:
    """Dask's distributed, or a MissingPackageError."""
    return _imported("distributed", "batches need Dask", "batch", "pip install --force-reinstall distributed")


def fsspec() -> Any:
    """fsspec, which knows file systems by their URLs, or a MissingPackageError."""
    return _imported("fsspec", "batches need fsspec", "batch", "pip install --force-reinstall fsspec")


def zarr() -> Any:
    """zarr, stores of arrays in chunks, or a MissingPackageError."""
    need = "Zarr stores need zarr and Python 3.11 or later"
    return _imported("zarr", need, "batch", "pip install --force-reinstall zarr")


def _imported(module: str, need: str, extra: str, remedy: str) -> Any:
    try:
        return import_module(module)
    except Exception as error:  # what is installed by halves may raise anything
        if isinstance(error, ModuleNotFoundError) and error.name == module.partition(".")[0]:
            raise MissingPackageError(f"{need}: pip install 'pyibr-opencl[{extra}]'") from None
        raise MissingPackageError(f"{need}, which is installed but cannot be imported ({error}); {remedy}") from error
