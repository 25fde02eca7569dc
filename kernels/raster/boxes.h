#ifndef RASTER_BOXES_H
#define RASTER_BOXES_H
/* Boxes: the bins that images of primitives may touch. */
#include "lib/screen.h"

/* The first and last bins, in x and in y, that each of LANES primitives may touch; low > high if there are none */
typedef struct {
    intl low_x, high_x, low_y, high_y;
} Boxes;

/* The bins of the pixels within limits; none for lanes that are not in the mask `shown`. */
INLINED Boxes boxes_within(floatl low_x, floatl high_x, floatl low_y, floatl high_y, intl shown, Screen screen)
{
    const float right = screen.width - 1.0f, bottom = screen.height - 1.0f;
    const float per_bin = 1.0f / BIN; /* a power of two: exact */
    /* Clamped to one pixel around the picture, which keeps whole numbers small. */
    const floatl x0 = ceil_lanes(clamp_lanes(low_x, (floatl)0.0f, (floatl)(right + 1.0f)));
    const floatl y0 = ceil_lanes(clamp_lanes(low_y, (floatl)0.0f, (floatl)(bottom + 1.0f)));
    const floatl x1 = floor_lanes(clamp_lanes(high_x, (floatl)-1.0f, (floatl)right));
    const floatl y1 = floor_lanes(clamp_lanes(high_y, (floatl)-1.0f, (floatl)bottom));
    const intl seen = shown & (x0 <= x1) & (y0 <= y1);
    const Boxes boxes = {
        select_lanes(seen, to_intl(x0 * per_bin), (intl)1), select_lanes(seen, to_intl(x1 * per_bin), (intl)0),
        select_lanes(seen, to_intl(y0 * per_bin), (intl)1), select_lanes(seen, to_intl(y1 * per_bin), (intl)0)};
    return boxes;
}

/* Writes the first `count` boxes: first and last bin in x, first and last in y. */
INLINED void store_boxes(Boxes box, int count, global ushort *boxes)
{
    for (int lane = 0; lane < min(LANES, count); lane++)
        vstore4((ushort4)(int_lane(box.low_x, lane), int_lane(box.high_x, lane), int_lane(box.low_y, lane),
                          int_lane(box.high_y, lane)), lane, boxes);
}
#endif
