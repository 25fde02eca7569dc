#ifndef RELIEF_ENTRY_H
#define RELIEF_ENTRY_H
/* A relief, and the entry of a pixel's ray: the vertices' frames and quadrics there, and the ray in texture space
 * (Oliveira & Policarpo 2005, sections 3.3 and 3.4).
 *
 * faces: (triangles, 3) corners of each. projected: (vertices, 4), raster/project.cl. vertices: (vertices,
 * VERTEX_FLOATS) u, v, normal, gradient of u, gradient of v (world, per scene unit), a, b, c, depth, is sharp.
 * uv_bends: (vertices, VERTEX_FLOATS) a, b and c of u, and of v: what they are more than their gradients say. texels,
 * bounds, levels: search.h. points, neighbours: walk.h.
 *
 * With WITHIN the last triangle is a window right before the eye, which is below the mesh: it covers the whole picture,
 * and rays that enter there start at its vertices' depth, which is 0 at all others.
 */
#include "lib/texture.h"
#include "lib/vectors.h"
#include "raster/triangle.h"
#include "relief/search.h"

#define VERTEX_FLOATS 16 /* floats of a vertex, */
#define VERTEX_IS_SHARP 15 /* and which of them says that a triangle around it is turned far from its normal */

#define LINEAR 0
#define SAFE 1
#define FLAT_MAX 1e-5f       /* curvature times depth: a surface of less is taken for a plane */
#define ARC_PARTS 16         /* of a ray below the mesh, among whose ends its deepest point is searched */
#define DEEPEST_HALVINGS 8   /* of the interval in which a ray is deepest below circles */
#define BOTTOM_STEPS 8       /* towards where it reaches the bottom below circles */
#define CIRCLES_TOLERANCE 5e-3f /* of the depth: by what rays may be less deep below circles than by equation 7 */
#define COSINE_MIN 1e-3f     /* of a ray that enters: at outlines interpolated normals may point away from the viewer */

typedef struct {
    global const int *faces;
    global const float *projected, *vertices, *uv_bends, *points;
    global const int *neighbours;
    global const uint *texels;
    global const uint *bounds;
    global const int *levels;
    int level_count;
    Screen screen;
    float scale, pixel_size; /* scene units of depth 1, and of a pixel at distance 1 */
    int quadric, search, steps, halvings;
} Relief;

/* The vertices' values, interpolated where the rays of LANES pixels enter */
typedef struct {
    floatl u, v;
    Vector normal, along_u, along_v; /* the normal of unit length, and the gradients of u and v */
    floatl a, b, c;
    floatl is_sharp; /* > 0: a corner's normal is far from that of a triangle around it, as at creases */
#if BENT
    floatl bends_u[3], bends_v[3]; /* as a, b and c, of u and v */
#endif
#if WITHIN
    floatl depth;
#endif
} Entry;

#if WITHIN
#define ENTRY_DEPTH(e) ((e)->depth)
#else
#define ENTRY_DEPTH(e) 0.0f
#endif

INLINED Entry entry_of(const Relief *relief, intl index, floatl x, floatl y)
{
    const OnTriangle pixel = on_triangle(relief->faces, relief->projected, index, x, y);
    floatl of_vertex[VERTEX_FLOATS];
    corner_means(relief->vertices, &pixel, of_vertex);
    const Vector normal = {of_vertex[2], of_vertex[3], of_vertex[4]};
    const floatl unit = 1.0f / sqrt(max_lanes(DOT(normal, normal), (floatl)1e-20f));
    Entry e = {of_vertex[0], of_vertex[1], scaled(normal, unit), {of_vertex[5], of_vertex[6], of_vertex[7]},
               {of_vertex[8], of_vertex[9], of_vertex[10]}, of_vertex[11], of_vertex[12], of_vertex[13],
               of_vertex[VERTEX_IS_SHARP]};
#if WITHIN
    e.depth = of_vertex[14];
#endif
#if BENT
    corner_means(relief->uv_bends, &pixel, of_vertex);
    UNROLLED
    for (int k = 0; k < 3; k++) {
        e.bends_u[k] = of_vertex[k];
        e.bends_v[k] = of_vertex[3 + k];
    }
#endif
    return e;
}

/* x and y of the frame in which the quadric is z = a x^2 + b y^2 + c x y */
INLINED void tangents_of(const Entry *e, Vector *x, Vector *y)
{
    *x = normalized(e->along_u);
    *y = cross_product(e->normal, *x);
}

/* The quadric's bilinear form, of two directions; of one direction twice it is a x^2 + b y^2 + c x y. */
INLINED floatl quadric_form(const Entry *e, floatl x, floatl y, floatl other_x, floatl other_y)
{
    return e->a * x * other_x + e->b * y * other_y + 0.5f * e->c * (x * other_y + y * other_x);
}

#if BENT
INLINED floatl uv_form(const floatl *bends, floatl x, floatl y)
{
    return bends[0] * x * x + bends[1] * y * y + bends[2] * x * y;
}
#endif

/* The principal curvatures, and along them a ray's direction, which is (x, y) in the tangent plane; share: of the
 * curvatures, 0 to 1 */
INLINED PrincipalCurvatures curvatures_of(const Entry *e, floatl x, floatl y, float share)
{
    /* The quadric is l1 p^2 + l2 q^2 along its principal directions, l1 >= l2. */
    const floatl sum = share * (e->a + e->b), s_2 = x * x + y * y;
    const floatl curvature_difference = share * sqrt((e->a - e->b) * (e->a - e->b) + e->c * e->c); /* l1 - l2 */
    const floatl bend = share * quadric_form(e, x, y, x, y);
    const floatl first = (bend - 0.5f * (sum - curvature_difference) * s_2) /
                         max_lanes(curvature_difference, (floatl)1e-20f);
    const floatl w1 = clamp_lanes(first, (floatl)0.0f, s_2);
    const PrincipalCurvatures made = {-sum - curvature_difference, curvature_difference - sum, w1, s_2 - w1};
    return made;
}

/* The ray in texture space (section 3.4), but for its level and end */
void set_ray(ReliefRay *ray, const Entry *e, Vector d, int quadric, float scale)
{
    const float per_scale = 1.0f / scale;
    const floatl cosine = DOT(d, e->normal); /* < 0: it enters */
    ray->u = WRAPPED_UV(CLAMPED_U, e->u);
    ray->v = WRAPPED_UV(CLAMPED_V, e->v);
    ray->du = DOT(d, e->along_u);
    ray->dv = DOT(d, e->along_v);
    const Vector down = cross_product(e->normal, e->along_u);
    const floatl per_u = 1.0f / sqrt(max_lanes(DOT(e->along_u, e->along_u), (floatl)1e-30f));
    const floatl x = ray->du * per_u, y = DOT(d, down) * per_u; /* of the direction */
    ray->L = max_lanes(-cosine, (floatl)COSINE_MIN) * per_scale;
    const floatl bend = quadric ? quadric_form(e, x, y, x, y) : (floatl)0.0f;
    ray->K = bend * per_scale;
#if BENT
    ray->M = (floatl)0.0f;
    /* Below a surface that bends outwards u and v run faster, by as much as points on it are farther apart. */
    const floatl gv_x = DOT(e->along_v, e->along_u) * per_u, gv_y = DOT(e->along_v, down) * per_u;
    const floatl deeper = quadric ? 2.0f * cosine : (floatl)0.0f;
    ray->bend_u = deeper * quadric_form(e, 1.0f / per_u, 0.0f, x, y) + uv_form(e->bends_u, x, y);
    ray->bend_v = deeper * quadric_form(e, gv_x, gv_y, x, y) + uv_form(e->bends_v, x, y);
#endif
#if DISTANCE == PERPENDICULAR
    ray->vz = min_lanes(cosine, (floatl)-COSINE_MIN);
    ray->bend = bend;
    ray->scale = scale;
#endif
#if WITHIN
    const intl starts_below = e->depth > 0.0f;
    ray->depth = e->depth;
    ray->L = select_lanes(starts_below, -cosine * per_scale, ray->L);
#if BENT
    ray->bend_u = select_lanes(starts_below, (floatl)0.0f, ray->bend_u); /* gradients are those of the eye's depth */
    ray->bend_v = select_lanes(starts_below, (floatl)0.0f, ray->bend_v);
#endif
    use_quadric_depth(ray, starts_below);
#endif
}

/* Gives a ray whose point t after its entry is `depth` deep, where it is deepest, or reaches the bottom, the parabola
 * through both, which begins with `slope` where that is less steep; with BENT the cubic that begins with `slope` and
 * ends with another. Both rise all along. */
INLINED void bend_through(ReliefRay *ray, floatl t, floatl depth, floatl slope, floatl last_slope, intl which)
{
    const floatl mean = (depth - START_DEPTH(ray)) / t;
#if BENT
    /* A steeper one that is deepest at t would rise again behind that. */
    const floatl steepest = select_lanes(depth < 1.0f, 2.0f * mean, 3.0f * mean);
    const floatl rise = min_lanes(slope, steepest), last = clamp_lanes(last_slope, (floatl)0.0f, 3.0f * mean);
    ray->L = select_lanes(which, rise, ray->L);
    ray->K = select_lanes(which, (3.0f * mean - 2.0f * rise - last) / t, ray->K);
    ray->M = select_lanes(which, (rise + last - 2.0f * mean) / (t * t), ray->M);
    ray->bottom = select_lanes(which, select_lanes(depth >= 1.0f, t, (floatl)NEVER), ray->bottom);
#else
    const floatl rise = min_lanes(slope, 2.0f * mean);
    ray->L = select_lanes(which, rise, ray->L);
    ray->K = select_lanes(which, (mean - rise) / t, ray->K);
#endif
}

/* Far below a curved surface, rays are less deep than equation 7 says, which makes outlines, and the shadows that they
 * cast, too wide. Rays that are more than CIRCLES_TOLERANCE less deep by the circles of the principal curvatures (ray.h)
 * where equation 7 has them at the bottom, or deepest, are given another parabola: the one that reaches the bottom where
 * the ray does by circles, or is deepest where it is by circles, and as deep there. It is never deeper than by equation
 * 7, and right at the bottom and at outlines. enters: the rays that are asked for */
static void follow_circles(ReliefRay *ray, const Entry *e, Vector d, float scale, intl enters)
{
    const floatl L = ray->L, K = ray->K, cosine = L * scale, bend = -2.0f * K * scale;
    const floatl discriminant = L * L + 4.0f * K;
    const floatl at_quadric = select_lanes(discriminant >= 0.0f, 2.0f / (L + sqrt(max_lanes(discriminant, (floatl)0.0f))),
                                           -0.5f * L / K);
    Vector x_axis, y_axis;
    tangents_of(e, &x_axis, &y_axis);
    const PrincipalCurvatures c = curvatures_of(e, DOT(d, x_axis), DOT(d, y_axis), 1.0f);
    const floatl tolerance = CIRCLES_TOLERANCE * scale;
    const floatl off = beyond_quadric(&c, -cosine * at_quadric, at_quadric);
    const intl differs = enters & (off > tolerance);
    if (!any_lane(differs))
        return;
    /* The secant method, from where equation 7 reaches the bottom */
    floatl t = at_quadric, depth = 1.0f - off / scale, rise = L + K * t;
    intl reaches = differs & (discriminant >= 0.0f);
    for (int i = 0; i < BOTTOM_STEPS && any_lane(reaches & (depth < 1.0f - BOTTOM_TOLERANCE)); i++) {
        const floatl next = t + max_lanes(1.0f - depth, (floatl)0.0f) / rise;
        const floatl there = next * (L + K * next) - beyond_quadric(&c, -cosine * next, next) / scale;
        reaches = reaches & ((there > depth) | (depth >= 1.0f - BOTTOM_TOLERANCE));
        const intl steps = reaches & (depth < 1.0f - BOTTOM_TOLERANCE); /* shorter steps tell no slope */
        rise = select_lanes(steps & (next > t), (there - depth) / (next - t), rise);
        t = select_lanes(steps, next, t);
        depth = select_lanes(steps, there, depth);
    }
    reaches = reaches & (depth >= 1.0f - BOTTOM_TOLERANCE);
    const intl peaks = differs & !reaches & (bend * scale > FLAT_MAX) & (c.k2 > 0.0f);
    if (any_lane(peaks)) {
        /* Bisection finds where the derivative of the depth by circles is 0: after the ray is deepest below a sphere of
         * the greater curvature, and before it is by equation 7. up: 1 + k1 z of the ray's point; far: the same with z
         * raised by the first circle's part; around: 1 + k2 z with that z. */
        floatl before = cosine / c.k2, after = cosine / bend;
        for (int i = 0; i < DEEPEST_HALVINGS; i++) {
            const floatl middle = 0.5f * (before + after);
            const floatl up = 1.0f - c.k1 * cosine * middle, x_2 = c.w1 * middle * middle,
                         far = sqrt(up * up + c.k1 * c.k1 * x_2);
            const floatl around = 1.0f + c.k2 * (c.k1 * x_2 / (up + far) - cosine * middle);
            const intl dives = around * (cosine * up - c.k1 * c.w1 * middle) > c.k2 * c.w2 * middle * far;
            before = select_lanes(dives, middle, before);
            after = select_lanes(dives, after, middle);
        }
        const floatl deepest = 0.5f * (before + after);
        const floatl there = deepest * (L + K * deepest) - beyond_quadric(&c, -cosine * deepest, deepest) / scale;
        t = select_lanes(peaks, deepest, t);
        depth = select_lanes(peaks, there, depth);
    }
    const intl follows = reaches | (peaks & (depth > 0.0f) & (depth < 1.0f));
#if BENT
    const floatl steep = L;
#else
    const floatl steep = select_lanes(reaches, L, (floatl)INFINITY);
#endif
    bend_through(ray, t, select_lanes(reaches, max_lanes(depth, (floatl)(1.0f + BOTTOM_PRECISION)), depth), steep,
                 select_lanes(reaches, rise, (floatl)0.0f), follows);
}

/* A ray is below the mesh until it leaves that by a back, `distance` after its entry, where its depth falls by `slope`
 * per scene unit. Its depth between is estimated by the cubic with the depths and slopes of both ends. Returns where the
 * cubic first reaches the bottom, or else is deepest, in t, and how deep it is there. round: by what the depth below
 * circles is more than below parabolas */
INLINED floatl deepest_between(const ReliefRay *ray, floatl distance, floatl slope, floatl round, floatl *t,
                               floatl *last_slope)
{
    const floatl L = ray->L * round, leaves = max_lanes(slope, (floatl)0.0f) * round, start = START_DEPTH(ray);
    floatl depth = start, before = start;
    *t = *last_slope = 0.0f;
    for (int i = 1; i <= ARC_PARTS; i++) {
        const float part = (float)i / ARC_PARTS, rest = 1.0f - part;
        const float started = rest * rest * (1.0f + 2.0f * part); /* what is left of the depth at the start */
        const floatl now = distance * (part * rest) * (L * rest + leaves * part) + start * started;
        const intl rises = (depth < 1.0f) & (now > depth);
        const floatl reached = select_lanes(now > 1.0f, (1.0f - before) / (now - before), (floatl)1.0f);
        *t = select_lanes(rises, distance * (i - 1 + reached) * (1.0f / ARC_PARTS), *t);
        depth = select_lanes(rises, min_lanes(now, (floatl)1.0f), depth);
        *last_slope = select_lanes(rises & (now > 1.0f), (now - before) * ARC_PARTS / distance, *last_slope);
        before = now;
    }
    return depth;
}

/* An entry whose quadric has a share of its curvature */
INLINED Entry flattened(Entry e, floatl share)
{
    e.a *= share;
    e.b *= share;
    e.c *= share;
    return e;
}

intl is_finite_ray(const ReliefRay *ray)
{
#if BENT
    return isfinite_lanes(ray->u + ray->v + ray->du + ray->dv + ray->K + ray->bend_u + ray->bend_v);
#else
    return isfinite_lanes(ray->u + ray->v + ray->du + ray->dv + ray->K);
#endif
}

/* The square of the texels that a pixel covers along a side where it sees the surface straight on, `size` scene
 * units */
floatl texels_of(const Entry *e, int width, int height, floatl size, intl enters)
{
    const floatl u_2 = DOT(e->along_u, e->along_u);
    const floatl v_2 = DOT(e->along_v, e->along_v);
    const floatl texels_2 = max_lanes(u_2 * ((float)width * width), v_2 * ((float)height * height)) * size * size;
    return select_lanes(enters, texels_2, (floatl)1.0f);
}

/* The level of the heights whose texels are as large as such a pixel; on curved surfaces, where rays may come out
 * again, none whose heights are off by more than a pixel, which would move outlines */
intl level_of(const Relief *relief, const Entry *e, floatl size, intl enters)
{
    intl level = level_of_texels(texels_of(e, relief->levels[0], relief->levels[1], size, enters), relief->level_count);
    const intl is_curved = (fabs(e->a) + fabs(e->b) + fabs(e->c)) * (relief->quadric * relief->scale) > FLAT_MAX;
    for (int l = 1; l < relief->level_count && any_lane(level >= l); l++) {
        const float lost = relief->scale * (1.0f / 65535.0f) * relief->levels[l * LEVEL_INTS + HEIGHT_ERROR];
        level = select_lanes(is_curved & (size < lost), min(level, (intl)(l - 1)), level);
    }
    return level;
}

/* The scene units that a pixel takes at nearness n */
#define PIXEL_SIZE(relief, n)                                                                                  \
    (((relief)->screen.perspective ? 1.0f / (n) : (floatl)1.0f) * (relief)->pixel_size)

/* count: of searches, a constant, so that loops over them are unrolled */
INLINED void search_relief(const Relief *relief, Search *searches, int count)
{
    if (relief->search == SAFE)
        safe_search(searches, count, relief->texels, relief->bounds, relief->levels);
    else
        linear_search(searches, count, relief->texels, relief->steps, relief->halvings);
}
#endif
