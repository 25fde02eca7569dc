/* Things too small for the sweep's lines: their pixels' own hits are put among those of the lines.
 *
 * Lines pass within half a pixel of the pixels that they settle, and resolve.cl looks for a pixel's surface only around
 * what its line and its neighbours' lines met. What is narrower may lie between the lines. In the source it stands out
 * alone: within two samples to either side, along rows or along columns, it is torn off, or it falls away across the lines
 * from a sample amid what is even, so far that the target sees them LONE_BY pixels apart, and farther than noise
 * explains. (On rough surfaces everything does; there lines meet enough.) The triangles of the cells around such samples
 * are carried over to the target.
 *
 * surface: picture/edges.cl. prominence: picture/prominence.cl. hits: (dst_height, dst_pitch) of epipolar.cl, hits.h; the
 * nearest hit of each pixel stays. least: a difference of nearness that moves nothing in the target by LONE_BY pixels.
 * Work-item: STRIP * PROMINENCE_BLOCK samples of a row. Cost: O(samples), and the pixels of what stands out alone.
 * Determinism: maxima and bits that are set do not depend on the order of work-items.
 * Not in the paper, whose pixels see what their lines see.
 */
#include "lib/prominence.h"
#include "warp/hits.h"

#define LONE_BY 4.0f  /* target pixels: more than the windows of candidates.h reach in all */
#define NARROW 4.0f   /* target pixels: lines meet a triangle that is nowhere narrower */
#define ON_LINE 2e-3f /* pixels off an edge, and its line's slope, at which a ray still may run along it */
#define HAIR_OF_EDGE 1e-3f /* pixels by which a ray may pass beside a triangle by rounding */

#define ONE_OF(mask) select_lanes(mask, (intl)1, (intl)0)

/* Which of the samples (x, y) to (x + LANES - 1, y) stand out alone in the target? */
OUTLINED intl lone_samples(Grid grid, PixelMap map, int x, int y, int sides)
{
    if (y < 0 || y >= grid.height)
        return 0;
    const Neighbours n = with_neighbours(grid, x, y);
    /* By how much nearness LONE_BY pixels are, here */
    const float *D = map.dst_from_src, *S = map.src_from_dst;
    const floatl u = to_floatl(x + lane_index), v = y, w = MAP_ROW(D, 2, u, v, n.here), inverse = 1.0f / w;
    const floatl moves_x = D[3] - D[11] * (MAP_ROW(D, 0, u, v, n.here) * inverse),
                 moves_y = D[7] - D[11] * (MAP_ROW(D, 1, u, v, n.here) * inverse);
    const floatl by = LONE_BY * w / max_lanes(fabs(moves_x), fabs(moves_y));
    const intl along_rows = fabs(u * S[11] - S[3]) >= fabs(v * S[11] - S[7]); /* the line through here */
    const Sides all = sides_of(n);
    /* Another one that stands out, or an edge, may lie on one of the sides. */
    const intl is_even = ONE_OF(all.left.change > by) + ONE_OF(all.right.change > by) + ONE_OF(all.above.change > by) +
                             ONE_OF(all.below.change > by) <= 1;
    intl lone = 0;
    for (int back = 0; back < 2; back++) {
        if (!(sides & (back ? SHOWS_BACK : SHOWS_FRONT)))
            continue;
        const floatl in_row = PROMINENCE(n.here, all.left, all.right, back);
        const floatl in_column = PROMINENCE(n.here, all.above, all.below, back);
        lone = lone | (in_row == INFINITY) | (in_column == INFINITY) |
               (is_even & (select_lanes(along_rows, in_column, in_row) >= by));
    }
    return lone & (w > 0.0f) & (u >= 0.0f) & (u < grid.width) & (n.here > NO_SURFACE);
}

/* A corner of a cell, and where the target sees it */
typedef struct {
    float x, y, q;
    float u, v, w;
} Corner;

INLINED Corner corner_at(Grid grid, PixelMap map, int x, int y)
{
    const float *D = map.dst_from_src;
    const float q = grid.nearness[y * grid.pitch + x], w = MAP_ROW(D, 2, x, y, q), inverse = 1.0f / w;
    const Corner corner = {x, y, q, MAP_ROW(D, 0, x, y, q) * inverse, MAP_ROW(D, 1, x, y, q) * inverse, w};
    return corner;
}

/* Where in a row of the target the edge from a to b runs: widens [*low, *high] to it. */
void widen(Corner a, Corner b, float row, float *low, float *high)
{
    if (a.v == b.v || row < fmin(a.v, b.v) - HAIR_OF_EDGE || row > fmax(a.v, b.v) + HAIR_OF_EDGE)
        return;
    const float u = a.u + clamp((row - a.v) / (b.v - a.v), 0.0f, 1.0f) * (b.u - a.u);
    *low = fmin(*low, u - HAIR_OF_EDGE);
    *high = fmax(*high, u + HAIR_OF_EDGE);
}

/* The hit of a pixel's ray on the triangle of a corner and the samples beside it, `to` (1 or -1) along its row and its
 * column, with these differences of nearness; EMPTY if it meets none. */
INLINED float hit_on(Corner corner, float to, float gu, float gv, Grid grid, PixelMap map, int column, int row, int *is_front)
{
    const float *S = map.src_from_dst;
    const float u = PIXEL_ROW(S, 0, column, row), v = PIXEL_ROW(S, 1, column, row), w = PIXEL_ROW(S, 2, column, row);
    const float at_start = PIXEL_ROW(S, 3, column, row) - corner.q * w - gu * (u - corner.x * w) - gv * (v - corner.y * w);
    const float per_unit = S[15] - corner.q * S[11] - gu * (S[3] - corner.x * S[11]) - gv * (S[7] - corner.y * S[11]);
    const float met = -at_start / per_unit, w_met = w + met * S[11];
    const float u_met = (u + met * S[3]) / w_met, v_met = (v + met * S[7]) / w_met;
    const float du = to * (u_met - corner.x), dv = to * (v_met - corner.y);
    const int is_met = du >= -HAIR_OF_EDGE && dv >= -HAIR_OF_EDGE && du + dv <= 1.0f + HAIR_OF_EDGE && w_met > 0.0f &&
                       IS_BEFORE(map.dst_perspective, met);
    const int on_pixels = fabs(u_met - 0.5f * (grid.width - 1)) <= 0.5f * grid.width + HAIR_OF_EDGE &&
                          fabs(v_met - 0.5f * (grid.height - 1)) <= 0.5f * grid.height + HAIR_OF_EDGE;
    *is_front = per_unit > 0.0f;
    return is_met && on_pixels ? met : EMPTY;
}

/* Puts the hits of pixels on the triangle of a corner a and the samples beside it, b along its row and c along its
 * column, among `hits`. */
OUTLINED void draw_triangle(Corner a, Corner b, Corner c, Grid grid, PixelMap map, int sides, global float *hits)
{
    const float top = fmax(fmin(a.v, fmin(b.v, c.v)) - HAIR_OF_EDGE, 0.0f);
    const float bottom = fmin(fmax(a.v, fmax(b.v, c.v)) + HAIR_OF_EDGE, map.dst_height - 1.0f);
    if (!(fmin(a.w, fmin(b.w, c.w)) > 0.0f) || !(ceil(top) <= bottom))
        return; /* most triangles pass between two rows of pixels */
    const float2 side_b = (float2)(b.u - a.u, b.v - a.v), side_c = (float2)(c.u - a.u, c.v - a.v), across = side_c - side_b;
    const float area = side_b.x * side_c.y - side_b.y * side_c.x;
    const float longest = fmax(fmax(dot(side_b, side_b), dot(side_c, side_c)), dot(across, across));
    if (!(area * area <= NARROW * NARROW * longest))
        return;
    const float to = b.x - a.x, gu = to * (b.q - a.q), gv = to * (c.q - a.q);
    const int last = convert_int_sat(floor(bottom));
    for (int row = convert_int_sat(ceil(top)); row <= last; row++) {
        float low = INFINITY, high = -INFINITY;
        widen(a, b, row, &low, &high);
        widen(b, c, row, &low, &high);
        widen(c, a, row, &low, &high);
        const int end = convert_int_sat(floor(fmin(high, map.dst_width - 1.0f)));
        for (int column = convert_int_sat(ceil(fmax(low, 0.0f))); column <= end; column++) {
            int is_front;
            const float met = hit_on(a, to, gu, gv, grid, map, column, row, &is_front);
            if (IS_HIT(met))
                put_own_hit(hits + (size_t)row * map.dst_pitch + column, met, !(sides & (is_front ? SHOWS_FRONT : SHOWS_BACK)));
        }
    }
}

/* Does the epipolar line of a sample run along the edge from it by (dx, dy)? */
INLINED int runs_along(PixelMap map, float x, float y, float dx, float dy)
{
    const float *S = map.src_from_dst, u = x * S[11] - S[3], v = y * S[11] - S[7];
    return !(fabs(u * dy - v * dx) > ON_LINE * (fabs(u) + fabs(v)));
}

/* Puts the hits of the pixels whose rays run along the edge from a to b among `hits`: they see it even if the triangles
 * beside it are open. Of other rays that pass it within a hair the hit is one more place to look. */
OUTLINED void draw_edge(Corner a, Corner b, PixelMap map, global float *hits)
{
    if (!(fmin(a.w, b.w) > 0.0f))
        return;
    const float *D = map.dst_from_src, dx = b.x - a.x, dy = b.y - a.y;
    const float du = b.u - a.u, dv = b.v - a.v, length = fmax(fabs(du), fabs(dv));
    const int is_wide = fabs(du) >= fabs(dv), size = is_wide ? map.dst_width : map.dst_height;
    const float from = is_wide ? fmin(a.u, b.u) : fmin(a.v, b.v);
    const int last = convert_int_sat(floor(fmin(from + length + HAIR_OF_EDGE, size - 1.0f)));
    for (int i = convert_int_sat(ceil(fmax(from - HAIR_OF_EDGE, 0.0f))); i <= last; i++) {
        const float part = length > 0.0f ? clamp(is_wide ? (i - a.u) / du : (i - a.v) / dv, 0.0f, 1.0f) : 0.0f;
        const float other = is_wide ? a.v + part * dv : a.u + part * du, nearest = floor(other + 0.5f);
        if (!(fabs(other - nearest) <= ON_LINE && nearest >= 0.0f && nearest < (is_wide ? map.dst_height : map.dst_width)))
            continue;
        const float there = part * a.w / (b.w + part * (a.w - b.w)); /* where in the source, from a to b */
        const float x = a.x + there * dx, y = a.y + there * dy, q = a.q + there * (b.q - a.q);
        const float met = MAP_ROW(D, 3, x, y, q) / MAP_ROW(D, 2, x, y, q);
        const int column = is_wide ? i : (int)nearest, row = is_wide ? (int)nearest : i;
        if (IS_BEFORE(map.dst_perspective, met))
            put_own_hit(hits + (size_t)row * map.dst_pitch + column, met, 0);
    }
}

/* Draws the triangles of the cell of sample (x, y), and its edges where they are open and lines run along them. */
OUTLINED void draw_cell(Grid grid, PixelMap map, int x, int y, int sides, global float *hits)
{
    global const float *sample = grid.nearness + y * grid.pitch + x;
    const int bits = as_int(sample[0]), lower_open = bits & TORN_ALL;
    const int upper_open = (bits & TORN_DIAGONAL) | (as_int(sample[1]) & TORN_BELOW) | (as_int(sample[grid.pitch]) & TORN_RIGHT);
    const int right = lower_open && !(bits & TORN_RIGHT) && runs_along(map, x, y, 1.0f, 0.0f);
    const int below = lower_open && !(bits & TORN_BELOW) && runs_along(map, x, y, 0.0f, 1.0f);
    const int diagonal = lower_open && upper_open && !(bits & TORN_DIAGONAL) && runs_along(map, x + 1, y, -1.0f, 1.0f);
    if (lower_open && upper_open && !(right | below | diagonal))
        return; /* most cells among scattered samples */
    const Corner q00 = corner_at(grid, map, x, y), q10 = corner_at(grid, map, x + 1, y);
    const Corner q01 = corner_at(grid, map, x, y + 1), q11 = corner_at(grid, map, x + 1, y + 1);
    if (!lower_open)
        draw_triangle(q00, q10, q01, grid, map, sides, hits);
    if (!upper_open)
        draw_triangle(q11, q01, q10, grid, map, sides, hits);
    if (right)
        draw_edge(q00, q10, map, hits);
    if (below)
        draw_edge(q00, q01, map, hits);
    if (diagonal)
        draw_edge(q10, q01, map, hits);
}

/* Draws the cells around those of a packet's samples that stand out alone; of several of a cell the first one does, or
 * some do again, in different packets, which changes nothing. */
OUTLINED void draw_packet(Grid grid, PixelMap map, int x, int y, int sides, global float *hits)
{
    const uint lone = lane_bits(lone_samples(grid, map, x, y, sides));
    if (!lone)
        return;
    const uint above = lane_bits(lone_samples(grid, map, x, y - 1, sides)), left = lone << 1;
    const uint drawn[4] = {left | above | above << 1, above | above >> 1, left, 0}; /* of the samples' cells, row by row */
    for (int cell = 0; cell < 4; cell++)
        for (uint wanted = lone & ~CHOSEN(drawn, cell); wanted; wanted &= wanted - 1)
            draw_cell(grid, map, x + LOWEST(wanted) - 1 + (cell & 1), y - 1 + (cell >> 1), sides, hits);
}

kernel void draw_lone(global const float *surface, global const float *prominence, global float *hits, PixelMap map,
                      int sides, float least)
{
    const int y = get_global_id(1), blocks = (map.src_width + PROMINENCE_BLOCK - 1) / PROMINENCE_BLOCK;
    if (y >= map.src_height)
        return;
    const Grid grid = GRID_OF(surface, map.src_width, map.src_height, map.src_pitch, NO_CUT);
    const int first = get_global_id(0) * STRIP, count = min(STRIP, blocks - first);
    global const float *most = prominence + 2 * ((size_t)y * blocks + first);
    /* Few blocks have any: they are found first, in a loop that is nothing but that. */
    int found[STRIP], found_count = 0;
    for (int i = 0; i < count; i++)
        if (((sides & SHOWS_FRONT) && most[2 * i] >= least) || ((sides & SHOWS_BACK) && most[2 * i + 1] >= least))
            found[found_count++] = first + i;
    for (int i = 0; i < found_count; i++) {
        const int start = found[i] * PROMINENCE_BLOCK;
        for (int x = start; x < min(start + PROMINENCE_BLOCK, grid.width); x += LANES)
            draw_packet(grid, map, x, y, sides, hits);
    }
}
