/* Light on what is made of images, whose colours are taken for the surface's own: deferred shading.
 *
 * Once a thing is drawn, each of its pixels is shaded as meshes are (lib/light.h), by the normal that its images have
 * there, or where they have none by that of the picture's depths, `neighbour_offset` pixels away. A normal that points away from the
 * viewer is of the surface's back, and is turned round. In shadow maps a point is moved off its surface by its slope in
 * the picture: normals may be bent.
 *
 * before: (height, width) the depths before the thing was drawn, with `blank` 0; other pixels stay. depth, color: the
 * picture. NORMALS: normals (height, width, 3): x, y, z in the world, as 0.5 + 0.5 * x: see DECODED.
 * Work-item: LANES pixels of a row. Cost: O(pixels). Determinism: every pixel on its own.
 */
#include "lib/color.h"
#include "lib/light.h"
#include "picture/facing.h"

#ifndef NORMALS
#define NORMALS 0 /* 1: there is a picture of the thing's normals */
#endif
#define DECODED(c) (2.0f * (c) - 1.0f)
#define BACKFACING 0.2f /* of the cosine to the view: as far beyond the horizon normals are seen that are mixed, or bent */
#define SHORTEST_MEAN 0.1f /* shorter means of normals point anywhere: 8 bits a channel hold them to 0.004 */

kernel void relight(global const float *before, global const float *depth, global channel *color, Screen screen,
                    int blank, int neighbour_offset, Light light SHADOW_PARAMETERS
#if NORMALS
                    ,
                    global const float *normals
#endif
)
{
    const int first = get_global_id(0) * LANES, row = get_global_id(1);
    if (first >= screen.width || row >= screen.height)
        return;
    const Drawn shown = drawn_at(before, depth, screen, blank, first, row);
    if (!any_lane(shown.drawn))
        return;
    const Vector p = shown.p, facing = facing_at(depth, screen, shown.x, shown.y, neighbour_offset, shown.n, p);
    const intl at = 3 * (row * screen.width + shown.x), at_1 = at + 1, at_2 = at + 2;
    const Vector ahead = view_direction(screen, p);
    Vector normal = facing;
#if NORMALS
    const Vector mapped = {DECODED((floatl)(gather(normals, at))), DECODED((floatl)(gather(normals, at_1))),
                         DECODED((floatl)(gather(normals, at_2)))};
    const floatl length = sqrt(DOT(mapped, mapped)), per_length = 1.0f / max_lanes(length, (floatl)1e-6f);
    const intl of_back = DOT(mapped, ahead) * per_length > BACKFACING;
    const Vector turned = scaled(mapped, pick(of_back, -per_length, per_length));
    const intl sound = length > SHORTEST_MEAN;
    normal.x = pick(sound, turned.x, facing.x);
    normal.y = pick(sound, turned.y, facing.y);
    normal.z = pick(sound, turned.z, facing.z);
#endif
    const Color own = {(floatl)(gather(color, at)), (floatl)(gather(color, at_1)), (floatl)(gather(color, at_2))};
    Color shade = {own.r / CHANNEL_MAX, own.g / CHANNEL_MAX, own.b / CHANNEL_MAX};
    apply_light(&shade, light, p, normal, ahead, VISIBILITY(p, facing));
    for (int lane = 0; lane < LANES; lane++) {
        const float3 one = rounded_channel(clamp(color_lane(shade, lane), 0.0f, 1.0f) * CHANNEL_MAX);
        if (int_lane(shown.drawn, lane))
            write_pixel(color + int_lane(at, lane), one);
    }
}
