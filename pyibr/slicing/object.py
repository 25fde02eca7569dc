"""Objects from depth images from all sides: the intersection of their volumes (Kautz & Seidel 2001, section 4)."""

from __future__ import annotations

from collections.abc import Sequence

from pyibr.core.checks import checked_bool, one_of
from pyibr.core.errors import ArgumentError
from pyibr.core.pixelspace import longer_side, pixel_size
from pyibr.images import DepthImage
from pyibr.opencl.memory import DeviceArray
from pyibr.picture.undistort import undistorted
from pyibr.slicing.boxes import box_of_samples, depth_extent_of
from pyibr.slicing.cells import maps_of
from pyibr.slicing.meshing import MeshableSolid
from pyibr.slicing.solid import Missing, SolidSlicing, Texture, checked_views, words_of
from pyibr.slicing.spacing import SLICES_USUAL, Slices

_EXTENT_RATIO_MAX = 8.0  # largest spacing of slices, relative to a view's nearest depth or orthographic width


class DepthObject(MeshableSolid):
    """Solid that is the intersection of the volumes behind depth images, in the images' colours.

    A point is part of it if it lies behind the surface of every image. Space where an image saw no surface is cut off.
    A sample covers its pixel, so outlines run half-way between samples with depth and samples without. With more
    images, outlines lie farther out, because each image cuts off details between its samples. Section 4 of the paper.

    Parameters
    ----------
    views : sequence of DepthImage
        Orthographic or perspective, at any poses; the paper arranges six as a cube
        (`pyibr.capture.object_views`).
    slices : int or "view"
        Number along the longest edge of the object's box; other directions have the same spacing. "view": as many as
        the picture needs. Slices are then a pixel's width apart (section 3.4), but no closer than a quarter of a sample
        of the views, and more `halvings` bring points within an eighth of a pixel of the surface.
    slicing : {"orthogonal", "screen"}
        "orthogonal": along the edge of the box that faces the viewer most; the box's axes are the first view's.
        "screen": parallel to the view plane.
    halvings : int
        Number of halvings of the interval between a ray's first slice inside the solid and the slice before, to
        approach the surface; 0 leaves points on the slices, as in the paper.
    texture : {"visible", "naive"}
        Up to three images colour a point, weighted by how close their directions are to the target's. "visible":
        images that saw the point, if any did; "naive": the closest images, as in the paper.
    missing : {"empty", "unknown"}
        Meaning of a sample without depth. "empty": space along its ray is empty; "unknown": the image does not decide,
        for scans of sensors that do not see everything. Infinite depth, and depth from the image's `far` on, is
        always empty. Points outside an image's frame are cut off with "empty", and left to other images with "unknown".
    only : int, optional
        Number of the only slice to draw, for inspecting the tests on it (figure 16). Numbers run from 0 at one side of
        the box to `slices` at the other, or to fewer where the box is shorter. Slices parallel to the screen count
        from the middle; farther slices are above 0. Points lie on the slice, without `halvings`.
    thin : bool
        Draws parts one sample thin in an image (wires, leaves, bars) as wide as the samples that saw them; without it,
        they are narrower in the intersection of all images; see `warp`. Neighbours are torn apart as with
        `cut_ratio=1.05`, whatever the picture's ratio.

    Raises
    ------
    ArgumentError
        If there are no views, a view has no valid depth, or the views' volumes have nothing in common.

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
        super().__init__(checked_views(views, {DepthImage: undistorted}), slices, slicing, halvings, only, texture)
        one_of("missing", missing, Missing)
        self.missing: Missing = missing
        self.thin = checked_bool("thin", thin)
        box = box_of_samples(self.views, missing == "empty")
        # Samples cover their pixels; ribbons reach up to a sample beyond the centres of samples that they cover.
        sample = max(pixel_size(view.camera, corner) for view in self.views for corner in box.corners)
        self.box = box.grown(sample if thin else 0.5 * sample)
        _check_resolved(self)

    def with_views(self, views: Sequence[DepthImage]) -> DepthObject:
        """Return the same object made from other views, for animations; data of unchanged views is shared.

        Parameters
        ----------
        views : sequence of DepthImage
            All views of the result, at any poses; pass unchanged views again from `views`.

        Returns
        -------
        DepthObject
            The same as a new object.

        Raises
        ------
        ArgumentError
            As for a new object.

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

    @property
    def surfaces(self) -> list[DepthImage]:
        """The views."""
        return self.views

    def maps(self) -> DeviceArray:
        """Return nearness of the views' samples, and cells: `maps_of`."""
        return maps_of(self.views, self.box, self.missing == "empty")


def _check_resolved(thing: DepthObject) -> None:
    """Raise ArgumentError if the slices are too far apart to show a view's depths, for example with a far wall."""
    for number, view in enumerate(thing.views):
        nearest, farthest = depth_extent_of(view).nearest, depth_extent_of(view).farthest
        camera = view.camera
        seen = nearest if camera.projection == "perspective" else longer_side(camera)
        slices = SLICES_USUAL if thing.slices == "view" else thing.slices
        if float(thing.box.edges.max()) > slices * _EXTENT_RATIO_MAX * seen:
            expected = f"depths that {slices} slices can resolve (set `far` if larger depths are no surface)"
            raise ArgumentError("views", expected, f"{nearest:g} to {farthest:g} in view {number}")
