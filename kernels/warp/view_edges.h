#ifndef WARP_VIEW_EDGES_H
#define WARP_VIEW_EDGES_H
/* Distances of a view's samples to its edges, as view_edges.cl writes them and blend.cl reads them; what a step is. */
#include "lib/lanes.h"

#define FEATHER 8          /* samples within which weights fade towards an edge */
#define STEPS 4            /* of a byte, a sample of distance */
#define FAR_FROM_EDGES 33  /* 1 + STEPS * FEATHER */
#define DISTANCE_BITS 63   /* of a sample's byte; further bits of the upper one: */
#define LOWER_OPEN 64      /* the triangles of the sample's cell are open */
#define UPPER_OPEN 128
#define EDGE_DEVIATIONS 8.0f /* of the noise, that explain a step between neighbours */
#define STEEP 11.0f    /* a surface at less than 5 degrees to its rays goes so many times as far back as aside */
#define STEP_MIN 0.01f /* of the depth: less is no step */

/* unit: a depth, where the view's have no origin; else 0 */
typedef struct {
    int width, height, pitch;
    int perspective;
    float density; /* pixels a unit of what is at depth 1 (perspective) or anywhere, along both axes: fx * fy */
    float noise_2, noise_1, noise_0;
    float unit;
} EdgeView;

/* By how much neighbours' depths differ on one surface, the nearer one's being z */
INLINED floatl step_allowed(EdgeView view, floatl z)
{
    const floatl noise = EDGE_DEVIATIONS * ((view.noise_2 * z + view.noise_1) * z + view.noise_0);
    const floatl sample = (view.perspective ? z : (floatl)1.0f) * rsqrt(view.density);
    const floatl least = STEP_MIN * (view.unit > 0.0f ? (floatl)view.unit : z);
    return max_lanes(noise, max_lanes(STEEP * sample, least));
}
#endif
