"""Placement of frusta on a mesh in a browser (Schaufler & Priglinger 1999, section 7.1)."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pyibr.app.live.page_space import page_space_around
from pyibr.app.live.pages import Pages
from pyibr.app.place.captures import Captures
from pyibr.app.place.model import Placement
from pyibr.app.place.page import BrowserPage, PlacePage
from pyibr.capture.coverage import surface_of
from pyibr.capture.frusta import Frustum, load_frusta, part_of
from pyibr.core.checks import instance_of, numbers, one_of
from pyibr.core.errors import ArgumentError
from pyibr.images.depth_image import Side
from pyibr.images.pictures import camera_before
from pyibr.meshes.mesh import Mesh
from pyibr.picture.light import light_for

__all__ = ["place"]


def place(
    mesh: Mesh,
    frusta: Sequence[Frustum] | str | PathLike[str] = (),
    *,
    size: int = 256,
    folder: str | PathLike[str] = "frusta",
    up: ArrayLike = (0, -1, 0),
    port: int = 8080,
    side: Side = "front",
    within: ArrayLike | None = None,
) -> Pages:
    """Place frusta on a mesh in a browser, until their depth images cover it.

    Frusta are proposed automatically or added by hand. They can be moved, turned, resized and deleted. Surface that no
    frustum sees is red, and the page shows its fraction. A corner shows the chosen frustum's picture, where unwanted
    parts can be painted over. All browsers that open the page edit the same set. Only this machine can open the page.

    Parameters
    ----------
    mesh : Mesh
    frusta : sequence of pyibr.capture.frusta.Frustum, or a path
        Initial frusta; also a set's folder, or a JSON file of frusta.
    size : int
        Pixels a side of the frusta's images.
    folder : path
        Where the page saves its sets, unless the page names another folder; `load` reads them.
    up : (3,)
        Up direction of the world.
    port : int
        Port of the page, or the next free one; 0 takes any free port.
    side : {"front", "back", "both"}
        Side of the surface that the frusta's images show: "back" for frusta inside a solid. Ignored for a set's file,
        which has its own.
    within : (2, 3), optional
        A box, (low, high) in the world: only the part of the mesh inside it shall be covered. By default the box in
        a set's file, or the whole mesh.

    Returns
    -------
    Pages
        As for `view`.

    Raises
    ------
    ArgumentError
        An argument has a wrong type or value.
    FileFormatError
        A file of frusta cannot be read.
    MissingPackageError
        viser is not installed (the extra `view`).
    DeviceError
        No OpenCL device works.

    Examples
    --------
    >>> import pyibr as ibr
    >>> from pyibr.capture import models
    >>> pages = ibr.place(models.donut(), size=64, port=0)
    >>> pages.close()
    """
    instance_of("mesh", mesh, Mesh, "a pyibr.Mesh")
    one_of("side", side, Side)
    about: dict[str, Any] = {"side": side}
    if isinstance(frusta, (str, PathLike)):
        path = frusta
        frusta, about = load_frusta(path)
        within = part_of(about, path) if within is None else within
    surface = surface_of(mesh, within=within)
    placement = Placement(size, surface.within)
    placement.take(frusta, about)
    upward = numbers("up", up, (3,))
    if not upward.any():
        raise ArgumentError("up", "a direction", "zeros")
    low, high = surface.bounds
    around, captures = page_space_around(low, high), Captures(surface, light_for(mesh, upward))
    shared: list[PlacePage] = []
    return Pages(
        lambda client, _: BrowserPage(shared[0], client),
        around,
        camera_before(low, high, upward),
        0.5 * (low + high),
        upward / np.linalg.norm(upward),
        port,
        "pyibr place",
        lambda pages: shared.append(PlacePage(pages, placement, captures, around, Path(folder))),
    )
