#ifndef WARP_SEGMENTS_H
#define WARP_SEGMENTS_H
/* Lines cut into segments: a work-item settles some pixels of a target line, and walks only the part of the source line
 * that these pixels may see. A walk along the whole line would give the same hits.
 */
#include "lib/bounds.h"
#include "warp/interval.h"

#define BLOCK_STEPS (BOUNDS_STEP - 1) /* so many steps of a line, with their ends, lie in one window of lib/bounds.h */
#define NEAR_PIXEL 0.05f              /* pixels: by rounding, a pixel may show a surface that ends this far from it */

#if LANES == 1 /* with more lanes, whole lines are walked */
/* Can the next BLOCK_STEPS steps of a line, from a major coordinate on, show something at the pixels from low to
 * high? */
INLINED int may_show(SweepLines line, Targets targets, global const float *bounds, PixelMap map, float major, float low,
                     float high)
{
    const float last = fmin(major + BLOCK_STEPS, line.last_major + 1.0f);
    const float minor = line.minor_0 + fmin(line.tilt * major, line.tilt * last);
    const float u = line.u_major ? major : minor, v = line.u_major ? minor : major;
    const int x = (int)clamp(u + FROM_RING, 0.0f, (float)map.src_width) / BOUNDS_STEP;
    const int y = (int)clamp(v + FROM_RING, 0.0f, (float)map.src_height) / BOUNDS_STEP;
    const float2 range = vload2(y * BOUNDS_ACROSS(map.src_width) + x, bounds);
    float least = INFINITY, most = -INFINITY;
    UNROLLED
    for (int corner = 0; corner < 4; corner++) {
        const Projection place = project_at(targets, corner & 1 ? last : major, corner & 2 ? range.y : range.x);
        if (place.w <= 0.0f) /* not in front of the target's centre: the steps may show at any pixel */
            return range.x <= range.y;
        least = fmin(least, place.p / place.w);
        most = fmax(most, place.p / place.w);
    }
    return range.x <= range.y && most >= low && least <= high;
}

/* Shortens a segment's walk at both ends, block by block, by steps that show nothing at the segment's pixels. Returns
 * the number of tested blocks that were left out. */
INLINED uint clip_walk(SweepLines *line, global const float *bounds, PixelMap map)
{
    const Targets targets = targets_along(map, *line);
    const float low = line->low - NEAR_PIXEL, high = line->high + NEAR_PIXEL;
    float from = floor(line->from), to = ceil(line->to);
    uint blocks = 0;
    for (; from < to && !may_show(*line, targets, bounds, map, from, low, high); from += BLOCK_STEPS)
        blocks++;
    for (; from < to && !may_show(*line, targets, bounds, map, to - BLOCK_STEPS, low, high); to -= BLOCK_STEPS)
        blocks++;
    line->from = fmax(line->from, from);
    line->to = fmin(line->to, to);
    return blocks;
}
#endif
#endif
