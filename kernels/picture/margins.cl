/* The margins of a surface (lib/margins.h) from its edges.
 *
 * Beside a triangle of the same cell its plane goes on. Else nearness changes as it does to the neighbours that are of one
 * surface with the sample, and towards those that are torn off it stays: a slope from the other side would amplify its
 * noise, and of round things it would stick out.
 *
 * surface: picture/edges.cl. counts: (pieces,) quarters that a piece's samples have. starts: (pieces,) the column of
 * a piece's first one in `margins`, lib/margins.h.
 * Work-item: `piece` samples of a row, a multiple of LANES or all. Cost: O(samples). Determinism: each piece on its own.
 */
#include "lib/lanes.h"
#include "lib/margins.h"
#include "lib/surface.h"

#define HAS_EDGE(sample, edges) ((as_intl(sample) & (edges)) != 0) /* TORN_... */

/* A packet of samples, and those around them */
typedef struct {
    floatl here, left, right, above, below, above_left, above_right, below_left;
    intl torn_left, torn_right, torn_above, torn_below;
} Around;

/* Which parts of a packet's four quarters are margins: TO_RIGHT and TO_BELOW are their numbers */
typedef struct {
    intl lower[4], upper[4];
} Parts;

INLINED Around around_of(global const float *own, int pitch)
{
    Around n;
    n.here = load_lanes(own);
    n.left = load_lanes(own - 1);
    n.right = load_lanes(own + 1);
    n.above = load_lanes(own - pitch);
    n.below = load_lanes(own + pitch);
    n.above_left = load_lanes(own - pitch - 1);
    n.above_right = load_lanes(own - pitch + 1);
    n.below_left = load_lanes(own + pitch - 1);
    n.torn_left = HAS_EDGE(n.left, TORN_RIGHT);
    n.torn_right = HAS_EDGE(n.here, TORN_RIGHT);
    n.torn_above = HAS_EDGE(n.above, TORN_BELOW);
    n.torn_below = HAS_EDGE(n.here, TORN_BELOW);
    return n;
}

/* Of the cells around the samples: the triangle of the last corner of that above to the left, both of the two beside
 * it, and that of the first corner of the one below to the right */
INLINED Parts parts_of(Around n, intl wanted)
{
    const intl solid = wanted & (n.here > NO_SURFACE);
    Parts parts;
    parts.upper[0] = parts.lower[0] = solid & (HAS_EDGE(n.above_left, TORN_DIAGONAL) | n.torn_above | n.torn_left);
    parts.lower[TO_RIGHT] = solid & HAS_EDGE(n.above, TORN_ALL);
    parts.upper[TO_RIGHT] =
        solid & (HAS_EDGE(n.above, TORN_DIAGONAL) | HAS_EDGE(n.above_right, TORN_BELOW) | n.torn_right);
    parts.lower[TO_BELOW] = solid & HAS_EDGE(n.left, TORN_ALL);
    parts.upper[TO_BELOW] = solid & (HAS_EDGE(n.left, TORN_DIAGONAL) | HAS_EDGE(n.below_left, TORN_RIGHT) | n.torn_below);
    parts.lower[3] = parts.upper[3] = solid & HAS_EDGE(n.here, TORN_ALL);
    return parts;
}

/* Are any of a packet's samples beside an edge? */
INLINED int any_edge(Around n)
{
    return any_lane(((as_intl(n.here) | as_intl(n.left) | as_intl(n.above) | as_intl(n.above_left)) & TORN_ALL) |
                    (as_intl(n.above_right) & TORN_BELOW) | (as_intl(n.below_left) & TORN_RIGHT));
}

/* The slopes of the packet's quarters of a number */
INLINED void slopes_of(Around n, intl lower, intl upper, int number, floatl *slope_x, floatl *slope_y)
{
    const floatl left = n.here - n.left, right = n.right - n.here, up = n.here - n.above, down = n.below - n.here;
    const intl beside_upper = lower & !upper, beside_lower = upper & !lower; /* the triangle that is there */
    const floatl flat = 0.0f; /* to what is torn off */
    *slope_x = number & TO_RIGHT ? select_lanes(n.torn_right, flat, right) : select_lanes(n.torn_left, flat, left);
    *slope_y = number & TO_BELOW ? select_lanes(n.torn_below, flat, down) : select_lanes(n.torn_above, flat, up);
    if (number == TO_RIGHT) {
        *slope_x = select_lanes(beside_upper, right, select_lanes(beside_lower, n.above_right - n.above, *slope_x));
        *slope_y = select_lanes(beside_upper, n.right - n.above_right, select_lanes(beside_lower, up, *slope_y));
    } else if (number == TO_BELOW) {
        *slope_x = select_lanes(beside_upper, n.below - n.below_left, select_lanes(beside_lower, left, *slope_x));
        *slope_y = select_lanes(beside_upper, down, select_lanes(beside_lower, n.below_left - n.left, *slope_y));
    }
}

#define PIECE_OF(first, y) ((y) * ((width + piece - 1) / piece) + (first) / piece)

kernel void count_margins(global const float *surface, global int *counts, int width, int height, int pitch,
                          int piece)
{
    const int first = get_global_id(0) * piece, y = get_global_id(1);
    if (first >= width || y >= height)
        return;
    const Grid grid = GRID_OF(surface, width, height, pitch, NO_CUT);
    int count = 0;
    for (int x = first; x < min(first + piece, width); x += LANES) {
        const Around n = around_of(grid.nearness + (size_t)y * pitch + x, pitch);
        if (!any_edge(n))
            continue;
        const Parts parts = parts_of(n, x + lane_index < width);
        for (int number = 0; number < 4; number++)
            count += popcount(lane_bits(parts.lower[number] | parts.upper[number]));
    }
    counts[PIECE_OF(first, y)] = count;
}

kernel void find_margins(global const float *surface, global const int *starts, global float *margins, int width,
                         int height, int pitch, int piece, int margin_pitch)
{
    const int first = get_global_id(0) * piece, y = get_global_id(1);
    if (first >= width || y >= height)
        return;
    const Grid grid = GRID_OF(surface, width, height, pitch, NO_CUT);
    int at = starts[PIECE_OF(first, y)];
    for (int x = first; x < min(first + piece, width); x += LANES) {
        const Around n = around_of(grid.nearness + (size_t)y * pitch + x, pitch);
        if (!any_edge(n))
            continue;
        const Parts parts = parts_of(n, x + lane_index < width);
        for (int number = 0; number < 4; number++) {
            const intl lower = parts.lower[number], upper = parts.upper[number];
            uint left = lane_bits(lower | upper);
            if (!left)
                continue;
            floatl slope_x, slope_y;
            slopes_of(n, lower, upper, number, &slope_x, &slope_y);
            for (; left; left = WITHOUT_LOWEST(left), at++) {
                const int lane = LOWEST(left);
                global float *out = margins + at;
                out[MARGIN_X * margin_pitch] = x + lane;
                out[MARGIN_Y * margin_pitch] = y;
                out[MARGIN_NEARNESS * margin_pitch] = float_lane(n.here, lane);
                out[MARGIN_SLOPE_X * margin_pitch] = float_lane(slope_x, lane);
                out[MARGIN_SLOPE_Y * margin_pitch] = float_lane(slope_y, lane);
                const int in_lower = int_lane(lower, lane) ? IN_LOWER : 0, in_upper = int_lane(upper, lane) ? IN_UPPER : 0;
                out[MARGIN_BITS * margin_pitch] = as_float(number | in_lower | in_upper);
            }
        }
    }
}
