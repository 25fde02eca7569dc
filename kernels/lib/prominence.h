#ifndef LIB_PROMINENCE_H
#define LIB_PROMINENCE_H
/* How samples of a surface stand out over what lies around them, along rows and along columns. */
#include "lib/lanes.h"
#include "lib/surface.h"

#define PROMINENCE_BLOCK 16 /* samples of a row of which it is known how the most prominent one stands out */

/* A packet of samples and the next two on each side */
typedef struct {
    floatl here, left_1, left_2, right_1, right_2, above_1, above_2, below_1, below_2;
} Neighbours;

/* Samples (x, y) to (x + LANES - 1, y) of the surface, no surface beyond its ring */
INLINED floatl samples_or_none(Grid grid, int x, int y)
{
    floatl n = MISSING_SAMPLE;
    if (y >= -1 && y <= grid.height)
        for (int lane = max(-1 - x, 0); lane < min(LANES, grid.width + 1 - x); lane++)
            set_float_lane(n, lane, grid.nearness[y * grid.pitch + x + lane]);
    return n;
}

INLINED Neighbours with_neighbours(Grid grid, int x, int y)
{
    Neighbours n;
    if (x >= 1 && x + LANES + 1 <= grid.width && y >= 1 && y + 1 < grid.height) {
        global const float *here = grid.nearness + y * grid.pitch + x;
        n.here = load_lanes(here);
        n.left_1 = load_lanes(here - 1);
        n.left_2 = load_lanes(here - 2);
        n.right_1 = load_lanes(here + 1);
        n.right_2 = load_lanes(here + 2);
        n.above_1 = load_lanes(here - grid.pitch);
        n.above_2 = load_lanes(here - 2 * grid.pitch);
        n.below_1 = load_lanes(here + grid.pitch);
        n.below_2 = load_lanes(here + 2 * grid.pitch);
        return n;
    }
    n.here = samples_or_none(grid, x, y);
    n.left_1 = samples_or_none(grid, x - 1, y);
    n.left_2 = samples_or_none(grid, x - 2, y);
    n.right_1 = samples_or_none(grid, x + 1, y);
    n.right_2 = samples_or_none(grid, x + 2, y);
    n.above_1 = samples_or_none(grid, x, y - 1);
    n.above_2 = samples_or_none(grid, x, y - 2);
    n.below_1 = samples_or_none(grid, x, y + 1);
    n.below_2 = samples_or_none(grid, x, y + 2);
    return n;
}

/* What lies on a side of samples, within two of them: the least and the greatest nearness, (-INFINITY, INFINITY) if they
 * are torn from it; and by how much it changes itself */
typedef struct {
    floatl low, high, change;
} Side;

typedef struct {
    Side left, right, above, below;
} Sides;

/* bits: of the samples that own the edges on the way */
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

/* By how much of nearness samples stand out between two sides, as seen from the front or from the back: INFINITY if they
 * are torn from both */
#define PROMINENCE(here, a, b, back)                                                                           \
    ((back) ? min_lanes((a).high, (b).high) - (here) : (here) - max_lanes((a).low, (b).low))
#endif
