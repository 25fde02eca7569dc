#ifndef CLEANING_TINT_H
#define CLEANING_TINT_H
/* Colours in 32 bits, 10 for each channel. The difference of two colours is the sum of the channels' differences. */
#include "lib/lanes.h"

#define TINT_BITS 10
#define TINT_MAX 1020.0f /* a channel's greatest value: a multiple of 255, so bytes are exact */
#define UNLIKE_LITTLE 30 /* UNLIKE_...: greatest colour differences of steps of class 0, 1 and 2 (grow.cl) */
#define UNLIKE_SOME 102
#define UNLIKE_MUCH 306

#define TINT_LEVEL(value, full) WIDE(convert_uint)((value) * (TINT_MAX / (full)) + 0.5f)
#define PACKED_TINT(r, g, b, full)                                                                             \
    (TINT_LEVEL(r, full) | TINT_LEVEL(g, full) << TINT_BITS | TINT_LEVEL(b, full) << 2 * TINT_BITS)
#define TINT_CHANNEL(tint, number) as_intl((tint) >> (number) * TINT_BITS & (1 << TINT_BITS) - 1)

INLINED intl unlikeness(uintl a, uintl b)
{
    intl sum = 0;
    UNROLLED
    for (int number = 0; number < 3; number++) {
        const intl off = TINT_CHANNEL(a, number) - TINT_CHANNEL(b, number);
        sum += max(off, -off);
    }
    return sum;
}
#endif
