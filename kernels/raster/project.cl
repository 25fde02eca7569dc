/* Vertices of the world to the target's pixel space.
 *
 * vertices: (count, 3) world. projected: (count, 4) homogeneous U, V, W, Q (lib/pixelspace.h).
 * Work-item: a vertex. Cost: O(count). Determinism: every vertex on its own.
 */
#include "lib/screen.h"

kernel void project(global const float *vertices, global float *projected, int count, Screen screen)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const float3 p = vload3(i, vertices);
    const float *m = screen.from_world;
    float4 made;
    made.x = m[0] * p.x + m[1] * p.y + m[2] * p.z + m[3];
    made.y = m[4] * p.x + m[5] * p.y + m[6] * p.z + m[7];
    made.z = m[8] * p.x + m[9] * p.y + m[10] * p.z + m[11];
    made.w = m[12] * p.x + m[13] * p.y + m[14] * p.z + m[15];
    vstore4(made, i, projected);
}
