/* All kernels that clean an image, as one program: building one takes longer than what is in it. */
#include "cleaning/place.cl"
#include "cleaning/keep.cl"
#include "cleaning/area.cl"
#include "cleaning/grow.cl"
#include "cleaning/islands.cl"
#include "cleaning/sharpen.cl"
#include "cleaning/smooth.cl"
