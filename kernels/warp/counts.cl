/* Depth in counts of 16 bits, as cameras deliver it, to planar depth and back.
 *
 * counts: 0 where there is no depth. depth: NaN where there is none. scale: counts a scene unit. Back they are rounded to
 * the nearest count, and are 0, too, where a depth is more than they hold.
 * Work-item: `share` samples, a multiple of LANES. Cost: O(samples), one pass. Determinism: every sample on its own.
 */
#include "lib/lanes.h"

#define MOST 65535.0f

/* Unaligned, in one instruction: vstore16 goes count by count. */
typedef struct __attribute__((packed)) {
    WIDE(ushort) counts;
} UnalignedCounts;

#define DEPTH_OF_COUNT(type, count, scale) select((type)NAN, (count) / (scale), (count) > 0.0f)
#define ROUNDED_COUNT(type, depth, scale)                                                                      \
    select((type)0.0f, (depth) * (scale) + 0.5f, ((depth) > 0.0f) & ((depth) * (scale) < MOST + 0.5f)) /* not of NaN */

kernel void to_depth(global const ushort *counts, global float *depth, int count, int share, float scale)
{
    const int first = get_global_id(0) * share, end = min(first + share, count);
    int i = first;
    for (; i + LANES <= end; i += LANES) {
        const floatl stored = to_floatl(((global const UnalignedCounts *)(counts + i))->counts);
        store_lanes(DEPTH_OF_COUNT(floatl, stored, scale), depth + i);
    }
    for (; i < end; i++)
        depth[i] = DEPTH_OF_COUNT(float, (float)counts[i], scale);
}

kernel void to_counts(global const float *depth, global ushort *counts, int count, int share, float scale)
{
    const int first = get_global_id(0) * share, end = min(first + share, count);
    int i = first;
    for (; i + LANES <= end; i += LANES) {
        const floatl z = load_lanes(depth + i);
        ((global UnalignedCounts *)(counts + i))->counts = WIDE(convert_ushort)(to_intl(ROUNDED_COUNT(floatl, z, scale)));
    }
    for (; i < end; i++)
        counts[i] = (ushort)ROUNDED_COUNT(float, depth[i], scale);
}
