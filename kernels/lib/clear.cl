/* Fills a buffer of floats or uints. Work-item: `share` elements; `share` is a multiple of LANES. Cost: O(elements). */
#include "lib/lanes.h"

#define SET_SHARE(vectors)                                                                                     \
    const int first = get_global_id(0) * share, end = min(first + share, count);                               \
    int i = first;                                                                                             \
    for (; i + LANES <= end; i += LANES)                                                                       \
        store_lanes((vectors)value, values + i);                                                               \
    for (; i < end; i++)                                                                                       \
        values[i] = value;

kernel void clear(global float *values, int count, int share, float value)
{
    SET_SHARE(floatl)
}

kernel void clear_uints(global uint *values, int count, int share, uint value)
{
    SET_SHARE(uintl)
}
