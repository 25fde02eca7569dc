/* Binning: lists the primitives that may touch each bin of BIN x BIN pixels, in the order of the primitives.
 *
 * `project` maps vertices from the world to the target's pixel space. `screen` maps points relative to `origin`, the
 * camera's centre: far from the world's origin, the relative points are exact, and the matrix has no large numbers.
 * `bound_primitives` finds the bins that each primitive may touch. Primitives are divided into chunks of `chunk`
 * primitives; `count_bins` counts each chunk's primitives in each bin. `total_bins` and `total_rows` sum the counts of
 * each bin and of each row of bins. `start_bins` replaces each count by the place in `list` where the chunk's
 * primitives in this bin begin. `fill_bins` writes the indices of the primitives there, so lists keep the order of the
 * primitives, without atomics. `sort_bins` sorts each list from front to back, which pays if the fragment program costs
 * more than the sort.
 *
 * vertices: (count, 3) world. projected: (vertices, 4) homogeneous U, V, W, Q (lib/pixelspace.h). corners: (primitives,
 * CORNERS) vertex indices. boxes: (primitives, 4) first and last bin in x, first and last in y; first > last if
 * invisible. counts: (chunks, bins), initially 0. totals: (bins,). row_totals: (bins_y,). list: primitives, bin by bin.
 * starts: (bins + 1,) start of each bin's list in `list`. keys: as long as `list`, scratch. culled: see triangle.h.
 * Work-item: a vertex (project), STRIP packets of primitives (bound), a chunk (count, fill), a bin (total_bins, start,
 * sort), a row of bins (total_rows). Cost: O(vertices + primitives + list + chunks * bins), plus the sort. Determinism:
 * fixed order.
 */
#include "raster/boxes.h"

#ifndef CORNERS
#define CORNERS 3 /* vertices of a primitive: 3 for triangles, 6 for prisms */
#endif
#ifndef BETWEEN
#define BETWEEN 0 /* 1: primitives that contain no pixel's centre are listed, too */
#endif
#define BIN_MARGIN (BETWEEN ? 1.0f : 0.01f) /* pixels: triangle.h rounds projected corners to 1/256 */

kernel void project(global const float *vertices, global float *projected, int count, float origin_x, float origin_y,
                    float origin_z, Screen screen)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const float3 p = vload3(i, vertices) - (float3)(origin_x, origin_y, origin_z);
    const float *m = screen.from_world;
    const float4 made = {POINT_ROW(m, 0, p), POINT_ROW(m, 1, p), POINT_ROW(m, 2, p), POINT_ROW(m, 3, p)};
    vstore4(made, i, projected);
}

typedef struct {
    floatl U, V, W;
} ProjectedCorner;

INLINED ProjectedCorner corner_of(global const int *corners, global const float *projected, intl index, int k)
{
    floatl row[4];
    gather_rows(projected, (intl)(gather(corners, CORNERS * index + k)), row);
    const ProjectedCorner corner = {row[0], row[1], row[2]};
    return corner;
}

OUTLINED Boxes boxes_of(global const int *corners, global const float *projected, intl index, Screen screen,
                       float nearest_w, int culled)
{
    floatl x[CORNERS], y[CORNERS];
    intl some = (intl)0, all = (intl)(LANES == 1 ? 1 : -1);
    floatl low_x = INFINITY, high_x = -INFINITY, low_y = INFINITY, high_y = -INFINITY;
    UNROLLED
    for (int k = 0; k < CORNERS; k++) {
        const ProjectedCorner corner = corner_of(corners, projected, index, k);
        x[k] = corner.U / corner.W;
        y[k] = corner.V / corner.W;
        const intl before = corner.W >= nearest_w;
        some = some | before;
        all = all & before;
        low_x = select_lanes(before, min_lanes(x[k], low_x), low_x);
        high_x = select_lanes(before, max_lanes(x[k], high_x), high_x);
        low_y = select_lanes(before, min_lanes(y[k], low_y), low_y);
        high_y = select_lanes(before, max_lanes(y[k], high_y), high_y);
    }
    if (any_lane(some & !all)) /* adds points of edges on the near plane; rare, so corners are read again */
        for (int k = 0; k < CORNERS; k++)
            for (int l = 0; l < CORNERS; l++) {
                const ProjectedCorner from = corner_of(corners, projected, index, k),
                                      to = corner_of(corners, projected, index, l);
                const intl leaves = (from.W >= nearest_w) & !(to.W >= nearest_w);
                const floatl part = (from.W - nearest_w) / (from.W - to.W);
                const floatl at_x = (from.U + (to.U - from.U) * part) / nearest_w,
                             at_y = (from.V + (to.V - from.V) * part) / nearest_w;
                low_x = select_lanes(leaves, min_lanes(at_x, low_x), low_x);
                high_x = select_lanes(leaves, max_lanes(at_x, high_x), high_x);
                low_y = select_lanes(leaves, min_lanes(at_y, low_y), low_y);
                high_y = select_lanes(leaves, max_lanes(at_y, high_y), high_y);
            }
#if CORNERS == 3
    if (culled) { /* moved corners (triangle.h) may turn a sliver over: the limit grows with its sides */
        const floatl ax = x[1] - x[0], ay = y[1] - y[0], bx = x[2] - x[0], by = y[2] - y[0];
        const floatl moved = BIN_MARGIN * (1.0f + fabs(ax) + fabs(ay) + fabs(bx) + fabs(by));
        some = some & (!all | ((ax * by - ay * bx) * culled <= moved));
    }
#endif
    return boxes_within(low_x - BIN_MARGIN, high_x + BIN_MARGIN, low_y - BIN_MARGIN, high_y + BIN_MARGIN, some, screen);
}

kernel void bound_primitives(global const int *corners, global const float *projected, global ushort *boxes,
                             int primitives, Screen screen, float nearest_w, int culled)
{
    const int first = get_global_id(0) * STRIP * LANES, last = min(first + STRIP * LANES, primitives);
    for (int start = first; start < last; start += LANES) {
        const Boxes box = boxes_of(corners, projected, min(start + lane_index, (intl)(last - 1)), screen, nearest_w,
                                   culled);
        store_boxes(box, last - start, boxes + (size_t)4 * start);
    }
}

/* Counts a chunk's primitives in each bin; or, with `fills`, writes their indices to `list`, from the places in
 * `counts` on. */
INLINED void go_through_chunk(global const ushort *boxes, global int *counts, global int *list, int fills,
                              int primitives, int chunk, int bins_x, int bins_y)
{
    const int c = get_global_id(0), first = c * chunk, last = min(first + chunk, primitives);
    if (first >= primitives)
        return;
    global int *mine = counts + (size_t)c * bins_x * bins_y;
    for (int i = first; i < last; i++) {
        const ushort4 box = vload4(i, boxes);
        for (int y = box.z; y <= box.w; y++)
            for (int x = box.x; x <= box.y; x++) {
                const int place = mine[y * bins_x + x]++;
                if (fills)
                    list[place] = i;
            }
    }
}

kernel void count_bins(global const ushort *boxes, global int *counts, int primitives, int chunk, int bins_x, int bins_y)
{
    go_through_chunk(boxes, counts, 0, 0, primitives, chunk, bins_x, bins_y);
}

kernel void total_bins(global const int *counts, global int *totals, int chunks, int bins)
{
    const int b = get_global_id(0);
    if (b >= bins)
        return;
    int total = 0;
    for (int c = 0; c < chunks; c++)
        total += counts[(size_t)c * bins + b];
    totals[b] = total;
}

kernel void total_rows(global const int *totals, global int *row_totals, int bins_x, int bins_y)
{
    const int row = get_global_id(0);
    if (row >= bins_y)
        return;
    int total = 0;
    for (int x = 0; x < bins_x; x++)
        total += totals[row * bins_x + x];
    row_totals[row] = total;
}

kernel void start_bins(global int *counts, global const int *totals, global const int *row_totals, global int *starts,
                       int chunks, int bins_x, int bins_y)
{
    const int x = get_global_id(0), row = get_global_id(1), b = row * bins_x + x;
    if (x >= bins_x || row >= bins_y)
        return;
    int place = 0;
    for (int above = 0; above < row; above++)
        place += row_totals[above];
    for (int before = row * bins_x; before < b; before++)
        place += totals[before];
    starts[b] = place;
    if (b == bins_x * bins_y - 1)
        starts[b + 1] = place + totals[b];
    for (int c = 0; c < chunks; c++) {
        const size_t at = (size_t)c * bins_x * bins_y + b;
        const int count = counts[at];
        counts[at] = place;
        place += count;
    }
}

kernel void fill_bins(global const ushort *boxes, global int *counts, global int *list, int primitives, int chunk,
                      int bins_x, int bins_y)
{
    go_through_chunk(boxes, counts, list, 1, primitives, chunk, bins_x, bins_y);
}

float front_of(global const int *corners, global const float *projected, int i)
{
    float nearest = -INFINITY;
    for (int k = 0; k < CORNERS; k++) {
        const float4 p = vload4(corners[CORNERS * i + k], projected);
        nearest = fmax(nearest, p.z > 0.0f ? p.w / p.z : INFINITY);
    }
    return nearest;
}

/* Sorts each list by nearness, nearest first, then by index (heap sort). */
kernel void sort_bins(global const int *corners, global const float *projected, global float *keys, global int *list,
                      global const int *starts, int bins)
{
    const int b = get_global_id(0);
    if (b >= bins)
        return;
    global int *item = list + starts[b];
    global float *key = keys + starts[b];
    const int count = starts[b + 1] - starts[b];
    for (int i = 0; i < count; i++)
        key[i] = front_of(corners, projected, item[i]);
#define COMES_LATER(k, i, l, j) ((k) < (l) || ((k) == (l) && (i) > (j)))
    for (int start = count / 2 - 1, end = count; end > 1;) {
        int hole = 0;
        float k;
        int i;
        if (start >= 0) {
            hole = start--;
            k = key[hole], i = item[hole];
        } else {
            end--;
            k = key[end], i = item[end];
            key[end] = key[0], item[end] = item[0];
        }
        for (int child = 2 * hole + 1; child < end; child = 2 * hole + 1) {
            if (child + 1 < end && COMES_LATER(key[child + 1], item[child + 1], key[child], item[child]))
                child++;
            if (!COMES_LATER(key[child], item[child], k, i))
                break;
            key[hole] = key[child], item[hole] = item[child];
            hole = child;
        }
        key[hole] = k, item[hole] = i;
    }
}
