/* Shadows on what shows its own colours: images and objects made of images.
 *
 * Such colours hold the light that they were taken in. Where the pixel's point is out of the light's sight they keep
 * the light's ambient part. Normals come from the picture's depths, `neighbour_offset` pixels away. What turns away from the light is dark, and fades before that over `fade`
 * of the cosine; with 0 that is left to the map, in which a solid's front hides its back.
 *
 * before: (height, width) the depths before the thing was drawn, with `blank` 0; other pixels stay. depth, color: the
 * picture. Work-item: LANES pixels of a row. Cost: O(pixels). Determinism: every pixel on its own.
 */
#define SHADOWED 1
#include "lib/light.h"
#include "picture/facing.h"

kernel void darken(global const float *before, global const float *depth, global channel *color, Screen screen,
                   int blank, int neighbour_offset, float fade, Light light SHADOW_PARAMETERS)
{
    const int first = get_global_id(0) * LANES, row = get_global_id(1);
    if (first >= screen.width || row >= screen.height)
        return;
    const Drawn shown = drawn_at(before, depth, screen, blank, first, row);
    if (!any_lane(shown.drawn))
        return;
    const Vector p = shown.p, facing = facing_at(depth, screen, shown.x, shown.y, neighbour_offset, shown.n, p);
    const ToLight to = to_light(light, p);
    const floatl cosine = DOT(facing, to.direction);
    const floatl faces = fade > 0.0f ? clamp_lanes(cosine / fade, (floatl)0.0f, (floatl)1.0f) : (floatl)1.0f;
    const floatl visible = VISIBILITY(p, facing) * to.falloff * faces;
    const floatl left = light.ambient + (1.0f - light.ambient) * visible;
    for (int lane = 0; lane < LANES; lane++) {
        const float share = float_lane(left, lane);
        if (!int_lane(shown.drawn, lane) || !(share < 1.0f))
            continue;
        const size_t pixel = 3 * ((size_t)row * screen.width + first + lane);
        for (int k = 0; k < 3; k++)
            color[pixel + k] = to_channel(color[pixel + k] * share);
    }
}
