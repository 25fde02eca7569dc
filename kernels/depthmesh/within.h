#ifndef DEPTHMESH_WITHIN_H
#define DEPTHMESH_WITHIN_H
/* Samples of a row within one drawn triangle of the quadtree; drawn triangles extend to the edges of the image. */
#include "depthmesh/tree.h"

#define ON_EDGE 1e-3f /* samples: largest distance from an edge at which a sample counts as on the edge */

/* An edge of a triangle: it crosses row y at the column x + (y - low) * slope */
typedef struct {
    float x, slope, low, high;
} RowEdge;

/* A triangle. Its corners are the start of the longest side, the right angle and the end of the longest side: `corner`
 * holds their samples, `at` their drawn positions, `n` their nearness. Its plane has the nearness
 * n[1] + (x - at[1].x) * per_x + (y - at[1].y) * per_y. */
typedef struct {
    int2 corner[3], low, high; /* low, high: least and greatest coordinates of the corners */
    float2 at[3];
    float n[3], per_x, per_y;
    RowEdge edges[3];
} Within;

RowEdge row_edge(float2 a, float2 b)
{
    const float2 upper = a.y < b.y ? a : b, lower = a.y < b.y ? b : a;
    const RowEdge edge = {upper.x, (lower.x - upper.x) / (lower.y - upper.y), upper.y,
                          upper.y == lower.y ? -INFINITY : lower.y};
    return edge;
}

/* Widens a range of columns up to the point where the row crosses the edge. */
void widen_to_edge(RowEdge edge, float row, float2 *part)
{
    if (row < edge.low || row > edge.high)
        return;
    const float x = edge.x + (row - edge.low) * edge.slope;
    part->x = fmin(part->x, x);
    part->y = fmax(part->y, x);
}

/* The sample on which a vertex lies */
int2 sample_of(const Layout *layout, int2 v)
{
    return min(v, (int2)(layout->width - 1, layout->height - 1));
}

/* Fills in the triangle on side b (0: A, 1: B) of the vertex (x, y) of step s. Returns whether it has an area. */
int triangle_within(const Layout *layout, global const float *placed, int x, int y, int s, int b, Within *t)
{
    const int centers = IS_CENTER(x, y, s), across = (x & s) != 0, rises = centers && !IS_MAIN(x, y, s);
    const int2 p = (int2)(x, y), along = centers ? (int2)(s, rises ? -s : s) : across ? (int2)(s, 0) : (int2)(0, s);
    const int2 to_a = centers ? (int2)(rises ? -s : s, -s) : across ? (int2)(0, -s) : (int2)(-s, 0);
    const int2 corner[3] = {p - along, b ? p - to_a : p + to_a, p + along};
    if (any(corner[1] < 0) || any(corner[1] > layout->side))
        return 0;
    for (int k = 0; k < 3; k++) {
        const int2 v = sample_of(layout, corner[k]);
        t->corner[k] = v;
        t->at[k] = (float2)(place_of(v.x, layout->width), place_of(v.y, layout->height));
        t->n[k] = placed[v.y * layout->pitch + v.x];
    }
    t->low = min(t->corner[1], min(t->corner[0], t->corner[2]));
    t->high = max(t->corner[1], max(t->corner[0], t->corner[2]));
    const float2 u = t->at[0] - t->at[1], v = t->at[2] - t->at[1];
    const float area = u.x * v.y - u.y * v.x, inverse = 1.0f / area;
    t->per_x = ((t->n[0] - t->n[1]) * v.y - (t->n[2] - t->n[1]) * u.y) * inverse;
    t->per_y = ((t->n[2] - t->n[1]) * u.x - (t->n[0] - t->n[1]) * v.x) * inverse;
    for (int k = 0; k < 3; k++)
        t->edges[k] = row_edge(t->at[k], t->at[(k + 1) % 3]);
    return area != 0.0f;
}

/* First and last column of the triangle's samples in a row; the first exceeds the last if there are none */
int2 columns_within(const Within *t, int row)
{
    float2 part = (float2)(INFINITY, -INFINITY);
    for (int k = 0; k < 3; k++)
        widen_to_edge(t->edges[k], row, &part);
    return (int2)(max((int)ceil(part.x - ON_EDGE), t->low.x), min((int)floor(part.y + ON_EDGE), t->high.x));
}

INLINED floatl plane_nearness(const Within *t, intl x, int row)
{
    return t->n[1] + (row - t->at[1].y) * t->per_y + (to_floatl(x) - t->at[1].x) * t->per_x;
}
#endif
