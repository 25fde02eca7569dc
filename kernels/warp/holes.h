#ifndef WARP_HOLES_H
#define WARP_HOLES_H
/* Holes as bits, and the memory layout of `behind`, for behind.cl and fill.cl. `behind` has two planes, of rows of
 * `pitch` numbers. A plane covers the picture's tiles and HALO more pixels on every side. */
#include "lib/lanes.h"

#define TILE 16 /* pixels, or cells, along a tile's side */
#define HALO 4  /* pixels that are read on each side of a tile; outside of the picture, `behind` is undefined */
#define HALO_TILE (TILE + 2 * HALO)
#define BEHIND_PLANE(height, pitch) ((size_t)(((height) + TILE - 1) / TILE * TILE + 2 * HALO) * (pitch))

#define COLUMNS ((int16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15))
#define AMONG(bits) (((int16)(int)(bits) >> COLUMNS & 1) != 0) /* mask of the columns whose bit is set */

typedef struct __attribute__((packed)) {
    ulong bytes;
} EightBytes;

/* Bit i is 1 if pixel x + i of row y is a hole, for i < 8 * bytes. Pixels outside of the picture are no holes. */
ulong hole_bits(global const uchar *valid, int width, int height, int x, int y, int bytes)
{
    const ulong all = ~0ul >> (64 - 8 * bytes);
    ulong bits = 0; /* valid pixels */
    if (y < 0 || y >= height)
        return 0;
    global const uchar *row = valid + (size_t)y * width;
    if (x >= 0 && x + 8 * bytes <= width) {
        for (int i = 0; i < bytes; i++) { /* the product's highest byte gathers the lowest bits of eight bytes */
            const ulong eight = ((global const EightBytes *)(row + x + 8 * i))->bytes;
            bits |= ((eight & 0x0101010101010101ul) * 0x0102040810204080ul >> 56) << (8 * i);
        }
        return ~bits & all;
    }
    for (int i = max(-x, 0); i < min(8 * bytes, width - x); i++)
        bits |= (ulong)(row[x + i] == 0) << i;
    return bits;
}
#endif
