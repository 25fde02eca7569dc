#ifndef CLEANING_PLANE_H
#define CLEANING_PLANE_H
/* Planes: images with an empty margin, so that kernels read neighbours without checks at the border.
 *
 * A row has `pitch` elements, in whole packets; the first pixel of the image is in row ABOVE and column ASIDE. Kernels
 * write the margin of a plane, too, with the values for no sample.
 */
#include "lib/lanes.h"

#define ABOVE 5   /* rows of margin above the image, and below: the radius of the smoothing */
#define ASIDE 16 /* columns of margin to the left, a packet; to the right at least as many */

typedef struct {
    int width, height, pitch;
} ImagePlane;

#define IS_ROW_OF_IMAGE(plane, row) ((row) >= ABOVE && (row) < ABOVE + (plane).height)
#define IS_PACKET_OF_IMAGE(plane, x, row)                                                                      \
    (IS_ROW_OF_IMAGE(plane, row) && (x) >= ASIDE && (x) < ASIDE + (plane).width)

/* Mask of the lanes of a packet that are pixels of the image, in a row of the image */
#define IN_IMAGE(plane, x) ((x) + lane_index < (intl)(ASIDE + (plane).width))

/* Loops over a work-item's packets of a row of a plane, `strip` of them; x is the first lane's column. Declares `row`. */
#define EACH_PACKET(plane, x, row)                                                                             \
    const int row = get_global_id(1), end_ = row < (plane).height + 2 * ABOVE ? (plane).pitch : 0;             \
    for (int x = get_global_id(0) * strip * LANES, last_ = min(x + strip * LANES, end_); x < last_; x += LANES)

/* Bits of a pixel's mark */
#define KEPT 1    /* measured and kept */
#define STILL 2   /* depth of the previous frame that still holds */
#define AREA 4    /* may have depth */
#define DOUBTED 8 /* stays in the area only if the closing of the present seeds contains it */
#define SEED 3  /* KEPT or STILL */
#endif
