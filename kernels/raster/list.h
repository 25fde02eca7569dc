#ifndef RASTER_LIST_H
#define RASTER_LIST_H
/* The loop of raster/region.h, to be included after a fragment program, which defines FRAGMENTS as 1. */
#include "raster/region.h"

#ifndef FRAGMENTS
#define FRAGMENTS 0 /* 1: there is a fragment program */
#endif

#if FRAGMENTS
void draw_list(const Context *context, Region *region, global const int *list, int first, int last, int x, int y)
{
    for (int i = first; i < last; i += LANES) {
        Primitives primitives;
        const intl at = min(i + lane_index, (intl)(last - 1)), index = (intl)(gather(list, at));
        const intl seen = set_up(context, index, x, y, &primitives) & (i + lane_index < last);
        if (!any_lane(seen))
            continue;
        for (int lane = 0; lane < LANES; lane++) {
            if (!int_lane(seen, lane))
                continue;
            const int low_x = int_lane(primitives.low_x, lane), high_x = int_lane(primitives.high_x, lane);
            const int low_y = int_lane(primitives.low_y, lane), high_y = int_lane(primitives.high_y, lane);
            for (int row = low_y / BLOCK; row <= high_y / BLOCK; row++)
                for (int column = low_x / BLOCK; column <= high_x / BLOCK; column++)
                    cover(context, &primitives, lane, region, row * ROW + column, column * BLOCK, row * BLOCK);
        }
    }
}
#endif
#endif
