/* Speckle: islands of so few samples, apart from what is around them, that no surface is known to be there.
 *
 * Samples above or beside each other that are less than 1 apart are one island. Each has the number of its first
 * pixel: runs of pixels are joined by union-find with atomic minima (Playne, Hawick: A new algorithm for parallel
 * connected-component labelling on GPUs, 2018). An island of no more than SPECKLE pixels, or a tenth of the image's,
 * is none but noise; unless one of its samples is what the frame before had there: a wire that broke into pieces.
 *
 * values: a plane on a scale (scale.h) in which surfaces are apart by 1; measured, known: the same of what was
 * measured, and of the frame before. labels: a plane; at a run's first pixel the place of a run's before it, or its
 * own; at others that of the run's first pixel. sizes: a plane; pixels of the run, and then of the island, at the
 * first pixel; 0 at others. totals: samples, and whether a seed is speckle. marks: plane.h; speckle is DOUBTED and no
 * SEED any more. Work-item: `run` pixels of a row. O(pixels). Determinism: integers, whose minima and sums know no
 * order.
 */
#include "cleaning/plane.h"
#include "cleaning/scale.h"

#define SPECKLE 40
#define SPECKLE_PART 10
#define OF_BEFORE (1 << 30) /* in `sizes`: the frame before had some of it */

#define ARE_ONE(a, b) (IS_KNOWN(a) & IS_KNOWN(b) & (fabs((a) - (b)) <= 1.0f))

#define BEGIN_RUN(plane, run)                                                                                  \
    const int first = get_global_id(0) * run, row = get_global_id(1);                                          \
    if (first >= plane.width || row >= plane.height)                                                           \
        return;                                                                                                \
    const int line = (row + ABOVE) * plane.pitch + ASIDE;                                                      \
    const int begin = line + first, end = line + min(first + run, plane.width);

kernel void find_runs(global const float *values, global const float *measured, global const float *known,
                      int has_before, global const uchar *marks, global int *labels, global int *sizes,
                      global int *totals, ImagePlane plane, int run)
{
    BEGIN_RUN(plane, run)
    int start = begin, length = 0, is_of_before = 0, count = 0;
    for (int at = begin; at < end; at++) {
        const float value = values[at];
        if (at > begin && !ARE_ONE(values[at - 1], value)) {
            sizes[start] = length | is_of_before;
            start = at, length = 0, is_of_before = 0;
        }
        labels[at] = start;
        sizes[at] = 0;
        if (IS_KNOWN(value))
            length++, count++;
        if (has_before && (marks[at] & KEPT) && ARE_ONE(measured[at], known[at]))
            is_of_before = OF_BEFORE;
    }
    sizes[start] = length | is_of_before;
    atomic_add(totals, count);
}

int root_of(global volatile int *labels, int at)
{
    for (int label = labels[at]; label != at; label = labels[at])
        at = label;
    return at;
}

void join_islands(global volatile int *labels, int a, int b)
{
    for (;;) {
        a = root_of(labels, a), b = root_of(labels, b);
        if (a == b)
            return;
        const int high = max(a, b), low = min(a, b), label = atomic_min(labels + high, low);
        if (label == high)
            return;
        a = low, b = label; /* it got another one meanwhile */
    }
}

kernel void join_runs(global const float *values, global int *labels, ImagePlane plane, int run)
{
    BEGIN_RUN(plane, run)
    global const float *above = values - plane.pitch;
    for (int at = begin; at < end; at++) {
        const int goes_on = ARE_ONE(values[at - 1], values[at]);
        if (goes_on && at == begin)
            join_islands(labels, at, at - 1);
        const int is_known = goes_on && ARE_ONE(above[at - 1], above[at]) && ARE_ONE(above[at - 1], values[at - 1]);
        if (ARE_ONE(above[at], values[at]) && !is_known)
            join_islands(labels, at, at - plane.pitch);
    }
}

kernel void add_runs(global int *labels, global int *sizes, ImagePlane plane, int run)
{
    BEGIN_RUN(plane, run)
    for (int at = begin; at < end; at++) {
        const int size = sizes[at];
        if (size == 0)
            continue;
        const int root = root_of(labels, at);
        if (root != at) {
            labels[at] = root;
            atomic_add(sizes + root, size & (OF_BEFORE - 1));
            if (size & OF_BEFORE)
                atomic_or(sizes + root, OF_BEFORE);
        }
    }
}

kernel void drop_speckle(global const float *values, global const int *labels, global const int *sizes,
                         global int *totals, global uchar *marks, ImagePlane plane, int run)
{
    BEGIN_RUN(plane, run)
    const int most = min(SPECKLE, totals[0] / SPECKLE_PART);
    int has_seed = 0;
    for (int at = begin; at < end; at++)
        if (IS_KNOWN(values[at]) && sizes[labels[labels[at]]] <= most) {
            has_seed |= marks[at] & SEED;
            marks[at] = (marks[at] & AREA) | DOUBTED;
        }
    if (has_seed)
        atomic_or(totals + 1, 1);
}
