#ifndef LIB_SURFACE_H
#define LIB_SURFACE_H
/* The surface of a depth image: the triangulated grid of its samples.
 *
 * The cell between samples (x, y) and (x+1, y+1) is split into two triangles by the diagonal from (x+1, y) to (x, y+1).
 * Over a triangle, nearness is an affine function of the image's u and v, with the gradient (gu, gv): so the triangle
 * is planar in space, too. A triangle or an edge is open, which means that there is no surface, if one of its corners
 * is invalid or two of its corners are torn apart; otherwise it is closed. A closed edge exists even if its triangles
 * are open: a ray that runs along the edge sees it. A cell is whole if both of its triangles are closed.
 *
 * A sample is as large as its pixel. So the image's samples are surrounded by a ring of further samples, in columns -1
 * and `width` and in rows -1 and `height`, and the surface ends half way to the ring, at the edges of the image's
 * pixels (picture/edges.cl). At depth edges, surfaces have margins (lib/margins.h). The last bits of samples store
 * which neighbours are torn apart.
 */
#include "lib/pixelspace.h"

/* A Cut decides by the nearness a >= b of two samples alone whether they are torn apart. (near_scale, far_scale, least)
 * is (1, ratio, 0) if nearness is 1/z, (1, 1, step) if it is -z, and (0, 0, 0) if no samples are torn apart. */
typedef struct {
    float near_scale, far_scale, least;
} Cut;

#define NO_CUT {0.0f, 0.0f, 0.0f}
#define IS_OPEN(cut, a, b) (((cut).near_scale * (a) - (cut).far_scale * (b) > (cut).least) | ((b) <= NO_SURFACE))

/* The edge test: neighbours are torn apart by a Cut alone or, if `straight` is 1, where the surface does not continue
 * straight. */
typedef struct {
    int straight;
    int both; /* 1: neighbours are only torn if the surface does not continue and the Cut tears them, too */
    float noise[3];     /* noise explains differences of nearness n up to noise[0] + noise[1] n + noise[2] n^2 */
    float per_pixel[3]; /* greatest change on surfaces that face the camera, along rows, columns, diagonals: */
    int perspective;    /* 1: per_pixel holds fractions of nearness; 0: differences of nearness */
} EdgeTest;

#define NOISE_DEVIATIONS 5.656854f /* standard deviations of a sample (4 sqrt(2)): noise explains smaller differences */

/* The test with the noise that picture/noise.cl has found */
EdgeTest with_noise(EdgeTest test, global const float *noise)
{
    for (int i = 0; i < 3; i++)
        test.noise[i] = NOISE_DEVIATIONS * (test.perspective ? noise[i] : i == 1 ? -noise[1] : noise[2 - i]);
    return test;
}

/* The greatest difference of nearness that noise explains between neighbours; near: the greater nearness */
#define EXPLAINED(test, near) ((test).noise[0] + (near) * ((test).noise[1] + (near) * (test).noise[2]))

/* A depth image's samples, row by row. The pointer leads to the image's first sample, not to the ring. */
typedef struct {
    global const float *nearness;
    int width, height, pitch;
    Cut cut; /* for pairs of samples that have no TORN_... bit */
} Grid;

/* The grid of a surface of (height + 2, pitch) samples, which includes a ring */
#define GRID_OF(surface, width, height, pitch, cut) {(surface) + (pitch) + 1, width, height, pitch, cut}

#define BORDER 0.5f /* pixels from the outermost samples to the end of the surface */

/* A sample's bits. Each is set if two samples are torn apart: */
#define TORN_RIGHT 1    /* the sample and its right neighbour */
#define TORN_BELOW 2    /* the sample and its neighbour below */
#define TORN_DIAGONAL 4 /* its right neighbour and its neighbour below */
#define TORN_ALL 7
#define MISSING_SAMPLE as_float(as_int(NO_SURFACE) | TORN_ALL)

/* Masks of cells with an open triangle. LOWER: the triangle with the cell's first sample; UPPER: with the last
 * sample */
#define IS_LOWER_OPEN(q00) ((as_intl(q00) & TORN_ALL) != 0)
#define IS_UPPER_OPEN(q00, q10, q01)                                                                               (((as_intl(q00) & TORN_DIAGONAL) | (as_intl(q10) & TORN_BELOW) | (as_intl(q01) & TORN_RIGHT)) != 0)

/* Samples whose nearness differs by less than this fraction show one surface, even if they are torn apart. */
#define ONE_SURFACE 0.01f

#define NEAREST 1e-30f /* smaller depths are invalid: their nearness would overflow in products */

/* In source pixels: a ray that passes this close to a sample sees only this sample. A ray that stays this close to a
 * row, a column or a diagonal of samples sees only the edges between these samples. */
#define ON_SAMPLES 1e-3f

/* The sides of a surface that are shown. The front faces the source camera. */
#define SHOWS_FRONT 1
#define SHOWS_BACK 2
#define SHOWS_BOTH 3
#endif
