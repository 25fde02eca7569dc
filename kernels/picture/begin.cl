/* The first kernels of nearly every picture of images, as one program: each program adds a fixed time to builds. */
#include "lib/clear.cl"
#include "picture/noise.cl"
#include "picture/prepare.cl"
