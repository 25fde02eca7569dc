/* Finds speckle: islands of few samples, apart from their surroundings, that are unlikely to be a surface.
 *
 * Vertical or horizontal neighbours belong to one island if their values differ by at most 1. The label of an island is
 * the index of its first pixel: runs of pixels are joined by union-find with atomic minima (Playne, Hawick: A new
 * algorithm for parallel connected-component labelling on GPUs, 2018). An island is speckle if it has at most SPECKLE
 * pixels and at most a tenth of the image's samples, unless one of its samples agrees with the previous frame: then it
 * may be a piece of a wire with gaps.
 *
 * values: a plane on a scale (scale.h) on which surfaces are at least 1 apart. measured, known: such planes of the
 * measured depth and of the previous frame's. labels: a plane; at the first pixel of a run, the index of the first
 * pixel of an earlier run or of this run; at other pixels, the index of the run's first pixel. sizes: a plane; at the
 * first pixel of a run, the number of the run's pixels, later of the island's; 0 at other pixels. totals: the number of
 * samples, and 1 if any seed is speckle, else 0. marks: plane.h; speckle becomes DOUBTED and loses SEED. Work-item:
 * `run` pixels of a row. Cost: O(pixels). Determinism: minima and sums of integers do not depend on their order.
 */
#include "cleaning/plane.h"
#include "cleaning/scale.h"

#define SPECKLE 40
#define SPECKLE_PART 10
#define OF_BEFORE (1 << 30) /* flag in `sizes`: a sample of the run or island agrees with the previous frame */

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
        a = low, b = label; /* another work-item has changed high's label: its island is joined, too */
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
