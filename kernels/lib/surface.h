#ifndef LIB_SURFACE_H
#define LIB_SURFACE_H
/* The surface of a depth image: the triangulated grid of its samples.
 *
 * The cell between samples (x, y) and (x+1, y+1) is split by the diagonal from (x+1, y) to (x, y+1). Nearness is
 * affine over a triangle, so a plane in space is a plane (gu, gv) over the image. A triangle, or an edge, is open (no
 * surface) if one of its corners is no surface, or if two of its corners' depths are torn apart. An edge is there if
 * its own two samples are, whatever becomes of the triangles beside it: that is what a ray sees that runs along it.
 *
 * A sample is as large as the pixel that measured it: surfaces have a ring of further samples around the image's own,
 * which are those of columns and rows -1 and `width` and `height`, and end at the edges of the image's pixels, half way
 * to them (picture/edges.cl). At edges they have margins (lib/margins.h). Which neighbours are torn apart stands in the
 * samples' last bits.
 */
#include "lib/pixelspace.h"

/* Are two samples of nearness a >= b torn apart? (near_scale, far_scale, least) is (1, ratio, 0) where nearness is
 * 1/z, (1, 1, step) where it is -z, (0, 0, 0) where all neighbours are one surface. */
typedef struct {
    float near_scale, far_scale, least;
} Cut;

#define NO_CUT {0.0f, 0.0f, 0.0f}
#define IS_OPEN(cut, a, b) (((cut).near_scale * (a) - (cut).far_scale * (b) > (cut).least) | ((b) <= NO_SURFACE))

/* How neighbours are told to be torn apart: where the surface does not go on, or, if not `straight`, by a Cut alone. */
typedef struct {
    int straight;
    int both; /* where the surface does not go on, and the Cut tears, too */
    float noise[3];     /* noise changes nearness n by up to noise[0] + noise[1] n + noise[2] n^2 from sample to sample */
    float per_pixel[3]; /* along rows, columns, diagonals: what the steepest surface that faces the camera changes it by, */
    int perspective;    /* as a part of itself, or in all */
} EdgeTest;

#define NOISE_DEVIATIONS 5.656854f /* 4 sqrt(2): neighbours differ by no more deviations of a sample's noise */

/* The test with the noise of picture/noise.cl */
EdgeTest with_noise(EdgeTest test, global const float *noise)
{
    for (int i = 0; i < 3; i++)
        test.noise[i] = NOISE_DEVIATIONS * (test.perspective ? noise[i] : i == 1 ? -noise[1] : noise[2 - i]);
    return test;
}

/* Change of nearness that noise explains */
#define EXPLAINED(test, near) ((test).noise[0] + (near) * ((test).noise[1] + (near) * (test).noise[2]))

/* A depth image's samples, row by row, from its own first one on */
typedef struct {
    global const float *nearness;
    int width, height, pitch;
    Cut cut; /* of pairs that no bit tells of */
} Grid;

/* The grid of a surface with a ring, of (height + 2, pitch) samples */
#define GRID_OF(surface, width, height, pitch, cut) {(surface) + (pitch) + 1, width, height, pitch, cut}

#define BORDER 0.5f /* pixels from the outermost samples to where the surface ends */

/* Bits of a sample: what is torn apart */
#define TORN_RIGHT 1    /* the sample from the one to its right, */
#define TORN_BELOW 2    /* from the one below it, */
#define TORN_DIAGONAL 4 /* its neighbour to the right from its neighbour below */
#define TORN_ALL 7
#define MISSING_SAMPLE as_float(as_int(NO_SURFACE) | TORN_ALL)

/* Is the cell's triangle of the first sample open, or that of the last one? Of lanes */
#define IS_LOWER_OPEN(q00) ((as_intl(q00) & TORN_ALL) != 0)
#define IS_UPPER_OPEN(q00, q10, q01)                                                                               (((as_intl(q00) & TORN_DIAGONAL) | (as_intl(q10) & TORN_BELOW) | (as_intl(q01) & TORN_RIGHT)) != 0)

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
