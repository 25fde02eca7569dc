/* Where a surface has samples that stand out over what is around them, and by how much of nearness.
 *
 * surface: picture/edges.cl. prominence: (height, blocks, 2) of each PROMINENCE_BLOCK samples of a row, that of the most
 * prominent one, as seen from the front and from the back; INFINITY if it is torn off on both sides, -INFINITY if noise
 * explains it. noise_0, noise_1, noise_2: of nearness n noise explains noise_0 + noise_1 n + noise_2 n^2.
 * Work-item: STRIP blocks. Cost: O(samples). Determinism: each block on its own.
 */
#include "lib/prominence.h"

/* By how much of nearness samples stand out, between their sides in the row or in the column, as seen from the front and
 * from the back */
INLINED void stand_out(Neighbours n, floatl *front, floatl *back)
{
    const intl before = as_intl(n.left_1) | as_intl(n.left_2) | as_intl(n.above_1) | as_intl(n.above_2);
    if (any_lane(((before | as_intl(n.here) | as_intl(n.right_1) | as_intl(n.below_1)) & TORN_ALL) != 0)) {
        const Sides all = sides_of(n);
        *front = max_lanes(PROMINENCE(n.here, all.left, all.right, 0), PROMINENCE(n.here, all.above, all.below, 0));
        *back = max_lanes(PROMINENCE(n.here, all.left, all.right, 1), PROMINENCE(n.here, all.above, all.below, 1));
        return;
    }
    /* Most packets: nothing is torn. */
    const floatl row_low = max_lanes(min_lanes(n.left_1, n.left_2), min_lanes(n.right_1, n.right_2));
    const floatl row_high = min_lanes(max_lanes(n.left_1, n.left_2), max_lanes(n.right_1, n.right_2));
    const floatl column_low = max_lanes(min_lanes(n.above_1, n.above_2), min_lanes(n.below_1, n.below_2));
    const floatl column_high = min_lanes(max_lanes(n.above_1, n.above_2), max_lanes(n.below_1, n.below_2));
    *front = n.here - min_lanes(row_low, column_low);
    *back = max_lanes(row_high, column_high) - n.here;
}

/* Writes that of a row's blocks `first` to `end` - 1: -INFINITY where it is no more than noise explains. */
OUTLINED void measure_blocks(Grid grid, int first, int end, int y, float noise_0, float noise_1, float noise_2,
                             global float *out)
{
    for (int block = first; block < end; block++) {
        const int from = block * PROMINENCE_BLOCK;
        floatl front = -INFINITY, back = -INFINITY;
        for (int x = from; x < min(from + PROMINENCE_BLOCK, grid.width); x += LANES) {
            const Neighbours n = with_neighbours(grid, x, y);
            floatl front_here, back_here;
            stand_out(n, &front_here, &back_here);
            const intl solid = (n.here > NO_SURFACE) & (x + lane_index < grid.width);
            const floatl noise = noise_0 + n.here * (noise_1 + n.here * noise_2);
            front = select_lanes(solid & (front_here > noise), max_lanes(front_here, front), front);
            back = select_lanes(solid & (back_here > noise), max_lanes(back_here, back), back);
        }
        const int any = any_lane(max_lanes(front, back) > -INFINITY); /* mostly none */
        out[2 * block] = any ? -least_lane(-front) : -INFINITY;
        out[2 * block + 1] = any ? -least_lane(-back) : -INFINITY;
    }
}

kernel void measure_prominence(global const float *surface, global float *prominence, int width, int height, int pitch,
                               float noise_0, float noise_1, float noise_2)
{
    const int first = get_global_id(0) * STRIP, y = get_global_id(1);
    const int blocks = (width + PROMINENCE_BLOCK - 1) / PROMINENCE_BLOCK;
    if (y >= height)
        return;
    const Grid grid = GRID_OF(surface, width, height, pitch, NO_CUT);
    measure_blocks(grid, first, min(first + STRIP, blocks), y, noise_0, noise_1, noise_2,
                   prominence + 2 * (size_t)y * blocks);
}
