"""Objects from images all round: what depth images or silhouettes leave of space (Kautz & Seidel 2001, 4 and 5)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple
from functools import cached_property
from typing import Any, Literal, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import Fixed, Float64, checked_bool, describe, one_of
from pyibr.core.errors import ArgumentError
from pyibr.core.pixelspace import longer_side, pixel_size
from pyibr.images import DepthImage
from pyibr.images.silhouette import Silhouette, is_opposite
from pyibr.meshes.textures import rgba_words
from pyibr.opencl.device import current
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.headers import constant, struct
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, upload
from pyibr.opencl.program import kernel
from pyibr.picture.deferred import NO_ENTRY, Entry, entry_for
from pyibr.picture.normals import showing_normals
from pyibr.picture.shadow import Lighting
from pyibr.picture.straighten import straight_silhouette, straightened
from pyibr.picture.target import Target
from pyibr.slicing.boxes import Box, box_of_samples, box_of_silhouettes, depth_extent_of, nearness_map
from pyibr.slicing.ribbons import ribbons_of
from pyibr.slicing.spacing import (
    SLICES_USUAL,
    Slices,
    checked_halvings,
    checked_only,
    checked_slices,
    halvings_between,
    nearest_pixel,
    slices_text,
    spacing_min,
)

ObjectSlicing = Literal["orthogonal", "screen"]
Texture = Literal["visible", "naive"]
Missing = Literal["empty", "unknown"]
Float32 = NDArray[np.float32]

_Known = TypeVar("_Known")

_APART_MAX = 8.0  # times a view's nearest depth, or the width of what it sees if it is orthographic
_SLICES_MIN = 32  # slices of what is seen small
_NEIGHBOUR_OFFSET = 4  # pixels between the depths that tell normals: slices are steps
_BEHIND = 8.0  # samples by which an object's surface may lie behind a view's own


class DepthObject(Fixed):
    """Solid that depth images all round leave of space, in their colours.

    A point is part of it if it lies behind every image's surface. Where an image saw no surface it leaves nothing.
    Section 4 of the paper.

    Parameters
    ----------
    views : sequence of DepthImage
        Orthographic or perspective, at any poses: six arranged as a cube in the paper
        (`pyibr.capture.object_views`).
    slices : int or "view"
        Along the longest edge of the object's box; other directions have the same spacing. "view": as many as the
        picture needs, with slices a pixel apart (section 3.4; but no closer than half a sample of the views), and
        more `halvings`, so that points are within an eighth of a pixel of the surface.
    slicing : {"orthogonal", "screen"}
        Along the edge of the box (its axes are the first view's) that faces the viewer most, or parallel to the view
        plane.
    halvings : int
        How often the way from a slice that passes back to the one before is halved to meet the surface; 0 leaves the
        slices as they are, as in the paper.
    texture : {"visible", "naive"}
        Up to three images colour a point, weighted by how close their directions are to the target's: "visible"
        takes those that saw the point (if any did), "naive" the closest ones as in the paper.
    missing : {"empty", "unknown"}
        What a sample without depth says: that space is empty along its ray, or nothing, as in the scans of sensors
        that do not see everything. Infinite depth, and depth from the image's `far` on, always means empty. Beside an
        image it is the same: what lies out of its frame is cut off, or left to the other images.
    only : int, optional
        The number of the slice that alone is drawn, to look at what the tests leave of it (figure 16): from 0 at one
        side of the box to `slices` at the other, or fewer where it is shorter; of slices parallel to the screen from
        the middle on, farther ones above 0. Points are on the slice, without `halvings`.
    thin : bool
        Things one sample thin in an image (wires, leaves, bars), of which the surface between samples leaves little or
        nothing, are as wide in it as the samples that saw them; see `warp`. Neighbours are torn apart as by
        `cut_ratio=1.05`, whatever the picture's.

    Raises
    ------
    ArgumentError
        If there are no views, one has no valid depth, or their volumes have nothing in common.

    Examples
    --------
    >>> import pyibr as ibr
    >>> from pyibr.capture import models
    >>> from pyibr.capture.raycast import object_views
    >>> thing = ibr.DepthObject(object_views(models.donut(), 64), slices=64)
    >>> thing
    <DepthObject 6 views, 64 slices>
    >>> camera = ibr.Camera.look_at((0, 0, 4), (0, 0, 0), (0, 1, 0), (41, 41), fov_y=45)
    >>> frame = ibr.render(thing, camera)
    >>> bool(frame.valid[20, 32]), bool(frame.valid[20, 20])  # the ring, and the hole in it
    (True, False)
    """

    def __init__(
        self,
        views: Sequence[DepthImage],
        *,
        slices: Slices = 128,
        slicing: ObjectSlicing = "orthogonal",
        texture: Texture = "visible",
        halvings: int = 2,
        missing: Missing = "empty",
        only: int | None = None,
        thin: bool = False,
    ) -> None:
        self.views = _checked_views(views, (DepthImage,))
        self.halvings = checked_halvings(halvings)
        self.slices: Slices = checked_slices(slices)
        self.only = checked_only(only, self.slices)
        one_of("slicing", slicing, ObjectSlicing)
        one_of("texture", texture, Texture)
        one_of("missing", missing, Missing)
        self.slicing: ObjectSlicing = slicing
        self.texture: Texture = texture
        self.missing: Missing = missing
        self.thin = checked_bool("thin", thin)
        box = box_of_samples(self.views, missing == "empty")
        # Ribbons reach up to a sample beyond the middles of those that they cover.
        reach = max(pixel_size(view.camera, corner) for view in self.views for corner in box.corners)
        self.box = box.grown(reach) if thin else box
        _check_resolved(self)

    def __repr__(self) -> str:
        return f"<DepthObject {len(self.views)} views, {slices_text(self.slices)}>"

    @property
    def bounds(self) -> tuple[Float64, Float64]:
        """(low, high), each (3,), in the world: the box around the object."""
        return self.box.bounds

    def draw(self, target: Target, lighting: Lighting | None) -> None:
        """Draw the object in its views' colours, which hold their light, unless a light relights them."""
        _draw_in_light(target, self, lighting, normals=True)

    def with_views(self, views: Sequence[DepthImage]) -> DepthObject:
        """The same of other views, for animations; what is known of those that it keeps is shared.

        Parameters
        ----------
        views : sequence of DepthImage
            As many as there are to be, at any poses; those of `views` that have not changed are given again.

        Returns
        -------
        DepthObject
            As if it were made anew.

        Raises
        ------
        ArgumentError
            As for a new one.

        Examples
        --------
        >>> import pyibr as ibr
        >>> from pyibr.capture import models
        >>> from pyibr.capture.raycast import object_views
        >>> views = object_views(models.donut(), 64)
        >>> first = ibr.DepthObject(views, slices=64)
        >>> darker = ibr.DepthImage(views[0].color // 2, views[0].depth, views[0].camera)
        >>> first.with_views([darker, *first.views[1:]])
        <DepthObject 6 views, 64 slices>
        """
        made = DepthObject(
            views,
            slices=self.slices,
            slicing=self.slicing,
            texture=self.texture,
            halvings=self.halvings,
            missing=self.missing,
            only=self.only,
            thin=self.thin,
        )
        made.__dict__["rgba"] = _with_known(self, self.rgba, made.views, _words_of)
        if all(map(np.array_equal, astuple(self.box), astuple(made.box))):  # what is empty lies at its end
            made.__dict__["maps"] = _with_known(self, self.maps, made.views, made.map_of)
        return made

    @cached_property
    def maps(self) -> list[Float32]:
        """Nearness images of the views, see `nearness_map`."""
        return [self.map_of(view) for view in self.views]

    def map_of(self, view: DepthImage) -> Float32:
        """The nearness image of one view."""
        return nearness_map(view, self.box, self.missing == "empty")

    @cached_property
    def rgba(self) -> list[NDArray[np.uint32]]:
        """Colours of the views, with A 255 where there is a sample."""
        return [_words_of(view) for view in self.views]


class VisualHull(Fixed):
    """Visual hull: the largest solid that fits into all silhouettes.

    Parameters
    ----------
    views : sequence of Silhouette or DepthImage
        Any number, at any calibrated poses; of depth images only `valid` and the colours are used. Each must show all
        of the object: what lies out of its frame is cut off.
    slices : int or "view"
        Along the longest edge of the hull's box; other directions have the same spacing. "view": as for `DepthObject`.
    slicing : {"orthogonal", "screen"}
        As for `DepthObject`; the box's axes are the world's.
    halvings, only : int
        As for `DepthObject`.

    Raises
    ------
    ArgumentError
        If there are no views, or nothing lies within all silhouettes.

    Examples
    --------
    >>> import pyibr as ibr
    >>> from pyibr.capture import models
    >>> from pyibr.capture.raycast import object_views
    >>> hull = ibr.VisualHull(object_views(models.donut(), 64), slices=64)
    >>> hull.tested  # opposite views show one silhouette
    [0, 2, 4]
    """

    texture: Texture = "naive"  # silhouettes do not tell what they see

    def __init__(
        self,
        views: Sequence[Silhouette | DepthImage],
        *,
        slices: Slices = 128,
        slicing: ObjectSlicing = "orthogonal",
        halvings: int = 2,
        only: int | None = None,
    ) -> None:
        self.views = _checked_views(views, (Silhouette, DepthImage))
        self.halvings = checked_halvings(halvings)
        self.slices: Slices = checked_slices(slices)
        self.only = checked_only(only, self.slices)
        one_of("slicing", slicing, ObjectSlicing)
        self.slicing: ObjectSlicing = slicing
        self.box = box_of_silhouettes([self.views[number] for number in self.tested])

    def __repr__(self) -> str:
        return f"<VisualHull {len(self.views)} views, {slices_text(self.slices)}>"

    @property
    def bounds(self) -> tuple[Float64, Float64]:
        """(low, high), each (3,), in the world: the box around the object."""
        return self.box.bounds

    def draw(self, target: Target, lighting: Lighting | None) -> None:
        """Draw the object in its views' colours, which hold their light, unless a light relights them."""
        given = all(isinstance(view, DepthImage) and view.normals is not None for view in self.views)
        _draw_in_light(target, self, lighting, normals=given)  # depths are none of its surface's

    @cached_property
    def outlines(self) -> list[int]:
        """For each view the number of the first with its silhouette: opposite orthographic views share one."""
        firsts: list[int] = []
        for number, view in enumerate(self.views):
            same = (other for other in sorted(set(firsts)) if is_opposite(view, self.views[other]))
            firsts.append(next(same, number))
        return firsts

    @property
    def tested(self) -> list[int]:
        """Numbers of the views with silhouettes of their own; each is tested once."""
        return sorted(set(self.outlines))

    @cached_property
    def maps(self) -> list[Float32]:
        """Masks of the views, 0 or 1."""
        return [_mask_of(view) for view in self.views]

    @cached_property
    def rgba(self) -> list[NDArray[np.uint32]]:
        """Colours of the views, with A 255 on the object."""
        return [_words_of(view) for view in self.views]

    def with_views(self, views: Sequence[Silhouette | DepthImage]) -> VisualHull:
        """The same of other views, for animations; see `DepthObject.with_views`.

        Where an outline changes, all are asked again where the hull's sides lie; while only colours change, they stay.

        Examples
        --------
        >>> import pyibr as ibr
        >>> from pyibr.capture import models
        >>> from pyibr.capture.raycast import object_views
        >>> first = ibr.VisualHull(object_views(models.donut(), 64), slices=64)
        >>> first.with_views(first.views[:4])
        <VisualHull 4 views, 64 slices>
        """
        given = _checked_views(views, (Silhouette, DepthImage))
        if len(given) == len(self.views) and all(map(_same_outline, given, self.views)):
            made = object.__new__(VisualHull)
            made.__dict__.update(self.__getstate__(), views=given)
        else:
            made = VisualHull(given, slices=self.slices, slicing=self.slicing, halvings=self.halvings, only=self.only)
        made.__dict__["rgba"] = _with_known(self, self.rgba, given, _words_of)
        made.__dict__["maps"] = _with_known(self, self.maps, given, _mask_of)
        return made


def _words_of(view: DepthImage | Silhouette) -> NDArray[np.uint32]:
    return rgba_words(view.shown_color, view.valid)


def _mask_of(view: DepthImage | Silhouette) -> Float32:
    return np.ascontiguousarray(view.valid, np.float32)


def _same_outline(a: DepthImage | Silhouette, b: DepthImage | Silhouette) -> bool:
    return a is b or (a.camera == b.camera and np.array_equal(a.valid, b.valid))


def _with_known(
    thing: DepthObject | VisualHull, values: list[_Known], views: Sequence[Any], make: Callable[[Any], _Known]
) -> list[_Known]:
    """Make something of each view; for views of a thing it is there already."""
    known = {id(view): value for view, value in zip(thing.views, values, strict=True)}
    return [known[id(view)] if id(view) in known else make(view) for view in views]


def draw_object(
    target: Target, thing: DepthObject | VisualHull, counters: DeviceArray | None = None, entry: Entry = NO_ENTRY
) -> None:
    """Draw an object into the target; `counts`, (H, W) int32, gains the view tests of each pixel."""
    hull = isinstance(thing, VisualHull)
    buffers = cached_on_device(thing, "buffers", lambda: _object_buffers(thing))
    if entry.normals:
        entry = entry.with_arrays(normals=cached_on_device(thing, "normals", lambda: _normals_of(thing)))
    box, camera = thing.box, target.camera
    directions = np.array([_direction(view.camera, box) for view in thing.views])
    cosines = directions @ _direction(camera, box)
    order = np.argsort(-cosines, kind="stable")
    if hull:  # of the views with one silhouette, the closest to the target's is tested, and colours
        _, closest = np.unique(np.array(thing.outlines)[order], return_index=True)
        order = order[np.sort(closest)]
    spacing, halvings = spacing_in(thing, camera)
    sample = _sample_in(thing.views, box)
    record = np.zeros((), struct("slicing/object.cl", "Box"))
    # In the kernel the world's origin is the box's middle: float32 holds what is near 0 best.
    record["from_world"] = (box.from_world @ _moved_by(box.center)).ravel()
    record["edges"], record["spacing"], record["slices"] = box.edges, spacing, np.ceil(box.edges.max() / spacing - 1e-6)
    depth = float(camera.camera_from_world[2, :3] @ box.center + camera.camera_from_world[2, 3])
    record["alone"], record["only"] = thing.only is not None, thing.only or 0
    record["first"] = np.rint(depth / spacing) if thing.slicing == "screen" else 0
    corners = np.asarray(box.corners, np.float32)
    near = target.near((corners.min(axis=0), corners.max(axis=0)))
    low_x, low_y, across, down = _blocks(target, box, near)
    defines = {"VIEWS": len(order), "SILHOUETTES": int(hull), **target.color_defines, **entry.defines}
    more: dict[str, Any] = {**entry.arguments}
    if counters is not None:
        defines["COUNTERS"] = 1
        more["counters"] = counters
    if isinstance(thing, DepthObject) and thing.thin:
        defines["RIBBONS"] = 1
        buffers = buffers | cached_on_device(thing, "ribbons", lambda: _ribbons_of(thing))
    if across > 0 and down > 0:
        launch(
            kernel("slicing/object.cl", "draw_object", **defines),
            (across, down),
            **buffers,
            order=upload(order.astype(np.int32)),
            closeness=upload(np.maximum(cosines, 1e-3).astype(np.float32)),
            screen=Struct("Screen", target.screen(near, box.center)),
            box=Struct("Box", record),
            slices_axis=slices_axis(thing, camera),
            halvings=halvings,
            finds_thin=thing.slices == "view",
            visible=thing.texture == "visible",
            unknown=isinstance(thing, DepthObject) and thing.missing == "unknown",
            sample=sample,
            stride=(_BEHIND * sample + spacing / 2**halvings) / 2 ** (constant("slicing/object.cl", "STRIDES") - 1),
            low_x=low_x,
            low_y=low_y,
            blank=target.blank,
            **target.outputs(),
            **more,
        )
        target.blank = False


def _sample_in(views: Sequence[DepthImage | Silhouette], box: Box) -> float:
    """Scene units from one sample to the next in a box's middle, of the view whose are the largest."""
    return max(pixel_size(view.camera, box.center) for view in views)


def spacing_in(thing: DepthObject | VisualHull, camera: Camera) -> tuple[float, int]:
    """Scene units from slice to slice in a picture, and how often the way between two is halved."""
    box = thing.box
    if thing.slices != "view":
        return float(box.edges.max()) / thing.slices, 0 if thing.only is not None else thing.halvings
    pixel = nearest_pixel(camera, box.corners)
    # Along the ray through the middle slices lie a pixel apart.
    if thing.slicing == "screen":
        spacing, extent = pixel, np.abs(box.axes @ camera.forward) @ box.edges
    else:
        axis = slices_axis(thing, camera)
        spacing, extent = pixel * abs(float(box.axes[axis] @ _direction(camera, box))), box.edges[axis]
    # No closer than half a sample: what is thinner there no view tells.
    sample = min(pixel_size(view.camera, box.center) for view in thing.views)
    least = max(0.5 * sample, spacing_min(float(box.edges.max())))
    spacing = min(max(spacing, least), extent / _SLICES_MIN)
    return float(spacing), max(thing.halvings, halvings_between(float(spacing), pixel))


def _draw_in_light(target: Target, thing: DepthObject | VisualHull, lighting: Lighting | None, normals: bool) -> None:
    """Draw an object in its views' colours, and light on it; `normals`: those that its views tell relight it."""
    cameras = [target.camera, *(() if lighting is None else lighting.cameras)]
    bias = max(spacing_in(thing, camera)[0] for camera in cameras)
    draw_object(
        target, thing, entry=entry_for(target, lighting, bias=bias, apart=_NEIGHBOUR_OFFSET, fade=0, normals=normals)
    )


def _moved_by(offset: Float64) -> Float64:
    """(4, 4) that adds an offset to points."""
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    return matrix


def slices_axis(thing: DepthObject | VisualHull, camera: Camera) -> int:
    """Edge of the box that the slices stand across: the one that faces the camera most, or the kernel's TO_SCREEN."""
    if thing.slicing == "screen":
        return int(constant("slicing/object.cl", "TO_SCREEN"))
    return int(np.argmax(np.abs(thing.box.axes @ _direction(camera, thing.box))))


def _direction(camera: Camera, box: Box) -> Float64:
    """Unit vector in which a camera sees the box."""
    forward = camera.world_from_camera[:3, 2]
    if camera.projection == "perspective":
        forward = box.center - camera.world_from_camera[:3, 3]
    return forward / max(float(np.linalg.norm(forward)), 1e-30)


def _blocks(target: Target, box: Box, near: float) -> tuple[int, int, int, int]:
    """First pixel and blocks across and down: all of a blank picture, else where the box may be seen."""
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


def _object_buffers(thing: DepthObject | VisualHull) -> dict[str, DeviceArray]:
    """The object for the current device."""
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
        "maps": upload(np.concatenate([values.ravel() for values in thing.maps])),
        "colors": _uploaded(thing.rgba),
    }


def _ribbons_of(thing: DepthObject) -> dict[str, DeviceArray]:
    """Ribbons of the views; of each sample the number of its first ribbon, and at last that of all."""
    found = [ribbons_of(view) for view in thing.views]
    none = np.zeros((1, int(constant("slicing/ribbon_record.h", "RIBBON_FLOATS"))), np.float32)
    records = np.concatenate([one.records for one in found])
    firsts = np.cumsum(np.concatenate([np.zeros(1, np.int32), *(one.counts.ravel() for one in found)]), dtype=np.int32)
    return {"firsts": upload(firsts), "ribbons": upload(records if len(records) else none)}


def _normals_of(thing: DepthObject | VisualHull) -> DeviceArray:
    return _uploaded([_words_of(showing_normals(view)) for view in thing.views])


def _uploaded(rgba: Sequence[NDArray[np.uint32]]) -> DeviceArray:
    """RGBA of all views, one after the other."""
    return upload(np.concatenate(rgba))


def _check_resolved(thing: DepthObject) -> None:
    """Raise ArgumentError if slices are so far apart that they miss what a view saw: of a wall far behind, say."""
    for number, view in enumerate(thing.views):
        nearest, farthest = depth_extent_of(view).nearest, depth_extent_of(view).farthest
        camera = view.camera
        seen = nearest if camera.projection == "perspective" else longer_side(camera)
        slices = SLICES_USUAL if thing.slices == "view" else thing.slices
        if float(thing.box.edges.max()) > slices * _APART_MAX * seen:
            expected = f"depths that {slices} slices can tell apart (or `far`, if larger ones are no surface)"
            raise ArgumentError("views", expected, f"{nearest:g} to {farthest:g} in view {number}")


def _checked_views(views: object, kinds: Any) -> list[Any]:
    if not isinstance(views, Sequence) or not views:
        raise ArgumentError("views", "a sequence of at least one view", describe(cast("object", views)))
    several = list(cast("Sequence[object]", views))
    for number, view in enumerate(several):
        if not isinstance(view, kinds):
            names = " or ".join(f"pyibr.{kind.__name__}" for kind in kinds)
            raise ArgumentError("views", f"a sequence of {names}", f"{describe(view)} as view {number}")
    straight = [
        straight_silhouette(view) if isinstance(view, Silhouette) else straightened(cast("DepthImage", view))
        for view in several
    ]
    for number, view in enumerate(straight):
        if not view.valid.any():
            raise ArgumentError("views", "views with valid depth", f"none in view {number}")
    return straight
