#ifndef LIB_BOUNDS_H
#define LIB_BOUNDS_H
/* How near and how far a surface is within windows of its cells: what passes a window before or behind all of its
 * samples need not look at them.
 *
 * Window (x, y) has 2 BOUNDS_STEP cells on a side, from column BOUNDS_STEP * x - 1 and row BOUNDS_STEP * y - 1 on, the
 * ring's first ones. They overlap, so that the one that a line's first cell tells holds BOUNDS_STEP steps along it.
 */
#include "lib/surface.h"

#define BOUNDS_STEP 8

#define FROM_RING 0.99f /* from samples to those of the ring; less by what rounding may do, for which windows have room */

/* Windows over so many samples */
#define BOUNDS_ACROSS(size) ((size) / BOUNDS_STEP + 1)
#endif
