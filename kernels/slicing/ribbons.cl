/* Things one sample thin in a depth image: their samples, and their ribbons (lib/ribbons.h), which objects are made of
 * (slicing/object.cl).
 *
 * surface: (height + 2, pitch), picture/edges.cl. thin: (height, width) 1 where a sample is. samples: (count,) the thin
 * ones' numbers, y * width + x. ribbons: (count, NEIGHBOURS, RIBBON_FLOATS) to each neighbour of each; nearness is
 * NO_SURFACE where there is none. Work-item: a row; a thin sample. Cost: O(samples), and O(RUN_MAX) for each ribbon.
 * Determinism: every one on its own.
 */
#include "lib/ribbons.h"
#include "slicing/ribbon_record.h"

kernel void mark_thin(global const float *surface, global uchar *thin, int width, int height, int pitch, Cut cut)
{
    const int y = get_global_id(0);
    const Grid grid = GRID_OF(surface, width, height, pitch, cut);
    if (y >= height)
        return;
    for (int x = 0; x < width; x++)
        thin[(size_t)y * width + x] = sample_at(grid, x, y) > NO_SURFACE && is_thin(grid, x, y);
}

kernel void find_ribbons(global const float *surface, global const int *samples, global float *ribbons, int count,
                         int width, int height, int pitch, Cut cut)
{
    const int number = get_global_id(0);
    const Grid grid = GRID_OF(surface, width, height, pitch, cut);
    if (number >= count)
        return;
    const int x = samples[number] % width, y = samples[number] / width;
    for (int neighbour = 0; neighbour < NEIGHBOURS; neighbour++) {
        global float *to = ribbons + RIBBON_FLOATS * ((size_t)number * NEIGHBOURS + neighbour);
        if (!is_first_of(grid, x, y, neighbour)) {
            vstore8((float8)NO_SURFACE, 0, to);
            continue;
        }
        const Ribbon one = ribbon_of(grid, x, y, neighbour);
        vstore8((float8)(one.x, one.y, one.dx, one.dy, one.n, one.gu, one.gv, one.ends), 0, to);
    }
}
