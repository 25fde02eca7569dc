#ifndef SLICING_RAYS_H
#define SLICING_RAYS_H
/* Quantities that are linear along a pixel's ray, and limits for the number of slices. */
#include "lib/lanes.h"

/* The value at the ray's depth z: fixed + sloped z */
typedef struct {
    floatl fixed, sloped;
} Linear;

/* If the number of slices depends on the size of pixels: */
#define SLICES_MAX 4096     /* most slices through an object or a displacement */
#define SLICES_STEADY 256   /* this many slices through a displacement miss few thin parts, even if pixels are wide */
#define HALVINGS_MAX 24     /* most bisections of the interval between two slices: float32 resolves no more */
#define PIXEL_PARTS 8       /* hits are at most 1/8 of a pixel from the surface */
#define TEXTURE_PARTS 512   /* and at most 1/512 of the displacement, so that textures do not flicker */

#define AT(linear, z) ((linear).fixed + (linear).sloped * (z))
#endif
