/* The alpha test of a height map (Kautz & Seidel 2001, sections 3.1 and 3.2). */
#include "lib/lanes.h"

#define AT_LEAST 0 /* alpha >= h: the inside is filled, the base drawn (Dietrich) */
#define BAND 1     /* alpha within a band above h: one sees through between samples that differ by more (Schaufler) */
#define INSIDE 2   /* alpha > h: where alpha is 0 there is nothing (Kautz & Seidel) */

/* Bilinear height at (u, v), tiled. Texel centres are at (i + 0.5) / size. A word holds a texel's height, 16 bits, and
 * above it that of its right neighbour. */
floatl height_at(global const uint *heights, int width, int height, floatl u, floatl v)
{
    const floatl tx = (u - floor_lanes(u)) * width - 0.5f, ty = (v - floor_lanes(v)) * height - 0.5f;
    const floatl x0 = floor_lanes(tx), y0 = floor_lanes(ty), fx = tx - x0, fy = ty - y0;
    const intl ix = to_intl(x0), iy = to_intl(y0);
    /* Lanes that do not ask may hold anything: none may read beyond the map. */
    const intl x = clamp(pick(ix < 0, ix + width, ix), (intl)0, (intl)(width - 1));
    const intl y = clamp(pick(iy < 0, iy + height, iy), (intl)0, (intl)(height - 1));
    const intl upper = y * width + x, lower = pick(y + 1 >= height, (intl)0, y + 1) * width + x;
    const intl a = as_intl((uintl)(gather(heights, upper))), b = as_intl((uintl)(gather(heights, lower)));
    const floatl aa = to_floatl(a & 0xffff), ab = to_floatl((a >> 16) & 0xffff);
    const floatl ba = to_floatl(b & 0xffff), bb = to_floatl((b >> 16) & 0xffff);
    const floatl top = aa + fx * (ab - aa), bottom = ba + fx * (bb - ba);
    return (top + fy * (bottom - top)) * (1.0f / 65535.0f);
}

/* Does a point of height h pass, where the map says alpha? */
intl passes(int test, floatl alpha, floatl h, float band)
{
    if (test == AT_LEAST)
        return alpha >= h;
    if (test == INSIDE)
        return alpha > h;
    return (alpha >= h) & (alpha < h + band);
}
