#ifndef WARP_PYRAMID_H
#define WARP_PYRAMID_H
/* The pyramid of push and pull (fill.cl): weighted means of pixels, level by level.
 *
 * A tile of TILE x TILE pixels becomes one cell of a level that is TILE times as coarse. TILE x TILE of these cells
 * form a tile again, until a single tile is left. Between its pixels and its cell, a tile has three levels, with 8, 4
 * and 2 cells a side.
 *
 * A cell has PLANES values: colour and nearness, each times the cell's weight, and this weight, at most 1. (Nearness is
 * averaged instead of depth, since it is linear on planes.) base: (PLANES, height, width), the cells that form the
 * tiles. cells: (PLANES, tiles down, tiles across), one cell for each tile; they are the base of the next tiles.
 * inner: the three levels of each tile, PLANES * INNER_CELLS values, undefined in tiles of weight 0; then one more tile
 * of zeros.
 *
 * Small weights must not add up along a long edge: otherwise more foreground would leak into the holes of finer
 * pictures. With HAS_BEHIND, when four cells become one, nearer cells get less weight. A cell's factor is the ratio of
 * its depth to the farthest of the four depths, to the power of 16 s, at most 64, where s is the cells' side in pixels.
 * So large cells fill wide holes with the farthest surface: the wider a disocclusion is, the farther its surface lies
 * behind the occluding one, and the middle of the hole shows the wall, not the floor in front. But the factor is at
 * least 0.3: otherwise, in wide holes, a few samples that are far by noise would decide alone, and the hole would
 * flicker.
 */
#include "lib/lanes.h"
#include "lib/pixelspace.h"
#include "warp/holes.h"

#ifndef HAS_BEHIND
#define HAS_BEHIND 1 /* 0: there is no `behind`, and all pixels weigh the same */
#endif
#define PLANES 5
#define WEIGHT_PLANE 4   /* the plane of the weights */
#define INNER_CELLS 84   /* cells in a tile's three levels of 8 x 8, 4 x 4 and 2 x 2 cells */
#define STEEPEST_LEVEL 2 /* from this level on, the power stays the same */
#define RATIO_MIN 0.3f   /* the least factor of a cell's weight; the farthest of four cells has factor 1 */
#define SATURATION 32.0f /* weights below 1/32 do not add up */

/* The index in `inner`, plane 0, of cell (x, y) of the level with 8 x 8 cells a tile */
#define FIRST_CELL(x, y, across)                                                                               \
    ((size_t)((y) / 8 * (across) + (x) / 8) * PLANES * INNER_CELLS + (y) % 8 * 8 + (x) % 8)

#define MASKED(mask, values) as_float16(as_int16(values) & (mask))
#define HALVED(a, b) (((a) + (b)).even + ((a) + (b)).odd)

/* Reduces two rows of a level's cells to one row of half their length. The greatest weight w of four cells limits the
 * new weight, so that small weights stay small: it is at most max(w, SATURATION w^2), and at most 1. */
#define HALVE(long_row, half_row, made, row, level)                                                            \
    {                                                                                                          \
        long_row a = 1.0f, b = 1.0f; /* factors relative to the farthest of four */                           \
        if (HAS_BEHIND) {                                                                                      \
            a = DEPTHS(row, 0), b = DEPTHS(row, 1);                                                            \
            const half_row farthest = fmax(fmax(a, b).even, fmax(a, b).odd);                                   \
            long_row beside;                                                                                   \
            beside.even = beside.odd = farthest > 0.0f ? 1.0f / farthest : (half_row)0.0f;                     \
            a *= beside, b *= beside;                                                                          \
            for (int squared = 0; squared < 4 + min(level, STEEPEST_LEVEL); squared++)                         \
                a *= a, b *= b;                                                                                \
            a = fmax(a, RATIO_MIN), b = fmax(b, RATIO_MIN);                                                    \
        }                                                                                                      \
        const half_row weights = HALVED(a * row(WEIGHT_PLANE, 0), b * row(WEIGHT_PLANE, 1));                   \
        const long_row more = fmax(row(WEIGHT_PLANE, 0), row(WEIGHT_PLANE, 1));                                \
        const half_row greatest = fmax(more.even, more.odd);                                                    \
        const half_row limit = fmin(fmax(greatest, SATURATION * greatest * greatest), 1.0f);                   \
        const half_row scale = weights > limit ? limit / weights : (half_row)1.0f;                             \
        for (int p = 0; p < WEIGHT_PLANE; p++)                                                                 \
            made(p) = scale * HALVED(a * row(p, 0), b * row(p, 1));                                            \
        made(WEIGHT_PLANE) = scale * weights;                                                                  \
    }
/* The depths of a row's cells; 0 in cells without a weight */
#define DEPTHS(row, i)                                                                                         \
    (row(WEIGHT_PLANE, i) == 0.0f ? 0.0f                                                                       \
     : perspective               ? row(WEIGHT_PLANE, i) / row(3, i)                                            \
                                 : -row(3, i) / row(WEIGHT_PLANE, i))
#endif
