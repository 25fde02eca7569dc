/* Fills a buffer of floats or uints. Work-item: `share` of them, a multiple of LANES. O(n). */
#include "lib/lanes.h"

#ifndef UINTS
#define UINTS 0 /* 1: the values are uints */
#endif
#if UINTS
#define element uint
#define elements uintl
#else
#define element float
#define elements floatl
#endif

kernel void clear(global element *values, int count, int share, element value)
{
    const int first = get_global_id(0) * share, end = min(first + share, count);
    int i = first;
    for (; i + LANES <= end; i += LANES)
        store_lanes((elements)value, values + i);
    for (; i < end; i++)
        values[i] = value;
}
