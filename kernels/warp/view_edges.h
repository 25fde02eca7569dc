#ifndef WARP_VIEW_EDGES_H
#define WARP_VIEW_EDGES_H
/* Distances of a view's samples to its edges, as view_edges.cl writes them and blend.cl reads them. */
#define FEATHER 8          /* samples within which weights fade towards an edge */
#define STEPS 4            /* of a byte, a sample of distance */
#define FAR_FROM_EDGES 33  /* 1 + STEPS * FEATHER */
#define DISTANCE_BITS 63   /* of a sample's byte; further bits of the upper one: */
#define LOWER_OPEN 64      /* the triangles of the sample's cell are open */
#define UPPER_OPEN 128
#define EDGE_DEVIATIONS 8.0f /* of the noise, that explain a step between neighbours */
#endif
