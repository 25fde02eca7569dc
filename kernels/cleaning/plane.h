#ifndef CLEANING_PLANE_H
#define CLEANING_PLANE_H
/* Planes: images with an empty margin, so that kernels read neighbours without checks at the border.
 *
 * A row has `pitch` elements, a multiple of LANES. The first pixel of the image is in row ABOVE and column ASIDE.
 * Kernels that write a plane also write its margin, with the value that means no sample.
 */
#include "lib/lanes.h"

#define ABOVE 5   /* rows of margin above the image, and as many below: the radius of smoothing */
#define ASIDE 16 /* columns of margin on the left, a packet (LANES); at least as many on the right */

typedef struct {
    int width, height, pitch;
} ImagePlane;

#define IS_ROW_OF_IMAGE(plane, row) ((row) >= ABOVE && (row) < ABOVE + (plane).height)
#define IS_PACKET_OF_IMAGE(plane, x, row)                                                                      \
    (IS_ROW_OF_IMAGE(plane, row) && (x) >= ASIDE && (x) < ASIDE + (plane).width)

/* Mask of a packet's lanes in the image, if the packet's row belongs to the image. x: the first lane's column */
#define IN_IMAGE(plane, x) ((x) + lane_index < (intl)(ASIDE + (plane).width))

/* Loops over a work-item's `strip` packets in a row of a plane. Declares `row`, and x, the column of the first lane. */
#define EACH_PACKET(plane, x, row)                                                                             \
    const int row = get_global_id(1), end_ = row < (plane).height + 2 * ABOVE ? (plane).pitch : 0;             \
    for (int x = get_global_id(0) * strip * LANES, last_ = min(x + strip * LANES, end_); x < last_; x += LANES)

/* Bits of a pixel's mark */
#define KEPT 1    /* has a measured depth that is kept */
#define STILL 2   /* has a depth of the previous frame that still holds */
#define AREA 4    /* may have depth */
#define DOUBTED 8 /* stays in the area only if the area (area.cl) of the present seeds contains it */
#define SEED 3  /* KEPT or STILL */
#endif
