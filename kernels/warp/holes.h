#ifndef WARP_HOLES_H
#define WARP_HOLES_H
/* Holes as bits, and the memory layout of `behind`: two planes of rows of `pitch` numbers, as many rows as a picture's
 * tiles have, and HALO more on every side. Shared by behind.cl and fill.cl. */
#include "lib/lanes.h"

#define TILE 16 /* pixels, or cells, along a tile's side */
#define HALO 4  /* pixels around a tile; `behind` is undefined there */
#define HALO_TILE (TILE + 2 * HALO)
#define BEHIND_PLANE(height, pitch) ((size_t)(((height) + TILE - 1) / TILE * TILE + 2 * HALO) * (pitch))

#define COLUMNS ((int16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15))
#define AMONG(bits) (((int16)(int)(bits) >> COLUMNS & 1) != 0) /* -1 in the columns whose bit is set */

typedef struct __attribute__((packed)) {
    ulong bytes;
} EightBytes;

/* Bit i: whether pixel x + i of row y is a hole, for i < 8 * bytes; there are no holes outside of the picture. */
ulong hole_bits(global const uchar *valid, int width, int height, int x, int y, int bytes)
{
    const ulong all = ~0ul >> (64 - 8 * bytes);
    ulong bits = 0; /* valid pixels */
    if (y < 0 || y >= height)
        return 0;
    global const uchar *row = valid + (size_t)y * width;
    if (x >= 0 && x + 8 * bytes <= width) {
        for (int i = 0; i < bytes; i++) { /* The product gathers eight bytes' lowest bits in its highest byte. */
            const ulong eight = ((global const EightBytes *)(row + x + 8 * i))->bytes;
            bits |= (eight * 0x0102040810204080ul >> 56) << (8 * i);
        }
        return ~bits & all;
    }
    for (int i = max(-x, 0); i < min(8 * bytes, width - x); i++)
        bits |= (ulong)(row[x + i] == 0) << i;
    return bits;
}
#endif
