/* Relief mapping on a mesh, with true silhouettes and depth (Oliveira & Policarpo 2005).
 *
 * A pixel's ray enters the relief at the mesh. There the vertices' frames and quadrics are interpolated, and the ray is
 * followed in texture space (search.h) until it meets the relief or comes out again beside the silhouette. It may then
 * enter elsewhere: a region's pixels are searched layer by layer, nearest entry first, for as long as an entry lies
 * nearer than what has been found. All lanes of a block search at once, whichever triangles they entered.
 *
 * An eye below the mesh, within the relief, has no entries around it. Then a window right before it is one, WITHIN: its
 * rays start there, at the eye's depth, and are searched as far as they are below the mesh.
 *
 * For a light, rays that come by a back before any front are stopped at the bottom of the relief (stop_from_below).
 *
 * Deviations from the paper: safe steps (search.h); a ray that comes out of its quadric before it leaves the mesh is
 * searched once more, by what the mesh itself says (entry.h, follow_mesh); the tile sizes are gradients of u and v,
 * which also hold where u and v are not at right angles; the normal follows the quadric; the second search for shadows,
 * which the paper gives up for the light's map on curved surfaces, goes by the quadric of the point's own entry.
 *
 * faces, projected, vertices: entry.h. list, starts: raster/bins.cl, of fronts and backs where quadrics bend. texels,
 * bounds, levels: search.h. colors: lib/texture.h. normal_map: (normal_height, normal_width, 3), where > 0, with its
 * pyramid. How often both are read: lib/footprint.h. What a light does: sight.h.
 * counts: (height, width, 2) searches and their steps, with COUNTERS. places: (height, width, 2) u and v of what
 * is seen, in 0 to 1, NaN where nothing is, with UV_WRITTEN.
 * Work-item: a region (raster/region.h). Cost: O(list + pixels * layers * steps). Determinism: list order.
 */
#define KEEPS_UV 1
#include "raster/region.h"
#include "relief/entry.h"
#include "relief/shading_point.h"
#include "relief/shadows.h"

#ifndef UV_WRITTEN
#define UV_WRITTEN 0 /* 1: where on the surface each pixel is, is written, too */
#endif

#ifndef DEPTH_ALONE
#define DEPTH_ALONE 0 /* 1: colours do not count, as of a light's map */
#endif

/* Entries of a region's pixels */
typedef struct {
    floatl first[BLOCKS], second[BLOCKS]; /* nearness of the nearest two so far */
    intl entered[BLOCKS];                 /* triangle of the first, -1: none */
    floatl beyond[BLOCKS];                /* entries up to this one have been searched */
    intl beyond_index[BLOCKS];
    floatl t[BLOCKS];                     /* from the entry to what is seen, in scene units */
    floatl share[BLOCKS];                 /* of the quadric's bending that what is seen was found by */
    intl escaped[BLOCKS];                    /* by its quadric the ray from the first entry came out */
    floatl leaves[BLOCKS];                /* nearness of the back by which a ray leaves the mesh; EMPTY: nowhere */
    intl left_by[BLOCKS];                 /* its triangle */
} Layers;

typedef struct {
    Relief relief;
    float nearest_w;
    int x, y;   /* the region's first pixel */
    int culled; /* CULLS_BACKS: fronts are listed, where rays enter; CULLS_FRONTS: backs, where lost rays leave */
    Layers *layers;
    global int *counters;
} Context;

typedef Triangles Primitives;

intl set_up(const Context *context, intl index, int x, int y, Primitives *t)
{
    return set_up_triangles(context->relief.faces, context->relief.projected, index, context->nearest_w, context->culled, x, y, t);
}

/* Where a block's lost rays leave by a triangle's back; of a light's, where they come by one before any front. */
void cover_back(Layers *layers, const Primitives *t, int lane, int block, int first_x, int first_y)
{
    floatl n;
    if (!DEPTH_ALONE && !any_lane(layers->escaped[block]))
        return;
    const intl covered = covered_by(t, lane, first_x, first_y, &n);
    const intl wanted = DEPTH_ALONE ? n > layers->first[block] : layers->escaped[block] & (n < layers->first[block]);
    const intl next = covered & wanted & (n > layers->leaves[block]);
    layers->leaves[block] = pick(next, n, layers->leaves[block]);
    layers->left_by[block] = pick(next, (intl)int_lane(t->index, lane), layers->left_by[block]);
}

void cover(const Context *context, const Primitives *t, int lane, Region *region, int block, int first_x, int first_y)
{
    floatl n;
    Layers *layers = context->layers;
    const int index = int_lane(t->index, lane);
    if (context->culled == CULLS_FRONTS) {
        cover_back(layers, t, lane, block, first_x, first_y);
        return;
    }
    const floatl first = layers->first[block], second = layers->second[block], beyond = layers->beyond[block];
    const intl covered = covered_by(t, lane, first_x, first_y, &n);
    const intl seen = covered & (n <= context->relief.screen.nearest) & (n > region->nearness[block]) &
                      ((n < beyond) | ((n == beyond) & (layers->beyond_index[block] < index)));
    const intl nearer = seen & (n > first);
    layers->second[block] = pick(nearer, first, pick(seen & (n > second), n, second));
    layers->first[block] = pick(nearer, n, first);
    layers->entered[block] = pick(nearer, (intl)index, layers->entered[block]);
}

#define FRAGMENTS 1
#include "raster/list.h"

/* Where a block's rays enter, in the world, and in which direction */
typedef struct {
    Vector from, direction;
    floatl share; /* of the quadric's bending that they follow */
} EntryRay;

/* Sets up a search by the rays of a block's pixels that enter a triangle; `again`: by those that were lost and are still
 * below the mesh, up to where they leave it. */
EntryRay begin_search(const Context *context, int block, int again, Search *s)
{
    const Relief *relief = &context->relief;
    const Layers *layers = context->layers;
    const floatl x = to_floatl(context->x + FIRST_X(block) + block_x), y = to_floatl(context->y + FIRST_Y(block) + block_y);
    const floatl n = layers->first[block];
    EntryRay entry_ray;
    entry_ray.from = point_at(relief->screen, x, y, n);
#if WITHIN
    entry_ray.direction = ray_direction(relief->screen, x, y); /* the window is too near to tell it */
#else
    entry_ray.direction = view_direction(relief->screen, entry_ray.from);
#endif
    entry_ray.share = 1.0f;
    const intl entered = layers->entered[block], enters = entered >= 0;
    const Entry e = entry_of(relief, pick(enters, entered, (intl)0), x, y);
    set_ray(&s->ray, &e, entry_ray.direction, relief->quadric, relief->scale);
#if DEPTH_ALONE && DISTANCE == APPROXIMATE
    if (relief->quadric)
        follow_circles(&s->ray, &e, entry_ray.direction, relief->scale, enters);
#endif
    s->ray.level = level_of(relief, &e, PIXEL_SIZE(relief, n), enters);
    intl searches = enters;
    floatl longest = INFINITY;
    if (again || WITHIN) {
        const intl leaves = layers->escaped[block] & (layers->leaves[block] > EMPTY);
        const Vector through = minus(point_at(relief->screen, x, y, pick(leaves, layers->leaves[block], n)), entry_ray.from);
        const floatl distance = sqrt(DOT(through, through));
        if (again) {
            const Entry exit = entry_of(relief, pick(leaves, layers->left_by[block], (intl)0), x, y);
            longest = distance;
            const floatl slope = DOT(entry_ray.direction, exit.normal) / relief->scale;
            searches = leaves & follow_mesh(&s->ray, distance, slope, &entry_ray.share);
        } else {
            longest = pick(leaves & (ENTRY_DEPTH(&e) > 0.0f), distance, longest);
        }
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
void count_steps(const Context *context, int block, const Search *s)
{
    for (int lane = 0; lane < LANES; lane++) {
        const long at = pixel_of(context->relief.screen, context->x + FIRST_X(block), context->y + FIRST_Y(block), lane);
        if (at >= 0 && int_lane(s->searches, lane)) {
            context->counters[2 * at]++;
            context->counters[2 * at + 1] += int_lane(s->taken, lane);
        }
    }
}
#endif

/* Takes over what a search has found. Which pixels are to be searched from their next entry on? */
intl keep_hits(const Context *context, int block, const Search *s, EntryRay entry_ray, Region *region)
{
    Layers *layers = context->layers;
    const floatl t = s->t, so_far = region->nearness[block];
    const Vector hit = {entry_ray.from.x + t * entry_ray.direction.x, entry_ray.from.y + t * entry_ray.direction.y, entry_ray.from.z + t * entry_ray.direction.z};
    const floatl nearness = nearness_of(context->relief.screen, hit);
    const intl entered = layers->entered[block], nearer = s->searches & s->found & (nearness > so_far);
    region->nearness[block] = pick(nearer, nearness, so_far);
    region->owner[block] = pick(nearer, entered, region->owner[block]);
    layers->t[block] = pick(nearer, t, layers->t[block]);
    layers->share[block] = pick(nearer, entry_ray.share, layers->share[block]);
    layers->escaped[block] = s->searches & !s->found;
    region->u[block] = pick(nearer, s->ray.u + s->ray.du * t, region->u[block]);
    region->v[block] = pick(nearer, s->ray.v + s->ray.dv * t, region->v[block]);
    const intl more = (entered >= 0) & (layers->second[block] > region->nearness[block]);
    layers->beyond[block] = pick(more, layers->first[block], (floatl)-INFINITY);
    layers->beyond_index[block] = entered;
    return more;
}

/* Searches from the first entries of INTERLEAVED blocks; `again`: see begin_search. Are there more? */
int search_blocks(const Context *context, int block, int again, Region *region)
{
    Search searches[INTERLEAVED];
    EntryRay entry_rays[INTERLEAVED];
    int any = 0, more = 0;
    for (int k = 0; k < INTERLEAVED; k++) {
        entry_rays[k] = begin_search(context, block + k, again, &searches[k]);
        any |= any_lane(searches[k].active);
    }
    if (again && !any)
        return 0;
    search_relief(&context->relief, searches, INTERLEAVED);
    for (int k = 0; k < INTERLEAVED; k++) {
        more |= any_lane(keep_hits(context, block + k, &searches[k], entry_rays[k], region));
#if COUNTERS
        count_steps(context, block + k, &searches[k]);
#endif
    }
    return more;
}

/* Where the rays of all blocks leave the mesh, as cover_back asks; first, last: of the list */
void find_backs(const Context *context, Region *region, global const int *list, int first, int last)
{
    Context backs = *context;
    backs.culled = CULLS_FRONTS;
    draw_list(&backs, region, list, first, last, context->x, context->y);
}

#if DEPTH_ALONE
/* A light's rays that come by a back before any front come from below, as from behind a wall, or from within a tube that
 * is open: the relief stops them at its bottom, before all that it carries. first, last: of the list */
void stop_from_below(const Context *context, Region *region, global const int *list, int first, int last)
{
    const Relief *relief = &context->relief;
    Layers *layers = context->layers;
    for (int block = 0; block < BLOCKS; block++)
        layers->leaves[block] = EMPTY;
    find_backs(context, region, list, first, last);
    for (int block = 0; block < BLOCKS; block++) {
        const intl leaves = layers->leaves[block] > EMPTY;
        if (!any_lane(leaves))
            continue;
        const floatl x = to_floatl(context->x + FIRST_X(block) + block_x), y = to_floatl(context->y + FIRST_Y(block) + block_y);
        const intl left_by = pick(leaves, layers->left_by[block], (intl)0);
        const Vector from = point_at(relief->screen, x, y, pick(leaves, layers->leaves[block], (floatl)1.0f));
        const Vector back = scaled(view_direction(relief->screen, from), (floatl)-1.0f); /* the other way round, it enters there */
        const Entry e = entry_of(relief, left_by, x, y);
        ReliefRay ray;
        set_ray(&ray, &e, back, relief->quadric, relief->scale);
#if DISTANCE == APPROXIMATE
        if (relief->quadric)
            follow_circles(&ray, &e, back, relief->scale, leaves);
#endif
        mask_inactive(&ray, leaves & is_finite_ray(&ray));
        set_end(&ray);
        const Vector bottom = {from.x + ray.end * back.x, from.y + ray.end * back.y, from.z + ray.end * back.z};
        const floatl nearness = nearness_of(relief->screen, bottom);
        const intl before = relief->screen.perspective ? (nearness > 0.0f) & (nearness <= relief->screen.nearest) : leaves;
        const intl stops = leaves & ray.at_bottom & before & (nearness > region->nearness[block]);
        region->nearness[block] = pick(stops, nearness, region->nearness[block]);
        region->owner[block] = pick(stops, left_by, region->owner[block]);
    }
}
#endif

/* Searches from the nearest entries that have not been searched, by their quadrics; then, of the rays that were lost, by
 * the mesh, but not for a light: what is guessed too near would shade what is lit. Rays that start within the relief are
 * searched as far as they are below the mesh. first, last: of the list. Are there more? */
int search_layer(const Context *context, Region *region, global const int *list, int first, int last)
{
    Layers *layers = context->layers;
    int more = 0, escaped = 0;
    for (int block = 0; block < BLOCKS; block++) {
        layers->beyond[block] = -INFINITY;
        layers->escaped[block] = WITHIN ? layers->entered[block] >= 0 : (intl)0;
        layers->leaves[block] = EMPTY;
    }
    if (WITHIN)
        find_backs(context, region, list, first, last);
    for (int block = 0; block < BLOCKS; block += INTERLEAVED) {
        int any = 0;
        for (int k = 0; k < INTERLEAVED; k++)
            any |= any_lane(layers->entered[block + k] >= 0);
        if (any)
            more |= search_blocks(context, block, 0, region);
        for (int k = 0; k < INTERLEAVED; k++)
            escaped |= any_lane(layers->escaped[block + k]);
    }
    if (!escaped || DEPTH_ALONE)
        return more;
    if (!WITHIN)
        find_backs(context, region, list, first, last);
    for (int block = 0; block < BLOCKS; block += INTERLEAVED) {
        int any = 0;
        for (int k = 0; k < INTERLEAVED; k++)
            any |= any_lane(layers->escaped[block + k] & (layers->leaves[block + k] > EMPTY));
        if (any)
            more |= search_blocks(context, block, 1, region);
    }
    return more;
}

/* What the pixels see, layer by layer; first, last: of the list */
void search_layers(const Context *context, Region *region, global const int *list, int first, int last)
{
    Layers *layers = context->layers;
    for (int block = 0; block < BLOCKS; block++) {
        layers->t[block] = 0.0f;
        layers->share[block] = 1.0f;
        layers->beyond[block] = INFINITY;
        layers->beyond_index[block] = -1;
    }
    /* Of each triangle of the list, a pixel has one entry. */
    for (int again = 1, most = last - first; again && most > 0; most--) {
        for (int block = 0; block < BLOCKS; block++) {
            layers->first[block] = layers->second[block] = EMPTY;
            layers->entered[block] = -1;
        }
        draw_list(context, region, list, first, last, context->x, context->y);
#if DEPTH_ALONE
        if (most == last - first)
            stop_from_below(context, region, list, first, last);
#endif
        again = search_layer(context, region, list, first, last);
    }
}

#if UV_WRITTEN
/* Writes where on the map a block's pixels see the relief; x, y: its first pixel. */
void write_uv(const Region *region, int block, Screen screen, int x, int y, global float *uvs)
{
    for (int lane = 0; lane < LANES; lane++) {
        const long at = pixel_of(screen, x, y, lane);
        const float2 uv = {float_lane(region->u[block], lane), float_lane(region->v[block], lane)};
        const float2 in_map = {CLAMPED_U ? clamp(uv.x, 0.0f, 1.0f) : uv.x - floor(uv.x),
                               CLAMPED_V ? clamp(uv.y, 0.0f, 1.0f) : uv.y - floor(uv.y)};
        if (at >= 0)
            vstore2(int_lane(region->owner[block], lane) >= 0 ? in_map : (float2)(NAN), at, uvs);
    }
}
#endif

kernel void draw_relief(global const int *faces, global const float *projected, global const int *list,
                        global const int *starts, int bins_x, global const float *vertices, global const uint *texels,
                        global const uint *bounds, global const int *levels, int level_count,
                        global const uint *colors, int color_width, int color_height, int color_levels,
                        global float *depth, global channel *color, global uchar *valid, Screen screen,
                        float nearest_w, float scale, float pixel_size, int quadric, int search, int steps,
                        int halvings, int blank ANISOTROPY_PARAMETER
#if LIT
                        ,
                        global const float *normal_map, int normal_width, int normal_height,
                        Light light SHADOW_PARAMETERS
#endif
#if SHADOWED
                        ,
                        int hidden_by, int flat_base
#endif
                        COUNTERS_PARAMETER(int)
#if UV_WRITTEN
                        ,
                        global float *uvs
#endif
)
{
    const int x = get_global_id(0) * REGION, y = get_global_id(1) * REGION;
    if (x >= screen.width || y >= screen.height)
        return;
    Layers layers;
    const Relief relief = {faces, projected, vertices, texels, bounds, levels, level_count, screen, scale, pixel_size,
                           quadric, search, steps, halvings};
    const Context context = {relief, nearest_w, x, y, CULLS_BACKS, &layers, COUNTERS_ARGUMENT(int)};
    const int bin = y / BIN * bins_x + x / BIN;
    const int first = starts[bin], last = starts[bin + 1];
    if (!UV_WRITTEN && first == last) {
        if (blank)
            clear_region(screen, depth, color, valid, x, y);
        return;
    }
    Region region;
    begin_region(&region, screen, depth, blank, x, y);
    search_layers(&context, &region, list, first, last);

    for (int block = 0; block < BLOCKS; block++) {
        const intl owner = region.owner[block], mine = owner >= 0;
        if (!blank && !any_lane(mine))
            continue;
        const int first_x = x + FIRST_X(block), first_y = y + FIRST_Y(block);
        Color shade = {0.0f, 0.0f, 0.0f};
        if (!DEPTH_ALONE && any_lane(mine)) {
            const floatl u = pick(mine, region.u[block], (floatl)0.0f), v = pick(mine, region.v[block], (floatl)0.0f);
            const floatl px = to_floatl(first_x + block_x), py = to_floatl(first_y + block_y), n = region.nearness[block];
            const Entry e = flattened(entry_of(&relief, pick(mine, owner, (intl)0), px, py), layers.share[block]);
            const floatl size = PIXEL_SIZE(&relief, n);
#if LIT || ANISOTROPIC
            const floatl t = pick(mine, layers.t[block], (floatl)0.0f);
            const ShadingPoint shading = shading_point_at(&relief, &e, px, py, n, u, v, t, mine);
#endif
#if ANISOTROPIC
            const UvSteps over = relief_uv_steps(&relief, &e, &shading, n, anisotropy);
            const Footprint f = footprint_of(over, color_width, color_height, mine);
#else
            const Footprint f = even_footprint(texels_of(&e, color_width, color_height, size, mine));
#endif
            add_footprint(colors, u, v, f, level_of_texels(f.texels_2, color_levels), color_width, color_height, 1.0f / 255.0f,
                          &shade);
#if LIT
            /* Of the surface itself: no map decides what hides it from the light. */
            const Vector own = relief_normal_by_slope(shading.normal, &e, texels, shading.track, scale);
            Vector normal = own;
            if (normal_width > 0) {
#if ANISOTROPIC
                const Vector mapped = mean_normal(normal_map, normal_width, normal_height, shading.place.u, shading.place.v, over, mine);
#else
                const Vector mapped = normal_in(normal_map, normal_width, normal_height, 0, shading.place.u, shading.place.v);
#endif
                normal = relief_normal_by_map(shading.normal, &e, mapped);
            }
            floatl visible = 1.0f;
#if SHADOWED
            const intl faces = mine & (DOT(normal, to_light(light, shading.point).direction) > 0.0f);
            visible = in_sight(&relief, &e, &shading, own, light, faces, hidden_by, flat_base, shadow_maps, shadow);
#endif
            apply_light(&shade, light, shading.point, normal, shading.ahead, visible);
#endif
        }
#if UV_WRITTEN
        write_uv(&region, block, screen, first_x, first_y, uvs);
#endif
        write_block(&region, block, screen, depth, color, valid, blank, first_x, first_y, shade);
    }
}
