/* Depth to nearness: the sweep and the searches read 1/z (perspective) or -z (orthographic), never z.
 *
 * One work-item converts one row and notes the row's range, which bounds what the view can reach.
 * depth: (src_height, src_width) planar z; not finite, <= NEAREST or >= far is no surface.
 * nearness: (src_height, src_pitch), a pitch that is no power of two, because columns are read too.
 * ranges: (src_height, 2) least and greatest nearness of the row, (inf, -inf) where it has no surface.
 * O(n^2), one pass.
 */
#include "lib/lanes.h"
#include "lib/surface.h"

kernel void to_nearness(global const float *depth, global float *nearness, global float *ranges, int src_width,
                        int src_height, int src_pitch, int src_perspective, float far)
{
    const int y = get_global_id(0);
    if (y >= src_height)
        return;
    global const float *z = depth + (size_t)y * src_width;
    global float *q = nearness + (size_t)y * src_pitch;
    floatl low = INFINITY, high = -INFINITY;
    int x = 0;
    for (; x + LANES <= src_width; x += LANES) {
        const floatl d = load_lanes(z + x);
        const floatl near = src_perspective ? 1.0f / d : -d;
        const intl solid = (d > NEAREST) & (d < far);
        store_lanes(pick(solid, near, (floatl)NO_SURFACE), q + x);
        low = fmin(low, pick(solid, near, (floatl)INFINITY));
        high = fmax(high, pick(solid, near, (floatl)-INFINITY));
    }
    float least = least_lane(low), greatest = -least_lane(-high);
    for (; x < src_width; x++) {
        const float near = src_perspective ? 1.0f / z[x] : -z[x];
        const int solid = z[x] > NEAREST && z[x] < far;
        q[x] = solid ? near : NO_SURFACE;
        least = solid ? fmin(least, near) : least;
        greatest = solid ? fmax(greatest, near) : greatest;
    }
    ranges[2 * y] = least;
    ranges[2 * y + 1] = greatest;
}
