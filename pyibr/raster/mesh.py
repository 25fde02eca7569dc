"""Meshes drawn by the rasteriser: bins to pixels, in the order of the triangles (kernels/raster/mesh.cl)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.shown import picture_of
from pyibr.images.pictures import camera_before
from pyibr.images.srgb import in_bytes
from pyibr.meshes.mesh import Mesh
from pyibr.meshes.normals import areas, pieces_of
from pyibr.meshes.textures import texture_pyramid
from pyibr.opencl.ahead import build_ahead
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.launch import launch
from pyibr.opencl.memory import DeviceArray, upload
from pyibr.opencl.program import kernel
from pyibr.picture.drawable import as_drawable
from pyibr.picture.light import light_for
from pyibr.picture.render import render
from pyibr.picture.shadow import Lighting
from pyibr.picture.target import Target
from pyibr.raster.bins import bin_defines, bin_primitives, project

_GREY = (0.8, 0.8, 0.8)  # colour of a mesh without texture and vertex colours
_DOWN, _PAPER = np.array([0.0, 1.0, 0.0]), (255, 255, 255)


def draw_mesh(target: Target, mesh: Mesh, lit: Lighting | None) -> None:
    """Draw a mesh into the target; without `lit`, in its own colours."""
    near = target.near(mesh.bounds)
    buffers = cached_on_device(mesh, "buffers", lambda: _buffers(mesh))
    projected = project(target, buffers["vertices"], near)
    defines: dict[str, int] = bin_defines(3) | target.color_defines
    more: dict[str, Any] = {}
    if mesh.texture is not None and mesh.uv is not None:
        defines["TEXTURED"] = 1
        height, width = mesh.texture.shape[:2]
        more = {"uv": buffers["uv"], "texels": buffers["texels"], "texture_width": width, "texture_height": height}
        more["levels"] = max(width, height).bit_length()
        defines |= target.filter_defines
        more |= target.filter_arguments
    elif mesh.colors is not None:
        defines["TINTED"] = 1
        more = {"tints": buffers["tints"]}
    if lit is not None:
        defines |= lit.defines
        more |= {**cached_on_device(mesh, "normals", lambda: _normals(mesh)), **lit.arguments()}
        if lit.maps is not None:
            more["vertices"] = buffers["vertices"]
    build_ahead("raster/mesh.cl", "draw_mesh", compiled=True, **defines)
    bins = bin_primitives(target, buffers["faces"], projected, near, mesh.sides)
    launch(
        kernel("raster/mesh.cl", "draw_mesh", **defines),
        bins.grid,
        faces=buffers["faces"],
        culled=bins.culled,
        blank=target.blank,
        base_r=_GREY[0],
        base_g=_GREY[1],
        base_b=_GREY[2],
        **bins.arguments,
        **target.outputs(),
        **more,
    )
    target.blank = False


@dataclass(frozen=True)
class DrawnMesh:
    """A mesh as `render` draws it."""

    mesh: Mesh

    @property
    def bounds(self) -> tuple[NDArray[Any], NDArray[Any]]:
        """Bounding box of the triangles: (low, high), each (3,), in the world."""
        return self.mesh.bounds

    def draw(self, target: Target, lighting: Lighting | None) -> None:
        """Draw the triangles, lit by their normals."""
        draw_mesh(target, self.mesh, lighting)


@as_drawable.register
def _(thing: Mesh) -> DrawnMesh:
    return DrawnMesh(thing)


@picture_of.register
def _(thing: Mesh) -> NDArray[Any]:
    """Picture of the whole mesh, seen obliquely from above, with -y up; lit if it has no colours."""
    low, high = (corner.astype(np.float64) for corner in thing.bounds)
    if not (low < high).any():  # a mesh of one point
        high = low + 1.0
    frame = render(thing, camera_before(low, high, -_DOWN), light_for(thing, -_DOWN), background=_PAPER)
    return in_bytes(frame.color)


def _buffers(mesh: Mesh) -> dict[str, DeviceArray]:
    """Upload the mesh to the current device."""
    made = {"vertices": upload(mesh.vertices), "faces": upload(mesh.faces)}
    if mesh.texture is not None and mesh.uv is not None:
        made["uv"], made["texels"] = upload(mesh.uv), upload(texture_pyramid(mesh.texture))
    elif mesh.colors is not None:
        scale = np.float32(1 / 255 if mesh.colors.dtype == np.uint8 else 1)
        made["tints"] = upload(np.ascontiguousarray(mesh.colors * scale, np.float32))
    return made


def _normals(mesh: Mesh) -> dict[str, DeviceArray]:
    """Upload the mesh's normals to the current device."""
    normals = mesh.normals if mesh.normals is not None else mesh.smooth_normals
    return {"normals": upload(normals), "fronts": upload(_fronts(mesh, normals))}


def _fronts(mesh: Mesh, normals: NDArray[np.float32]) -> NDArray[np.int16]:
    """Signs (M,): 1, or -1 for triangles whose corners run clockwise as seen from the side of their normals."""
    across, fronts = areas(mesh.vertices, mesh.faces), np.empty(len(mesh.faces), np.int16)
    for some in pieces_of(len(fronts)):
        along = (across[some] * normals[mesh.faces[some]].sum(axis=1)).sum(axis=1)
        fronts[some] = np.where(along < 0, -1, 1)
    return fronts
