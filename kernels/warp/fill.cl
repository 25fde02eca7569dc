/* Fills holes from their surroundings by push and pull (Gortler, Grzeszczuk, Szeliski, Cohen: The Lumigraph, 1996,
 * section 3.4). Push averages the valid pixels next to holes into ever coarser cells of a pyramid (pyramid.h). A cell
 * whose weight is below 1 is partly unknown; pull fills this part from the next coarser level. So narrow holes are
 * filled from close by and wide holes from all around.
 *
 * With HAS_BEHIND, a pixel nearer than the depth behind the surrounding holes weighs less, and so does a foreground
 * pixel (behind.cl) that touches a hole. So a disocclusion is filled from the background, not from the occluding
 * surface. But no weight is 0: without background in reach, the foreground fills the hole. And a hole next to
 * foreground shows some of it, since a camera's pixel on a silhouette mixes foreground and background.
 *
 * color, depth, valid: (height, width). behind: behind.cl. base, cells, inner: pyramid.h; the base of the finest tiles
 * are the pixels. pull_cells replaces colour and nearness of the base's cells by filled values. Work-item: on CPUs a
 * row of `strip` tiles of pixels, or one tile of cells; on GPUs, where `strip` is 1, a cell of a tile's first level
 * (push), a tile (push_levels), or a pixel or cell (pull). Cost: O(pixels). Determinism: a pixel that is written is
 * only read by its own work-item; sums run in a fixed order.
 */
#include "warp/fill_cells.h"
#include "warp/fill_tiles.h"

#if LANES == 16
#define PUSHERS 1 /* work-items that push, along a tile's side */
#define PULLERS 1 /* work-items that pull, along a tile's side */
#define PUSH_PIXELS push_tile
#define PUSH_CELLS push_base_tile
#define PULL_CELLS pull_base_tile
#define PULL_PIXELS pull_tile
#else
#define PUSHERS (TILE / 2)
#define PULLERS TILE
#define PUSH_PIXELS push_quad
#define PUSH_CELLS push_base_quad
#define PULL_CELLS pull_cell
#define PULL_PIXELS pull_pixel
#endif

kernel void push_pixels(global const channel *color, global const float *depth, global const uchar *valid,
                        global const float *behind, int width, int height, int pitch, int perspective, int strip,
                        global float *inner, global float *cells)
{
    const int across = (width + TILE - 1) / TILE, down = (height + TILE - 1) / TILE;
    const int first = get_global_id(0) * strip, row = get_global_id(1);
    if (row >= PUSHERS * down)
        return;
    for (int column = first; column < min(first + strip, PUSHERS * across); column++)
        PUSH_PIXELS(color, depth, valid, behind, width, height, pitch, perspective, column, row, across, down, inner,
                    cells);
}

kernel void push_cells(global const float *base, int width, int height, int perspective, int level, global float *inner,
                       global float *cells)
{
    const int across = (width + TILE - 1) / TILE, down = (height + TILE - 1) / TILE;
    const int column = get_global_id(0), row = get_global_id(1);
    if (column < PUSHERS * across && row < PUSHERS * down)
        PUSH_CELLS(base, width, height, perspective, level, column, row, across, down, inner, cells);
}

kernel void pull_cells(global float *base, int width, int height, global const float *inner, global const float *cells)
{
    const int across = (width + TILE - 1) / TILE, down = (height + TILE - 1) / TILE;
    const int column = get_global_id(0), row = get_global_id(1);
    if (column * (TILE / PULLERS) < width && row * (TILE / PULLERS) < height)
        PULL_CELLS(base, width, height, column, row, across, down, inner, cells);
}

kernel void pull_pixels(global channel *color, global float *depth, global const uchar *valid,
                        global const float *behind, int width, int height, int pitch, int perspective, int strip,
                        global const float *inner, global const float *cells)
{
    const int across = (width + TILE - 1) / TILE, down = (height + TILE - 1) / TILE;
    const int first = get_global_id(0) * strip, row = get_global_id(1), side = TILE / PULLERS;
    if (row * side >= height)
        return;
    for (int column = first; column < first + strip && column * side < width; column++)
        PULL_PIXELS(color, depth, valid, behind, width, height, pitch, perspective, column, row, across, down, inner,
                    cells);
}
