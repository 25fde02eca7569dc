/* Sets floats or uints. Work-item: `share` of them, a multiple of LANES. O(n). */
#include "lib/lanes.h"

#ifndef UINTS
#define UINTS 0 /* 1: the values are uints */
#endif
#if UINTS
#define word uint
#define words uintl
#else
#define word float
#define words floatl
#endif

kernel void clear(global word *values, int count, int share, word value)
{
    const int first = get_global_id(0) * share, end = min(first + share, count);
    int i = first;
    for (; i + LANES <= end; i += LANES)
        store_lanes((words)value, values + i);
    for (; i < end; i++)
        values[i] = value;
}
