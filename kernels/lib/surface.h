/* The surface that a depth image means: the triangulated grid of its samples.
 *
 * The cell between samples (x, y) and (x+1, y+1) is split by the diagonal from (x+1, y) to (x, y+1). Nearness is
 * affine over a triangle, so a plane in space is a plane (gu, gv) over the image. A triangle is open (no surface)
 * if one of its corners is no surface, or if its corners' depths differ by more than the cut ratio.
 */
#include "lib/pixelspace.h"

/* Are two samples of nearness a >= b torn apart? near_scale, far_scale: (1, ratio) where nearness is 1/z,
 * (ratio, 1) where it is -z, (0, 0) where all neighbours are one surface. */
typedef struct {
    float near_scale, far_scale;
} Cut;

#define IS_OPEN(cut, a, b) (((cut).near_scale * (a) - (cut).far_scale * (b) > 0.0f) | ((b) <= NO_SURFACE))

/* Which sides of a surface are shown, seen from the source camera. */
#define SHOWS_FRONT 1
#define SHOWS_BACK 2
