#ifndef SLICING_RAYS_H
#define SLICING_RAYS_H
/* Quantities that are linear along a pixel's ray. */
#include "lib/lanes.h"

/* At the ray's z: fixed + sloped z */
typedef struct {
    floatl fixed, sloped;
} Linear;

#define AT(linear, z) ((linear).fixed + (linear).sloped * (z))
#endif
