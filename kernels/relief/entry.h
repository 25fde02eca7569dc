#ifndef RELIEF_ENTRY_H
#define RELIEF_ENTRY_H
/* A relief, and the entry of a pixel's ray: the interpolated frame and quadric there, and the ray in texture space
 * (Oliveira & Policarpo 2005, sections 3.3 and 3.4).
 *
 * faces: (triangles, 3) vertex indices. projected: (vertices, 4), raster/bins.cl. vertices: (vertices,
 * VERTEX_FLOATS) u, v, normal, gradient of u, gradient of v (world, per scene unit), a, b, c of the quadric. texels,
 * bounds, levels: search.h. prisms: walk.h.
 */
#include "lib/texture.h"
#include "lib/vectors.h"
#include "raster/triangle.h"
#include "relief/search.h"

#ifndef DEPTH_ALONE
#define DEPTH_ALONE 0 /* 1: no colours are needed, as in a light's map */
#endif

#define VERTEX_FLOATS 16 /* floats of a vertex */

#define LINEAR 0
#define SAFE 1
#define FLAT_MAX 1e-5f       /* curvature times the relief's depth: surfaces with less count as planes */
#define COSINE_MIN 1e-3f     /* least cosine between the ray and the normal: at outlines, normals may point away */

typedef struct {
    global const int *faces;
    global const float *projected, *vertices, *prisms;
    global const uint *texels;
    global const uint *bounds;
    global const int *levels;
    int level_count;
    Screen screen;
    float scale, pixel_size; /* depth of the bottom; size of a pixel at distance 1; scene units */
    int quadric, search, steps, halvings;
} Relief;

/* The vertices' values, interpolated at the entries of LANES pixels' rays */
typedef struct {
    floatl u, v;
    Vector normal, along_u, along_v; /* the normal of unit length, and the gradients of u and v */
    floatl a, b, c;
} Entry;

INLINED Entry entry_at(const Relief *relief, const OnTriangle *at)
{
    floatl of_vertex[VERTEX_FLOATS];
    corner_means(relief->vertices, at, of_vertex);
    const Vector normal = {of_vertex[2], of_vertex[3], of_vertex[4]};
    const Entry e = {of_vertex[0], of_vertex[1], normalized(normal), {of_vertex[5], of_vertex[6], of_vertex[7]},
                     {of_vertex[8], of_vertex[9], of_vertex[10]}, of_vertex[11], of_vertex[12], of_vertex[13]};
    return e;
}

INLINED Entry entry_of(const Relief *relief, intl index, floatl x, floatl y)
{
    const OnTriangle pixel = on_triangle(relief->faces, relief->projected, index, x, y);
    return entry_at(relief, &pixel);
}

/* The axes x and y of the frame in which the quadric is z = a x^2 + b y^2 + c x y */
INLINED void tangents_of(const Entry *e, Vector *x, Vector *y)
{
    *x = normalized(e->along_u);
    *y = cross_product(e->normal, *x);
}

/* The quadric's bilinear form of two directions; for equal directions, a x^2 + b y^2 + c x y. */
INLINED floatl quadric_form(const Entry *e, floatl x, floatl y, floatl other_x, floatl other_y)
{
    return e->a * x * other_x + e->b * y * other_y + 0.5f * e->c * (x * other_y + y * other_x);
}

/* Sets the ray in texture space (section 3.4), except its level and end. */
void set_ray(ReliefRay *ray, const Entry *e, Vector d, int quadric, float scale)
{
    const float per_scale = 1.0f / scale;
    const floatl cosine = DOT(d, e->normal); /* < 0: the ray enters */
    ray->u = WRAPPED_UV(CLAMPED_U, e->u);
    ray->v = WRAPPED_UV(CLAMPED_V, e->v);
    ray->du = DOT(d, e->along_u);
    ray->dv = DOT(d, e->along_v);
    const Vector down = cross_product(e->normal, e->along_u);
    const floatl per_u = 1.0f / sqrt(max_lanes(DOT(e->along_u, e->along_u), (floatl)1e-30f));
    const floatl x = ray->du * per_u, y = DOT(d, down) * per_u; /* components of d */
    ray->L = max_lanes(-cosine, (floatl)COSINE_MIN) * per_scale;
    const floatl bend = quadric ? quadric_form(e, x, y, x, y) : (floatl)0.0f;
    ray->K = bend * per_scale;
#if WALKS
    ray->depth = (floatl)0.0f;
#endif
#if DISTANCE == PERPENDICULAR
    ray->vz = min_lanes(cosine, (floatl)-COSINE_MIN);
    ray->bend = bend;
    ray->scale = scale;
#endif
}

/* An entry whose quadric keeps only the fraction `share` of its curvature */
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

/* The squared number of texels along a side of a pixel that is `size` scene units wide, as on a surface that faces the
 * camera; 1 where no ray enters */
floatl texels_of(const Entry *e, int width, int height, floatl size, intl enters)
{
    const floatl u_2 = DOT(e->along_u, e->along_u);
    const floatl v_2 = DOT(e->along_v, e->along_v);
    const floatl texels_2 = max_lanes(u_2 * ((float)width * width), v_2 * ((float)height * height)) * size * size;
    return select_lanes(enters, texels_2, (floatl)1.0f);
}

/* Limits the level from which heights are read. On curved surfaces, rays may come out again, so heights that are wrong
 * by more than a pixel's size would move outlines. */
INLINED intl finest_level(const Relief *relief, intl level, floatl size, intl is_curved)
{
    for (int l = 1; l < relief->level_count && any_lane(level >= l); l++) {
        const float lost = relief->scale * (1.0f / 65535.0f) * relief->levels[l * LEVEL_INTS + HEIGHT_ERROR];
        level = select_lanes(is_curved & (size < lost), min(level, (intl)(l - 1)), level);
    }
    return level;
}

/* The level whose texels are as large as a pixel of `size` scene units, or a finer level if `finest_level` gives one */
INLINED intl level_of(const Relief *relief, const Entry *e, floatl size, intl enters)
{
    const floatl texels_2 = texels_of(e, relief->levels[0], relief->levels[1], size, enters);
    const intl is_curved = (fabs(e->a) + fabs(e->b) + fabs(e->c)) * (relief->quadric * relief->scale) > FLAT_MAX;
    return finest_level(relief, level_of_texels(texels_2, relief->level_count), size, is_curved);
}

#define PIXEL_SIZE(relief, n)                                                                                  \
    (((relief)->screen.perspective ? 1.0f / (n) : (floatl)1.0f) * (relief)->pixel_size)

/* count: number of searches; a compile-time constant, so that loops are unrolled */
INLINED void search_relief(const Relief *relief, Search *searches, int count)
{
    if (relief->search == SAFE)
        safe_search(searches, count, relief->texels, relief->bounds, relief->levels);
    else
        linear_search(searches, count, relief->texels, relief->steps, relief->halvings);
}
#endif
