"""A page in a browser for looking around in anything that pyibr draws."""

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

    Only this machine can open the page. Its controls select the method, the drawing of depth images, the light and the
    constructor arguments of the things. Two methods can be compared. While the camera moves, the resolution is reduced
    as needed; 0.2 s after the camera rests, it is full. Scenes with `Gaussians` are then drawn exactly, and warped from
    the last exact pictures while the camera moves.

    Parameters
    ----------
    things : thing, sequence of things, or mapping of str to either
        As for `render`. Each entry of a mapping is a method, which can be selected and compared with the others. Depth
        images can also be drawn by the warp's methods, as depth meshes, as a depth object and as a visual hull.
    camera : Camera, optional
        Initial camera; only its pose and field of view are used. By default the first depth image's camera, or a
        camera that sees everything.
    up : (3,), optional
        Up direction of the world. By default the depth images' up direction, or -y.
    port : int
        Port of the page, or the next free one; 0 takes any free port.

    Returns
    -------
    Pages
        Shows its page in a notebook. In a script, call `wait`, as the page ends with the script; `close` ends it
        earlier.

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
        lambda client, pages: ViewPage(client, pages, scene, name),
        scene.page_space,
        scene.start,
        scene.pivot,
        scene.up,
        port,
        "pyibr view",
    )
