"""Packages: optional ones, imported where they are used, with errors that name their extra; installed distributions."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

from pyibr.core.errors import MissingPackageError

PYIBR = "pyibr-opencl"
"""Name on package indexes, where another project is called pyibr."""

_OWNERS = {  # distributions by the folder that they write into; the first is the one to keep
    "pyibr": (PYIBR, "pyibr"),
    "cv2": ("opencv-contrib-python", "opencv-python", "opencv-contrib-python-headless", "opencv-python-headless"),
}


def open3d() -> Any:
    """Open3D, or a MissingPackageError."""
    libraries = "on Debian and Ubuntu: apt install libegl1 libgl1 libgomp1 libusb-1.0-0 libx11-6"
    return _imported("open3d", "Open3D's meshes need Open3D", "open3d", libraries)


def opencv(user: str, *names: str) -> Any:
    """OpenCV in any build, or MissingPackageError; `user` names the caller, which needs the attributes `names`."""
    libraries = "on Debian and Ubuntu: apt install libgl1 libglib2.0-0 (a headless build needs neither)"
    cv2 = _imported("cv2", f"{user} needs OpenCV", "opencv", libraries)
    lacking = [name for name in names if not hasattr(cv2, name)]
    if lacking:
        version = getattr(cv2, "__version__", "")
        found = f"the installed OpenCV {version} lacks it" if version else "only a folder is left of the installed one"
        raise MissingPackageError(
            f"{user} needs cv2.{' and cv2.'.join(lacking)}, but {found}; to repair it: "
            "pip install --force-reinstall opencv-contrib-python (or the build that you had)"
        )
    return cv2


def _package(module: str, need: str, extra: str, wheel: str = "") -> Callable[[], Any]:
    """A function that returns a package, or raises MissingPackageError; wheel: its name for pip, if different."""
    return partial(_imported, module, need, extra, f"pip install --force-reinstall {wheel or module}")


def _imported(module: str, need: str, extra: str, remedy: str) -> Any:
    try:
        return import_module(module)
    except Exception as error:  # broken installations may raise anything
        if isinstance(error, ModuleNotFoundError) and error.name == module.partition(".")[0]:
            raise MissingPackageError(f"{need}: pip install 'pyibr-opencl[{extra}]'") from None
        raise MissingPackageError(f"{need}, which is installed but cannot be imported ({error}); {remedy}") from error


pyav = _package("av", "videos need PyAV", "video")
openexr = _package("OpenEXR", "EXR files need OpenEXR", "exr")
h5py = _package("h5py", "HDF5 files need h5py", "hdf5")
scikit_image = _package("skimage.metrics", "SSIM needs scikit-image", "metrics", "scikit-image")
flip_evaluator = _package("flip_evaluator", "FLIP needs flip-evaluator", "metrics", "flip-evaluator")
gaussforge = _package("gaussforge", "Gaussians in .splat, .spz and .sog files need gaussforge", "gaussians")
lzfse = _package("lzfse", "depth in .r3d files needs lzfse", "r3d")
rosbags = _package("rosbags.highlevel", "ROS bags need rosbags", "ros", "rosbags")
rosbags_types = _package("rosbags.typesys", "ROS bags need rosbags", "ros", "rosbags")
viser = _package("viser", "pages in the browser need viser", "view")
distributed = _package("distributed", "batches need Dask", "batch")
fsspec = _package("fsspec", "batches need fsspec", "batch")
zarr = _package("zarr", "Zarr stores need zarr and Python 3.11 or later", "batch")


def version_of(distribution: str) -> str | None:
    """The version of an installed distribution, or None."""
    from importlib import metadata

    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None


def clashes() -> list[tuple[str, str]]:
    """(problem, command that repairs it) for distributions that have overwritten each other's files."""
    found: list[tuple[str, str]] = []
    for folder, names in _OWNERS.items():
        owners = [name for name in names if _writes_into(name, folder)]
        if len(owners) > 1:
            kept, *others = owners
            what = f"{' and '.join(owners)} have both written into {folder}/: removing one breaks the other"
            mend = f"pip install --force-reinstall --no-deps {kept}=={version_of(kept)}"
            found.append((what, f"pip uninstall -y {' '.join(others)} && {mend}"))
    return found


def _writes_into(distribution: str, folder: str) -> bool:
    from importlib import metadata

    try:
        files = metadata.files(distribution)
    except metadata.PackageNotFoundError:
        return False
    return any(file.parts[0] == folder for file in files or ())
