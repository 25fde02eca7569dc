#ifndef LIB_NORMALS_H
#define LIB_NORMALS_H
/* Maps of normals. */
#include "lib/taps.h"
#include "lib/vectors.h"

/* A map of unit normals (height, width, 3) at (u, v), tiled or clamped, bilinear: x along u, y along v, z along the normal */
INLINED Vector normal_in(global const float *map, int width, int height, floatl u, floatl v)
{
    const Taps taps = map_taps(width, height, u, v);
    floatl part[3];
    for (int axis = 0; axis < 3; axis++) {
#define NORMAL_TAP(k) (floatl)(gather(map, 3 * taps.at[k] + axis))
        part[axis] = bilinear(taps, NORMAL_TAP(0), NORMAL_TAP(1), NORMAL_TAP(2), NORMAL_TAP(3));
    }
    const Vector made = {part[0], part[1], part[2]};
    return made;
}
#endif
