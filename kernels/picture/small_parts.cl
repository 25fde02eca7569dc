/* Finds small parts of a surface: margins (lib/margins.h), which no triangle covers, and samples that stand out from
 * their surroundings (lib/prominence.h), which epipolar lines may miss.
 *
 * If the margin's cell has a closed triangle, the margin continues this triangle's plane. Otherwise, its slope along
 * each axis leads to the neighbour on its side, and is 0 if this neighbour is torn off: a slope from the opposite side
 * would amplify noise, and give round surfaces spikes.
 *
 * surface: picture/edges.cl. noise: picture/noise.cl. count: the number of margins, initially 0. margins:
 * (MARGIN_PLANES, capacity), lib/margins.h; if `count` exceeds the capacity, some are missing, and the caller launches
 * again with more room. prominence: (height, blocks, 2) greatest prominence in each block of PROMINENCE_BLOCK samples
 * of a row, seen from the front and from the back; INFINITY if a sample is torn off on both sides, -INFINITY if noise
 * explains the prominence of all samples.
 * Work-item: `piece` samples of a row, a multiple of PROMINENCE_BLOCK, or the whole row. Cost: O(samples). Determinism:
 * the margins are the same, but in any order; blocks are independent.
 */
#include "lib/margins.h"
#include "lib/prominence.h"

#define HAS_EDGE(sample, edges) ((as_intl(sample) & (edges)) != 0) /* TORN_... */

/* A packet of samples and their neighbours */
typedef struct {
    floatl here, left, right, above, below, above_left, above_right, below_left;
    intl torn_left, torn_right, torn_above, torn_below;
} Around;

/* For each quarter of a pixel (number: sum of TO_... bits): samples with a margin in the lower, upper triangle */
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

/* A quarter is a margin where the sample's triangle in the quarter's cell is open. In the cell on the upper left, the
 * sample is the last corner and only belongs to the second triangle; in the cell on the lower right, it is the first
 * corner and only belongs to the first triangle; in the other two cells, it belongs to both. */
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

/* Tells whether any of a packet's samples lies next to a torn edge. */
INLINED int any_edge(Around n)
{
    return any_lane(((as_intl(n.here) | as_intl(n.left) | as_intl(n.above) | as_intl(n.above_left)) & TORN_ALL) |
                    (as_intl(n.above_right) & TORN_BELOW) | (as_intl(n.below_left) & TORN_RIGHT));
}

/* The slopes of the packet's margins in quarters with a given number. Unless the cell has a closed triangle, they are
 * at most as steep as surfaces that face the camera, since a steeper surface may end there. */
INLINED void slopes_of(Around n, intl lower, intl upper, int number, EdgeTest test, floatl *slope_x, floatl *slope_y)
{
    const floatl left = n.here - n.left, right = n.right - n.here, up = n.here - n.above, down = n.below - n.here;
    const intl beside_upper = lower & !upper, beside_lower = upper & !lower; /* the cell's other triangle is closed */
    const floatl flat = 0.0f; /* towards torn neighbours */
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

/* The samples' prominence from the front and from the back: the greater of those along the row and along the column */
INLINED void stand_out(Neighbours n, floatl *front, floatl *back)
{
    const intl before = as_intl(n.left_1) | as_intl(n.left_2) | as_intl(n.above_1) | as_intl(n.above_2);
    const intl after = as_intl(n.right_1) | as_intl(n.right_2) | as_intl(n.below_1) | as_intl(n.below_2);
    if (any_lane(((before | as_intl(n.here) | after) & TORN_ALL) != 0)) {
        const Sides all = sides_of(n);
        *front = max_lanes(PROMINENCE(n.here, all.left, all.right, 0), PROMINENCE(n.here, all.above, all.below, 0));
        *back = max_lanes(PROMINENCE(n.here, all.left, all.right, 1), PROMINENCE(n.here, all.above, all.below, 1));
        return;
    }
    /* In most packets, nothing is torn. */
    const floatl row_low = max_lanes(min_lanes(n.left_1, n.left_2), min_lanes(n.right_1, n.right_2));
    const floatl row_high = min_lanes(max_lanes(n.left_1, n.left_2), max_lanes(n.right_1, n.right_2));
    const floatl column_low = max_lanes(min_lanes(n.above_1, n.above_2), min_lanes(n.below_1, n.below_2));
    const floatl column_high = min_lanes(max_lanes(n.above_1, n.above_2), max_lanes(n.below_1, n.below_2));
    *front = n.here - min_lanes(row_low, column_low);
    *back = max_lanes(row_high, column_high) - n.here;
}

#define SPAN (LANES == 1 ? PROMINENCE_BLOCK : STRIP * LANES) /* samples whose margins are counted, then written */

/* Writes the margins of some packets to the columns from `at` on. packets: bit i is set to include the packet that
 * begins i * LANES samples after x0 */
OUTLINED void write_quarters(uint packets, Grid grid, int x0, int y, EdgeTest test, global float *margins, int at, int capacity)
{
    for (; packets; packets &= packets - 1) {
        const int x = x0 + LOWEST(packets) * LANES;
        const Around n = around_of(grid.nearness + (size_t)y * grid.pitch + x, grid.pitch);
        const Parts parts = parts_of(n, x + lane_index < grid.width);
        for (int number = 0; number < 4; number++) {
            const intl lower = parts.lower[number], upper = parts.upper[number];
            const uint some = lane_bits(lower | upper);
            if (!some)
                continue;
            floatl slope_x, slope_y;
            slopes_of(n, lower, upper, number, test, &slope_x, &slope_y);
            const intl bits =
                number | select_lanes(lower, (intl)IN_LOWER, (intl)0) | select_lanes(upper, (intl)IN_UPPER, (intl)0);
            store_some(to_floatl(x + lane_index), some, margins + MARGIN_X * capacity + at);
            store_some((floatl)y, some, margins + MARGIN_Y * capacity + at);
            store_some(n.here, some, margins + MARGIN_NEARNESS * capacity + at);
            store_some(slope_x, some, margins + MARGIN_SLOPE_X * capacity + at);
            store_some(slope_y, some, margins + MARGIN_SLOPE_Y * capacity + at);
            store_some(as_floatl(bits), some, margins + MARGIN_BITS * capacity + at);
            at += popcount(some);
        }
    }
}

/* The number of margins among a packet's quarters */
INLINED int count_quarters(Around n, intl wanted)
{
    const Parts parts = parts_of(n, wanted);
    int count = 0;
    for (int number = 0; number < 4; number++)
        count += popcount(lane_bits(parts.lower[number] | parts.upper[number]));
    return count;
}

/* Writes the prominence and the margins of samples `first` to `end` - 1 of row y. */
OUTLINED void look_around_row(Grid grid, int first, int end, int y, EdgeTest test, global float *prominence,
                              global float *margins, volatile global int *count, int capacity)
{
    const int blocks = (grid.width + PROMINENCE_BLOCK - 1) / PROMINENCE_BLOCK;
    global float *most = prominence + 2 * ((size_t)y * blocks + first / PROMINENCE_BLOCK);
    for (int x0 = first; x0 < end; x0 += SPAN) {
        uint with_quarters = 0;
        int quarters = 0;
        for (int block = x0; block < min(x0 + SPAN, end); block += PROMINENCE_BLOCK, most += 2) {
            floatl front = -INFINITY, back = -INFINITY;
            for (int x = block; x < min(block + PROMINENCE_BLOCK, end); x += LANES) {
                const intl wanted = x + lane_index < grid.width;
                const Around around = around_of(grid.nearness + (size_t)y * grid.pitch + x, grid.pitch);
                const int own = any_edge(around) ? count_quarters(around, wanted) : 0;
                with_quarters |= own ? 1u << (x - x0) / LANES : 0;
                quarters += own;
                const Neighbours n = with_neighbours(grid, x, y);
                floatl front_here, back_here;
                stand_out(n, &front_here, &back_here);
                const intl solid = (n.here > NO_SURFACE) & wanted;
                const floatl explained = EXPLAINED(test, n.here);
                front = select_lanes(solid & (front_here > explained), max_lanes(front_here, front), front);
                back = select_lanes(solid & (back_here > explained), max_lanes(back_here, back), back);
            }
            const int any = any_lane(max_lanes(front, back) > -INFINITY); /* 0 in most packets */
            most[0] = any ? -least_lane(-front) : -INFINITY;
            most[1] = any ? -least_lane(-back) : -INFINITY;
        }
        if (!quarters)
            continue;
        const int at = atomic_add(count, quarters);
        if (at + quarters <= capacity)
            write_quarters(with_quarters, grid, x0, y, test, margins, at, capacity);
    }
}

kernel void look_around(global const float *surface, global const float *noise, global float *prominence,
                        global float *margins, global int *count, int width, int height, int pitch, int piece, int capacity,
                        EdgeTest test)
{
    const int first = get_global_id(0) * piece, y = get_global_id(1);
    if (first >= width || y >= height)
        return;
    const Grid grid = GRID_OF(surface, width, height, pitch, NO_CUT);
    look_around_row(grid, first, min(first + piece, width), y, with_noise(test, noise), prominence, margins, count, capacity);
}
