#ifndef CLEANING_PLANE_H
#define CLEANING_PLANE_H
/* Planes: an image amid a margin in which there is nothing, so that neighbours are read without asking where it ends.
 *
 * Rows are of `pitch` elements, whole packets; the image's first pixel is in row ABOVE and column ASIDE. What is said
 * of a plane's depth, values and bytes holds of its margin, too: it is written with the rest.
 */
#include "lib/lanes.h"

#define ABOVE 5   /* rows of margin, below the image too: as far as the smoothing looks */
#define ASIDE 16 /* columns, a packet, to the left; to the right at least as many */

typedef struct {
    int width, height, pitch;
} ImagePlane;

#define IS_ROW_OF_IMAGE(plane, row) ((row) >= ABOVE && (row) < ABOVE + (plane).height)
#define IS_PACKET_OF_IMAGE(plane, x, row)                                                                      \
    (IS_ROW_OF_IMAGE(plane, row) && (x) >= ASIDE && (x) < ASIDE + (plane).width)

/* Lanes of a packet of an image's row that are pixels of it */
#define IN_IMAGE(plane, x) ((x) + lane_index < (intl)(ASIDE + (plane).width))

/* A work-item's packets of a row of a plane, `strip` of them: x is the first lane's column. */
#define EACH_PACKET(plane, x)                                                                                  \
    for (int x = get_global_id(0) * strip * LANES, end_ = min(x + strip * LANES, (plane).pitch); x < end_; x += LANES)

/* What bytes of a plane tell of a pixel */
#define KEPT 1    /* was measured, and is believed */
#define STILL 2   /* is taken from the frame before */
#define AREA 4    /* may have depth */
#define DOUBTED 8 /* has to be within the area of what is kept now to stay in it */
#define SEED 3  /* KEPT or STILL */
#endif
