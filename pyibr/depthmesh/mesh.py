"""One depth image as an adaptive triangle mesh (Pajarola, Sainz & Meng 2003, section 3)."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Literal, overload

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import (
    Float64,
    Immutable,
    checked_bool,
    describe,
    instance_of,
    integer_from,
    number_from,
    numbers,
    one_of,
)
from pyibr.core.errors import ArgumentError
from pyibr.core.undistortion import covering_camera
from pyibr.depthmesh.drawing import draw_depth_meshes
from pyibr.depthmesh.merging import merged
from pyibr.depthmesh.segmentation import Segmentation
from pyibr.depthmesh.selection import REUSE_MAX, active_within, select_for
from pyibr.depthmesh.strips import strips_of, with_normals
from pyibr.depthmesh.tree import ErrorsBy, Tree, build_tree
from pyibr.depthmesh.triangulation import list_triangles, pixels_of
from pyibr.images import DepthImage
from pyibr.meshes.mesh import Mesh
from pyibr.opencl.device import current
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.memory import DeviceArray
from pyibr.picture.shadow import Lighting
from pyibr.picture.target import Target
from pyibr.picture.undistort import undistorted

Int32 = NDArray[np.int32]

_START = 3  # merging starts from this multiple of the wanted number of triangles
_LEAST_ERROR, _MOST_ERROR = 1e-4, 0.02  # relative to the extent: errors of the triangulation that merging starts from


class DepthMesh(Immutable):
    """A depth image as a triangle mesh that adapts to the viewer: fine where the viewer sees detail, without cracks.

    Each sample covers its pixel, so the mesh extends half a pixel beyond the outermost samples, by linear
    extrapolation. The device holds a restricted quadtree over the samples, with the error of each vertex, and each
    target gets its triangulation from this tree. `render` draws the side that the view saw, with 8 bits a channel.

    Parameters
    ----------
    view : DepthImage
        Perspective or orthographic, at least 2x2 samples. A view with a lens is undistorted first.
    tolerance : float
        Largest distance between the surface that `render` draws and the full grid, in pixels of the target, >= 0;
        0 draws the full grid.
    segmentation : Segmentation, optional
        Test that removes triangles which bridge two surfaces; by default the paper's test.
    errors : {"sum", "largest"}
        Estimate of the error where a vertex and its descendants are left out: the "sum" of their errors, where of a
        vertex and its child only the larger one counts, is an upper bound; the "largest" of them, as in the paper
        (section 3.2), is seldom exceeded and takes fewer triangles at the same tolerance. The sum is the default
        because the tolerance then holds. Neither counts errors that the view's noise explains, if that noise is known
        or estimated (`DepthImage.noise`).
    reuse : float
        Reuse of triangles while the camera moves little: 0 to 0.5, 0 for none. With 0.1, the triangles are chosen
        for a tolerance that is a tenth finer and a view that is a tenth wider, and are drawn again as long as they
        meet the tolerance. The triangles then depend on the previous targets.

    Raises
    ------
    ArgumentError
        If an argument is out of its range; on first use, if the samples make no triangle, or lie so near or far that
        products of their distances exceed single precision.

    Examples
    --------
    >>> import pyibr as ibr
    >>> from pyibr.capture import models
    >>> from pyibr.capture.raycast import object_views
    >>> thing = ibr.DepthMesh(object_views(models.donut(), 64)[4])
    >>> thing
    <DepthMesh 64x64>
    >>> fine, coarse = (thing.triangulate(thing.view.camera, tolerance=tolerance) for tolerance in (0, 2))
    >>> len(coarse.faces) < len(fine.faces)
    True
    """

    def __init__(
        self,
        view: DepthImage,
        *,
        tolerance: float = 1.0,
        segmentation: Segmentation | None = None,
        errors: ErrorsBy = "sum",
        reuse: float = 0.0,
    ) -> None:
        instance_of("view", view, DepthImage, "a pyibr.DepthImage")
        if min(view.camera.size) < 2:
            raise ArgumentError("view", "at least 2x2 samples", f"{view.camera.width}x{view.camera.height}")
        if not view.valid.any():
            raise ArgumentError("view", "samples with valid depth", "none")
        rule = Segmentation() if segmentation is None else segmentation
        if not isinstance(rule, Segmentation):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ArgumentError("segmentation", "a pyibr.depthmesh.Segmentation or None", describe(rule))
        self.view = undistorted(view)
        self.tolerance = checked_tolerance("tolerance", tolerance)
        self.segmentation = rule
        self.errors: ErrorsBy = one_of("errors", errors, ErrorsBy)
        self.reuse = number_from("reuse", reuse, 0.0, REUSE_MAX, "a number from 0 to 0.5")

    def __repr__(self) -> str:
        return f"<DepthMesh {self.view.camera.width}x{self.view.camera.height}>"

    @property
    def bounds(self) -> tuple[Float64, Float64]:
        """(low, high), each (3,), in the world: the box around the triangles, without isolated samples."""
        return self._box

    @cached_property
    def _box(self) -> tuple[Float64, Float64]:
        with self.tree.cells.session.call():
            found = _in_triangles(self.tree)
            low, high = self.view.bounds_of(found)
            found[1:-1, 1:-1] = False
            border = self.view.camera.unproject(*self.tree.vertices_of(np.flatnonzero(found).astype(np.int32)))
            return np.min([low, *border], axis=0), np.max([high, *border], axis=0)

    def draw(self, target: Target, lighting: Lighting | None) -> None:
        """Draw the triangles in the view's colours, which contain their light, unless a light relights them."""
        bounds, tolerance = self.bounds, self.tolerance
        draw_depth_meshes(target, self, [self.tree], bounds, tolerance=tolerance, reuse=self.reuse, lighting=lighting)

    @property
    def tree(self) -> Tree:
        """The quadtree on the current device, built once."""
        with current().call():
            return cached_on_device(self, "tree", self._made_tree)

    def _made_tree(self) -> Tree:
        made = build_tree(self.view, self.segmentation, self.errors)
        if not any(part.any() for part in made.drawn_cells()):
            raise ArgumentError("view", "samples that make triangles", "only isolated ones, or rubber sheets")
        return made

    @cached_property
    def normals(self) -> NDArray[np.float32]:
        """(H, W, 3) unit normals of the samples in the frame of the view's camera, towards the camera."""
        tree = self.tree
        with tree.cells.session.call():
            return tree.sample_normals()

    @property
    def quality(self) -> NDArray[np.float32]:
        """(H, W) ``|n . (0, 0, 1)|``, in [0, 1]: how directly each sample faces the camera."""
        return np.abs(self.normals[..., 2])

    def triangulate(self, camera: Camera, *, tolerance: float | None = None) -> Mesh:
        """Triangulate the surface for a camera (section 3.4 of the paper).

        Parameters
        ----------
        camera : Camera
            Perspective or orthographic. Surface outside its view stays coarse.
        tolerance : float, optional
            Pixels of that camera, >= 0: vertices whose projected error is smaller are left out; 0 takes all vertices.
            By default the mesh's own `tolerance`.

        Returns
        -------
        Mesh
            In the world, with the view's colour as texture and uv coordinates into it, with vertex colours for file
            formats without textures, with normals, and with the attribute "quality" (N,).

        Raises
        ------
        ArgumentError
            If an argument is out of its range.
        """
        with self.tree.cells.session.call():
            return self._mesh_of(*self._some_triangles_for(camera, tolerance))

    def simplify(self, max_error: float | None = None, *, count: int | None = None) -> Mesh:
        """Triangulate the surface within an error or to a number of triangles, for any view.

        With `max_error` alone, the triangles come from the quadtree; along depth edges they are as fine as the samples.
        With `count`, triangles are merged, along depth edges too, the flattest first: for small web pages and files.

        Parameters
        ----------
        max_error : float, optional
            Scene units, >= 0: largest difference of depth between the mesh and any sample. With `count`, it bounds the
            distance of each vertex from the planes and outlines that were merged into it, and merging stops before it
            exceeds this error, so more triangles may remain.
        count : int, optional
            Largest number of triangles, >= 1.

        Returns
        -------
        Mesh
            As from `triangulate`.

        Raises
        ------
        ArgumentError
            If neither is given, or one is out of its range.

        Examples
        --------
        >>> import numpy as np
        >>> import pyibr as ibr
        >>> camera = ibr.Camera([[30, 0, 16], [0, 30, 16], [0, 0, 1]], (33, 33))
        >>> plane = ibr.DepthImage(np.zeros((33, 33, 3), np.uint8), np.full((33, 33), 2, np.float32), camera)
        >>> len(ibr.DepthMesh(plane).simplify(1e-4).faces)
        2
        >>> y, x = np.mgrid[:33, :33]
        >>> ball = np.where((x - 16) ** 2 + (y - 16) ** 2 < 100, 1.5, 2.0).astype(np.float32)
        >>> thing = ibr.DepthMesh(ibr.DepthImage(plane.color, ball, camera))
        >>> len(thing.simplify(0.1).faces) > 4 * len(thing.simplify(count=50).faces)
        True
        """
        tree = self.tree
        if count is None:
            if max_error is None:
                raise ArgumentError("max_error", "a number >= 0, or `count` instead", "neither")
            bound = checked_tolerance("max_error", max_error)
            with tree.cells.session.call():
                return self._mesh_of(*_triangles_of(tree, active_within(tree, bound)))
        most = integer_from("count", count, 1, 2**31 - 1)
        limit = math.inf if max_error is None else checked_tolerance("max_error", max_error)
        with tree.cells.session.call():
            samples, faces = self._start_for(most, limit)
            pixels, depth = tree.vertices_of(samples)
            points = self.view.camera.unproject(pixels, depth)
            left = merged(points, pixels, faces.astype(np.int64), most, limit)
            used, corners = np.unique(left, return_inverse=True)
            return self._mesh_of(samples[used], corners.reshape(-1, 3).astype(np.int32))

    def _start_for(self, count: int, limit: float) -> tuple[Int32, Int32]:
        """Triangles of the tree that merging to `count` starts from: `_START` times as many, or more at depth edges."""
        low, high = self.bounds
        error = _LEAST_ERROR * float(np.max(high - low))
        found = _triangles_of(self.tree, active_within(self.tree, min(error, limit)))
        while len(found[1]) > _START * count and 2 * error <= limit and error < _MOST_ERROR * np.max(high - low):
            error *= 2
            found = _triangles_of(self.tree, active_within(self.tree, error))
        return found

    @overload
    def strips(
        self, camera: Camera, *, tolerance: float | None = None, normals: Literal[False] = False
    ) -> list[NDArray[np.int32]]: ...

    @overload
    def strips(
        self, camera: Camera, *, tolerance: float | None = None, normals: Literal[True]
    ) -> list[NDArray[np.void]]: ...

    def strips(
        self, camera: Camera, *, tolerance: float | None = None, normals: bool = False
    ) -> list[NDArray[np.int32]] | list[NDArray[np.void]]:
        """Triangle strips of the mesh from `triangulate`, with its vertex numbers (figure 6 of the paper).

        Parameters
        ----------
        camera, tolerance
            As for `triangulate`.
        normals : bool
            Whether the strips hold vertex records with normals instead of vertex numbers alone.

        Returns
        -------
        list of (n,) int32 arrays
            Every three consecutive numbers form a triangle, and every second triangle has the opposite winding. A
            repeated number turns the strip and forms a triangle without area. Strips end where a triangle is not drawn.
            With `normals`, arrays of records as in a vertex buffer: "number" int32, "position" and "normal" (3,)
            float32 in the world, the normal of unit length and towards the view, and "color" (3,) in the view's dtype.

        Raises
        ------
        ArgumentError
            As for `triangulate`.

        Examples
        --------
        >>> import numpy as np
        >>> import pyibr as ibr
        >>> camera = ibr.Camera([[30, 0, 16], [0, 30, 16], [0, 0, 1]], (33, 33))
        >>> plane = ibr.DepthImage(np.zeros((33, 33, 3), np.uint8), np.full((33, 33), 2, np.float32), camera)
        >>> (strip,) = ibr.DepthMesh(plane).strips(camera, normals=True)
        >>> strip.dtype.names, strip["normal"][0] + 0.0
        (('number', 'position', 'normal', 'color'), array([ 0.,  0., -1.], dtype=float32))
        """
        checked_bool("normals", normals)
        with self.tree.cells.session.call():
            samples, faces = self._some_triangles_for(camera, tolerance)
            made = self._mesh_of(samples, faces) if normals else None
        strips = strips_of(samples[faces], faces, self.view.camera.size, self.tree.side)
        return strips if made is None else with_normals(strips, made, self.view.shown_color.dtype)

    def _some_triangles_for(self, camera: Camera, tolerance: float | None) -> tuple[Int32, Int32]:
        samples, faces = self._triangles_for(camera, tolerance)
        if not len(faces):
            raise ArgumentError("camera", "a camera for which triangles remain at this tolerance", describe(camera))
        return samples, faces

    def _triangles_for(self, camera: Camera, tolerance: float | None) -> tuple[Int32, Int32]:
        instance_of("camera", camera, Camera, "a pyibr.Camera")
        allowed = self.tolerance if tolerance is None else checked_tolerance("tolerance", tolerance)
        return _triangles_of(self.tree, select_for([self.tree], covering_camera("camera", camera), allowed).active[0])

    def _mesh_of(self, samples: Int32, faces: Int32) -> Mesh:
        camera = self.view.camera
        y, x = np.divmod(samples, camera.width)
        (pixels, depth), normals = self.tree.vertices_of(samples), self.tree.normals.to_host()[:, y, x].T
        return Mesh(
            camera.unproject(pixels, depth),
            faces,
            uv=(pixels + 0.5) / camera.size,
            normals=normals @ camera.world_from_camera[:3, :3].T,
            texture=self.view.shown_color,
            colors=self.view.shown_color[y, x],
            attributes={"quality": np.abs(normals[:, 2])},
        )


def _in_triangles(tree: Tree) -> NDArray[np.bool_]:
    """Mask, (H, W) bool, of the samples that are corners of drawn triangles."""
    width, height = tree.view.camera.size
    upper, lower = tree.drawn_cells()
    y, x = np.ogrid[: height - 1, : width - 1]
    main = y % 2 == x % 2  # kernels/depthmesh/tree.h
    found = np.zeros((height, width), np.bool_)
    found[:-1, :-1] |= upper | (lower & main)
    found[:-1, 1:] |= upper | (lower & ~main)
    found[1:, :-1] |= lower | (upper & ~main)
    found[1:, 1:] |= lower | (upper & main)
    return found


def _triangles_of(tree: Tree, active: DeviceArray) -> tuple[Int32, Int32]:
    """Return the active vertices' triangles: (N,) corners as samples y * width + x, and (T, 3) indices of corners."""
    found = list_triangles([tree], [active])
    corners = found.corners.to_host()
    used = np.zeros(found.point_firsts[-1], np.bool_)  # False where segmentation removed all triangles around a point
    used[corners] = True
    x, y = pixels_of(found.points.to_host()[used], tree.view).T
    samples = (y * tree.view.camera.width + x).astype(np.int32)
    return samples, (np.cumsum(used, dtype=np.int32) - 1)[corners]


def checked_tolerance(argument: str, value: float) -> float:
    """Return a number >= 0, or raise ArgumentError."""
    number = float(numbers(argument, value, ()))
    if number < 0:
        raise ArgumentError(argument, "a number >= 0", describe(value))
    return min(number, float(np.finfo(np.float32).max))
