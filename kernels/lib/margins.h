#ifndef LIB_MARGINS_H
#define LIB_MARGINS_H
/* The margins of a surface: what no triangle covers of the pixels of samples beside depth edges.
 *
 * A sample is as large as the pixel that measured it, but at an edge the triangles of lib/surface.h end at the samples
 * themselves. There the surface goes on, half a pixel: of an open triangle each corner has the part that lies
 * nearest to it. Seen from a sample, that is a quarter of its pixel; or one half of a quarter, on one side of the
 * cell's diagonal, if the other half is in a triangle.
 *
 * Found once a surface (picture/small_parts.cl), they lie in MARGIN_PLANES rows of `pitch` numbers: one quarter a column.
 */
#define MARGIN_X 0 /* the sample's column and row */
#define MARGIN_Y 1
#define MARGIN_NEARNESS 2 /* at the sample, */
#define MARGIN_SLOPE_X 3  /* and its changes from column to column and from row to row */
#define MARGIN_SLOPE_Y 4
#define MARGIN_BITS 5 /* an int: */
#define MARGIN_PLANES 6

#define TO_RIGHT 1 /* the quarter lies to the right of the sample, */
#define TO_BELOW 2 /* below it; */
#define IN_LOWER 4 /* it is a margin on the upper left of the cell's diagonal, where its first triangle would be, */
#define IN_UPPER 8 /* on the other side */
#endif
