#ifndef SLICING_RECORDS_H
#define SLICING_RECORDS_H
/* Ribbons (lib/ribbons.h) in memory, from ribbons.cl to object.cl: x, y, dx, dy, n, gu, gv, ends */
#define RIBBON_FLOATS 8

/* A view's map is two images (slicing/cells.cl). The first holds the nearness of the samples. The last two bits of a
 * sample's float are the kind of the cell between the sample and its neighbours to the right, below and to the lower
 * right; kind 0 is a bilinear surface. */
#define EMPTY_CELL 1   /* no surface */
#define OTHER_CELL 2   /* a surface that is nearer than the bilinear surface */
#define OUTLINE_CELL 3 /* a surface that ends at the background */
/* The second image holds a float for each cell whose kind is not 0. The float's last bits mark which samples belong to
 * the cell's nearest part, row by row, and whether there is background. The float is the part's nearness minus the
 * bilinear surface's if all four samples belong to this part, else the part's nearness minus the first sample's. */
#define CELL_WHOLE 15      /* all four samples belong to the nearest part */
#define CELL_BACKGROUND 16 /* at least one sample is background: beyond the nearest part, the cell is empty */
#define CELL_BITS 31
#endif
