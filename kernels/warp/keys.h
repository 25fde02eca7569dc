#ifndef WARP_KEYS_H
#define WARP_KEYS_H
/* Nearness as an ordered uint, for atomic maxima: 0 is below all values. */
uint key_of(float nearness)
{
    const uint bits = as_uint(nearness);
    return bits & 0x80000000u ? ~bits : bits | 0x80000000u;
}

float nearness_of_key(uint key)
{
    return as_float(key & 0x80000000u ? key & 0x7fffffffu : ~key);
}
#endif
