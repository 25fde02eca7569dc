/* The margins of a surface (lib/margins.h) from its edges.
 *
 * Beside a triangle of the same cell its plane goes on. Else nearness changes as it does to the neighbours that are of one
 * surface with the sample, and towards those that are torn off it stays: a slope from the other side would amplify its
 * noise, and of round things it would stick out.
 *
 * surface: picture/edges.cl. count: of the quarters that there are, 0 before. margins: (MARGIN_PLANES, capacity),
 * lib/margins.h; where there are more than that, it holds no more, and they are to be found once more with room for them.
 * Work-item: `piece` samples of a row, a multiple of LANES or all; it counts its quarters and takes as many columns.
 * Cost: O(samples). Determinism: the same quarters, in any order.
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

/* The slopes of the packet's quarters of a number. Without a triangle beside them they are no more than of a surface that
 * faces the camera: a steeper one may end. */
INLINED void slopes_of(Around n, intl lower, intl upper, int number, EdgeTest test, floatl *slope_x, floatl *slope_y)
{
    const floatl left = n.here - n.left, right = n.right - n.here, up = n.here - n.above, down = n.below - n.here;
    const intl beside_upper = lower & !upper, beside_lower = upper & !lower; /* the triangle that is there */
    const floatl flat = 0.0f; /* to what is torn off */
    *slope_x = number & TO_RIGHT ? select_lanes(n.torn_right, flat, right) : select_lanes(n.torn_left, flat, left);
    *slope_y = number & TO_BELOW ? select_lanes(n.torn_below, flat, down) : select_lanes(n.torn_above, flat, up);
    const floatl scale = test.perspective ? n.here : (floatl)1.0f;
    *slope_x = clamp_lanes(*slope_x, -test.per_pixel[0] * scale, test.per_pixel[0] * scale);
    *slope_y = clamp_lanes(*slope_y, -test.per_pixel[1] * scale, test.per_pixel[1] * scale);
    if (number == TO_RIGHT) {
        *slope_x = select_lanes(beside_upper, right, select_lanes(beside_lower, n.above_right - n.above, *slope_x));
        *slope_y = select_lanes(beside_upper, n.right - n.above_right, select_lanes(beside_lower, up, *slope_y));
    } else if (number == TO_BELOW) {
        *slope_x = select_lanes(beside_upper, n.below - n.below_left, select_lanes(beside_lower, left, *slope_x));
        *slope_y = select_lanes(beside_upper, down, select_lanes(beside_lower, n.below_left - n.left, *slope_y));
    }
}

/* How many quarters the samples `first` to `end` - 1 of a row have */
OUTLINED int count_quarters(Grid grid, int first, int end, int y)
{
    int count = 0;
    for (int x = first; x < end; x += LANES) {
        const Around n = around_of(grid.nearness + (size_t)y * grid.pitch + x, grid.pitch);
        if (!any_edge(n))
            continue;
        const Parts parts = parts_of(n, x + lane_index < grid.width);
        for (int number = 0; number < 4; number++)
            count += popcount(lane_bits(parts.lower[number] | parts.upper[number]));
    }
    return count;
}

/* Writes these, from column `at` on. */
OUTLINED void write_quarters(Grid grid, int first, int end, int y, EdgeTest test, global float *margins, int at,
                             int capacity)
{
    for (int x = first; x < end; x += LANES) {
        const Around n = around_of(grid.nearness + (size_t)y * grid.pitch + x, grid.pitch);
        if (!any_edge(n))
            continue;
        const Parts parts = parts_of(n, x + lane_index < grid.width);
        for (int number = 0; number < 4; number++) {
            const intl lower = parts.lower[number], upper = parts.upper[number];
            uint left = lane_bits(lower | upper);
            if (!left)
                continue;
            floatl slope_x, slope_y;
            slopes_of(n, lower, upper, number, test, &slope_x, &slope_y);
            for (; left; left = WITHOUT_LOWEST(left), at++) {
                const int lane = LOWEST(left);
                global float *out = margins + at;
                out[MARGIN_X * capacity] = x + lane;
                out[MARGIN_Y * capacity] = y;
                out[MARGIN_NEARNESS * capacity] = float_lane(n.here, lane);
                out[MARGIN_SLOPE_X * capacity] = float_lane(slope_x, lane);
                out[MARGIN_SLOPE_Y * capacity] = float_lane(slope_y, lane);
                const int in_lower = int_lane(lower, lane) ? IN_LOWER : 0, in_upper = int_lane(upper, lane) ? IN_UPPER : 0;
                out[MARGIN_BITS * capacity] = as_float(number | in_lower | in_upper);
            }
        }
    }
}

kernel void find_margins(global const float *surface, global float *margins, global int *count, int width, int height,
                         int pitch, int piece, int capacity, EdgeTest test)
{
    const int first = get_global_id(0) * piece, y = get_global_id(1);
    if (first >= width || y >= height)
        return;
    const Grid grid = GRID_OF(surface, width, height, pitch, NO_CUT);
    const int end = min(first + piece, width), own = count_quarters(grid, first, end, y);
    if (!own)
        return;
    const int at = atomic_add((volatile global int *)count, own);
    if (at + own <= capacity)
        write_quarters(grid, first, end, y, test, margins, at, capacity);
}
