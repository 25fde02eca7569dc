/* Draws small patches of planes: margins, which no triangle covers, and triangles that the sweep's lines may miss.
 *
 * Margins (lib/margins.h) are met by the pixels' own rays, not by the sweep's lines. Hits on margins are stored in a
 * second plane of `hits`.
 *
 * Lines pass within half a pixel of the pixels that they settle, and resolve.cl looks for a pixel's surface only around
 * the hits of its line and of its neighbours' lines. A narrow piece of surface may lie between the lines. In the
 * source, the samples of such a piece are isolated in their row or their column: on both sides, within two samples, the
 * surface is torn or falls back. A fall only counts if it runs across the epipolar lines on an even surface, exceeds
 * the noise, and moves the samples LONE_BY pixels apart in the target. (On a rough surface every sample stands out, and
 * the lines meet enough of them.) The triangles around isolated samples are drawn into the lines' hits.
 *
 * surface: picture/edges.cl. prominence: picture/small_parts.cl. margins: (MARGIN_PLANES, margin_pitch), lib/margins.h;
 * count: their number.
 * hits: (dst_height, dst_pitch) of epipolar.cl, hits.h; the nearest hit of each pixel stays. The plane of hits on
 * margins begins `plane` values later and is EMPTY at first; a side that is not shown blocks the view. least:
 * the prominence (lib/prominence.h) below which no sample moves by LONE_BY pixels in the target.
 * Work-item: STRIP * PROMINENCE_BLOCK cells of a row (the first `lone_items` work-items); STRIP * LANES margins (the
 * others). Cost: O(samples + margins + drawn pixels). Determinism: maxima and set bits do not depend on the order of
 * work-items. In the paper there are no patches: all samples are connected, and pixels take the hits of their lines.
 */
#include "lib/margins.h"
#include "lib/prominence.h"
#include "warp/trace.h"

#define LONE_BY 4.0f  /* target pixels: farther than all windows of candidates.h together reach */
#define NARROW 4.0f   /* target pixels: lines meet all triangles that are at least this wide */
#define ON_LINE 2e-3f /* a ray runs along an edge if it is at most this far off: in target pixels, and in slope */
#define HAIR 1e-3f    /* pixels by which patches overlap their neighbours, against rounding */
#define PATCH_WIDTH_MAX 256.0f /* target pixels: greatest size of a drawn margin */

/* Patches, one for each lane. A patch is a square of a plane, or half of the square. The square extends `reach` samples
 * from its sample in the directions to_x, to_y (1 or -1). It is halved by the diagonal on which the offsets from the
 * sample add up to `diagonal`. lower: the patch contains the half on the upper left; upper: on the lower right. */
typedef struct {
    Plane plane;
    floatl to_x, to_y, diagonal;
    intl lower, upper;
    float reach;
} Patches;

/* Points of the source, one for each lane, in the target: pixel (u, v), and the homogeneous component w */
typedef struct {
    floatl u, v, w;
} Seen;

INLINED Seen seen_at(PixelMap map, floatl x, floatl y, floatl n)
{
    const float *D = map.dst_from_src;
    Seen seen;
    seen.w = MAP_ROW(D, 2, x, y, n);
    const floatl inverse = 1.0f / seen.w;
    seen.u = MAP_ROW(D, 0, x, y, n) * inverse;
    seen.v = MAP_ROW(D, 1, x, y, n) * inverse;
    return seen;
}

/* Widens [*low, *high] to contain the columns at which the edges from a to b are within `hair` pixels of the rows. */
INLINED void widen(Seen a, Seen b, floatl row, floatl hair, floatl *low, floatl *high)
{
    const intl passes = (row >= min_lanes(a.v, b.v) - hair) & (row <= max_lanes(a.v, b.v) + hair);
    const floatl zero = 0.0f, one = 1.0f, per_row = 1.0f / (b.v - a.v), to_u = b.u - a.u;
    /* On level edges, the divisions give NaN, which clamp_lanes turns into 0: the adjoining edges then give the
     * ends. */
    const floatl above = a.u + clamp_lanes((row - hair - a.v) * per_row, zero, one) * to_u;
    const floatl below = a.u + clamp_lanes((row + hair - a.v) * per_row, zero, one) * to_u;
    *low = select_lanes(passes, min_lanes(*low, min_lanes(above, below) - hair), *low);
    *high = select_lanes(passes, max_lanes(*high, max_lanes(above, below) + hair), *high);
}

/* Stores the hits `met` of the pixels' own rays, for the pixels in the mask `meet`. */
INLINED void put_own_hits(intl meet, floatl column, floatl row, floatl met, intl hides, PixelMap map, global float *hits)
{
    const intl pixel = to_intl(row) * map.dst_pitch + to_intl(column);
    for (uint left = lane_bits(meet); left; left = WITHOUT_LOWEST(left)) {
        const int lane = LOWEST(left);
        put_own_hit(hits + int_lane(pixel, lane), float_lane(met, lane), int_lane(hides, lane));
    }
}

INLINED void put_hits(intl meet, floatl column, floatl row, floatl packed, PixelMap map, global float *hits)
{
    const intl pixel = to_intl(row) * map.dst_pitch + to_intl(column), bits = as_intl(packed);
    for (uint left = lane_bits(meet); left; left = WITHOUT_LOWEST(left))
        put_nearest(hits + int_lane(pixel, LOWEST(left)), int_lane(bits, LOWEST(left)));
}

/* Draws the wanted patches, each with four corners. Hits on triangles are marked as hits of the pixels' own rays
 * (OWN_RAY); hits on margins need no mark. */
OUTLINED void draw_packet(Patches at, const Seen *corners, floatl hair, intl wanted, Grid grid, PixelMap map, int sides,
                          int are_margins, global float *hits)
{
    floatl low_v = INFINITY, high_v = -INFINITY, per_unit;
    intersect_plane(rays_of(map, 0.0f, 0.0f), at.plane, &per_unit);
    const intl hides = select_lanes(per_unit > 0.0f, (intl)(sides & SHOWS_FRONT ? 0 : 1), (intl)(sides & SHOWS_BACK ? 0 : 1));
    intl drawn = wanted & (per_unit != 0.0f);
    UNROLLED
    for (int i = 0; i < 4; i++) {
        drawn = drawn & (corners[i].w > 0.0f);
        low_v = min_lanes(corners[i].v, low_v);
        high_v = max_lanes(corners[i].v, high_v);
    }
    const float last_x = map.dst_width - 1, last_y = map.dst_height - 1, widest = are_margins ? PATCH_WIDTH_MAX : INFINITY;
    const floatl top = ceil_lanes(clamp_lanes(low_v - hair, (floatl)0.0f, (floatl)(last_y + 1.0f)));
    const floatl bottom = min_lanes(min_lanes(high_v + hair, (floatl)last_y), top + widest);
    for (floatl row = top; any_lane(drawn & (row <= bottom)); row += 1.0f) {
        floatl low = INFINITY, high = -INFINITY;
        UNROLLED
        for (int i = 0; i < 4; i++)
            widen(corners[i], corners[(i + 1) & 3], row, hair, &low, &high);
        high = min_lanes(min_lanes(high, (floatl)last_x), low + widest);
        high = select_lanes(drawn & (row <= bottom), high, (floatl)-1.0f);
        floatl column = ceil_lanes(clamp_lanes(low, (floatl)0.0f, (floatl)(last_x + 1.0f)));
        for (; any_lane(column <= high); column += 1.0f) {
            const Rays rays = rays_of(map, column, row);
            const floatl met = intersect_plane(rays, at.plane, &per_unit);
            const floatl w = rays.w + met * rays.centre.z, inverse = 1.0f / w;
            const floatl u = (rays.u + met * rays.centre.x) * inverse, v = (rays.v + met * rays.centre.y) * inverse;
            const floatl du = u - at.plane.x, dv = v - at.plane.y, half_ = 0.5f * at.reach;
            const intl in_square = (fabs(at.to_x * du - half_) <= half_ + HAIR) & (fabs(at.to_y * dv - half_) <= half_ + HAIR);
            const intl in_part = (at.lower & (du + dv <= at.diagonal + HAIR)) | (at.upper & (du + dv >= at.diagonal - HAIR));
            const intl is_met =
                (column <= high) & in_square & in_part & (w > 0.0f) & IS_BEFORE(map.dst_perspective, met);
            if (are_margins) {
                put_hits(is_met, column, row, PACKED_HIT(met, hides), map, hits);
                continue;
            }
            const intl on_pixels = (fabs(u - 0.5f * (grid.width - 1)) <= 0.5f * grid.width + HAIR) &
                                   (fabs(v - 0.5f * (grid.height - 1)) <= 0.5f * grid.height + HAIR);
            put_own_hits(is_met & on_pixels, column, row, met, hides, map, hits);
        }
    }
}

/* Draws LANES margins, except margins outside of the mask `wanted`. */
OUTLINED void draw_margins(global const float *margins, int pitch, intl wanted, Grid grid, PixelMap map, int sides,
                           global float *hits)
{
    const intl bits = as_intl(load_lanes(margins + MARGIN_BITS * pitch));
    const floatl x = load_lanes(margins + MARGIN_X * pitch), y = load_lanes(margins + MARGIN_Y * pitch);
    const floatl n = load_lanes(margins + MARGIN_NEARNESS * pitch);
    const floatl gu = load_lanes(margins + MARGIN_SLOPE_X * pitch), gv = load_lanes(margins + MARGIN_SLOPE_Y * pitch);
    const floatl to_x = select_lanes((bits & TO_RIGHT) != 0, (floatl)1.0f, (floatl)-1.0f);
    const floatl to_y = select_lanes((bits & TO_BELOW) != 0, (floatl)1.0f, (floatl)-1.0f);
    const Patches at = {{n, gu, gv, x, y}, to_x, to_y, 0.0f, (bits & IN_LOWER) != 0, (bits & IN_UPPER) != 0, 0.5f};
    const floatl dx = 0.5f * to_x, dy = 0.5f * to_y, n_x = n + gu * dx, n_y = n + gv * dy;
    const Seen corners[4] = {seen_at(map, x, y, n), seen_at(map, x + dx, y, n_x), seen_at(map, x + dx, y + dy, n_x + gv * dy),
                             seen_at(map, x, y + dy, n_y)};
    const floatl side_x = max_lanes(fabs(corners[1].u - corners[0].u), fabs(corners[1].v - corners[0].v));
    const floatl side_y = max_lanes(fabs(corners[3].u - corners[0].u), fabs(corners[3].v - corners[0].v));
    /* HAIR pixels of the source, or HAIR pixels of the target if these are larger */
    draw_packet(at, corners, HAIR * max_lanes(2.0f * max_lanes(side_x, side_y), (floatl)1.0f), wanted, grid, map, sides, 1,
                hits);
}

#define ONE_OF(mask) select_lanes(mask, (intl)1, (intl)0)

/* The mask of the samples from (x, y) to (x + LANES - 1, y) that are isolated */
OUTLINED intl lone_samples(Grid grid, PixelMap map, int x, int y, int sides)
{
    const Neighbours n = with_neighbours(grid, x, y);
    /* The difference of nearness that moves these samples by LONE_BY target pixels */
    const float *D = map.dst_from_src, *S = map.src_from_dst;
    const floatl u = to_floatl(x + lane_index), v = y, w = MAP_ROW(D, 2, u, v, n.here), inverse = 1.0f / w;
    const floatl moves_x = D[3] - D[11] * (MAP_ROW(D, 0, u, v, n.here) * inverse),
                 moves_y = D[7] - D[11] * (MAP_ROW(D, 1, u, v, n.here) * inverse);
    const floatl by = LONE_BY * w / max_lanes(fabs(moves_x), fabs(moves_y));
    const intl along_rows = fabs(u * S[11] - S[3]) >= fabs(v * S[11] - S[7]); /* mask for the epipolar lines */
    const Sides all = sides_of(n);
    /* The surface is even if at most one of the four sides is uneven: another isolated sample may lie there. */
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

/* Triangles, one for each lane. The corners are sample (x, y) and its next samples in the row and in the column, in
 * direction `to` (1: right and below; -1: left and above). */
typedef struct {
    int x[LANES], y[LANES], to[LANES];
    int count;
} LonePacket;

OUTLINED void draw_triangles(LonePacket *triangles, Grid grid, PixelMap map, int sides, global float *hits)
{
    const intl wanted = lane_index < triangles->count;
    const intl x = select_lanes(wanted, (intl)load_lanes(triangles->x), (intl)0);
    const intl y = select_lanes(wanted, (intl)load_lanes(triangles->y), (intl)0);
    const intl step = select_lanes(wanted, (intl)load_lanes(triangles->to), (intl)1), at_corner = y * grid.pitch + x;
    triangles->count = 0;
    const floatl q = (floatl)(gather(grid.nearness, at_corner)), q_x = (floatl)(gather(grid.nearness, at_corner + step));
    const floatl q_y = (floatl)(gather(grid.nearness, at_corner + step * grid.pitch));
    const floatl u = to_floatl(x), v = to_floatl(y), to = to_floatl(step);
    const Patches at = {{q, to * (q_x - q), to * (q_y - q), u, v}, to, to, to, step > 0, step < 0, 1.0f};
    const Seen a = seen_at(map, u, v, q), b = seen_at(map, u + to, v, q_x), c = seen_at(map, u, v + to, q_y);
    const Seen corners[4] = {a, b, c, c};
    const floatl b_u = b.u - a.u, b_v = b.v - a.v, c_u = c.u - a.u, c_v = c.v - a.v, area = b_u * c_v - b_v * c_u;
    const floatl across = (c_u - b_u) * (c_u - b_u) + (c_v - b_v) * (c_v - b_v);
    const floatl longest = max_lanes(max_lanes(b_u * b_u + b_v * b_v, c_u * c_u + c_v * c_v), across);
    const intl is_narrow = area * area <= NARROW * NARROW * longest;
    draw_packet(at, corners, HAIR, wanted & is_narrow, grid, map, sides, 0, hits);
}

/* Does the epipolar line through sample (x, y) run along the edge from this sample to (x + dx, y + dy)? */
INLINED intl run_along(PixelMap map, floatl x, floatl y, float dx, float dy)
{
    const float *S = map.src_from_dst;
    const floatl u = x * S[11] - S[3], v = y * S[11] - S[7];
    return fabs(u * dy - v * dx) <= ON_LINE * (fabs(u) + fabs(v));
}

/* Stores hits on the edges from samples (x, y) to (x + dx, y + dy), for pixels whose rays run along these edges. Such
 * rays see the edges even if the triangles on both sides are open. If a ray only passes close to an edge, resolve.cl
 * takes the hit as one more place to trace. */
OUTLINED void draw_edges(Grid grid, PixelMap map, intl x, intl y, int dx, int dy, intl wanted, global float *hits)
{
    const float *D = map.dst_from_src;
    x = select_lanes(wanted, x, (intl)0);
    const intl at = y * grid.pitch + x;
    const floatl q = (floatl)(gather(grid.nearness, at)), q_to = (floatl)(gather(grid.nearness, at + dy * grid.pitch + dx));
    const floatl a_x = to_floatl(x), a_y = to_floatl(y);
    const Seen a = seen_at(map, a_x, a_y, q), b = seen_at(map, a_x + dx, a_y + dy, q_to);
    const floatl du = b.u - a.u, dv = b.v - a.v, length = max_lanes(fabs(du), fabs(dv));
    const intl is_wide = fabs(du) >= fabs(dv), drawn = wanted & (min_lanes(a.w, b.w) > 0.0f);
    const floatl size = select_lanes(is_wide, (floatl)map.dst_width, (floatl)map.dst_height);
    const floatl other_size = select_lanes(is_wide, (floatl)map.dst_height, (floatl)map.dst_width);
    const floatl from = select_lanes(is_wide, min_lanes(a.u, b.u), min_lanes(a.v, b.v));
    const floatl last = select_lanes(drawn, min_lanes(from + length + HAIR, size - 1.0f), (floatl)-1.0f);
    for (floatl i = ceil_lanes(clamp_lanes(from - HAIR, (floatl)0.0f, size)); any_lane(i <= last); i += 1.0f) {
        const floatl along = select_lanes(is_wide, (i - a.u) / du, (i - a.v) / dv);
        const floatl part = select_lanes(length > 0.0f, clamp_lanes(along, (floatl)0.0f, (floatl)1.0f), (floatl)0.0f);
        const floatl other = select_lanes(is_wide, a.v + part * dv, a.u + part * du);
        const floatl nearest = floor_lanes(clamp_lanes(other + 0.5f, (floatl)-1.0f, other_size));
        const intl passes = (i <= last) & (fabs(other - nearest) <= ON_LINE) & (nearest >= 0.0f) & (nearest < other_size);
        const floatl there = part * a.w / (b.w + part * (a.w - b.w)); /* place on the source's edge: 0 at a, 1 at b */
        const floatl u = a_x + there * dx, v = a_y + there * dy, n = q + there * (q_to - q);
        const floatl met = MAP_ROW(D, 3, u, v, n) / MAP_ROW(D, 2, u, v, n);
        put_own_hits(passes & IS_BEFORE(map.dst_perspective, met), select_lanes(is_wide, i, nearest),
                     select_lanes(is_wide, nearest, i), met, (intl)0, map, hits);
    }
}

/* Adds the triangles whose first corner is one of LANES samples from (x, y) on and is wanted; draws each full
 * packet. */
INLINED void add_triangles(LonePacket *triangles, int x, int y, int to, intl wanted, Grid grid, PixelMap map, int sides,
                           global float *hits)
{
    for (uint left = lane_bits(wanted); left; left = WITHOUT_LOWEST(left)) {
        const int i = LANES == 1 ? 0 : triangles->count; /* GPUs keep the arrays in registers */
        triangles->x[i] = x + LOWEST(left);
        triangles->y[i] = y;
        triangles->to[i] = to;
        if (++triangles->count == LANES)
            draw_triangles(triangles, grid, map, sides, hits);
    }
}

/* Draws cells of the row, from sample (x, y) on, if their bit in `cells` is set: their triangles and, on open
 * triangles, the edges that run along epipolar lines. */
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

/* Does any sample of a block stand out by `least` or more? */
INLINED int stands_out(global const float *prominence, int block, int blocks, int y, int height, int sides, float least)
{
    if (y < 0 || y >= height)
        return 0;
    global const float *most = prominence + 2 * ((size_t)y * blocks + block);
    return ((sides & SHOWS_FRONT) && most[0] >= least) || ((sides & SHOWS_BACK) && most[1] >= least);
}

/* Draws the cells around isolated samples in STRIP blocks of the row of cells between the samples' rows y and y + 1. */
OUTLINED void draw_lone(Grid grid, global const float *prominence, int first, int y, global float *hits, PixelMap map,
                        int sides, float least)
{
    const int blocks = (grid.width + PROMINENCE_BLOCK - 1) / PROMINENCE_BLOCK, end = min(first + STRIP, blocks);
    LonePacket triangles;
    triangles.count = 0;
    uint before = 0; /* whether the sample before a packet is isolated */
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

kernel void draw_patches(global const float *surface, global const float *prominence, global const float *margins,
                         global float *hits, PixelMap map, int sides, float least, int lone_items, int count,
                         int margin_pitch, int plane)
{
    const Grid grid = GRID_OF(surface, map.src_width, map.src_height, map.src_pitch, NO_CUT);
    const int item = get_global_id(0), first = (item - lone_items) * STRIP * LANES, rows = map.src_height + 1;
    if (item < lone_items)
        draw_lone(grid, prominence, item / rows * STRIP, item % rows - 1, hits, map, sides, least);
    else
        for (int i = first; i < min(first + STRIP * LANES, count); i += LANES)
            draw_margins(margins + i, margin_pitch, i + lane_index < count, grid, map, sides, hits + plane);
}
