/* Smooths noise by a bilateral filter around a local plane at each sample, and by blending with the previous frame.
 *
 * Without the planes, noise would stay on steep surfaces, as neighbours differ there by more than noise. The planes'
 * slopes come from a first, wider filter (`roughen`). A neighbour's weight is (1 - u / SUPPORT)^4, and 0 for
 * u > SUPPORT, with u = (difference of values / RANGE)^2 + (distance in pixels / SPACING)^2: this is close to
 * exp(-u / 2), and cheaper. The new value moves towards the previous one by the fraction BEFORE_WEIGHT exp(-d^2 / 2) of
 * their difference, where d is this difference, divided by `strength`. So differences due to noise shrink, and
 * differences due to motion stay.
 *
 * values, rough: planes on a scale (scale.h) on which noise has a standard deviation of 1. before, grown: planes of
 * depth, 0 for none. marks: plane.h. strength: 0 for no smoothing. depth: (height, width), NaN for none. invented:
 * (height, width) 1 if the depth was not measured. A sample whose value does not change keeps its depth to the bit.
 * Work-item: `strip` packets of a row. Cost: O(pixels): each of two filters reads 81 samples a pixel. Determinism:
 * kernels read only finished planes.
 */
#include "cleaning/plane.h"
#include "cleaning/scale.h"

#define SPACING 3.0f /* pixels */
#define RANGE 3.3f /* standard deviations of the noise: samples that differ by ten deviations get no weight */
#define ROUGH_RANGE (2.0f * RANGE)
#define REACH 3 /* pixels on each side from which a slope is estimated */
#define BEFORE_WEIGHT 0.9f
#define SUPPORT 10.0f
#define SHARPNESS(range) min(1.0f / (SUPPORT * (range) * (range)), 1e30f) /* finite, so that 0 times it is 0 */

/* The weight, about exp(-u / 2). rest: 1 - u / SUPPORT */
INLINED floatl weight_of(floatl rest)
{
    floatl weight = max_lanes(rest, (floatl)0.0f);
    weight *= weight;
    return weight * weight;
}

/* Adds the samples of the row at offset y, from `reach` pixels on the left to `reach` pixels on the right. */
#define ADD_ROW(y, reach)                                                                                      \
    {                                                                                                          \
        const floatl plane_y = middle + (float)(y) * down;                                                     \
        UNROLLED                                                                                               \
        for (int x = -(reach); x <= (reach); x++) {                                                            \
            const floatl off = load_lanes(values + (y) * pitch + x) - (plane_y + (float)x * across);           \
            const floatl weight = weight_of(1.0f - (float)(x * x + (y) * (y)) / (SUPPORT * SPACING * SPACING) -  \
                                            sharpness * (off * off));                                          \
            total += weight * off;                                                                             \
            weights += weight;                                                                                 \
        }                                                                                                      \
    }

/* The weighted mean by which the samples around exceed a plane, which contains the middle sample and has the slopes
 * `across` and `down` */
INLINED floatl off_mean(global const float *values, int pitch, floatl across, floatl down, float range)
{
    const floatl middle = load_lanes(values);
    const float sharpness = SHARPNESS(range);
    floatl total = 0.0f, weights = 0.0f;
    ADD_ROW(-5, 0) ADD_ROW(-4, 3) ADD_ROW(-3, 4) ADD_ROW(-2, 4) ADD_ROW(-1, 4)
    ADD_ROW(0, 5)
    ADD_ROW(1, 4) ADD_ROW(2, 4) ADD_ROW(3, 4) ADD_ROW(4, 3) ADD_ROW(5, 0)
    return total / weights; /* not 0: the middle sample has weight 1 */
}

kernel void roughen(global const float *values, global float *rough, ImagePlane plane, int strip, float strength)
{
    EACH_PACKET(plane, x, row)
    {
        const int at = row * plane.pitch + x;
        floatl value = MISSING;
        if (IS_PACKET_OF_IMAGE(plane, x, row)) {
            value = load_lanes(values + at);
            const intl is_known = IS_KNOWN(value);
            if (any_lane(is_known))
                value += off_mean(values + at, plane.pitch, 0.0f, 0.0f, ROUGH_RANGE * strength); /* 0 if MISSING */
        }
        store_lanes(value, rough + at);
    }
}

/* The change of values per pixel along one axis: the smaller change of the two sides; 0 if their signs differ */
INLINED floatl slope_along(global const float *rough, int step)
{
    const floatl low = load_lanes(rough - REACH * step), high = load_lanes(rough + REACH * step);
    const floatl middle = load_lanes(rough);
    const floatl first = middle - low, last = high - middle;
    const floatl lesser = select_lanes(fabs(first) < fabs(last), first, last);
    return select_lanes(IS_KNOWN(low) & IS_KNOWN(high) & (first * last > 0.0f), lesser * (1.0f / REACH), (floatl)0.0f);
}

INLINED floatl smoothed(global const float *values, global const float *rough, floatl grown, floatl before,
                        global const float *table, global const int *guide, Scale scale, int pitch, float strength)
{
    const floatl value = load_lanes(values);
    floatl off = off_mean(values, pitch, slope_along(rough, 1), slope_along(rough, pitch), RANGE * strength);
    const intl has_before = before > 0.0f;
    if (any_lane(has_before)) {
        const floatl to_before = value_of_depth(table, scale, before) - (value + off);
        const floatl weight = BEFORE_WEIGHT * weight_of(1.0f - SHARPNESS(strength) * (to_before * to_before));
        off += select_lanes(has_before, weight * to_before, (floatl)0.0f);
    }
    return select_lanes(off == 0.0f, grown, depth_of_value(table, guide, scale, value + off));
}

kernel void smooth(global const float *values, global const float *rough, global const float *grown,
                   global const float *before, int has_before, global const uchar *marks, global const float *table,
                   global const int *guide, Scale scale, ImagePlane plane, int strip, float strength,
                   global float *depth, global uchar *invented)
{
    EACH_PACKET(plane, x, row)
    {
        const int at = row * plane.pitch + x, count = ASIDE + plane.width - x;
        if (!IS_PACKET_OF_IMAGE(plane, x, row))
            continue;
        floatl found = load_lanes(grown + at);
        const intl is_known = found > 0.0f;
        if (strength > 0.0f && any_lane(is_known)) {
            const floatl known = has_before ? load_lanes(before + at) : (floatl)0.0f;
            found = smoothed(values + at, rough + at, found, known, table, guide, scale, plane.pitch, strength);
        }
        found = select_lanes(is_known, found, (floatl)NAN);
        const intl is_invented = select_lanes(is_known & ((load_bytes(marks + at) & KEPT) == 0), (intl)1, (intl)0);
        const size_t to = (size_t)(row - ABOVE) * plane.width + x - ASIDE;
        store_first(found, depth + to, count);
        store_first_bytes(is_invented, invented + to, count);
    }
}
