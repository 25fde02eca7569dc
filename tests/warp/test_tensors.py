"""Batches of tensors: `pyibr.torch` with NumPy's arrays, and with PyTorch where it is installed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from tests.debian_torch import torch as torch_or_skip
from tools.processes import run_python

SIZE = (63, 45)
CAMERA = ibr.Camera([[60, 0, 31], [0, 60, 22], [0, 0, 1]], SIZE)
TARGETS = [CAMERA.moved(0.2, 0, 0), CAMERA.moved(0.1, 0.1, 0.3)]


def depths(count: int) -> np.ndarray:
    """(count, H, W): a disk in front of a wall, elsewhere in each item."""
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    return np.stack([np.where(np.hypot(x - 20 - 5 * i, y - 22) < 9, 2.0, 4.0 + 0.01 * x) for i in range(count)]).astype(
        np.float32
    )


def values(count: int, channels: int = 3, dtype: Any = np.float32) -> np.ndarray:
    return (np.random.default_rng(0).random((count, channels, SIZE[1], SIZE[0]), np.float32) * 2 - 1).astype(dtype)


def splat_arguments(count: int, move: float = 0.2) -> tuple[Any, ...]:
    pose = np.broadcast_to(np.eye(4), (count, 4, 4)).copy()
    moved = pose.copy()
    moved[:, 0, 3] = move
    return values(count), None, depths(count)[:, None], pose, moved, np.broadcast_to(CAMERA.K, (count, 3, 3)), None


def test_a_batch_holds_the_frames_of_single_warps():
    made = ibr.torch.warp(values(3, 5), depths(3), CAMERA, TARGETS)
    assert made.values.shape == (3, 2, 5, 45, 63) and made.mask.shape == made.depth.shape == (3, 2, 1, 45, 63)
    for item in range(3):
        features = np.ascontiguousarray(values(3, 5)[item].transpose(1, 2, 0))
        view = ibr.DepthImage(None, depths(3)[item], CAMERA, features=features)
        for number, camera in enumerate(TARGETS):
            frame = ibr.warp(view, camera)
            np.testing.assert_array_equal(made.values[item, number], frame.features.transpose(2, 0, 1))
            np.testing.assert_array_equal(made.mask[item, number, 0], frame.valid)
            np.testing.assert_array_equal(made.depth[item, number, 0], np.nan_to_num(frame.depth))


def test_results_do_not_depend_on_the_batch():
    whole = ibr.torch.warp(values(7), depths(7), CAMERA, TARGETS)
    for count in (1, 2):
        part = ibr.torch.warp(values(7)[:count], depths(7)[:count], CAMERA, TARGETS)
        for one, other in zip(part, whole, strict=True):
            np.testing.assert_array_equal(one, other[:count])


def test_targets_and_sources_may_differ_between_items():
    one = ibr.torch.warp(values(2), depths(2), CAMERA, TARGETS[0])
    assert one.values.shape == (2, 3, 45, 63)
    each = ibr.torch.warp(values(2), depths(2)[:, None], [CAMERA, CAMERA], [TARGETS[:1], TARGETS[1:]])
    np.testing.assert_array_equal(each.values[0, 0], one.values[0])
    other = ibr.torch.warp(values(2), depths(2), [CAMERA, CAMERA.moved(0.1, 0, 0)], TARGETS[1])
    assert (other.values[1] != each.values[1, 0]).any() and (other.values[0] != each.values[0, 0]).any()


@pytest.mark.parametrize("dtype", [np.bool_, np.uint8, np.float16, np.float32, np.float64, ">f4"])
def test_types_are_kept(dtype):
    made = ibr.torch.warp(values(1, dtype=dtype), depths(1), CAMERA, TARGETS[0], interpolation="nearest")
    assert made.values.dtype == dtype and set(np.unique(made.values)) <= {0, *np.unique(values(1, dtype=dtype))}


def test_the_splatting_functions_arguments_and_results():
    frame, mask, depth, flow = ibr.torch.forward_warp(*splat_arguments(2), render_depth=True)
    assert frame.shape == (2, 3, 45, 63) and mask.shape == (2, 1, 45, 63) and mask.dtype == np.float32
    assert depth.shape == (2, 45, 63) and flow.shape == (2, 2, 45, 63)
    expected = ibr.torch.warp(values(2), depths(2), CAMERA, CAMERA.moved(-0.2, 0, 0))  # 0.2 is the scene's motion
    holes = ~np.broadcast_to(expected.mask, frame.shape)
    assert holes.any() and (frame[holes] == -1).all()
    np.testing.assert_array_equal(frame[~holes], expected.values[~holes])
    np.testing.assert_array_equal(mask == 1, expected.mask)
    np.testing.assert_allclose(flow[:, 0], 60 * 0.2 / depths(2), atol=1e-4)
    np.testing.assert_allclose(flow[:, 1], 0, atol=1e-4)
    without = ibr.torch.forward_warp(*splat_arguments(2), is_image=False)
    assert (without[0][holes] == 0).all() and without[2] is None


def test_the_splatting_functions_masks_unknown_depths_and_distances():
    frame1, _, depth1, *cameras = splat_arguments(1, 0.0)
    mask1 = np.ones_like(depth1)
    mask1[..., 10:20, 40:50] = 0
    depth1[..., 30:35, 40:50] = np.nan
    _, mask, depth, _ = ibr.torch.forward_warp(frame1, mask1, depth1, *cameras, render_depth=True)
    np.testing.assert_array_equal(mask, mask1)
    np.testing.assert_allclose(depth[0, 30:35, 40:50], 1e4, rtol=1e-6)
    x, y = (np.indices(SIZE[::-1])[::-1] - np.array([31, 22])[:, None, None]) / 60
    distance = splat_arguments(1)[2] * np.sqrt(x**2 + y**2 + 1)
    _, _, planar, _ = ibr.torch.forward_warp(frame1, None, distance, *cameras, is_depth=False, render_depth=True)
    np.testing.assert_allclose(planar, splat_arguments(1)[2][:, 0], rtol=1e-5)
    bright = ibr.torch.forward_warp(3 * frame1, None, splat_arguments(1)[2], *cameras)[0]
    assert bright.min() == -1 and bright.max() == 1


@pytest.mark.parametrize(
    ("name", "change"),
    {
        "tensor": {"tensor": [[1.0]]},
        "depth": {"depth": depths(1)[:, :-1]},
        "source": {"source": [CAMERA, CAMERA]},
        "cameras": {"cameras": [TARGETS, TARGETS]},
        "fill": {"fill": "background"},
        "method": {"method": "forward"},
        "origins": {"origins": True},
        "edges": {"edges": "torn"},
        "tensor: expected uint8": {"tensor": values(1, dtype=np.int32)},
        "depth: expected a tensor of shape": {"depth": np.ones((1, 2, *SIZE[::-1]), np.float32)},
        "cameras: expected a pyibr.Camera": {"cameras": 3},
    }.items(),
)
def test_wrong_arguments_are_named(name, change):
    given = {"tensor": values(1), "depth": depths(1), "source": CAMERA, "cameras": TARGETS, **change}
    with pytest.raises(ibr.ArgumentError, match=name):
        ibr.torch.warp(**given)


def test_wrong_matrices_are_named():
    arguments = splat_arguments(1)
    for number, name in ((0, "frame1"), (2, "depth1"), (3, "transformation1"), (5, "intrinsic1")):
        with pytest.raises(ibr.ArgumentError, match=name):
            ibr.torch.forward_warp(*arguments[:number], arguments[number][..., :-1, 0], *arguments[number + 1 :])
        if number > 2:
            with pytest.raises(ibr.ArgumentError, match=f"{name}: expected"):
                ibr.torch.forward_warp(*arguments[:number], 0 * arguments[number], *arguments[number + 1 :])
    with pytest.raises(ibr.ArgumentError, match="frame1: expected floats"):
        ibr.torch.forward_warp(values(1, dtype=np.uint8), *arguments[1:])


def test_an_empty_view_is_a_mask_of_zeros():
    made = ibr.torch.warp(values(1), depths(1), CAMERA, CAMERA.moved(50, 0, 0))
    assert not made.mask.any() and not made.values.any() and not made.depth.any()


def test_an_item_without_depth_is_empty_and_leaves_the_others():
    some = depths(2)
    some[0] = np.nan
    made, alone = (ibr.torch.warp(values(2)[k:], some[k:], CAMERA, TARGETS) for k in (0, 1))
    assert not made.mask[0].any() and not made.values[0].any() and not made.depth[0].any()
    np.testing.assert_array_equal(made.values[1:], alone.values)


def test_arrays_import_no_torch():
    script = "import sys, numpy as np, pyibr as ibr\n"
    script += "c = ibr.Camera([[9, 0, 4], [0, 9, 4], [0, 0, 1]], (9, 9))\n"
    script += "ibr.torch.warp(np.ones((1, 1, 9, 9), np.float32), np.ones((1, 9, 9), np.float32), c, c)\n"
    assert run_python("-c", script + "print('torch' in sys.modules)").stdout.strip() == "False"


def test_tensors_come_back_as_tensors():
    torch = torch_or_skip()
    for layout in (torch.contiguous_format, torch.channels_last):
        tensor = torch.from_dlpack(values(2)).contiguous(memory_format=layout)
        made = ibr.torch.warp(tensor, torch.from_dlpack(depths(2)), CAMERA, TARGETS)
        expected = ibr.torch.warp(values(2), depths(2), CAMERA, TARGETS)
        assert made.values.dtype == torch.float32 and made.mask.dtype == torch.bool
        for one, other in zip(made, expected, strict=True):
            np.testing.assert_array_equal(np.from_dlpack(one.float()), other.astype(np.float32))
    assert type(ibr.torch.warp(torch.nn.Parameter(tensor), depths(2), CAMERA, TARGETS).values) is torch.Tensor
    for dtype in (torch.bfloat16, torch.float16, torch.float64, torch.uint8, torch.bool):
        assert ibr.torch.warp(tensor.to(dtype), depths(2), CAMERA, TARGETS).values.dtype == dtype
    arrays = splat_arguments(2)
    given = [None if one is None else torch.from_dlpack(np.array(one, np.float32)) for one in arrays]
    for one, other in zip(ibr.torch.forward_warp(*given), ibr.torch.forward_warp(*arrays), strict=True):
        assert (one is None) == (other is None)
        if one is not None:
            np.testing.assert_allclose(np.from_dlpack(one), other, rtol=1e-3, atol=1e-3)


def test_the_gradient_is_the_transposed_map():
    torch = torch_or_skip()
    x, y = np.meshgrid(np.arange(12), np.arange(9))
    depth = np.where(np.hypot(x - 5, y - 4) < 3, 2.0, 4.0).astype(np.float32)[None]
    camera = ibr.Camera([[12, 0, 5.5], [0, 12, 4], [0, 0, 1]], (12, 9))
    tensor = torch.rand(1, 2, 9, 12, dtype=torch.float64, requires_grad=True)
    for move in ((0.3, 0, 0), (0.1, 0.05, 0.4), (0, 0, -0.5)):
        target = [camera.moved(*move), camera.moved(0, 0.2, 0)]

        def warped(some: Any, target: Any = target) -> Any:
            return ibr.torch.warp(some, depth, camera, target).values

        # A step of 0.5 hides float32's rounding, and is exact as the warp is linear.
        assert torch.autograd.gradcheck(warped, (tensor,), eps=0.5, atol=1e-5, rtol=1e-5)
    lens = ibr.Camera(camera.K, camera.size, lens=ibr.Lens("brown_conrady", [-0.1, 0, 0, 0]))
    for source, target in ((lens, camera), (camera, lens)):
        with pytest.raises(ibr.ArgumentError, match="without lenses"):
            ibr.torch.warp(tensor, depth, source, target)
        with torch.no_grad():
            ibr.torch.warp(tensor, depth, source, target)


def test_a_gradient_is_of_the_depth_at_the_time_of_the_warp():
    torch = torch_or_skip()
    tensor, depth, gradients = torch.from_dlpack(values(1)).requires_grad_(True), depths(1), []
    for is_changed in (False, True):
        warped = ibr.torch.warp(tensor, depth, CAMERA, TARGETS[0]).values
        if is_changed:
            depth[:] = 1.3
        gradients.append(torch.autograd.grad(warped.sum(), tensor)[0])
    assert torch.equal(*gradients)


def test_a_texture_is_fitted_from_warped_views():
    """Gradient descent on four views of an unknown texture reaches it, where a view sees it."""
    torch = torch_or_skip()
    truth = torch.from_dlpack(values(1)) * 0.5
    cameras = [CAMERA.moved(x, y, 0) for x, y in ((0.1, 0), (-0.1, 0), (0, 0.1), (0, -0.1))]
    goal = ibr.torch.warp(truth, depths(1), CAMERA, cameras).values
    texture = torch.zeros_like(truth, requires_grad=True)
    optimizer = torch.optim.Adam([texture], lr=0.1)
    losses = []
    for _ in range(60):
        optimizer.zero_grad()
        loss = ((ibr.torch.warp(texture, depths(1), CAMERA, cameras).values - goal) ** 2).mean()
        loss.backward()
        optimizer.step()
        losses.append(float(loss))
    assert losses[-1] < 1e-3 * losses[0]
