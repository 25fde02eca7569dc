/* All kernels that clean an image, as one program: each build of a program has a high fixed cost. */
#include "cleaning/place.cl"
#include "cleaning/keep.cl"
#include "cleaning/area.cl"
#include "cleaning/grow.cl"
#include "cleaning/islands.cl"
#include "cleaning/sharpen.cl"
#include "cleaning/smooth.cl"
