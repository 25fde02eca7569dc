/* A lens's picture from a straight one: each pixel reads where its own ray passes.
 *
 * Between four pixels that show one surface, nearness (affine on a plane) and colour are what lies between them; at the
 * edges of surfaces, beside holes, and if `linear` is 0, they are the nearest one's. Four are one surface if all show
 * something, and every step between neighbours is small or goes on as beside it: a slope is no edge, however steep.
 * places: (3, height, pitch) u and v in the straight picture, NaN for pixels that are none of its own, and depth in the
 * lens's frame over depth in the picture's. pane_depth, pane_color, pane_valid: (pane_height, pane_width), depth NaN
 * where there is nothing. depth, color, valid: (height, width); what is no pixel of this picture stays, or is emptied.
 * ORIGINS: where pixels come from, (..., 3), and what they are, are carried over, too; pixels without a ray are `unseen`.
 * Work-item: LANES pixels of a row. Cost: O(pixels). Determinism: every pixel on its own.
 */
#include "lib/color.h"

#ifndef ORIGINS
#define ORIGINS 0 /* 1: where pixels come from, and what they are, is carried over, too */
#endif
#define SMALL 0.01f /* of the nearness: steps that are no edge */

/* Nearness at columns and rows that may lie beyond the border; NaN: nothing. */
INLINED floatl nearness_at(global const float *depth, int width, int height, intl column, intl row)
{
    const intl inside = (column >= 0) & (column < width) & (row >= 0) & (row < height);
    const floatl z = (floatl)(gather(depth, pick(inside, row * width + column, (intl)0)));
    return pick(inside, 1.0f / z, (floatl)NAN);
}

/* Is the step from b to c small, or does it go on from a to b, or from c to d? NaN does not go on. */
INLINED intl goes_on(floatl a, floatl b, floatl c, floatl d)
{
    const floatl step = c - b, small = SMALL * fmin(b, c);
    return (fabs(step) <= small) | (fabs(b - a - step) <= small) | (fabs(d - c - step) <= small);
}

kernel void join(global const float *places, global const float *pane_depth, global const channel *pane_color,
                 global const uchar *pane_valid, int pane_width, int pane_height, int width, int height, int pitch, int first,
                 int linear, global float *depth, global channel *color, global uchar *valid
#if ORIGINS
                 , global const float *pane_origin, global const uchar *pane_classes, global float *origin,
                 global uchar *classes, int unseen
#endif
)
{
    const int x0 = get_global_id(0) * LANES, y = get_global_id(1);
    if (x0 >= width || y >= height)
        return;
    global const float *place = places + (size_t)y * pitch + x0;
    const size_t plane = (size_t)height * pitch;
    const floatl u_own = load_lanes(place), v_own = load_lanes(place + plane), deeper = load_lanes(place + 2 * plane);
    const intl own = u_own == u_own;
    const floatl u = pick(own, u_own, (floatl)0.0f), v = pick(own, v_own, (floatl)0.0f);
    const floatl left = lesser(floor_lanes(u), (floatl)max(pane_width - 2, 0)), upper = lesser(floor_lanes(v), (floatl)max(pane_height - 2, 0));
    const floatl fx = u - left, fy = v - upper;
    const intl x = to_intl(left), up = to_intl(upper);
    floatl n[4];
    for (int i = 0; i < 4; i++)
        n[i] = nearness_at(pane_depth, pane_width, pane_height, x + (i & 1), up + (i >> 1));
    const floatl low = fmin(fmin(n[0], n[1]), fmin(n[2], n[3])), high = fmax(fmax(n[0], n[1]), fmax(n[2], n[3]));
    const intl all_there = own & isfinite_lanes(n[0] + n[1] + n[2] + n[3]) & (intl)(linear ? -1 : 0);
    intl whole = all_there & (high - low <= SMALL * low);
    if (any_lane(all_there & !whole)) {
        intl on = all_there;
        for (int i = 0; i < 2; i++) {
            const floatl before = nearness_at(pane_depth, pane_width, pane_height, x - 1, up + i);
            const floatl after = nearness_at(pane_depth, pane_width, pane_height, x + 2, up + i);
            on = on & goes_on(before, n[2 * i], n[2 * i + 1], after);
            const floatl above = nearness_at(pane_depth, pane_width, pane_height, x + i, up - 1);
            const floatl under = nearness_at(pane_depth, pane_width, pane_height, x + i, up + 2);
            on = on & goes_on(above, n[i], n[2 + i], under);
        }
        whole = whole | on;
    }
    const floatl gx = 1.0f - fx, gy = 1.0f - fy;
    const floatl weights[4] = {gx * gy, fx * gy, gx * fy, fx * fy};
    const intl near_right = fx >= 0.5f, near_below = fy >= 0.5f;
    const intl nearest = (up + pick(near_below, (intl)1, (intl)0)) * pane_width + x + pick(near_right, (intl)1, (intl)0);
    const floatl n_nearest = pick(near_below, pick(near_right, n[3], n[2]), pick(near_right, n[1], n[0]));
    floatl between = 0.0f;
    for (int i = 0; i < 4; i++)
        between += weights[i] * pick(whole, n[i], (floatl)0.0f);
    const floatl z = deeper / pick(whole, between, n_nearest);

    const int count = pane_width * pane_height;
    Color c = read_color(pane_color, nearest, count);
    if (any_lane(whole)) {
        Color mixed = {0.0f, 0.0f, 0.0f};
        for (int i = 0; i < 4; i++)
            add_color(&mixed, weights[i], read_color(pane_color, (up + (i >> 1)) * pane_width + x + (i & 1), count));
        c = pick_color(whole, mixed, c);
    }
    const int lanes = min(LANES, width - x0);
    for (int lane = 0; lane < lanes; lane++) {
        const size_t at = (size_t)y * width + x0 + lane;
        const int from = int_lane(nearest, lane);
        if (!int_lane(own, lane)) {
            if (!first)
                continue;
            depth[at] = NAN;
            valid[at] = 0;
            write_pixel(color + CHANNELS * at, (float3)(0.0f));
#if ORIGINS
            vstore3((float3)(NAN), at, origin);
            classes[at] = unseen;
#endif
            continue;
        }
        depth[at] = float_lane(z, lane);
        valid[at] = pane_valid[from];
        write_pixel(color + CHANNELS * at, color_lane(c, lane));
#if ORIGINS
        classes[at] = pane_classes[from];
        const float3 one = vload3(from, pane_origin);
        float3 place_there = one;
        if (int_lane(whole, lane)) {
            const int corner = int_lane(up, lane) * pane_width + int_lane(x, lane);
            float3 sum = 0.0f;
            int same = 1;
            for (int i = 0; i < 4; i++) {
                const float3 each = vload3(corner + (i >> 1) * pane_width + (i & 1), pane_origin);
                same = same && each.z == one.z;
                sum += float_lane(weights[i], lane) * each;
            }
            place_there = same ? (float3)(sum.xy, one.z) : one;
        }
        vstore3(place_there, at, origin);
#endif
    }
}
