"""Drawing solids by slices: depth objects and visual hulls (kernels/slicing/object.cl)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64
from pyibr.core.pixelspace import pixel_size
from pyibr.images.order import ranks_of
from pyibr.opencl.device import current
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.headers import constant, struct
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, upload
from pyibr.opencl.program import kernel
from pyibr.picture.deferred import NO_ENTRY, Entry, entry_for
from pyibr.picture.normals import showing_normals
from pyibr.picture.shadow import Lighting
from pyibr.picture.target import Target
from pyibr.slicing.boxes import Box
from pyibr.slicing.cells import maps_of, reaches_of
from pyibr.slicing.ribbons import ribbons_of
from pyibr.slicing.solid import Solid, words_of
from pyibr.slicing.spacing import halvings_between, nearest_pixel, spacing_min

_SLICES_MIN = 32  # smallest number of slices, for objects that are small in the picture
_NEIGHBOUR_OFFSET = 4  # pixels to the neighbours whose depths give a normal: closer ones may lie on the same slice
# An image locates outlines to within half a sample. Where k images show one outline, the innermost lies k / (k + 1) of
# a sample inside the outermost on average. So outlines are drawn where their samples have the weight 1 / (k + 1).
_AGREEING = 3.0  # k + 1 is a third of the number of images: for the paper's six images, the weight is 1 / 2
_BEHIND = 8.0  # samples: the object's surface lies at most this far behind the surface of a view that sees it


def draw_in_light(target: Target, thing: Solid, lighting: Lighting | None) -> None:
    """Draw a solid in its views' colours, with light on it."""
    cameras = [target.camera, *(() if lighting is None else lighting.cameras)]
    # The shadow map shows the surface up to one spacing too near, and the picture half a spacing too far.
    bias = 1.5 * max(spacing_in(thing, camera)[0] for camera in cameras)
    # The depths of a hull's views do not fit the hull, so only given normals relight it.
    normals = not thing.silhouettes or all(view.normals is not None for view in thing.views)
    entry = entry_for(target, lighting, bias=bias, apart=_NEIGHBOUR_OFFSET, fade=0, normals=normals)
    draw_object(target, thing, entry=entry)


def draw_object(target: Target, thing: Solid, counters: DeviceArray | None = None, entry: Entry = NO_ENTRY) -> None:
    """Draw an object into the target; `counters`, (H, W) int32, gains the view tests of each pixel."""
    buffers = buffers_of(thing)
    if entry.normals:
        words = cached_on_device(
            thing, "normals", lambda: joined([words_of(showing_normals(view)) for view in thing.views])
        )
        entry = entry.with_arrays(normals=words)
    box, camera = thing.box, target.camera
    directions = np.array([_direction(view.camera, box) for view in thing.views])
    cosines = (directions * _direction(camera, box)).sum(axis=1)  # the bits do not depend on the other views
    order = np.lexsort((ranks_of(thing.views), -cosines))
    # Among views that share an outline, only the closest to the target's direction is tested. The others, which look
    # from behind, are the last to give colours.
    _, closest = np.unique(np.array(thing.outlines)[order], return_index=True)
    order = np.concatenate([order[np.sort(closest)], np.delete(order, closest)])
    spacing, halvings = spacing_in(thing, camera)
    sample = max(pixel_size(view.camera, box.center) for view in thing.views)  # the largest, at the box's centre
    record = np.zeros((), struct("slicing/object.cl", "Box"))
    # In the kernel the world's origin is the box's middle, because float32 is most precise near 0.
    record["from_world"] = (box.from_world @ _moved_by(box.center)).ravel()
    record["edges"], record["spacing"], record["slices"] = box.edges, spacing, np.ceil(box.edges.max() / spacing - 1e-6)
    depth = float(camera.camera_from_world[2, :3] @ box.center + camera.camera_from_world[2, 3])
    record["alone"], record["only"] = thing.only is not None, thing.only or 0
    record["first"] = np.rint(depth / spacing) if thing.slicing == "screen" else 0
    corners = np.asarray(box.corners, np.float32)
    near = target.near((corners.min(axis=0), corners.max(axis=0)))
    low_x, low_y, across, down = _blocks(target, box, near)
    defines = {"SILHOUETTES": int(thing.silhouettes), **target.color_defines, **entry.defines}
    more: dict[str, Any] = {**entry.arguments}
    if counters is not None:
        defines["COUNTERS"] = 1
        more["counters"] = counters
    if thing.thin:
        defines["RIBBONS"] = 1
        buffers = buffers | ribbons_on_device(thing)
    if across > 0 and down > 0:
        launch(
            kernel("slicing/object.cl", "draw_object", **defines),
            (across, down),
            **{"surfaces": buffers["maps"], **buffers, **surfaces_on_device(thing)},
            order=upload(order.astype(np.int32)),
            closeness=upload(np.maximum(cosines, 1e-3).astype(np.float32)),
            view_count=len(closest),
            colored=len(order),
            screen=Struct("Screen", target.screen(near, box.center)),
            box=Struct("Box", record),
            slices_axis=slices_axis(thing, camera),
            halvings=halvings,
            visible=thing.texture == "visible",
            unknown=thing.missing == "unknown",
            outline=outline_of(len(closest)),
            sample=sample,
            stride=(_BEHIND * sample + spacing / 2**halvings) / 2 ** (constant("slicing/object.cl", "STRIDES") - 1),
            low_x=low_x,
            low_y=low_y,
            blank=target.blank,
            **target.outputs(),
            **more,
        )
        target.blank = False


def outline_of(count: int) -> float:
    """Return the sample weight at which surfaces of `count` views end: `outline` of kernels/slicing/view_volumes.h."""
    return min(0.5, _AGREEING / count)


def spacing_in(thing: Solid, camera: Camera) -> tuple[float, int]:
    """Return the spacing of slices in a picture, in scene units, and the number of halvings between two slices."""
    box = thing.box
    if thing.slices != "view":
        return float(box.edges.max()) / thing.slices, 0 if thing.only is not None else thing.halvings
    pixel = nearest_pixel(camera, box.corners)
    # On the ray through the box's middle, slices are as far apart as a pixel is wide at the box's nearest corner.
    if thing.slicing == "screen":
        spacing, extent = pixel, np.abs(box.axes @ camera.forward) @ box.edges
    else:
        axis = slices_axis(thing, camera)
        spacing, extent = pixel * abs(float(box.axes[axis] @ _direction(camera, box))), box.edges[axis]
    # Tips and outlines are arbitrarily thin, but closer slices find few more of them for their time.
    sample = min(pixel_size(view.camera, box.center) for view in thing.views)
    least = max(0.25 * sample, spacing_min(float(box.edges.max())))
    spacing = min(max(spacing, least), extent / _SLICES_MIN)
    return float(spacing), max(thing.halvings, halvings_between(float(spacing), pixel))


def slices_axis(thing: Solid, camera: Camera) -> int:
    """Return the box's axis at right angles to the slices: the one that faces the camera most; or TO_SCREEN."""
    if thing.slicing == "screen":
        return int(constant("slicing/object.cl", "TO_SCREEN"))
    return int(np.argmax(np.abs(thing.box.axes @ _direction(camera, thing.box))))


def _moved_by(offset: Float64) -> Float64:
    """Return the (4, 4) matrix that adds an offset to points."""
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    return matrix


def _direction(camera: Camera, box: Box) -> Float64:
    """Unit vector along which a camera sees the box."""
    forward = camera.world_from_camera[:3, 2]
    if camera.projection == "perspective":
        forward = box.center - camera.world_from_camera[:3, 3]
    return forward / max(float(np.linalg.norm(forward)), 1e-30)


def _blocks(target: Target, box: Box, near: float) -> tuple[int, int, int, int]:
    """Return first x, first y, blocks across and blocks down for a blank picture, or for the part with the box."""
    block = current().profile.block
    width, height = target.camera.size
    low_x = low_y = 0
    if not target.blank:
        u, v, w, _ = target.from_world @ np.column_stack([box.corners, np.ones(8)]).T
        if (w < near).all():
            return 0, 0, 0, 0
        if (w >= near).all():
            low_x, width = max(int(np.floor((u / w).min())), 0), min(int(np.ceil((u / w).max())) + 1, width)
            low_y, height = max(int(np.floor((v / w).min())), 0), min(int(np.ceil((v / w).max())) + 1, height)
    return low_x, low_y, -(-(width - low_x) // block), -(-(height - low_y) // block)


def buffers_of(thing: Solid) -> dict[str, DeviceArray]:
    """Return the object's buffers on the current device, under the kernels' names."""
    return cached_on_device(thing, "buffers", lambda: _object_buffers(thing))


def surfaces_on_device(thing: Solid) -> dict[str, DeviceArray]:
    """Return the buffers of a hull's surface as its views see it, under the kernels' names; none if nothing needs it.

    Depth objects need none, because their views' surfaces also test points.
    """
    if not thing.silhouettes or thing.texture == "naive":
        return {}

    def made() -> dict[str, DeviceArray]:
        surfaces = thing.surfaces
        return {"surfaces": maps_of(surfaces, thing.box, True), "reaches": reaches_of(surfaces)}

    return cached_on_device(thing, "surfaces", made)


def ribbons_on_device(thing: Solid) -> dict[str, DeviceArray]:
    """Return the buffers of the object's ribbons on the current device, under the kernels' names."""
    return cached_on_device(thing, "ribbons", lambda: _ribbons_of(thing))


def _object_buffers(thing: Solid) -> dict[str, DeviceArray]:
    """Upload the object to the current device."""
    sizes: list[tuple[int, int, int]] = []
    start = 0
    for view in thing.views:
        sizes.append((*view.camera.size, start))
        start += view.valid.size
    move = _moved_by(thing.box.center)
    matrices = np.array([view.camera.pixel_matrix @ view.camera.camera_from_world @ move for view in thing.views])
    return {
        "matrices": upload(matrices.reshape(-1, 16).astype(np.float32)),
        "sizes": upload(np.array(sizes, np.int32)),
        "maps": thing.maps(),
        "reaches": upload(np.zeros(1, np.float32)) if thing.silhouettes else reaches_of(thing.views),
        "colors": joined(thing.rgba),
    }


def _ribbons_of(thing: Solid) -> dict[str, DeviceArray]:
    """Upload the views' ribbons: the index of each sample's first ribbon, then the total; and the records."""
    found = [ribbons_of(view) for view in thing.views]
    none = np.zeros((1, int(constant("slicing/records.h", "RIBBON_FLOATS"))), np.float32)
    records = np.concatenate([records for _, records in found])
    firsts = np.cumsum(np.concatenate([np.zeros(1, np.int32), *(counts for counts, _ in found)]), dtype=np.int32)
    return {"firsts": upload(firsts), "ribbons": upload(records if len(records) else none)}


def joined(images: Sequence[NDArray[Any]]) -> DeviceArray:
    """Upload the images of all views, one after the other."""
    return upload(np.concatenate([image.ravel() for image in images]))
