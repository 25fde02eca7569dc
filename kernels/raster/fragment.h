#ifndef RASTER_FRAGMENT_H
#define RASTER_FRAGMENT_H
/* Common part of all kernels with fragment programs: how they read the bins of raster/bins.cl and begin a region.
 *
 * A fragment program defines
 *   Context     its arguments, passed by pointer
 *   Primitives  values that all pixels of a primitive share, for LANES primitives; intl low_x, high_x, low_y, high_y:
 *               the box of a primitive's pixels in the region
 *   intl set_up(const Context *, intl index, int x, int y, Primitives *)   returns which primitives may be visible;
 *               x, y: the region's first pixel
 *   void cover(const Context *, const Primitives *, int lane, Region *, int block, int x, int y)   draws a lane's
 *               primitive in a block; x, y: the block's first pixel in the region
 * and then includes raster/list.h, which draws the primitives of a bin in order.
 */
#include "raster/region.h"

/* Kernel parameters: the bins, and the camera for which they were made */
#define BINS_PARAMETERS                                                                                        \
    global const float *projected, global const int *list, global const int *starts, int bins_x,               \
        Screen screen, float nearest_w

/* Primitives that may be visible in a bin, of all meshes or of some: list[first] to list[last - 1] */
typedef struct {
    global const int *list;
    int first, last;
} BinList;

/* Sets the list of the bin at (x, y). Oclgrind cannot run a function that returns a struct within a loop. */
INLINED void list_of_bin(global const int *list, global const int *starts, int bins_x, int x, int y, BinList *listed)
{
    const int bin = y / BIN * bins_x + x / BIN;
    listed->list = list;
    listed->first = starts[bin];
    listed->last = starts[bin + 1];
}

/* Begins the region at (x, y) and returns 1. If the list is empty, returns 0 instead, and clears the region if the
 * picture is blank. */
OUTLINED int begin_listed(Region *region, const Picture *picture, BinList listed, int x, int y)
{
    const int any = listed.first < listed.last;
    if (any)
        begin_in_picture(region, picture, x, y);
    else if (picture->blank)
        clear_region(picture, x, y);
    return any;
}

/* In a launch with a work-item for each region, sets this work-item's list and begins its region. Returns 0 if there is
 * nothing to draw, else 1. */
INLINED int begin_item(Region *region, const Picture *picture, global const int *list, global const int *starts,
                       int bins_x, BinList *listed)
{
    const int x = get_global_id(0) * REGION, y = get_global_id(1) * REGION;
    if (x >= picture->screen.width || y >= picture->screen.height)
        return 0;
    list_of_bin(list, starts, bins_x, x, y, listed);
    return begin_listed(region, picture, *listed, x, y);
}
#endif
