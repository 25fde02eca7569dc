/* Surfaces as large as the pixels that measured them, at depth edges, too: the squares of the samples there are drawn.
 *
 * At an edge the surface of lib/surface.h ends at the last samples, half a pixel before what they measured does: things one
 * sample thin are not there at all, and what is behind them shows. `rims` carries the pixels of all samples next to an
 * opening over to the target, as squares at their own depth; the nearest one stays. `add_rims` writes them where the
 * target shows nothing, or what they are torn apart from. surface: picture/edges.cl. keys: (dst_height, dst_width) nearness as warp/keys.h orders it, 0 where there is no rim. depth, valid:
 * (dst_height, dst_width). Work-item: STRIP * LANES samples, or pixels, of a row. Cost: O(samples + pixels of rims).
 * Determinism: a maximum does not depend on the order of work-items.
 */
#include "lib/lanes.h"
#include "lib/surface.h"
#include "warp/keys.h"

#ifndef STRIP
#define STRIP 1 /* packets of LANES samples, or pixels, that a work-item goes through: starting one takes longer than most */
#endif
#define SAMPLE_WIDTH_MAX 64 /* target pixels: a sample's own is drawn no wider, as one right before the target would be */

/* Draws the pixels around samples x of row y, one a lane, of nearness n. */
INLINED void draw_pixels(PixelMap map, floatl x, float y, floatl n, intl wanted, global uint *keys)
{
    const float *D = map.dst_from_src, *S = map.src_from_dst;
    floatl u[4], v[4], low_u = INFINITY, low_v = INFINITY, high_u = -INFINITY, high_v = -INFINITY;
    intl drawn = wanted;
    UNROLLED
    for (int i = 0; i < 4; i++) { /* the square's corners, in turn */
        const floatl cx = x + (i == 1 || i == 2 ? 0.5f : -0.5f);
        const float cy = y + (i >= 2 ? 0.5f : -0.5f);
        const floatl w = MAP_ROW(D, 2, cx, cy, n);
        drawn = drawn & (w > 0.0f);
        u[i] = MAP_ROW(D, 0, cx, cy, n) / w;
        v[i] = MAP_ROW(D, 1, cx, cy, n) / w;
        low_u = min_lanes(u[i], low_u);
        high_u = max_lanes(u[i], high_u);
        low_v = min_lanes(v[i], low_v);
        high_v = max_lanes(v[i], high_v);
    }
    drawn = drawn & ((u[2] - u[0]) * (v[3] - v[1]) - (u[3] - u[1]) * (v[2] - v[0]) > 0.0f); /* not seen from behind */
    const intl left = to_intl(ceil_lanes(clamp_lanes(low_u, (floatl)0.0f, (floatl)map.dst_width)));
    const intl top = to_intl(ceil_lanes(clamp_lanes(low_v, (floatl)0.0f, (floatl)map.dst_height)));
    /* Shifted by 1, so that what lies to the left of the target is no pixel */
    const intl right = min(to_intl(floor_lanes(clamp_lanes(high_u + 1.0f, (floatl)0.0f, (floatl)map.dst_width))) - 1,
                           left + SAMPLE_WIDTH_MAX);
    const intl bottom = min(to_intl(floor_lanes(clamp_lanes(high_v + 1.0f, (floatl)0.0f, (floatl)map.dst_height))) - 1,
                            top + SAMPLE_WIDTH_MAX);
    for (intl row = top; any_lane(drawn & (row <= bottom)); row += 1)
        for (intl column = left; any_lane(drawn & (row <= bottom) & (column <= right)); column += 1) {
            /* Where the pixel's ray meets the plane of this nearness, and whether that is within the square */
            const floatl c = to_floatl(column), r = to_floatl(row);
            const floatl w0 = PIXEL_ROW(S, 2, c, r), q0 = PIXEL_ROW(S, 3, c, r);
            const floatl there = (n * w0 - q0) / (S[15] - n * S[11]), w = w0 + there * S[11];
            const floatl px = (PIXEL_ROW(S, 0, c, r) + there * S[3]) / w;
            const floatl py = (PIXEL_ROW(S, 1, c, r) + there * S[7]) / w;
            const intl within_it = (fabs(px - x) <= 0.5f) & (fabs(py - y) <= 0.5f) &
                                   IS_BEFORE(map.dst_perspective, there);
            const intl hit = drawn & (row <= bottom) & (column <= right) & within_it;
            const intl at = row * map.dst_width + column;
            for (int lane = 0; lane < LANES; lane++)
                if (int_lane(hit, lane))
                    atomic_max(keys + int_lane(at, lane), key_of(float_lane(there, lane)));
        }
}

kernel void rims(global const float *surface, global uint *keys, PixelMap map)
{
    const int y = get_global_id(1);
    if (y >= map.src_height)
        return;
    const Grid grid = GRID_OF(surface, map.src_width, map.src_height, map.src_pitch, NO_CUT);
    /* Rims are few in most packets: they are gathered to full ones first. */
    float rim_x[(STRIP + 1) * LANES], rim_n[(STRIP + 1) * LANES];
    int count = 0;
    for (int x0 = get_global_id(0) * STRIP * LANES, packet = 0; packet < STRIP && x0 < map.src_width; x0 += LANES, packet++) {
        global const float *own = grid.nearness + (size_t)y * map.src_pitch + x0;
        const floatl n = load_lanes(own);
        const intl to_left = as_intl(load_lanes(own - 1)) & TORN_RIGHT, above = as_intl(load_lanes(own - map.src_pitch)) & TORN_BELOW;
        const intl open = (to_left | above | (as_intl(n) & (TORN_RIGHT | TORN_BELOW))) != 0;
        const intl rim = open & (n > NO_SURFACE) & (x0 + lane_index < map.src_width);
        if (!any_lane(rim))
            continue;
        for (int lane = 0; lane < LANES; lane++) {
            rim_x[count] = x0 + lane;
            rim_n[count] = float_lane(n, lane);
            count += int_lane(rim, lane) != 0;
        }
    }
    for (int first = 0; first < count; first += LANES)
        draw_pixels(map, load_lanes(rim_x + first), y, load_lanes(rim_n + first), first + lane_index < count, keys);
}

/* Depths of a target that shows depths z, with its rims: where nothing shows, or a surface that the rim is torn apart
 * from */
INLINED floatl with_rims(floatl z, uintl key, int perspective, Cut cut)
{
    const intl bits = as_intl(key);
    const floatl rim = as_floatl(select_lanes(bits < 0, bits & 0x7fffffff, ~bits)); /* nearness_of_key() in lanes */
    const floatl shown = perspective ? 1.0f / z : -z;
    const intl torn_from = (rim > shown) & IS_OPEN(cut, rim, shown);
    return select_lanes((bits != 0) & ((z != z) | torn_from), DEPTH_OF(perspective, rim), z);
}

kernel void add_rims(global const uint *keys, global float *depth, global uchar *valid, int width, int height,
                     int perspective, Cut cut)
{
    const int y = get_global_id(1);
    if (y >= height)
        return;
    for (int x0 = get_global_id(0) * STRIP * LANES, packet = 0; packet < STRIP && x0 < width; x0 += LANES, packet++) {
        const size_t at = (size_t)y * width + x0;
        if (x0 + LANES <= width) {
            const uintl key = load_lanes(keys + at);
            if (!any_lane(as_intl(key) != 0))
                continue; /* most packets have none */
            const floatl z = with_rims(load_lanes(depth + at), key, perspective, cut);
            store_lanes(z, depth + at);
            store_bytes(to_ucharl((z == z) & 1), valid + at);
            continue;
        }
        for (int i = 0; i < width - x0; i++) {
            floatl z = depth[at + i];
            uintl key = keys[at + i];
            z = with_rims(z, key, perspective, cut);
            depth[at + i] = float_lane(z, 0);
            valid[at + i] = float_lane(z, 0) == float_lane(z, 0);
        }
    }
}
