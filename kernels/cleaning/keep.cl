/* Chooses the samples to keep: all except flying pixels. Pixels without a kept sample get the previous frame's depth if
 * it still holds.
 *
 * The depth of a flying pixel lies between two surfaces, apart from both: the camera mixed their depths at an edge.
 * Flying pixels are detected along rows, columns and diagonals; the next sample on each side may be up to GAP pixels
 * away. If the line through the next two samples on one side leads to the pixel's depth, the pixel belongs to their
 * surface and is kept. A pixel's previous depth still holds if a kept sample within GAP pixels lies on the same surface
 * and has a similar colour.
 *
 * values, known: planes of the measured and of the previous depth, on a scale (scale.h) on which surfaces are at least
 * 1 apart. tint: tint.h. marks: a plane of the bits KEPT, AREA and DOUBTED (plane.h). held: `marks` with STILL added.
 * Work-item: `strip` packets of a row. Cost: O(pixels). Determinism: kernels read only finished planes.
 */
#include "cleaning/plane.h"
#include "cleaning/scale.h"
#include "cleaning/tint.h"

#define GAP 2
#define LED_TO 2.0f /* greatest difference between a sample's value and the line through samples of its surface */

/* The value of the next sample on one side, at most GAP pixels away */
INLINED floatl next_value(global const float *at, int step)
{
    const floatl one = load_lanes(at + step);
    return select_lanes(IS_KNOWN(one), one, load_lanes(at + 2 * step));
}

/* Does the line through the next two samples on one side lead to the pixel's value? */
INLINED intl is_led_to(global const float *at, int step, floatl value)
{
    const floatl one = load_lanes(at + step), two = load_lanes(at + 2 * step), three = load_lanes(at + 3 * step);
    const intl is_first = IS_KNOWN(one), is_close = select_lanes(is_first, IS_KNOWN(two), IS_KNOWN(three));
    const floatl next = select_lanes(is_first, one, two);
    const floatl near_one = select_lanes(is_first, two, three);
    const floatl far_one = select_lanes(is_first, three, load_lanes(at + 4 * step));
    const floatl after = select_lanes(is_close, near_one, far_one);
    const floatl steps = select_lanes(is_first, (floatl)1.0f, (floatl)2.0f);
    const floatl ratio = select_lanes(is_close, steps, 0.5f * steps);
    const floatl expected = next + (next - after) * ratio;
    return IS_KNOWN(next) & IS_KNOWN(after) & (fabs(expected - value) < LED_TO);
}

INLINED intl is_flying_along(global const float *at, int step, floatl value)
{
    const floatl first = next_value(at, step), last = next_value(at, -step);
    const intl is_between = IS_KNOWN(first) & IS_KNOWN(last) & (value - min_lanes(first, last) > 1.0f) &
                            (max_lanes(first, last) - value > 1.0f);
    if (!any_lane(is_between))
        return is_between;
    return is_between & !(is_led_to(at, step, value) | is_led_to(at, -step, value));
}

kernel void keep(global const float *values, global uchar *marks, ImagePlane plane, int strip)
{
    EACH_PACKET(plane, x, row)
    {
        const size_t at = (size_t)row * plane.pitch + x;
        intl mark = 0;
        if (IS_PACKET_OF_IMAGE(plane, x, row)) {
            const floatl value = load_lanes(values + at);
            const intl is_known = IS_KNOWN(value);
            intl flies = is_known & (intl)0;
            if (any_lane(is_known))
                flies = is_flying_along(values + at, 1, value) | is_flying_along(values + at, plane.pitch, value) |
                        is_flying_along(values + at, plane.pitch + 1, value) |
                        is_flying_along(values + at, plane.pitch - 1, value);
            mark = select_lanes(is_known & !flies, (intl)KEPT, (intl)0) |
                   select_lanes(IN_IMAGE(plane, x), (intl)(AREA | DOUBTED), (intl)0);
        }
        store_bytes(to_ucharl(mark), marks + at);
    }
}

kernel void hold(global const float *values, global const float *known, global const uint *tint, int has_color,
                 global const uchar *marks, global uchar *held, ImagePlane plane, int strip)
{
    EACH_PACKET(plane, x, row)
    {
        const int at = row * plane.pitch + x;
        intl mark = load_bytes(marks + at);
        if (IS_PACKET_OF_IMAGE(plane, x, row)) {
            const floatl before = load_lanes(known + at);
            const intl is_asked = ((mark & KEPT) == 0) & IS_KNOWN(before);
            intl holds = is_asked & (intl)0;
            for (int dy = -GAP; dy <= GAP && any_lane(is_asked & !holds); dy++)
                for (int dx = -GAP; dx <= GAP; dx++) {
                    const int other = at + dy * plane.pitch + dx;
                    const intl is_kept = (load_bytes(marks + other) & KEPT) != 0;
                    intl is_alike = is_kept & (fabs(load_lanes(values + other) - before) < 1.0f);
                    if (has_color)
                        is_alike &= unlikeness(load_lanes(tint + at), load_lanes(tint + other)) < UNLIKE_SOME;
                    holds |= is_alike;
                }
            mark |= select_lanes(is_asked & holds, (intl)STILL, (intl)0);
        }
        store_bytes(to_ucharl(mark), held + at);
    }
}
