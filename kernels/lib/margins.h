#ifndef LIB_MARGINS_H
#define LIB_MARGINS_H
/* The margins of a surface: at depth edges, the parts of pixels that no triangle covers.
 *
 * A sample is as large as its pixel, but at an edge the triangles of lib/surface.h end at the samples. Margins extend
 * the surface by half a pixel: each sample at a corner of an open triangle gets the part of the triangle that is
 * nearest to it. In a cell, a sample's margin is a quarter of its pixel; if one of the cell's triangles is closed, the
 * margin is only the part of this quarter on the open triangle's side of the diagonal.
 *
 * Margins are found once for each surface (picture/small_parts.cl). They are stored in MARGIN_PLANES rows of `pitch`
 * numbers, one margin per column.
 */
#define MARGIN_X 0 /* the sample's column */
#define MARGIN_Y 1 /* the sample's row */
#define MARGIN_NEARNESS 2 /* nearness at the sample */
#define MARGIN_SLOPE_X 3  /* change of nearness per column */
#define MARGIN_SLOPE_Y 4  /* change of nearness per row */
#define MARGIN_BITS 5 /* an int of the bits below */
#define MARGIN_PLANES 6

#define TO_RIGHT 1 /* the quarter lies to the right of the sample */
#define TO_BELOW 2 /* the quarter lies below the sample */
#define IN_LOWER 4 /* the margin covers the cell's first triangle, on the upper left of the diagonal */
#define IN_UPPER 8 /* the margin covers the cell's second triangle */
#endif
