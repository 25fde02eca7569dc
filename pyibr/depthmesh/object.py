"""Several depth images of one object or scene, blended per pixel (Pajarola, Sainz & Meng 2003, section 4)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64, Immutable, checked_bool, describe, instance_of, integer_from, number_from, one_of
from pyibr.core.errors import ArgumentError
from pyibr.core.undistortion import check_no_lens, covering_camera
from pyibr.depthmesh.closing import Closed, Missing, closing_of
from pyibr.depthmesh.drawing import Blending, build_ahead_of_meshes, draw_depth_meshes
from pyibr.depthmesh.mesh import DepthMesh, checked_tolerance
from pyibr.depthmesh.segmentation import Segmentation
from pyibr.depthmesh.selection import REUSE_MAX
from pyibr.depthmesh.viewpoints import Viewpoints
from pyibr.images import DepthImage
from pyibr.images.depth_image import check_seen
from pyibr.images.exposure import exposure_gains
from pyibr.opencl.device import one_call
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.memory import DeviceArray, zeros
from pyibr.picture.shadow import Lighting
from pyibr.picture.target import Target

Blend = Literal["quality", "position", "nearest"]
Choice = Literal["closest", "facing"]

_EPSILON = 0.01  # relative to the largest extent
_BLENDED_MAX = 32  # largest number of blended views


class DepthMeshObject(Immutable):
    """Depth images of one object or scene as adaptive meshes, blended per pixel.

    For each target, the views with the closest viewpoints are triangulated. Each pixel finds the nearest surface of
    each view's mesh and blends the colours of the front surface and of surfaces close behind it. Colours have 8 bits
    a channel.

    Parameters
    ----------
    views : sequence of DepthImage or DepthMesh
        Views at any poses: the paper takes six from the sides of a box around an object
        (`pyibr.capture.object_views`), but frames of a scene work as well. A `DepthMesh` keeps its own `errors`.
    tolerance : float
        Largest distance, in pixels of the target, >= 0, between two meshes of the same surface: each mesh gets half
        of this tolerance.
    blend : {"quality", "position", "nearest"}
        "quality" weights each view by the closeness of its viewpoint and, per pixel, by how directly the surface
        faced the view; "position" by the closeness alone. In both, a view fades over 8 of its samples towards the ends
        of its surface: depth edges, holes, the image border. "nearest" takes the colour of the front surface.
    blended : int
        Number of views that are drawn, 1 to 32, three in the paper; at most all views.
    epsilon : float, optional
        Scene units, >= 0: surfaces that lie less than this behind the front surface count as the same surface. By
        default 1 % of the largest extent of the samples.
    closed : bool or "sheets"
        Whether and how holes are closed. True: coarse meshes of the other close views fill them. Further, a pixel is
        closed if its ray must meet an unseen surface: the ray meets the back of a mesh, or passes behind a depth edge
        and from there on crosses no space that a view saw to be empty. At such an edge the near surface ends half a
        sample beyond its samples, and the far surface continues behind the near one. Closed surface is a guess, and
        `Frame.guessed` is its mask. "sheets", as in the paper (section 4.5): coarse meshes of the drawn views that keep
        their rubber sheets fill the holes; they cover empty space, too.
    missing : {"unknown", "empty"}
        Meaning of a sample without depth (NaN or 0) where rays close holes. "unknown": the view does not decide, as in
        frames of depth cameras; a scene without empty samples counts as a room, where every ray meets a surface, unless
        the views show a thing whole from several sides. "empty": the sample's ray meets no surface, as in pictures of
        an object alone. Infinite depth, and depth from the view's `far` on, is always empty.
    segmentation : Segmentation, optional
        Segmentation for all views; by default each `DepthMesh` keeps its own.
    match_exposures : bool
        Whether different exposures of the views are matched: the channels of each view are multiplied so that views
        agree where they saw the same surface. For cameras with automatic exposure.
    choose : {"closest", "facing"}
        Choice of the views that are drawn: the views with the "closest" viewpoints, or, for views at various distances
        around an object, close views that see it from the same side ("facing": section 4.2 of the paper). The weights
        depend on closeness in either case.
    reuse : float
        Reuse of triangles while the camera moves little, as in `DepthMesh`: 0 to 0.5.

    Raises
    ------
    ArgumentError
        If an argument is out of its range, if a view has no valid depth, or if a view's surface is so far from the
        other views' surfaces that it must be another object.

    Examples
    --------
    >>> import pyibr as ibr
    >>> from pyibr.capture import models
    >>> from pyibr.capture.raycast import object_views
    >>> thing = ibr.DepthMeshObject(object_views(models.donut(), 64))
    >>> thing
    <DepthMeshObject 6 views>
    >>> camera = ibr.Camera.look_at((0, 0, 4), (0, 0, 0), (0, 1, 0), (41, 41), fov_y=45)
    >>> frame = ibr.render(thing, camera)
    >>> bool(frame.valid[20, 32]), bool(frame.valid[20, 20])  # the ring, and the hole in it
    (True, False)
    """

    def __init__(
        self,
        views: Sequence[DepthImage | DepthMesh],
        *,
        tolerance: float = 1.0,
        blend: Blend = "quality",
        blended: int = 3,
        epsilon: float | None = None,
        closed: Closed = True,
        missing: Missing = "unknown",
        segmentation: Segmentation | None = None,
        match_exposures: bool = False,
        choose: Choice = "closest",
        reuse: float = 0.0,
    ) -> None:
        self.meshes = _checked_meshes(views, segmentation)
        self.tolerance = checked_tolerance("tolerance", tolerance)
        self.blend: Blend = one_of("blend", blend, Blend)
        self.blended = min(integer_from("blended", blended, 1, _BLENDED_MAX), len(self.meshes))
        self._epsilon = None if epsilon is None else checked_tolerance("epsilon", epsilon)
        if not isinstance(closed, bool) and closed != "sheets":  # pyright: ignore[reportUnnecessaryComparison]
            raise ArgumentError("closed", 'True, False or "sheets"', describe(closed))
        self.closed: Closed = closed
        self.missing: Missing = one_of("missing", missing, Missing)
        self.match_exposures = checked_bool("match_exposures", match_exposures)
        self.choose: Choice = one_of("choose", choose, Choice)
        self.reuse = number_from("reuse", reuse, 0.0, REUSE_MAX, "a number from 0 to 0.5")

    def __repr__(self) -> str:
        return f"<DepthMeshObject {len(self.meshes)} view{'s' * (len(self.meshes) != 1)}>"

    @property
    def views(self) -> Sequence[DepthMesh]:
        """The meshes of the views; the same object can be made from these."""
        return self.meshes

    @property
    def segmentation(self) -> Segmentation | None:
        """Segmentation of all views; None if the views have different ones."""
        first, *others = {mesh.segmentation for mesh in self.meshes}
        return None if others else first

    @cached_property
    def _boxes(self) -> Float64:
        """(views, 2, 3) low and high of each mesh's box in the world."""
        boxes: list[tuple[Float64, Float64]] = []
        for number, mesh in enumerate(self.meshes):
            try:
                boxes.append(mesh.bounds)
            except ArgumentError as error:
                raise ArgumentError("views", f"views with {error.expected}", f"{error.got} in view {number}") from None
        return np.array(boxes)

    @cached_property
    def _viewpoints(self) -> Viewpoints:
        return Viewpoints([mesh.view for mesh in self.meshes], self._boxes)

    @property
    def bounds(self) -> tuple[Float64, Float64]:
        """(low, high), each (3,), in the world: the box around the surfaces."""
        return self._viewpoints.bounds

    @cached_property
    def extent(self) -> float:
        """The largest edge of the box around the surfaces, in scene units."""
        return self._viewpoints.extent

    @cached_property
    def epsilon(self) -> float:
        """Largest distance behind the front surface, in scene units, at which a surface counts as the same."""
        return _EPSILON * self.extent if self._epsilon is None else self._epsilon

    def draw(self, target: Target, lighting: Lighting | None, occupancy: DeviceArray | None = None) -> None:
        """Draw the blended meshes in the views' colours, which contain their light, unless a light relights them.

        `occupancy`, (H, W) uint32, receives the bits that the method of this name returns.
        """
        build_ahead_of_meshes(target, self.closed, is_lit=lighting is not None)
        viewpoints, closing, trees = self._viewpoints, None, [mesh.tree for mesh in self.meshes]
        closeness, order = viewpoints.ranked(target.camera, self.choose == "facing")
        drawn = viewpoints.drawn(target.camera, order, self.blended, self.closed)
        if self.closed:
            closing = cached_on_device(
                self, "closing", lambda: closing_of(trees, self.extent, self.closed, self.missing)
            )
        draw_depth_meshes(
            target,
            self,
            trees,
            viewpoints.bounds,
            tolerance=self.tolerance,
            reuse=self.reuse,
            blending=Blending(self.blend, drawn, closeness, self.epsilon, closing=closing, gains=self._gains),
            lighting=lighting,
            occupancy=occupancy,
        )

    @cached_property
    def _gains(self) -> Float64 | None:
        """(views, 3) factors for the views' colours."""
        return exposure_gains([mesh.view for mesh in self.meshes]) if self.match_exposures else None

    def weights(self, camera: Camera) -> Float64:
        """Positional weights of the views for a camera (section 4.2 of the paper).

        Returns
        -------
        (views,) float64
            For the `blended` chosen views, the normalised inverse distance between the view's viewpoint and the
            camera's; 0 for the others. Among views with the same viewpoint, views that look the same way as the camera
            come first. Views whose surface the camera does not see get almost no weight. The viewpoint of an
            orthographic camera lies in front of the centre of the object, at the average distance of the perspective
            views, or at twice the object's extent if there are none.
        """
        instance_of("camera", camera, Camera, "a pyibr.Camera")
        found, order = self._viewpoints.ranked(covering_camera("camera", camera), self.choose == "facing")
        found[order[self.blended :]] = 0.0
        return found / found.sum()

    def occupancy(self, camera: Camera) -> NDArray[np.uint32]:
        """Find the views that gave each pixel its colour (figure 12 of the paper).

        Returns
        -------
        (H, W) uint32
            Bit k for view k.

        Raises
        ------
        ArgumentError
            If there are more than 32 views, since each needs a bit.
        """
        instance_of("camera", camera, Camera, "a pyibr.Camera")
        check_no_lens("camera", camera)
        if len(self.meshes) > 32:
            raise ArgumentError("views", "at most 32, a bit each", f"{len(self.meshes)}")
        with one_call():
            found = zeros((camera.height, camera.width), np.uint32)
            self.draw(Target(camera, np.dtype(np.uint8)), None, found)
            return np.array(found.to_host())


def _checked_meshes(views: object, segmentation: Segmentation | None) -> list[DepthMesh]:
    if not isinstance(views, Sequence) or not views:
        raise ArgumentError("views", "a sequence of at least one view", describe(cast("object", views)))
    meshes: list[DepthMesh] = []
    for number, view in enumerate(cast("Sequence[object]", views)):
        if isinstance(view, DepthMesh):
            is_kept = segmentation in (None, view.segmentation)
            meshes.append(view if is_kept else DepthMesh(view.view, segmentation=segmentation, errors=view.errors))
        elif not isinstance(view, DepthImage):
            raise ArgumentError("views", "DepthImage or DepthMesh", f"{describe(view)} as view {number}")
        elif min(view.camera.size) < 2:
            size = f"{view.camera.width}x{view.camera.height}"
            raise ArgumentError("views", "views of at least 2x2 samples", f"{size} as view {number}")
        elif not view.valid.any():
            raise ArgumentError("views", "views with valid depth", f"none in view {number}")
        else:
            check_seen(view, number)
            meshes.append(DepthMesh(view, segmentation=segmentation))
    _check_connected([mesh.view for mesh in meshes])
    return meshes


def _check_connected(views: list[DepthImage]) -> None:
    """Raise ArgumentError if the views' boxes, doubled in size, are not connected: a view shows another object."""
    boxes = np.array([view.bounds for view in views])
    reach = 0.5 * (boxes[:, 1] - boxes[:, 0]).max(axis=1, keepdims=True)
    low, high = boxes[:, 0] - reach, boxes[:, 1] + reach
    joined = np.arange(len(views)) == 0
    for _ in views:  # each round joins the views that meet a joined one
        low_of_all, high_of_all = low[joined], high[joined]
        meets = (low[:, None] <= high_of_all).all(axis=2) & (high[:, None] >= low_of_all).all(axis=2)
        joined = joined | meets.any(axis=1)
    if not joined.all():
        number = int(np.argmin(joined))
        raise ArgumentError("views", "views of one scene", f"view {number}, which shares no volume with the first ones")
