#ifndef LIB_WRAP_H
#define LIB_WRAP_H
/* Texture wrap modes: what maps are beyond u from 0 to 1, and beyond v. */
#include "lib/lanes.h"

#ifndef CLAMPED_U
#define CLAMPED_U 0 /* 1: beyond 0 to 1 maps go on with the values of their border; 0: they repeat */
#endif
#ifndef CLAMPED_V
#define CLAMPED_V 0 /* 1: the same along v */
#endif

/* u, or v, wrapped: a number that stays small */
#define WRAPPED_UV(clamped, u) ((clamped) ? (u) : (u) - floor_lanes(u))
#endif
