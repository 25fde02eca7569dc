#ifndef LIB_WRAP_H
#define LIB_WRAP_H
/* What maps are beyond u and v from 0 to 1. */
#include "lib/lanes.h"

#ifndef CLAMPED
#define CLAMPED 0 /* 1: beyond 0 to 1 maps go on with the values of their border; 0: they repeat */
#endif

/* Where u, or v, is on the map, in numbers that stay small */
#if CLAMPED
#define IN_FIRST_TILE(u) (u)
#else
#define IN_FIRST_TILE(u) ((u) - floor_lanes(u))
#endif
#endif
