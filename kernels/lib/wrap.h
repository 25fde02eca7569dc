#ifndef LIB_WRAP_H
#define LIB_WRAP_H
/* Wrap modes of textures: the values that maps have where u or v is below 0 or above 1. */
#include "lib/lanes.h"

#ifndef CLAMPED_U
#define CLAMPED_U 0 /* 1: beyond their border along u, maps keep the border's values; 0: they repeat */
#endif
#ifndef CLAMPED_V
#define CLAMPED_V 0 /* 1: the same along v */
#endif

/* u or v; if the map repeats, only the fraction, from 0 to 1 */
#define WRAPPED_UV(clamped, u) ((clamped) ? (u) : (u) - floor_lanes(u))
#endif
