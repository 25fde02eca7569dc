#ifndef WARP_WALK_EDGES_H
#define WARP_WALK_EDGES_H
/* Walks lines of the source from edge to edge of its triangles: this finds exactly what the lines meet. */
#include "warp/interval.h"

/* Prefetches the samples that lines read some steps later. Along rows, a line reads one cache line for 16 steps, and no
 * other line reads it. So each step prefetches for two lanes only, in turn. */
INLINED void prefetch_samples(Grid grid, SweepLines line, LineGroup group, intl index, int turn)
{
#if LANES == 16
    if (line.u_major.s0) {
        prefetch_at(grid.nearness + int_lane(index, turn & 7));
        prefetch_at(grid.nearness + int_lane(index, (turn & 7) + 8));
    } else {
        prefetch_across_rows(grid.nearness, index, group);
    }
#endif
}

/* Walks lines of the source, and settles pixels of the target. Returns the number of cells passed. */
INLINED uint walk_edges(Grid grid, SweepLines line, LineGroup group, PixelMap map, HitWriter *writer)
{
    const floatl from = select_lanes(line.sign > 0.0f, line.from, line.to), minor = line.minor_0 + line.tilt * from;
    Lines lines;
    lines.u = select_lanes(line.u_major, from, minor);
    lines.v = select_lanes(line.u_major, minor, from);
    lines.du = line.sign * select_lanes(line.u_major, (floatl)1.0f, line.tilt);
    lines.dv = line.sign * select_lanes(line.u_major, line.tilt, (floatl)1.0f);
    lines.length = select_lanes(line.low <= line.high, line.to - line.from, (floatl)-1.0f);
    snap(&lines);
    const Traversal traversal = traversal_of(lines, grid);
    const Targets targets = targets_of(map, line.along, lines.u, lines.v, lines.du, lines.dv);
    Interval interval = nothing_settled(line);
    floatl at = 0.0f, x = 0.0f, y = 0.0f;
    intl active = lines.length > 0.0f, connected = 0;
    enter_cells(lines, at, active, &x, &y);
    Projection before = project_at(targets, at, (floatl)NO_SURFACE);
    const floatl last_u = grid.width - 1, last_v = grid.height - 1;
    uint cells = 0;
    /* A line enters a new cell only by crossing a column or a row, and crosses none twice: so many cells are enough. */
    for (int cells_left = grid.width + grid.height + 6; cells_left > 0 && any_lane(active); cells_left--) {
        COUNT(cells, active)
        const floatl u = clamp_lanes(lines.u + lines.du * (at + PREFETCH_STEPS), (floatl)0.0f, last_u),
                     v = clamp_lanes(lines.v + lines.dv * (at + PREFETCH_STEPS), (floatl)0.0f, last_v);
        prefetch_samples(grid, line, group, to_intl(v) * grid.pitch + to_intl(u), cells_left);
        const Cell cell = pass_cells(grid, lines, traversal, x, y, at);
        const Projection enters = select_projection(connected, before, project_at(targets, at, cell.q_in));
        const Projection crosses = project_at(targets, cell.crossing, cell.q_crossing),
                         leaves = project_at(targets, cell.out, cell.q_out);
        const intl has_both = cell.has_first & cell.has_second;
        for (int part = 0; part < 2; part++) {
            const intl there = active & (part ? cell.has_second : cell.has_first);
            if (!any_lane(there))
                continue;
            const Projection a = part ? select_projection(has_both, crosses, enters) : enters;
            const Projection b = part ? leaves : select_projection(has_both, crosses, leaves);
            const intl open = part ? cell.second_open : cell.first_open;
            extend(&interval, writer, a, b, there, open, line, group, map);
        }
        connected = select_lanes(cell.has_second, !cell.second_open,
                                 select_lanes(cell.has_first, !cell.first_open, connected));
        before = leaves;
        x = cell.next_x;
        y = cell.next_y;
        at = cell.out;
        active = active & (at < lines.length);
    }
    return cells;
}
#endif
