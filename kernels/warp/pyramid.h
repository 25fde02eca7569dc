#ifndef WARP_PYRAMID_H
#define WARP_PYRAMID_H
/* The pyramid of push and pull (fill.cl): weighted means of pixels, level by level.
 *
 * A tile is TILE x TILE pixels, and one cell of the level TILE times as coarse. The tiles of that level are the cells
 * of the next one, until a single tile is left. Within a tile three levels halve the side: 8, 4 and 2 cells.
 *
 * A cell has PLANES values: colour and nearness (in which planes are linear), each times the weight, and the weight,
 * at most 1. base: (PLANES, height, width), the cells that make up tiles. cells: (PLANES, tiles down, tiles across),
 * one cell for each tile: the base of the next tiles. inner: the three levels of each tile, PLANES * INNER_CELLS
 * values, undefined in tiles of weight 0; then one more tile of zeros.
 *
 * Small weights must not add up along a long edge: otherwise more foreground would leak in finer pictures. With
 * HAS_BEHIND, four cells become one with weights that fall with nearness. A cell's factor is the ratio of its depth to
 * the farthest of the four depths, to the power of 16 times the cells' side, at most 64. So large cells fill wide holes
 * with the farthest surface: the wider a disocclusion is, the farther its surface lies behind the occluding one, and
 * the middle of the hole shows the wall, not the floor in front. But the factor is at least 0.3, so that a few
 * samples that are far by noise do not decide alone, which would make wide holes flicker.
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
#define STEEPEST_LEVEL 2 /* the level from which on the power stays the same */
#define RATIO_MIN 0.3f   /* the least factor of a cell's weight, relative to the farthest of four cells */
#define SATURATION 32.0f /* weights below 1/32 do not add up */

/* Cell (x, y) of the level of 8 x 8 cells a tile, in plane 0 of `inner` */
#define FIRST_CELL(x, y, across)                                                                               \
    ((size_t)((y) / 8 * (across) + (x) / 8) * PLANES * INNER_CELLS + (y) % 8 * 8 + (x) % 8)

#define MASKED(mask, values) as_float16(as_int16(values) & (mask))
#define HALVED(a, b) (((a) + (b)).even + ((a) + (b)).odd)

/* Reduces two rows of cells of a level to one row of half their length. The new weight is at most 1 and, so that small
 * weights stay small, at most the greater of w and SATURATION w^2, with w the greatest weight of the four cells. */
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
/* Depths of a row's cells, 0 for cells without a weight */
#define DEPTHS(row, i)                                                                                         \
    (row(WEIGHT_PLANE, i) == 0.0f ? 0.0f                                                                       \
     : perspective               ? row(WEIGHT_PLANE, i) / row(3, i)                                            \
                                 : -row(3, i) / row(WEIGHT_PLANE, i))
#endif
