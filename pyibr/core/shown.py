"""Display of frames, depth images, meshes and cameras: in notebooks, in a window, and as files.

Higher packages register the implementations: renderers at `picture_of`, writers at `save_as`.
"""

from __future__ import annotations

import io
import os
import sys
from functools import singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import describe
from pyibr.core.errors import ArgumentError, Error

if TYPE_CHECKING:
    from PIL.Image import Image

_SIDE_MAX = 1600  # in pixels: larger pictures would bloat notebooks


@singledispatch
def picture_of(thing: object) -> NDArray[np.uint8]:
    """(H, W, 3) picture that represents an object."""
    raise ArgumentError("thing", "something that has a picture", describe(thing))


@singledispatch
def save_as(thing: object, path: str | os.PathLike[str]) -> None:
    """Write the part of an object that this suffix's format stores."""
    raise ArgumentError("thing", "an object that can be saved", describe(thing))


class Shown:
    """Base of objects with a picture: notebooks display it automatically, `show` does so anywhere."""

    def _repr_png_(self) -> bytes:
        written = io.BytesIO()
        self._picture().save(written, "PNG")
        return written.getvalue()

    def show(self) -> None:
        """Show the object's picture: below the cell of a notebook, else in the system's image viewer, through Pillow.

        Raises
        ------
        Error
            If there is neither a notebook nor a display.

        Examples
        --------
        >>> import pyibr as ibr
        >>> camera = ibr.Camera.from_fov((640, 480), fov_x=60)
        >>> camera.show()  # doctest: +SKIP
        """
        from PIL import ImageShow

        shell: Any = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
        if hasattr(shell, "kernel"):
            sys.modules["IPython"].display.display(self)
            return
        is_blind = sys.platform.startswith("linux") and not {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys()
        if is_blind or not ImageShow.show(self._picture(), title=repr(self)):
            raise Error("no display or notebook to show a picture in; `save` writes a file")

    def _picture(self) -> Image:
        from PIL import Image

        image = Image.fromarray(picture_of(self))
        image.thumbnail((_SIDE_MAX, _SIDE_MAX))
        return image
