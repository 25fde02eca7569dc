/* The margins of surfaces: what no triangle covers of the pixels of samples beside depth edges.
 *
 * A sample is as large as the pixel that measured it, but at an edge the triangles of lib/surface.h end at the samples
 * themselves. There the surface goes straight on, half a pixel: of an open triangle each corner has the part that lies
 * nearest to it. Seen from a sample, that is a quarter of its pixel; or one half of a quarter, on one side of the
 * cell's diagonal, if the other half is in a triangle. Beside a triangle its plane goes on; else the slope to a neighbour of the same
 * surface, in its direction or in the opposite one; and what stands alone faces the camera.
 *
 * surface: picture/edges.cl. margins: (dst_height, dst_pitch) target nearness of the nearest margin in each pixel, EMPTY
 * before; a side that is not shown hides what lies behind it (hits.h).
 * Work-item: STRIP * LANES samples of a row. Cost: O(samples + pixels of margins). Determinism: a maximum does not depend
 * on the order of work-items.
 * Not in the paper, whose samples are all connected.
 */
#include "lib/lanes.h"
#include "lib/surface.h"
#include "warp/hits.h"

#ifndef STRIP
#define STRIP 1 /* packets of LANES samples that a work-item goes through: starting one takes longer than most */
#endif
#define MARGIN_WIDTH_MAX 256 /* target pixels: a margin is drawn no wider, as one right before the target would be */
#define HAIR 1e-3f /* pixels by which margins and triangles overlap, for rounding */

/* Samples beside edges, one a lane, and those around them */
typedef struct {
    floatl x, y, here, left, right, above, below;
    floatl above_right, below_left;
    intl torn_left, torn_right, torn_above, torn_below;
} Rim;

/* A quarter of the samples' pixels, towards (to_x, to_y): its parts on the two sides of a diagonal that are margins, and its plane */
typedef struct {
    float to_x, to_y;
    intl lower, upper;
    floatl gu, gv;
} Quarter;

INLINED Rim rim_of(Grid grid, floatl x, int y)
{
    const intl at = to_intl(x) + y * grid.pitch;
    Rim rim;
    rim.x = x;
    rim.y = y;
    rim.here = (floatl)(gather(grid.nearness, at));
    rim.left = (floatl)(gather(grid.nearness, at - 1));
    rim.right = (floatl)(gather(grid.nearness, at + 1));
    rim.above = (floatl)(gather(grid.nearness, at - grid.pitch));
    rim.below = (floatl)(gather(grid.nearness, at + grid.pitch));
    rim.above_right = (floatl)(gather(grid.nearness, at + 1 - grid.pitch));
    rim.below_left = (floatl)(gather(grid.nearness, at - 1 + grid.pitch));
    rim.torn_left = (as_intl(rim.left) & TORN_RIGHT) != 0;
    rim.torn_right = (as_intl(rim.here) & TORN_RIGHT) != 0;
    rim.torn_above = (as_intl(rim.above) & TORN_BELOW) != 0;
    rim.torn_below = (as_intl(rim.here) & TORN_BELOW) != 0;
    return rim;
}

/* The slope to a neighbour of the same surface, or that from the neighbour on the other side, which may double or
 * halve the nearness at most over a whole pixel */
INLINED floatl slope_to(floatl to_next, intl torn_next, floatl from_last, intl torn_last, floatl here)
{
    const floatl bound = fabs(here);
    const floatl beyond = select_lanes(torn_last, (floatl)0.0f, clamp_lanes(from_last, -bound, bound));
    return select_lanes(torn_next, beyond, to_next);
}

INLINED Quarter quarter_of(Rim rim, intl lower, intl upper, int number)
{
    Quarter quarter;
    quarter.to_x = number & 1 ? 0.5f : -0.5f;
    quarter.to_y = number & 2 ? 0.5f : -0.5f;
    quarter.lower = lower;
    quarter.upper = upper;
    const floatl along_left = rim.here - rim.left, along_right = rim.right - rim.here;
    const floatl along_up = rim.here - rim.above, along_down = rim.below - rim.here;
    quarter.gu = number & 1 ? slope_to(along_right, rim.torn_right, along_left, rim.torn_left, rim.here)
                            : slope_to(along_left, rim.torn_left, along_right, rim.torn_right, rim.here);
    quarter.gv = number & 2 ? slope_to(along_down, rim.torn_below, along_up, rim.torn_above, rim.here)
                            : slope_to(along_up, rim.torn_above, along_down, rim.torn_below, rim.here);
    /* Beside a triangle of the same cell: its plane */
    if (number == 1) { /* the cell above and to the right */
        quarter.gu = select_lanes(lower & !upper, along_right, select_lanes(upper & !lower, rim.above_right - rim.above, quarter.gu));
        quarter.gv = select_lanes(lower & !upper, rim.right - rim.above_right, select_lanes(upper & !lower, along_up, quarter.gv));
    }
    if (number == 2) { /* the cell below and to the left */
        quarter.gu = select_lanes(lower & !upper, rim.below - rim.below_left, select_lanes(upper & !lower, along_left, quarter.gu));
        quarter.gv = select_lanes(lower & !upper, along_down, select_lanes(upper & !lower, rim.below_left - rim.left, quarter.gv));
    }
    return quarter;
}

/* Where the target sees samples: (U, V, W) of its pixel space */
typedef struct {
    floatl u, v, w;
} Seen;

/* The pixels [left, right] x [top, bottom] around what is drawn of the quarters; `drawn` lanes have any. */
typedef struct {
    floatl left, right, top, bottom;
    intl drawn;
} Box;

INLINED Box box_of(PixelMap map, Seen seen, Quarter quarter, intl wanted)
{
    const float *D = map.dst_from_src;
    const float x = quarter.to_x, y = quarter.to_y;
    /* Pixel space changes evenly over a plane. */
    const Seen by_x = {x * (D[0] + quarter.gu * D[3]), x * (D[4] + quarter.gu * D[7]), x * (D[8] + quarter.gu * D[11])};
    const Seen by_y = {y * (D[1] + quarter.gv * D[3]), y * (D[5] + quarter.gv * D[7]), y * (D[9] + quarter.gv * D[11])};
    floatl low_u = INFINITY, low_v = INFINITY, high_u = -INFINITY, high_v = -INFINITY;
    Box box;
    box.drawn = wanted;
    UNROLLED
    for (int i = 0; i < 4; i++) {
        const float j = i & 1, k = i >> 1;
        const floatl w = seen.w + j * by_x.w + k * by_y.w, inverse = 1.0f / w;
        const floatl u = (seen.u + j * by_x.u + k * by_y.u) * inverse, v = (seen.v + j * by_x.v + k * by_y.v) * inverse;
        box.drawn = box.drawn & (w > 0.0f);
        low_u = min_lanes(u, low_u);
        high_u = max_lanes(u, high_u);
        low_v = min_lanes(v, low_v);
        high_v = max_lanes(v, high_v);
    }
    const float last_x = map.dst_width - 1, last_y = map.dst_height - 1;
    box.left = ceil_lanes(clamp_lanes(low_u - HAIR, (floatl)0.0f, (floatl)(last_x + 1.0f)));
    box.top = ceil_lanes(clamp_lanes(low_v - HAIR, (floatl)0.0f, (floatl)(last_y + 1.0f)));
    box.right = min_lanes(floor_lanes(clamp_lanes(high_u + HAIR, (floatl)-1.0f, (floatl)last_x)), box.left + MARGIN_WIDTH_MAX);
    box.bottom = min_lanes(floor_lanes(clamp_lanes(high_v + HAIR, (floatl)-1.0f, (floatl)last_y)), box.top + MARGIN_WIDTH_MAX);
    box.drawn = box.drawn & (box.left <= box.right) & (box.top <= box.bottom);
    return box;
}

/* Draws a quarter of each of the rim samples that are `wanted`. */
INLINED void draw_quarter(PixelMap map, Rim rim, Seen seen, Quarter quarter, intl wanted, int sides, global float *margins)
{
    const float *S = map.src_from_dst;
    const Box box = box_of(map, seen, quarter, wanted);
    if (!any_lane(box.drawn))
        return; /* most lie between the pixels' centres */
    const floatl per_unit = S[15] - rim.here * S[11] - quarter.gu * (S[3] - rim.x * S[11]) - quarter.gv * (S[7] - rim.y * S[11]);
    const intl drawn = box.drawn & (per_unit != 0.0f);
    const intl front_hides = sides & SHOWS_FRONT ? 0 : 1, back_hides = sides & SHOWS_BACK ? 0 : 1;
    const intl hides = select_lanes(per_unit > 0.0f, front_hides, back_hides);
    const float out_x = quarter.to_x < 0.0f ? -1.0f : 1.0f, out_y = quarter.to_y < 0.0f ? -1.0f : 1.0f;
    for (floatl row = box.top; any_lane(drawn & (row <= box.bottom)); row += 1.0f)
        for (floatl column = box.left; any_lane(drawn & (row <= box.bottom) & (column <= box.right)); column += 1.0f) {
            const floatl u = PIXEL_ROW(S, 0, column, row), v = PIXEL_ROW(S, 1, column, row);
            const floatl w = PIXEL_ROW(S, 2, column, row), q = PIXEL_ROW(S, 3, column, row);
            const floatl met = -(q - rim.here * w - quarter.gu * (u - rim.x * w) - quarter.gv * (v - rim.y * w)) / per_unit;
            const floatl w_met = w + met * S[11], inverse = 1.0f / w_met;
            const floatl du = (u + met * S[3]) * inverse - rim.x, dv = (v + met * S[7]) * inverse - rim.y;
            const floatl along_x = out_x * du, along_y = out_y * dv, across = du + dv;
            const intl in_quarter = (fabs(along_x - 0.25f) <= 0.25f + HAIR) & (fabs(along_y - 0.25f) <= 0.25f + HAIR);
            const intl in_part = (quarter.lower & (across <= HAIR)) | (quarter.upper & (across >= -HAIR));
            const intl hit = drawn & (row <= box.bottom) & (column <= box.right) & in_quarter & in_part & (w_met > 0.0f) &
                             IS_BEFORE(map.dst_perspective, met);
            const intl at = to_intl(row) * map.dst_pitch + to_intl(column), bits = as_intl(PACKED_HIT(met, hides));
            for (uint left = lane_bits(hit); left; left &= left - 1) {
                const int lane = LOWEST(left);
                put_nearest(margins + int_lane(at, lane), int_lane(bits, lane));
            }
        }
}

/* Draws the margins of a packet of rim samples. */
INLINED void draw_margins_of(PixelMap map, Grid grid, floatl x, int y, intl wanted, int sides, global float *margins)
{
    const Rim rim = rim_of(grid, x, y);
    const intl at = to_intl(x) + y * grid.pitch;
    const intl above_left = as_intl((floatl)(gather(grid.nearness, at - 1 - grid.pitch)));
    const intl diagonal = (as_intl(rim.here) & TORN_DIAGONAL) != 0;
    const intl diagonal_above = (as_intl(rim.above) & TORN_DIAGONAL) != 0, diagonal_left = (as_intl(rim.left) & TORN_DIAGONAL) != 0;
    /* What is open of the cells around, towards the sample: of those to the left and above the triangle of their last
     * corner, of the next ones two, and one of the last */
    const intl first = ((above_left & TORN_DIAGONAL) != 0) | rim.torn_above | rim.torn_left;
    const intl right_lower = (as_intl(rim.above) & TORN_ALL) != 0;
    const intl right_upper = diagonal_above | ((as_intl(rim.above_right) & TORN_BELOW) != 0) | rim.torn_right;
    const intl left_lower = (as_intl(rim.left) & TORN_ALL) != 0;
    const intl left_upper = diagonal_left | rim.torn_below | ((as_intl(rim.below_left) & TORN_RIGHT) != 0);
    const intl last = diagonal | rim.torn_right | rim.torn_below;
    const float *D = map.dst_from_src;
    const Seen seen = {MAP_ROW(D, 0, x, y, rim.here), MAP_ROW(D, 1, x, y, rim.here), MAP_ROW(D, 2, x, y, rim.here)};
    for (int number = 0; number < 4; number++) {
        const intl lower = number == 0 ? first : number == 1 ? right_lower : number == 2 ? left_lower : last;
        const intl upper = number == 0 ? first : number == 1 ? right_upper : number == 2 ? left_upper : last;
        const intl open = wanted & (lower | upper);
        if (any_lane(open))
            draw_quarter(map, rim, seen, quarter_of(rim, lower, upper, number), open, sides, margins);
    }
}

kernel void draw_margins(global const float *surface, global float *margins, PixelMap map, int sides)
{
    const int y = get_global_id(1);
    if (y >= map.src_height)
        return;
    const Grid grid = GRID_OF(surface, map.src_width, map.src_height, map.src_pitch, NO_CUT);
    /* Samples beside edges are few in most packets: they are gathered to full ones first. */
    float rim_x[(STRIP + 1) * LANES];
    int count = 0;
    for (int x0 = get_global_id(0) * STRIP * LANES, packet = 0; packet < STRIP && x0 < map.src_width; x0 += LANES, packet++) {
        global const float *own = grid.nearness + (size_t)y * map.src_pitch + x0;
        const floatl n = load_lanes(own);
        const intl before = as_intl(load_lanes(own - 1)), above = as_intl(load_lanes(own - map.src_pitch));
        const intl bits = as_intl(n) | before | above | as_intl(load_lanes(own - map.src_pitch - 1)) |
                          (as_intl(load_lanes(own - map.src_pitch + 1)) & TORN_BELOW) |
                          (as_intl(load_lanes(own + map.src_pitch - 1)) & TORN_RIGHT);
        const intl rim = ((bits & TORN_ALL) != 0) & (n > NO_SURFACE) & (x0 + lane_index < map.src_width);
        for (uint left = lane_bits(rim); left; left &= left - 1)
            rim_x[count++] = x0 + LOWEST(left);
    }
    for (int first = 0; first < count; first += LANES) {
        const intl wanted = first + lane_index < count;
        const floatl x = select_lanes(wanted, load_lanes(rim_x + first), (floatl)0.0f);
        draw_margins_of(map, grid, x, y, wanted, sides, margins);
    }
}
