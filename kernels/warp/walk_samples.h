#ifndef WARP_WALK_SAMPLES_H
#define WARP_WALK_SAMPLES_H
/* Along rows or columns of the source's samples, from each to the next: exactly what such lines meet, which see the
 * edges between their samples alone.
 */
#include "warp/interval.h"

/* Returns the samples that were passed. */
INLINED uint walk_samples(Grid grid, SweepLines line, LineGroup group, PixelMap map, HitWriter *writer)
{
    const floatl first = ceil_lanes(line.from), last = floor_lanes(line.to);
    const intl steps = select_lanes((line.low <= line.high) & (line.from <= line.to), to_intl(last - first), (intl)-1);
    const Targets targets = targets_along(map, line);
    const intl row = clamp(to_intl(line.minor_0), (intl)0, line.last_minor) * line.stride_minor; /* there may be none */
    Interval interval = nothing_settled(line);
    floatl major = select_lanes(line.sign > 0.0f, first, last);
    Projection from = project_at(targets, major, (floatl)NO_SURFACE);
    const intl ahead = PREFETCH_STEPS * to_intl(line.sign) * line.stride_major,
               last_sample = grid.height * grid.pitch - 1;
    uint samples = 0;
    for (int count = 0; any_lane(count <= steps); count++, major += line.sign) {
        const intl active = count <= steps;
        COUNT(samples, active)
        const intl at = row + clamp(to_intl(major), (intl)0, to_intl(line.last_major)) * line.stride_major;
        prefetch_across_rows(grid.nearness, clamp(at + ahead, (intl)0, last_sample), group);
        const Projection to = project_at(targets, major, (floatl)(gather(grid.nearness, at)));
        const floatl high = max_lanes(from.nearness, to.nearness), low = min_lanes(from.nearness, to.nearness);
        const intl open = IS_OPEN(grid.cut, high, low);
        extend(&interval, writer, from, to, active, open, line, group, map);
        from = to;
    }
    return samples;
}
#endif
