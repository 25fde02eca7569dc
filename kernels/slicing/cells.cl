/* Computes the surface of a depth image between its samples, as a map (records.h), for objects from images.
 *
 * An image knows its surface only at its samples. If the surface were bilinear in between, protruding details would be
 * cut off, and each further image would cut off more. So at a crease, the surface reaches to where the planes through
 * the samples on both sides meet, and at a depth edge it continues with its slope.
 *
 * depth: (height, width). maps: from `start` on, (2, height, width) the samples' nearness, then cells. Work-item: STRIP
 * packets of samples in a row, each the upper left one of a cell. Cost: O(samples). Determinism: cells are independent.
 */
#include "lib/lanes.h"
#include "lib/pixelspace.h"
#include "slicing/records.h"

/* In sample distances: */
#define EDGE 3.0f      /* neighbouring samples farther apart in depth belong to two surfaces */
#define RISE_MAX 2.0f  /* greatest depth by which a surface may be nearer than its samples */
/* In other units: */
#define ROUND 0.375f   /* fraction of the bend next to a crease by which the crease is lowered, as roundness */
#define FALL 1e30f     /* stands for the difference in nearness to a neighbour that is not solid */
#define LINE 6         /* number of samples that are read on the line through a cell's side */
#define FIRST 2        /* index of the side's first sample in this line */

typedef struct {
    int width, height, perspective;
    float far;            /* depth from which on there is no surface */
    int missing_is_empty; /* 1: samples without depth are empty; 0: they are unknown */
    float empty, unknown; /* nearness of empty and of unknown samples */
    float per_sample;     /* difference in nearness over a depth of one sample distance; perspective: at nearness 1 */
} CellImage;

typedef struct {
    floatl nearness;
    intl solid, empty;
    intl here; /* the sample lies in the image; else it repeats a border sample */
} CellSample;

/* Samples (low, y) to (low + LANES - 1, y) */
INLINED CellSample cell_sample(global const float *depth, CellImage image, int low, int y)
{
    const intl x = low + lane_index, column = min(max(x, (intl)0), (intl)(image.width - 1));
    const int row = min(max(y, 0), image.height - 1);
    floatl d;
    if (low >= 0 && low + LANES <= image.width)
        d = load_lanes(depth + row * image.width + low);
    else
        d = (floatl)(gather(depth, row * image.width + column));
    CellSample sample;
    sample.here = (column == x) & (intl)(row == y ? -1 : 0);
    sample.solid = (d > 0.0f) & (d < image.far);
    sample.empty = (!sample.solid) & ((intl)(image.missing_is_empty ? -1 : 0) | (d >= image.far));
    sample.nearness = select_lanes(sample.solid, DEPTH_OF(image.perspective, d),
                                   select_lanes(sample.empty, (floatl)image.empty, (floatl)image.unknown));
    return sample;
}

/* The difference in nearness over a depth of one sample distance */
INLINED floatl size_of_sample(CellImage image, floatl nearness)
{
    return image.perspective ? nearness * image.per_sample : (floatl)image.per_sample;
}

/* A cell's side. first, last: the surface's rise in nearness from the next sample beyond each end of the side to this
 * end; crease: by how much nearness a crease lies above the side, or 0; sharp: by how much more the surface bends at
 * the side than next to it */
typedef struct {
    floatl first, last, crease, sharp;
} CellSide;

/* line: the samples on the line through the side; the side's two ends are in the middle */
INLINED CellSide side_beside(CellImage image, const CellSample *line)
{
    floatl change[LINE - 1], bend[LINE];
    intl joined[LINE - 1];
    UNROLLED
    for (int k = 0; k < LINE - 1; k++) {
        const floatl by = line[k + 1].nearness - line[k].nearness;
        const intl both = line[k].solid & line[k + 1].solid & line[k].here & line[k + 1].here;
        joined[k] = both & (fabs(by) <= EDGE * size_of_sample(image, line[k].nearness));
        change[k] = select_lanes(both, by, select_lanes(line[k].solid, (floatl)-FALL, (floatl)FALL));
    }
    UNROLLED
    for (int k = 1; k < LINE - 1; k++)
        bend[k] = max_lanes(change[k - 1] - change[k], (floatl)0.0f);
    /* The lines through the two samples on either side meet this far above the side, in nearness. */
    const floatl left = bend[2], right = bend[3];
    const floatl height = left / max_lanes(left + right, (floatl)1e-30f) * right;
    /* A round surface bends as much at all samples of this line. It rises above its chord by an eighth of this bend,
     * and a crease by a half. Narrow facets bend more at some samples than at others, so the smallest bend counts. */
    const floatl around = min_lanes(min_lanes(left, right), min_lanes(select_lanes(joined[1], bend[1], (floatl)FALL),
                                                                      select_lanes(joined[3], bend[4], (floatl)FALL)));
    const intl known = joined[2] & (joined[1] | joined[3]);
    const CellSide side = {select_lanes(joined[1], max_lanes(change[1], (floatl)0.0f), (floatl)0.0f),
                           select_lanes(joined[3], max_lanes(-change[3], (floatl)0.0f), (floatl)0.0f),
                           select_lanes(known, height - ROUND * around, (floatl)0.0f),
                           max_lanes(left, right) - around};
    return side;
}

INLINED floatl with_bits(floatl value, intl bits, int places)
{
    return as_floatl((as_intl(value) & ~places) | bits);
}

/* Finds the cells whose first samples are (low, y) to (low + LANES - 1, y). Writes the samples' nearness from `to` on,
 * and the cells at the same place in the second image. */
OUTLINED void find_packet(global const float *depth, CellImage image, int low, int y, global float *to)
{
    CellSample rows[2][LINE], columns[2][LINE];
    UNROLLED
    for (int k = 0; k < 2 * LINE; k++)
        rows[k & 1][k >> 1] = cell_sample(depth, image, low + (k >> 1) - FIRST, y + (k & 1));
    const CellSample corners[4] = {rows[0][FIRST], rows[0][FIRST + 1], rows[1][FIRST], rows[1][FIRST + 1]};
    const floatl first = corners[0].nearness;
    const intl nothing = corners[0].empty & corners[1].empty & corners[2].empty & corners[3].empty;
    intl kind = EMPTY_CELL, bits = CELL_BACKGROUND;
    floatl cell = 0.0f;
    if (any_lane(!nothing)) {
        UNROLLED
        for (int k = 0; k < 2 * LINE; k++) {
            const int side = k & 1, along = k >> 1;
            columns[side][along] = along == FIRST || along == FIRST + 1
                                       ? rows[along - FIRST][FIRST + side]
                                       : cell_sample(depth, image, low + side, y + along - FIRST);
        }
        const CellSide above = side_beside(image, rows[0]), below = side_beside(image, rows[1]);
        const CellSide left = side_beside(image, columns[0]), right = side_beside(image, columns[1]);
        const floatl rises[4] = {above.first + left.first, above.last + right.first, below.first + left.last,
                                 below.last + right.last};
        floatl nearest = first, farthest = first;
        intl whole = -1, beside_empty = 0;
        UNROLLED
        for (int k = 0; k < 4; k++) {
            nearest = max_lanes(nearest, corners[k].nearness);
            farthest = min_lanes(farthest, corners[k].nearness);
            whole = whole & corners[k].solid;
            beside_empty = beside_empty | corners[k].empty;
        }
        const floatl sample = size_of_sample(image, nearest);
        whole = whole & (nearest - farthest <= EDGE * sample);
        intl part = 0;
        floatl ceiling = -INFINITY;
        UNROLLED
        for (int k = 0; k < 4; k++) {
            const intl of_part = select_lanes(beside_empty, !corners[k].empty,
                                              corners[k].nearness >= nearest - EDGE * sample);
            const floatl reach = corners[k].nearness + min_lanes(rises[k], RISE_MAX * sample);
            ceiling = select_lanes(of_part, max_lanes(ceiling, reach), ceiling);
            part = part | select_lanes(of_part, (intl)(1 << k), (intl)0);
        }
        /* A crease along the diagonal crosses no side: it lies above the bilinear surface by a quarter of the twist. */
        const floatl twist = fabs(first - corners[1].nearness - corners[2].nearness + corners[3].nearness),
                     sharp = max_lanes(max_lanes(above.sharp, below.sharp), max_lanes(left.sharp, right.sharp));
        const floatl both = max_lanes(above.crease, below.crease) + max_lanes(left.crease, right.crease) +
                            0.25f * min_lanes(twist, sharp),
                     crease = min_lanes(both, RISE_MAX * sample);
        const intl other = select_lanes(beside_empty, (intl)OUTLINE_CELL,
                                        select_lanes(whole & (crease == 0.0f), (intl)0, (intl)OTHER_CELL));
        kind = select_lanes(nothing, (intl)EMPTY_CELL, other);
        cell = select_lanes(whole, crease, select_lanes(nothing, (floatl)0.0f, ceiling - first));
        bits = select_lanes(whole, (intl)CELL_WHOLE, part) | select_lanes(beside_empty, (intl)CELL_BACKGROUND, (intl)0);
    }
    const int count = image.width - low;
    store_first(with_bits(first, kind, OUTLINE_CELL), to, count);
    store_first(with_bits(cell, bits, CELL_BITS), to + image.width * image.height, count);
}

kernel void find_cells(global const float *depth, global float *maps, int start, CellImage image)
{
    const int first = get_global_id(0) * STRIP * LANES, y = get_global_id(1);
    if (y >= image.height)
        return;
    for (int low = first; low < min(first + STRIP * LANES, image.width); low += LANES)
        find_packet(depth, image, low, y, maps + start + y * image.width + low);
}
