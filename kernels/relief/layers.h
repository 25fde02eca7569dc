#ifndef RELIEF_LAYERS_H
#define RELIEF_LAYERS_H
/* Layers of a relief: the fragment program that finds the relief in a region's pixels (Oliveira & Policarpo 2005).
 *
 * A pixel's ray may enter the relief, come out again at a silhouette and enter elsewhere. So a ray is searched in
 * layers: from the nearest entry, then from the next, as long as that entry is nearer than the ray's hit. All lanes of
 * a block search together, even if their rays enter through different triangles.
 *
 * With exact distances rays walk below the mesh (walk.h). With other distances, a ray that comes out of the relief
 * without a hit, above the quadric of its entry, has escaped. It is searched once more, up to the back face where it
 * leaves the mesh (follow_mesh). In a light's map, the bottom of the relief stops rays that meet a back before any
 * front (stop_from_below).
 */
#include "relief/entries.h"
#include "relief/walks.h"

#define ARC_PARTS 16 /* equal parts of a ray below the mesh; the deepest end of a part is found */
#define BOTTOM_TOLERANCE 1e-3f /* fraction by which estimated depths grow, so that rays reach the bottom */

/* A ray enters below the mesh, where its depth grows by `first_slope` per scene unit. It comes out `distance`
 * scene units behind, where its depth falls by `slope`. Its depth is estimated by the cubic with these slopes and depth
 * 0 at both ends. Finds where the cubic first reaches the bottom, or else is deepest: sets t, and returns the depth. */
INLINED floatl deepest_between(floatl first_slope, floatl distance, floatl slope, floatl *t)
{
    floatl depth = 0.0f, before = 0.0f;
    *t = 0.0f;
    for (int i = 1; i <= ARC_PARTS; i++) {
        const float part = (float)i / ARC_PARTS, rest = 1.0f - part;
        const floatl now = distance * (part * rest) * (first_slope * rest + slope * part);
        const intl rises = (depth < 1.0f) & (now > depth);
        const floatl reached = select_lanes(now > 1.0f, (1.0f - before) / (now - before), (floatl)1.0f);
        *t = select_lanes(rises, distance * (i - 1 + reached) * (1.0f / ARC_PARTS), *t);
        depth = select_lanes(rises, min_lanes(now, (floatl)1.0f), depth);
        before = now;
    }
    return depth;
}

/* Changes the depths of escaped rays, which leave the mesh `distance` behind their entries, if the cubic of
 * deepest_between reaches deeper than the depth below the quadric. The new depth is a parabola through the point where
 * the cubic is at the bottom, or deepest. The parabola begins with the ray's slope, or a lower slope. Returns which
 * rays are changed; share: set to the fraction of the quadric's curvature that remains */
intl follow_mesh(const Relief *relief, ReliefRay *ray, const Entry *out, Vector direction, floatl distance,
                 intl escaped, floatl *share)
{
    const floatl K = ray->K, slope = max_lanes(DOT(direction, out->normal), (floatl)0.0f) / relief->scale;
    floatl t;
    const floatl depth = deepest_between(ray->L, distance, slope, &t), safe_t = max_lanes(t, (floatl)1e-20f);
    const intl follows = escaped & (t > 0.0f) & (depth > depth_of(ray, t));
    const floatl bends = (depth / safe_t - ray->L) / safe_t;
    *share = select_lanes(follows & (K < bends), max_lanes(bends / K, (floatl)0.0f), (floatl)1.0f);
    const floatl mean = depth * (1.0f + BOTTOM_TOLERANCE) / safe_t, rise = min_lanes(ray->L, 2.0f * mean);
    ray->L = select_lanes(follows, rise, ray->L);
    ray->K = select_lanes(follows, (mean - rise) / safe_t, K);
    use_quadric_depth(ray, follows);
    return follows;
}

/* The rays of a block's pixels (world), from their entries into the relief */
typedef struct {
    Vector from, direction;
    floatl share; /* fraction of the quadric's curvature that the rays' depth follows, 0 to 1 */
} EntryRay;

/* Sets up a search along the rays of a block's pixels, from the nearest entries not yet searched. by_mesh: 1: only
 * along escaped rays, up to their exits, with depths from follow_mesh */
static EntryRay begin_search(const Context *context, const Region *region, int block, int by_mesh, Search *s)
{
    const Relief *relief = &context->relief;
    const Layers *layers = context->layers;
    const floatl x = BLOCK_X(region, block), y = BLOCK_Y(region, block);
    const floatl n = layers->first[block];
    EntryRay entry_ray;
    entry_ray.from = point_at(relief->screen, x, y, n);
    entry_ray.direction = view_direction(relief->screen, entry_ray.from);
    entry_ray.share = 1.0f;
    const intl entered = layers->entered[block], enters = entered >= 0, triangle = select_lanes(enters, entered, (intl)0);
    const Entry e = entry_of(relief, triangle, x, y);
    set_ray(&s->ray, &e, entry_ray.direction, relief->quadric, relief->scale);
    s->ray.level = level_of(relief, &e, PIXEL_SIZE(relief, n), enters);
    intl searches = enters;
    floatl longest = INFINITY;
    if (by_mesh) {
        const intl leaves = layers->escaped[block] & (layers->exit[block] > EMPTY);
        const Vector through = minus(point_at(relief->screen, x, y, select_lanes(leaves, layers->exit[block], n)),
                                     entry_ray.from);
        const floatl way = sqrt(DOT(through, through));
        const Entry out = entry_of(relief, select_lanes(leaves, layers->exit_triangle[block], triangle), x, y);
        searches = follow_mesh(relief, &s->ray, &out, entry_ray.direction, way, leaves, &entry_ray.share);
        longest = select_lanes(searches, way, longest);
    }
    begin_rays(s, searches & is_finite_ray(&s->ray), FIRST_TIER);
    set_end(&s->ray);
    s->ray.at_bottom = s->ray.at_bottom & (s->ray.end <= longest);
    s->ray.end = min_lanes(s->ray.end, longest);
    s->track = track_of(&s->ray, relief->levels);
    return entry_ray;
}

/* Searches along the rays of INTERLEAVED blocks, from `block` on; by_mesh: as in begin_search. Returns whether there
 * are further entries to search. */
OUTLINED int search_blocks(const Context *context, int block, int by_mesh, Region *region)
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
        const Search *s = &searches[k];
        Layers *layers = context->layers;
        const int at = block + k;
        const intl nearer = keep_hits(context, at, s, entry_rays[k].from, entry_rays[k].direction, layers->entered[at],
                                      region);
        layers->t[at] = select_lanes(nearer, s->t, layers->t[at]);
        layers->share[at] = select_lanes(nearer, entry_rays[k].share, layers->share[at]);
        layers->escaped[at] = by_mesh ? (intl)0 : s->searches & !s->found;
        more |= any_lane(end_layer(layers, region, at));
#if COUNTERS
        count_steps(context, region, at, s);
#endif
    }
    return more;
}

OUTLINED void find_exits(const Context *context, Region *region, BinList listed)
{
    Context backs = *context;
    backs.culled = CULLS_FRONTS;
    for (int block = 0; block < BLOCKS; block++)
        context->layers->exit[block] = EMPTY;
    draw_list(&backs, region, listed);
}

#if DEPTH_ALONE
/* A light's ray that meets a back before any front comes from below the mesh: from behind a wall, or out of an open
 * tube. The bottom of the relief stops the ray before it reaches the relief's surface. */
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
        mask_inactive(&ray, leaves & is_finite_ray(&ray));
        set_end(&ray);
        const floatl nearness = nearness_of(relief->screen, plus_scaled(from, ray.end, back));
        const intl before = relief->screen.perspective ? (nearness > 0.0f) & (nearness <= relief->screen.nearest)
                                                       : leaves;
        const intl stops = leaves & ray.at_bottom & before & (nearness > region->nearness[block]);
        region->nearness[block] = select_lanes(stops, nearness, region->nearness[block]);
        region->owner[block] = select_lanes(stops, triangle, region->owner[block]);
    }
}
#endif

/* Searches a layer: first with depths from the quadrics of the entries, then, along escaped rays, with depths from
 * follow_mesh. In a light's map the second search is left out: a hit that is estimated too near the light would shade
 * lit points. Returns whether there are further entries to search. */
static int search_layer(const Context *context, Region *region, BinList listed)
{
    Layers *layers = context->layers;
    int more = 0, escaped = 0;
    for (int block = 0; block < BLOCKS; block += INTERLEAVED) {
        int any = 0;
        for (int k = 0; k < INTERLEAVED; k++) {
            layers->searched[block + k] = -INFINITY;
            layers->escaped[block + k] = 0;
            any |= any_lane(layers->entered[block + k] >= 0);
        }
        if (!any)
            continue;
#if WALKS
        if (context->relief.quadric) {
            more |= walk_layer(context, block, region);
            continue;
        }
#endif
        more |= search_blocks(context, block, 0, region);
        for (int k = 0; k < INTERLEAVED; k++)
            escaped |= any_lane(layers->escaped[block + k]);
    }
    if (!escaped || DEPTH_ALONE || WALKS)
        return more;
    find_exits(context, region, listed);
    for (int block = 0; block < BLOCKS; block += INTERLEAVED) {
        int any = 0;
        for (int k = 0; k < INTERLEAVED; k++)
            any |= any_lane(layers->escaped[block + k] & (layers->exit[block + k] > EMPTY));
        if (any)
            more |= search_blocks(context, block, 1, region);
    }
    return more;
}

/* The vertices' values, interpolated at the entry of a pixel's ray; if the ray walked, on the mesh above its hit */
INLINED Entry entry_of_hit(const Relief *relief, const Layers *layers, int block, intl triangle, floatl x, floatl y)
{
    OnTriangle at = on_triangle(relief->faces, relief->projected, triangle, x, y);
#if WALKS
    if (relief->quadric) {
        at.weight[1] = layers->foot_second[block];
        at.weight[2] = layers->foot_third[block];
        at.weight[0] = 1.0f - at.weight[1] - at.weight[2];
    }
#endif
    return flattened(entry_at(relief, &at), layers->share[block]);
}

OUTLINED void search_layers(const Context *context, Region *region, BinList listed)
{
    Layers *layers = context->layers;
    for (int block = 0; block < BLOCKS; block++) {
#if WALKS
        layers->foot_second[block] = layers->foot_third[block] = 0.0f;
#endif
        layers->t[block] = 0.0f;
        layers->share[block] = 1.0f;
        layers->searched[block] = INFINITY;
        layers->searched_triangle[block] = -1;
    }
#if WITHIN
    walk_from_eye(context, region);
#endif
    const int triangles = listed.last - listed.first; /* a pixel has at most one entry per triangle */
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
