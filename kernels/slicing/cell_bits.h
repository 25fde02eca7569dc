#ifndef SLICING_CELL_BITS_H
#define SLICING_CELL_BITS_H
/* A view's map is two images (slicing/cells.cl): the nearness of samples, whose last bits tell what the cell between a
 * sample and its three neighbours to the right and below is, */
#define EMPTY_CELL 1 /* there is no surface, */
#define OTHER_CELL 2 /* or a nearer one than the bilinear, */
#define OUTLINE_CELL 3 /* or one that ends */
/* and other cells: floats whose last bits tell which of the samples, row by row, are of the nearest part, and whether
 * one is background. That part is by so much nearer than the first sample; or, of all four, than the bilinear. */
#define CELL_WHOLE 15      /* all four */
#define CELL_BACKGROUND 16 /* one at least: what is not of the part is empty */
#define CELL_BITS 31
#endif
