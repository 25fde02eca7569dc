/* Textures with their pyramids, tiled: RGBA bytes, level by level from the largest, each half the size of the one
 * before, rounded down (Williams 1983).
 */
#include "lib/color.h"

#define LEVELS_MOST 16

#define CHANNEL(word, shift) to_floatl((word >> shift) & 255)

/* Adds the texel (x, y) of each lane's level, wrapped, to sum, with a weight. */
void add_texel(global const uint *texels, intl x, intl y, intl width, intl height, intl start, floatl weight, Color *sum)
{
    const intl at = start + y * width + x;
    const intl word = as_intl((uintl)(gather(texels, at)));
    sum->r += weight * CHANNEL(word, 0);
    sum->g += weight * CHANNEL(word, 8);
    sum->b += weight * CHANNEL(word, 16);
}

intl wrapped(intl i, intl size)
{
    const intl rest = i % size;
    return pick(rest < 0, rest + size, rest);
}

void add_level(global const uint *texels, floatl u, floatl v, intl level, int width, int height, floatl weight, Color *sum)
{
    intl start = 0, w = width, h = height;
    for (int l = 0; l < LEVELS_MOST; l++) {
        const intl finer = level > l;
        if (!any_lane(finer))
            break;
        start = pick(finer, start + w * h, start);
        w = pick(finer, max(w / 2, (intl)1), w);
        h = pick(finer, max(h / 2, (intl)1), h);
    }
    const floatl tx = u * to_floatl(w) - 0.5f, ty = v * to_floatl(h) - 0.5f;
    const floatl x0 = floor(tx), y0 = floor(ty), fx = tx - x0, fy = ty - y0;
    const intl xa = wrapped(to_intl(x0), w), xb = wrapped(to_intl(x0) + 1, w);
    const intl ya = wrapped(to_intl(y0), h), yb = wrapped(to_intl(y0) + 1, h);
    add_texel(texels, xa, ya, w, h, start, weight * (1.0f - fx) * (1.0f - fy), sum);
    add_texel(texels, xb, ya, w, h, start, weight * fx * (1.0f - fy), sum);
    add_texel(texels, xa, yb, w, h, start, weight * (1.0f - fx) * fy, sum);
    add_texel(texels, xb, yb, w, h, start, weight * fx * fy, sum);
}
