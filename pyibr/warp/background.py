"""A guess of the background that a view hides, made once for all cameras of a path."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64, instance_of, one_of
from pyibr.core.pixelspace import PixelMap, camera_pair
from pyibr.images.depth_image import DepthImage
from pyibr.opencl.device import current, one_call
from pyibr.opencl.headers import constant, struct
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import empty, to_host
from pyibr.opencl.program import kernel
from pyibr.picture.samples import samples_of
from pyibr.picture.target import Target
from pyibr.warp.filling import Fill, fill_holes
from pyibr.warp.view import WarpedView
from pyibr.warp.warp import checked_cameras

_PLACES_MAX = 6  # extreme places of a path
_BETWEEN = 0.1  # times the longest shift: places closer to the lines between chosen ones uncover nothing more
_LARGEST = 2.0  # sides of the layer, relative to the view's sides


def background_layer(view: DepthImage, cameras: Camera | Sequence[Camera], *, fill: Fill = "background") -> DepthImage:
    """Guess, once for all cameras of a path, what a view hides from them.

    `warp` with `fill` guesses anew for each camera, so that the guesses of a film flicker. The layer is drawn together
    with the view: `warp([view, layer], camera)`. It is the second layer of a layered depth image (Shade et al. 1998):
    where the cameras' motion uncovers background, the foreground's samples are removed, and the holes are filled.

    Parameters
    ----------
    view : DepthImage
    cameras : Camera or sequence of Camera
        Cameras of the path. The layer covers the surfaces that they and cameras between them see behind the view's
        foreground and, up to half the view's size away, beyond its border.
    fill : {"background", "smooth", "inpaint", "exemplar"}
        How holes are filled, as in `warp`.

    Returns
    -------
    DepthImage
        The layer, with the view's pose and resolution, without a lens and with a border around it; `guessed` is True.
        Samples that the cameras do not need have no depth.

    Raises
    ------
    ArgumentError
        An argument has a wrong type or value, or the view has no samples.
    MissingPackageError
        OpenCV is not installed (`fill="inpaint"`).

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> camera = ibr.Camera([[100, 0, 31.5], [0, 100, 23.5], [0, 0, 1]], (64, 48))
    >>> depth = np.full((48, 64), 4.0, np.float32)
    >>> depth[16:32, 24:40] = 2  # a card in front of a wall
    >>> view = ibr.DepthImage(np.full((48, 64, 3), 200, np.uint8), depth, camera)
    >>> path = [camera.moved(0.05 * k, 0, 0) for k in range(5)]
    >>> layer = ibr.background_layer(view, path)
    >>> frames = ibr.warp([view, layer], path)
    >>> bool(np.isfinite(frames[4].depth).all()), bool(frames[4].valid.all())  # no hole is left, but guesses are marked
    (True, False)
    """
    instance_of("view", view, DepthImage, "a pyibr.DepthImage")
    path = checked_cameras("cameras", cameras)
    one_of("fill", fill, Fill)
    thing = WarpedView(view, fill=fill)
    source = thing.sources[0]
    with one_call():
        samples = samples_of(source)
        ends = (samples.low, samples.high)
        canvas = _canvas(source.camera, path, ends)
        places = _extreme_places(canvas, path, ends)
        target = Target(canvas, view.color.dtype, channels=view.color.shape[2])
        thing.draw(target, None)
        _hide_foreground(target, places, ends)
        pixel_map = PixelMap(camera_pair(source.camera, canvas), samples)
        fill_holes(target, [(source, samples, pixel_map)], fill, epipole=places[0][:3] if places else None)
        layer = empty(target.depth.shape, np.float32)
        grid = -(-canvas.width // int(constant("warp/background.cl", "ROW_PART"))), canvas.height
        _launch("cut_out", grid, target, valid=target.valid, depth=target.depth, layer=layer)
        color, depth = to_host([target.color, layer])
    color[np.isnan(depth)] = 0
    return DepthImage(color if view.has_color else None, depth, canvas, noise=view.noise, guessed=True)


def _canvas(camera: Camera, path: Sequence[Camera], ends: tuple[float, float]) -> Camera:
    """The view's camera, widened within limits to hold what the path's cameras see."""
    size = np.array(camera.size)
    pixels = [np.zeros((1, 2)), size[None] - 1.0]
    for one in path:
        matrix = camera_pair(camera, one).dst_from_src
        corners = np.array([(x, y, 1) for x in (0, one.width - 1) for y in (0, one.height - 1)])
        for nearness in ends:  # at this nearness in the view, a homography maps pixels to pixels
            plane = matrix[:3, :3].copy()
            plane[:, 2] += nearness * matrix[:3, 3]
            found = np.linalg.lstsq(plane, corners.T, rcond=None)[0]
            pixels.append((found[:2] / found[2])[:, found[2] > 0].T)
    every = np.concatenate(pixels)
    room = (_LARGEST - 1) / 2 * size
    before = np.ceil(np.clip(-every.min(axis=0), 1, room)).astype(int)
    after = np.ceil(np.clip(every.max(axis=0) - size + 1, 1, room)).astype(int)
    K = camera.K.copy()
    K[:2, 2] += before
    width, height = size + before + after
    return Camera(K, (int(width), int(height)), camera.world_from_camera, projection=camera.projection)


def _extreme_places(canvas: Camera, path: Sequence[Camera], ends: tuple[float, float]) -> list[Float64]:
    """Centres of the path's extreme cameras, (U, V, W, Q) in the canvas's pixel space, the farthest one first.

    Cameras are compared by how far they shift the nearest surface against the farthest one, at the canvas's corners.
    """
    centers = [camera_pair(canvas, one).src_from_dst[:, 3] for one in path]
    shifts = np.array([np.zeros(8), *(_shifts(canvas, one, ends).ravel() for one in centers)])
    chosen = [0]
    while len(chosen) <= _PLACES_MAX:
        beside = np.min([_distances(shifts, shifts[a], shifts[b]) for a in chosen for b in chosen], axis=0)
        farthest = int(beside.argmax())
        if beside[farthest] < max(0.5, _BETWEEN * float(np.linalg.norm(shifts, axis=1).max())):
            break
        chosen.append(farthest)
    return [centers[number - 1] for number in chosen[1:]]


def _shifts(canvas: Camera, center: Float64, ends: tuple[float, float]) -> Float64:
    """(4, 2) pixels between the nearest and the farthest point of a ray from a camera's centre, at most the canvas."""
    corners = np.array([(x, y) for x in (0, canvas.width) for y in (0, canvas.height)])
    before = center[3] - ends[0] * center[2], center[3] - ends[1] * center[2]
    per_nearness = 1 / max(*before, 1e-30) if min(before) <= 0 else 1 / min(before)
    shift = (center[:2] - corners * center[2]) * ((ends[1] - ends[0]) * per_nearness)
    return np.clip(shift, -max(canvas.size), max(canvas.size))


def _distances(points: Float64, a: Float64, b: Float64) -> Float64:
    """Distances of points from the segment between a and b."""
    along = b - a
    part = np.clip((points - a) @ along / max(float(along @ along), 1e-30), 0, 1)
    return np.linalg.norm(points - a - part[:, None] * along, axis=1)


def _hide_foreground(target: Target, places: Sequence[Float64], ends: tuple[float, float]) -> None:
    """Make holes where cameras at these places see background behind the picture's surface."""
    profile, canvas = current().profile, target.camera
    grid = profile.packets(*canvas.size, profile.strip)
    envelope, spare = (empty(target.depth.shape, np.float32) for _ in range(2))
    perspective = int(canvas.projection == "perspective")
    shared = {"strip": profile.strip, "depth": target.depth, "valid": target.valid, "perspective": perspective}
    _launch("begin_envelope", grid, target, envelope=envelope, **shared)
    for center in places:
        away = np.zeros((), struct("warp/background.cl", "Away"))
        away["x"], away["y"], away["w"], away["n"] = center / np.abs(center).max()
        reach = float(np.linalg.norm(_shifts(canvas, center, ends), axis=1).max())
        for power in reversed(range(max(int(np.log2(max(reach, 1))), 0) + 1)):
            step = {"away": Struct("Away", away), "stride": float(2**power), "strip": profile.strip}
            _launch("lower_envelope", grid, target, **{"from": envelope}, to=spare, **step)
            envelope, spare = spare, envelope
    _launch("hide_foreground", grid, target, envelope=envelope, **shared)


def _launch(name: str, grid: tuple[int, ...], target: Target, **arguments: Any) -> None:
    width, height = target.camera.size
    launch(kernel("warp/background.cl", name), grid, width=width, height=height, **arguments)
