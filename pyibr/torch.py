"""Tensors in and out: warps of batches with any number of channels, for networks that are conditioned on geometry.

Tensors come in by DLPack. Those of PyTorch come back as tensors, with a gradient; for all others, such as JAX's and
NumPy's, the results are NumPy arrays. CPU tensors are read in place if their channels come last in memory
(`torch.channels_last`), otherwise they are copied once. CUDA tensors are copied once each way. The results' channels
come last in memory. Only a call with a PyTorch tensor imports torch.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import describe, shape_text
from pyibr.core.errors import ArgumentError
from pyibr.images import DepthImage, Frame
from pyibr.images.converters import depth_from_euclidean
from pyibr.warp.warp import checked_cameras, warp_transposed
from pyibr.warp.warp import warp as warp_views

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from pyibr.warp.view import WarpOptions

Array = NDArray[Any]
Targets = Camera | Sequence[Camera] | Sequence[Sequence[Camera]]

_FARTHEST = 1e4  # `forward_warp` limits depths to this, as the function that it replaces


class Warped(NamedTuple):
    """A warped batch; the second axis, of the targets, is missing if there is one target.

    Attributes
    ----------
    values : (B, N, C, H, W)
        The tensor's values on the surface at each pixel, in its dtype; 0 where `mask` is False.
    mask : (B, N, 1, H, W) bool
        Whether the pixel shows a surface.
    depth : (B, N, 1, H, W) float32
        Planar z in the target camera's frame, in scene units; 0 where `mask` is False.
    """

    values: Any
    mask: Any
    depth: Any


def warp(
    tensor: Any, depth: Any, source: Camera | Sequence[Camera], cameras: Targets, **options: Unpack[WarpOptions]
) -> Warped:
    """Render a batch of images with depth from new cameras.

    An item's result does not depend on the other items. The gradient of PyTorch reaches `tensor`, in which the warp is
    linear: it is the transposed map, with the same weights, and equal bits in each run. `depth` and the cameras get no
    gradient. Frames are drawn one after the other, so that there is memory for the results and one frame.

    Parameters
    ----------
    tensor : (B, C, h, w) tensor
        Values of the samples, such as colours, features or labels: 1 to 1,024 channels of uint8, float16, bfloat16,
        float32 or float64 (computed as float32).
    depth : (B, h, w) or (B, 1, h, w) tensor
        Planar z in scene units, as for `DepthImage`: infinite in empty space, NaN or <= 0 where unknown.
    source : Camera, or sequence of B cameras
        The cameras of the batch, of the size (w, h).
    cameras : Camera, sequence of N cameras, or sequence of B sequences of N cameras
        The targets: one or N for all items, or N for each. All have one size, (W, H).
    **options
        Options of `WarpedView`: `interpolation` ("nearest" for labels), `edges`, `cut_ratio`, `side`, `thin`.

    Returns
    -------
    Warped

    Raises
    ------
    ArgumentError
        An argument has a wrong type, shape or value.
    DeviceError
        No OpenCL device works.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> camera = ibr.Camera([[50, 0, 15.5], [0, 50, 11.5], [0, 0, 1]], (32, 24))
    >>> features, depth = np.ones((2, 8, 24, 32), np.float32), np.full((2, 24, 32), 2, np.float32)
    >>> ibr.torch.warp(features, depth, camera, [camera, camera.moved(0.1, 0, 0)]).values.shape
    (2, 2, 8, 24, 32)
    """
    made = _warped(tensor, _job("tensor", tensor, depth, source, cameras, options))
    return Warped(*(one[:, 0] for one in made)) if isinstance(cameras, Camera) else made


def forward_warp(
    frame1: Any,
    mask1: Any,
    depth1: Any,
    transformation1: Any,
    transformation2: Any,
    intrinsic1: Any,
    intrinsic2: Any = None,
    *,
    is_image: bool = True,
    is_depth: bool = True,
    render_depth: bool = False,
    **options: Unpack[WarpOptions],
) -> tuple[Any, Any, Any, Any]:
    """Warp a batch with the arguments of the splatting function that video models share, but with visibility.

    The function of this name in GEN3C, TrajectoryCrafter and other projects adds up all samples that fall on a pixel,
    with weights that fall with their depth relative to the greatest one of the batch. So the background shows through
    the foreground, and results depend on the batch. Here, a pixel shows the first surface on its ray.

    Parameters
    ----------
    frame1 : (B, C, h, w) tensor
        Colours from -1 to 1, or other values with ``is_image=False``.
    mask1 : (B, 1, h, w) tensor, or None
        0 for samples without a surface.
    depth1 : (B, 1, h, w) tensor
        Planar z, or with ``is_depth=False`` the distance to the camera's centre. NaN means 10,000, the greatest depth.
    transformation1, transformation2 : (B, 4, 4) tensors
        From the world to the camera (OpenCV's axes), of the samples and of the new views.
    intrinsic1 : (B, 3, 3) tensor
        In pixels; pixel centres lie at integers.
    intrinsic2 : (B, 3, 3) tensor, or None
        None for those of the samples.
    is_image : bool
        Whether values are limited to -1 to 1, and holes become -1; otherwise 0.
    is_depth : bool
    render_depth : bool
        Whether the new depth is returned.
    **options
        As for `warp`.

    Returns
    -------
    warped_frame2 : (B, C, h, w) tensor
        As `warp` returns its values, with their gradient.
    mask2 : (B, 1, h, w) tensor
        1 where a surface is seen, 0 in holes, in the dtype of `frame1`.
    warped_depth2 : (B, h, w) tensor, or None
        Planar z, 0 in holes.
    flow12 : (B, 2, h, w) tensor
        Motion of each sample in pixels, without a gradient.

    Raises
    ------
    ArgumentError
        An argument has a wrong shape or value.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> frame, depth = np.zeros((1, 3, 24, 32), np.float32), np.full((1, 1, 24, 32), 2, np.float32)
    >>> at, K = np.eye(4)[None], np.array([[[50, 0, 15.5], [0, 50, 11.5], [0, 0, 1]]])
    >>> moved = at + [[0, 0, 0, 0.1], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]]
    >>> warped, mask, _, flow = ibr.torch.forward_warp(frame, None, depth, at, moved, K)
    >>> warped.shape, float(flow[0, 0, 0, 0])
    ((1, 3, 24, 32), 2.5)
    """
    batch, _, height, width = _shape_of("frame1", frame1, (None, None, None, None))
    given = [
        ("depth1", depth1, (batch, 1, height, width)),
        ("transformation1", transformation1, (batch, 4, 4)),
        ("transformation2", transformation2, (batch, 4, 4)),
        ("intrinsic1", intrinsic1, (batch, 3, 3)),
        ("intrinsic2", intrinsic1 if intrinsic2 is None else intrinsic2, (batch, 3, 3)),
    ]
    for name, value, shape in given:
        _shape_of(name, value, shape)
    pose1, pose2, K1, K2 = (_array_of(name, value) for name, value, _ in given[1:])
    cameras, targets = _cameras_of(K1, pose1, (width, height)), _cameras_of(K2, pose2, (width, height))
    depths = np.nan_to_num(_array_of("depth1", depth1)[:, 0].astype(np.float32), nan=_FARTHEST, posinf=_FARTHEST)
    np.clip(depths, 0, _FARTHEST, out=depths)
    if not is_depth:
        depths = np.stack([depth_from_euclidean(one, camera) for one, camera in zip(depths, cameras, strict=True)])
    flow = np.stack([_flow(*one) for one in zip(depths, cameras, targets, strict=True)])
    if mask1 is not None:
        _shape_of("mask1", mask1, (batch, 1, height, width))
        depths[_array_of("mask1", mask1)[:, 0] <= 0] = np.nan
    job = _job("frame1", frame1, depths, cameras, [[target] for target in targets], options)
    values, mask, seen = (one[:, 0] for one in _warped(frame1, job._replace(hole=-1.0 if is_image else 0.0)))
    values = values.clip(-1, 1) if is_image else values
    mask2 = mask.to(frame1.dtype) if _is_torch(frame1) else mask.astype(frame1.dtype)
    return values, mask2, seen[:, 0] if render_depth else None, _like(frame1, flow)


def _cameras_of(K: Array, camera_from_world: Array, size: tuple[int, int]) -> list[Camera]:
    poses: Array = np.linalg.inv(camera_from_world.astype(np.float64))
    return [Camera(one, size, pose) for one, pose in zip(K, poses, strict=True)]


def _flow(depth: NDArray[np.float32], camera: Camera, target: Camera) -> NDArray[np.float32]:
    """(2, h, w) the motion of each sample in pixels of the target."""
    motion = target.camera_from_world @ camera.world_from_camera
    rays = (target.K @ motion[:3, :3] @ np.linalg.inv(camera.K)).astype(np.float32)
    y, x = np.arange(camera.height, dtype=np.float32)[:, None], np.arange(camera.width, dtype=np.float32)
    u, v, w = (
        (a * x + (b * y + c)) * depth + np.float32(d)
        for (a, b, c), d in zip(rays, target.K @ motion[:3, 3], strict=True)
    )
    w += np.float32(1e-7)  # as in the function that this one replaces
    return np.stack([u / w - x, v / w - y])


class _Job(NamedTuple):
    """A batch's geometry."""

    views: Sequence[DepthImage]  # without colours
    targets: Sequence[Sequence[Camera]]  # for each view
    options: WarpOptions
    hole: float = 0.0  # value of pixels that show nothing

    def warped(self, values: Array) -> tuple[Array, Array, Array]:
        """Warp values (B, C, h, w); the channels of the results come last in memory."""
        features = np.moveaxis(values, 1, -1)
        shape = len(self.views), len(self.targets[0]), self.targets[0][0].height, self.targets[0][0].width
        made = np.empty((*shape, values.shape[1]), values.dtype)
        mask, depth = np.empty(shape, np.bool_), np.empty(shape, np.float32)
        for item, (view, targets) in enumerate(zip(self.views, self.targets, strict=True)):
            if not view.valid.any():
                made[item], mask[item] = 0, False
                continue
            full = DepthImage(None, view.depth, view.camera, features=features[item])
            for number, camera in enumerate(targets):
                at = item, number
                none = np.empty((*shape[2:], 0), np.uint8)
                frame = Frame(none, depth[at], mask[at], camera, features=made[at])
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", UserWarning)  # the mask tells that a frame is empty
                    warp_views(full, camera, out=frame, **self.options)
        depth[~mask] = 0
        if self.hole:
            made[~mask] = self.hole
        return np.moveaxis(made, -1, 2), mask[:, :, None], depth[:, :, None]

    def transposed(self, gradient: Array) -> Array:
        """Map a gradient for the results of `warped` to one for the values."""
        size = self.views[0].depth.shape
        sums = np.zeros((len(self.views), *size, gradient.shape[2]), np.float32)
        for item, (view, targets) in enumerate(zip(self.views, self.targets, strict=True)):
            for number, camera in enumerate(targets if view.valid.any() else ()):
                own = np.ascontiguousarray(np.moveaxis(gradient[item, number], 0, -1), np.float32)
                sums[item] += warp_transposed(view, camera, own, **self.options)
        return np.moveaxis(sums, -1, 1)


def _job(
    argument: str, tensor: Any, depth: Any, source: Camera | Sequence[Camera], cameras: Targets, options: WarpOptions
) -> _Job:
    """Check the arguments of `warp`."""
    for name in ("fill", "blend", "splat"):
        if name in options:
            raise ArgumentError(name, "no such option: tensors are neither filled nor blended", "one")
    batch, _, height, width = _shape_of(argument, tensor, (None, None, None, None))
    sources = [source] * batch if isinstance(source, Camera) else checked_cameras("source", source)
    if len(sources) != batch or any(camera.size != (width, height) for camera in sources):
        raise ArgumentError("source", f"one camera, or {batch}, of the size {(width, height)}", describe(source))
    flat = depth[:, 0] if len(_shape_of("depth", depth, None)) == 4 else depth
    _shape_of("depth", flat, (batch, height, width))
    views = [DepthImage(None, one, at) for one, at in zip(_array_of("depth", flat), sources, strict=True)]
    return _Job(views, _targets_of(cameras, batch), options)


def _warped(tensor: Any, job: _Job) -> Warped:
    """Warp a tensor, with a gradient if it is PyTorch's."""
    if not _is_torch(tensor):
        return Warped(*job.warped(_array_of("tensor", tensor)))
    if tensor.requires_grad and any(camera.lens for camera in (view.camera for view in job.views)):
        raise ArgumentError("source", "cameras without lenses, for a gradient", "one with a lens")
    return Warped(*_function().apply(tensor, job))


@functools.cache
def _function() -> Any:
    """Make the function of PyTorch that has the warp's gradient."""
    torch = import_module("torch")

    class Warp(torch.autograd.Function):
        @staticmethod
        def forward(ctx: Any, tensor: Any, job: _Job) -> tuple[Any, ...]:
            ctx.job, ctx.like = job, tensor[:0]
            values, mask, depth = job.warped(_array_of("tensor", tensor))
            told = torch.from_dlpack(mask.view(np.uint8)).bool().to(tensor.device), _like(tensor, depth)
            ctx.mark_non_differentiable(*told)
            return (_like(tensor, values).to(tensor.dtype), *told)

        @staticmethod
        @torch.autograd.function.once_differentiable
        def backward(ctx: Any, gradient: Any, *_: Any) -> tuple[Any, None]:
            made = ctx.job.transposed(_array_of("gradient", gradient))
            return _like(ctx.like, made).to(ctx.like.dtype), None

    return Warp


def _is_torch(value: Any) -> bool:
    return type(value).__module__.partition(".")[0] == "torch"


def _array_of(argument: str, tensor: Any) -> Array:
    """Return a tensor as an array, in place if it is in this machine's memory and of a type that the warp takes."""
    if _is_torch(tensor):
        torch = import_module("torch")
        plain = tensor.detach().cpu()
        single, byte = plain.dtype in (torch.bfloat16, torch.float64), plain.dtype == torch.bool
        tensor = plain.float() if single else plain.byte() if byte else plain
    try:
        return cast("Array", tensor) if isinstance(tensor, np.ndarray) else np.from_dlpack(tensor)
    except (BufferError, RuntimeError, TypeError, ValueError) as error:
        raise ArgumentError(argument, "a tensor in this machine's memory, with `__dlpack__`", str(error)) from error


def _like(tensor: Any, array: Array) -> Any:
    """Return an array as a tensor of the kind and on the device of another one, without a copy on CPUs."""
    return import_module("torch").from_dlpack(array).to(tensor.device) if _is_torch(tensor) else array


def _shape_of(argument: str, tensor: Any, shape: tuple[int | None, ...] | None) -> tuple[int, ...]:
    """Return a tensor's shape, which has to fit `shape`, or raise ArgumentError."""
    if not hasattr(tensor, "__dlpack__"):
        raise ArgumentError(argument, "a tensor or an array, with `__dlpack__`", describe(tensor))
    found = tuple(map(int, tensor.shape))
    if shape is not None and (
        len(found) != len(shape) or any(n not in (None, m) for n, m in zip(shape, found, strict=True))
    ):
        raise ArgumentError(argument, f"a tensor of shape {shape_text(shape)}", str(found))
    if 0 in found:
        raise ArgumentError(argument, "a tensor with at least one value", f"shape {found}")
    return found


def _targets_of(cameras: Targets, batch: int) -> list[list[Camera]]:
    """Return the targets of each item."""
    one = not isinstance(cameras, Camera) and all(isinstance(camera, Camera) for camera in cameras)
    groups: list[Any] = [cameras] * batch if one or isinstance(cameras, Camera) else list(cameras)
    targets = [checked_cameras("cameras", group) for group in groups]
    first = targets[0][0] if targets else None
    if len(targets) != batch or any(len(group) != len(targets[0]) for group in targets):
        counts = [len(group) for group in targets]
        raise ArgumentError("cameras", f"{batch} sequences of as many cameras", f"sequences of {counts}")
    if first and any(camera.size != first.size for group in targets for camera in group):
        raise ArgumentError("cameras", "cameras of one size", "several sizes")
    return targets
