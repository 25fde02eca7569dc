/* Where a surface has samples that stand out over what is around them, and by how much of nearness.
 *
 * surface: picture/edges.cl. prominence: (height, blocks, 2) of each PROMINENCE_BLOCK samples of a row, that of the most prominent one,
 * as seen from the front and from the back; INFINITY if it is torn off on both sides.
 * Work-item: STRIP blocks. Cost: O(samples). Determinism: each block on its own.
 */
#include "lib/prominence.h"

#ifndef STRIP
#define STRIP 1 /* blocks that a work-item goes through: starting one takes longer than most */
#endif

/* Writes that of a block's samples of a row. */
INLINED void measure_block(Grid grid, int first, int y, global float *out)
{
    floatl front = -INFINITY, back = -INFINITY;
    for (int x = first; x < min(first + PROMINENCE_BLOCK, grid.width); x += LANES) {
        const Neighbours n = with_neighbours(grid, x, y);
        const intl solid = (n.here > NO_SURFACE) & (x + lane_index < grid.width);
        const Falls before = falls_of(n, 0), behind = falls_of(n, 1);
        const floatl over_front = max_lanes(PROMINENCE_IN_ROW(before), PROMINENCE_IN_COLUMN(before));
        const floatl over_back = max_lanes(PROMINENCE_IN_ROW(behind), PROMINENCE_IN_COLUMN(behind));
        front = select_lanes(solid, max_lanes(over_front, front), front);
        back = select_lanes(solid, max_lanes(over_back, back), back);
    }
    out[0] = -least_lane(-front);
    out[1] = -least_lane(-back);
}

kernel void measure_prominence(global const float *surface, global float *prominence, int width, int height, int pitch)
{
    const int first = get_global_id(0) * STRIP, y = get_global_id(1), blocks = (width + PROMINENCE_BLOCK - 1) / PROMINENCE_BLOCK;
    if (y >= height)
        return;
    const Grid grid = GRID_OF(surface, width, height, pitch, NO_CUT);
    for (int block = first; block < min(first + STRIP, blocks); block++)
        measure_block(grid, block * PROMINENCE_BLOCK, y, prominence + 2 * ((size_t)y * blocks + block));
}
