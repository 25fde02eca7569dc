/* Converts raw depth of 16 bits, as cameras deliver it, to planar depth and back.
 *
 * raw: (count,) 0 for no depth. depth: (count,) NaN for no depth. scale: raw units per scene unit. Raw depth is rounded
 * to the nearest unit, and 0 for depths too large for 16 bits. Work-item: `share` samples, a multiple of LANES. Cost:
 * O(samples). Determinism: samples are independent.
 */
#include "lib/lanes.h"

#define RAW_MAX 65535.0f

/* An unaligned store to this struct is one instruction; vstore16 stores the values one by one. */
typedef struct __attribute__((packed)) {
    WIDE(ushort) raw;
} UnalignedRaw;

#define DEPTH_OF_RAW(type, count, scale) select((type)NAN, (count) / (scale), (count) > 0.0f)
#define RAW_OF_DEPTH(type, depth, scale)                                                                       \
    select((type)0.0f, (depth) * (scale) + 0.5f, ((depth) > 0.0f) & ((depth) * (scale) < RAW_MAX + 0.5f)) /* NaN: 0 */

kernel void to_depth(global const ushort *raw, global float *depth, int count, int share, float scale)
{
    const int first = get_global_id(0) * share, end = min(first + share, count);
    int i = first;
    for (; i + LANES <= end; i += LANES) {
        const floatl stored = to_floatl(((global const UnalignedRaw *)(raw + i))->raw);
        store_lanes(DEPTH_OF_RAW(floatl, stored, scale), depth + i);
    }
    for (; i < end; i++)
        depth[i] = DEPTH_OF_RAW(float, (float)raw[i], scale);
}

kernel void to_raw_depth(global const float *depth, global ushort *raw, int count, int share, float scale)
{
    const int first = get_global_id(0) * share, end = min(first + share, count);
    int i = first;
    for (; i + LANES <= end; i += LANES) {
        const floatl z = load_lanes(depth + i);
        ((global UnalignedRaw *)(raw + i))->raw = WIDE(convert_ushort)(to_intl(RAW_OF_DEPTH(floatl, z, scale)));
    }
    for (; i < end; i++)
        raw[i] = (ushort)RAW_OF_DEPTH(float, depth[i], scale);
}
