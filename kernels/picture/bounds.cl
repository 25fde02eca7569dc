/* Finds the least and the greatest nearness of a surface in windows of its cells (lib/bounds.h).
 *
 * surface: picture/edges.cl. bounds: (down, across, 2) least and greatest nearness of each window's valid samples;
 * (FLT_MAX, -FLT_MAX) without valid samples. Interpolated nearness lies between the bounds, too. Work-item: STRIP
 * windows of a row. Cost: O(samples). Determinism: windows are independent.
 */
#include "lib/bounds.h"
#include "lib/lanes.h"

#define WINDOW_SIDE (2 * BOUNDS_STEP + 1) /* samples */
#define BOUNDS_ROUNDING 1e-6f /* greatest relative error of interpolated nearness: 16 roundings to 24 bits */

/* Writes the bounds of a window of width x height samples, which starts at `first`. */
INLINED void bound_window(global const float *first, int pitch, int width, int height, global float *out)
{
    floatl low = FLT_MAX, high = -FLT_MAX;
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x += LANES) {
            const int from = min(x, WINDOW_SIDE - LANES); /* read no sample beyond the window: rows may end there */
            const floatl n = load_lanes(first + y * pitch + from);
            const intl solid = (from + lane_index < width) & (n > NO_SURFACE);
            low = select_lanes(solid, min_lanes(n, low), low);
            high = select_lanes(solid, max_lanes(n, high), high);
        }
    const float least = least_lane(low), most = -least_lane(-high);
    const float rounding = least <= most ? BOUNDS_ROUNDING * fmax(fabs(least), fabs(most)) : 0.0f;
    out[0] = least - rounding;
    out[1] = most + rounding;
}

kernel void bound_surface(global const float *surface, global float *bounds, int width, int height, int pitch)
{
    const int y = get_global_id(1), across = BOUNDS_ACROSS(width), top = y * BOUNDS_STEP;
    if (y >= BOUNDS_ACROSS(height))
        return;
    for (int x = get_global_id(0) * STRIP; x < min((int)(get_global_id(0) + 1) * STRIP, across); x++) {
        const int left = x * BOUNDS_STEP;
        bound_window(surface + (size_t)top * pitch + left, pitch, min(WINDOW_SIDE, width + 2 - left),
                     min(WINDOW_SIDE, height + 2 - top), bounds + 2 * ((size_t)y * across + x));
    }
}
