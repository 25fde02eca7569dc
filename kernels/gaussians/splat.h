#ifndef GAUSSIANS_SPLAT_H
#define GAUSSIANS_SPLAT_H
/* Splats: Gaussians, projected to the screen.
 *
 * At (dx, dy) pixels from its centre, a splat's opacity is 2 to the power of
 *     strength - across * dx^2 - (along * dy - lean * dx)^2,
 * which is the distribution of x, and that of y for a given x. No term cancels another one, so long and thin splats are
 * exact in single precision, too. The splat's plane has the nearness (lib/pixelspace.h)
 *     nearness + nearness_x * dx + nearness_y * dy,
 * from `least` to `most`.
 */
#include "lib/color.h"

#define RECORD 16                                  /* floats of a SplatRecord */
#define LEAST_OPACITY_LOG2 (-7.9943534368588579f) /* log2(1 / 255): a smaller opacity counts as 0 */
#define NOT_DRAWN 0xFFFFFFFF                       /* sort key of Gaussians that are not drawn */

typedef struct {
    float u, v;             /* centre, in pixels */
    float across, lean, along;
    float strength;         /* log2 of the opacity at the centre */
    float reach;            /* pixels from the centre to the highest and to the lowest pixel that is drawn */
    float nearness, nearness_x, nearness_y, least, most;
    float r, g, b, unused; /* colour, at least 0 */
} SplatRecord;

/* LANES splats */
typedef struct {
    floatl u, v, across, lean, along, strength, reach, nearness, nearness_x, nearness_y, least, most;
    Color color;
} Splats;

#define SPLAT_FIELDS(s)                                                                                        \
    (s).u, (s).v, (s).across, (s).lean, (s).along, (s).strength, (s).reach, (s).nearness, (s).nearness_x,      \
        (s).nearness_y, (s).least, (s).most, (s).color.r, (s).color.g, (s).color.b, (floatl)0.0f

/* Writes LANES splats as records. */
INLINED void store_splats(Splats splats, global float *records)
{
#if LANES == 16
    float16 rows[RECORD] = {SPLAT_FIELDS(splats)};
    transpose(rows);
    for (int lane = 0; lane < LANES; lane++)
        vstore16(rows[lane], lane, records);
#else
    vstore16((float16)(SPLAT_FIELDS(splats)), 0, records);
#endif
}
#endif
