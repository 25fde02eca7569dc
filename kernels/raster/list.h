#ifndef RASTER_LIST_H
#define RASTER_LIST_H
/* The loop that draws the primitives of a list. Include this file after a fragment program (fragment.h) that defines
 * FRAGMENTS as 1. */
#include "raster/fragment.h"

#ifndef FRAGMENTS
#define FRAGMENTS 0 /* 1: there is a fragment program */
#endif

#if FRAGMENTS
OUTLINED void draw_list(const Context *context, Region *region, BinList listed)
{
    for (int i = listed.first; i < listed.last; i += LANES) {
        Primitives primitives;
        const intl at = min(i + lane_index, (intl)(listed.last - 1)), index = (intl)(gather(listed.list, at));
        const intl seen = set_up(context, index, region->x, region->y, &primitives) & (i + lane_index < listed.last);
        if (!any_lane(seen))
            continue;
        for (int lane = 0; lane < LANES; lane++) {
            if (!int_lane(seen, lane))
                continue;
            const int low_x = int_lane(primitives.low_x, lane), high_x = int_lane(primitives.high_x, lane);
            const int low_y = int_lane(primitives.low_y, lane), high_y = int_lane(primitives.high_y, lane);
            for (int row = low_y / BLOCK; row <= high_y / BLOCK; row++)
                for (int column = low_x / BLOCK; column <= high_x / BLOCK; column++)
                    cover(context, &primitives, lane, region, BLOCK_AT(column, row), column * BLOCK, row * BLOCK);
        }
    }
}
#endif
#endif
