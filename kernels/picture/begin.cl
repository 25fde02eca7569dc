/* The kernels with which nearly every picture of images begins, as one program: each program's build has a fixed
 * cost. */
#include "lib/clear.cl"
#include "picture/noise.cl"
#include "picture/prepare.cl"
