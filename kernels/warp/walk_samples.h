#ifndef WARP_WALK_SAMPLES_H
#define WARP_WALK_SAMPLES_H
/* Walks along rows or columns of samples of the source, from sample to sample. This is exact: such a line runs
 * along the edges between its samples, and crosses no other edge.
 */
#include "warp/interval.h"

/* Walks lines of the source, and settles pixels of the target. Returns the number of samples passed. */
INLINED uint walk_samples(Grid grid, SweepLines line, LineGroup group, PixelMap map, HitWriter *writer)
{
    const floatl first = floor_lanes(line.from), last = min_lanes(ceil_lanes(line.to), line.last_major + 1.0f);
    const intl steps = select_lanes((line.low <= line.high) & (line.from <= line.to), to_intl(last - first), (intl)-1);
    const Targets targets = targets_along(map, line);
    const intl row = clamp(to_intl(line.minor_0), (intl)0, line.last_minor) * line.stride_minor; /* may lie outside */
    Interval interval = nothing_settled(line);
    floatl major = select_lanes(line.sign > 0.0f, first, last);
    const intl rises = line.sign > 0.0f;
    const floatl begins = select_lanes(rises, line.from, line.to), ends = select_lanes(rises, line.to, line.from); /* between samples */
    floatl n = NO_SURFACE;
    Projection from = project_at(targets, major, n);
    const intl ahead = PREFETCH_STEPS * to_intl(line.sign) * line.stride_major, last_sample = grid.height * grid.pitch - 1;
    uint samples = 0;
    for (int count = 0; any_lane(count <= steps); count++, major += line.sign) {
        const intl active = count <= steps;
        COUNT(samples, active)
        const intl at = row + clamp(to_intl(major), (intl)-1, to_intl(line.last_major) + 1) * line.stride_major;
        prefetch_across_rows(grid.nearness, clamp(at + ahead, (intl)0, last_sample), group);
        const floatl before = n, last_step = clamp_lanes((ends - major) * line.sign, (floatl)-1.0f, (floatl)0.0f);
        n = (floatl)(gather(grid.nearness, at));
        const floatl change = n - before;
        if (count == 1)
            from = project_at(targets, begins, n - change * (major - begins) * line.sign);
        const Projection to = project_at(targets, major + last_step * line.sign, n + last_step * change);
        /* The bit of an edge is stored in the left or upper one of its two samples. */
        const intl owner = select_lanes(rises, as_intl(before), as_intl(n)), edge = select_lanes(line.u_major, (intl)TORN_RIGHT, (intl)TORN_BELOW);
        extend(&interval, writer, from, to, active & (intl)(count ? -1 : 0), (owner & edge) != 0, line, group, map);
        from = to;
    }
    return samples;
}
#endif
