/* Finds the distance of each of a view's samples from the edges of the view's surface. When several views are blended
 * (blend.cl), the sample's weight depends on this distance.
 *
 * A sample's byte is 0 at a step, where the surface goes on so steeply that it may be a rubber sheet. Otherwise it is
 * 1 + STEPS d, where d is the distance in samples, at most FEATHER, to the nearest step or end of the surface (a hole,
 * a cut, or the image's border). This distance is the larger of the distances along the two axes.
 *
 * surface: (height + 2, pitch), picture/edges.cl. marks: (height, mark_pitch) STEP at a step, 0 at an end and beyond
 * the image, elsewhere FEATHER; rows have FEATHER more columns on either side. in_row: (height, mark_pitch) distances
 * within each row alone. edges: (height, width) for each sample, its own byte and the byte of the sample below. Two
 * bits of the own byte mark the open triangles of the sample's cell, where the picture shows a margin.
 * Launches: mark_edges, row_distances, edge_distances, once for each view.
 * Work-item: LANES samples of a row. Cost: O(samples). Determinism: samples are independent.
 */
#include "lib/lanes.h"
#include "lib/surface.h"
#include "warp/view_edges.h"

#define STEP -1.0f

kernel void mark_edges(global const float *surface, global float *marks, EdgeView view, int mark_pitch)
{
    const int x0 = get_global_id(0) * LANES, y = get_global_id(1);
    if (x0 >= view.width + 2 * FEATHER || y >= view.height)
        return;
    const intl at = x0 + lane_index - FEATHER, x = clamp(at, (intl)0, (intl)(view.width - 1));
    const Grid grid = GRID_OF(surface, view.width, view.height, view.pitch, NO_CUT);
    global const float *nearness = grid.nearness;
    const int row = y * view.pitch, above = max(y - 1, 0) * view.pitch;
    const int below = min(y + 1, view.height - 1) * view.pitch;
    const intl left = row + max(x - 1, (intl)0), right = row + min(x + 1, (intl)(view.width - 1));
    const floatl n = (floatl)(gather(nearness, row + x));
    const floatl around[4] = {(floatl)(gather(nearness, left)), (floatl)(gather(nearness, right)),
                              (floatl)(gather(nearness, above + x)), (floatl)(gather(nearness, below + x))};
    const floatl z = DEPTH_OF(view.perspective, n);
    intl is_step = (intl)0, is_end = (n <= NO_SURFACE) | (at < 0) | (at >= view.width);
    /* The bit of an edge is stored in the left or upper one of its two samples. */
    const intl open_to[4] = {as_intl(around[0]) & TORN_RIGHT, as_intl(n) & TORN_RIGHT, as_intl(around[2]) & TORN_BELOW,
                             as_intl(n) & TORN_BELOW};
    for (int i = 0; i < 4; i++) {
        const intl open = open_to[i] != 0;
        const floatl beside = DEPTH_OF(view.perspective, around[i]);
        is_step |= !open & (fabs(beside - z) > step_allowed(view, min_lanes(beside, z)));
        is_end |= open;
    }
    const floatl whole = select_lanes(is_end, (floatl)0.0f, (floatl)FEATHER);
    store_lanes(select_lanes(is_step, (floatl)STEP, whole), marks + (size_t)y * mark_pitch + x0);
}

kernel void row_distances(global const float *marks, global float *in_row, int width, int height, int mark_pitch)
{
    const int x0 = get_global_id(0) * LANES, y = get_global_id(1);
    if (x0 >= width || y >= height)
        return;
    global const float *here = marks + (size_t)y * mark_pitch + x0 + FEATHER;
    floatl least = max_lanes(load_lanes(here), (floatl)0.0f);
    for (int step = 1; step <= FEATHER; step++) {
        const floatl found = min_lanes(load_lanes(here - step), load_lanes(here + step));
        least = min_lanes(least, max_lanes(found, (floatl)0.0f) + step);
    }
    store_lanes(least, in_row + (size_t)y * mark_pitch + x0);
}

/* The bytes of LANES samples of row y, from x0 on, without the bits of open triangles */
INLINED intl distances_at(global const float *marks, global const float *in_row, int x0, int y, int height,
                          int mark_pitch)
{
    floatl distance = min(min(y + 1, height - y), FEATHER); /* to the rows beyond the image */
    for (int row = max(y - FEATHER, 0); row <= min(y + FEATHER, height - 1); row++) {
        const floatl along = load_lanes(in_row + (size_t)row * mark_pitch + x0);
        distance = min_lanes(distance, max_lanes(along, (floatl)abs(row - y)));
    }
    const intl is_step = load_lanes(marks + (size_t)y * mark_pitch + x0 + FEATHER) < 0.0f;
    return select_lanes(is_step, (intl)0, to_intl(1.0f + STEPS * distance));
}

kernel void edge_distances(global const float *marks, global const float *in_row, global const float *surface,
                           global ushort *edges, int width, int height, int pitch, int mark_pitch)
{
    const int x0 = get_global_id(0) * LANES, y = get_global_id(1);
    if (x0 >= width || y >= height)
        return;
    const intl here = distances_at(marks, in_row, x0, y, height, mark_pitch);
    const Grid grid = GRID_OF(surface, width, height, pitch, NO_CUT);
    global const float *own = grid.nearness + (size_t)y * pitch + x0;
    const floatl n = load_lanes(own), right = load_lanes(own + 1), below = load_lanes(own + pitch);
    const intl open = select_lanes((intl)IS_LOWER_OPEN(n), (intl)LOWER_OPEN, (intl)0) |
                      select_lanes((intl)IS_UPPER_OPEN(n, right, below), (intl)UPPER_OPEN, (intl)0);
    const intl pair = here | open | distances_at(marks, in_row, x0, min(y + 1, height - 1), height, mark_pitch) << 8;
    for (int lane = 0; lane < min(LANES, width - x0); lane++)
        edges[(size_t)y * width + x0 + lane] = int_lane(pair, lane);
}
