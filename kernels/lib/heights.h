/* Height maps, tiled: texel centres are at (i + 0.5) / size.
 *
 * HEIGHT_BYTES 1: a word holds four heights of 8 bits: a texel, its right neighbour, and the two below.
 * HEIGHT_BYTES 2: a word holds two of 16 bits: a texel and its right neighbour.
 */
#include "lib/lanes.h"

#ifndef HEIGHT_BYTES
#define HEIGHT_BYTES 2
#endif

/* Heights at the corners of the cell right of and below a texel, in [0, 1]: first letter up to down, second left to
 * right */
typedef struct {
    floatl aa, ab, ba, bb;
} Patch;

/* The patch at texel (x, y), both within the map of width x height words from `start` on */
Patch read_patch(global const uint *texels, intl start, intl width, intl height, intl x, intl y)
{
    Patch patch;
    const intl upper = start + y * width + x;
    const intl a = as_intl((uintl)(gather(texels, upper)));
#if HEIGHT_BYTES == 1
    const float unit = 1.0f / 255.0f;
    patch.aa = to_floatl(a & 255) * unit;
    patch.ab = to_floatl((a >> 8) & 255) * unit;
    patch.ba = to_floatl((a >> 16) & 255) * unit;
    patch.bb = to_floatl((a >> 24) & 255) * unit;
#else
    const float unit = 1.0f / 65535.0f;
    const intl below = y + 1, lower = start + pick(below >= height, below - height, below) * width + x;
    const intl b = as_intl((uintl)(gather(texels, lower)));
    patch.aa = to_floatl(a & 0xffff) * unit;
    patch.ab = to_floatl((a >> 16) & 0xffff) * unit;
    patch.ba = to_floatl(b & 0xffff) * unit;
    patch.bb = to_floatl((b >> 16) & 0xffff) * unit;
#endif
    return patch;
}

/* Bilinear height at (u, v) */
floatl height_in(global const uint *texels, intl start, intl width, intl height, floatl u, floatl v)
{
    const floatl tx = (u - floor(u)) * to_floatl(width) - 0.5f, ty = (v - floor(v)) * to_floatl(height) - 0.5f;
    const floatl x0 = floor(tx), y0 = floor(ty), fx = tx - x0, fy = ty - y0;
    const intl ix = to_intl(x0), iy = to_intl(y0); /* u - floor(u) may round to 1: x0 is width - 1 even then */
    const Patch p = read_patch(texels, start, width, height, pick(ix < 0, ix + width, ix), pick(iy < 0, iy + height, iy));
    const floatl top = p.aa + fx * (p.ab - p.aa), bottom = p.ba + fx * (p.bb - p.ba);
    return top + fy * (bottom - top);
}
