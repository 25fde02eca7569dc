/* All kernels that clean an image, as one program: each program's build has a fixed cost, more than one more kernel
 * costs. */
#include "cleaning/place.cl"
#include "cleaning/keep.cl"
#include "cleaning/area.cl"
#include "cleaning/grow.cl"
#include "cleaning/islands.cl"
#include "cleaning/sharpen.cl"
#include "cleaning/smooth.cl"
