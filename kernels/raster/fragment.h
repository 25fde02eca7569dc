#ifndef RASTER_FRAGMENT_H
#define RASTER_FRAGMENT_H
/* What all kernels with fragment programs begin with: the bins of raster/bins.cl, and the picture's regions.
 *
 * A fragment program defines
 *   Context     its arguments, by pointer
 *   Primitives  what is the same for all pixels of each of LANES primitives; intl low_x, high_x, low_y, high_y: the
 *               box of its pixels in the region
 *   intl set_up(const Context *, intl index, int x, int y, Primitives *)   x, y: the region's first pixel; which of
 *               them may be seen
 *   void cover(const Context *, const Primitives *, int lane, Region *, int block, int x, int y)   one of them; x, y:
 *               the block's first pixel in the region
 * and then includes raster/list.h, which draws the primitives of a bin in order.
 */
#include "raster/region.h"

/* Parameters of the bins, and of the camera that they are made for */
#define BINS_PARAMETERS                                                                                        \
    global const float *projected, global const int *list, global const int *starts, int bins_x,               \
        Screen screen, float nearest_w

/* The primitives that may be seen in a bin, or those of one mesh among them: list[first] to list[last - 1] */
typedef struct {
    global const int *list;
    int first, last;
} BinList;

/* That of the bin at (x, y). Oclgrind cannot run a function that returns a struct within a loop. */
INLINED void list_of_bin(global const int *list, global const int *starts, int bins_x, int x, int y, BinList *listed)
{
    const int bin = y / BIN * bins_x + x / BIN;
    listed->list = list;
    listed->first = starts[bin];
    listed->last = starts[bin + 1];
}

/* Begins the region at (x, y), unless its bin's list is empty, when there is nothing to draw: then a blank picture is
 * cleared there. Returns whether it has begun. */
OUTLINED int begin_listed(Region *region, const Picture *picture, BinList listed, int x, int y)
{
    const int any = listed.first < listed.last;
    if (any)
        begin_in_picture(region, picture, x, y);
    else if (picture->blank)
        clear_region(picture, x, y);
    return any;
}

/* The same for the region of this work-item, of a launch with one for each; sets what is listed there. */
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
