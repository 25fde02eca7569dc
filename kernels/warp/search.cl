/* The O(n^3) inverse warp: every pixel of the target searches its own epipolar segment, from the epipole (or where the
 * line enters the image) to the projection of the ray's point at infinity (Schaufler & Priglinger 1999, section 4).
 *
 * seen: (dst_height, dst_pitch) nearness of the hit, BLOCKED or EMPTY. Work-item: one pixel. Cost: O(source width).
 * Determinism: every pixel on its own.
 */
#include "warp/trace.h"

kernel void search(global const float *nearness, global float *seen, PixelMap map, Cut cut, int shown, int low_x, int high_x,
                   int low_y, int high_y
#ifdef COUNT_SAMPLES
                   ,
                   global uint *counts /* (dst_height, dst_width): cells visited */
#endif
)
{
    const int x = low_x + get_global_id(0), y = low_y + get_global_id(1);
    if (x >= high_x || y >= high_y)
        return;
    const float *S = map.src_from_dst;
    const Grid grid = {nearness, map.src_width, map.src_height, map.src_pitch, cut};
    Ray ray;
    ray.start = (float4)(PIXEL_ROW(S, 0, x, y), PIXEL_ROW(S, 1, x, y), PIXEL_ROW(S, 2, x, y), PIXEL_ROW(S, 3, x, y));
    ray.centre = (float4)(S[3], S[7], S[11], S[15]);
    ray.perspective = map.dst_perspective;
    Walk walk = walk_of(ray, grid.width, grid.height);
    uint samples = 0;
    seen[y * map.dst_pitch + x] = trace(grid, ray, walk, shown, &samples);
#ifdef COUNT_SAMPLES
    counts[y * map.dst_width + x] = samples;
#endif
}
