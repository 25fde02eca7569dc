#ifndef LIB_NORMALS_H
#define LIB_NORMALS_H
/* Directions in the world, and maps of normals. */
#include "lib/lanes.h"
#include "lib/screen.h"

Direction at_unit_length(Direction d)
{
    const floatl unit = 1.0f / sqrt(greater(d.x * d.x + d.y * d.y + d.z * d.z, (floatl)1e-30f));
    const Direction made = {d.x * unit, d.y * unit, d.z * unit};
    return made;
}

/* A map of unit normals (height, width, 3) at (u, v), tiled and bilinear: x along u, y along v, z along the normal */
Direction normal_in(global const float *map, int width, int height, floatl u, floatl v)
{
    const floatl tx = (u - floor_lanes(u)) * width - 0.5f, ty = (v - floor_lanes(v)) * height - 0.5f;
    const floatl x0 = floor_lanes(tx), y0 = floor_lanes(ty), fx = tx - x0, fy = ty - y0;
    const intl left = pick(x0 < 0.0f, (intl)(width - 1), min(to_intl(x0), (intl)(width - 1)));
    const intl up = pick(y0 < 0.0f, (intl)(height - 1), min(to_intl(y0), (intl)(height - 1)));
    const intl right = pick(left + 1 < width, left + 1, (intl)0), down = pick(up + 1 < height, up + 1, (intl)0);
    floatl part[3];
    for (int axis = 0; axis < 3; axis++) {
        const intl aa = 3 * (up * width + left) + axis, ab = 3 * (up * width + right) + axis;
        const intl ba = 3 * (down * width + left) + axis, bb = 3 * (down * width + right) + axis;
        const floatl top = (1.0f - fx) * (floatl)(gather(map, aa)) + fx * (floatl)(gather(map, ab));
        const floatl bottom = (1.0f - fx) * (floatl)(gather(map, ba)) + fx * (floatl)(gather(map, bb));
        part[axis] = (1.0f - fy) * top + fy * bottom;
    }
    const Direction made = {part[0], part[1], part[2]};
    return made;
}
#endif
