/* On CPUs, computes a whole surface in one launch. Each band of rows gets nearness, edges, border, margins and
 * prominence while it is in cache.
 *
 * Arguments: as in picture/nearness.cl, picture/edges.cl and picture/small_parts.cl. converts: 0 if the nearness is
 * already known. band: number of rows of a band, at least BAND_HALO. A band also needs the rows around it. So two
 * work-items compute these rows, with equal results, and none has to wait for another.
 * Work-item: a band. Cost: O(samples). Determinism: as in the kernels that it replaces.
 */
#include "picture/edges.cl"
#include "picture/nearness.cl"
#include "picture/small_parts.cl"

#define BAND_HALO 2  /* a band's prominence also depends on the edges in this many rows above and below the band */
#define EDGE_HALO 3  /* these edges also depend on the nearness in this many rows beyond them */

#if LANES > 1
kernel void prepare(global const float *depth, global float *nearness, global float *ranges, int converts, float far,
                    global const float *noise, global float *surface, global float *ring, global float *prominence,
                    global float *margins, global int *count, int width, int height, int pitch, int band, int capacity,
                    Cut cut, EdgeTest test)
{
    const int id = get_global_id(0), half_ = ((height + band - 1) / band + 1) / 2;
    /* Runtimes give neighbouring work-items to one thread. With this order, a thread's bands lie all over the image. */
    const int first = (id < half_ ? 2 * id : 2 * (id - half_) + 1) * band, end = min(first + band, height), row = width + 2;
    if (first >= height)
        return;
    const Image image = {nearness, width, height, pitch};
    const Grid grid = GRID_OF(surface, width, height, pitch, NO_CUT);
    const EdgeTest noisy = with_noise(test, noise);
    const int from = max(first - BAND_HALO, 0), to = min(end + BAND_HALO, height);
    for (int y = max(from - EDGE_HALO, 0); converts && y < min(to + EDGE_HALO, height); y++)
        convert_piece(depth, nearness, ranges, 0, y, width, height, pitch, test.perspective, far, width, 0, cut);
    for (int y = from; y < to; y++)
        mark_row(image, 0, width, y, cut, noisy, surface + (size_t)(y + 1) * pitch + 1);
    for (int i = 0; i < row; i++) {
        if (from == 0)
            continue_at(image, surface, ring, i);
        if (to == height)
            continue_at(image, surface, ring, row + i);
    }
    for (int y = from; y < to; y++) {
        continue_at(image, surface, ring, 2 * row + y);
        continue_at(image, surface, ring, 2 * row + height + y);
    }
    for (int y = first; y < end; y++)
        look_around_row(grid, 0, width, y, noisy, prominence, margins, count, capacity);
}
#endif
