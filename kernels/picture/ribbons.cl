/* Finds the ribbons of parts that are one sample wide (lib/ribbons.h), such as wires, leaves and bars.
 *
 * surface: (height + 2, pitch), picture/edges.cl. begins: (height, width), initially 0; a thin sample's bit k is set if
 * a ribbon leads from it to its neighbour number k. Work-item: STRIP * LANES samples of a row. Cost: O(samples); thin
 * samples also read all of their neighbours. Determinism: samples are independent.
 */
#include "lib/lanes.h"
#include "lib/ribbons.h"

/* Reads LANES samples of row y, from x0 on, and their left and right neighbours; NO_SURFACE outside of the image. */
INLINED void load_row(Grid grid, int x0, int y, floatl *left, floatl *here, floatl *right)
{
    const intl x = x0 + lane_index;
    *left = *here = *right = NO_SURFACE;
    if (y < 0 || y >= grid.height)
        return;
    global const float *own = grid.nearness + (size_t)y * grid.pitch + x0;
    *here = select_lanes(x < grid.width, load_lanes(own), (floatl)NO_SURFACE);
    /* Rows have room for reads beyond the image. */
    *right = select_lanes(x + 1 < grid.width, load_lanes(own + 1), (floatl)NO_SURFACE);
    *left = shifted_lanes(*here);
    set_float_lane(*left, 0, x0 > 0 ? own[-1] : NO_SURFACE);
}

/* Tells whether a cell is not whole: two of its samples are torn apart, or one is missing. */
#define IS_TORN(q00, q10, q01, q11)                                                                            \
    (IS_LOWER_OPEN(q00) | IS_UPPER_OPEN(q00, q10, q01) | (min_lanes(q01, q11) <= NO_SURFACE))

kernel void find_ribbons(global const float *surface, global ushort *begins, int width, int height, int pitch, Cut cut)
{
    const int y = get_global_id(1);
    const Grid grid = GRID_OF(surface, width, height, pitch, cut);
    if (y >= height)
        return;
    for (int x0 = get_global_id(0) * STRIP * LANES, packet = 0; packet < STRIP && x0 < width; x0 += LANES, packet++) {
        floatl left[3], here[3], right[3];
        for (int i = 0; i < 3; i++)
            load_row(grid, x0, y + i - 1, left + i, here + i, right + i);
        const intl thin = (here[1] > NO_SURFACE) & IS_TORN(left[0], here[0], left[1], here[1]) &
                          IS_TORN(here[0], right[0], here[1], right[1]) & IS_TORN(left[1], here[1], left[2], here[2]) &
                          IS_TORN(here[1], right[1], here[2], right[2]);
        if (!any_lane(thin))
            continue; /* most packets have none */
        for (int lane = 0; lane < LANES; lane++)
            for (int neighbour = 0; int_lane(thin, lane) && neighbour < NEIGHBOURS; neighbour++)
                if (is_first_of(grid, x0 + lane, y, neighbour))
                    begins[(size_t)y * width + x0 + lane] |= 1 << neighbour;
    }
}
