/* Finds the nearest, or the farthest, triangle that each ray meets.
 *
 * With the ray as origin, an edge function is the difference of two products: its sign is correct or 0, and 0 counts as
 * inside. So no ray passes between two triangles with a common edge. A ray may pass exactly through the border of a
 * surface, so a ray that meets no triangle gets a triangle that it misses by at most NEAR_MISS.
 *
 * faces: (triangles, 3) vertex indices. projected, list, starts: bins.cl. places: (2, rays) each ray's column and row
 * in the picture for which the bins were made; NaN: the ray's entry in `met` is kept. sense: 1 for the nearest
 * triangle, -1 for the farthest; the first of equally distant ones counts. met: (rays,) triangle, -1: none. Work-item:
 * a ray. Cost: O(list). Determinism: list order.
 */
#include "raster/fragment.h"

#define NEAR_MISS 1e-3f /* pixels */

/* Nearness of a triangle's plane on the ray at (x, y), if the ray meets the triangle or misses it by at most `slack`
 * pixels; else NaN */
float met_nearness(global const int *corners, global const float *projected, float x, float y, float slack)
{
#pragma OPENCL FP_CONTRACT OFF /* contraction would round only one of two products */
    float U[3], V[3], W[3], Q[3], sum = 0.0f, w = 0.0f, q = 0.0f, low = INFINITY, high = -INFINITY;
    UNROLLED
    for (int k = 0; k < 3; k++) {
        const float4 at = vload4(corners[k], projected);
        U[k] = at.x - x * at.z, V[k] = at.y - y * at.z, W[k] = at.z, Q[k] = at.w;
    }
    UNROLLED
    for (int k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        const float inside = U[i] * V[j] - V[i] * U[j];
        const float near = slack > 0.0f ? slack * hypot(V[i] * W[j] - W[i] * V[j], W[i] * U[j] - U[i] * W[j]) : 0.0f;
        low = fmin(low, inside + near), high = fmax(high, inside - near);
        sum += inside, w += inside * W[k], q += inside * Q[k];
    }
    const int before = sum > 0.0f ? w > 0.0f : w < 0.0f;
    return before && (low >= 0.0f || high <= 0.0f) ? q / w : NAN;
}

kernel void meet(BINS_PARAMETERS, global const int *faces, global const float *places, int rays, int sense,
                 global int *met)
{
    const int ray = get_global_id(0);
    if (ray >= rays || isnan(places[ray]))
        return;
    const float x = places[ray], y = places[rays + ray];
    const int bin = (int)y / BIN * bins_x + (int)x / BIN;
    float best = -INFINITY;
    int owner = -1;
    for (float slack = 0.0f; slack <= NEAR_MISS && owner < 0; slack += NEAR_MISS)
        for (int i = starts[bin]; i < starts[bin + 1]; i++) {
            const float n = met_nearness(faces + 3 * list[i], projected, x, y, slack);
            if (n <= screen.nearest && sense * n > best)
                best = sense * n, owner = list[i];
        }
    met[ray] = owner;
}
