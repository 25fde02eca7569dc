#ifndef WARP_WALK_COLUMNS_H
#define WARP_WALK_COLUMNS_H
/* Walks lines of the source from column to column (or from row to row). Where all triangles between two columns are
 * closed, the surface counts as straight: its corners at diagonals and rows are left out. It ends at open triangles.
 */
#include "warp/interval.h"

/* Places where lines pass a column, between two samples */
typedef struct {
    floatl cell; /* the first sample */
    floatl part; /* position from the first sample to the second, 0 to 1; outside of this range beyond the image */
    intl at;           /* the first sample's index */
    floatl a, b;       /* the samples' nearness */
    Projection place;
} Column;

/* A step of the lines from one column to the next: through one cell, or through two cells if it crosses a row. */
typedef struct {
    Column from, to;
    floatl begins, ends; /* part of the step that lies on the line: 0 to 1, except in a line's first and last step */
    floatl passed;                 /* the row that is crossed; 1: the cell's last, -1: its first, 0: none */
    floatl beyond_from, beyond_to; /* if a row is crossed: nearness of each column's third sample (`from`, `to`: two) */
    floatl slope;                  /* rows per column */
    intl mirrored, transposed;     /* masks: columns and rows are both mirrored; columns and rows are swapped */
    intl along, edge;              /* if lines run along edges: their TORN_... bit; mask: this step's edge has it */
} Step;

/* The triangles that lines pass on a step, in order, two in each cell. */
typedef struct {
    floatl leaves[4];   /* position, 0 to 1, at which lines leave each triangle; not above the previous: they miss it */
    floatl nearness[4]; /* the surface's nearness at this position */
    intl open[4];
} PassedTriangles;

/* Tells which triangles of a cell are open. The cell is given by its samples in two columns. `first` is for the
 * triangle that contains both samples of the first column, `second` for the other. */
INLINED void are_open(Step step, floatl from_a, floatl from_b, floatl to_a, floatl to_b, intl *first, intl *second)
{
    const floatl q00 = select_lanes(step.mirrored, to_b, from_a);
    /* q10, q01: in the image, the samples to the right of the cell's first sample and below it */
    const intl swapped = step.mirrored != step.transposed;
    const floatl q10 = select_lanes(swapped, from_b, to_a), q01 = select_lanes(swapped, to_a, from_b);
    const intl lower = IS_LOWER_OPEN(q00), upper = IS_UPPER_OPEN(q00, q10, q01);
    *first = select_lanes(step.along != 0, step.edge, select_lanes(step.mirrored, upper, lower));
    *second = select_lanes(step.along != 0, step.edge, select_lanes(step.mirrored, lower, upper));
}

/* The triangles of a step. A cell's diagonal leads from the second sample of the first column to the first sample of
 * the second column. */
INLINED PassedTriangles triangles_of(Step step)
{
    const Column from = step.from, to = step.to;
    const intl none = step.passed == 0.0f, down = step.passed > 0.0f, up = step.passed < 0.0f;
    /* to_...: samples in the second column, of the step's first cell; from_...: samples in the first column, of its
     * last cell */
    const floatl to_a = select_lanes(down, step.beyond_to, select_lanes(up, to.b, to.a)),
                 to_b = select_lanes(down, to.a, select_lanes(up, step.beyond_to, to.b));
    const floatl from_a = select_lanes(down, from.b, select_lanes(up, step.beyond_from, from.a));
    const floatl from_b = select_lanes(down, step.beyond_from, select_lanes(up, from.a, from.b));
    const floatl per_diagonal = 1.0f / (1.0f + step.slope), diagonal = (1.0f - from.part) * per_diagonal;
    const floatl row = min_lanes(select_lanes(down, 1.0f - from.part, -from.part) / step.slope, (floatl)1.0f);
    const floatl row_from = select_lanes(down, from.b, from.a), row_to = select_lanes(down, to.a, to.b);

    PassedTriangles triangles;
    triangles.leaves[0] = min_lanes(diagonal, select_lanes(none, (floatl)1.0f, row));
    triangles.leaves[1] = select_lanes(none, triangles.leaves[0], row);
    /* A step up enters its second cell beyond the diagonal, so it misses the cell's first triangle. */
    triangles.leaves[2] = select_lanes(down, max_lanes(min_lanes((2.0f - from.part) * per_diagonal, (floatl)1.0f), row),
                                       triangles.leaves[1]);
    triangles.leaves[3] = 1.0f;
    triangles.nearness[1] = row_from + triangles.leaves[1] * (row_to - row_from);
    triangles.nearness[0] = select_lanes(none | (diagonal < row), from.b + triangles.leaves[0] * (to_a - from.b),
                                         triangles.nearness[1]);
    triangles.nearness[2] = from_b + triangles.leaves[2] * (to.a - from_b);
    are_open(step, from.a, from.b, to_a, to_b, &triangles.open[0], &triangles.open[1]);
    are_open(step, from_a, from_b, to.a, to.b, &triangles.open[2], &triangles.open[3]);
    return triangles;
}

/* Extends the interval by a step on which the surface may be torn: each run of closed triangles is a segment. major:
 * the first column's coordinate */
INLINED void extend_torn(Interval *interval, HitWriter *writer, Step step, Targets targets, floatl major, intl active,
                         SweepLines line, LineGroup group, PixelMap map)
{
    const PassedTriangles triangles = triangles_of(step);
    const int is_clipped = any_lane((step.begins > 0.0f) | (step.ends < 1.0f));
    Projection begin = step.from.place, enters = begin, held_begin = begin, held_end = begin, last = begin;
    floatl entered = 0.0f;
    intl inside = 0, held = 0; /* held: mask of runs that have ended and wait until the other lanes' runs end, too */
    for (int part = 0; part < 4; part++) {
        const floatl leaves = CHOSEN(triangles.leaves, part);
        Projection left = step.to.place;
        if (part < 3)
            left = project_at(targets, major + line.sign * leaves, CHOSEN(triangles.nearness, part));
        const Projection passed = left;
        const intl is_passed = leaves > entered;
        intl there = active & is_passed;
        if (is_clipped) { /* clip the part of the step in this triangle to the line */
            const floatl low = max_lanes(entered, step.begins), high = min_lanes(leaves, step.ends);
            const floatl change = (left.nearness - enters.nearness) / (leaves - entered);
            const Projection at_low = project_at(targets, major + line.sign * low,
                                                 enters.nearness + (low - entered) * change);
            const Projection at_high = project_at(targets, major + line.sign * high,
                                                  enters.nearness + (high - entered) * change);
            left = select_projection(is_passed & (high < leaves), at_high, left);
            enters = select_projection(is_passed & (low > entered), at_low, enters);
            there = there & (high > low);
        }
        const intl stops = there & CHOSEN(triangles.open, part);
        const intl ends = inside & stops, second = held & there & !stops;
        if (any_lane(second)) {
            extend(interval, writer, held_begin, held_end, second, (intl)0, line, group, map);
            interval->ended = interval->ended | second;
            held = held & !second;
        }
        held = held | ends;
        held_begin = select_projection(ends, begin, held_begin);
        held_end = select_projection(ends, last, held_end);
        interval->ended = interval->ended | (stops & !held);
        begin = select_projection(inside, begin, enters);
        inside = (inside | there) & !stops;
        last = select_projection(there, left, last);
        enters = select_projection(is_passed, passed, enters);
        entered = max_lanes(entered, leaves);
    }
    if (any_lane(held | inside))
        extend(interval, writer, select_projection(held, held_begin, begin), select_projection(held, held_end, last),
               held | inside, (intl)0, line, group, map);
    interval->ended = interval->ended | held;
}

/* A line through samples of a row, column or diagonal sees only the edges between these samples. Returns the TORN_...
 * bit of these edges; 0 for other lines. */
INLINED intl edges_along(floatl start, floatl slope, floatl length, intl u_major)
{
    const floatl longest = max_lanes(length, (floatl)1.0f);
    const intl on_samples = fabs(start - floor_lanes(start + 0.5f)) < ON_SAMPLES;
    const intl diagonals = on_samples & (fabs(slope + 1.0f) * longest < ON_SAMPLES);
    const intl straight = on_samples & (fabs(slope) * longest < ON_SAMPLES);
    const intl edges = select_lanes(u_major, (intl)TORN_RIGHT, (intl)TORN_BELOW);
    return select_lanes(straight, edges, select_lanes(diagonals, (intl)TORN_DIAGONAL, (intl)0));
}

/* For steps along an edge: the sample that stores the edge's bit, which is the edge's upper or left sample or, for a
 * diagonal, the upper left sample of its cell */
INLINED floatl edge_owner(Grid grid, Step step, intl stride)
{
    const intl along_diagonals = step.along == TORN_DIAGONAL;
    const floatl owner = select_lanes(step.mirrored, step.to.a, step.from.a);
    if (!any_lane(along_diagonals))
        return owner;
    const intl above = select_lanes(step.mirrored, step.to.at + stride, step.from.at - stride);
    return select_lanes(along_diagonals, (floatl)(gather(grid.nearness, max(above, (intl)(-grid.pitch - 1)))), owner);
}

/* The columns that lines pass. If a line's steps lead to smaller columns, its rows are numbered from the last one, so
 * that all lines cross the cells' diagonals in the same direction. */
typedef struct {
    floatl minor_0, tilt;   /* row = minor_0 + tilt * column */
    intl along;             /* as in Step */
    intl at_0, stride;      /* index of the sample in column 0 and row 0, and stride from row to row */
    intl last_row, last_column, stride_major;
    intl ahead;             /* index of the sample that is prefetched, minus the index of the column's sample */
} Columns;

INLINED Columns columns_of(SweepLines line)
{
    const intl mirrored = line.sign < 0.0f;
    Columns columns;
    columns.minor_0 = select_lanes(mirrored, to_floatl(line.last_minor) - line.minor_0, line.minor_0);
    columns.tilt = select_lanes(mirrored, -line.tilt, line.tilt);
    columns.along = 0;
    columns.at_0 = select_lanes(mirrored, line.last_minor * line.stride_minor, (intl)0);
    columns.stride = select_lanes(mirrored, -line.stride_minor, line.stride_minor);
    columns.last_row = line.last_minor;
    columns.last_column = to_intl(line.last_major);
    columns.stride_major = line.stride_major;
    columns.ahead = PREFETCH_STEPS * to_intl(line.sign) * line.stride_major;
    return columns;
}

/* The column at a major coordinate. before: `cell` of the previous column, ignored if `is_first` */
INLINED Column column_at(Columns columns, floatl major, int is_first, floatl before, Grid grid, Targets targets,
                         LineGroup group)
{
    const intl along = columns.along;
    const floatl nudge = select_lanes(along, (floatl)0.5f, (floatl)0.0f);
    const intl last_cell = select_lanes(along, columns.last_row + 1, columns.last_row);
    const intl to_b = select_lanes(along, (intl)0, columns.stride);
    const intl number = clamp(to_intl(major), (intl)-1, columns.last_column + 1);
    const floatl minor = columns.minor_0 + columns.tilt * major;
    Column column;
    column.cell = to_floatl(max(min(to_intl(minor + nudge + 1.0f) - 1, last_cell), (intl)-1));
    if (!is_first) /* a step crosses at most one row, whatever the rounding */
        column.cell = clamp_lanes(column.cell, before - 1.0f, before + 1.0f);
    column.part = select_lanes(along, (floatl)0.0f, minor - column.cell);
    column.at = columns.at_0 + number * columns.stride_major + to_intl(column.cell) * columns.stride;
    const intl last_sample = grid.height * grid.pitch - 1;
    prefetch_across_rows(grid.nearness, clamp(column.at + columns.ahead, (intl)0, last_sample), group);
    const intl at_b = column.at + to_b;
    column.a = (floatl)(gather(grid.nearness, column.at));
    column.b = (floatl)(gather(grid.nearness, at_b));
    const floatl part = clamp_lanes(column.part, (floatl)0.0f, (floatl)1.0f);
    /* Exactly at the second sample, only this sample counts: the first one may be missing. */
    const floatl between = column.a + part * (column.b - column.a);
    column.place = project_at(targets, major, select_lanes(part < 1.0f, between, column.b));
    return column;
}

/* Walks lines of the source, and settles pixels of the target. Returns the number of columns passed. */
INLINED uint walk_columns(Grid grid, SweepLines line, LineGroup group, PixelMap map, HitWriter *writer)
{
    const floatl first = floor_lanes(line.from), last = min_lanes(ceil_lanes(line.to), line.last_major + 1.0f);
    const intl steps = select_lanes((line.low <= line.high) & (line.from <= line.to), to_intl(last - first), (intl)-1);
    const Targets targets = targets_along(map, line);
    const intl mirrored = line.sign < 0.0f;
    Columns columns = columns_of(line);
    const intl stride = columns.stride;
    Step step;
    step.slope = columns.tilt * line.sign;
    step.mirrored = mirrored;
    step.transposed = !line.u_major;
    step.along = edges_along(columns.minor_0 + columns.tilt * first, step.slope, last - first, line.u_major);
    step.edge = 0;
    const intl along = step.along != 0;
    columns.along = along;
    /* Lines begin and end at the image's border or at the epipole, which may lie between columns. */
    const floatl begins = select_lanes(mirrored, last - line.to, line.from - first);
    const floatl ends = 1.0f - select_lanes(mirrored, line.from - first, last - line.to);

    Interval interval = nothing_settled(line);
    floatl major = select_lanes(mirrored, last, first);
    uint passed = 0;
    const intl begin = steps >= 0;
    COUNT(passed, begin)
    step.from = column_at(columns, major, 1, (floatl)0.0f, grid, targets, group);
    Column next = column_at(columns, major + line.sign, 0, step.from.cell, grid, targets, group);
    for (int count = 1; any_lane(count <= steps); count++) {
        const intl active = count <= steps, is_last = count == steps;
        COUNT(passed, active)
        const Column from = step.from, to = next;
        major += line.sign;
        /* Samples are fetched one step ahead. */
        next = column_at(columns, major + line.sign, 0, to.cell, grid, targets, group);
        step.passed = select_lanes(along, (floatl)0.0f, to.cell - from.cell);
        step.beyond_from = from.a;
        step.beyond_to = to.a;
        if (any_lane(step.passed != 0.0f)) {
            const intl down = step.passed > 0.0f, up = step.passed < 0.0f;
            const intl at_from = from.at + select_lanes(down, 2 * stride, select_lanes(up, -stride, (intl)0));
            const intl at_to = to.at + select_lanes(down, -stride, select_lanes(up, 2 * stride, (intl)0));
            step.beyond_from = (floatl)(gather(grid.nearness, at_from));
            step.beyond_to = (floatl)(gather(grid.nearness, at_to));
        }
        step.begins = 0.0f;
        step.ends = 1.0f;
        if (count == 1)
            step.begins = begins;
        step.ends = select_lanes(is_last, ends, step.ends);
        step.to = to;

        intl bits = as_intl(from.a) | as_intl(from.b) | as_intl(to.a) | as_intl(to.b) | as_intl(step.beyond_from) |
                    as_intl(step.beyond_to);
        if (any_lane(along)) {
            const floatl owner = edge_owner(grid, step, stride);
            step.edge = (as_intl(owner) & step.along) != 0;
            bits = select_lanes(along, as_intl(owner), bits);
        }
        if (any_lane(active & ((bits & TORN_ALL) != 0))) {
            extend_torn(&interval, writer, step, targets, major - line.sign, active, line, group, map);
        } else {
            Projection begin = from.place, end = to.place;
            if (count == 1 || any_lane(is_last)) {
                const floatl nearness = begin.nearness, change = end.nearness - nearness;
                begin = project_at(targets, major + line.sign * (step.begins - 1.0f), nearness + step.begins * change);
                end = project_at(targets, major + line.sign * (step.ends - 1.0f), nearness + step.ends * change);
            }
            extend(&interval, writer, begin, end, active, (intl)0, line, group, map);
        }
        step.from = to;
    }
    return passed;
}
#endif
