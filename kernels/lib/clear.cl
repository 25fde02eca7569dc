/* Sets floats. Work-item: `chunk` of them. O(n). */
kernel void clear(global float *values, int count, int chunk, float value)
{
    const int first = get_global_id(0) * chunk;
    for (int i = first; i < min(first + chunk, count); i++)
        values[i] = value;
}
