#ifndef WARP_PIXEL_WEIGHTS_H
#define WARP_PIXEL_WEIGHTS_H
/* The weight of a pixel next to holes, and a hole's fraction of foreground (fill.cl), from behind.cl's results. */
#include "lib/channel.h"
#include "warp/pyramid.h"

#define RIM_PART 0.2f         /* the greatest fraction of foreground in a hole next to foreground */
#define BESIDE 1              /* pixels: only valid pixels this close to a hole have a weight */
#define PIXEL_WEIGHT_MIN 1e-6f /* the least weight of these pixels */
#define RATIO_FLOOR 1e-3f     /* if the 12th power of z / around is less, it counts as 0, as at half the depth */

#if HAS_BEHIND
/* The fraction of foreground in a pixel of depth z next to a hole; far, falloff: the hole's values in `behind` */
#define FOREGROUND(z, far, falloff) clamp((falloff) * ((far) - (z)), 0.0f, 1.0f)

/* The weights of pixels with depths z, one for each lane. around: the farthest depth behind the holes near the pixel;
 * touching, falloffs: the farthest depth behind the holes that touch the pixel, and their greatest falloff */
INLINED floatl weights_of(floatl z, floatl around, floatl touching, floatl falloffs)
{
    floatl ratio = around > z ? z / around : (floatl)1.0f;
    ratio *= ratio;
    ratio *= ratio;
    ratio *= ratio * ratio; /* to the 12th power */
    ratio += RATIO_FLOOR * (ratio - 1.0f);
    ratio *= 1.0f - FOREGROUND(z, touching, falloffs);
    return ratio > PIXEL_WEIGHT_MIN ? ratio : (floatl)PIXEL_WEIGHT_MIN;
}
#endif

#if HAS_BEHIND && CHANNELS == 3
/* Writes the colour of the hole (x, y): its filled colour `own`, mixed with the colour of foreground pixels next to it
 * in its row and column. This colour's part is at most RIM_PART. */
void show_rim(global channel *color, global const float *depth, global const uchar *valid, global const float *behind,
              int width, int height, int pitch, int x, int y, float4 own)
{
    global const float *told = behind + (size_t)(y + HALO) * pitch + x + HALO;
    const float falloff = told[BEHIND_PLANE(height, pitch)];
    if (falloff == 0.0f)
        return;
    float4 sum = 0.0f;
    float most = 0.0f;
    for (int side = 0; side < 4; side++) {
        const int u = x + (side == 0) - (side == 1), v = y + (side == 2) - (side == 3);
        const size_t at = (size_t)v * width + u;
        if (u < 0 || v < 0 || u >= width || v >= height || !valid[at])
            continue;
        const float part = FOREGROUND(depth[at], told[0], falloff);
        if (part == 0.0f)
            continue;
        sum += part * (float4)(color[3 * at], color[3 * at + 1], color[3 * at + 2], 1.0f);
        most = fmax(most, part);
    }
    if (most > 0.0f)
        vstore3(to_channels(mix(own, sum / sum.w, RIM_PART * most)).xyz, (size_t)y * width + x, color);
}
#endif
#endif
