/* Projects vertices of the world to the target's pixel space.
 *
 * vertices: (count, 3) world. screen: for points relative to `origin`, the camera's centre. Far from the world's
 * origin, such differences are exact, and the matrix has no large numbers. projected: (count, 4) homogeneous U, V, W, Q
 * (lib/pixelspace.h).
 * Work-item: a vertex. Cost: O(count). Determinism: vertices are independent.
 */
#include "lib/screen.h"

kernel void project(global const float *vertices, global float *projected, int count, float origin_x, float origin_y,
                    float origin_z, Screen screen)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const float3 p = vload3(i, vertices) - (float3)(origin_x, origin_y, origin_z);
    const float *m = screen.from_world;
    const float4 made = {POINT_ROW(m, 0, p), POINT_ROW(m, 1, p), POINT_ROW(m, 2, p), POINT_ROW(m, 3, p)};
    vstore4(made, i, projected);
}
