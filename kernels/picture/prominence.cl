/* Where a surface has samples that stand out over what is around them, and by how much of nearness.
 *
 * surface: picture/edges.cl. prominence: (height, blocks, 2) of each BLOCK samples of a row, that of the most prominent one,
 * as seen from the front and from the back; INFINITY if it is torn off on both sides.
 * Work-item: a block. Cost: O(samples). Determinism: each block on its own.
 */
#include "lib/prominence.h"

kernel void measure_prominence(global const float *surface, global float *prominence, int width, int height, int pitch)
{
    const int block = get_global_id(0), y = get_global_id(1), blocks = (width + BLOCK - 1) / BLOCK;
    if (y >= height || block >= blocks)
        return;
    const Grid grid = GRID_OF(surface, width, height, pitch, NO_CUT);
    floatl front = -INFINITY, back = -INFINITY;
    for (int x = block * BLOCK; x < min(block * BLOCK + BLOCK, width); x += LANES) {
        const Around n = samples_around(grid, x, y);
        const intl solid = (n.here > NO_SURFACE) & (x + lane_index < width);
        const Sides before = sides_of(n, 0), behind = sides_of(n, 1);
        const floatl over_front = max_lanes(PROMINENCE_IN_ROW(before), PROMINENCE_IN_COLUMN(before));
        const floatl over_back = max_lanes(PROMINENCE_IN_ROW(behind), PROMINENCE_IN_COLUMN(behind));
        front = select_lanes(solid, max_lanes(over_front, front), front);
        back = select_lanes(solid, max_lanes(over_back, back), back);
    }
    global float *out = prominence + 2 * ((size_t)y * blocks + block);
    out[0] = -least_lane(-front);
    out[1] = -least_lane(-back);
}
