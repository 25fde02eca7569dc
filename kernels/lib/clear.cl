/* Sets floats. Work-item: `chunk` of them, a multiple of LANES. O(n). */
#include "lib/lanes.h"

kernel void clear(global float *values, int count, int chunk, float value)
{
    const int first = get_global_id(0) * chunk, end = min(first + chunk, count);
    int i = first;
    for (; i + LANES <= end; i += LANES)
        store_lanes((floatl)value, values + i);
    for (; i < end; i++)
        values[i] = value;
}
