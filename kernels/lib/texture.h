#ifndef LIB_TEXTURE_H
#define LIB_TEXTURE_H
/* Textures with mipmaps, tiled or clamped (lib/wrap.h): RGBA bytes, one level after the other. Each level has half the
 * width and height of the previous one, rounded down (Williams 1983).
 */
#include "lib/color.h"
#include "lib/taps.h"

#define LEVELS_MAX 16

/* The start of a level in the texture's memory, in texels. width, height: at first the size of the first level; they
 * become the size of `level`. */
INLINED intl start_of_level(intl level, intl *width, intl *height)
{
    intl start = 0;
    for (int l = 0; l < LEVELS_MAX; l++) {
        const intl finer = level > l;
        if (!any_lane(finer))
            break;
        start = select_lanes(finer, start + *width * *height, start);
        *width = select_lanes(finer, max(*width >> 1, (intl)1), *width);
        *height = select_lanes(finer, max(*height >> 1, (intl)1), *height);
    }
    return start;
}

/* Adds the bilinear value at (u, v) of the level that begins at `start`, times a weight. */
INLINED void add_texels(global const uint *texels, floatl u, floatl v, intl start, intl w, intl h, floatl weight,
                        Color *sum)
{
    const Taps taps = map_taps(w, h, u, v);
    floatl weights[4];
    tap_weights(taps.fx, taps.fy, weights);
    UNROLLED
    for (int k = 0; k < 4; k++) {
        const intl at = start + taps.at[k];
        add_color(sum, weight * weights[k], color_of(texels_at(texels, at)));
    }
}

/* The level whose texels are as large as a pixel. The pixel's side covers sqrt(texels_2) texels of the first level. */
intl level_of_texels(floatl texels_2, int level_count)
{
    const floatl finite = select_lanes(isfinite_lanes(texels_2), max_lanes(texels_2, (floatl)1.0f), (floatl)1.0f);
    const intl doublings = (as_intl(finite) >> 23) - 127; /* log2(texels_2), rounded down */
    return min(doublings >> 1, (intl)(level_count - 1));
}
#endif
