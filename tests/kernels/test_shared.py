"""Functions of shared headers, called by small kernels and compared with NumPy."""

from __future__ import annotations

import numpy as np
import pyopencl as cl
import pytest
from numpy.typing import NDArray

from pyibr.opencl.device import current
from pyibr.opencl.headers import kernels_folder
from tests.one_lane import skip_where_unused
from tests.reference.heights import bilinear, bilinear_height

COUNT = 48  # numbers in each array: whole packets of 16 lanes

DRIVER = """
kernel void clamped(global const float *map, int width, int height, global const float *x, global const float *y,
                    global float *out)
{
    const int i = get_global_id(0) * LANES;
    const Taps taps = clamped_taps(width, height, load_lanes(x + i), load_lanes(y + i));
    floatl weights[4], sum = 0.0f;
    tap_weights(taps.fx, taps.fy, weights);
    for (int k = 0; k < 4; k++)
        sum += weights[k] * (floatl)(gather(map, taps.at[k]));
    store_lanes(sum, out + i);
}

kernel void tiled(global const float *map, int width, int height, global const float *u, global const float *v,
                  global float *out)
{
    const int i = get_global_id(0) * LANES;
    const Taps taps = map_taps(width, height, load_lanes(u + i), load_lanes(v + i));
#define TAP(k) (floatl)(gather(map, taps.at[k]))
    store_lanes(bilinear(taps, TAP(0), TAP(1), TAP(2), TAP(3)), out + i);
}

kernel void moved_into_tile(global const float *x, int size, global float *out)
{
    const int i = get_global_id(0) * LANES;
    const floatl at = load_lanes(x + i), per_size = 1.0f / size;
    FLOOR(at, whole, number)
    store_lanes(to_floatl(WRAPPED(0, whole, number, (intl)size, per_size)), out + i);
}

kernel void points(Screen screen, global const float *x, global const float *y, global const float *n,
                   global float *out)
{
    const int i = get_global_id(0) * LANES, count = get_global_size(0) * LANES;
    const Vector p = point_at(screen, load_lanes(x + i), load_lanes(y + i), load_lanes(n + i));
    const Vector way = view_direction(screen, p);
    store_lanes(p.x, out + i);
    store_lanes(p.y, out + count + i);
    store_lanes(p.z, out + 2 * count + i);
    store_lanes(way.x, out + 3 * count + i);
    store_lanes(way.y, out + 4 * count + i);
    store_lanes(way.z, out + 5 * count + i);
}
"""


@pytest.fixture(params=[1, 16])
def driver(request: pytest.FixtureRequest):
    """Function that runs a kernel of DRIVER in 16 lanes or 1; the kernel writes its last argument, the result."""
    session, lanes = current(), request.param
    skip_where_unused(lanes)
    headers = "".join(f'#include "lib/{name}.h"\n' for name in ("heights", "lanes", "screen", "taps"))
    program = cl.Program(session.context, headers + DRIVER)
    program.build(["-I", str(kernels_folder()), f"-DLANES={lanes}", "-cl-std=CL1.2", "-Werror"])

    def run(name: str, *arguments: NDArray[np.generic] | np.generic, rows: int = 1) -> NDArray[np.float32]:
        flags = cl.mem_flags.READ_ONLY | cl.mem_flags.COPY_HOST_PTR
        passed = [
            cl.Buffer(session.context, flags, hostbuf=a) if isinstance(a, np.ndarray) and a.ndim else a
            for a in arguments
        ]
        made = np.empty(rows * COUNT, np.float32)
        out = cl.Buffer(session.context, cl.mem_flags.WRITE_ONLY, made.nbytes)
        cl.Kernel(program, name)(session.queue, (COUNT // lanes,), None, *passed, out)
        cl.enqueue_copy(session.queue, made, out)
        return made.reshape(rows, COUNT)

    return run


@pytest.mark.parametrize("shape", [(5, 7), (1, 6), (6, 1), (1, 1)])
def test_taps_at_a_border_count_as_on_it_and_taps_of_tiles_go_round(driver, shape):
    rng = np.random.default_rng(2)
    map_, size = rng.random(shape, np.float32), np.int32(shape[::-1])
    x, y = ((rng.random((2, COUNT)) * 1.6 - 0.3) * size[:, None]).astype(np.float32)
    made = driver("clamped", map_, *size, x, y)[0]
    np.testing.assert_allclose(made, bilinear(map_, x.astype(float), y.astype(float)), atol=2e-6)
    u, v = (rng.random((2, COUNT)) * 6 - 3).astype(np.float32)
    made = driver("tiled", map_, *size, u, v)[0]
    np.testing.assert_allclose(made, bilinear_height(map_, u.astype(float), v.astype(float)), atol=2e-5)


def test_no_texel_lies_beyond_a_tile(driver):
    """Positions may be a thousand tiles away, where float32 barely resolves texels; idle lanes hold any value."""
    size = 10007
    multiples = size * np.arange(1000 - COUNT // 2, 1000)
    far = np.concatenate([multiples, multiples - 1]).astype(np.float32)
    anything = np.resize(np.float32([np.nan, np.inf, -np.inf, 3e38, -3e38, 2**31, -(2**31), 0, -1]), COUNT)
    for x in (far, anything):
        made = driver("moved_into_tile", x, np.int32(size))[0]
        assert ((made >= 0) & (made < size)).all()
    near = np.random.default_rng(5).integers(-(2**20), 2**20, COUNT).astype(np.float32)
    np.testing.assert_array_equal(driver("moved_into_tile", near, np.int32(size))[0], near % size)


@pytest.mark.parametrize("perspective", [1, 0])
def test_a_pixel_sees_a_point_and_a_direction(driver, perspective):
    rng = np.random.default_rng(4)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    pixels = np.array([[80, 0, 40.5], [0, 75, 30.2], [0, 0, 1]])
    from_world = np.eye(4)  # to (U, V, W, Q)
    rows = pixels @ np.hstack([rotation, [[0.1], [0.2], [4.0]]])
    if perspective:
        from_world[:3], from_world[3] = rows, (0, 0, 0, 1)
    else:
        from_world[:2] = rows[:2] - np.outer(pixels[:2, 2], rows[2]) + np.outer(pixels[:2, 2], (0, 0, 0, 1))
        from_world[2], from_world[3] = (0, 0, 0, 1), -rows[2]
    screen = np.zeros(1, "16f4, 16f4, i4, i4, i4, f4")
    screen[0] = (from_world.ravel(), np.linalg.inv(from_world).ravel(), 81, 61, perspective, 1.0)
    x, y = (rng.random((2, COUNT)) * [[80], [60]]).astype(np.float32)
    depth = 2 + rng.random(COUNT)
    nearness = (1 / depth if perspective else -depth).astype(np.float32)
    made = driver("points", screen[0], x, y, nearness, rows=6)
    points = np.vstack([made[:3], np.ones(COUNT)])
    U, V, W, Q = from_world @ points
    np.testing.assert_allclose([U / W, V / W, Q / W], [x, y, nearness], rtol=2e-4, atol=1e-4)
    axis = rotation.T @ np.array([0, 0, 1.0])
    expected = (
        rotation.T @ (rotation @ made[:3] + [[0.1], [0.2], [4.0]]) if perspective else np.tile(axis[:, None], COUNT)
    )
    np.testing.assert_allclose(made[3:], expected / np.linalg.norm(expected, axis=0), atol=1e-4)
