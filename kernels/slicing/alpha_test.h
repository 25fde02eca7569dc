#ifndef SLICING_ALPHA_TEST_H
#define SLICING_ALPHA_TEST_H
/* The alpha test of a height map (Kautz & Seidel 2001, sections 3.1 and 3.2). */
#include "lib/heights.h"
#include "lib/taps.h"

#define AT_LEAST 0 /* alpha >= h: the inside is filled, the base drawn (Dietrich) */
#define BAND 1     /* alpha within a band above h: gaps open between samples that differ by more (Schaufler) */
#define INSIDE 2   /* alpha > h: where alpha is 0 there is nothing (Kautz & Seidel) */

/* Bilinear height at (u, v), 0 to 1, tiled or clamped; heights: lib/heights.h. u and v are wrapped before they are
 * scaled, which is exact for any number of tiles. */
floatl height_at(global const uint *heights, int width, int height, floatl u, floatl v)
{
    const HeightMap map = {width, height, 0};
    const Taps taps = map_taps(width, height, u, v);
    return height_of(read_patch(heights, map, taps.column, taps.row), taps.fx, taps.fy) * HEIGHT_UNIT;
}

/* Tells whether a point of height h passes where the map's value is alpha. */
intl passes(int test, floatl alpha, floatl h, float band)
{
    if (test == AT_LEAST)
        return alpha >= h;
    if (test == INSIDE)
        return alpha > h;
    return (alpha >= h) & (alpha < h + band);
}
#endif
