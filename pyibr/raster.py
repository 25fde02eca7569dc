"""The rasteriser: primitives to bins on the device, bins to pixels in the primitives' order (kernels/raster/).

`Bins` serves every system that draws triangles or tetrahedra; `draw_mesh` draws a `Mesh` with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pyibr.mesh import Mesh
    from pyibr.opencl.memory import DeviceArray
    from pyibr.shadow import Lighting
    from pyibr.target import Target

BIN = 32  # pixels; as in kernels/raster/
_CHUNKS = {True: 32, False: 1024}  # parts that primitives are binned in, on a CPU and on a GPU
_CULLED = {"both": 0, "front": 1, "back": -1}  # kernels/raster/mesh.cl
_GREY = (0.8, 0.8, 0.8)  # of a mesh without texture and colours


@dataclass(frozen=True)
class Bins:
    """Primitives of a target's bins.

    Attributes
    ----------
    list : DeviceArray (L,) int32
        Numbers of primitives, bin by bin.
    starts : DeviceArray (bins + 1,) int32
        Where each bin's part begins.
    columns, rows : int
        Bins across and down.
    """

    list: DeviceArray
    starts: DeviceArray
    columns: int
    rows: int


def project(target: Target, vertices: DeviceArray, near: float) -> DeviceArray:
    """(N, 4) homogeneous pixel-space positions of (N, 3) vertices of the world.

    As exact as float32 vertices are, even far from the world's origin: they are taken relative to the camera.
    """
    from pyibr.opencl.launch import Struct, launch
    from pyibr.opencl.memory import empty
    from pyibr.opencl.program import kernel

    count = vertices.shape[0]
    origin = target.camera.center.astype(np.float32)  # the same for all things: no cracks between neighbours
    projected = empty((count, 4), np.float32)
    launch(
        kernel("raster/project.cl", "project"),
        (count,),
        vertices=vertices,
        projected=projected,
        count=count,
        origin_x=float(origin[0]),
        origin_y=float(origin[1]),
        origin_z=float(origin[2]),
        screen=Struct("Screen", target.screen(near, origin)),
    )
    return projected


def bin_primitives(
    target: Target, corners: DeviceArray, projected: DeviceArray, near: float, culled: int = 0, sort: bool = False
) -> Bins:
    """Sort primitives, (P, 3) or (P, 4) indices of projected vertices, into the target's bins.

    Each bin's are in the order of their numbers or, with `sort`, from front to back.
    """
    from pyibr.opencl.device import current
    from pyibr.opencl.launch import Struct, launch
    from pyibr.opencl.memory import empty, upload
    from pyibr.opencl.program import kernel

    count, sides = corners.shape
    columns, rows = (-(-size // BIN) for size in target.camera.size)
    bins = columns * rows
    chunk = max(-(-count // _CHUNKS[current().is_cpu]), 1)
    chunks = max(-(-count // chunk), 1)
    boxes, counts, totals = empty((count, 4), np.int16), empty((chunks, bins), np.int32), empty((bins,), np.int32)
    shared = {"primitives": count, "chunk": chunk, "bins_x": columns, "bins_y": rows}
    launch(
        kernel("raster/bins.cl", "count_bins", CORNERS=sides, BIN=BIN),
        (chunks,),
        corners=corners,
        projected=projected,
        boxes=boxes,
        counts=counts,
        screen=Struct("Screen", target.screen(near)),
        nearest_w=near,
        culled=culled,
        **shared,
    )
    starts = np.zeros(bins + 1, np.int32)
    for summed in (False, True):
        uploaded = upload(starts)
        launch(
            kernel("raster/bins.cl", "start_bins", CORNERS=sides, BIN=BIN),
            (bins,),
            counts=counts,
            totals=totals,
            starts=uploaded,
            chunks=chunks,
            bins=bins,
            summed=summed,
        )
        if not summed:
            starts = np.concatenate([[0], np.cumsum(totals.to_host())]).astype(np.int32)
    found = empty((max(int(starts[-1]), 1),), np.int32)
    launch(
        kernel("raster/bins.cl", "fill_bins", CORNERS=sides, BIN=BIN),
        (chunks,),
        boxes=boxes,
        counts=counts,
        list=found,
        **shared,
    )
    if sort:
        launch(
            kernel("raster/bins.cl", "sort_bins", CORNERS=sides, BIN=BIN),
            (bins,),
            corners=corners,
            projected=projected,
            keys=empty(found.shape, np.float32),
            list=found,
            starts=uploaded,
            bins=bins,
        )
    return Bins(found, uploaded, columns, rows)


def draw_mesh(target: Target, mesh: Mesh, lit: Lighting | None) -> None:
    """Draw a mesh into the target.

    Parameters
    ----------
    target : Target
    mesh : Mesh
    lit : Lighting or None
        None shows the mesh's own colours as they are.
    """
    from pyibr.opencl.device import current
    from pyibr.opencl.launch import Struct, launch
    from pyibr.opencl.program import kernel

    near, cull = target.near(mesh.bounds), _CULLED[mesh.sides]
    buffers = _buffers(mesh)
    projected = project(target, buffers["vertices"], near)
    bins = bin_primitives(target, buffers["faces"], projected, near, cull)
    defines: dict[str, int] = {}
    more: dict[str, Any] = {}
    if "texels" in buffers:
        defines["TEXTURED"] = 1
        height, width = _checked(mesh.texture).shape[:2]
        more = {"uv": buffers["uv"], "texels": buffers["texels"], "texture_width": width, "texture_height": height}
        more["levels"] = max(width, height).bit_length()
    elif "tints" in buffers:
        defines["TINTED"] = 1
        more = {"tints": buffers["tints"]}
    if lit is not None:
        defines |= lit.defines
        more |= {**_normals(mesh, buffers), **lit.arguments()}
        if lit.maps is not None:
            more["vertices"] = buffers["vertices"]
    whole = current().is_cpu
    launch(
        kernel("raster/mesh.cl", "draw_mesh", BIN=BIN, COLOR_BYTES=target.channel_bytes, **defines),
        (bins.columns, bins.rows) if whole else target.camera.size,
        faces=buffers["faces"],
        projected=projected,
        list=bins.list,
        starts=bins.starts,
        bins_x=bins.columns,
        screen=Struct("Screen", target.screen(near)),
        nearest_w=near,
        culled=cull,
        blank=target.blank,
        base_r=_GREY[0],
        base_g=_GREY[1],
        base_b=_GREY[2],
        **target.outputs(),
        **more,
    )
    target.blank = False


def _buffers(mesh: Mesh) -> dict[str, DeviceArray]:
    """The mesh on the current device, made once."""
    from pyibr.opencl.device import current
    from pyibr.opencl.memory import upload

    session = current()
    kept = mesh.device_cache.get(session)
    if isinstance(kept, dict):
        return cast("dict[str, DeviceArray]", kept)
    made = {"vertices": upload(mesh.vertices), "faces": upload(mesh.faces)}
    if mesh.texture is not None and mesh.uv is not None:
        made["uv"], made["texels"] = upload(mesh.uv), upload(texture_pyramid(mesh.texture))
    elif mesh.colors is not None:
        made["tints"] = upload(_unit(mesh.colors))
    mesh.device_cache[session] = made
    return made


def _normals(mesh: Mesh, buffers: dict[str, DeviceArray]) -> dict[str, DeviceArray]:
    from pyibr.opencl.memory import upload

    if "normals" not in buffers:
        normals = mesh.normals if mesh.normals is not None else mesh.smooth_normals
        buffers["normals"], buffers["fronts"] = upload(normals), upload(_fronts(mesh, normals))
    return {name: buffers[name] for name in ("normals", "fronts")}


def _fronts(mesh: Mesh, normals: NDArray[np.float32]) -> NDArray[np.int16]:
    """(M,) 1, or -1 for triangles whose corners run clockwise as seen from where their normals point."""
    corner = mesh.vertices[mesh.faces].astype(np.float64)
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    along = (across * normals[mesh.faces].sum(axis=1)).sum(axis=1)
    return np.where(along < 0, -1, 1).astype(np.int16)


def _unit(colors: NDArray[Any]) -> NDArray[np.float32]:
    scale = np.float32(1 / 255 if colors.dtype == np.uint8 else 1)
    return np.ascontiguousarray(colors * scale, np.float32)


def texture_pyramid(texture: NDArray[Any]) -> NDArray[np.uint32]:
    """All levels of a texture, largest first, as RGBA words: each half as large as the one before, rounded down."""
    import cv2

    level = as_bytes(texture)
    words: list[NDArray[np.uint32]] = []
    while True:
        height, width = level.shape[:2]
        words.append(rgba_words(level))
        if width == height == 1:
            return np.concatenate(words)
        level = cv2.resize(level, (max(width // 2, 1), max(height // 2, 1)), interpolation=cv2.INTER_AREA)


def rgba_words(color: NDArray[Any], valid: NDArray[np.bool_] | None = None) -> NDArray[np.uint32]:
    """An image's pixels as RGBA words in a row: a texel is one read. A is 255, or 0 where not valid."""
    import cv2

    rgba = np.asarray(cv2.cvtColor(as_bytes(color), cv2.COLOR_RGB2RGBA), np.uint8)
    if valid is not None:
        rgba[..., 3] = valid * np.uint8(255)
    return rgba.view(np.uint32).ravel()


def as_bytes(color: NDArray[Any]) -> NDArray[np.uint8]:
    """Colours in 8 bits a channel."""
    return color if color.dtype == np.uint8 else np.rint(np.clip(color, 0, 1) * np.float32(255)).astype(np.uint8)


def _checked(texture: NDArray[Any] | None) -> NDArray[Any]:
    assert texture is not None
    return texture
