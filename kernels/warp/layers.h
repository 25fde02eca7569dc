#ifndef WARP_LAYERS_H
#define WARP_LAYERS_H
/* Layers, the pictures of single views, in the memory of blend.cl; their sums, and parameters of their views. */
#include "lib/channel.h"
#include "lib/gbuffer.h"
#include "lib/lanes.h"

#ifndef ORIGINS
#define ORIGINS 0 /* 1: keeps the origins of the layer of the greatest weight, too */
#endif
#define TOLERANCE_MIN 0.02f   /* fraction of the depth: layers that differ by less show one surface */
#define LAYER_DEVIATIONS 4.0f /* standard deviations of the noise that explain a difference */

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

#define MEANS 1 /* means of red, green, blue, depth */
#define GREATEST 5
#define ORIGIN_SUMS 4
#define NORMAL_MEANS (GREATEST + ORIGIN_SUMS * ORIGINS)
#define SUMS (NORMAL_MEANS + NORMAL_PLANES * (GBUFFER == 2))

/* The view of a layer. density: pixels per square scene unit, at depth 1 in perspective views, at every depth in
 * orthographic ones */
typedef struct {
    float forward[3], centre[3]; /* relative to the screen's origin */
    float density;               /* fx * fy */
    int perspective;
    int low_x, high_x, low_y, high_y; /* pixels that the view may reach */
} LayerView;

/* Parameters of a layer's view in the blend: gains of its colours; noise at depth z, whose standard deviation is
 * noise_2 z z + noise_1 z + noise_0; the view's number. */
typedef struct {
    float red, green, blue;
    float noise_2, noise_1, noise_0;
    int number;
} BlendedView;

/* The depth by which a layer may be off. unit: replaces z in the least tolerance if depths have no origin; else 0 */
INLINED floatl depth_tolerance(BlendedView view, float unit, floatl z)
{
    const floatl noise = LAYER_DEVIATIONS * ((view.noise_2 * z + view.noise_1) * z + view.noise_0);
    return max_lanes(noise, unit > 0.0f ? (floatl)(TOLERANCE_MIN * unit) : TOLERANCE_MIN * z);
}
#endif
