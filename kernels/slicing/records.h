#ifndef SLICING_RECORDS_H
#define SLICING_RECORDS_H
/* Ribbons (lib/ribbons.h) in memory, from ribbons.cl to object.cl: x, y, dx, dy, n, gu, gv, ends */
#define RIBBON_FLOATS 8

/* A view's map is two images (slicing/cells.cl). The first holds the nearness of the samples. Its last bits give the
 * kind of the cell between a sample and its three neighbours to the right and below; 0 is a bilinear surface. */
#define EMPTY_CELL 1   /* no surface */
#define OTHER_CELL 2   /* a surface nearer than the bilinear one */
#define OUTLINE_CELL 3 /* a surface that ends at the background */
/* The second image holds a float for each cell of another kind. The float's last bits mark the samples of the cell's
 * nearest part, row by row, and background. The float is the nearness of this part minus that of the first sample; if
 * the part has all four samples, minus that of the bilinear surface. */
#define CELL_WHOLE 15      /* all four samples */
#define CELL_BACKGROUND 16 /* at least one sample is background: samples outside the part are empty */
#define CELL_BITS 31
#endif
