/* Surfaces as large as the pixels that measured them: single missing samples are bridged, and rims are drawn.
 *
 * The surface of lib/surface.h ends at the last samples, half a pixel before what they measured does: things one sample
 * thin are not there at all, and what is behind them shows. `rims` carries the pixels of all samples next to an opening,
 * or to the image's border, over to the target, as squares at their own depth; the nearest one stays. `add_rims` writes
 * them where the target shows nothing, or what they are torn apart from. Through a single missing sample, what is behind
 * would show, too: `bridge` closes it.
 * nearness, bridged: (src_height, src_pitch). keys: (dst_height, dst_width) nearness as warp/keys.h orders it, 0 where there is
 * no rim. depth, valid: (dst_height, dst_width).
 * Work-item: STRIP * LANES samples, or pixels, of a row. Cost: O(samples + pixels of rims). Determinism: a maximum does not
 * depend on the order of work-items.
 */
#include "lib/lanes.h"
#include "lib/surface.h"
#include "warp/keys.h"

#ifndef STRIP
#define STRIP 1 /* packets of LANES samples, or pixels, that a work-item goes through: starting one takes longer than most */
#endif
#define WIDEST 64 /* target pixels: a sample's own is drawn no wider, as one right before the target would be */

/* Draws the pixel around sample (x, y) of nearness n. */
void draw_pixel(PixelMap map, int x, int y, float n, global uint *keys)
{
    const float *D = map.dst_from_src, *S = map.src_from_dst;
    float u[4], v[4], low_u = INFINITY, low_v = INFINITY, high_u = -INFINITY, high_v = -INFINITY;
    for (int i = 0; i < 4; i++) { /* round the square */
        const float cx = x + (i == 1 || i == 2 ? 0.5f : -0.5f), cy = y + (i >= 2 ? 0.5f : -0.5f);
        const float w = MAP_ROW(D, 2, cx, cy, n);
        if (!(w > 0.0f))
            return;
        u[i] = MAP_ROW(D, 0, cx, cy, n) / w;
        v[i] = MAP_ROW(D, 1, cx, cy, n) / w;
        low_u = fmin(low_u, u[i]);
        high_u = fmax(high_u, u[i]);
        low_v = fmin(low_v, v[i]);
        high_v = fmax(high_v, v[i]);
    }
    if (!((u[2] - u[0]) * (v[3] - v[1]) - (u[3] - u[1]) * (v[2] - v[0]) > 0.0f))
        return; /* seen from behind */
    const int left = convert_int_sat(ceil(clamp(low_u, 0.0f, (float)map.dst_width)));
    const int top = convert_int_sat(ceil(clamp(low_v, 0.0f, (float)map.dst_height)));
    const int right = min(convert_int_sat(floor(clamp(high_u, -1.0f, map.dst_width - 1.0f))), left + WIDEST);
    const int bottom = min(convert_int_sat(floor(clamp(high_v, -1.0f, map.dst_height - 1.0f))), top + WIDEST);
    for (int row = top; row <= bottom; row++)
        for (int column = left; column <= right; column++) {
            /* Where the pixel's ray meets the plane of this nearness, and whether that is within the square */
            const float w0 = PIXEL_ROW(S, 2, column, row), q0 = PIXEL_ROW(S, 3, column, row);
            const float there = (n * w0 - q0) / (S[15] - n * S[11]), w = w0 + there * S[11];
            const float px = (PIXEL_ROW(S, 0, column, row) + there * S[3]) / w;
            const float py = (PIXEL_ROW(S, 1, column, row) + there * S[7]) / w;
            if (fabs(px - x) <= 0.5f && fabs(py - y) <= 0.5f && IS_BEFORE(map.dst_perspective, there))
                atomic_max(keys + row * map.dst_width + column, key_of(there));
        }
}

/* The samples to the left, to the right, above and below of LANES samples n from `own` on */
INLINED void load_beside(global const float *own, floatl n, int x0, int y, PixelMap map, floatl *beside)
{
    const intl x = x0 + lane_index;
    beside[0] = shifted_lanes(n);
    set_float_lane(beside[0], 0, x0 > 0 ? own[-1] : NO_SURFACE);
    beside[1] = pick(x + 1 < map.src_width, load_lanes(own + 1), (floatl)NO_SURFACE); /* rows have room to look beyond */
    beside[2] = y > 0 ? load_lanes(own - map.src_pitch) : (floatl)NO_SURFACE;
    beside[3] = y + 1 < map.src_height ? load_lanes(own + map.src_pitch) : (floatl)NO_SURFACE;
}

/* Single samples that are missing between two of one surface become what lies between these. */
kernel void bridge(global const float *nearness, global float *bridged, PixelMap map, Cut cut)
{
    const int y = get_global_id(1);
    if (y >= map.src_height)
        return;
    for (int x0 = get_global_id(0) * STRIP * LANES, packet = 0; packet < STRIP && x0 < map.src_width; x0 += LANES, packet++) {
        const size_t at = (size_t)y * map.src_pitch + x0;
        floatl n = load_lanes(nearness + at), beside[4];
        const intl none = n <= NO_SURFACE;
        if (any_lane(none)) {
            load_beside(nearness + at, n, x0, y, map, beside);
            const intl across = !IS_OPEN(cut, greater(beside[0], beside[1]), lesser(beside[0], beside[1]));
            const intl down = !IS_OPEN(cut, greater(beside[2], beside[3]), lesser(beside[2], beside[3]));
            const floatl between = 0.5f * pick(across, beside[0] + beside[1], beside[2] + beside[3]);
            n = pick(none & (across | down), between, n);
        }
        store_lanes(n, bridged + at);
    }
}

kernel void rims(global const float *nearness, global uint *keys, PixelMap map, Cut cut)
{
    const int y = get_global_id(1);
    if (y >= map.src_height)
        return;
    for (int x0 = get_global_id(0) * STRIP * LANES, packet = 0; packet < STRIP && x0 < map.src_width; x0 += LANES, packet++) {
        global const float *own = nearness + (size_t)y * map.src_pitch + x0;
        const floatl n = load_lanes(own);
        const intl x = x0 + lane_index;
        floatl beside[4], high = n, low = n;
        load_beside(own, n, x0, y, map, beside);
        for (int i = 0; i < 4; i++) {
            high = greater(beside[i], high);
            low = lesser(beside[i], low);
        }
        if (!any_lane((x < map.src_width) & IS_OPEN(cut, high, low)))
            continue;
        intl open = 0;
        for (int i = 0; i < 4; i++)
            open = open | IS_OPEN(cut, greater(beside[i], n), lesser(beside[i], n));
        const intl rim = open & (n > NO_SURFACE) & (x < map.src_width);
        for (int lane = 0; lane < LANES; lane++)
            if (int_lane(rim, lane))
                draw_pixel(map, x0 + lane, y, float_lane(n, lane), keys);
    }
}

/* One pixel: a rim, if there is one, where nothing shows, or what it is torn apart from */
void add_rim(uint key, global float *depth, global uchar *valid, int perspective, Cut cut)
{
    const float rim = nearness_of(key), shown = perspective ? 1.0f / *depth : -*depth;
    if (key && (!*valid || (rim > shown && IS_OPEN(cut, rim, shown)))) {
        *depth = DEPTH_OF(perspective, rim);
        *valid = 1;
    }
}

kernel void add_rims(global const uint *keys, global float *depth, global uchar *valid, int width, int height, int perspective,
                     Cut cut)
{
    const int y = get_global_id(1);
    if (y >= height)
        return;
    for (int x0 = get_global_id(0) * STRIP * LANES, packet = 0; packet < STRIP && x0 < width; x0 += LANES, packet++) {
        const size_t at = (size_t)y * width + x0;
        if (x0 + LANES <= width && !any_lane(as_intl(load_lanes(keys + at)) != 0))
            continue; /* as most */
        for (int lane = 0; lane < min(LANES, width - x0); lane++)
            add_rim(keys[at + lane], depth + at + lane, valid + at + lane, perspective, cut);
    }
}
