"""Objects from depth images all round: what they leave of space (Kautz & Seidel 2001, section 4)."""

from __future__ import annotations

from collections.abc import Sequence

from pyibr.core.checks import checked_bool, one_of
from pyibr.core.errors import ArgumentError
from pyibr.core.pixelspace import longer_side, pixel_size
from pyibr.images import DepthImage
from pyibr.opencl.memory import DeviceArray
from pyibr.picture.shadow import Lighting
from pyibr.picture.target import Target
from pyibr.picture.undistort import undistorted
from pyibr.slicing.boxes import box_of_samples, depth_extent_of
from pyibr.slicing.cells import maps_of, reach_of
from pyibr.slicing.drawing import draw_in_light
from pyibr.slicing.meshing import MeshableSolid
from pyibr.slicing.solid import Missing, SolidSlicing, Texture, checked_views, words_of
from pyibr.slicing.spacing import SLICES_USUAL, Slices

_EXTENT_RATIO_MAX = 8.0  # times a view's nearest depth, or the width of what it sees if it is orthographic


class DepthObject(MeshableSolid):
    """Solid that depth images all round leave of space, in their colours.

    A point is part of it if it lies behind every image's surface. Where an image saw no surface it leaves nothing; a
    sample covers its pixel, so outlines run half-way between samples with depth and those without, and the more images
    there are, the farther out: each cuts off what its samples missed.
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
        Things one sample thin in an image (wires, leaves, bars), of which all images together leave less than each,
        are as wide in it as the samples that saw them; see `warp`. Neighbours are torn apart as by
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
        slicing: SolidSlicing = "orthogonal",
        texture: Texture = "visible",
        halvings: int = 2,
        missing: Missing = "empty",
        only: int | None = None,
        thin: bool = False,
    ) -> None:
        super().__init__(checked_views(views, {DepthImage: undistorted}), slices, slicing, halvings, only)
        one_of("texture", texture, Texture)
        one_of("missing", missing, Missing)
        self.texture: Texture = texture
        self.missing: Missing = missing
        self.thin = checked_bool("thin", thin)
        box = box_of_samples(self.views, missing == "empty")
        # Samples cover their pixels; ribbons reach up to a sample beyond the middles of those that they cover.
        sample = max(pixel_size(view.camera, corner) for view in self.views for corner in box.corners)
        self.box = box.grown(sample if thin else 0.5 * sample)
        _check_resolved(self)

    def draw(self, target: Target, lighting: Lighting | None) -> None:
        """Draw the object in its views' colours, which hold their light, unless a light relights them."""
        draw_in_light(target, self, lighting, normals=True)

    def with_views(self, views: Sequence[DepthImage]) -> DepthObject:
        """Return the same object of other views, for animations; what is known of views that stay is shared.

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
        made.__dict__["rgba"] = self.with_known(self.rgba, made.views, words_of)
        return made

    def maps(self) -> DeviceArray:
        """Nearness of the views' samples, and cells: `pyibr.slicing.cells`."""
        return maps_of(self.views, self.box, self.missing == "empty")

    def reach_of(self, view: DepthImage) -> float:
        """The nearness by which a view's surface may be nearer than its samples."""
        return reach_of(view)


def _check_resolved(thing: DepthObject) -> None:
    """Raise ArgumentError if slices are so far apart that they miss what a view saw: of a wall far behind, say."""
    for number, view in enumerate(thing.views):
        nearest, farthest = depth_extent_of(view).nearest, depth_extent_of(view).farthest
        camera = view.camera
        seen = nearest if camera.projection == "perspective" else longer_side(camera)
        slices = SLICES_USUAL if thing.slices == "view" else thing.slices
        if float(thing.box.edges.max()) > slices * _EXTENT_RATIO_MAX * seen:
            expected = f"depths that {slices} slices can tell apart (or `far`, if larger ones are no surface)"
            raise ArgumentError("views", expected, f"{nearest:g} to {farthest:g} in view {number}")
