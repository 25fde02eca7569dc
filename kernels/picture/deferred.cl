/* Light on what is made of images, once all things are drawn: deferred shading.
 *
 * The G-buffer (lib/gbuffer.h) tells which pixels show such things. RELIT 0: their colours hold the light that they
 * were taken in, and shadows alone are added. A point in shadow keeps the light's ambient part; so does one whose
 * surface turns away from the light, towards which it fades over `fade` of the cosine. RELIT 1: their colours are the
 * surface's own, and are shaded as meshes are (lib/light.h), by the thing's normals, or where it has none by those of
 * its depths in the picture, `neighbour_offset` pixels away. A normal that points away from the viewer is of the
 * surface's back, and is turned round. For the shadow maps normals are always those of the depths, since others may be
 * interpolated.
 *
 * entered, numbers, normals: depth, thing and normal of the G-buffer; normals are read of no thing without them.
 * things: (things, THING) of each: scene units by which it may lie before its surface in a map; pixels between the
 * depths that tell its slope; cosine from which it fades, 0 for solids, whose fronts hide their backs in the map; 1 if
 * it has normals. depth, color: the picture.
 * Work-item: LANES pixels of a row. Cost: O(pixels), once for each thing that a work-item's pixels show. Determinism:
 * every pixel on its own.
 */
#include "lib/color.h"
#include "lib/light.h"
#include "picture/facing.h"

#ifndef RELIT
#define RELIT 0 /* 1: colours are the surface's own */
#endif
#define THING 4
#define BACKFACING 0.2f /* cosine by which interpolated normals of visible surfaces may point away from the viewer */
#define SHORTEST_MEAN 0.1f /* shorter interpolated normals have no certain direction: 8 bits hold them to 0.004 */

#if RELIT
/* A thing's normals, turned to the viewer, who looks `ahead`; where they are too short to be known, those of its
 * depths, `facing` */
INLINED Vector normal_of(global const float *normals, intl pixel, Vector facing, Vector ahead)
{
    const Vector mapped = vector_at(normals, pixel);
    const floatl length = sqrt(DOT(mapped, mapped)), per_length = 1.0f / max_lanes(length, (floatl)1e-6f);
    const Vector turned = scaled(mapped,
                                 select_lanes(DOT(mapped, ahead) * per_length > BACKFACING, -per_length, per_length));
    const intl known = length > SHORTEST_MEAN;
    const Vector normal = {select_lanes(known, turned.x, facing.x), select_lanes(known, turned.y, facing.y),
                           select_lanes(known, turned.z, facing.z)};
    return normal;
}
#endif

kernel void light_things(global const float *entered, global const int *numbers, global const float *things,
                         global const float *depth, global channel *color, Screen screen, Light light SHADOW_PARAMETERS
#if RELIT
                         ,
                         global const float *normals
#endif
)
{
    const int first = get_global_id(0) * LANES, row = get_global_id(1);
    if (first >= screen.width || row >= screen.height)
        return;
    const intl x = min(first + lane_index, (intl)(screen.width - 1)), pixel = row * screen.width + x;
    const floatl z = (floatl)(gather(depth, pixel));
    const intl number = (intl)(gather(numbers, pixel));
    intl left = (first + lane_index < screen.width) & ((floatl)(gather(entered, pixel)) == z);
    while (any_lane(left)) {
        const int thing = (int)least_lane(select_lanes(left, to_floatl(number), (floatl)INFINITY));
        const intl mine = left & (number == thing);
        left = left & !mine;
        global const float *how = things + THING * thing;
        const Shown shown = {depth, entered, numbers, thing};
        const floatl n = select_lanes(mine, DEPTH_OF(screen.perspective, z),
                                      (floatl)(screen.perspective ? 1.0f : -1.0f));
        const Vector p = point_at(screen, to_floatl(x), (floatl)row, n);
        const Vector facing = facing_at(shown, screen, first, row, (int)how[1], n, p);
#if SHADOWED
        shadow.bias = how[0];
#endif
#if RELIT
        const Vector ahead = view_direction(screen, p);
        Vector normal = facing;
        if (how[3] > 0.0f)
            normal = normal_of(normals, pixel, facing, ahead);
        const intl red = 3 * pixel, green = red + 1, blue = red + 2;
        Color shade = {(floatl)(gather(color, red)), (floatl)(gather(color, green)), (floatl)(gather(color, blue))};
        shade.r /= CHANNEL_MAX;
        shade.g /= CHANNEL_MAX;
        shade.b /= CHANNEL_MAX;
        apply_light(&shade, light, p, normal, ahead, VISIBILITY(p, facing));
        for (int lane = 0; lane < LANES; lane++) {
            const float3 one = rounded_channel(clamp(color_lane(shade, lane), 0.0f, 1.0f) * CHANNEL_MAX);
            if (int_lane(mine, lane))
                write_pixel(color + int_lane(red, lane), one);
        }
#else
        const ToLight to = to_light(light, p);
        const floatl cosine = DOT(facing, to.direction);
        const float fade = how[2];
        const floatl faces = fade > 0.0f ? clamp_lanes(cosine / fade, (floatl)0.0f, (floatl)1.0f) : (floatl)1.0f;
        const floatl share = light.ambient + (1.0f - light.ambient) * (VISIBILITY(p, facing) * to.falloff * faces);
        for (int lane = 0; lane < LANES; lane++) {
            const float kept = float_lane(share, lane);
            if (!int_lane(mine, lane) || !(kept < 1.0f))
                continue;
            global channel *own = color + 3 * (size_t)int_lane(pixel, lane);
            for (int k = 0; k < 3; k++)
                own[k] = to_channel(own[k] * kept);
        }
#endif
    }
}
