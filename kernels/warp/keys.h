#ifndef WARP_KEYS_H
#define WARP_KEYS_H
/* The nearest of several objects at each pixel. keys: its nearness as a uint with the same order; 0, the initial value,
 * is less than all keys. indices: the least number of an object with this nearness, initially the greatest uint. */
uint key_of(float nearness)
{
    const uint bits = as_uint(nearness);
    return bits & 0x80000000u ? ~bits : bits | 0x80000000u;
}

float nearness_of_key(uint key)
{
    return as_float(key & 0x80000000u ? key & 0x7fffffffu : ~key);
}

/* Enters an object at pixel `at`: into the keys or, once all keys are known and `by_index` is 1, into the indices. */
void enter_key(global uint *keys, global uint *indices, int by_index, int at, uint key, uint number)
{
    if (!by_index)
        atomic_max(keys + at, key);
    else if (keys[at] == key)
        atomic_min(indices + at, number);
}
#endif
