"""Plain arrays of trimesh's meshes, and of objects with the same attributes, since trimesh is not imported."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import describe, plain_array
from pyibr.core.errors import ArgumentError
from pyibr.io.image import without_alpha


def arrays_of(mesh: Any) -> dict[str, Any]:
    """Return a `trimesh.Trimesh` as arguments of `Mesh`.

    Its `visual` provides the texture and `uv`, or the colours of vertices or faces.
    """
    if not hasattr(mesh, "vertices") or not hasattr(mesh, "faces"):
        raise ArgumentError(
            "mesh", "a mesh with vertices and faces (for a trimesh.Scene, pass its to_mesh())", describe(mesh)
        )
    vertices = plain_array("mesh.vertices", mesh.vertices, "numbers of shape (N, 3)")
    faces = plain_array("mesh.faces", mesh.faces, "integers of shape (M, 3)")
    made = {"vertices": vertices, "faces": faces}
    visual = cast("Any", getattr(mesh, "visual", None))
    kind = getattr(visual, "kind", None)
    if kind == "texture":
        return made | _textured(visual, len(vertices))
    if kind == "vertex":
        return made | {"colors": _colors(visual.vertex_colors)}
    if kind == "face":  # each face gets its own corners
        corners = np.arange(3 * len(faces)).reshape(-1, 3)
        colors = np.repeat(_colors(visual.face_colors), 3, axis=0)
        return {"vertices": vertices[faces.ravel()], "faces": corners, "colors": colors}
    return made


def _textured(visual: Any, count: int) -> dict[str, Any]:
    """Texture and uv of `count` vertices, whose v runs up; without a picture, the material's one colour."""
    material = getattr(visual, "material", None)
    picture = getattr(material, "image", None)
    if picture is None:
        picture = getattr(material, "baseColorTexture", None)
    if picture is not None and visual.uv is not None:
        uv = np.array(visual.uv, np.float64)
        uv[:, 1] = 1 - uv[:, 1]
        return {"uv": uv, "texture": without_alpha(np.array(picture.convert("RGBA")), "the texture")}
    color = getattr(material, "main_color", None)
    return {} if color is None else {"colors": _colors(np.tile(color, (count, 1)))}


def _colors(values: Any) -> NDArray[Any]:
    """Colours without alpha, with a warning unless all is opaque."""
    return without_alpha(np.array(values), "the mesh")
