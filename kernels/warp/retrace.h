/* A pixel's own ray, traced exactly around what its epipolar line and its neighbours' lines saw.
 *
 * Lines pass within half a pixel, so what the ray meets first lies near one of those answers; only along a crest, seen
 * at a grazing angle, may it lie farther off.
 */
#include "warp/trace.h"

#define WINDOW 2.0f  /* pixels of the source that are traced to either side of an answer */
#define BEYOND 8.0f  /* and, if nothing is met there, before the first answer and behind the last one; */
#define BEHIND 64.0f /* behind the last one if the pixel's line met something: past a crest, the next slope may be far */

/* The part of a walk between two major coordinates, in walking order. */
Walk part_of(Walk walk, float from, float to)
{
    walk.from = walk.sign > 0.0f ? fmax(walk.from, from) : fmin(walk.from, from);
    walk.to = walk.sign > 0.0f ? fmin(walk.to, to) : fmax(walk.to, to);
    return walk;
}

/* Target nearness of the hit, BLOCKED or EMPTY. density, apart: as in resolve.cl. */
float retrace(Grid grid, global const float *seen, PixelMap map, int shown, int x, int y, float density, int apart)
{
    const float *S = map.src_from_dst;
    Ray ray;
    ray.start = (float4)(PIXEL_ROW(S, 0, x, y), PIXEL_ROW(S, 1, x, y), PIXEL_ROW(S, 2, x, y), PIXEL_ROW(S, 3, x, y));
    ray.centre = (float4)(S[3], S[7], S[11], S[15]);
    ray.perspective = map.dst_perspective;
    const Walk whole = walk_of(ray, grid.width, grid.height);
    const float window = whole.sign * WINDOW * density;

    float tried[9]; /* where the answers lie on the line: the pixel's own, its neighbours', those `apart` away */
    float first = INFINITY, last = -INFINITY;
    float nearest = EMPTY;
    int answers = 0;
    uint samples = 0;
    for (int i = 0; i < (apart > 1 ? 9 : 5); i++) {
        const int by = i > 4 ? apart : 1, side = i % 4;
        const int nx = x + (side == 1 ? -by : side == 2 ? by : 0), ny = y + (side == 3 ? -by : i && side == 0 ? by : 0);
        tried[i] = INFINITY;
        if (nx < 0 || nx >= map.dst_width || ny < 0 || ny >= map.dst_height)
            continue;
        const float answer = seen[ny * map.dst_pitch + nx];
        if (!IS_HIT(answer))
            continue;
        const float4 point = ray.start + answer * ray.centre;
        tried[i] = (whole.u_major ? point.x : point.y) / point.z;
        first = fmin(first, tried[i] * whole.sign);
        last = fmax(last, tried[i] * whole.sign);
        answers += i ? 1 : 2;
        int again = 0;
        for (int j = 0; j < i; j++)
            again |= fabs(tried[i] - tried[j]) < 0.5f * fabs(window);
        if (!again)
            nearest = fmax(nearest, trace(grid, ray, part_of(whole, tried[i] - window, tried[i] + window), shown, &samples));
    }
    const int connected = grid.cut.far_scale == 0.0f;
    if (!IS_HIT(nearest) && connected && answers >= 2) { /* a window that begins behind the surface sees its back */
        const float more = whole.sign * density, behind = tried[0] < INFINITY ? BEHIND : BEYOND;
        const Walk wide = part_of(whole, whole.sign * first - BEYOND * more, whole.sign * last + behind * more);
        nearest = trace(grid, ray, wide, shown, &samples);
    }
    return nearest;
}
