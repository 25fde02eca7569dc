#ifndef SLICING_RAYS_H
#define SLICING_RAYS_H
/* Quantities that are linear along a pixel's ray, and bounds on the spacing of its slices. */
#include "lib/lanes.h"

/* At the ray's z: fixed + sloped z */
typedef struct {
    floatl fixed, sloped;
} Linear;

#define SLICES_MAX 4096     /* slices over a thing: the greatest number that a picture chooses */
#define SLICES_STEADY 256   /* slices over a displacement between which little is missed, however wide pixels are */
#define HALVINGS_MAX 24     /* of the interval between two slices: float32 holds no more */
#define PIXEL_PARTS 8       /* parts of a pixel to which a picture that chooses its slices brings points to the surface */
#define TEXTURE_PARTS 512   /* parts of a displacement to which they are brought, too, lest textures flicker */

#define AT(linear, z) ((linear).fixed + (linear).sloped * (z))
#endif
