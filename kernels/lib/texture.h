#ifndef LIB_TEXTURE_H
#define LIB_TEXTURE_H
/* Textures with their pyramids, tiled or clamped (lib/wrap.h): RGBA bytes, level by level from the largest, each half the
 * size of the one before, rounded down (Williams 1983).
 */
#include "lib/color.h"
#include "lib/wrap.h"

#define LEVELS_MOST 16

/* Where a level begins, in texels; width and height: the first's, which become the level's */
INLINED intl start_of_level(intl level, intl *width, intl *height)
{
    intl start = 0;
    for (int l = 0; l < LEVELS_MOST; l++) {
        const intl finer = level > l;
        if (!any_lane(finer))
            break;
        start = pick(finer, start + *width * *height, start);
        *width = pick(finer, max(*width >> 1, (intl)1), *width);
        *height = pick(finer, max(*height >> 1, (intl)1), *height);
    }
    return start;
}

/* Adds a texture's level, which begins at `start`, at (u, v), by a weight. */
void add_texels(global const uint *texels, floatl u, floatl v, intl start, intl w, intl h, floatl weight, Color *sum)
{
    const floatl across = to_floatl(w), down = to_floatl(h);
    const floatl tx = FROM_FIRST(u * across - 0.5f, across), ty = FROM_FIRST(v * down - 0.5f, down);
    const floatl x0 = floor_lanes(tx), y0 = floor_lanes(ty), fx = tx - x0, fy = ty - y0;
    const floatl right = weight * fx, left = weight - right;
    /* Lanes that do not ask may hold anything: none may read beyond the level. */
    const intl xa = to_intl(within(IN_TILE(x0, across, 1.0f / across), across - 1.0f)), xb = pick(xa + 1 < w, xa + 1, (intl)0);
    const intl y_in = to_intl(within(IN_TILE(y0, down, 1.0f / down), down - 1.0f));
    const intl ya = start + y_in * w, yb = start + pick(y_in + 1 < h, y_in + 1, (intl)0) * w;
    add_color(sum, left * (1.0f - fy), color_of(texels_at(texels, ya + xa)));
    add_color(sum, right * (1.0f - fy), color_of(texels_at(texels, ya + xb)));
    add_color(sum, left * fy, color_of(texels_at(texels, yb + xa)));
    add_color(sum, right * fy, color_of(texels_at(texels, yb + xb)));
}

/* The level whose texels are as large as a pixel, from the square of how many of the first's it covers along a side */
intl level_of_texels(floatl texels_2, int level_count)
{
    const floatl sound = pick(isfinite_lanes(texels_2), greater(texels_2, (floatl)1.0f), (floatl)1.0f);
    const intl doublings = (as_intl(sound) >> 23) - 127; /* its log2, rounded down */
    return min(doublings >> 1, (intl)(level_count - 1));
}
#endif
