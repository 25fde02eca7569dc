#ifndef SLICING_TETRAHEDRA_H
#define SLICING_TETRAHEDRA_H
/* Tetrahedra of a displacement volume, set up for a region of pixels (Kautz & Seidel 2001, section 3).
 *
 * All that the loops of surface.cl need of a tetrahedron is affine over the picture: where rays enter and leave it, u,
 * v and height along them, and the number of the slice. For each triangle one of the slicing directions is chosen here
 * (section 3.2). Arrays: surface.cl.
 */
#include "raster/fragment.h"
#include "slicing/rays.h"

#define SURFACE 0
#define ORTHOGONAL 1
#define SCREEN 2
#define SIDE_MARGIN 1e-5f /* of a tetrahedron, by which its sides are moved outwards */
#define HEIGHT_ROUNDING 1e-5f /* of the displacement: what lies no higher is on the base */
#define ROUNDING_ULPS 8.0f /* the least parts of a float that heights err by, where a displacement is next to nothing */
#define SLICE_ROUNDING 1e-4f /* slices: rounding of where a ray enters and leaves a tetrahedron */

typedef struct {
    global const int *corners;
    global const float *projected, *points, *places, *frames;
    global const uint *heights;
    global const float *gradients;
    Screen screen;
    float nearest_w, spacing;
    float pixel; /* scene units of a pixel at depth 1; 0: slices are the same in all pictures */
    float band;  /* of heights that BAND takes; 0: that of a slice */
    int slices, slicing, test, halvings, map_width, map_height;
    global int *counters;
} Context;

/* A quantity that is affine in the picture's pixel space: x px + y py + one + n times the nearness. So along a ray it
 * is linear in depth (`Linear`); in a perspective picture its `fixed` is the same for all pixels, in an orthographic
 * one its `sloped`. */
typedef struct {
    float x, y, one, n;
} Quantity;

typedef struct {
    Quantity rows[4];  /* barycentric coordinates: >= 0 inside */
    Quantity sides[4]; /* per pixel, the nearness at which the ray crosses each side, */
    int leaves[4];     /* and whether it leaves there, on its way to the camera */
    Quantity outline[4]; /* positive at a block's first pixel if the tetrahedron may be seen in it */
    int outlines;
    Quantity u, v, h, slice;
    float nearest, front, rear; /* nearness: of the screen, of the corners */
    float first, last;          /* a little farther and nearer than the corners */
    int index, perspective, crosses; /* the near plane */
    float spacing, band; /* of its slices, and of heights that the test BAND takes */
    float height_rounding; /* HEIGHT_ROUNDING, more where the displacement is shallow; */
    float slice_rounding;  /* and SLICE_ROUNDING */
    int halvings; /* of the interval between two slices */
} Tetrahedron;

typedef struct {
    Tetrahedron of[LANES];
    intl low_x, high_x, low_y, high_y;
} Primitives;

/* Rows of the inverse of the matrix whose columns are the corners: barycentric coordinates. 0 if it is flat. */
int barycentric_rows(const float4 *p, Quantity *rows)
{
    float determinant = 0.0f;
    for (int k = 0; k < 4; k++) {
        const float4 a = p[(k + 1) & 3], b = p[(k + 2) & 3], c = p[(k + 3) & 3];
        const float bc_zw = b.z * c.w - b.w * c.z, bc_yw = b.y * c.w - b.w * c.y, bc_yz = b.y * c.z - b.z * c.y;
        const float bc_xw = b.x * c.w - b.w * c.x, bc_xz = b.x * c.z - b.z * c.x, bc_xy = b.x * c.y - b.y * c.x;
        const float sign = k & 1 ? -1.0f : 1.0f;
        rows[k].x = sign * (a.y * bc_zw - a.z * bc_yw + a.w * bc_yz);
        rows[k].y = -sign * (a.x * bc_zw - a.z * bc_xw + a.w * bc_xz);
        rows[k].one = sign * (a.x * bc_yw - a.y * bc_xw + a.w * bc_xy);
        rows[k].n = -sign * (a.x * bc_yz - a.y * bc_xz + a.z * bc_xy);
        if (k == 0)
            determinant = rows[0].x * p[0].x + rows[0].y * p[0].y + rows[0].one * p[0].z + rows[0].n * p[0].w;
    }
    if (determinant == 0.0f || !isfinite(determinant))
        return 0;
    const float inverse = 1.0f / determinant;
    for (int k = 0; k < 4; k++) {
        rows[k].x *= inverse;
        rows[k].y *= inverse;
        rows[k].one *= inverse;
        rows[k].n *= inverse;
    }
    return 1;
}

/* A quantity from its values at the corners */
Quantity from_corners(const Quantity *rows, float4 values)
{
    Quantity made;
    made.x = rows[0].x * values.x + rows[1].x * values.y + rows[2].x * values.z + rows[3].x * values.w;
    made.y = rows[0].y * values.x + rows[1].y * values.y + rows[2].y * values.z + rows[3].y * values.w;
    made.one = rows[0].one * values.x + rows[1].one * values.y + rows[2].one * values.z + rows[3].one * values.w;
    made.n = rows[0].n * values.x + rows[1].n * values.y + rows[2].n * values.z + rows[3].n * values.w;
    return made;
}

/* Spaces the slices a pixel apart along the ray, where the tetrahedron is nearest; facing: the cosine between the ray
 * and the slices' normal there. They lie closer where they would be fewer than SLICES_STEADY, lest thin things flicker;
 * but no closer than the part of a pixel to which halvings refine hits, nor than half a texel, within which heights
 * hold nothing new. Where slices lie more than a pixel apart, there are more halvings between two. */
void space_slices(const Context *context, Tetrahedron *t, float facing)
{
    t->spacing = context->spacing;
    t->halvings = context->halvings;
    t->band = context->band > 0.0f ? context->band : 1.0f / context->slices;
    if (context->pixel == 0.0f)
        return;
    const float pixel = context->pixel * (t->perspective ? 1.0f / t->front : 1.0f);
    const float scale = context->spacing * context->slices;
    global const float *g = context->gradients + t->index / 3 * 6;
    const float texels = fmax(fast_length(vload3(0, g)) * context->map_width,
                              fast_length(vload3(1, g)) * context->map_height);
    const float least = fmax(fmin(0.5f / fmax(texels, 1e-30f), scale), scale / SLICES_MAX);
    const float pixel_spacing = pixel * facing;
    t->spacing = fmax(fmin(pixel_spacing, fmax(pixel_spacing / PIXEL_PARTS, scale / SLICES_STEADY)), least);
    if (context->band == 0.0f)
        t->band = t->spacing / scale;
    const float parts = t->spacing * fmax(PIXEL_PARTS / pixel, TEXTURE_PARTS / scale);
    t->halvings = max(context->halvings, min((int)ceil(log2(fmax(parts, 1.0f))), HALVINGS_MAX));
}

/* By how much heights err by rounding. A height along a ray is a difference of two numbers as large as the ray is long
 * in displacements, at a pixel whose coordinates are rounded, too. x, y: the region's first pixel */
float rounding_of(const Tetrahedron *t, int x, int y)
{
    const float by_x = fabs(t->h.x) * (x + REGION), by_y = fabs(t->h.y) * (y + REGION);
    const float along = fabs(t->h.n) * (t->perspective ? 1.0f : fmax(fabs(t->front), fabs(t->rear)));
    const float across = (by_x + by_y) * (t->perspective ? 1.0f / fmax(t->rear, 1e-30f) : 1.0f);
    return fmin(fmax(ROUNDING_ULPS * FLT_EPSILON * (along + across), HEIGHT_ROUNDING), 1.0f);
}

/* Sets where rays enter and leave through each of the four sides, which are moved outwards by `grown`; and the outline
 * in the picture, whose lines lie between a side by which rays enter and one by which they leave. */
void bound_sides(Tetrahedron *t, float grown)
{
    for (int k = 0; k < 4; k++) {
        const Quantity row = t->rows[k];
        const float n = fabs(row.n) > 1e-30f ? row.n : 1e-30f; /* seen edge-on */
        t->sides[k] = (Quantity){-row.x / n, -row.y / n, -(row.one + grown) / n, 0.0f};
        t->leaves[k] = n < 0.0f;
    }
    t->outlines = 0;
    for (int k = 0; k < 4; k++)
        for (int l = 0; l < 4; l++)
            if (t->leaves[k] && !t->leaves[l]) {
                Quantity o = {t->sides[k].x - t->sides[l].x, t->sides[k].y - t->sides[l].y,
                              t->sides[k].one - t->sides[l].one, 0.0f};
                o.one += (fmax(o.x, 0.0f) + fmax(o.y, 0.0f)) * (BLOCK - 1);
                t->outline[t->outlines++] = o;
            }
}

/* Sets up a tetrahedron. Returns its box in the region at (x, y): (low_x, high_x, low_y, high_y); empty if it cannot be
 * seen */
int4 set_up_one(const Context *context, int index, int x, int y, Tetrahedron *t)
{
    const int4 empty = (int4)(1, 0, 1, 0);
    float4 p[4];
    int crosses = 0;
    for (int k = 0; k < 4; k++) {
        p[k] = vload4(context->corners[4 * index + k], context->projected);
        p[k].xy -= (float2)(x, y) * p[k].z; /* relative to the region */
        crosses |= !(p[k].z >= context->nearest_w);
    }
    int4 box = (int4)(0, REGION - 1, 0, REGION - 1);
    if (!crosses) {
        float2 low = p[0].xy / p[0].z, high = low;
        for (int k = 1; k < 4; k++) {
            low = fmin(low, p[k].xy / p[k].z);
            high = fmax(high, p[k].xy / p[k].z);
        }
        low = fmin(fmax(ceil(low - 1e-3f), 0.0f), (float)REGION);
        high = fmin(fmax(floor(high + 1e-3f), -1.0f), REGION - 1.0f);
        box = (int4)((int)low.x, (int)high.x, (int)low.y, (int)high.y);
        if (box.x > box.y || box.z > box.w)
            return empty;
    }
    if (!barycentric_rows(p, t->rows))
        return empty;
    float3 point[4], place[4], middle = 0.0f;
    for (int k = 0; k < 4; k++) {
        point[k] = vload3(context->corners[4 * index + k], context->points);
        place[k] = vload3(context->corners[4 * index + k], context->places);
        middle += 0.25f * point[k];
    }
    t->u = from_corners(t->rows, (float4)(place[0].x, place[1].x, place[2].x, place[3].x));
    t->v = from_corners(t->rows, (float4)(place[0].y, place[1].y, place[2].y, place[3].y));
    t->h = from_corners(t->rows, (float4)(place[0].z, place[1].z, place[2].z, place[3].z));
    t->perspective = context->screen.perspective;

    t->index = index;
    t->crosses = crosses;
    t->nearest = t->front = context->screen.nearest;
    if (!crosses)
        t->front = fmax(fmax(p[0].w / p[0].z, p[1].w / p[1].z), fmax(p[2].w / p[2].z, p[3].w / p[3].z));

    int direction = 0; /* a */
    const float *m = context->screen.to_world;
    const float3 eye = (float3)(m[3], m[7], m[11]);
    const float3 view = t->perspective ? middle - eye / m[15] : eye;
    const float3 a = vload3(index / 3 * 3, context->frames);
    float3 d = a;
    float facing = fabs(dot(a, view)); /* times the view's length */
    if (context->slicing == ORTHOGONAL) { /* the direction that faces the viewer most */
        for (int k = 1; k < 3; k++) {
            const float3 other = vload3(index / 3 * 3 + k, context->frames);
            if (fabs(dot(other, view)) > facing) {
                facing = fabs(dot(other, view));
                direction = k;
                d = other;
            }
        }
    }
    space_slices(context, t, context->slicing == SCREEN ? 1.0f : facing / length(view));
    t->rear = t->perspective ? 0.0f : -INFINITY;
    if (!crosses)
        t->rear = fmin(fmin(p[0].w / p[0].z, p[1].w / p[1].z), fmin(p[2].w / p[2].z, p[3].w / p[3].z));
    t->height_rounding = crosses ? HEIGHT_ROUNDING : rounding_of(t, x, y);
    t->slice_rounding = SLICE_ROUNDING;
    /* Across the normal a whole number is taken off, as large as that of the first corner: what remains is exact. */
    if (context->slicing == SCREEN) {
        const float along = 1.0f / t->spacing, off = rint((t->perspective ? p[0].z : -p[0].w) * along);
        t->slice = t->perspective ? (Quantity){0.0f, 0.0f, along, -off} : (Quantity){0.0f, 0.0f, -off, -along};
    } else if (direction == 0) {
        const float count = context->pixel == 0.0f ? context->slices
                                                   : context->slices * (context->spacing / t->spacing);
        t->slice = t->h;
        t->slice.x *= count;
        t->slice.y *= count;
        t->slice.one *= count;
        t->slice.n *= count;
        t->slice_rounding = fmax(SLICE_ROUNDING, fmin(t->height_rounding * count, 0.5f));
    } else {
        const float along = 1.0f / t->spacing, first = dot(point[0], d) * along;
        const float4 beside = (float4)(0.0f, dot(point[1] - point[0], d), dot(point[2] - point[0], d),
                                       dot(point[3] - point[0], d));
        t->slice = from_corners(t->rows, (first - rint(first)) + beside * along);
    }
    bound_sides(t, crosses ? 0.0f : SIDE_MARGIN / p[0].z); /* no gap between neighbours by rounding */
    const float margin = 1e-4f * (t->front - t->rear) + 2e-6f * fmax(fabs(t->front), fabs(t->rear));
    t->first = crosses ? t->rear : t->rear - margin;
    t->last = crosses ? t->nearest : fmin(t->front + margin, t->nearest);
    return box;
}

intl set_up(const Context *context, intl index, int x, int y, Primitives *made)
{
    for (int lane = 0; lane < LANES; lane++) {
        const int4 box = set_up_one(context, int_lane(index, lane), x, y, &made->of[lane]);
        set_int_lane(made->low_x, lane, box.x);
        set_int_lane(made->high_x, lane, box.y);
        set_int_lane(made->low_y, lane, box.z);
        set_int_lane(made->high_y, lane, box.w);
    }
    return made->low_x <= made->high_x;
}

Linear along_ray(const Tetrahedron *t, Quantity q, floatl x, floatl y)
{
    const floatl at = q.x * x + (q.y * y + q.one);
    Linear made;
    made.fixed = t->perspective ? (floatl)q.n : at;
    made.sloped = t->perspective ? at : (floatl)(-q.n);
    return made;
}
#endif
