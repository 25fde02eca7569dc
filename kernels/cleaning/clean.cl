/* All kernels that clean an image, as one program: building a program has a fixed cost, more than a kernel adds. */
#include "cleaning/place.cl"
#include "cleaning/keep.cl"
#include "cleaning/area.cl"
#include "cleaning/grow.cl"
#include "cleaning/islands.cl"
#include "cleaning/sharpen.cl"
#include "cleaning/smooth.cl"
