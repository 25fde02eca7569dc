#ifndef PICTURE_GBUFFER_H
#define PICTURE_GBUFFER_H
/* The G-buffer (Saito & Takahashi 1990): what light is to know of pixels that show things made of images.
 *
 * Those are lit once all things are drawn (picture/deferred.cl). A kernel that draws one writes which thing a pixel shows,
 * its depth, and its normal if that is asked for, whenever it writes the pixel. No other kernel knows of the buffer: an
 * entry holds only as long as its depth is the picture's. What is drawn in front later changes that.
 */
#ifndef GBUFFER
#define GBUFFER 0 /* 1: kernels that draw such things write the buffer; 2: normals, too */
#endif

#if GBUFFER
typedef struct {
    global float *depth;  /* (height, width) */
    global int *thing;    /* (height, width) number of the thing */
    global float *normal; /* (height, width, 3) in the world, of any length */
    int number;           /* of the thing that is drawn */
} GBuffer;

#if GBUFFER == 2
#define GBUFFER_PARAMETERS , global float *gbuffer_depth, global int *gbuffer_thing, int thing, global float *gbuffer_normal
#define GBUFFER_VALUE {gbuffer_depth, gbuffer_thing, gbuffer_normal, thing}
#else
#define GBUFFER_PARAMETERS , global float *gbuffer_depth, global int *gbuffer_thing, int thing
#define GBUFFER_VALUE {gbuffer_depth, gbuffer_thing, 0, thing}
#endif

/* A vector from what images of normals hold of it, which may be mixed as colours are */
#define NORMAL_OF(stored) (2.0f * (stored) - 1.0f)

/* A pixel shows the thing at a depth. normal: as images hold it */
void enter_pixel(GBuffer gbuffer, size_t pixel, float depth, float3 normal)
{
    gbuffer.depth[pixel] = depth;
    gbuffer.thing[pixel] = gbuffer.number;
#if GBUFFER == 2
    vstore3(NORMAL_OF(normal), pixel, gbuffer.normal);
#endif
}
#else
#define GBUFFER_PARAMETERS
#endif
#endif
