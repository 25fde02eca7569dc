#ifndef CLEANING_TINT_H
#define CLEANING_TINT_H
/* Colours of 10 bits a channel in one word, and how unlike two of them are: their channels' differences, added. */
#include "lib/lanes.h"

#define TINT_BITS 10
#define TINT_MAX 1020.0f /* a multiple of 255: bytes are exact */
#define UNLIKE_LITTLE 30 /* of TINT_MAX: holes grow together where colours are no more unlike, then in the order */
#define UNLIKE_SOME 102  /* of these, and at last whatever the colours */
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
