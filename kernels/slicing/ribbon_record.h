#ifndef SLICING_RIBBON_RECORD_H
#define SLICING_RIBBON_RECORD_H
/* Layout of ribbons (lib/ribbons.h) in memory, from ribbons.cl to object.cl. */
#define RIBBON_FLOATS 8 /* floats: x, y, dx, dy, n, gu, gv, ends */
#endif
