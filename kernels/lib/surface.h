#ifndef LIB_SURFACE_H
#define LIB_SURFACE_H
/* The surface of a depth image: the triangulated grid of its samples.
 *
 * The cell between samples (x, y) and (x+1, y+1) is split by the diagonal from (x+1, y) to (x, y+1). Nearness is
 * affine over a triangle, so a plane in space is a plane (gu, gv) over the image. A triangle, or an edge, is open (no
 * surface) if one of its corners is no surface, or if two of its corners' depths are torn apart. An edge is there if
 * its own two samples are, whatever becomes of the triangles beside it: that is what a ray sees that runs along it.
 */
#include "lib/pixelspace.h"

/* Are two samples of nearness a >= b torn apart? (near_scale, far_scale, least) is (1, ratio, 0) where nearness is
 * 1/z, (1, 1, step) where it is -z, (0, 0, 0) where all neighbours are one surface. */
typedef struct {
    float near_scale, far_scale, least;
} Cut;

#define IS_OPEN(cut, a, b) (((cut).near_scale * (a) - (cut).far_scale * (b) > (cut).least) | ((b) <= NO_SURFACE))

/* A depth image's samples, row by row */
typedef struct {
    global const float *nearness;
    int width, height, pitch;
    Cut cut;
} Grid;

/* Of the nearness: within it samples show one surface, whatever tears neighbours. */
#define ONE_SURFACE 0.01f

#define NEAREST 1e-30f /* depths below it are invalid: their nearness would overflow in products */

/* A ray that passes a sample, or runs along a row, a column or the diagonals of the cells, within this many pixels
 * of the source sees the sample, or the edges that it runs along, alone. */
#define ON_SAMPLES 1e-3f

/* Which sides of a surface are shown, seen from the source camera. */
#define SHOWS_FRONT 1
#define SHOWS_BACK 2
#define SHOWS_BOTH 3
#endif
