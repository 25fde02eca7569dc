"""Looking around in anything that pyibr draws, in a browser."""

from __future__ import annotations

from numpy.typing import ArrayLike

from pyibr.app.live.pages import Pages
from pyibr.app.view.page import ViewPage
from pyibr.app.view.scene import scene_of
from pyibr.core.camera import Camera
from pyibr.core.checks import describe
from pyibr.core.errors import ArgumentError
from pyibr.opencl.device import explain

__all__ = ["view"]


def view(things: object, camera: Camera | None = None, *, up: ArrayLike | None = None, port: int = 8080) -> Pages:
    """Look around in a browser, with pictures that pyibr draws while the camera moves.

    The page can only be opened on this machine. Its controls choose the method, how depth images are drawn, the light,
    and whatever the things' classes are made with; two methods are compared beside each other. While the camera moves
    the resolution falls as far as it must, and is full 0.2 s after it rests.

    Parameters
    ----------
    things : thing, sequence of things, or mapping of str to either
        As for `render`. Of a mapping each entry is a method to choose, and to compare with the others. Depth images
        can be drawn by the warp's methods, as depth meshes, as a depth object and as a visual hull, too.
    camera : Camera, optional
        Where to begin; only its pose and its field of view count. By default the first depth image's, or one that
        sees all.
    up : (3,), optional
        What is up in the world. By default what is up in the depth images, or -y.
    port : int
        The first one that is tried; 0 takes any that is free.

    Returns
    -------
    Pages
        It shows its page in a notebook. In a script call its `wait`, or the page ends with the script; `close` ends it
        before.

    Raises
    ------
    ArgumentError
        An argument has a wrong type or value.
    MissingPackageError
        viser is not installed (the extra `view`).
    DeviceError
        No OpenCL device works.

    Examples
    --------
    >>> import pyibr as ibr
    >>> square = ibr.Mesh([[-1, -1, 3], [1, -1, 3], [-1, 1, 3], [1, 1, 3]], [[0, 1, 2], [3, 2, 1]])
    >>> pages = ibr.view(square, port=0)
    >>> pages.url.rsplit(":", 1)[0]
    'http://127.0.0.1'
    >>> pages.close()
    """
    if camera is not None and not isinstance(camera, Camera):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ArgumentError("camera", "a pyibr.Camera or None", describe(camera))
    scene = scene_of(things, camera, up)
    device = explain()[0]
    name = f"{device.name} ({device.platform})"
    return Pages(
        lambda client, pages: ViewPage(client, scene, pages.stream, name, pages.call),
        scene.page_space,
        scene.start,
        scene.pivot,
        scene.up,
        port,
        "pyibr view",
    )
