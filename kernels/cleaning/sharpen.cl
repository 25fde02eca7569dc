/* Sharpens soft edges: each sample of a ramp between two surfaces moves to the closer surface, which is extrapolated to
 * the sample.
 *
 * Depth from networks has ramps instead of edges, several pixels wide. Ramps are detected along rows, columns and
 * diagonals. A ramp is a run of samples that all rise, or all fall: each step by at least the fraction RAMP_RISE of the
 * run's steepest step. Beyond its ends, a ramp has tails with smaller steps. So the surface on each side is the line
 * through two samples farther out, at distances in proportion to the ramp's length. A ramp is an edge if the two lines,
 * extrapolated to the sample, differ by more than the fraction APART of nearness. If the ramps in several directions
 * are edges, the steepest one counts. A slope that does not end within RAMP_REACH samples is part of a surface. A
 * sample gets no nearness outside of the range that the samples within RAMP_REACH along the ramp have.
 *
 * nearness: a plane (plane.h) of 1 / depth, 0 for none. sharp: (height, width) nearness of samples that change, 0 for
 * others. Work-item: `strip` packets of a row. Cost: O(pixels * RAMP_REACH). Determinism: pixels are independent.
 */
#include "cleaning/plane.h"

#define RAMP_REACH 12 /* greatest number of a ramp's samples on each side of a sample */
#define RAMP_RISE 0.3f
#define TAIL(length) ((length) / 3)      /* samples from the ramp's end to the first of the two that define a line */
#define BASE(length) (1 + (length) / 4) /* samples from the first of these two to the second */
#define APART 0.04f
#define BEYOND 0.1f /* fraction of the surfaces' difference: a ramp's sample may lie this far beyond one of them */
#define RISES 1e-30f

/* The number of steps in a direction that stay in the image */
INLINED intl steps_inside(ImagePlane plane, int x, int row, int dx, int dy)
{
    const intl column = x - ASIDE + lane_index;
    intl inside = 2 * (plane.width + plane.height);
    if (dx != 0)
        inside = min(inside, dx > 0 ? plane.width - 1 - column : column);
    if (dy != 0)
        inside = min(inside, (intl)(dy > 0 ? plane.height - 1 + ABOVE - row : row - ABOVE));
    return max(inside, 0);
}

/* Returns the number of steps, in one direction, along which nearness times `sign` rises by at least `least`. Sets
 * `steepest` to the greatest rise. Clears `ends` in lanes whose run reaches the image's border, a missing sample, or
 * RAMP_REACH steps. */
INLINED intl length_of_run(global const float *at, int step, intl inside, floatl sign, floatl least, floatl *steepest,
                           intl *ends)
{
    floatl here = load_lanes(at);
    intl goes_on = (here > 0.0f) & (sign != 0.0f), length = 0, stops = goes_on & (intl)0;
    for (int t = 1; t <= RAMP_REACH; t++) {
        goes_on &= inside >= t;
        if (!any_lane(goes_on))
            break;
        const floatl next = load_lanes(at + t * step), rise = sign * (next - here);
        goes_on &= next > 0.0f;
        stops |= goes_on & (rise < least);
        goes_on &= rise >= least;
        *steepest = select_lanes(goes_on, max_lanes(*steepest, rise), *steepest);
        length += select_lanes(goes_on, (intl)1, (intl)0);
        here = next;
    }
    *ends &= stops;
    return length;
}

/* Clamps nearness to the range of the samples within RAMP_REACH along a direction and against it. */
INLINED floatl clamped_to_range(floatl value, global const float *at, int step, intl ahead, intl behind)
{
    floatl low = load_lanes(at), high = low;
    for (int t = -RAMP_REACH; t <= RAMP_REACH; t++) {
        const intl inside = (t <= ahead) & (-t <= behind);
        if (!any_lane(inside))
            continue;
        const floatl near = load_lanes(at + t * step);
        const intl is_known = inside & (near > 0.0f);
        low = select_lanes(is_known, min_lanes(low, near), low);
        high = select_lanes(is_known, max_lanes(high, near), high);
    }
    return clamp_lanes(value, low, high);
}

/* The surface at the end of a ramp, extrapolated back to the sample */
INLINED floatl continued(global const float *values, int at, int step, intl end, intl length, intl inside, floatl steep)
{
    const intl close = min(end + TAIL(length), inside), far = min(close + BASE(length), inside);
    const intl own = at + lane_index;
    const floatl first = (floatl)(gather(values, own + close * step)), last = (floatl)(gather(values, own + far * step));
    const floatl slope = (first - last) / to_floatl(max(far - close, 1));
    const floatl line = first + clamp_lanes(slope, -steep, steep) * to_floatl(close);
    const floatl there = clamp_lanes(line, 0.5f * first, 2.0f * first);
    const intl is_known = (first > 0.0f) & (last > 0.0f);
    return select_lanes(is_known, there, (floatl)(gather(values, own + end * step)));
}

/* Sets `found` to the closer surface at the ramp along (dx, dy), if this ramp is the steepest edge so far. */
INLINED void sharpen_along(global const float *values, ImagePlane plane, int x, int row, int dx, int dy, floatl *found,
                           floatl *steepest)
{
    const int at = row * plane.pitch + x, step = dy * plane.pitch + dx;
    const intl ahead = steps_inside(plane, x, row, dx, dy), behind = steps_inside(plane, x, row, -dx, -dy);
    const floatl own = load_lanes(values + at), next = load_lanes(values + at + step);
    const floatl before = load_lanes(values + at - step);
    const floatl change = select_lanes(next > 0.0f, next, own) - select_lanes(before > 0.0f, before, own);
    const floatl sign = select_lanes(change > 0.0f, (floatl)1.0f, select_lanes(change < 0.0f, (floatl)-1.0f, (floatl)0.0f));
    floatl peak = 0.0f, unused = 0.0f;
    intl any = 1, ends = any == 1;
    length_of_run(values + at, step, ahead, sign, (floatl)RISES, &peak, &any);
    length_of_run(values + at, -step, behind, -sign, (floatl)RISES, &peak, &any);
    const floatl steep = dx != 0 && dy != 0 ? peak * M_SQRT1_2_F : peak;
    if (!any_lane(steep > *steepest))
        return;
    const floatl least = max_lanes(RAMP_RISE * peak, (floatl)RISES);
    const intl to = length_of_run(values + at, step, ahead, sign, least, &unused, &ends);
    const intl from = length_of_run(values + at, -step, behind, -sign, least, &unused, &ends);
    const floatl high = sign * continued(values, at, step, to, to + from, ahead, least);
    const floatl low = sign * continued(values, at, -step, from, to + from, behind, least);
    const floatl apart = high - low, above = sign * own - low, below = high - sign * own;
    const intl is_edge = ends & (to + from >= 2) & (apart > APART * max_lanes(fabs(high), fabs(low))) &
                         (min_lanes(above, below) > -BEYOND * apart) & (steep > *steepest);
    if (!any_lane(is_edge))
        return;
    const floatl closer = sign * select_lanes(above < below, low, high);
    *found = select_lanes(is_edge, clamped_to_range(closer, values + at, step, ahead, behind), *found);
    *steepest = select_lanes(is_edge, steep, *steepest);
}

kernel void sharpen(global const float *nearness, global float *sharp, ImagePlane plane, int strip)
{
    EACH_PACKET(plane, x, row)
    {
        if (!IS_PACKET_OF_IMAGE(plane, x, row))
            continue;
        floatl found = 0.0f, steepest = 0.0f;
        sharpen_along(nearness, plane, x, row, 1, 0, &found, &steepest);
        sharpen_along(nearness, plane, x, row, 0, 1, &found, &steepest);
        sharpen_along(nearness, plane, x, row, 1, 1, &found, &steepest);
        sharpen_along(nearness, plane, x, row, -1, 1, &found, &steepest);
        store_first(found, sharp + (size_t)(row - ABOVE) * plane.width + x - ASIDE, ASIDE + plane.width - x);
    }
}
