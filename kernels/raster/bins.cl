/* Binning: which primitives may touch which bins of BIN x BIN pixels, in the order of the primitives.
 *
 * `count_bins` bounds each primitive and counts, per chunk of primitives and bin; `start_bins` turns the counts of a
 * bin into places, once the host has summed up the bins; `fill_bins` writes the primitives' numbers. A bin's list is
 * in the order of the primitives, since each chunk fills its own part: no atomics, reproducible. `sort_bins` puts each
 * list from front to back, for fragment programs that cost more than that.
 *
 * corners: (primitives, CORNERS) vertices of each. projected: (vertices, 4), see project.cl. boxes: (primitives, 4)
 * first and last bin in x and y; empty (first > last) if it cannot be seen. counts: (chunks, bins). totals: (bins,).
 * starts: (bins + 1,) place of each bin's list in `list`. culled: 1 drops triangles seen from behind, -1 those seen from the front.
 * Work-item: a chunk (count, fill), a bin (start). Cost: O(primitives + list). Determinism: fixed order.
 */
#include "lib/screen.h"

#ifndef BIN
#define BIN 32 /* pixels, the side of a bin */
#endif
#ifndef CORNERS
#define CORNERS 3 /* vertices of a primitive: 3 triangles, 4 tetrahedra */
#endif
#define SLACK 0.01f /* pixels: rounding of the projected corners, to 1/256 in triangle.h */

kernel void count_bins(global const int *corners, global const float *projected, global short *boxes,
                       global int *counts, int primitives, int chunk, int bins_x, int bins_y, Screen screen,
                       float nearest_w, int culled)
{
    const int c = get_global_id(0), first = c * chunk, last = min(first + chunk, primitives);
    if (first >= primitives)
        return;
    global int *mine = counts + (size_t)c * bins_x * bins_y;
    for (int b = 0; b < bins_x * bins_y; b++)
        mine[b] = 0;
    for (int i = first; i < last; i++) {
        float4 p[CORNERS];
        float low_x = INFINITY, high_x = -INFINITY, low_y = INFINITY, high_y = -INFINITY;
        int before = 0;
        for (int k = 0; k < CORNERS; k++) {
            p[k] = vload4(corners[CORNERS * i + k], projected);
            if (!(p[k].z >= nearest_w))
                continue;
            before++;
            const float x = p[k].x / p[k].z, y = p[k].y / p[k].z;
            low_x = fmin(low_x, x);
            high_x = fmax(high_x, x);
            low_y = fmin(low_y, y);
            high_y = fmax(high_y, y);
        }
        if (before && before < CORNERS) /* where its edges cross the near plane */
            for (int k = 0; k < CORNERS; k++)
                for (int l = 0; l < CORNERS; l++) {
                    if (!(p[k].z >= nearest_w) || p[l].z >= nearest_w)
                        continue;
                    const float4 at = p[k] + (p[l] - p[k]) * ((p[k].z - nearest_w) / (p[k].z - p[l].z));
                    low_x = fmin(low_x, at.x / nearest_w);
                    high_x = fmax(high_x, at.x / nearest_w);
                    low_y = fmin(low_y, at.y / nearest_w);
                    high_y = fmax(high_y, at.y / nearest_w);
                }
        const float x0 = fmax(ceil(low_x - SLACK), 0.0f), x1 = fmin(floor(high_x + SLACK), screen.width - 1.0f);
        const float y0 = fmax(ceil(low_y - SLACK), 0.0f), y1 = fmin(floor(high_y + SLACK), screen.height - 1.0f);
        int seen = before && x0 <= x1 && y0 <= y1;
#if CORNERS == 3
        if (seen && culled && before == CORNERS) {
            const float2 a = p[0].xy / p[0].z, b = p[1].xy / p[1].z - a, d = p[2].xy / p[2].z - a;
            seen = (b.x * d.y - b.y * d.x) * culled <= SLACK; /* triangle.h decides */
        }
#endif
        const short4 box = seen ? (short4)((short)(x0 / BIN), (short)(x1 / BIN), (short)(y0 / BIN), (short)(y1 / BIN))
                                : (short4)(1, 0, 1, 0);
        vstore4(box, i, boxes);
        for (int y = box.z; y <= box.w; y++)
            for (int x = box.x; x <= box.y; x++)
                mine[y * bins_x + x]++;
    }
}

kernel void start_bins(global int *counts, global int *totals, global const int *starts, int chunks, int bins,
                       int summed)
{
    const int b = get_global_id(0);
    if (b >= bins)
        return;
    int place = summed ? starts[b] : 0;
    for (int c = 0; c < chunks; c++) {
        const int more = counts[(size_t)c * bins + b];
        if (summed)
            counts[(size_t)c * bins + b] = place;
        place += more;
    }
    totals[b] = place;
}

kernel void fill_bins(global const short *boxes, global int *counts, global int *list, int primitives, int chunk,
                      int bins_x, int bins_y)
{
    const int c = get_global_id(0), first = c * chunk, last = min(first + chunk, primitives);
    if (first >= primitives)
        return;
    global int *places = counts + (size_t)c * bins_x * bins_y;
    for (int i = first; i < last; i++) {
        const short4 box = vload4(i, boxes);
        for (int y = box.z; y <= box.w; y++)
            for (int x = box.x; x <= box.y; x++)
                list[places[y * bins_x + x]++] = i;
    }
}

/* Nearness of the nearest corner */
float front_of(global const int *corners, global const float *projected, int i)
{
    float nearest = -INFINITY;
    for (int k = 0; k < CORNERS; k++) {
        const float4 p = vload4(corners[CORNERS * i + k], projected);
        nearest = fmax(nearest, p.z > 0.0f ? p.w / p.z : INFINITY);
    }
    return nearest;
}

/* Heap sort; equally near ones in the order of their numbers. */
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
#define IS_BEHIND(k, i, l, j) ((k) < (l) || ((k) == (l) && (i) > (j)))
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
            if (child + 1 < end && IS_BEHIND(key[child + 1], item[child + 1], key[child], item[child]))
                child++;
            if (!IS_BEHIND(key[child], item[child], k, i))
                break;
            key[hole] = key[child], item[hole] = item[child];
            hole = child;
        }
        key[hole] = k, item[hole] = i;
    }
}
