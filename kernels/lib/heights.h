#ifndef LIB_HEIGHTS_H
#define LIB_HEIGHTS_H
/* Height maps, tiled or clamped (lib/wrap.h). Texel centres are at (i + 0.5) / size, so (x, y) = uv * size - 0.5 counts
 * from the first centre.
 *
 * HEIGHT_BYTES 1: 32 bits hold the heights of four texels: a texel, its right neighbour, and the two below.
 * HEIGHT_BYTES 2: 32 bits hold the heights of a texel and its right neighbour.
 * The last texel of a row or column has the first texel as neighbour; in clamped maps, itself.
 */
#include "lib/lanes.h"
#include "lib/wrap.h"

#ifndef HEIGHT_BYTES
#define HEIGHT_BYTES 2 /* bytes per height, see above */
#endif
#if HEIGHT_BYTES == 1
#define HEIGHT_UNIT (1.0f / 255.0f)
#else
#define HEIGHT_UNIT (1.0f / 65535.0f)
#endif

#ifndef POWERS_OF_TWO
#define POWERS_OF_TWO 0 /* 1: the map repeats along both axes, sides are powers of two: bit masks wrap indices */
#endif

/* Rays that walk from cell to cell of a map; in texels: */
#define NUDGE 1e-3f         /* by how much a place is moved ahead, into the cell that the ray enters */
#define AXIS_PARALLEL 1e-4f /* a ray that moves less along an axis counts as not moving along it */

/* One level of a map; lanes may be on different levels. */
typedef struct {
    intl width, height, start; /* in texels; start: the level's place in the buffer */
#if !POWERS_OF_TWO
    floatl per_width, per_height;
#endif
} HeightMap;

/* FLOOR: the greatest whole number <= x, as a float and as an int. WRAPPED: the texel's column or row inside the map
 * for this int: wrapped around if the map repeats, else clamped. */
#if POWERS_OF_TWO
/* If |x| < 2^22, the sum of x and this number is rounded so that its last bits hold x as a whole number. For a whole x,
 * FLOOR may yield x - 1, so that the fraction is 1. */
#define WHOLE_BITS 12582912.0f
#define FLOOR(x, whole, number)                                                                                \
    const floatl number##_bits = ((x) - 0.5f) + WHOLE_BITS;                                                    \
    const floatl whole = number##_bits - WHOLE_BITS;                                                           \
    const intl number = as_intl(number##_bits);
#else
#define FLOOR(x, whole, number)                                                                                \
    const floatl whole = floor_lanes(x);                                                                       \
    const intl number = to_intl(whole);
#endif
#if POWERS_OF_TWO
#define WRAPPED(clamped, whole, number, size, per_size) ((number) & ((size) - 1))
#else
#define WRAPPED(clamped, whole, number, size, per_size)                                                        \
    clamp((clamped) ? (number) : (number) - (size) * to_intl(floor_lanes(((whole) + 0.5f) * (per_size))),      \
          (intl)0, (size) - 1)
#endif

/* Heights at the corners of a cell, in HEIGHT_UNITs. First letter: a: above, b: below; second letter: a: left, b:
 * right */
typedef struct {
    floatl aa, ab, ba, bb;
} Patch;

/* The heights at the corners of the cell whose upper left corner is the map's texel (x, y) */
INLINED Patch read_patch(global const uint *texels, HeightMap map, intl x, intl y)
{
    Patch patch;
    const intl upper = map.start + y * map.width + x;
    const intl a = as_intl((uintl)(gather(texels, upper)));
#if HEIGHT_BYTES == 1
    patch.aa = to_floatl(a & 255);
    patch.ab = to_floatl((a >> 8) & 255);
    patch.ba = to_floatl((a >> 16) & 255);
    patch.bb = to_floatl((a >> 24) & 255);
#else
    const intl lower = map.start + select_lanes(y + 1 < map.height, y + 1, CLAMPED_V ? y : (intl)0) * map.width + x;
    const intl b = as_intl((uintl)(gather(texels, lower)));
    patch.aa = to_floatl(a & 0xffff);
    patch.ab = to_floatl((a >> 16) & 0xffff);
    patch.ba = to_floatl(b & 0xffff);
    patch.bb = to_floatl((b >> 16) & 0xffff);
#endif
    return patch;
}

/* The same for texel (ix, iy), which may lie outside of the map. (x, y): its place after wrapping or clamping. Beyond
 * their borders, clamped maps are constant. */
INLINED Patch read_cell(global const uint *texels, HeightMap map, intl ix, intl iy, intl x, intl y)
{
    Patch patch = read_patch(texels, map, x, y);
#if CLAMPED_U
    const intl left = ix < 0;
    patch.ab = select_lanes(left, patch.aa, patch.ab);
    patch.bb = select_lanes(left, patch.ba, patch.bb);
#endif
#if CLAMPED_V
    const intl above = iy < 0;
    patch.ba = select_lanes(above, patch.aa, patch.ba);
    patch.bb = select_lanes(above, patch.ab, patch.bb);
#endif
    return patch;
}

/* The bilinear height in a cell, in HEIGHT_UNITs; fx, fy: position in the cell, 0 to 1 */
INLINED floatl height_of(Patch p, floatl fx, floatl fy)
{
    const floatl top = p.aa + fx * (p.ab - p.aa), bottom = p.ba + fx * (p.bb - p.ba);
    return top + fy * (bottom - top);
}

/* A quantity that is quadratic along a line: fixed + sloped s + curved s^2 */
typedef struct {
    floatl fixed, sloped, curved;
} Quadratic;

/* The bilinear heights along a line in a cell, 0 to 1; at s = 0 the line is at (fx, fy), and it moves by (dx, dy) s. */
INLINED Quadratic heights_along(Patch p, floatl fx, floatl fy, floatl dx, floatl dy)
{
    const floatl slope_x = (p.ab - p.aa) * HEIGHT_UNIT, slope_y = (p.ba - p.aa) * HEIGHT_UNIT;
    const floatl twist = (p.aa - p.ab - p.ba + p.bb) * HEIGHT_UNIT;
    const Quadratic along = {p.aa * HEIGHT_UNIT + slope_x * fx + slope_y * fy + twist * fx * fy,
                             slope_x * dx + slope_y * dy + twist * (fx * dy + fy * dx), twist * dx * dy};
    return along;
}

/* The least s >= 0 with q >= 0; if there is none, the result is negative, infinite or no number. */
INLINED floatl first_not_negative(Quadratic q)
{
    const floatl discriminant = q.sloped * q.sloped - 4.0f * q.curved * q.fixed;
    const floatl s = 2.0f * q.fixed / (-q.sloped - sqrt(max_lanes(discriminant, (floatl)0.0f)));
    return select_lanes(q.fixed >= 0.0f, (floatl)0.0f, select_lanes(discriminant >= 0.0f, s, (floatl)INFINITY));
}

/* The bilinear height at (x, y), which may lie outside of the map, in HEIGHT_UNITs */
floatl height_in(global const uint *texels, HeightMap map, floatl x, floatl y)
{
    FLOOR(x, x0, ix)
    FLOOR(y, y0, iy)
    const intl tx = WRAPPED(CLAMPED_U, x0, ix, map.width, map.per_width),
               ty = WRAPPED(CLAMPED_V, y0, iy, map.height, map.per_height);
    return height_of(read_cell(texels, map, ix, iy, tx, ty), x - x0, y - y0);
}
#endif
