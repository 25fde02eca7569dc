#ifndef WARP_LAYERS_H
#define WARP_LAYERS_H
/* Layers (the pictures of single views): their planes in the buffers of blend.cl, and the parameters of their views. */
#include "lib/channel.h"
#include "lib/gbuffer.h"
#include "lib/lanes.h"

#ifndef ORIGINS
#define ORIGINS 0 /* 1: pixels' origins (views, places in them) are kept: from the layer with the greatest weight */
#endif
#define TOLERANCE_MIN 0.02f   /* fraction of the depth: layers that differ by less show one surface */
#define LAYER_DEVIATIONS 4.0f /* standard deviations: noise explains smaller differences of depth */

#define WEIGHT 0
#define DEPTH 1
#define COLOR 2
#if CHANNELS == 0
#define COLOR_PLANES 0
#elif COLOR_BYTES == 1
#define COLOR_PLANES 1
#else
#define COLOR_PLANES 3
#endif
#define ORIGIN_PLANES 2
#define NORMAL_PLANES 3
#define ORIGIN (COLOR + COLOR_PLANES)
#define NORMAL (ORIGIN + ORIGIN_PLANES * ORIGINS)
#define LAYER_PLANES (NORMAL + NORMAL_PLANES * (GBUFFER == 2))

#define MEANS 1 /* the first of four planes: means of red, green, blue, depth */
#define GREATEST 5
#define ORIGIN_SUMS 4
#define NORMAL_MEANS (GREATEST + ORIGIN_SUMS * ORIGINS)
#define SUMS (NORMAL_MEANS + NORMAL_PLANES * (GBUFFER == 2))

/* The view of a layer. density: pixels per square scene unit, at depth 1 in perspective views, at any depth in
 * orthographic views */
typedef struct {
    float forward[3], centre[3]; /* relative to the screen's origin */
    float density;               /* fx * fy */
    int perspective;
    int low_x, high_x, low_y, high_y; /* pixels that the view may reach */
} LayerView;

/* A layer's view when layers are blended: factors of its colours; the noise's standard deviation noise_2 z z + noise_1
 * z + noise_0 at depth z; the view's number. */
typedef struct {
    float red, green, blue;
    float noise_2, noise_1, noise_0;
    int number;
} BlendedView;

/* The tolerated error of a layer's depth. unit: scene units; if above 0, it replaces z in the least tolerance, as
 * depths of orthographic views have no origin. */
INLINED floatl depth_tolerance(BlendedView view, float unit, floatl z)
{
    const floatl noise = LAYER_DEVIATIONS * ((view.noise_2 * z + view.noise_1) * z + view.noise_0);
    return max_lanes(noise, unit > 0.0f ? (floatl)(TOLERANCE_MIN * unit) : TOLERANCE_MIN * z);
}
#endif
