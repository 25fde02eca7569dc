#ifndef LIB_NORMALS_H
#define LIB_NORMALS_H
/* Maps of normals. */
#include "lib/taps.h"
#include "lib/texture.h"
#include "lib/vectors.h"

/* A level of a map of normals (height, width, 3), which has mipmaps as textures do, at (u, v), tiled or clamped,
 * bilinear: x along u, y along v, z along the normal. Those of the first level are of unit length. */
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
