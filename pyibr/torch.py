"""Tensors in and out: warps of batches with any number of channels, for networks that are conditioned on geometry.

Tensors come in by DLPack. Those of PyTorch come back as tensors, with a gradient; for all others, such as JAX's and
NumPy's, the results are NumPy arrays. CPU tensors are read in place if their channels come last in memory
(`torch.channels_last`), otherwise they are copied once. CUDA tensors are copied once each way. The results' channels
come last in memory. Only a call with a PyTorch tensor imports torch.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, TypedDict, cast

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64, describe, numbers, shape_text
from pyibr.core.errors import ArgumentError
from pyibr.images import DepthImage, Frame
from pyibr.images.converters import depth_from_euclidean
from pyibr.images.depth_image import Side, checked_features
from pyibr.picture.undistort import Interpolation
from pyibr.warp.view import Edges, WarpedView
from pyibr.warp.warp import checked_cameras, warp_transposed, warped_frames

if TYPE_CHECKING:
    from typing_extensions import Unpack

Array = NDArray[Any]
Targets = Camera | Sequence[Camera] | Sequence[Sequence[Camera]]

_FARTHEST = 1e4  # `forward_warp` limits depths to this, as the function that it replaces


class TensorOptions(TypedDict, total=False):
    """Options of `warp` and `forward_warp`, as in `pyibr.WarpedView`."""

    interpolation: Interpolation
    edges: Edges
    cut_ratio: float | None
    side: Side
    thin: bool


_OPTIONS = TensorOptions.__annotations__.keys()


class Warped(NamedTuple):
    """A warped batch. If `cameras` was a `Camera`, the second axis, N, is missing.

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
    tensor: Any, depth: Any, source: Camera | Sequence[Camera], cameras: Targets, **options: Unpack[TensorOptions]
) -> Warped:
    """Render a batch of images with depth from new cameras.

    An item's result does not depend on the other items. The gradient of PyTorch reaches `tensor`, in which the warp is
    linear: it is the transposed map, with the same weights, and equal bits in each run. It has no gradient of its own.
    `depth` and the cameras get no gradient. Frames are drawn one after the other: memory for the results and one frame
    suffices.

    Parameters
    ----------
    tensor : (B, C, h, w) tensor
        Values of the samples, such as colours, features or labels: 1 to 1,024 channels of bool, uint8, float16,
        bfloat16, float32 or float64 (computed as float32).
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
    **options: Unpack[TensorOptions],
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
        Planar z, or with ``is_depth=False`` the distance to the camera's centre. NaN and greater depths become 10,000.
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
    pose1, pose2, K1, K2 = (numbers(name, _array_of(name, value), None, finite=False) for name, value, _ in given[1:])
    cameras = [_camera_of(1, *both, (width, height)) for both in zip(K1, pose1, strict=True)]
    targets = [_camera_of(2, *both, (width, height)) for both in zip(K2, pose2, strict=True)]
    depths = _array_of("depth1", depth1)[:, 0].astype(np.float32)
    depths[np.isnan(depths)] = _FARTHEST
    np.clip(depths, 0, _FARTHEST, out=depths)
    if not is_depth:
        depths = np.stack([depth_from_euclidean(one, camera) for one, camera in zip(depths, cameras, strict=True)])
    flow = np.stack([_flow(*one) for one in zip(depths, cameras, targets, strict=True)])
    if mask1 is not None:
        _shape_of("mask1", mask1, (batch, 1, height, width))
        depths[~(_array_of("mask1", mask1)[:, 0] > 0)] = np.nan
    job = _job("frame1", frame1, depths, cameras, [[target] for target in targets], options)
    if is_image and job.values.dtype.kind != "f":
        raise ArgumentError("frame1", "floats from -1 to 1, or is_image=False with it", describe(job.values))
    values, mask, seen = (one[:, 0] for one in _warped(frame1, job._replace(hole=-1.0 if is_image else 0.0)))
    if is_image and max(-job.values.min(), job.values.max()) > 1:
        values = values.clip(-1, 1)
    mask2 = mask.to(frame1.dtype) if _is_torch(frame1) else mask.astype(frame1.dtype)
    return values, mask2, seen[:, 0] if render_depth else None, _like(frame1, flow)


def _camera_of(number: int, K: Float64, camera_from_world: Float64, size: tuple[int, int]) -> Camera:
    """Return the camera of an item, or raise ArgumentError with the names of `forward_warp`."""
    try:
        return Camera(K, size, np.linalg.inv(camera_from_world))
    except np.linalg.LinAlgError:
        raise ArgumentError(f"transformation{number}", "rigid motions", "a matrix without an inverse") from None
    except ArgumentError as error:
        name = "intrinsic" if error.argument == "K" else "transformation"
        raise ArgumentError(f"{name}{number}", error.expected, error.got) from None


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
    """A batch and its geometry."""

    values: Array  # (B, C, h, w)
    views: Sequence[DepthImage]  # without colours
    targets: Sequence[Sequence[Camera]]  # for each view
    options: TensorOptions
    hole: float = 0.0  # value of pixels that show nothing

    def warped(self) -> tuple[Array, Array, Array]:
        """Return values, mask and depth; the channels come last in memory."""
        features = np.moveaxis(self.values, 1, -1)
        shape = len(self.views), len(self.targets[0]), self.targets[0][0].height, self.targets[0][0].width
        made = np.empty((*shape, self.values.shape[1]), self.values.dtype)
        mask, depth = np.empty(shape, np.bool_), np.empty(shape, np.float32)
        none = np.empty((*shape[2:], 0), np.uint8)
        for item, view in enumerate(self.views):
            full = DepthImage(None, view.depth, view.camera, features=features[item]) if view.valid.any() else None
            for number, camera in enumerate(self.targets[item]):
                at = item, number
                if full is None:
                    mask[at] = False
                else:
                    out = Frame(none, depth[at], mask[at], camera, features=made[at])
                    warped_frames(full, camera, out=out, **self.options)
                holes = ~mask[at]
                made[at][holes], depth[at][holes] = self.hole, 0
        return np.moveaxis(made, -1, 2), mask[:, :, None], depth[:, :, None]

    def transposed(self, gradient: Array) -> Array:
        """Map a gradient for the results of `warped` to one for the values."""
        sums = np.zeros((len(self.views), *self.views[0].depth.shape, gradient.shape[2]), np.float32)
        for item, view in enumerate(self.views):
            new = DepthImage(None, view.depth, view.camera)  # whose surface leaves the device after its use
            for number, camera in enumerate(self.targets[item] if view.valid.any() else ()):
                own = np.ascontiguousarray(np.moveaxis(gradient[item, number], 0, -1), np.float32)
                sums[item] += warp_transposed(new, camera, own, **self.options)
        return np.moveaxis(sums, -1, 1)


def _job(
    argument: str, tensor: Any, depth: Any, source: Camera | Sequence[Camera], cameras: Targets, options: TensorOptions
) -> _Job:
    """Check the arguments of `warp`."""
    if unknown := sorted(options.keys() - _OPTIONS):
        raise ArgumentError(unknown[0], f"one of the options {', '.join(_OPTIONS)}", "another")
    batch, _, height, width = _shape_of(argument, tensor, (None, None, None, None))
    sources = [source] * batch if isinstance(source, Camera) else checked_cameras("source", source)
    if len(sources) != batch or any(camera.size != (width, height) for camera in sources):
        raise ArgumentError("source", f"one camera, or {batch}, of the size {(width, height)}", describe(source))
    plane = (batch, 1, height, width) if len(_shape_of("depth", depth, None)) == 4 else (batch, height, width)
    _shape_of("depth", depth, plane)
    depths = _array_of("depth", depth).reshape(batch, height, width)
    if getattr(tensor, "requires_grad", False):
        depths = depths.copy()  # the caller may change it before the gradient is asked for
    views = [DepthImage(None, one, at) for one, at in zip(depths, sources, strict=True)]
    WarpedView(views[0], **options)  # checks them
    values, targets = _array_of(argument, tensor), _targets_of(cameras, batch)
    for one in values:
        checked_features(argument, np.moveaxis(one, 0, -1), (height, width))
    return _Job(values, views, targets, options)


def _warped(tensor: Any, job: _Job) -> Warped:
    """Warp a batch, with a gradient if it is PyTorch's."""
    if not _is_torch(tensor):
        values, *told = job.warped()
        return Warped(values.astype(tensor.dtype, copy=False), *told)
    lenses = [camera.lens for group in ([view.camera for view in job.views], *job.targets) for camera in group]
    if tensor.requires_grad and import_module("torch").is_grad_enabled() and any(lenses):
        raise ArgumentError("source, cameras", "cameras without lenses, for a gradient", "one with a lens")
    return Warped(*_function().apply(tensor, job))


@functools.cache
def _function() -> Any:
    """Make the function of PyTorch that has the warp's gradient."""
    torch = import_module("torch")

    class Warp(torch.autograd.Function):
        @staticmethod
        def forward(ctx: Any, tensor: Any, job: _Job) -> tuple[Any, ...]:
            values, mask, depth = job.warped()
            told = torch.from_dlpack(mask.view(np.uint8)).bool().to(tensor.device), _like(tensor, depth)
            ctx.job, ctx.like = job._replace(values=np.empty(0)), tensor.new_empty(0)
            ctx.mark_non_differentiable(*told)
            return (_like(tensor, values).to(tensor.dtype), *told)

        @staticmethod
        @torch.autograd.function.once_differentiable
        def backward(ctx: Any, gradient: Any, *_: Any) -> tuple[Any, None]:
            made = ctx.job.transposed(_array_of("gradient", gradient))
            return _like(ctx.like, made).to(ctx.like.dtype), None

    return Warp


def _is_torch(value: Any) -> bool:
    return any(kind.__module__.partition(".")[0] == "torch" for kind in type(value).__mro__)


def _array_of(argument: str, tensor: Any) -> Array:
    """Return a tensor as an array of a type that the warp takes, in place if it is in this machine's memory."""
    try:
        if _is_torch(tensor):
            plain = tensor.detach().cpu()
            tensor = {"torch.bfloat16": plain.float, "torch.bool": plain.byte}.get(str(plain.dtype), lambda: plain)()
        array: Array = np.asarray(cast("Array", tensor)) if isinstance(tensor, np.ndarray) else np.from_dlpack(tensor)
    except (BufferError, NotImplementedError, RuntimeError, TypeError, ValueError) as error:
        raise ArgumentError(argument, "a dense tensor in memory, with `__dlpack__`", str(error)) from error
    if array.dtype == np.bool_:
        return array.view(np.uint8)
    single = array.dtype == np.float64 or not array.dtype.isnative
    return array.astype(np.float32 if single and array.dtype.kind == "f" else array.dtype.newbyteorder("="), copy=False)


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
    groups: list[Any] = [cameras] * batch
    if isinstance(cameras, Sequence) and all(isinstance(group, Sequence) for group in cameras):
        groups = list(cameras)
    targets = [checked_cameras("cameras", group) for group in groups]
    if len(targets) != batch or any(len(group) != len(targets[0]) for group in targets):
        counts = [len(group) for group in targets]
        raise ArgumentError("cameras", f"{batch} sequences of as many cameras", f"sequences of {counts}")
    sizes = list(dict.fromkeys(camera.size for group in targets for camera in group))
    if len(sizes) > 1:
        raise ArgumentError("cameras", "cameras of one size", f"{sizes[0]} and {sizes[1]}")
    return targets
