/* Region growing: spreads depth from seeds over an area. Depth first spreads between similar colours, so regions that
 * grow from two sides meet at colour edges.
 *
 * A step from a pixel to a neighbour has a class, 0 to 3: the two colours differ little, somewhat, much or fully
 * (tint.h). The cost of a path from a seed is one number, ordered by the path's greatest class, then by the number of
 * steps since the path first met this class. A pixel's cost is the least cost of a path to it. Among the neighbours
 * with a lower cost, the one with the most similar colour gives the pixel its depth (if several are equally similar,
 * the first in EACH_STEP). The result equals region growing step by step, class after class (in the manner of Adams,
 * Bischof: Seeded region growing, 1994), but does not depend on the order of computation.
 *
 * `relax` lowers the costs in place, tile by tile, until nothing changes. Only a tile's own work-item writes the tile's
 * costs. This work-item may read an old or a new cost of a neighbouring tile: both are costs of existing paths, and the
 * least costs are unique, so the result does not depend on the order. A tile is skipped if neither it nor a
 * neighbouring tile changed in the previous pass.
 *
 * marks: plane.h; begin_growth removes AREA from DOUBTED pixels where `near` is 1. near: a plane, 1 outside of the area
 * (area.cl). tint: tint.h. costs: a plane, 0 at seeds. steps: a plane, 2 bits for the class of each step in EACH_STEP.
 * stamps: (down + 2, across + 2) for each of down * across tiles, number of the last pass that changed it; 0 around
 * them. parents: a plane, number of the neighbour that gives the pixel its depth, STAY at seeds. measured, before
 * (previous frame), grown: planes of depth, 0 for none. Work-item: `strip` packets of a row, or a tile (relax). Cost:
 * O(pixels + filled pixels * length of their paths). Determinism: see above.
 */
#include "cleaning/plane.h"
#include "cleaning/tint.h"

#define OUTSIDE 0x7ffffff8 /* cost outside of the area; UNREACHED: cost in the area, until a path reaches the pixel */
#define UNREACHED 0x7ffffff0
#define CLASS_SHIFT 29
#define GROWN_ROWS 16 /* number of a tile's rows */
#define STAY 4

/* Steps to the neighbours: the step's number, pixels across (to the right) and down */
#define EACH_STEP(F) F(0, 0, -1) F(1, -1, 0) F(2, 1, 0) F(3, 0, 1) F(4, -1, -1) F(5, 1, -1) F(6, -1, 1) F(7, 1, 1)

kernel void begin_growth(global uchar *marks, global const uchar *near, global const uint *tint, int has_color,
                         global int *costs, global int *steps, ImagePlane plane, int strip)
{
    EACH_PACKET(plane, x, row)
    {
        const int at = row * plane.pitch + x;
        intl cost = OUTSIDE, step = 0;
        if (IS_PACKET_OF_IMAGE(plane, x, row)) {
            intl mark = load_bytes(marks + at);
            const intl is_near = load_bytes(near + at) != 0, is_seed = (mark & SEED) != 0;
            const intl is_area = is_seed | (((mark & AREA) != 0) & !(((mark & DOUBTED) != 0) & is_near));
            const intl is_open = is_area & !is_seed;
            mark = (mark & SEED) | select_lanes(is_area, (intl)AREA, (intl)0);
            store_bytes(to_ucharl(mark), marks + at);
            cost = select_lanes(is_seed, (intl)0, select_lanes(is_open, (intl)UNREACHED, (intl)OUTSIDE));
            if (has_color && any_lane(is_open)) {
                const uintl own = load_lanes(tint + at);
#define ADD_STEP(number, dx, dy)                                                                               \
    {                                                                                                          \
        const intl unlike = unlikeness(own, load_lanes(tint + at + dy * plane.pitch + dx));                    \
        const intl kind = select_lanes(unlike > UNLIKE_LITTLE, (intl)1, (intl)0) +                                     \
                          select_lanes(unlike > UNLIKE_SOME, (intl)1, (intl)0) +                                       \
                          select_lanes(unlike > UNLIKE_MUCH, (intl)1, (intl)0);                                        \
        step |= kind << 2 * number;                                                                            \
    }
                EACH_STEP(ADD_STEP)
            }
        }
        store_lanes(cost, costs + at);
        store_lanes(step, steps + at);
    }
}

/* Lowers the costs of a packet. Returns 1 if any of them changed. */
INLINED int relax_packet(global const int *steps, global int *costs, int at, int pitch)
{
    const intl cost = load_lanes(costs + at), is_open = (cost > 0) & (cost < OUTSIDE);
    if (!any_lane(is_open))
        return 0;
    const intl step = load_lanes(steps + at);
    intl least = cost;
#define TAKE_STEP(number, dx, dy)                                                                              \
    least = min(least, max(load_lanes(costs + at + dy * pitch + dx), (step >> 2 * number & 3) << CLASS_SHIFT) + 1);
    EACH_STEP(TAKE_STEP)
    least = select_lanes(is_open, least, cost);
    if (!any_lane(least < cost))
        return 0;
    store_lanes(least, costs + at);
    return 1;
}

kernel void relax(global const int *steps, global int *costs, global int *stamps, ImagePlane plane, int number)
{
    const int across = (plane.width + LANES - 1) / LANES, down = (plane.height + GROWN_ROWS - 1) / GROWN_ROWS;
    const int column = get_global_id(0), row = get_global_id(1);
    if (column >= across || row >= down)
        return;
    int newest = 0;
    for (int v = row; v <= row + 2; v++)
        for (int u = column; u <= column + 2; u++)
            newest = max(newest, stamps[v * (across + 2) + u]);
    if (newest < number - 1)
        return;
    const int first = ABOVE + row * GROWN_ROWS, last = min(first + GROWN_ROWS, ABOVE + plane.height) - 1;
    const int x = ASIDE + column * LANES;
    int changed = 0, again = 1;
    while (again) {
        again = 0;
        for (int v = first; v <= last; v++)
            again |= relax_packet(steps, costs, v * plane.pitch + x, plane.pitch);
        for (int v = last; v >= first; v--)
            again |= relax_packet(steps, costs, v * plane.pitch + x, plane.pitch);
        changed |= again;
    }
    if (changed)
        stamps[(row + 1) * (across + 2) + column + 1] = number;
}

kernel void find_parents(global const int *costs, global const uint *tint, int has_color, global uchar *parents,
                         ImagePlane plane, int strip)
{
    EACH_PACKET(plane, x, row)
    {
        const int at = row * plane.pitch + x;
        intl parent = STAY;
        if (IS_PACKET_OF_IMAGE(plane, x, row)) {
            const intl cost = load_lanes(costs + at), is_open = (cost > 0) & (cost < UNREACHED);
            if (any_lane(is_open)) {
                const uintl own = has_color ? load_lanes(tint + at) : (uintl)0;
                intl least = UNREACHED;
#define COMPARE_STEP(number, dx, dy)                                                                           \
    {                                                                                                          \
        const int other = at + dy * plane.pitch + dx;                                                          \
        const intl unlike = has_color ? unlikeness(own, load_lanes(tint + other)) : (intl)0;                   \
        const intl is_better = (load_lanes(costs + other) < cost) & (unlike < least) & is_open;                \
        least = select_lanes(is_better, unlike, least);                                                                \
        parent = select_lanes(is_better, (intl)(STAY + 3 * dy + dx), parent);                                          \
    }
                EACH_STEP(COMPARE_STEP)
            }
        }
        store_bytes(to_ucharl(parent), parents + at);
    }
}

kernel void grow(global const uchar *marks, global const int *costs, global const uchar *parents,
                 global const float *measured, global const float *before, global float *grown, ImagePlane plane,
                 int strip)
{
    EACH_PACKET(plane, x, row)
    {
        const int at = row * plane.pitch + x;
        floatl depth = 0.0f;
        if (IS_PACKET_OF_IMAGE(plane, x, row)) {
            const intl cost = load_lanes(costs + at);
            intl mark = load_bytes(marks + at), from = at + lane_index;
            depth = load_lanes(measured + at);
            if (any_lane((cost > 0) & (cost < UNREACHED))) {
                for (intl parent = load_bytes(parents + at); any_lane(parent != STAY);) {
                    from += (parent / 3 - 1) * plane.pitch + parent % 3 - 1;
                    parent = (intl)(gather(parents, from));
                }
                mark = (intl)(gather(marks, from));
                depth = (floatl)(gather(measured, from));
            }
            if (any_lane((mark & STILL) != 0))
                depth = select_lanes((mark & STILL) != 0, (floatl)(gather(before, from)), depth);
            depth = select_lanes(cost < UNREACHED, depth, (floatl)0.0f);
        }
        store_lanes(depth, grown + at);
    }
}
