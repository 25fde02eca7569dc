#ifndef LIB_PROMINENCE_H
#define LIB_PROMINENCE_H
/* Prominence: the difference of nearness by which samples stand out from their neighbours along rows and columns. */
#include "lib/lanes.h"
#include "lib/surface.h"

#define PROMINENCE_BLOCK 16 /* samples of a row in a block; the greatest prominence of each block is stored */

/* A packet of samples, and each sample's two nearest neighbours on each side */
typedef struct {
    floatl here, left_1, left_2, right_1, right_2, above_1, above_2, below_1, below_2;
} Neighbours;

/* Reads the samples (x, y) to (x + LANES - 1, y) and their neighbours. Neighbours beyond the ring (surface.h) are
 * missing. Lanes outside of the image get arbitrary values. */
INLINED Neighbours with_neighbours(Grid grid, int x, int y)
{
    global const float *here = grid.nearness + y * grid.pitch + x;
    const intl column = x + lane_index;
    const floatl none = MISSING_SAMPLE;
    Neighbours n;
    n.here = load_lanes(here);
    n.left_1 = load_lanes(here - 1);
    n.left_2 = select_lanes(column > 0, load_lanes(here - 2), none);
    n.right_1 = load_lanes(here + 1);
    n.right_2 = select_lanes(column < grid.width - 1, load_lanes(here + 2), none);
    n.above_1 = load_lanes(here - grid.pitch);
    n.above_2 = y > 0 ? load_lanes(here - 2 * grid.pitch) : none;
    n.below_1 = load_lanes(here + grid.pitch);
    n.below_2 = y < grid.height - 1 ? load_lanes(here + 2 * grid.pitch) : none;
    return n;
}

/* The two neighbours on one side of a sample: their least and greatest nearness, -INFINITY and INFINITY if the side is
 * torn off; and the difference between the two neighbours */
typedef struct {
    floatl low, high, change;
} Side;

typedef struct {
    Side left, right, above, below;
} Sides;

/* bits: TORN_... bits; `edge` selects the bits for the edges to the neighbours `next` and `after` */
INLINED Side side_of(floatl next, floatl after, intl bits, int edge)
{
    const floatl low = min_lanes(next, after), high = max_lanes(next, after);
    const intl torn = ((bits & edge) != 0) | (low <= NO_SURFACE);
    const Side side = {select_lanes(torn, (floatl)-INFINITY, low), select_lanes(torn, (floatl)INFINITY, high),
                       select_lanes(torn, (floatl)0.0f, high - low)};
    return side;
}

INLINED Sides sides_of(Neighbours n)
{
    Sides all;
    all.left = side_of(n.left_1, n.left_2, as_intl(n.left_1) | as_intl(n.left_2), TORN_RIGHT);
    all.right = side_of(n.right_1, n.right_2, as_intl(n.here) | as_intl(n.right_1), TORN_RIGHT);
    all.above = side_of(n.above_1, n.above_2, as_intl(n.above_1) | as_intl(n.above_2), TORN_BELOW);
    all.below = side_of(n.below_1, n.below_2, as_intl(n.here) | as_intl(n.below_1), TORN_BELOW);
    return all;
}

/* The difference of nearness by which a sample stands out between sides a and b, seen from the front or from the back;
 * INFINITY if both sides are torn off */
#define PROMINENCE(here, a, b, back)                                                                           \
    ((back) ? min_lanes((a).high, (b).high) - (here) : (here) - max_lanes((a).low, (b).low))
#endif
