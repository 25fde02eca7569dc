/* Relief mapping on a mesh, with true silhouettes and depth (Oliveira & Policarpo 2005).
 *
 * A pixel's ray enters the relief at the mesh. There the vertices' frames and quadrics are interpolated, and the ray is
 * followed in texture space (search.h) until it meets the relief or comes out again beside the silhouette. It may then
 * enter elsewhere: a region's pixels are searched layer by layer, nearest entry first, for as long as an entry lies
 * nearer than what has been found. All lanes of a block search at once, whichever triangles they entered.
 *
 * Deviations from the paper: safe steps (search.h); the tile sizes are gradients of u and v, which also hold where u and
 * v are not at right angles; the normal follows the quadric; the second search for shadows, which the paper gives up
 * for the light's map on curved surfaces, goes by the quadric of the point's own entry.
 *
 * faces: (triangles, 3) corners of each. projected: (vertices, 4), raster/project.cl. list, starts: raster/bins.cl.
 * vertices: (vertices, VERTEX) u, v, normal, gradient of u, gradient of v (world, per scene unit), a, b, c, unused. texels, bounds,
 * levels: search.h. colors: lib/texture.h. normal_map: (normal_height, normal_width, 3), where > 0, with its pyramid. How
 * often both are read: lib/footprint.h.
 * counts: (height, width, 2) searched entries and their steps, with COUNTED. places: (height, width, 2) u and v of what
 * is seen, in 0 to 1, NaN where nothing is, with TOLD.
 * Work-item: a region (raster/region.h). Cost: O(list + pixels * layers * steps). Determinism: list order.
 */
#define PLACED 1
#include "lib/footprint.h"
#include "lib/light.h"
#include "raster/region.h"
#include "raster/triangle.h"
#include "relief/search.h"

#ifndef TOLD
#define TOLD 0 /* 1: where on the surface each pixel is, is written, too */
#endif

#ifndef DEPTH_ALONE
#define DEPTH_ALONE 0 /* 1: colours do not count, as of a light's map */
#endif

#define VERTEX 16 /* floats of a vertex */

#define LINEAR 0
#define SAFE 1
#define MAPPED 0
#define SEARCHED 1
#ifndef SHADOWS
#define SHADOWS MAPPED /* what hides the light: what its map says, or SEARCHED: what a second search finds, and the map beyond */
#endif
#define LIFTED 1e-3f /* of the relief's depth: how far above its surface a point is searched from, so that it is not in it */
#define FLAT 1e-5f /* curvature times depth: what bends less is a plane, but for rounding */
#define LEAST_COSINE 1e-3f /* of a ray that enters: at outlines interpolated normals may look away */

/* Entries of a region's pixels */
typedef struct {
    floatl first[BLOCKS], second[BLOCKS]; /* nearness of the nearest two so far */
    intl entered[BLOCKS];                 /* triangle of the first, -1: none */
    floatl beyond[BLOCKS];                /* entries up to this one have been searched */
    intl beyond_index[BLOCKS];
    floatl t[BLOCKS];                     /* from the entry to what is seen, in scene units */
} Layers;

typedef struct {
    global const int *faces;
    global const float *projected, *vertices;
    global const uint *texels;
    global const ushort *bounds;
    global const int *levels;
    int level_count;
    Screen screen;
    float nearest_w, scale, pixel_size;
    int quadric, search, steps, halvings;
    int x, y; /* the region's first pixel */
    Layers *layers;
    global int *counts;
} Context;

typedef Triangles Primitives;

intl set_up(const Context *context, intl index, int x, int y, Primitives *t)
{
    return set_up_triangles(context->faces, context->projected, index, context->nearest_w, 1, x, y, t);
}

void cover(const Context *context, const Primitives *t, int lane, Region *region, int block, int first_x, int first_y)
{
    floatl n;
    Layers *layers = context->layers;
    const int index = int_lane(t->index, lane);
    const floatl first = layers->first[block], second = layers->second[block], beyond = layers->beyond[block];
    const intl covered = covered_by(t, lane, first_x, first_y, &n);
    const intl seen = covered & (n <= context->screen.nearest) & (n > region->nearness[block]) &
                      ((n < beyond) | ((n == beyond) & (layers->beyond_index[block] < index)));
    const intl nearer = seen & (n > first);
    layers->second[block] = pick(nearer, first, pick(seen & (n > second), n, second));
    layers->first[block] = pick(nearer, n, first);
    layers->entered[block] = pick(nearer, (intl)index, layers->entered[block]);
}

#define FRAGMENTS 1
#include "raster/list.h"

/* What the vertices say where a pixel's ray enters */
typedef struct {
    floatl u, v;
    Vector normal, along_u, along_v; /* the normal of unit length, and the gradients of u and v */
    floatl a, b, c;
} Entry;

Entry entry_of(const Context *context, intl index, floatl x, floatl y)
{
    const OnTriangle pixel = on_triangle(context->faces, context->projected, index, x, y);
    floatl of_vertex[VERTEX];
    corner_means(context->vertices, &pixel, of_vertex);
    const Vector normal = {of_vertex[2], of_vertex[3], of_vertex[4]};
    const floatl unit = 1.0f / sqrt(greater(DOT(normal, normal), (floatl)1e-20f));
    const Entry e = {of_vertex[0], of_vertex[1], scaled(normal, unit), {of_vertex[5], of_vertex[6], of_vertex[7]},
                     {of_vertex[8], of_vertex[9], of_vertex[10]}, of_vertex[11], of_vertex[12], of_vertex[13]};
    return e;
}

/* a x^2 + b y^2 + c x y, of one direction, or between two */
INLINED floatl bending(const Entry *e, floatl x, floatl y, floatl other_x, floatl other_y)
{
    return e->a * x * other_x + e->b * y * other_y + 0.5f * e->c * (x * other_y + y * other_x);
}

/* The ray in texture space (section 3.4), but for its level and end */
void set_ray(ReliefRay *ray, const Entry *e, Vector d, int quadric, float scale)
{
    const float per_scale = 1.0f / scale;
    const floatl cosine = DOT(d, e->normal); /* < 0: it enters */
    ray->u = IN_FIRST_TILE(e->u);
    ray->v = IN_FIRST_TILE(e->v);
    ray->du = DOT(d, e->along_u);
    ray->dv = DOT(d, e->along_v);
    const Vector down = cross_of(e->normal, e->along_u);
    const floatl per_u = 1.0f / sqrt(greater(DOT(e->along_u, e->along_u), (floatl)1e-30f));
    const floatl x = ray->du * per_u, y = DOT(d, down) * per_u; /* of the direction */
    ray->L = greater(-cosine, (floatl)LEAST_COSINE) * per_scale;
    const floatl bend = quadric ? bending(e, x, y, x, y) : (floatl)0.0f;
    ray->K = bend * per_scale;
#if DISTANCE != APPROXIMATE
    ray->vz = lesser(cosine, (floatl)-LEAST_COSINE);
#endif
#if DISTANCE == EXACT
    ray->per_scale = per_scale;
    /* The quadric is l1 p^2 + l2 q^2 along its principal directions, l1 >= l2. */
    const floatl bends = quadric ? (floatl)1.0f : (floatl)0.0f, sum = bends * (e->a + e->b), s_2 = x * x + y * y;
    const floatl apart = bends * sqrt((e->a - e->b) * (e->a - e->b) + e->c * e->c); /* l1 - l2 */
    ray->k1 = -sum - apart;
    ray->k2 = apart - sum;
    const floatl first = (bend - 0.5f * (sum - apart) * s_2) / greater(apart, (floatl)1e-20f);
    ray->w1 = lesser(greater(first, (floatl)0.0f), s_2);
    ray->w2 = s_2 - ray->w1;
#elif DISTANCE == PERPENDICULAR
    ray->bend = bend;
    ray->scale = scale;
#endif
}

intl is_sound(const ReliefRay *ray)
{
    return isfinite_lanes(ray->u + ray->v + ray->du + ray->dv + ray->K);
}

/* The square of the texels that a pixel covers along a side where it sees the surface straight on, `size` scene units */
floatl texels_of(const Entry *e, int width, int height, floatl size, intl enters)
{
    const floatl u_2 = DOT(e->along_u, e->along_u);
    const floatl v_2 = DOT(e->along_v, e->along_v);
    const floatl texels_2 = greater(u_2 * ((float)width * width), v_2 * ((float)height * height)) * size * size;
    return pick(enters, texels_2, (floatl)1.0f);
}

/* The level of the heights whose texels are as large as such a pixel. Where the surface bends, so that rays may come out
 * again, no level that loses more than a pixel of the relief's height: outlines stay. */
intl level_of(const Context *context, const Entry *e, floatl size, intl enters)
{
    intl level = level_of_texels(texels_of(e, context->levels[0], context->levels[1], size, enters), context->level_count);
    const intl bends = (fabs(e->a) + fabs(e->b) + fabs(e->c)) * (context->quadric * context->scale) > FLAT;
    for (int l = 1; l < context->level_count && any_lane(level >= l); l++) {
        const float lost = context->scale * (1.0f / 65535.0f) * context->levels[l * TABLE + LOST];
        level = pick(bends & (size < lost), min(level, (intl)(l - 1)), level);
    }
    return level;
}

/* The scene units that a pixel takes at nearness n */
#define PIXEL_SIZE(context, n)                                                                                 \
    (((context)->screen.perspective ? 1.0f / (n) : (floatl)1.0f) * (context)->pixel_size)

#if LIT || ANISOTROPIC
/* What a point is seen by: its place on the maps, and the ray that has found it, t after its entry */
typedef struct {
    ReliefRay place; /* u, v, level */
    Track track;
    Vector ahead, point;
    Vector normal; /* of the quadric */
    floatl t;
} Seen;

/* x and y of the frame in which the quadric is z = a x^2 + b y^2 + c x y */
INLINED void tangents_of(const Entry *e, Vector *x, Vector *y)
{
    *x = at_unit_length(e->along_u);
    *y = cross_of(e->normal, *x);
}

/* The quadric's normal where a ray in direction d is after t */
INLINED Vector normal_at(const Entry *e, Vector d, floatl t, int quadric)
{
    Vector x, y, normal = e->normal;
    if (!quadric)
        return normal;
    tangents_of(e, &x, &y);
    const floatl px = t * DOT(d, x), py = t * DOT(d, y);
    const floatl along_x = -2.0f * bending(e, px, py, 1.0f, 0.0f), along_y = -2.0f * bending(e, px, py, 0.0f, 1.0f);
    normal.x += along_x * x.x + along_y * y.x;
    normal.y += along_x * x.y + along_y * y.y;
    normal.z += along_x * x.z + along_y * y.z;
    return at_unit_length(normal);
}

/* A normal tilted by how much the height rises over a texel, along u and along v, in HEIGHT_UNITs; not of unit length */
INLINED Vector tilted_by_rises(Vector normal, const Entry *e, HeightMap map, floatl across, floatl down, float scale)
{
    const float rise = scale * HEIGHT_UNIT;
    const floatl du = across * to_floatl(map.width) * rise, dv = down * to_floatl(map.height) * rise;
    const Vector tilted = {normal.x - du * e->along_u.x - dv * e->along_v.x, normal.y - du * e->along_u.y - dv * e->along_v.y,
                           normal.z - du * e->along_u.z - dv * e->along_v.z};
    return tilted;
}

/* Of a block's pixels, (px, py) in the picture */
INLINED Seen seen_at(const Context *context, const Region *region, const Entry *e, int block, floatl px, floatl py)
{
    const intl mine = region->owner[block] >= 0;
    const floatl n = region->nearness[block];
    const floatl u = pick(mine, region->u[block], (floatl)0.0f), v = pick(mine, region->v[block], (floatl)0.0f);
    Seen seen;
    seen.point = point_at(context->screen, px, py, n);
    seen.ahead = towards(context->screen, seen.point);
    seen.t = pick(mine, context->layers->t[block], (floatl)0.0f);
    seen.place.u = IN_FIRST_TILE(u);
    seen.place.v = IN_FIRST_TILE(v);
    seen.place.du = seen.place.dv = 0.0f;
    seen.place.level = level_of(context, e, PIXEL_SIZE(context, n), mine);
    seen.track = track_of(&seen.place, context->levels);
    seen.normal = normal_at(e, seen.ahead, seen.t, context->quadric);
    return seen;
}

#if ANISOTROPIC
/* The rises of the bilinear surface at (x, y) */
INLINED void rises_at(global const uint *texels, HeightMap map, floatl x, floatl y, floatl *across, floatl *down)
{
    FLOOR(x, x0, ix)
    FLOOR(y, y0, iy)
    const intl tx = ON_MAP(x0, ix, map.width, map.per_width), ty = ON_MAP(y0, iy, map.height, map.per_height);
    const Patch p = read_cell(texels, map, ix, iy, tx, ty);
    const floatl twist = p.aa - p.ab - p.ba + p.bb;
    *across = p.ab - p.aa + (y - y0) * twist;
    *down = p.ba - p.aa + (x - x0) * twist;
}

/* By how much u and v change over a pixel: on the plane that touches the relief where the pixel sees it */
INLINED UvSteps steps_on(const Context *context, const Entry *e, const Seen *seen, floatl n, int anisotropy)
{
    floatl across, down;
    rises_at(context->texels, seen->track.map, seen->track.x, seen->track.y, &across, &down);
    const Vector tilted = tilted_by_rises(seen->normal, e, seen->track.map, across, down, context->scale);
    return uv_steps(context->screen, n, seen->ahead, tilted, e->along_u, e->along_v, anisotropy);
}
#endif

#if LIT
/* A normal tilted by the heights' slopes, over two texels of the level */
INLINED Vector tilted_by_slope(Vector normal, const Entry *e, global const uint *texels, Track k, float scale)
{
    const floatl across = height_in(texels, k.map, k.x + 1.0f, k.y) - height_in(texels, k.map, k.x - 1.0f, k.y);
    const floatl down = height_in(texels, k.map, k.x, k.y + 1.0f) - height_in(texels, k.map, k.x, k.y - 1.0f);
    return at_unit_length(tilted_by_rises(normal, e, k.map, 0.5f * across, 0.5f * down, scale));
}

/* A normal tilted by one of a map, x along u, y along v */
INLINED Vector tilted_by_map(Vector normal, const Entry *e, Vector part)
{
    Vector x, y;
    tangents_of(e, &x, &y);
    const floatl across = pick(DOT(e->along_v, y) < 0.0f, (floatl)-1.0f, (floatl)1.0f) * part.y; /* v may run against y */
    const Vector tilted = {part.z * normal.x + part.x * x.x + across * y.x, part.z * normal.y + part.x * x.y + across * y.y,
                           part.z * normal.z + part.x * x.z + across * y.z};
    return at_unit_length(tilted);
}
#endif
#endif

/* Where a block's rays enter, in the world, and in which direction */
typedef struct {
    Vector from, way;
} Entrance;

/* Sets up a search by the rays of a block's pixels that enter a triangle. */
Entrance set_out(const Context *context, int block, Search *s)
{
    const floatl x = to_floatl(context->x + FIRST_X(block) + block_x), y = to_floatl(context->y + FIRST_Y(block) + block_y);
    const floatl n = context->layers->first[block];
    Entrance entrance;
    entrance.from = point_at(context->screen, x, y, n);
    entrance.way = towards(context->screen, entrance.from);
    const intl entered = context->layers->entered[block], enters = entered >= 0;
    const Entry e = entry_of(context, pick(enters, entered, (intl)0), x, y);
    set_ray(&s->ray, &e, entrance.way, context->quadric, context->scale);
    s->ray.level = level_of(context, &e, PIXEL_SIZE(context, n), enters);
#if COUNTED
    s->taken = 0;
#endif
    s->searches = s->active = enters & is_sound(&s->ray);
    rest(&s->ray, s->active);
    set_end(&s->ray);
    s->track = track_of(&s->ray, context->levels);
    return entrance;
}

#if COUNTED
void count_steps(const Context *context, int block, const Search *s)
{
    for (int lane = 0; lane < LANES; lane++) {
        const long at = pixel_of(context->screen, context->x + FIRST_X(block), context->y + FIRST_Y(block), lane);
        if (at >= 0 && int_lane(context->layers->entered[block], lane) >= 0) {
            context->counts[2 * at]++;
            context->counts[2 * at + 1] += int_lane(s->taken, lane);
        }
    }
}
#endif

/* Takes over what a search has found. Which pixels are to be searched from their next entry on? */
intl take_over(const Context *context, int block, const Search *s, Entrance entrance, Region *region)
{
    Layers *layers = context->layers;
    const float *m = context->screen.from_world;
    const floatl t = s->t, so_far = region->nearness[block];
    const Vector hit = {entrance.from.x + t * entrance.way.x, entrance.from.y + t * entrance.way.y, entrance.from.z + t * entrance.way.z};
    const floatl hit_w = POINT_ROW(m, 2, hit), hit_q = POINT_ROW(m, 3, hit), nearness = hit_q / hit_w;
    const intl entered = layers->entered[block], nearer = s->searches & s->found & (nearness > so_far);
    region->nearness[block] = pick(nearer, nearness, so_far);
    region->owner[block] = pick(nearer, entered, region->owner[block]);
    layers->t[block] = pick(nearer, t, layers->t[block]);
    region->u[block] = pick(nearer, s->ray.u + s->ray.du * t, region->u[block]);
    region->v[block] = pick(nearer, s->ray.v + s->ray.dv * t, region->v[block]);
    const intl more = (entered >= 0) & (layers->second[block] > region->nearness[block]);
    layers->beyond[block] = pick(more, layers->first[block], (floatl)-INFINITY);
    layers->beyond_index[block] = entered;
    return more;
}

/* Searches from the nearest entries that have not been searched. Are there more? */
int search_layer(const Context *context, Region *region)
{
    Layers *layers = context->layers;
    int again = 0;
    for (int block = 0; block < BLOCKS; block += TWINS) {
        int any = 0;
        for (int k = 0; k < TWINS; k++)
            any |= any_lane(layers->entered[block + k] >= 0);
        if (!any) {
            for (int k = 0; k < TWINS; k++)
                layers->beyond[block + k] = -INFINITY;
            continue;
        }
        Search searches[TWINS];
        Entrance entrances[TWINS];
        for (int k = 0; k < TWINS; k++)
            entrances[k] = set_out(context, block + k, &searches[k]);
        if (context->search == SAFE)
            safe_search(searches, context->texels, context->bounds, context->levels);
        else
            linear_search(searches, context->texels, context->steps, context->halvings);
        for (int k = 0; k < TWINS; k++) {
            again |= any_lane(take_over(context, block + k, &searches[k], entrances[k], region));
#if COUNTED
            count_steps(context, block + k, &searches[k]);
#endif
        }
    }
    return again;
}

#if SHADOWED
/* From a point of the relief to the light, as far as the relief around the point reaches */
typedef struct {
    ReliefRay ray;       /* the other way round: from where it leaves the relief down to the point */
    Vector exit, normal; /* where it leaves, and the base's normal there */
    intl sound, leaves;
    floatl way;   /* from the point to there, in scene units */
    floatl apart; /* how far another ray may find what lies at the point from there */
} LightRay;

/* Depths are below the quadric of the point's own entry, by equation 7: the point is on its surface to the last bit,
 * and the light's ray enters where that quadric's depth is 0. */
LightRay light_ray(const Context *context, const Entry *e, const Seen *seen, Vector light)
{
    LightRay made;
    ReliefRay *ray = &made.ray;
    Vector x, y;
    tangents_of(e, &x, &y);
    const float scale = context->scale, per_scale = 1.0f / scale, bends = context->quadric ? 1.0f : 0.0f;
    const floatl t = seen->t;
    const floatl px = t * DOT(seen->ahead, x), py = t * DOT(seen->ahead, y), pz = t * DOT(seen->ahead, e->normal);
    const floatl lx = DOT(light, x), ly = DOT(light, y), lz = DOT(light, e->normal);
    const floatl found = (bends * bending(e, px, py, px, py) - pz) * per_scale;
    const floatl height = HEIGHT_UNIT * height_in(context->texels, seen->track.map, seen->track.x, seen->track.y);
    const floatl depth = greater(1.0f - height - LIFTED, (floatl)0.0f);
    /* Along it, depth is depth + slope s + K s^2. */
    const floatl slope = (2.0f * bends * bending(e, px, py, lx, ly) - lz) * per_scale;
    const floatl K = bends * bending(e, lx, ly, lx, ly) * per_scale;
    const floatl discriminant = slope * slope - 4.0f * K * depth, divisor = sqrt(greater(discriminant, (floatl)0.0f)) - slope;
    made.leaves = (discriminant >= 0.0f) & (divisor > 0.0f);
    const floatl way = pick(made.leaves, 2.0f * depth / divisor, (floatl)0.0f), lift = (found - depth) * scale;
    made.way = way;
    made.exit.x = seen->point.x + lift * e->normal.x + way * light.x;
    made.exit.y = seen->point.y + lift * e->normal.y + way * light.y;
    made.exit.z = seen->point.z + lift * e->normal.z + way * light.z;
    const floatl qx = px + way * lx, qy = py + way * ly; /* of the exit */
    const floatl across = -2.0f * bends * bending(e, qx, qy, 1.0f, 0.0f), down = -2.0f * bends * bending(e, qx, qy, 0.0f, 1.0f);
    const Vector normal = {e->normal.x + across * x.x + down * y.x, e->normal.y + across * x.y + down * y.y,
                           e->normal.z + across * x.z + down * y.z};
    made.normal = at_unit_length(normal);
    ray->du = -DOT(light, e->along_u);
    ray->dv = -DOT(light, e->along_v);
    const floatl u = seen->place.u - ray->du * way, v = seen->place.v - ray->dv * way;
    ray->u = IN_FIRST_TILE(u);
    ray->v = IN_FIRST_TILE(v);
    ray->L = -slope - 2.0f * K * way;
    ray->K = K;
    ray->level = seen->place.level;
#if DISTANCE != APPROXIMATE
    ray->vz = (floatl)0.0f; /* without curvatures its depth is that of equation 7 */
#endif
#if DISTANCE == EXACT
    ray->per_scale = per_scale;
    ray->k1 = ray->k2 = ray->w1 = ray->w2 = (floatl)0.0f;
#elif DISTANCE == PERPENDICULAR
    ray->bend = (floatl)0.0f;
    ray->scale = scale;
#endif
    made.sound = (way > 0.0f) & (ray->L > 0.0f) & is_sound(ray);
    /* Along the surface, before the point and after; another entry's quadric turns by the curvature times that. */
    const floatl came_2 = t * t - pz * pz, goes_2 = way * way * (1.0f - lz * lz);
    const floatl curvature = bends * (fabs(e->a + e->b) + sqrt((e->a - e->b) * (e->a - e->b) + e->c * e->c)); /* the greater */
    made.apart = curvature * depth * scale * sqrt(greater(came_2, goes_2));
    return made;
}

/* Does the relief around the point hide it from the light? The paper's second search (figure 4) */
intl is_hidden(const Context *context, const LightRay *light, intl wanted)
{
    Search searches[TWINS], *s = searches;
    s->ray = light->ray;
    rest(&s->ray, light->sound & wanted);
    set_end(&s->ray);
    s->track = track_of(&s->ray, context->levels);
    /* Up to the point, but for what the searches may err by */
    const floatl per_texel = 1.0f / greater(greater(fabs(s->track.dx), fabs(s->track.dy)), (floatl)1e-20f);
    const floatl end = light->way - 2.0f * NUDGE * per_texel;
    s->ray.at_bottom = s->ray.at_bottom & (s->ray.end < end);
    s->ray.end = lesser(s->ray.end, end);
    s->searches = s->active = light->sound & wanted & (end > 0.0f);
#if COUNTED
    s->taken = 0;
#endif
    for (int k = 1; k < TWINS; k++) {
        searches[k] = searches[0];
        searches[k].active = 0;
    }
    if (context->search == SAFE)
        safe_search(searches, context->texels, context->bounds, context->levels);
    else
        linear_search(searches, context->texels, context->steps, context->halvings);
    return s->searches & s->found;
}

/* How far is a point of the relief in sight of the light, 0 to 1? own: the surface's normal there; faces: where it
 * matters.
 *
 * The light's map has been drawn by its own rays, by the quadrics where these enter. Where the surface bends they find
 * it elsewhere than the picture's rays, and would shade it by itself. So where what the map says depends on that, a
 * search from the point decides what the relief around it hides, and the map what hides the place where it ends. A ray
 * that by the quadric never leaves the relief, as along a saddle, is left to the map. */
floatl in_sight(const Context *context, const Entry *e, const Seen *seen, Vector own, Light light, intl faces SHADOW_PARAMETERS)
{
    intl wanted = faces;
    floatl mapped = 0.0f;
#if SHADOWS == MAPPED
    mapped = visibility(shadow_maps, shadow, seen->point, own);
    wanted = wanted & (mapped < 1.0f);
    if (!context->quadric || !any_lane(wanted))
        return mapped;
#endif
    const LightRay ray = light_ray(context, e, seen, to_light(light, seen->point).way);
    const floatl outside = visibility(shadow_maps, shadow, ray.exit, ray.normal);
#if SHADOWS == MAPPED
    wanted = wanted & ray.leaves & (outside > mapped) & (ray.apart > SHADOW_SLACK * texel_at(shadow, light, seen->point));
#else
    if (any_lane(wanted & !ray.leaves))
        mapped = visibility(shadow_maps, shadow, seen->point, own);
    wanted = wanted & ray.leaves;
#endif
    if (!any_lane(wanted))
        return mapped;
    return pick(wanted, pick(is_hidden(context, &ray, wanted), (floatl)0.0f, outside), mapped);
}
#endif

#if TOLD
/* Writes where on the map a block's pixels see the relief; x, y: its first pixel. */
void tell_places(const Region *region, int block, Screen screen, int x, int y, global float *places)
{
    for (int lane = 0; lane < LANES; lane++) {
        const long at = pixel_of(screen, x, y, lane);
        const float2 uv = {float_lane(region->u[block], lane), float_lane(region->v[block], lane)};
        const float2 in_map = CLAMPED ? clamp(uv, 0.0f, 1.0f) : uv - floor(uv);
        if (at >= 0)
            vstore2(int_lane(region->owner[block], lane) >= 0 ? in_map : (float2)(NAN), at, places);
    }
}
#endif

kernel void draw_relief(global const int *faces, global const float *projected, global const int *list,
                        global const int *starts, int bins_x, global const float *vertices, global const uint *texels,
                        global const ushort *bounds, global const int *levels, int level_count,
                        global const uint *colors, int color_width, int color_height, int color_levels,
                        global float *depth, global channel *color, global uchar *valid, Screen screen,
                        float nearest_w, float scale, float pixel_size, int quadric, int search, int steps,
                        int halvings, int blank ANISOTROPY_PARAMETER
#if LIT
                        ,
                        global const float *normal_map, int normal_width, int normal_height,
                        Light light SHADOW_PARAMETERS
#endif
                        COUNTS_PARAMETER(int)
#if TOLD
                        ,
                        global float *places
#endif
)
{
    const int x = get_global_id(0) * REGION, y = get_global_id(1) * REGION;
    if (x >= screen.width || y >= screen.height)
        return;
    Layers layers;
    const Context context = {faces, projected, vertices, texels, bounds, levels, level_count, screen, nearest_w, scale,
                             pixel_size, quadric, search, steps, halvings, x, y, &layers, COUNTS(int)};
    const int bin = y / BIN * bins_x + x / BIN;
    Region region;
    begin_region(&region, screen, depth, blank, x, y);
    for (int block = 0; block < BLOCKS; block++) {
        layers.t[block] = 0.0f;
        layers.beyond[block] = INFINITY;
        layers.beyond_index[block] = -1;
    }
    /* Of each triangle of the list, a pixel has one entry. */
    for (int again = 1, most = starts[bin + 1] - starts[bin]; again && most > 0; most--) {
        for (int block = 0; block < BLOCKS; block++) {
            layers.first[block] = layers.second[block] = EMPTY;
            layers.entered[block] = -1;
        }
        draw_list(&context, &region, list, starts[bin], starts[bin + 1], x, y);
        again = search_layer(&context, &region);
    }

    for (int block = 0; block < BLOCKS; block++) {
        const intl owner = region.owner[block], mine = owner >= 0;
        if (!blank && !any_lane(mine))
            continue;
        const int first_x = x + FIRST_X(block), first_y = y + FIRST_Y(block);
        Color shade = {0.0f, 0.0f, 0.0f};
        if (!DEPTH_ALONE && any_lane(mine)) {
            const floatl u = pick(mine, region.u[block], (floatl)0.0f), v = pick(mine, region.v[block], (floatl)0.0f);
            const floatl px = to_floatl(first_x + block_x), py = to_floatl(first_y + block_y), n = region.nearness[block];
            const Entry e = entry_of(&context, pick(mine, owner, (intl)0), px, py);
            const floatl size = PIXEL_SIZE(&context, n);
#if LIT || ANISOTROPIC
            const Seen seen = seen_at(&context, &region, &e, block, px, py);
#endif
#if ANISOTROPIC
            const UvSteps over = steps_on(&context, &e, &seen, n, anisotropy);
            const Footprint f = footprint_of(over, color_width, color_height, mine);
#else
            const Footprint f = even_footprint(texels_of(&e, color_width, color_height, size, mine));
#endif
            add_footprint(colors, u, v, f, level_of_texels(f.texels_2, color_levels), color_width, color_height, 1.0f / 255.0f,
                          &shade);
#if LIT
            /* Of the surface itself: no map decides what hides it from the light. */
            const Vector own = tilted_by_slope(seen.normal, &e, texels, seen.track, scale);
            Vector normal = own;
            if (normal_width > 0) {
#if ANISOTROPIC
                const Vector mapped = mean_normal(normal_map, normal_width, normal_height, seen.place.u, seen.place.v, over, mine);
#else
                const Vector mapped = normal_in(normal_map, normal_width, normal_height, 0, seen.place.u, seen.place.v);
#endif
                normal = tilted_by_map(seen.normal, &e, mapped);
            }
            floatl visible = 1.0f;
#if SHADOWED
            const intl faces = mine & (DOT(normal, to_light(light, seen.point).way) > 0.0f);
            visible = in_sight(&context, &e, &seen, own, light, faces, shadow_maps, shadow);
#endif
            shine(&shade, light, seen.point, normal, seen.ahead, visible);
#endif
        }
#if TOLD
        tell_places(&region, block, screen, first_x, first_y, places);
#endif
        write_block(&region, block, screen, depth, color, valid, blank, first_x, first_y, shade);
    }
}
