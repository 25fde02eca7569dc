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
 * Work-item: STRIP * PROMINENCE_BLOCK cells of a row. Cost: O(samples), and the pixels of what stands out alone.
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

/* Samples, one a lane, and where the target sees them */
typedef struct {
    floatl x, y, q;
    floatl u, v, w;
} Seen;

INLINED Seen seen_at(Grid grid, PixelMap map, intl x, intl y)
{
    const float *D = map.dst_from_src;
    Seen seen;
    seen.x = to_floatl(x);
    seen.y = to_floatl(y);
    seen.q = (floatl)(gather(grid.nearness, y * grid.pitch + x));
    seen.w = MAP_ROW(D, 2, seen.x, seen.y, seen.q);
    const floatl inverse = 1.0f / seen.w;
    seen.u = MAP_ROW(D, 0, seen.x, seen.y, seen.q) * inverse;
    seen.v = MAP_ROW(D, 1, seen.x, seen.y, seen.q) * inverse;
    return seen;
}

/* Where in rows of the target the edges from a to b run: widens [*low, *high] to it. */
INLINED void widen(Seen a, Seen b, floatl row, floatl *low, floatl *high)
{
    const intl passes = (a.v != b.v) & (row >= min_lanes(a.v, b.v) - HAIR_OF_EDGE) &
                        (row <= max_lanes(a.v, b.v) + HAIR_OF_EDGE);
    const floatl u = a.u + clamp_lanes((row - a.v) / (b.v - a.v), (floatl)0.0f, (floatl)1.0f) * (b.u - a.u);
    *low = select_lanes(passes, min_lanes(*low, u - HAIR_OF_EDGE), *low);
    *high = select_lanes(passes, max_lanes(*high, u + HAIR_OF_EDGE), *high);
}

/* Puts the own hits of pixels that `meet` something among `hits`. */
INLINED void put_own_hits(intl meet, floatl column, floatl row, floatl met, intl hides, PixelMap map, global float *hits)
{
    const intl pixel = to_intl(row) * map.dst_pitch + to_intl(column);
    for (uint left = lane_bits(meet); left; left = WITHOUT_LOWEST(left)) {
        const int lane = LOWEST(left);
        put_own_hit(hits + int_lane(pixel, lane), float_lane(met, lane), int_lane(hides, lane));
    }
}

/* Triangles, one a lane: the corners whose samples beside them, `to` (1 or -1) along row and column, are the others */
typedef struct {
    int x[LANES], y[LANES], to[LANES];
    int count;
} LonePacket;

/* Puts the hits of pixels on triangles among `hits`. */
OUTLINED void draw_triangles(LonePacket *triangles, Grid grid, PixelMap map, int sides, global float *hits)
{
    const float *S = map.src_from_dst;
    const intl wanted = lane_index < triangles->count;
    const intl x = select_lanes(wanted, (intl)load_lanes(triangles->x), (intl)0);
    const intl y = select_lanes(wanted, (intl)load_lanes(triangles->y), (intl)0);
    const intl step = select_lanes(wanted, (intl)load_lanes(triangles->to), (intl)1);
    const Seen a = seen_at(grid, map, x, y), b = seen_at(grid, map, x + step, y), c = seen_at(grid, map, x, y + step);
    triangles->count = 0;
    const floatl low_v = min_lanes(a.v, min_lanes(b.v, c.v)), high_v = max_lanes(a.v, max_lanes(b.v, c.v));
    const floatl top = ceil_lanes(clamp_lanes(low_v - HAIR_OF_EDGE, (floatl)0.0f, (floatl)map.dst_height));
    const floatl bottom = min_lanes(high_v + HAIR_OF_EDGE, (floatl)(map.dst_height - 1.0f));
    const floatl b_u = b.u - a.u, b_v = b.v - a.v, c_u = c.u - a.u, c_v = c.v - a.v, area = b_u * c_v - b_v * c_u;
    const floatl across = (c_u - b_u) * (c_u - b_u) + (c_v - b_v) * (c_v - b_v);
    const floatl longest = max_lanes(max_lanes(b_u * b_u + b_v * b_v, c_u * c_u + c_v * c_v), across);
    const intl drawn = wanted & (min_lanes(a.w, min_lanes(b.w, c.w)) > 0.0f) & (area * area <= NARROW * NARROW * longest);
    const floatl to = to_floatl(step), gu = to * (b.q - a.q), gv = to * (c.q - a.q);
    const floatl per_unit = S[15] - a.q * S[11] - gu * (S[3] - a.x * S[11]) - gv * (S[7] - a.y * S[11]);
    const intl hides = select_lanes(per_unit > 0.0f, (intl)(sides & SHOWS_FRONT ? 0 : 1), (intl)(sides & SHOWS_BACK ? 0 : 1));
    for (floatl row = top; any_lane(drawn & (row <= bottom)); row += 1.0f) {
        floatl low = INFINITY, high = -INFINITY;
        widen(a, b, row, &low, &high);
        widen(b, c, row, &low, &high);
        widen(c, a, row, &low, &high);
        high = select_lanes(drawn & (row <= bottom), min_lanes(high, (floatl)(map.dst_width - 1.0f)), (floatl)-1.0f);
        floatl column = ceil_lanes(clamp_lanes(low, (floatl)0.0f, (floatl)map.dst_width));
        for (; any_lane(column <= high); column += 1.0f) {
            const floatl u = PIXEL_ROW(S, 0, column, row), v = PIXEL_ROW(S, 1, column, row), w = PIXEL_ROW(S, 2, column, row);
            const floatl at_start = PIXEL_ROW(S, 3, column, row) - a.q * w - gu * (u - a.x * w) - gv * (v - a.y * w);
            const floatl met = -at_start / per_unit, w_met = w + met * S[11];
            const floatl u_met = (u + met * S[3]) / w_met, v_met = (v + met * S[7]) / w_met;
            const floatl du = to * (u_met - a.x), dv = to * (v_met - a.y);
            const intl is_met = (du >= -HAIR_OF_EDGE) & (dv >= -HAIR_OF_EDGE) & (du + dv <= 1.0f + HAIR_OF_EDGE) &
                                (w_met > 0.0f) & IS_BEFORE(map.dst_perspective, met);
            const intl on_pixels = (fabs(u_met - 0.5f * (grid.width - 1)) <= 0.5f * grid.width + HAIR_OF_EDGE) &
                                   (fabs(v_met - 0.5f * (grid.height - 1)) <= 0.5f * grid.height + HAIR_OF_EDGE);
            put_own_hits((column <= high) & is_met & on_pixels & IS_HIT(met), column, row, met, hides, map, hits);
        }
    }
}

/* Do the epipolar lines of samples run along the edges from them by (dx, dy)? */
INLINED intl run_along(PixelMap map, floatl x, floatl y, float dx, float dy)
{
    const float *S = map.src_from_dst;
    const floatl u = x * S[11] - S[3], v = y * S[11] - S[7];
    return fabs(u * dy - v * dx) <= ON_LINE * (fabs(u) + fabs(v));
}

/* Puts the hits of the pixels whose rays run along the edges from samples (x, y) by (dx, dy) among `hits`: they see these
 * even if the triangles beside them are open. Of other rays that pass an edge within a hair the hit is one more place to
 * look. */
OUTLINED void draw_edges(Grid grid, PixelMap map, intl x, intl y, int dx, int dy, intl wanted, global float *hits)
{
    const float *D = map.dst_from_src;
    x = select_lanes(wanted, x, (intl)0);
    const Seen a = seen_at(grid, map, x, y), b = seen_at(grid, map, x + dx, y + dy);
    const floatl du = b.u - a.u, dv = b.v - a.v, length = max_lanes(fabs(du), fabs(dv));
    const intl is_wide = fabs(du) >= fabs(dv), drawn = wanted & (min_lanes(a.w, b.w) > 0.0f);
    const floatl size = select_lanes(is_wide, (floatl)map.dst_width, (floatl)map.dst_height);
    const floatl other_size = select_lanes(is_wide, (floatl)map.dst_height, (floatl)map.dst_width);
    const floatl from = select_lanes(is_wide, min_lanes(a.u, b.u), min_lanes(a.v, b.v));
    const floatl last = select_lanes(drawn, min_lanes(from + length + HAIR_OF_EDGE, size - 1.0f), (floatl)-1.0f);
    for (floatl i = ceil_lanes(clamp_lanes(from - HAIR_OF_EDGE, (floatl)0.0f, size)); any_lane(i <= last); i += 1.0f) {
        const floatl along = select_lanes(is_wide, (i - a.u) / du, (i - a.v) / dv);
        const floatl part = select_lanes(length > 0.0f, clamp_lanes(along, (floatl)0.0f, (floatl)1.0f), (floatl)0.0f);
        const floatl other = select_lanes(is_wide, a.v + part * dv, a.u + part * du);
        const floatl nearest = floor_lanes(clamp_lanes(other + 0.5f, (floatl)-1.0f, other_size));
        const intl passes = (i <= last) & (fabs(other - nearest) <= ON_LINE) & (nearest >= 0.0f) & (nearest < other_size);
        const floatl there = part * a.w / (b.w + part * (a.w - b.w)); /* where in the source, from a to b */
        const floatl u = a.x + there * dx, v = a.y + there * dy, q = a.q + there * (b.q - a.q);
        const floatl met = MAP_ROW(D, 3, u, v, q) / MAP_ROW(D, 2, u, v, q);
        put_own_hits(passes & IS_BEFORE(map.dst_perspective, met), select_lanes(is_wide, i, nearest),
                     select_lanes(is_wide, nearest, i), met, (intl)0, map, hits);
    }
}

/* Adds the triangles of the wanted of LANES corners from (x, y) on, and draws them by packets. */
INLINED void add_triangles(LonePacket *triangles, int x, int y, int to, intl wanted, Grid grid, PixelMap map, int sides,
                           global float *hits)
{
    for (uint left = lane_bits(wanted); left; left = WITHOUT_LOWEST(left)) {
        const int i = LANES == 1 ? 0 : triangles->count; /* GPUs keep it in registers */
        triangles->x[i] = x + LOWEST(left);
        triangles->y[i] = y;
        triangles->to[i] = to;
        if (++triangles->count == LANES)
            draw_triangles(triangles, grid, map, sides, hits);
    }
}

/* Draws those of LANES cells from that of sample (x, y) on that have a bit: their triangles, and where these are open the
 * edges that lines run along. */
OUTLINED void draw_cells(LonePacket *triangles, Grid grid, PixelMap map, int x, int y, uint cells, int sides, global float *hits)
{
    global const float *samples = grid.nearness + y * grid.pitch + x;
    const floatl q00 = load_lanes(samples), q10 = load_lanes(samples + 1), q01 = load_lanes(samples + grid.pitch);
    const intl wanted = (((intl)(int)cells >> lane_index) & 1) != 0;
    const intl lower = wanted & IS_LOWER_OPEN(q00), upper = wanted & IS_UPPER_OPEN(q00, q10, q01);
    add_triangles(triangles, x, y, 1, wanted & !lower, grid, map, sides, hits);
    add_triangles(triangles, x + 1, y + 1, -1, wanted & !upper, grid, map, sides, hits);
    const intl bits = as_intl(q00), columns = x + lane_index;
    const floatl u = to_floatl(columns);
    const intl right = lower & ((bits & TORN_RIGHT) == 0) & run_along(map, u, y, 1.0f, 0.0f);
    const intl below = lower & ((bits & TORN_BELOW) == 0) & run_along(map, u, y, 0.0f, 1.0f);
    const intl diagonal = lower & upper & ((bits & TORN_DIAGONAL) == 0) & run_along(map, u + 1.0f, y, -1.0f, 1.0f);
    if (any_lane(right))
        draw_edges(grid, map, columns, y, 1, 0, right, hits);
    if (any_lane(below))
        draw_edges(grid, map, columns, y, 0, 1, below, hits);
    if (any_lane(diagonal))
        draw_edges(grid, map, columns + 1, y, -1, 1, diagonal, hits);
}

/* Does anything of a block of samples stand out by at least that much? */
INLINED int stands_out(global const float *prominence, int block, int blocks, int y, int height, int sides, float least)
{
    if (y < 0 || y >= height)
        return 0;
    global const float *most = prominence + 2 * ((size_t)y * blocks + block);
    return ((sides & SHOWS_FRONT) && most[0] >= least) || ((sides & SHOWS_BACK) && most[1] >= least);
}

kernel void draw_lone(global const float *surface, global const float *prominence, global float *hits, PixelMap map,
                      int sides, float least)
{
    const int y = (int)get_global_id(1) - 1; /* of the cells, which are between the samples of two rows */
    const int blocks = (map.src_width + PROMINENCE_BLOCK - 1) / PROMINENCE_BLOCK;
    const int first = get_global_id(0) * STRIP, end = min(first + STRIP, blocks);
    if (y >= map.src_height)
        return;
    const Grid grid = GRID_OF(surface, map.src_width, map.src_height, map.src_pitch, NO_CUT);
    LonePacket triangles;
    triangles.count = 0;
    uint before = 0; /* whether the sample before a packet stands out alone */
    for (int block = first; block < end; block++) {
        const int above = stands_out(prominence, block, blocks, y, grid.height, sides, least);
        const int below = stands_out(prominence, block, blocks, y + 1, grid.height, sides, least);
        const int start = block * PROMINENCE_BLOCK;
        for (int x = start; (above | below | before) && x < min(start + PROMINENCE_BLOCK, grid.width); x += LANES) {
            const uint lone = (above ? lane_bits(lone_samples(grid, map, x, y, sides)) : 0) |
                              (below ? lane_bits(lone_samples(grid, map, x, y + 1, sides)) : 0);
            if (lone | before)
                draw_cells(&triangles, grid, map, x - 1, y, lone | lone << 1 | before, sides, hits);
            before = lone >> (LANES - 1);
        }
    }
    if (before)
        draw_cells(&triangles, grid, map, min(end * PROMINENCE_BLOCK, grid.width) - 1, y, 1, sides, hits);
    if (triangles.count)
        draw_triangles(&triangles, grid, map, sides, hits);
}
