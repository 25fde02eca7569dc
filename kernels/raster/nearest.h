#ifndef RASTER_NEAREST_H
#define RASTER_NEAREST_H
/* Fragment program of opaque triangles (fragment.h): each pixel keeps the nearest triangle, or the first of
 * several that are equally near. */
#include "raster/fragment.h"
#include "raster/triangle.h"

typedef struct {
    global const int *corners;
    global const float *projected;
    Screen screen;
    float nearest_w;
    int culled;
} Context;

typedef Triangles Primitives;

INLINED intl set_up(const Context *context, intl index, int x, int y, Primitives *t)
{
    return set_up_triangles(context->corners, context->projected, index, context->nearest_w, context->culled, x, y, t);
}

static void cover(const Context *context, const Primitives *t, int lane, Region *region, int block, int first_x, int first_y)
{
    if (float_lane(t->n_high, lane) <= region->farthest[block])
        return;
    floatl n;
    const floatl so_far = region->nearness[block];
    const intl seen = covered_by(t, lane, first_x, first_y, &n) & (n > so_far) & (n <= context->screen.nearest);
    region->nearness[block] = select_lanes(seen, n, so_far);
    region->owner[block] = select_lanes(seen, (intl)int_lane(t->index, lane), region->owner[block]);
}

#define FRAGMENTS 1
#include "raster/list.h"
#endif
