#ifndef SLICING_VIEW_VOLUMES_H
#define SLICING_VIEW_VOLUMES_H
/* Each view's volume: the points behind the surface of its depth image (SILHOUETTES 0), or inside its silhouette
 * (SILHOUETTES 1). An object is the intersection of all views' volumes (Kautz & Seidel 2001, sections 4 and 5). Arrays:
 * object.cl.
 */
#include "lib/screen.h"
#include "lib/taps.h"
#include "slicing/rays.h"
#include "slicing/records.h"

#ifndef SILHOUETTES
#define SILHOUETTES 0 /* 1: maps are masks */
#endif
#ifndef RIBBONS
#define RIBBONS 0 /* 1: parts that are one sample wide in a view get the width of ribbons (lib/ribbons.h) */
#endif

/* A pixel's ray in the world */
typedef struct {
    Linear x, y, z;
} WorldRay;

/* The product of a matrix row and the points of a ray, with homogeneous coordinate 1 */
INLINED Linear row_of(global const float *m, const WorldRay *ray)
{
    Linear made;
    made.fixed = m[0] * ray->x.fixed + m[1] * ray->y.fixed + m[2] * ray->z.fixed + m[3];
    made.sloped = m[0] * ray->x.sloped + m[1] * ray->y.sloped + m[2] * ray->z.sloped;
    return made;
}

/* A view's four samples around a place, their bilinear weights, and whether the place lies in the view's image */
typedef struct {
    Taps taps;
    floatl weights[4];
    intl on_image;
} Samples;

INLINED Samples samples_at(global const int *size, floatl x, floatl y)
{
    Samples samples;
    samples.taps = clamped_taps(size[0], size[1], x, y);
    tap_weights(samples.taps.fx, samples.taps.fy, samples.weights);
    samples.on_image = (x >= -0.5f) & (x <= size[0] - 0.5f) & (y >= -0.5f) & (y <= size[1] - 0.5f);
    return samples;
}

#if SILHOUETTES
#define MAP_OF(views, size) ((views)->maps + (size)[2])
#else
#define MAP_OF(views, size) ((views)->maps + 2 * (size)[2])
#endif
#define SURFACE_OF(views, size) ((views)->surfaces + 2 * (size)[2])

/* A view's surface at a place: its nearness, and whether there is a surface */
typedef struct {
    floatl nearness;
    intl there;
} SurfaceSample;

/* A view's surface at a place, for `wanted` points with the nearness `mine` in the view. The surface is exact where it
 * may be close to the points; elsewhere it only lies on the correct side of them. reach: greatest difference in
 * nearness between surface and samples. outline: a cell's nearest part ends before background where the weights of the
 * part's samples sum to this; 0.5 is half-way, as a sample covers its pixel. Beside a farther surface, the part does
 * not end: the surface falls from the part to the farther surface, bilinearly with `outline` 0.5; with a smaller
 * `outline` the part's nearness extends farther out. creases: 0: a cell whose four samples all belong to the nearest
 * part is bilinear, without the crease that would rise above it. */
INLINED SurfaceSample surface_at(global const float *map, global const int *size, Samples samples, float outline,
                                 float reach, floatl mine, intl wanted, int creases)
{
    const floatl first = (floatl)(gather(map, samples.taps.at[0]));
    const intl kind = as_intl(first) & OUTLINE_CELL;
    SurfaceSample surface = {first, kind != EMPTY_CELL};
    if (!any_lane(wanted & surface.there))
        return surface;
    floatl bilinear = samples.weights[0] * first, nearest_sample = first;
    UNROLLED
    for (int k = 1; k < 4; k++) {
        const floatl there = (floatl)(gather(map, samples.taps.at[k]));
        bilinear += samples.weights[k] * there;
        nearest_sample = max_lanes(nearest_sample, there);
    }
    surface.nearness = bilinear;
    const intl other = wanted & (kind >= OTHER_CELL) & (mine <= nearest_sample + reach) &
                       ((kind == OUTLINE_CELL) | (mine > bilinear));
    if (!any_lane(other))
        return surface;
    const intl in_cells = samples.taps.at[0] + size[0] * size[1];
    const floatl cell = (floatl)(gather(map, in_cells));
    const intl bits = as_intl(cell), whole = (bits & CELL_WHOLE) == CELL_WHOLE, ends = (bits & CELL_BACKGROUND) != 0;
    floatl part = 0.0f;
    UNROLLED
    for (int k = 0; k < 4; k++)
        part += as_floatl(as_intl(samples.weights[k]) & -((bits >> k) & 1));
    const floatl rise = select_lanes(whole, creases ? cell : (floatl)0.0f, first + cell - bilinear);
    const float later = 0.5f / outline;
    const floatl falls = min_lanes(part * (later * later - 1.0f), (floatl)1.0f);
    const floatl share = select_lanes(whole | ends, (floatl)1.0f, falls);
    surface.nearness = select_lanes(other, bilinear + share * rise, bilinear);
    surface.there = surface.there & (!other | !ends | (part >= outline));
    return surface;
}

/* The sum of the bilinear weights of those samples around a place that belong to the object */
INLINED floatl mask_at(global const float *map, Samples samples)
{
    floatl sum = 0.0f;
    for (int k = 0; k < 4; k++)
        sum += samples.weights[k] * (floatl)(gather(map, samples.taps.at[k]));
    return sum;
}

typedef struct {
    Linear u, v, w, q;
} ViewRay;

INLINED ViewRay view_ray(global const float *matrix, const WorldRay *ray)
{
    const ViewRay made = {row_of(matrix, ray), row_of(matrix + 4, ray), row_of(matrix + 8, ray),
                          row_of(matrix + 12, ray)};
    return made;
}

typedef struct {
    int count, colored; /* number of views that test points, and of views that give colours */
    global const float *matrices;
    global const int *sizes;
    global const float *maps;
    global const float *surfaces;
    global const float *reaches;
    global const uint *colors;
    global const int *order;
    global const float *closeness;
    int visible, unknown;
    float outline;
    float sample, stride;
#if RIBBONS
    global const int *firsts;
    global const float *ribbons;
#endif
    global const uint *normals; /* RGBA bytes, as colors; with GBUFFER 2 */
} Views;

#if RIBBONS
/* The greatest of `value` and the nearness of a view's ribbons at the place (x, y) */
INLINED floatl over_ribbons(const Views *views, global const int *size, floatl x, floatl y, intl active, floatl value)
{
    const floatl column = clamp_lanes(floor_lanes(x + 0.5f), (floatl)0.0f, (floatl)(size[0] - 1));
    const floatl row = clamp_lanes(floor_lanes(y + 0.5f), (floatl)0.0f, (floatl)(size[1] - 1));
    const intl at = size[2] + to_intl(row) * size[0] + to_intl(column), next = at + 1;
    intl number = (intl)(gather(views->firsts, at));
    const intl last = (intl)(gather(views->firsts, next));
    for (; any_lane(active & (number < last)); number++) {
        const intl there = active & (number < last), first = RIBBON_FLOATS * select_lanes(there, number, (intl)0);
        floatl part[RIBBON_FLOATS];
        for (int k = 0; k < RIBBON_FLOATS; k++) {
            const intl here = first + k;
            part[k] = (floatl)(gather(views->ribbons, here));
        }
        floatl low = 0.0f, high = 1.0f;
        const floatl across[2] = {x - part[0], y - part[1]};
        for (int axis = 0; axis < 2; axis++) { /* part of the sweep during which the square covers the place */
            const floatl length = part[2 + axis],
                         per_length = 1.0f / select_lanes(fabs(length) > 1e-6f, length, (floatl)1e-6f);
            const floatl a = (across[axis] - 0.5f) * per_length, b = (across[axis] + 0.5f) * per_length;
            low = max_lanes(low, min_lanes(a, b));
            high = min_lanes(high, max_lanes(a, b));
        }
        const floatl along = across[0] * part[2] + across[1] * part[3];
        const intl beyond = (part[7] > 0.5f) & (along > part[2] * part[2] + part[3] * part[3]);
        const floatl near = part[4] + part[5] * across[0] + part[6] * across[1];
        value = select_lanes(there & (low <= high) & !beyond, max_lanes(value, near), value);
    }
    return value;
}
#endif

/* The number of views, first in testing order, for which a pixel's ray is transformed once; most points fail there. For
 * later views, each point is transformed. So it is for all views on GPUs, as an indexed array would lie in device
 * memory. */
#define RAYS_HELD (LANES == 1 ? 0 : 6)

/* A pixel's ray in the world, and in the spaces of the first RAYS_HELD views */
typedef struct {
    const WorldRay *ray;
    ViewRay held[RAYS_HELD + 1];
} ViewRays;

void hold_rays(const Views *views, const WorldRay *ray, ViewRays *rays)
{
    rays->ray = ray;
    for (int i = 0; i < min(views->count, RAYS_HELD); i++)
        rays->held[i] = view_ray(views->matrices + 16 * views->order[i], ray);
}

/* Returns which of the rays' points at depth z pass the test of every view; inside: points to test. Adds to `passed`
 * the number of views that a point passes before a view rejects it, and to `tests` the number of views tested. */
intl inside_all(const Views *views, const ViewRays *rays, floatl z, intl inside, intl *passed, intl *tests)
{
    for (int i = 0; i < views->count && any_lane(inside); i++) {
        *tests += inside & 1;
        const int number = views->order[i];
        ViewRay found;
        if (i >= RAYS_HELD)
            found = view_ray(views->matrices + 16 * number, rays->ray);
        const ViewRay *ray = i < RAYS_HELD ? &rays->held[i] : &found;
        const floatl w = AT(ray->w, z), inverse = 1.0f / w;
        global const int *size = views->sizes + 3 * number;
        const floatl u = AT(ray->u, z) * inverse, v = AT(ray->v, z) * inverse;
        const Samples samples = samples_at(size, u, v);
#if SILHOUETTES
        inside = inside & samples.on_image & (w > 0.0f) & (mask_at(MAP_OF(views, size), samples) >= 0.5f);
#else
        const floatl mine = AT(ray->q, z) * inverse;
        const SurfaceSample surface = surface_at(MAP_OF(views, size), size, samples, views->outline,
                                                 views->reaches[number], mine, inside & samples.on_image, 1);
#if RIBBONS
        const floatl value = select_lanes(surface.there, surface.nearness, (floatl)NO_SURFACE);
        const intl behind = mine <= over_ribbons(views, size, u, v, inside & samples.on_image, value);
#else
        const intl behind = surface.there & (mine <= surface.nearness);
#endif
        const intl seen = samples.on_image & (w > 0.0f);
        inside = inside & (seen | (intl)(views->unknown ? -1 : 0)) & (!seen | behind);
#endif
        *passed -= inside;
    }
    return inside;
}
#endif
