#ifndef WARP_CELLS_H
#define WARP_CELLS_H
/* Traverses the source's triangulated grid along a straight line, from cell to cell.
 *
 * In a cell, the line has two parts, one in each triangle: from its entry to the diagonal, and from the diagonal to its
 * exit. One part does not exist if the line misses a triangle.
 */
#include "lib/lanes.h"
#include "lib/surface.h"

/* Lines of the source, one for each lane, as functions of the distance: pixels walked along the line's major axis. */
typedef struct {
    floatl u, v, du, dv; /* position at distance 0, and its change per unit of distance */
    floatl length;       /* distance to walk; < 0: no walk */
    intl along_row, along_column, along_diagonal; /* the line runs along edges of the grid */
} Lines;

/* Values that are the same in all cells of a line. */
typedef struct {
    floatl step_u, step_v;   /* 1 or -1: the steps to the next cell */
    floatl ahead_u, ahead_v; /* offset from a cell's first sample to the column and the row where lines may leave it */
    /* per_...: distance on the line from column to column, row to row, diagonal to diagonal; never_u: INFINITY if the
     * line crosses no column, else 0; never_v: the same for rows */
    floatl per_u, per_v, per_d, never_u, never_v;
    floatl last_x, last_y;   /* the last cell's column and row */
    float lowest;            /* the last row that has a row below */
    intl edges;              /* TORN_... bits of the edges that the line sees: all, or the edges that it runs along */
    intl lower_first;        /* the line passes a cell's lower triangle before its upper one */
    int collapsed; /* 1: some lines run along edges; their cells are collapsed onto these edges */
} Traversal;

typedef struct {
    floatl x, y;                /* position of the cell's upper left sample */
    floatl q10, q00, q01, q11;  /* nearness of the cell's samples; q10 is to the right of q00 */
    floatl lower_u, lower_v, upper_u, upper_v; /* gradients of the cell's triangles */
    floatl crossing, out;       /* distances at which the line crosses the diagonal, and leaves the cell */
    floatl q_in, q_crossing, q_out; /* the surface's nearness at the entry, the crossing and the exit */
    intl has_first, has_second; /* masks: the line's first, second part exists */
    intl first_open, second_open; /* masks: the first, second part lies in an open triangle */
    floatl next_x, next_y;
} Cell;

/* Snaps lines onto rows, columns or diagonals of samples that they follow within rounding. */
INLINED void snap(Lines *lines)
{
    const floatl longest = fmax(lines->length, (floatl)1.0f);
    const floatl row = floor_lanes(lines->v + 0.5f), column = floor_lanes(lines->u + 0.5f);
    const floatl diagonal = floor_lanes(lines->u + lines->v + 0.5f);
    lines->along_row = (fabs(lines->dv) * longest < ON_SAMPLES) & (fabs(lines->v - row) < ON_SAMPLES);
    lines->along_column = (fabs(lines->du) * longest < ON_SAMPLES) & (fabs(lines->u - column) < ON_SAMPLES);
    lines->along_diagonal = (fabs(lines->du + lines->dv) * longest < ON_SAMPLES) &
                            (fabs(lines->u + lines->v - diagonal) < ON_SAMPLES);
    lines->dv = select_lanes(lines->along_row, (floatl)0.0f,
                             select_lanes(lines->along_diagonal, -lines->du, lines->dv));
    lines->du = select_lanes(lines->along_column, (floatl)0.0f, lines->du);
    lines->v = select_lanes(lines->along_row, row, select_lanes(lines->along_diagonal, diagonal - lines->u, lines->v));
    lines->u = select_lanes(lines->along_column, column, lines->u);
}

INLINED Traversal traversal_of(Lines lines, Grid grid)
{
    const floatl du = lines.du, dv = lines.dv;
    Traversal traversal;
    traversal.step_u = select_lanes(du < 0.0f, (floatl)-1.0f, (floatl)1.0f);
    traversal.step_v = select_lanes(dv < 0.0f, (floatl)-1.0f, (floatl)1.0f);
    traversal.ahead_u = select_lanes(du > 0.0f, (floatl)1.0f, (floatl)0.0f);
    traversal.ahead_v = select_lanes(dv > 0.0f, (floatl)1.0f, (floatl)0.0f);
    traversal.per_u = select_lanes(du == 0.0f, (floatl)0.0f, 1.0f / du);
    traversal.per_v = select_lanes(dv == 0.0f, (floatl)0.0f, 1.0f / dv);
    traversal.per_d = 1.0f / (du + dv);
    traversal.never_u = select_lanes(du == 0.0f, (floatl)INFINITY, (floatl)0.0f);
    traversal.never_v = select_lanes(dv == 0.0f, (floatl)INFINITY, (floatl)0.0f);
    traversal.lower_first = du + dv >= 0.0f;
    traversal.last_x = select_lanes(lines.along_column, (floatl)grid.width, (floatl)(grid.width - 1));
    traversal.last_y = select_lanes(lines.along_row, (floatl)grid.height, (floatl)(grid.height - 1));
    traversal.lowest = grid.height - 1;
    traversal.edges = select_lanes(lines.along_diagonal, (intl)TORN_DIAGONAL, (intl)TORN_ALL);
    traversal.edges = select_lanes(lines.along_column, (intl)TORN_BELOW, select_lanes(lines.along_row, (intl)TORN_RIGHT, traversal.edges));
    traversal.collapsed = any_lane(traversal.edges != TORN_ALL);
    return traversal;
}

/* Collapses the corners of cells (`gather_cells`) onto one row or column of samples, so that only these count. lower:
 * the line runs along the cells' second row, as in the last row of an image. */
INLINED void collapse_cells(floatl *corners, intl on_row, intl lower, intl on_column)
{
    corners[0] = select_lanes(on_row & lower, corners[2], corners[0]);
    corners[1] = select_lanes(on_row & lower, corners[3], corners[1]);
    corners[2] = select_lanes(on_row, corners[0], corners[2]);
    corners[3] = select_lanes(on_row, corners[1], corners[3]);
    corners[1] = select_lanes(on_column, corners[0], corners[1]);
    corners[3] = select_lanes(on_column, corners[2], corners[3]);
}

INLINED void enter_cells(Lines lines, floatl at, intl which, floatl *x, floatl *y)
{
    const floatl u = lines.u + lines.du * at, v = lines.v + lines.dv * at;
    *x = select_lanes(which, select_lanes(lines.du < 0.0f, ceil_lanes(u) - 1.0f, floor_lanes(u)), *x);
    *y = select_lanes(which, select_lanes(lines.dv < 0.0f, ceil_lanes(v) - 1.0f, floor_lanes(v)), *y);
}

/* Intersects lines with the cells (x, y) that they enter at distance `at`. The code selects values instead of
 * branching, as branches could not be predicted. Distances are computed from the cells' positions, since sums of steps
 * would drift. */
INLINED Cell pass_cells(Grid grid, Lines lines, Traversal traversal, floatl x, floatl y, floatl at)
{
    Cell cell;
    const floatl xc = clamp_lanes(x, (floatl)-1.0f, traversal.last_x), yc = clamp_lanes(y, (floatl)-1.0f, traversal.last_y);
    const intl base = to_intl(traversal.collapsed ? min_lanes(yc, (floatl)traversal.lowest) : yc) * grid.pitch + to_intl(xc);
    floatl corners[4];
    gather_cells(grid.nearness, grid.pitch, base, corners);
    if (traversal.collapsed)
        collapse_cells(corners, lines.along_row, yc > traversal.lowest, lines.along_column);
    intl lower_open = (as_intl(corners[0]) & traversal.edges) != 0;
    intl upper_open = IS_UPPER_OPEN(corners[0], corners[1], corners[2]);
    if (traversal.collapsed) {
        upper_open = select_lanes(traversal.edges == TORN_ALL, upper_open, lower_open);
        corners[0] = select_lanes(lines.along_diagonal, corners[1], corners[0]);
        corners[3] = select_lanes(lines.along_diagonal, corners[1], corners[3]);
    }
    const floatl q00 = corners[0], q10 = corners[1], q01 = corners[2], q11 = corners[3];

    const floatl out_u = (x + traversal.ahead_u - lines.u) * traversal.per_u + traversal.never_u;
    const floatl out_v = (y + traversal.ahead_v - lines.v) * traversal.per_v + traversal.never_v;
    const floatl out = clamp_lanes(min_lanes(out_u, out_v), at, lines.length);
    const floatl diagonal = (xc + yc + 1.0f - (lines.u + lines.v)) * traversal.per_d;
    cell.next_x = x + select_lanes(out_u <= out_v, traversal.step_u, (floatl)0.0f);
    cell.next_y = y + select_lanes(out_v <= out_u, traversal.step_v, (floatl)0.0f);
    cell.crossing = clamp_lanes(diagonal, at, out);
    cell.out = out;
    cell.has_first = diagonal > at; /* a line along the diagonal has only the second part */
    cell.has_second = !(diagonal >= out);

    const floatl u_0 = lines.u - xc + lines.du * at, v_0 = lines.v - yc + lines.dv * at;
    const floatl u_2 = lines.u - xc + lines.du * out, v_2 = lines.v - yc + lines.dv * out;
    const floatl u_1 = lines.u - xc + lines.du * cell.crossing;
    cell.lower_u = q10 - q00;
    cell.lower_v = q01 - q00;
    cell.upper_u = q11 - q01;
    cell.upper_v = q11 - q10;
    const intl enters_lower = (traversal.lower_first & cell.has_first) | (!(traversal.lower_first | cell.has_first));
    const intl leaves_lower = (traversal.lower_first & (!cell.has_second)) |
                              ((!traversal.lower_first) & cell.has_second);
    cell.q_in = select_lanes(enters_lower, q00 + cell.lower_u * u_0 + cell.lower_v * v_0,
                             q10 + cell.upper_u * (u_0 - 1.0f) + cell.upper_v * v_0);
    cell.q_out = select_lanes(leaves_lower, q00 + cell.lower_u * u_2 + cell.lower_v * v_2,
                              q10 + cell.upper_u * (u_2 - 1.0f) + cell.upper_v * v_2);
    cell.q_crossing = q01 + u_1 * (q10 - q01);

    const intl beyond = lines.along_diagonal & ((x != xc) | (y != yc)); /* outside of the grid, because of rounding */
    lower_open = beyond | lower_open;
    upper_open = beyond | upper_open;
    cell.first_open = select_lanes(traversal.lower_first, lower_open, upper_open);
    cell.second_open = select_lanes(traversal.lower_first, upper_open, lower_open);
    cell.x = xc;
    cell.y = yc;
    cell.q00 = q00;
    cell.q10 = q10;
    cell.q01 = q01;
    cell.q11 = q11;
    return cell;
}
#endif
