#ifndef RASTER_TRIANGLE_H
#define RASTER_TRIANGLE_H
/* Triangles in homogeneous pixel space (Olano & Greer 1997). They need no clipping, because an edge function is
 * positive on the visible side only, even where a corner lies behind the camera. LANES triangles are set up together.
 *
 * Edge functions are computed in whole numbers, from corners that are moved to the nearest 1/256 of a pixel, or in
 * floating point for edges with a corner behind the camera or far away. Either way, two triangles that share an edge
 * have exactly opposite functions, and the top-left rule gives the pixels on the edge to one of them.
 */
#include "lib/screen.h"
#include "raster/region.h"

/* Values of `culled`: the sign of the area of triangles that are not drawn. Seen from behind, areas are positive. */
#define CULLS_NONE 0
#define CULLS_BACKS 1
#define CULLS_FRONTS -1

#define SUBPIXELS 256
#define FARTHEST_CORNER 16384.0f /* pixels from the region: for farther corners, whole numbers of 32 bits overflow */
#define CORNER_ROUNDING 0.01f    /* pixels by which a moved corner may leave the triangle's box */

/* LANES edge functions a x + b y + c, positive inside */
typedef struct {
    floatl a, b, c;
} Edges;

/* The same in whole numbers: 0 or more at the pixels inside, the top-left rule included */
typedef struct {
    intl a, b, c;
} ExactEdges;

typedef struct {
    Edges edges[3]; /* edge k is opposite to corner k */
    ExactEdges exact_edges[3];
    intl exact;            /* bit k: edge k uses its exact function */
    floatl n_x, n_y, n_0;  /* nearness: n_x x + n_y y + n_0 */
    floatl n_low, n_high;  /* least and greatest nearness of the corners */
    intl index, low_x, high_x, low_y, high_y; /* the triangle; its box of pixels in the region */
} Triangles;

/* Top-left rule: does a triangle own the pixels on its edge with the function a x + b y + c? */
#define IS_TOP_LEFT(a, b) (((a) > 0) | (((a) == 0) & ((b) > 0)))

/* Functions of the edges from corner i to corner j: exactly the opposite of the functions from j to i */
INLINED Edges edges_of(const floatl *U, const floatl *V, const floatl *W, int i, int j)
{
#pragma OPENCL FP_CONTRACT OFF /* contraction would round only one of two products */
    const Edges e = {V[i] * W[j] - W[i] * V[j], W[i] * U[j] - U[i] * W[j], U[i] * V[j] - V[i] * U[j]};
    return e;
}

/* Functions of the edges from p to q (1/256 of a pixel), the top-left rule included. turned: 1, or -1 for triangles
 * whose functions would be negative inside */
INLINED ExactEdges exact_edges_of(intl px, intl py, intl qx, intl qy, intl turned)
{
    ExactEdges e;
    e.a = turned * (py - qy);
    e.b = turned * (qx - px);
    const longl at_p = to_longl(e.a) * to_longl(px) + to_longl(e.b) * to_longl(py);
    const longl c = -at_p - to_longl(select_lanes(IS_TOP_LEFT(e.a, e.b), (intl)0, (intl)1));
    e.c = to_intl(clamp(c >> 8, (longl)(-(1L << 29)), (longl)(1L << 29))); /* unit: 1/256 of a squared pixel */
    return e;
}

/* Sets up the triangles `index`; corners: (triangles, 3) indices in `projected`; x, y: the region's first pixel.
 * Returns which triangles may be visible. */
INLINED intl set_up_triangles(global const int *corners, global const float *projected, intl index, float nearest_w, int culled,
                      int x, int y, Triangles *t)
{
    floatl U[3], V[3], W[3], Q[3], at_x[3], at_y[3];
    intl px[3], py[3], close[3]; /* corner k is in front of the camera and not far away */
    intl crosses = 0;
    UNROLLED
    for (int k = 0; k < 3; k++) {
        const intl face = 3 * index + k, corner = (intl)(gather(corners, face));
        floatl at[4];
        gather_rows(projected, corner, at);
        W[k] = at[2];
        Q[k] = at[3];
        U[k] = at[0] - x * W[k]; /* pixels relative to the region's first pixel */
        V[k] = at[1] - y * W[k];
        at_x[k] = U[k] / W[k];
        at_y[k] = V[k] / W[k];
        const intl is_before = W[k] >= nearest_w;
        close[k] = is_before & (fabs(at_x[k]) < FARTHEST_CORNER) & (fabs(at_y[k]) < FARTHEST_CORNER);
        px[k] = to_intl(floor_lanes(select_lanes(close[k], at_x[k] * SUBPIXELS + 0.5f, (floatl)0.0f)));
        py[k] = to_intl(floor_lanes(select_lanes(close[k], at_y[k] * SUBPIXELS + 0.5f, (floatl)0.0f)));
        crosses = crosses | !is_before;
    }
    const float end = REGION - 1;
    const floatl low_x = min_lanes(at_x[0], min_lanes(at_x[1], at_x[2])),
                 high_x = max_lanes(at_x[0], max_lanes(at_x[1], at_x[2]));
    const floatl low_y = min_lanes(at_y[0], min_lanes(at_y[1], at_y[2])),
                 high_y = max_lanes(at_y[0], max_lanes(at_y[1], at_y[2]));
    t->low_x = to_intl(ceil_lanes(
        select_lanes(crosses, (floatl)0.0f, clamp_lanes(low_x - CORNER_ROUNDING, (floatl)0.0f, (floatl)REGION))));
    t->low_y = to_intl(ceil_lanes(
        select_lanes(crosses, (floatl)0.0f, clamp_lanes(low_y - CORNER_ROUNDING, (floatl)0.0f, (floatl)REGION))));
    t->high_x = to_intl(floor_lanes(select_lanes(
        crosses, (floatl)end, max_lanes(min_lanes(high_x + CORNER_ROUNDING, (floatl)end), (floatl)-1.0f))));
    t->high_y = to_intl(floor_lanes(select_lanes(
        crosses, (floatl)end, max_lanes(min_lanes(high_y + CORNER_ROUNDING, (floatl)end), (floatl)-1.0f))));
    intl seen = (t->low_x <= t->high_x) & (t->low_y <= t->high_y);
    if (!any_lane(seen))
        return seen;

    UNROLLED
    for (int k = 0; k < 3; k++)
        t->edges[k] = edges_of(U, V, W, (k + 1) % 3, (k + 2) % 3);
    const floatl determinant = t->edges[0].a * U[0] + t->edges[0].b * V[0] + t->edges[0].c * W[0];
    const intl all_close = close[0] & close[1] & close[2];
    const longl area = to_longl(px[1] - px[0]) * to_longl(py[2] - py[0]) -
                       to_longl(py[1] - py[0]) * to_longl(px[2] - px[0]);
    const intl area_sign = select_lanes(to_intl(area > 0L), (intl)1,
                                        select_lanes(to_intl(area < 0L), (intl)-1, (intl)0));
    const floatl turns = select_lanes(all_close, to_floatl(area_sign), determinant); /* > 0: seen from behind */
    seen = seen & (determinant != 0.0f) & isfinite_lanes(determinant) & (turns != 0.0f) & (turns * culled <= 0.0f);
    const intl turned = select_lanes(turns > 0.0f, (intl)1, (intl)-1);
    t->exact = 0;
    UNROLLED
    for (int k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        t->exact |= select_lanes(close[i] & close[j], (intl)(1 << k), (intl)0);
        t->exact_edges[k] = exact_edges_of(px[i], py[i], px[j], py[j], turned);
    }
    /* The plane's values are computed relative to a corner's nearness: they are small, and so are their errors. */
    const floatl middle = select_lanes(crosses, (floatl)0.0f, Q[0] / W[0]);
    const floatl sign = select_lanes(determinant < 0.0f, (floatl)-1.0f, (floatl)1.0f);
    t->n_x = t->n_y = t->n_0 = 0.0f;
    t->n_low = select_lanes(crosses, (floatl)-INFINITY, (floatl)INFINITY);
    t->n_high = -t->n_low;
    UNROLLED
    for (int k = 0; k < 3; k++) {
        const floatl differs = Q[k] - middle * W[k], n = Q[k] / W[k];
        t->edges[k].a *= sign;
        t->edges[k].b *= sign;
        t->edges[k].c *= sign;
        t->n_x += t->edges[k].a * differs;
        t->n_y += t->edges[k].b * differs;
        t->n_0 += t->edges[k].c * differs;
        t->n_low = select_lanes(!crosses & (n < t->n_low), n, t->n_low);
        t->n_high = select_lanes(!crosses & (n > t->n_high), n, t->n_high);
    }
    const floatl inverse = 1.0f / fabs(determinant);
    t->n_x *= inverse;
    t->n_y *= inverse;
    t->n_0 = t->n_0 * inverse + middle;
    t->index = index;
    return seen;
}

/* Returns which pixels of the block at (first_x, first_y) a lane's triangle covers. Sets their nearness. */
INLINED intl covered_by(const Triangles *t, int lane, int first_x, int first_y, floatl *nearness)
{
    const intl xi = first_x + block_x, yi = first_y + block_y;
    const floatl x = to_floatl(xi), y = to_floatl(yi);
    const int exact = int_lane(t->exact, lane);
    intl covered = lane_index >= 0;
    UNROLLED
    for (int k = 0; k < 3; k++) {
        if (exact >> k & 1) {
            const ExactEdges *e = &t->exact_edges[k];
            covered = covered & (int_lane(e->a, lane) * xi + (int_lane(e->b, lane) * yi + int_lane(e->c, lane)) >= 0);
        } else {
            const Edges *e = &t->edges[k];
            const float a = float_lane(e->a, lane), b = float_lane(e->b, lane);
            const floatl inside = a * x + (b * y + float_lane(e->c, lane));
            covered = covered & (IS_TOP_LEFT(a, b) ? inside >= 0.0f : inside > 0.0f);
        }
    }
    /* A triangle with moved corners may cover a pixel outside the original one, where a steep plane leaves the corners'
     * range of nearness: so nearness is clamped. */
    const floatl plane = float_lane(t->n_x, lane) * x + (float_lane(t->n_y, lane) * y + float_lane(t->n_0, lane));
    *nearness = clamp_lanes(plane, (floatl)float_lane(t->n_low, lane), (floatl)float_lane(t->n_high, lane));
    return covered;
}

/* Pixels' positions on triangles: the triangles' corners and the corners' perspective-correct weights. */
typedef struct {
    intl corner[3];
    floatl weight[3];
    floatl U[3], V[3], W[3]; /* homogeneous corners, with the pixel as origin */
    floatl area; /* twice the triangle's area, as seen: > 0 from behind */
    int uniform; /* all lanes are on one triangle */
} OnTriangle;

/* The positions of the picture's pixels (x, y) on triangles */
INLINED OnTriangle on_triangle(global const int *corners, global const float *projected, intl index, floatl x, floatl y)
{
    OnTriangle p;
    floatl sum = 0.0f;
    const int one = int_lane(index, 0);
    p.uniform = !any_lane(index != one);
    UNROLLED
    for (int k = 0; k < 3; k++) { /* with the pixel as origin, an edge function's value there is its c */
        if (p.uniform) {
            const int corner = corners[3 * one + k];
            const float4 at = vload4(corner, projected);
            p.corner[k] = corner;
            p.W[k] = at.z;
            p.U[k] = at.x - at.z * x;
            p.V[k] = at.y - at.z * y;
        } else {
            const intl face = 3 * index + k;
            p.corner[k] = (intl)(gather(corners, face));
            floatl at[4];
            gather_rows(projected, p.corner[k], at);
            p.W[k] = at[2];
            p.U[k] = at[0] - p.W[k] * x;
            p.V[k] = at[1] - p.W[k] * y;
        }
    }
    p.area = 0.0f;
    UNROLLED
    for (int k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        p.weight[k] = p.U[i] * p.V[j] - p.V[i] * p.U[j];
        p.area += p.weight[k];
    }
    const floatl sign = select_lanes(p.area < 0.0f, (floatl)-1.0f, (floatl)1.0f);
    UNROLLED
    for (int k = 0; k < 3; k++) { /* clamped to the triangle, as in `covered_by` */
        p.weight[k] = max_lanes(p.weight[k] * sign, (floatl)0.0f);
        sum += p.weight[k];
    }
    const floatl inverse = 1.0f / sum;
    UNROLLED
    for (int k = 0; k < 3; k++)
        p.weight[k] *= inverse;
    return p;
}

/* Weighted means of the corners' values; rows: (vertices, 16) */
INLINED void corner_means(global const float *rows, const OnTriangle *p, floatl *means)
{
#if LANES == 16
    if (p->uniform) {
        const float16 a = vload16(int_lane(p->corner[0], 0), rows), b = vload16(int_lane(p->corner[1], 0), rows),
                      c = vload16(int_lane(p->corner[2], 0), rows);
        UNROLLED
        for (int part = 0; part < 16; part++)
            means[part] = p->weight[0] * float_lane(a, part) + p->weight[1] * float_lane(b, part) +
                          p->weight[2] * float_lane(c, part);
        return;
    }
    UNROLLED
    for (int lane = 0; lane < LANES; lane++)
        means[lane] = float_lane(p->weight[0], lane) * vload16(int_lane(p->corner[0], lane), rows) +
                      float_lane(p->weight[1], lane) * vload16(int_lane(p->corner[1], lane), rows) +
                      float_lane(p->weight[2], lane) * vload16(int_lane(p->corner[2], lane), rows);
    transpose(means);
#else
    UNROLLED
    for (int part = 0; part < 16; part++)
        means[part] = p->weight[0] * rows[16 * p->corner[0] + part] + p->weight[1] * rows[16 * p->corner[1] + part] +
                      p->weight[2] * rows[16 * p->corner[2] + part];
#endif
}
#endif
