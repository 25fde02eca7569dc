#ifndef WARP_VIEW_EDGES_H
#define WARP_VIEW_EDGES_H
/* Distances of a view's samples to its edges, shared by view_edges.cl and blend.cl; the definition of a step. */
#include "lib/lanes.h"

#define FEATHER 8          /* samples within which weights fade towards an edge */
#define STEPS 4            /* number by which a byte grows per sample of distance */
#define FAR_FROM_EDGES 33  /* 1 + STEPS * FEATHER */
#define DISTANCE_BITS 63   /* bits of a byte that store the distance; a sample's own byte also has these bits: */
#define LOWER_OPEN 64      /* the lower triangle of the sample's cell is open; next bit: the upper */
#define UPPER_OPEN 128
#define EDGE_DEVIATIONS 8.0f /* standard deviations of the noise: smaller differences of depth are no step */
#define STEEP 11.0f    /* slope of a surface at 5 degrees to its rays: a steeper one is a step */
#define STEP_MIN 0.01f /* fraction of the depth: smaller differences are no step */

/* unit: scene units; if above 0, it replaces z in the least step, as depths of orthographic views have no origin */
typedef struct {
    int width, height, pitch;
    int perspective;
    float density; /* fx * fy: pixels per square scene unit, at depth 1 (perspective) or at all depths (orthographic) */
    float noise_2, noise_1, noise_0;
    float unit;
} EdgeView;

/* The greatest difference in depth between neighbours that are no step. z: the nearer depth */
INLINED floatl step_allowed(EdgeView view, floatl z)
{
    const floatl noise = EDGE_DEVIATIONS * ((view.noise_2 * z + view.noise_1) * z + view.noise_0);
    const floatl sample = (view.perspective ? z : (floatl)1.0f) * rsqrt(view.density);
    const floatl least = STEP_MIN * (view.unit > 0.0f ? (floatl)view.unit : z);
    return max_lanes(noise, max_lanes(STEEP * sample, least));
}
#endif
