/* Deferred lighting of things made of images, after all things are drawn.
 *
 * The G-buffer (lib/gbuffer.h) marks the pixels that show such things. With RELIT 0, their colours contain the light of
 * the photograph, so only shadows are added. In shadow, and where the surface faces away from the light, only the
 * light's ambient part remains. Direct light fades out as the cosine between normal and light falls from `fade` to 0.
 * With RELIT 1, colours are the surface's own and are shaded as on meshes (lib/light.h), by the thing's normals, or by
 * normals from the depths of neighbours (picture/facing.h). A normal that points away from the viewer belongs to the
 * surface's back and is reversed. To read shadow maps, normals from depths are always used, since the thing's normals
 * may be interpolated.
 *
 * entered, numbers, normals: depth, thing and normal of the G-buffer; normals are only read for things that have
 * them. things: (things, THING); for each thing: the shadow bias in scene units; the distance in pixels to the
 * neighbours whose depths give slopes; the cosine `fade`, 0 for solids, whose fronts shadow their backs; 1 if the thing
 * has normals. depth, color: the picture. Work-item: LANES pixels of a row. Cost: O(pixels * things in a packet).
 * Determinism: pixels are independent.
 */
#include "lib/color.h"
#include "lib/light.h"
#include "picture/facing.h"

#ifndef RELIT
#define RELIT 0 /* 1: colours are the surface's own */
#endif
#define THING 4
#define BACKFACING 0.2f /* greatest cosine of an interpolated normal and the view direction on a surface's front */
#define SHORTEST_MEAN 0.1f /* shorter interpolated normals have no certain direction: 8 bits resolve 0.004 */

#if RELIT
/* A thing's normals, turned towards the viewer, who looks along `ahead`. Where they are too short, `facing` is
 * returned: the normals from depths. */
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
