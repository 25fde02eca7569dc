#ifndef LIB_BOUNDS_H
#define LIB_BOUNDS_H
/* Least and greatest nearness of a surface in windows of cells. A line that passes a window in front of or behind all
 * of its samples can skip them.
 *
 * Window (x, y) has 2 BOUNDS_STEP cells on a side, starting at column BOUNDS_STEP * x - 1 and row BOUNDS_STEP * y - 1;
 * the first ones start in the ring. Windows overlap, so the window of a line's first cell contains BOUNDS_STEP steps
 * along the line.
 */
#include "lib/surface.h"

#define BOUNDS_STEP 8

#define FROM_RING 0.99f /* distance from the outermost samples to the ring, less a margin for rounding */

/* Number of windows over `size` samples */
#define BOUNDS_ACROSS(size) ((size) / BOUNDS_STEP + 1)
#endif
