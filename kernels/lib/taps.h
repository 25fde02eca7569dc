#ifndef LIB_TAPS_H
#define LIB_TAPS_H
/* The four texels around a place of a map, of which bilinear values are made. */
#include "lib/lanes.h"
#include "lib/wrap.h"

typedef struct {
    intl column, row; /* of the first */
    intl at[4];       /* row by row */
    floatl fx, fy;    /* how far the place is from the first to the last, 0 to 1 */
} Taps;

/* Around (x, y), counted from the first texel's centre; beyond the border it counts as on it. */
INLINED Taps clamped_taps(int width, int height, floatl x, floatl y)
{
    const floatl cx = lesser(greater(x, (floatl)0.0f), (floatl)(width - 1));
    const floatl cy = lesser(greater(y, (floatl)0.0f), (floatl)(height - 1));
    const floatl x0 = lesser(truncated(cx), (floatl)max(width - 2, 0)), y0 = lesser(truncated(cy), (floatl)max(height - 2, 0));
    const int right = min(width - 1, 1), down = min(height - 1, 1) * width;
    const intl column = to_intl(x0), row = to_intl(y0), at = row * width + column;
    const Taps taps = {column, row, {at, at + right, at + down, at + down + right}, cx - x0, cy - y0};
    return taps;
}

/* Around (u, v) of a map that is tiled: its whole width is 1, and its height. */
INLINED Taps tiled_taps(intl width, intl height, floatl u, floatl v)
{
    const floatl tx = (u - floor_lanes(u)) * to_floatl(width) - 0.5f, ty = (v - floor_lanes(v)) * to_floatl(height) - 0.5f;
    const floatl x0 = floor_lanes(tx), y0 = floor_lanes(ty);
    const intl ix = to_intl(x0), iy = to_intl(y0);
    /* Lanes that do not ask may hold anything: none may read beyond the map. */
    const intl left = clamp(pick(ix < 0, ix + width, ix), (intl)0, width - 1);
    const intl up = clamp(pick(iy < 0, iy + height, iy), (intl)0, height - 1);
    const intl right = pick(left + 1 < width, left + 1, (intl)0), down = pick(up + 1 < height, up + 1, (intl)0);
    const intl upper = up * width, lower = down * width;
    const Taps taps = {left, up, {upper + left, upper + right, lower + left, lower + right}, tx - x0, ty - y0};
    return taps;
}

/* Around (u, v) of a map whose whole width is 1, and its height */
INLINED Taps map_taps(intl width, intl height, floatl u, floatl v)
{
#if CLAMPED
    const floatl across = to_floatl(width), down = to_floatl(height);
    const floatl tx = lesser(greater(u * across - 0.5f, (floatl)0.0f), across - 1.0f);
    const floatl ty = lesser(greater(v * down - 0.5f, (floatl)0.0f), down - 1.0f);
    const floatl x0 = truncated(tx), y0 = truncated(ty);
    const intl left = clamp(to_intl(x0), (intl)0, width - 1), right = min(left + 1, width - 1);
    const intl up = clamp(to_intl(y0), (intl)0, height - 1), upper = up * width, lower = min(up + 1, height - 1) * width;
    const Taps taps = {left, up, {upper + left, upper + right, lower + left, lower + right}, tx - x0, ty - y0};
    return taps;
#else
    return tiled_taps(width, height, u, v);
#endif
}

INLINED void tap_weights(Taps taps, floatl *weights)
{
    const floatl gx = 1.0f - taps.fx, gy = 1.0f - taps.fy;
    weights[0] = gx * gy;
    weights[1] = taps.fx * gy;
    weights[2] = gx * taps.fy;
    weights[3] = taps.fx * taps.fy;
}

/* The mean of the taps' values */
INLINED floatl bilinear(Taps taps, floatl aa, floatl ab, floatl ba, floatl bb)
{
    const floatl top = (1.0f - taps.fx) * aa + taps.fx * ab, bottom = (1.0f - taps.fx) * ba + taps.fx * bb;
    return (1.0f - taps.fy) * top + taps.fy * bottom;
}
#endif
