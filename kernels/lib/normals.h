#ifndef LIB_NORMALS_H
#define LIB_NORMALS_H
/* Normal maps. */
#include "lib/taps.h"
#include "lib/texture.h"
#include "lib/vectors.h"

/* The bilinear value at (u, v) of one mipmap level of a normal map, tiled or clamped. The map is (height, width, 3): x
 * along u, y along v, z along the surface's normal. Normals of the first level have unit length. */
INLINED Vector normal_in(global const float *map, int width, int height, intl level, floatl u, floatl v)
{
    intl across = width, down = height;
    const intl start = start_of_level(level, &across, &down);
    const Taps taps = map_taps(across, down, u, v);
    floatl part[3];
    UNROLLED
    for (int axis = 0; axis < 3; axis++) {
#define NORMAL_TAP(k) (floatl)(gather(map, 3 * (start + taps.at[k]) + axis))
        part[axis] = bilinear(taps, NORMAL_TAP(0), NORMAL_TAP(1), NORMAL_TAP(2), NORMAL_TAP(3));
    }
    const Vector made = {part[0], part[1], part[2]};
    return made;
}
#endif
