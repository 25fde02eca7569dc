/* Denoised samples, from which errors.cl computes the quadtree's errors, so that noise alone splits no triangle.
 *
 * Each sample's nearness moves towards the means of pairs of opposite neighbours, so planes of any slope stay
 * unchanged. A pair weighs less the more its mean differs from the sample. If mean and sample differ by more than
 * PAIR_REACH standard deviations of the noise, the pair lies on other surfaces and is ignored.
 *
 * nearness, smoothed: (height, pitch), picture/nearness.cl. Work-item: a row. Cost: O(samples), 48 neighbours each.
 * Determinism: samples are independent.
 */
#include "depthmesh/tree.h"

#define PAIR_RADIUS 3     /* samples: largest offset of a neighbour along each axis */
#define PAIR_REACH 4.5f /* standard deviations of the noise */

/* Nearness of the samples (x + dx, row); NO_SURFACE outside the image */
INLINED floatl nearness_at(const Layout *layout, global const float *nearness, intl x, int first, int row, int dx)
{
    if (row < 0 || row >= layout->height)
        return (floatl)NO_SURFACE;
    global const float *start = nearness + (size_t)row * layout->pitch;
    const intl column = x + dx, there = (column >= 0) & (column < layout->width);
    if (first >= PAIR_RADIUS && first + LANES + PAIR_RADIUS <= layout->pitch)
        return select_lanes(there, load_lanes(start + first + dx), (floatl)NO_SURFACE);
    const intl at = select_lanes(there, column, (intl)0);
    return select_lanes(there, (floatl)(gather(start, at)), (floatl)NO_SURFACE);
}

kernel void smooth_nearness(global const float *nearness, global float *smoothed, Layout layout)
{
    const int y = get_global_id(0);
    if (y >= layout.height)
        return;
    const float *of = layout.noise;
    for (int first = 0; first < layout.width; first += LANES) {
        const size_t at = (size_t)y * layout.pitch + first;
        const intl x = first + lane_index;
        const floatl n = load_lanes(nearness + at);
        const floatl deviation = layout.perspective ? of[0] + (of[1] + of[2] * n) * n : (of[0] * n - of[1]) * n + of[2];
        const floatl sharpness = 1.0f / fmax(PAIR_REACH * deviation, fabs(n) * ROUNDING);
        floatl sum = 0.0f, weights = 1.0f; /* the sample itself has weight 1 and offset 0 */
        for (int dy = 0; dy <= PAIR_RADIUS; dy++)
            for (int dx = dy ? -PAIR_RADIUS : 1; dx <= PAIR_RADIUS; dx++) {
                const floatl a = nearness_at(&layout, nearness, x, first, y + dy, dx);
                const floatl b = nearness_at(&layout, nearness, x, first, y - dy, -dx);
                const floatl off = 0.5f * (a + b) - n, share = off * sharpness;
                const intl same = IS_SAMPLE(a) & IS_SAMPLE(b) & (fabs(share) < 1.0f);
                const floatl weight = select_lanes(same, 2.0f - 2.0f * share * share, (floatl)0.0f);
                sum += select_lanes(same, weight * off, (floatl)0.0f);
                weights += weight;
            }
        store_lanes(select_lanes(IS_SAMPLE(n), n + sum / weights, n), smoothed + at);
    }
}
