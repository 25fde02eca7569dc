#ifndef CLEANING_SCALE_H
#define CLEANING_SCALE_H
/* Scales: a scale maps nearness (1 / depth) to values, such that a difference of 1 is the same multiple of the noise at
 * every depth.
 *
 * A table holds the values at knots, and the scale is linear between them. Knots are all nearnesses whose float has 0
 * in the last KNOT_SHIFT bits; `first` is the first knot's other bits, as a number. So the distance of knots grows with
 * nearness, and a look-up needs no logarithm. A guide shortens the search for the inverse: the range of values is
 * divided into GUIDES equal parts, and at the start of each part, and at the end of the last one, the guide holds the
 * number of the last knot whose value is at most the value there.
 */
#include "lib/lanes.h"

#define KNOT_SHIFT 15
#define GUIDES 4096
#define MISSING 1e30f /* value of pixels without a sample: so far from all others that its weight is 0 */
#define IS_KNOWN(value) ((value) < 0.5f * MISSING)

typedef struct {
    int first, count;
    float cells_per_value;
} Scale;

#define KNOT(scale, number) as_floatl(((number) + (scale).first) << KNOT_SHIFT) /* nearness of a knot */

/* Values of depths; MISSING for depth 0 */
INLINED floatl value_of_depth(global const float *table, Scale scale, floatl depth)
{
    const floatl nearness = 1.0f / depth;
    const intl knot = clamp((as_intl(nearness) >> KNOT_SHIFT) - scale.first, 0, scale.count - 2);
    const floatl begin = KNOT(scale, knot), end = KNOT(scale, knot + 1);
    floatl low, high;
    gather_pairs(table, knot, &low, &high);
    return select_lanes(depth > 0.0f, low + (high - low) * ((nearness - begin) / (end - begin)), (floatl)MISSING);
}

/* Depths of values, the inverse. Values outside of the table are clamped to its ends. */
INLINED floatl depth_of_value(global const float *table, global const int *guide, Scale scale, floatl value)
{
    const intl cell = to_intl(clamp_lanes(value * scale.cells_per_value, (floatl)0.0f, (floatl)(GUIDES - 1)));
    intl knot = (intl)(gather(guide, cell)), last = (intl)(gather(guide, cell + 1));
    while (any_lane(knot < last)) {
        const intl middle = (knot + last + 1) >> 1, is_above = (floatl)(gather(table, middle)) > value;
        last = select_lanes(is_above, middle - 1, last);
        knot = select_lanes(is_above, knot, middle);
    }
    const floatl begin = KNOT(scale, knot), end = KNOT(scale, knot + 1);
    floatl low, high;
    gather_pairs(table, knot, &low, &high);
    const floatl part = select_lanes(high > low, (value - low) / (high - low), (floatl)0.0f);
    return 1.0f / (begin + clamp_lanes(part, (floatl)0.0f, (floatl)1.0f) * (end - begin));
}
#endif
