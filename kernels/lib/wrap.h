#ifndef LIB_WRAP_H
#define LIB_WRAP_H
/* What maps are beyond u and v from 0 to 1. */
#include "lib/lanes.h"

#ifndef CLAMPED
#define CLAMPED 0 /* 1: beyond 0 to 1 maps go on with the values of their border; 0: they repeat */
#endif

/* IN_FIRST_TILE: where u, or v, is on the map, in numbers that stay small. FROM_FIRST: x texels from the first one's
 * centre, of `count`, at the border for what lies beyond. */
#if CLAMPED
#define IN_FIRST_TILE(u) (u)
#define FROM_FIRST(x, count) lesser(greater(x, (floatl)0.0f), (count) - 1.0f)
#else
#define IN_FIRST_TILE(u) ((u) - floor_lanes(u))
#define FROM_FIRST(x, count) (x)
#endif
#endif
