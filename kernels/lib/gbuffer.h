#ifndef LIB_GBUFFER_H
#define LIB_GBUFFER_H
/* The G-buffer (Saito & Takahashi 1990): depths and normals of things drawn from images, for deferred lighting.
 *
 * Such things are lit after all things are drawn (picture/deferred.cl). A kernel that draws such a thing writes, for
 * each of the thing's pixels, the thing's number, the depth and, with GBUFFER 2, the normal. Other kernels do not write
 * the buffer. So an entry is only valid if its depth equals the picture's depth; otherwise another thing was drawn in
 * front later.
 */
#include "lib/lanes.h"

#ifndef GBUFFER
#define GBUFFER 0 /* 0: kernels do not write the buffer; 1: they write thing and depth; 2: also the normal */
#endif

#if GBUFFER
typedef struct {
    global float *depth;  /* (height, width) */
    global int *thing;    /* (height, width) number of the thing */
    global float *normal; /* (height, width, 3) in the world, of any length; with GBUFFER 2 */
    int number;           /* the drawn thing's number */
} GBuffer;
#else
typedef struct {
    int number;
} GBuffer;
#endif

/* The parameters that a kernel has for the buffer, and the initializer of its variable of type GBuffer */
#if GBUFFER == 2
#define GBUFFER_PARAMETERS , global float *gbuffer_depth, global int *gbuffer_thing, int thing, global float *gbuffer_normal
#define GBUFFER_VALUE {gbuffer_depth, gbuffer_thing, gbuffer_normal, thing}
#elif GBUFFER == 1
#define GBUFFER_PARAMETERS , global float *gbuffer_depth, global int *gbuffer_thing, int thing
#define GBUFFER_VALUE {gbuffer_depth, gbuffer_thing, 0, thing}
#else
#define GBUFFER_PARAMETERS
#define GBUFFER_VALUE {0}
#endif

/* The parameter that a kernel has for the normals of its images, as colours 0.5 + 0.5 (x, y, z); and the argument to
 * pass */
#if GBUFFER == 2
#define NORMALS_PARAMETER(type) , global const type *normals
#define NORMALS_ARGUMENT(type) normals
#else
#define NORMALS_PARAMETER(type)
#define NORMALS_ARGUMENT(type) (global const type *)0
#endif

/* Writes the entry of a pixel that shows the thing at a depth. normal: as a colour 0.5 + 0.5 (x, y, z) */
INLINED void enter_pixel(GBuffer gbuffer, size_t pixel, float depth, float3 normal)
{
#if GBUFFER
    gbuffer.depth[pixel] = depth;
    gbuffer.thing[pixel] = gbuffer.number;
#endif
#if GBUFFER == 2
    vstore3(2.0f * normal - 1.0f, pixel, gbuffer.normal);
#endif
}
#endif
