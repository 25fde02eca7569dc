/* The kernels that run first for nearly every picture that is drawn from depth images. They form one program, as each
 * build of a program has a fixed cost. */
#include "lib/clear.cl"
#include "picture/noise.cl"
#include "picture/prepare.cl"
