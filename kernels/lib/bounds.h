#ifndef LIB_BOUNDS_H
#define LIB_BOUNDS_H
/* The least and the greatest nearness of a surface in each window of cells. A line that passes in front of all samples
 * of a window, or behind all of them, can skip the window.
 *
 * Window (x, y) has 2 BOUNDS_STEP cells on a side. Its first column is BOUNDS_STEP * x - 1, its first row BOUNDS_STEP *
 * y - 1, so the first windows start in the ring (surface.h). Windows overlap, so that wherever a line starts, its next
 * BOUNDS_STEP cells lie in one window.
 */
#include "lib/surface.h"

#define BOUNDS_STEP 8

#define FROM_RING 0.99f /* pixels from the ring to the image's first samples, less 0.01 for rounding */

/* The number of windows across `size` samples */
#define BOUNDS_ACROSS(size) ((size) / BOUNDS_STEP + 1)
#endif
