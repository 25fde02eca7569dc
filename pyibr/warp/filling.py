"""Filling of holes, by kernels that run one after the other, or by OpenCV."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64
from pyibr.core.optional import opencv
from pyibr.core.pixelspace import PixelMap, longer_side
from pyibr.images.depth_image import DepthImage
from pyibr.opencl.device import current
from pyibr.opencl.headers import constant, struct
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, copy, empty, to_host, upload
from pyibr.opencl.program import kernel
from pyibr.picture.samples import Samples
from pyibr.picture.target import Target
from pyibr.warp.exemplar import continue_texture
from pyibr.warp.launches import map_of

Fill = Literal["background", "smooth", "inpaint", "exemplar"]

_DEVIATIONS = 3 * 2**0.5
"""Noise alone seldom makes two samples differ by more than this multiple of one sample's standard deviation."""
_ONE_SURFACE = 0.015
"""Largest difference in depth within a surface: a fraction of the depth, or of an orthographic image's longer side."""
_RUN = 64  # pixels of a row in which `behind_runs` finds the holes at once, as bits of a word
_RADIUS = 3  # pixels: OpenCV inpaints a pixel from its surroundings within this radius
_STEPS = 65535.0  # floats are scaled to the range from 0 to this: in any range, OpenCV adds about 1 to each pixel


def fill_holes(
    target: Target,
    views: Sequence[tuple[DepthImage, Samples, PixelMap]],
    how: Fill,
    epipole: Float64 | None = None,
) -> None:
    """Fill holes from the views and the current picture.

    The view with the least parallax counts most; among views with equal parallax, the first. epipole: (3,) homogeneous,
    from which the lines lead that cross disocclusions; by default, the epipole of the view that counts most.
    """
    target.filled = True
    nearest_first = sorted(views, key=lambda view: view[2].parallax)
    nearest, _, nearest_map = nearest_first[0]

    def behind(picture: Target) -> DeviceArray | None:
        away = nearest_map.epipole if epipole is None else epipole
        return find_behind(picture, away, nearest.noise) if how in ("background", "exemplar") else None

    seen_empty = [(samples, pixel_map) for view, samples, pixel_map in views if view.sees_empty_space]
    empty_space = _spread_empty_space(target, seen_empty, behind) if seen_empty else None
    if how == "inpaint":
        inpaint(target)
    else:
        told = behind(target)
        push_and_pull(target, told)
        if how == "exemplar" and target.color.shape[2]:
            continue_texture(target, lambda marked: push_and_pull(marked, told))
    if how in ("background", "exemplar") and target.color.shape[2]:
        for _, samples, pixel_map in reversed(nearest_first):
            _show_unobserved(target, samples, pixel_map)
    if empty_space is not None:
        width, height = target.camera.size
        arrays = {"empty_color": empty_space, **target.outputs()}
        _launch("empty.cl", "clear_empty", target, width=width, height=height, **arrays)


def find_behind(target: Target, epipole: Float64, noise: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> DeviceArray:
    """Find the depth behind holes, and its falloff, along lines through the epipole.

    epipole: (3,) homogeneous; if all 0, the lines are rows. noise: the view's, in the form of `DepthImage.noise`.

    Returns
    -------
    DeviceArray (2, rows, pitch) float32
        `behind` of kernels/warp/behind.cl.
    """
    width, height = target.camera.size
    tile, halo = _of_holes("TILE"), _of_holes("HALO")
    behind = empty((2, -(-height // tile) * tile + 2 * halo, -(-width // tile) * tile + 2 * halo), np.float32)
    image: dict[str, Any] = {"valid": target.valid, "width": width, "height": height}
    ends = {"perspective": int(target.camera.projection == "perspective"), "same": _same_surface(target.camera, noise)}
    shared = {**image, "depth": target.depth, "behind": behind, "pitch": behind.shape[2], **ends}
    profile = current().profile
    x, y, w = (epipole / max(float(np.abs(epipole).max()), 1e-30)).astype(np.float32).tolist()
    # If the epipole is at infinity, lines are parallel. If they lead exactly from pixel to pixel, pixels share lines.
    if w == 0 and {x, y} <= {-1.0, 0.0, 1.0}:
        dx, dy = (x, y) if (y, x) > (0, 0) else (-x, -y) if x or y else (1, 0)
        grid = -(-width // (profile.strip * _RUN)), height
        launch(kernel("warp/behind.cl", "behind_runs"), grid, strip=profile.strip, dx=dx, dy=dy, **shared)
        return behind
    block = int(constant("warp/behind.cl", "SKIP_BLOCK"))
    blocks = empty((-(-height // block), -(-width // block)), np.uint8)
    launch(kernel("warp/behind.cl", "behind_blocks"), blocks.shape[::-1], blocks=blocks, **image)
    away = {"epipole_x": x, "epipole_y": y, "epipole_w": w}
    grid = -(-width // profile.run), height
    launch(kernel("warp/behind.cl", "behind_lines"), grid, blocks=blocks, run=profile.run, **away, **shared)
    return behind


def _same_surface(camera: Camera, noise: tuple[float, float, float]) -> Struct:
    """The kernels' struct Same: the largest difference of depth between pixels of one surface in a picture."""
    values = np.zeros((), struct("warp/behind.cl", "Same"))
    values["same_2"], values["same_1"], values["same_0"] = (_DEVIATIONS * each for each in noise)
    if camera.projection == "perspective":
        values["same_1"] += _ONE_SURFACE
    else:
        values["same_0"] += _ONE_SURFACE * longer_side(camera)
    return Struct("Same", values)


def push_and_pull(target: Target, behind: DeviceArray | None) -> None:
    """Fill holes by push and pull through a pyramid of cells; with `behind` None all pixels weigh the same."""
    tile, planes, inner = (
        _of_holes("TILE"),
        *(int(constant("warp/fill.cl", name)) for name in ("PLANES", "INNER_CELLS")),
    )
    pyramid: list[dict[str, Any]] = []  # the arrays of each level of tiles, fine to coarse
    width, height = target.camera.size
    while width > 1 or height > 1 or not pyramid:
        down, across = -(-height // tile), -(-width // tile)
        cells, within = empty((planes, down, across), np.float32), empty((down * across + 1, planes, inner), np.float32)
        pyramid.append({"width": width, "height": height, "inner": within, "cells": cells})
        width, height = across, down

    profile = current().profile
    strip = max(profile.run // tile, 1)
    _, down, across = pyramid[0]["cells"].shape
    strips = -(-across // strip), down
    defines = {**target.color_defines, "HAS_BEHIND": int(behind is not None)}
    perspective = int(target.camera.projection == "perspective")
    told = empty((1, 1, 1), np.float32) if behind is None else behind
    image = {"behind": told, "pitch": told.shape[2], "perspective": perspective, "strip": strip, **target.outputs()}
    names = ("push_pixels", "push_cells", "pull_cells", "pull_pixels")
    push, push_cells, pull_cells, pull = (kernel("warp/fill.cl", name, **defines) for name in names)
    for number, tiles in enumerate(pyramid):
        _, down, across = tiles["cells"].shape
        first_level = across * tile // 2, down * tile // 2
        of_depths = {"perspective": perspective, "level": number * (tile.bit_length() - 1)}
        if number == 0:
            launch(push, profile.grid(strips, first_level), **image, **tiles)
        else:
            grid = profile.grid((across, down), first_level)
            launch(push_cells, grid, base=pyramid[number - 1]["cells"], **of_depths, **tiles)
        if profile.lanes == 1:
            launch(kernel("warp/fill.cl", "push_levels", **defines), (across, down), **of_depths, **tiles)
    for lower, upper in reversed(list(itertools.pairwise(pyramid))):
        grid = profile.grid(upper["cells"].shape[:0:-1], lower["cells"].shape[:0:-1])
        launch(pull_cells, grid, base=lower["cells"], **upper)
    launch(pull, profile.grid(strips, target.camera.size), **image, **pyramid[0])


def _show_unobserved(target: Target, samples: Samples, pixel_map: PixelMap) -> None:
    """Fill holes with the colours of a view's pixels without depth, where the filled depths project to such pixels."""
    given = {"nearness": samples.nearness, "src_color": samples.color, "map": map_of(pixel_map.pair)}
    _launch("unobserved.cl", "show_unobserved", target, **given, **target.outputs())


def _spread_empty_space(
    target: Target, views: Sequence[tuple[Samples, PixelMap]], behind: Callable[[Target], DeviceArray | None]
) -> DeviceArray:
    """Find the empty space in a picture: `empty_color` of kernels/warp/empty.cl, filled in the other holes."""
    empty_space = Target(target.camera, np.dtype(np.uint8))
    empty_space.color.fill(0)
    copy(target.depth, empty_space.depth)
    copy(target.valid, empty_space.valid)
    marked = {f"empty_{name}": array for name, array in empty_space.outputs().items()}
    for samples, pixel_map in views:
        _launch("empty.cl", "mark_empty", target, nearness=samples.nearness, map=map_of(pixel_map.pair), **marked)
    push_and_pull(empty_space, behind(empty_space))
    return empty_space.color


def _launch(file: str, name: str, target: Target, **arguments: Any) -> None:
    """Launch a kernel whose work-items take strips of a picture's rows."""
    profile = current().profile
    grid = profile.packets(*target.camera.size, profile.strip)
    launch(kernel(f"warp/{file}", name, **target.color_defines), grid, strip=profile.strip, **arguments)


def _of_holes(name: str) -> int:
    """Constant of kernels/warp/holes.h."""
    return int(constant("warp/holes.h", name))


def inpaint(target: Target) -> None:
    """Continue colour and depth from around the holes into them (Telea 2004)."""
    cv2 = opencv('fill="inpaint"', "inpaint")
    color, depth, valid = to_host([target.color, target.depth, target.valid])
    known = valid != 0
    if known.all() or not known.any():
        return
    perspective = target.camera.projection == "perspective"
    solid = np.where(known, depth, np.float32(1))
    found = _inpainted(cv2, 1 / solid if perspective else solid, known)  # planes are linear in nearness
    made = [(np.where(known, depth, 1 / found if perspective else found).astype(np.float32), target.depth)]
    if color.dtype == np.uint8 and color.size:
        made.append((_inpainted(cv2, color, known), target.color))
    elif color.size:
        channels = [_inpainted(cv2, np.ascontiguousarray(color[..., i]), known) for i in range(3)]
        made.append((np.dstack(channels), target.color))
    for array, into in made:
        copy(upload(array), into)


def _inpainted(cv2: Any, image: NDArray[Any], known: NDArray[np.bool_]) -> NDArray[Any]:
    """Fill the unknown pixels of an image, (H, W, 3) uint8 or (H, W) float32, within the range of its known ones."""
    low, high = image[known].min(), image[known].max()
    if image.dtype == np.uint8:
        return _filled(cv2, image, known, low, high)
    if low == high:
        return np.full_like(image, low)
    steps = _filled(cv2, (image - low) * (_STEPS / (high - low)), known, 0, _STEPS)
    return np.where(known, image, low + steps * ((high - low) / _STEPS))


def _filled(cv2: Any, image: NDArray[Any], known: NDArray[np.bool_], low: Any, high: Any) -> NDArray[Any]:
    framed = cv2.copyMakeBorder(image, 1, 1, 1, 1, cv2.BORDER_REPLICATE)  # OpenCV reads beyond images of one row
    holes = cv2.copyMakeBorder((~known).astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    return np.clip(cv2.inpaint(framed, holes, _RADIUS, cv2.INPAINT_TELEA)[1:-1, 1:-1], low, high)
