#ifndef LIB_TAPS_H
#define LIB_TAPS_H
/* The four texels around a position on a map, for bilinear interpolation. */
#include "lib/lanes.h"
#include "lib/wrap.h"

typedef struct {
    intl column, row; /* the first texel's column and row */
    intl at[4];       /* indices of the four texels, row by row */
    floatl fx, fy;    /* position between the texels: 0 at the left (upper) ones, 1 at the right (lower) ones */
} Taps;

/* The taps around (x, y), in texels from the centre of the map's first texel. Positions outside are moved to the
 * border. */
INLINED Taps clamped_taps(int width, int height, floatl x, floatl y)
{
    const floatl cx = clamp_lanes(x, (floatl)0.0f, (floatl)(width - 1));
    const floatl cy = clamp_lanes(y, (floatl)0.0f, (floatl)(height - 1));
    const floatl x0 = min_lanes(truncated(cx), (floatl)max(width - 2, 0)),
                 y0 = min_lanes(truncated(cy), (floatl)max(height - 2, 0));
    const int right = min(width - 1, 1), down = min(height - 1, 1) * width;
    const intl column = to_intl(x0), row = to_intl(y0), at = row * width + column;
    const Taps taps = {column, row, {at, at + right, at + down, at + down + right}, cx - x0, cy - y0};
    return taps;
}

/* Finds the two texels around a position on one axis of a map; along the axis, the map has length 1. Returns the
 * position between the texels: 0 at the first, 1 at the second. */
INLINED floatl taps_along(int clamped, intl size, floatl place, intl *first, intl *second)
{
    /* Inactive lanes may have any value, but must not read outside of the map. */
    const floatl length = to_floatl(size);
    if (clamped) {
        const floatl t = clamp_lanes(place * length - 0.5f, (floatl)0.0f, length - 1.0f), whole = truncated(t);
        *first = clamp(to_intl(whole), (intl)0, size - 1);
        *second = min(*first + 1, size - 1);
        return t - whole;
    }
    const floatl t = (place - floor_lanes(place)) * length - 0.5f, whole = floor_lanes(t);
    const intl number = to_intl(whole);
    *first = clamp(select_lanes(number < 0, number + size, number), (intl)0, size - 1);
    *second = select_lanes(*first + 1 < size, *first + 1, (intl)0);
    return t - whole;
}

/* The taps around (u, v); u and v go from 0 to 1 across the map. */
INLINED Taps map_taps(intl width, intl height, floatl u, floatl v)
{
    intl left, right, up, down;
    const floatl fx = taps_along(CLAMPED_U, width, u, &left, &right), fy = taps_along(CLAMPED_V, height, v, &up, &down);
    const intl upper = up * width, lower = down * width;
    const Taps taps = {left, up, {upper + left, upper + right, lower + left, lower + right}, fx, fy};
    return taps;
}

/* The bilinear weights of the four texels, row by row, at position (fx, fy) between them */
INLINED void tap_weights(floatl fx, floatl fy, floatl *weights)
{
    const floatl gx = 1.0f - fx, gy = 1.0f - fy;
    weights[0] = gx * gy;
    weights[1] = fx * gy;
    weights[2] = gx * fy;
    weights[3] = fx * fy;
}

/* The value of the nearest of the four texels. */
#define NEAREST_TAP(taps, values)                                                                              \
    select_lanes((taps).fy >= 0.5f, select_lanes((taps).fx >= 0.5f, (values)[3], (values)[2]),                 \
                 select_lanes((taps).fx >= 0.5f, (values)[1], (values)[0]))

/* The weighted mean of the taps' values */
INLINED floatl bilinear(Taps taps, floatl aa, floatl ab, floatl ba, floatl bb)
{
    const floatl top = (1.0f - taps.fx) * aa + taps.fx * ab, bottom = (1.0f - taps.fx) * ba + taps.fx * bb;
    return (1.0f - taps.fy) * top + taps.fy * bottom;
}
#endif
