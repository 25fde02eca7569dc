#ifndef RELIEF_ENTRY_H
#define RELIEF_ENTRY_H
/* A relief, and the entry of a pixel's ray: the vertices' frames and quadrics there, and the ray in texture space
 * (Oliveira & Policarpo 2005, sections 3.3 and 3.4).
 *
 * faces: (triangles, 3) corners of each. projected: (vertices, 4), raster/project.cl. vertices: (vertices,
 * VERTEX_FLOATS) u, v, normal, gradient of u, gradient of v (world, per scene unit), a, b, c, depth, unused. texels,
 * bounds, levels: search.h.
 *
 * With WITHIN the last triangle is a window right before the eye, which is below the mesh: it covers the whole picture,
 * and rays that enter there start at its vertices' depth, which is 0 at all others.
 */
#include "lib/texture.h"
#include "lib/vectors.h"
#include "raster/triangle.h"
#include "relief/search.h"

#define VERTEX_FLOATS 16 /* floats of a vertex */

#define LINEAR 0
#define SAFE 1
#define FLAT_MAX 1e-5f       /* curvature times depth: a surface of less is taken for a plane */
#define ARC_PARTS 16         /* of a ray below the mesh, among whose ends its deepest point is searched */
#define DEEPEST_HALVINGS 8   /* of the interval in which a light's ray is deepest */
#define COSINE_MIN 1e-3f     /* of a ray that enters: at outlines interpolated normals may point away from the viewer */

typedef struct {
    global const int *faces;
    global const float *projected, *vertices;
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
               {of_vertex[8], of_vertex[9], of_vertex[10]}, of_vertex[11], of_vertex[12], of_vertex[13]};
#if WITHIN
    e.depth = of_vertex[14];
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
#if DISTANCE != APPROXIMATE
    ray->vz = min_lanes(cosine, (floatl)-COSINE_MIN);
#endif
#if DISTANCE == EXACT
    ray->per_scale = per_scale;
    ray->curvatures = curvatures_of(e, x, y, quadric ? 1.0f : 0.0f);
#elif DISTANCE == PERPENDICULAR
    ray->bend = bend;
    ray->scale = scale;
#endif
#if WITHIN
    const intl starts_below = e->depth > 0.0f;
    ray->depth = e->depth;
    ray->L = select_lanes(starts_below, -cosine * per_scale, ray->L);
    use_quadric_depth(ray, starts_below);
#endif
}

/* Far below a curved surface, rays are less deep than equation 7 says, which makes outlines, and the shadows that they
 * cast, too wide. A light's ray that reaches the bottom by equation 7, but not by the circles of EXACT (ray.h), is
 * given another parabola: the one that is deepest where the ray is deepest by circles, and as deep there. Below a
 * sphere of the greater curvature no ray is deeper than below the circles, so rays that reach the bottom even there
 * stay as they are. enters: the rays that are asked for */
void follow_circles(ReliefRay *ray, const Entry *e, Vector d, float scale, intl enters)
{
    const floatl cosine = ray->L * scale, bend = -2.0f * ray->K * scale;
    const floatl curvature = fabs(e->a - e->b) + fabs(e->c) - (e->a + e->b); /* no less than the greater one */
    const floatl part = min_lanes(scale * curvature, (floatl)1.0f);
    const floatl steep = part * (2.0f - part); /* squared cosine from which on rays reach the bottom below the sphere */
    const intl reaches = ray->L * ray->L + 4.0f * ray->K >= 0.0f;
    const intl grazes = enters & reaches & (bend * scale > FLAT_MAX) & (cosine * cosine < steep);
    if (!any_lane(grazes))
        return;
    Vector x_axis, y_axis;
    tangents_of(e, &x_axis, &y_axis);
    const PrincipalCurvatures c = curvatures_of(e, DOT(d, x_axis), DOT(d, y_axis), 1.0f);
    /* Bisection finds where the derivative of the depth by circles is 0: after the ray is deepest below that sphere,
     * and before it is by equation 7. up: 1 + k1 z of the ray's point; far: the same with z raised by the first
     * circle's part; around: 1 + k2 z with that z. */
    floatl before = cosine / c.k2, after = cosine / bend;
    for (int i = 0; i < DEEPEST_HALVINGS; i++) {
        const floatl t = 0.5f * (before + after);
        const floatl up = 1.0f - c.k1 * cosine * t, x_2 = c.w1 * t * t, far = sqrt(up * up + c.k1 * c.k1 * x_2);
        const floatl around = 1.0f + c.k2 * (c.k1 * x_2 / (up + far) - cosine * t);
        const intl dives = around * (cosine * up - c.k1 * c.w1 * t) > c.k2 * c.w2 * t * far;
        before = select_lanes(dives, t, before);
        after = select_lanes(dives, after, t);
    }
    const floatl t = 0.5f * (before + after);
    const floatl depth = (t * (cosine - 0.5f * bend * t) - beyond_quadric(&c, -cosine * t, t)) / scale;
    const intl comes_out = grazes & (depth > 0.0f) & (depth < 1.0f);
    ray->L = select_lanes(comes_out, 2.0f * depth / t, ray->L);
    ray->K = select_lanes(comes_out, -depth / (t * t), ray->K);
}

/* A ray that has escaped, having come out by its quadric, is still below the mesh until it leaves that by a back,
 * `distance` after its entry, where its depth falls by `slope` per scene unit. Its depth between is estimated by the
 * cubic with the depths and slopes of both ends. If where the cubic first reaches the bottom, or else is deepest, it is
 * deeper than the quadric says, the mesh is less curved than its quadric: then the ray gets the parabola through its
 * entry and that point, no steeper at the entry than before. Returns which rays do; share: of the quadric's curvature
 * that is left. */
intl follow_mesh(ReliefRay *ray, floatl distance, floatl slope, floatl *share)
{
    const floatl L = ray->L, leaves = max_lanes(slope, (floatl)0.0f), start = START_DEPTH(ray);
    floatl t = 0.0f, depth = start, before = start;
    for (int i = 1; i <= ARC_PARTS; i++) {
        const float part = (float)i / ARC_PARTS, rest = 1.0f - part;
        const float started = rest * rest * (1.0f + 2.0f * part); /* what is left of the depth at the start */
        const floatl now = distance * (part * rest) * (L * rest + leaves * part) + start * started;
        const intl rises = (depth < 1.0f) & (now > depth);
        const floatl reached = select_lanes(now > 1.0f, (1.0f - before) / (now - before), (floatl)1.0f);
        t = select_lanes(rises, distance * (i - 1 + reached) * (1.0f / ARC_PARTS), t);
        depth = select_lanes(rises, min_lanes(now, (floatl)1.0f), depth);
        before = now;
    }
    const intl deeper = (t > 0.0f) & (depth > depth_of(ray, t));
    depth *= 1.0f + BOTTOM_TOLERANCE;
    const floatl mean = (depth - start) / t, rise = min_lanes(L, 2.0f * mean), K = (mean - rise) / t;
    *share = select_lanes(deeper & (ray->K < K), max_lanes(K / ray->K, (floatl)0.0f), (floatl)1.0f);
    ray->L = select_lanes(deeper, rise, L);
    ray->K = select_lanes(deeper, K, ray->K);
    use_quadric_depth(ray, deeper);
    return deeper;
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
    return isfinite_lanes(ray->u + ray->v + ray->du + ray->dv + ray->K);
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
