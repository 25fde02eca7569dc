#ifndef LIB_WRAP_H
#define LIB_WRAP_H
/* Texture wrap modes: values of maps outside u or v from 0 to 1. */
#include "lib/lanes.h"

#ifndef CLAMPED_U
#define CLAMPED_U 0 /* 1: outside 0 to 1, maps have the values of their border; 0: they repeat */
#endif
#ifndef CLAMPED_V
#define CLAMPED_V 0 /* 1: the same along v */
#endif

/* u or v, wrapped to a small number if the map repeats */
#define WRAPPED_UV(clamped, u) ((clamped) ? (u) : (u) - floor_lanes(u))
#endif
