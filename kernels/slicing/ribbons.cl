/* Writes the ribbons of a depth image (lib/ribbons.h) as records, which slicing/object.cl reads.
 *
 * surface: (height + 2, pitch), picture/edges.cl. numbers: (count,), picture/ribbons.cl. records: (count,
 * RIBBON_FLOATS). Work-item: a ribbon. Cost: O(RUN_MAX). Determinism: ribbons are independent.
 */
#include "lib/ribbons.h"
#include "slicing/records.h"

kernel void record_ribbons(global const float *surface, global const uint *numbers, global float *records, int count,
                           int width, int height, int pitch, Cut cut)
{
    const int i = get_global_id(0);
    const Grid grid = GRID_OF(surface, width, height, pitch, cut);
    if (i >= count)
        return;
    const Ribbon one = numbered_ribbon(grid, numbers[i]);
    vstore8((float8)(one.x, one.y, one.dx, one.dy, one.n, one.gu, one.gv, one.ends), i, records);
}
