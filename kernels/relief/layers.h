#ifndef RELIEF_LAYERS_H
#define RELIEF_LAYERS_H
/* Layers of a relief: the fragment program that finds what a region's pixels see of it (Oliveira & Policarpo 2005).
 *
 * A pixel's ray may enter the relief, come out again beside a silhouette and enter elsewhere. So the rays are searched
 * layer by layer: from the nearest entry that has not been searched, for as long as an entry lies nearer than what has
 * been found. All lanes of a block search at once, whichever triangles their rays enter.
 *
 * A ray that escapes, which by its quadric has come out again, is searched once more by what the mesh itself tells
 * (walk.h, follow_mesh): up to the back by which it leaves the mesh. With ASKS_MESH all rays whose way through the mesh
 * is short are searched by that alone. In a light's map, rays that meet a back before
 * any front are stopped at the bottom of the relief (stop_from_below).
 */
#define KEEPS_UV 1
#include "raster/fragment.h"
#include "relief/walk.h"

#ifndef DEPTH_ALONE
#define DEPTH_ALONE 0 /* 1: no colours are asked for, as in a light's map */
#endif
#define ASKS_MESH (DISTANCE == EXACT && !DEPTH_ALONE) /* short ways through the mesh follow it, not its quadrics */
#define SHORT_WAY 6.0f /* of the relief's depth: a ray's way through the mesh, times the cosine that it enters at */

/* A region's pixels: the entries of the layer that is searched, and how the pixel's hit has been found */
typedef struct {
    floatl first[BLOCKS], second[BLOCKS]; /* nearness of the nearest two entries of those not searched yet */
    intl entered[BLOCKS];                 /* triangle of the first, -1: none */
    floatl searched[BLOCKS];              /* nearness of the last entry that has been searched from, */
    intl searched_triangle[BLOCKS];       /* and its triangle */
    floatl t[BLOCKS];                     /* from the entry to the hit, in scene units */
    floatl share[BLOCKS];                 /* of the quadric's curvature that the hit was found with, 0 to 1 */
    intl escaped[BLOCKS];                 /* by its quadric the ray from the first entry has come out again */
    floatl exit[BLOCKS];                  /* nearness of the back by which it leaves the mesh; EMPTY: none */
    intl exit_triangle[BLOCKS];
} Layers;

typedef struct {
    Relief relief;
    float nearest_w;
    int culled; /* CULLS_BACKS: fronts are drawn, where rays enter; CULLS_FRONTS: backs, where they leave */
    Layers *layers;
    global int *counters;
} Context;

typedef Triangles Primitives;

static intl set_up(const Context *context, intl index, int x, int y, Primitives *t)
{
    return set_up_triangles(context->relief.faces, context->relief.projected, index, context->nearest_w,
                            context->culled, x, y, t);
}

/* Finds the exits of escaped rays, the nearest backs behind their entries; of a light's map, the backs before any
 * entry. */
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

/* The rays of a block's pixels in the world, from where they enter the relief */
typedef struct {
    Vector from, direction;
    floatl share; /* of the quadric's curvature that their depth follows, 0 to 1 */
    intl by_mesh; /* the mesh has been asked how deep they are */
} EntryRay;

/* Are the exits of all rays found before they are searched? */
INLINED int finds_exits_first(const Relief *relief)
{
#if WITHIN
    return 1;
#else
    return ASKS_MESH ? relief->quadric : 0;
#endif
}

/* Sets up a search along the rays of a block's pixels from their first entries; by_mesh: along those that have escaped,
 * by what the mesh tells, up to their exits. */
static EntryRay begin_search(const Context *context, const Region *region, int block, int by_mesh, Search *s)
{
    const Relief *relief = &context->relief;
    const Layers *layers = context->layers;
    const floatl x = BLOCK_X(region, block), y = BLOCK_Y(region, block);
    const floatl n = layers->first[block];
    EntryRay entry_ray;
    entry_ray.from = point_at(relief->screen, x, y, n);
#if WITHIN
    entry_ray.direction = ray_direction(relief->screen, x, y); /* the window is too near for view_direction */
#else
    entry_ray.direction = view_direction(relief->screen, entry_ray.from);
#endif
    entry_ray.share = 1.0f;
    entry_ray.by_mesh = 0;
    const intl entered = layers->entered[block], enters = entered >= 0, triangle = select_lanes(enters, entered, (intl)0);
    const Entry e = entry_of(relief, triangle, x, y);
    set_ray(&s->ray, &e, entry_ray.direction, relief->quadric, relief->scale);
#if DISTANCE == EXACT || (DEPTH_ALONE && DISTANCE == APPROXIMATE)
    if (relief->quadric && !by_mesh)
        follow_circles(&s->ray, &e, entry_ray.direction, relief->scale, enters & STARTS_AT_MESH(&s->ray));
#endif
    s->ray.level = level_of(relief, &e, PIXEL_SIZE(relief, n), enters);
    intl searches = enters;
    floatl longest = INFINITY;
    if (by_mesh || finds_exits_first(relief)) {
        const intl leaves = layers->escaped[block] & (layers->exit[block] > EMPTY);
        const Vector through = minus(point_at(relief->screen, x, y, select_lanes(leaves, layers->exit[block], n)),
                                     entry_ray.from);
        const floatl way = sqrt(DOT(through, through)), short_way = SHORT_WAY / s->ray.L;
        intl asks = by_mesh ? leaves : ((leaves & (way < short_way)) | (enters & (e.is_sharp > 0.0f))) &
                                           STARTS_AT_MESH(&s->ray);
        if (by_mesh)
            searches = 0;
        if ((by_mesh || ASKS_MESH) && any_lane(asks)) {
            const Exit exit = exit_at(relief, select_lanes(leaves, layers->exit_triangle[block], triangle), x, y,
                                      entry_ray.direction, select_lanes(leaves, way, (floatl)INFINITY));
            const floatl farthest = by_mesh ? (floatl)INFINITY : short_way;
            entry_ray.by_mesh = asks & (exit.distance <= farthest);
            if (!by_mesh)
                asks = asks & ((e.is_sharp > 0.0f) | !is_as_mesh(&s->ray, &e, exit, relief->scale));
            intl follows = 0;
            if (any_lane(asks))
                follows = follow_mesh(relief, &s->ray, &e, entry_ray.from, entry_ray.direction, triangle, exit, farthest,
                                      by_mesh ? leaves : (intl)0, asks, &entry_ray.share);
            entry_ray.by_mesh = entry_ray.by_mesh & (follows | !asks);
            longest = select_lanes(follows, way, longest);
            searches = by_mesh ? follows : searches;
        }
        longest = select_lanes(leaves & !STARTS_AT_MESH(&s->ray), way, longest);
    }
#if COUNTERS
    s->taken = 0;
#endif
    s->searches = s->active = searches & is_finite_ray(&s->ray);
    mask_inactive(&s->ray, s->active);
    set_end(&s->ray);
    s->ray.at_bottom = s->ray.at_bottom & (s->ray.end <= longest);
    s->ray.end = min_lanes(s->ray.end, longest);
    s->track = track_of(&s->ray, relief->levels);
    return entry_ray;
}

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

/* Keeps the hits of a search that are nearer than what the region shows. Returns for which pixels a further entry lies
 * nearer than that. */
intl keep_hits(const Context *context, int block, const Search *s, EntryRay entry_ray, Region *region)
{
    Layers *layers = context->layers;
    const floatl t = s->t, so_far = region->nearness[block];
    const Vector hit = {entry_ray.from.x + t * entry_ray.direction.x, entry_ray.from.y + t * entry_ray.direction.y,
                        entry_ray.from.z + t * entry_ray.direction.z};
    const floatl nearness = nearness_of(context->relief.screen, hit);
    const intl entered = layers->entered[block], nearer = s->searches & s->found & (nearness > so_far);
    region->nearness[block] = select_lanes(nearer, nearness, so_far);
    region->owner[block] = select_lanes(nearer, entered, region->owner[block]);
    layers->t[block] = select_lanes(nearer, t, layers->t[block]);
    layers->share[block] = select_lanes(nearer, entry_ray.share, layers->share[block]);
    layers->escaped[block] = s->searches & !s->found & !entry_ray.by_mesh;
    region->u[block] = select_lanes(nearer, ALONG(s->ray.u, s->ray.du, s->ray.bend_u, t), region->u[block]);
    region->v[block] = select_lanes(nearer, ALONG(s->ray.v, s->ray.dv, s->ray.bend_v, t), region->v[block]);
    const intl more = (entered >= 0) & (layers->second[block] > region->nearness[block]);
    layers->searched[block] = select_lanes(more, layers->first[block], (floatl)-INFINITY);
    layers->searched_triangle[block] = entered;
    return more;
}

/* Searches along the rays of INTERLEAVED blocks; by_mesh: of begin_search. Returns whether there are further
 * entries. */
static int search_blocks(const Context *context, int block, int by_mesh, Region *region)
{
    Search searches[INTERLEAVED];
    EntryRay entry_rays[INTERLEAVED];
    int any = 0, more = 0;
    for (int k = 0; k < INTERLEAVED; k++) {
        entry_rays[k] = begin_search(context, region, block + k, by_mesh, &searches[k]);
        any |= any_lane(searches[k].active);
    }
    if (by_mesh && !any)
        return 0;
    search_relief(&context->relief, searches, INTERLEAVED);
    for (int k = 0; k < INTERLEAVED; k++) {
        more |= any_lane(keep_hits(context, block + k, &searches[k], entry_rays[k], region));
#if COUNTERS
        count_steps(context, region, block + k, &searches[k]);
#endif
    }
    return more;
}

/* Finds the exits of the rays of all blocks (cover_back). */
void find_exits(const Context *context, Region *region, BinList listed)
{
    Context backs = *context;
    backs.culled = CULLS_FRONTS;
    for (int block = 0; block < BLOCKS; block++)
        context->layers->exit[block] = EMPTY;
    draw_list(&backs, region, listed);
}

#if DEPTH_ALONE
/* A light's rays that meet a back before any front come from below the mesh, as from behind a wall, or out of an open
 * tube: the bottom of the relief stops them there, before they reach what is carved into it. */
void stop_from_below(const Context *context, Region *region, BinList listed)
{
    const Relief *relief = &context->relief;
    Layers *layers = context->layers;
    find_exits(context, region, listed);
    for (int block = 0; block < BLOCKS; block++) {
        const intl leaves = layers->exit[block] > EMPTY;
        if (!any_lane(leaves))
            continue;
        const floatl x = BLOCK_X(region, block), y = BLOCK_Y(region, block);
        const intl triangle = select_lanes(leaves, layers->exit_triangle[block], (intl)0);
        const Vector from = point_at(relief->screen, x, y, select_lanes(leaves, layers->exit[block], (floatl)1.0f));
        /* The reversed ray enters at the exit. */
        const Vector back = scaled(view_direction(relief->screen, from), (floatl)-1.0f);
        const Entry e = entry_of(relief, triangle, x, y);
        ReliefRay ray;
        set_ray(&ray, &e, back, relief->quadric, relief->scale);
#if DISTANCE != PERPENDICULAR
        if (relief->quadric)
            follow_circles(&ray, &e, back, relief->scale, leaves);
#endif
        mask_inactive(&ray, leaves & is_finite_ray(&ray));
        set_end(&ray);
        const Vector bottom = {from.x + ray.end * back.x, from.y + ray.end * back.y, from.z + ray.end * back.z};
        const floatl nearness = nearness_of(relief->screen, bottom);
        const intl before = relief->screen.perspective ? (nearness > 0.0f) & (nearness <= relief->screen.nearest)
                                                       : leaves;
        const intl stops = leaves & ray.at_bottom & before & (nearness > region->nearness[block]);
        region->nearness[block] = select_lanes(stops, nearness, region->nearness[block]);
        region->owner[block] = select_lanes(stops, triangle, region->owner[block]);
    }
}
#endif

/* Searches a layer: from the first entries by their quadrics, and then along the rays that have escaped by the mesh. In
 * a light's map these are left out: a hit that is guessed too near would shade what is lit. WITHIN, rays are searched
 * up to their exits at first. Returns whether there are further entries. */
static int search_layer(const Context *context, Region *region, BinList listed)
{
    Layers *layers = context->layers;
    const int asks = finds_exits_first(&context->relief);
    int more = 0, escaped = 0;
    for (int block = 0; block < BLOCKS; block++) {
        layers->searched[block] = -INFINITY;
        layers->escaped[block] = asks ? layers->entered[block] >= 0 : (intl)0;
    }
    for (int by_mesh = 0; by_mesh <= (DEPTH_ALONE ? 0 : escaped); by_mesh++) {
        if (asks != by_mesh)
            find_exits(context, region, listed);
        for (int block = 0; block < BLOCKS; block += INTERLEAVED) {
            int any = 0;
            for (int k = 0; k < INTERLEAVED; k++)
                any |= any_lane(by_mesh ? layers->escaped[block + k] & (layers->exit[block + k] > EMPTY)
                                        : layers->entered[block + k] >= 0);
            if (any)
                more |= search_blocks(context, block, by_mesh, region);
            for (int k = 0; k < INTERLEAVED && !by_mesh; k++)
                escaped |= any_lane(layers->escaped[block + k]);
        }
    }
    return more;
}

/* Finds what the region's pixels see of the relief, layer by layer. */
OUTLINED void search_layers(const Context *context, Region *region, BinList listed)
{
    Layers *layers = context->layers;
    for (int block = 0; block < BLOCKS; block++) {
        layers->t[block] = 0.0f;
        layers->share[block] = 1.0f;
        layers->searched[block] = INFINITY;
        layers->searched_triangle[block] = -1;
    }
    const int triangles = listed.last - listed.first; /* a pixel has one entry of each at most */
    for (int more = 1, layer = 0; more && layer < triangles; layer++) {
        for (int block = 0; block < BLOCKS; block++) {
            layers->first[block] = layers->second[block] = EMPTY;
            layers->entered[block] = -1;
        }
        draw_list(context, region, listed);
#if DEPTH_ALONE
        if (layer == 0)
            stop_from_below(context, region, listed);
#endif
        more = search_layer(context, region, listed);
    }
}
#endif
