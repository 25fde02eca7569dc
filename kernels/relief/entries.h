#ifndef RELIEF_ENTRIES_H
#define RELIEF_ENTRIES_H
/* Entries of a region's rays into a relief, for the layer that is being searched, and the hits of this layer. */
#define KEEPS_UV 1
#include "raster/fragment.h"
#include "relief/entry.h"

#ifndef WITHIN
#define WITHIN 0 /* 1: the eye is below the mesh, and rays walk from the eye */
#endif

/* For each pixel of a region: the entries of the layer that is being searched, and how the pixel's hit was found */
typedef struct {
    floatl first[BLOCKS], second[BLOCKS]; /* nearness of the two nearest entries that have not been searched yet */
    intl entered[BLOCKS];                 /* triangle of the first of these entries, -1: none */
    floatl searched[BLOCKS];              /* nearness of the entry that was searched last */
    intl searched_triangle[BLOCKS];       /* this entry's triangle */
    floatl t[BLOCKS];                     /* distance from the entry to the hit, in scene units */
    floatl share[BLOCKS];                 /* fraction of the quadric's curvature that the hit's depth follows */
    intl escaped[BLOCKS];                 /* the first entry's ray came out of the entry's quadric without a hit */
    floatl exit[BLOCKS];                  /* nearness of the back through which the ray leaves the mesh; EMPTY: none */
    intl exit_triangle[BLOCKS];
#if WALKS
    floatl foot_second[BLOCKS], foot_third[BLOCKS]; /* second and third corner's weights, on the mesh above the hit */
#endif
} Layers;

typedef struct {
    Relief relief;
    float nearest_w;
    int culled; /* CULLS_BACKS: draws fronts, where rays enter; CULLS_FRONTS: draws backs, where they leave */
    Layers *layers;
    global int *counters;
#if WITHIN
    int eye_triangle; /* the triangle above the eye */
    float eye_depth;  /* the eye's depth below this triangle, 1 at the bottom */
#endif
} Context;

typedef Triangles Primitives;

static intl set_up(const Context *context, intl index, int x, int y, Primitives *t)
{
    return set_up_triangles(context->relief.faces, context->relief.projected, index, context->nearest_w,
                            context->culled, x, y, t);
}

/* Keeps exits: for an escaped ray, the nearest back behind its entry; in a light's map, the nearest back that lies in
 * front of every entry. */
void cover_back(Layers *layers, const Primitives *t, int lane, int block, int first_x, int first_y)
{
    floatl n;
    if (!DEPTH_ALONE && !any_lane(layers->escaped[block]))
        return;
    const intl covered = covered_by(t, lane, first_x, first_y, &n);
    const intl wanted = DEPTH_ALONE ? n > layers->first[block] : layers->escaped[block] & (n < layers->first[block]);
    const intl nearer = covered & wanted & (n > layers->exit[block]);
    layers->exit[block] = select_lanes(nearer, n, layers->exit[block]);
    layers->exit_triangle[block] = select_lanes(nearer, (intl)int_lane(t->index, lane), layers->exit_triangle[block]);
}

static void cover(const Context *context, const Primitives *t, int lane, Region *region, int block, int first_x, int first_y)
{
    floatl n;
    Layers *layers = context->layers;
    const int index = int_lane(t->index, lane);
    if (context->culled == CULLS_FRONTS) {
        cover_back(layers, t, lane, block, first_x, first_y);
        return;
    }
    const floatl first = layers->first[block], second = layers->second[block], searched = layers->searched[block];
    const intl covered = covered_by(t, lane, first_x, first_y, &n);
    const intl seen = covered & (n <= context->relief.screen.nearest) & (n > region->nearness[block]) &
                      ((n < searched) | ((n == searched) & (layers->searched_triangle[block] < index)));
    const intl nearer = seen & (n > first);
    layers->second[block] = select_lanes(nearer, first, select_lanes(seen & (n > second), n, second));
    layers->first[block] = select_lanes(nearer, n, first);
    layers->entered[block] = select_lanes(nearer, (intl)index, layers->entered[block]);
}

#define FRAGMENTS 1
#include "raster/list.h"

#if COUNTERS
void count_steps(const Context *context, const Region *region, int block, const Search *s)
{
    for (int lane = 0; lane < LANES; lane++) {
        const long at = pixel_of(context->relief.screen, region->x + FIRST_X(block), region->y + FIRST_Y(block), lane);
        if (at >= 0 && int_lane(s->searches, lane)) {
            context->counters[2 * at]++;
            context->counters[2 * at + 1] += int_lane(s->taken, lane);
        }
    }
}
#endif

/* Keeps the hits of a search that are nearer than the points which the region's pixels show so far. triangle: triangles
 * above the hits; from: the rays' points at t = 0. Returns which hits are kept. */
INLINED intl keep_hits(const Context *context, int block, const Search *s, Vector from, Vector direction, intl triangle,
                       Region *region)
{
    const floatl t = s->t, so_far = region->nearness[block];
    const floatl nearness = nearness_of(context->relief.screen, plus_scaled(from, t, direction));
    const intl nearer = s->searches & s->found & (nearness > so_far);
    region->nearness[block] = select_lanes(nearer, nearness, so_far);
    region->owner[block] = select_lanes(nearer, triangle, region->owner[block]);
    region->u[block] = select_lanes(nearer, s->ray.u + t * s->ray.du, region->u[block]);
    region->v[block] = select_lanes(nearer, s->ray.v + t * s->ray.dv, region->v[block]);
    return nearer;
}

/* Ends the search from a block's entries. Returns which pixels have a further entry that is nearer than the point they
 * show. */
INLINED intl end_layer(Layers *layers, const Region *region, int block)
{
    const intl entered = layers->entered[block];
    const intl more = (entered >= 0) & (layers->second[block] > region->nearness[block]);
    layers->searched[block] = select_lanes(more, layers->first[block], (floatl)-INFINITY);
    layers->searched_triangle[block] = entered;
    return more;
}
#endif
