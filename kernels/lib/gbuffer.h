#ifndef LIB_GBUFFER_H
#define LIB_GBUFFER_H
/* The G-buffer (Saito & Takahashi 1990): what deferred shading has to know of pixels that show things made of images.
 *
 * Those are lit once all things are drawn (picture/deferred.cl). A kernel that draws one enters each pixel that it
 * writes: which thing that shows, at what depth, and its normal if that is asked for. No other kernel knows of the
 * buffer: an entry holds only as long as its depth is the picture's. What is drawn in front later changes that.
 */
#include "lib/lanes.h"

#ifndef GBUFFER
#define GBUFFER 0 /* 1: kernels that draw such things write the buffer; 2: normals, too; 0: nothing is entered */
#endif

#if GBUFFER
typedef struct {
    global float *depth;  /* (height, width) */
    global int *thing;    /* (height, width) number of the thing */
    global float *normal; /* (height, width, 3) in the world, of any length; with GBUFFER 2 */
    int number;           /* of the thing that is drawn */
} GBuffer;
#else
typedef struct {
    int number;
} GBuffer;
#endif

/* A kernel's parameters for it, and its value */
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

/* A kernel's parameter of the normals that its images have, as colours: 0.5 + 0.5 of x, y and z; and its value */
#if GBUFFER == 2
#define NORMALS_PARAMETER(type) , global const type *normals
#define NORMALS_ARGUMENT(type) normals
#else
#define NORMALS_PARAMETER(type)
#define NORMALS_ARGUMENT(type) (global const type *)0
#endif

/* Enters that a pixel shows the thing at a depth. normal: as images hold it */
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
