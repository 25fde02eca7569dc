/* Relief mapping on a mesh, with true silhouettes and depth (Oliveira & Policarpo 2005).
 *
 * A pixel's ray enters the relief at the mesh. There the vertices' frames and quadrics are interpolated, and the ray is
 * followed in texture space (search.h) until it meets the relief or comes out again beside the silhouette. It may then
 * enter elsewhere: a region's pixels are searched layer by layer, nearest entry first, for as long as an entry lies
 * nearer than what has been found. All lanes of a block search at once, whichever triangles they entered.
 *
 * Deviations from the paper: safe steps (search.h); the tile sizes are gradients of u and v, which also hold where u and
 * v are not at right angles; the normal follows the quadric.
 *
 * faces: (triangles, 3) corners of each. projected: (vertices, 4), raster/project.cl. list, starts: raster/bins.cl.
 * vertices: (vertices, VERTEX) u, v, normal, gradient of u, gradient of v (world, per scene unit), a, b, unused. texels, bounds,
 * levels: search.h. colors: lib/texture.h. normal_map: (normal_height, normal_width, 3), where > 0.
 * counts: (height, width, 2) searched entries and their steps, with COUNTED. places: (height, width, 2) u and v of what
 * is seen, in the tile, NaN where nothing is, with TOLD.
 * Work-item: a region (raster/region.h). Cost: O(list + pixels * layers * steps). Determinism: list order.
 */
#define PLACED
#include "lib/light.h"
#include "lib/normals.h"
#include "lib/texture.h"
#include "raster/region.h"
#include "raster/triangle.h"
#include "relief/search.h"

#define VERTEX 16 /* floats of a vertex */
#define LINEAR 0
#define SAFE 1
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
    global const float *projected;
    Screen screen;
    float nearest_w;
    Layers *layers;
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
    const int index = INT_OF(t->index);
    const floatl first = layers->first[block], second = layers->second[block], beyond = layers->beyond[block];
    const intl covered = covered_by(t, lane, first_x, first_y, &n);
    const intl seen = covered & (n <= context->screen.nearest) & (n > region->nearness[block]) &
                      ((n < beyond) | ((n == beyond) & (layers->beyond_index[block] < index)));
    const intl nearer = seen & (n > first);
    layers->second[block] = pick(nearer, first, pick(seen & (n > second), n, second));
    layers->first[block] = pick(nearer, n, first);
    layers->entered[block] = pick(nearer, (intl)index, layers->entered[block]);
}

#include "raster/list.h"

/* What the vertices say where a pixel's ray enters */
typedef struct {
    floatl u, v, nx, ny, nz, ux, uy, uz, wx, wy, wz, a, b; /* n: unit length; w: the gradient of v */
} Entry;

Entry entry_of(global const int *faces, global const float *projected, global const float *vertices, intl index,
               floatl x, floatl y)
{
    const Place place = place_on(faces, projected, index, x, y);
    floatl of_vertex[VERTEX];
    corner_means(vertices, &place, of_vertex);
    const floatl nx = of_vertex[2], ny = of_vertex[3], nz = of_vertex[4];
    const floatl unit = 1.0f / sqrt(greater(nx * nx + ny * ny + nz * nz, (floatl)1e-20f));
    const Entry e = {of_vertex[0], of_vertex[1], nx * unit, ny * unit, nz * unit, of_vertex[5], of_vertex[6],
                     of_vertex[7], of_vertex[8], of_vertex[9], of_vertex[10], of_vertex[11], of_vertex[12]};
    return e;
}

/* The ray in texture space (section 3.4), but for its level and end */
void set_ray(ReliefRay *ray, const Entry *e, Direction d, int quadric, float scale)
{
    const float per_scale = 1.0f / scale;
    const floatl cosine = d.x * e->nx + d.y * e->ny + d.z * e->nz; /* < 0: it enters */
    ray->u = e->u - floor_lanes(e->u);
    ray->v = e->v - floor_lanes(e->v);
    ray->du = d.x * e->ux + d.y * e->uy + d.z * e->uz;
    ray->dv = d.x * e->wx + d.y * e->wy + d.z * e->wz;
    const floatl u_2 = e->ux * e->ux + e->uy * e->uy + e->uz * e->uz;
    const floatl x_2 = ray->du * ray->du / greater(u_2, (floatl)1e-30f); /* of the direction along x */
    const floatl y_2 = greater(1.0f - cosine * cosine - x_2, (floatl)0.0f);
    ray->L = greater(-cosine, (floatl)LEAST_COSINE) * per_scale;
    ray->K = quadric ? (e->a * x_2 + e->b * y_2) * per_scale : (floatl)0.0f;
#if DISTANCE == EXACT
    ray->vz = lesser(cosine, (floatl)-LEAST_COSINE);
    ray->a_xx = quadric ? e->a * x_2 : (floatl)0.0f;
    ray->b_yy = quadric ? e->b * y_2 : (floatl)0.0f;
    ray->aa_xx = e->a * ray->a_xx;
    ray->bb_yy = e->b * ray->b_yy;
    ray->scale = scale;
#endif
}

intl is_sound(const ReliefRay *ray)
{
    return isfinite_lanes(ray->u + ray->v + ray->du + ray->dv + ray->K);
}

/* The level of a map whose texels are as large as a pixel that sees the surface straight on, `size` scene units */
intl level_of(const Entry *e, int width, int height, int level_count, floatl size, intl enters)
{
    const floatl u_2 = e->ux * e->ux + e->uy * e->uy + e->uz * e->uz;
    const floatl v_2 = e->wx * e->wx + e->wy * e->wy + e->wz * e->wz;
    const floatl texels_2 = greater(u_2 * ((float)width * width), v_2 * ((float)height * height)) * size * size;
    return level_of_texels(pick(enters, texels_2, (floatl)1.0f), level_count);
}

#ifdef LIT
/* x and y of the frame in which the quadric is z = a x^2 + b y^2 */
void tangents_of(const Entry *e, Direction *x, Direction *y)
{
    const Direction along = {e->ux, e->uy, e->uz};
    *x = at_unit_length(along);
    y->x = e->ny * x->z - e->nz * x->y;
    y->y = e->nz * x->x - e->nx * x->z;
    y->z = e->nx * x->y - e->ny * x->x;
}

/* The quadric's normal where a ray in direction d is after t */
Direction normal_at(const Entry *e, Direction d, floatl t, int quadric)
{
    Direction x, y, normal = {e->nx, e->ny, e->nz};
    if (!quadric)
        return normal;
    tangents_of(e, &x, &y);
    const floatl along_x = -2.0f * e->a * t * (d.x * x.x + d.y * x.y + d.z * x.z);
    const floatl along_y = -2.0f * e->b * t * (d.x * y.x + d.y * y.y + d.z * y.z);
    normal.x += along_x * x.x + along_y * y.x;
    normal.y += along_x * x.y + along_y * y.y;
    normal.z += along_x * x.z + along_y * y.z;
    return at_unit_length(normal);
}

/* By the heights' slopes, over two texels of the level */
void tilt_by_slope(Direction *normal, const Entry *e, global const uint *texels, Track k, float scale)
{
    const float rise = 0.5f * scale * HEIGHT_UNIT;
    const floatl across = height_in(texels, k.map, k.x + 1.0f, k.y) - height_in(texels, k.map, k.x - 1.0f, k.y);
    const floatl down = height_in(texels, k.map, k.x, k.y + 1.0f) - height_in(texels, k.map, k.x, k.y - 1.0f);
    const floatl du = across * to_floatl(k.map.width) * rise, dv = down * to_floatl(k.map.height) * rise;
    const Direction tilted = {normal->x - du * e->ux - dv * e->wx, normal->y - du * e->uy - dv * e->wy,
                              normal->z - du * e->uz - dv * e->wz};
    *normal = at_unit_length(tilted);
}

/* By a map of unit normals, x along u, y along v, bilinear */
void tilt_by_map(Direction *normal, const Entry *e, global const float *map, int width, int height, floatl u, floatl v)
{
    const Direction part = normal_in(map, width, height, u, v);
    Direction x, y;
    tangents_of(e, &x, &y);
    const floatl turned = pick(e->wx * y.x + e->wy * y.y + e->wz * y.z < 0.0f, (floatl)-1.0f, (floatl)1.0f); /* v may run against y */
    const floatl across = turned * part.y;
    const Direction tilted = {part.z * normal->x + part.x * x.x + across * y.x,
                              part.z * normal->y + part.x * x.y + across * y.y,
                              part.z * normal->z + part.x * x.z + across * y.z};
    *normal = at_unit_length(tilted);
}
#endif

kernel void draw_relief(global const int *faces, global const float *projected, global const int *list,
                        global const int *starts, int bins_x, global const float *vertices, global const uint *texels,
                        global const ushort *bounds, global const int *levels, int level_count,
                        global const uint *colors, int color_width, int color_height, int color_levels,
                        global float *depth, global channel *color, global uchar *valid, Screen screen,
                        float nearest_w, float scale, float pixel_size, int quadric, int search, int steps,
                        int halvings, int blank
#ifdef LIT
                        ,
                        global const float *normal_map, int normal_width, int normal_height,
                        Light light SHADOW_PARAMETERS
#endif
#ifdef COUNTED
                        ,
                        global int *counts
#endif
#ifdef TOLD
                        ,
                        global float *places
#endif
)
{
    const int x = get_global_id(0) * REGION, y = get_global_id(1) * REGION;
    if (x >= screen.width || y >= screen.height)
        return;
    Layers layers;
    const Context context = {faces, projected, screen, nearest_w, &layers};
    const int bin = y / BIN * bins_x + x / BIN;
    const float *m = screen.to_world, *f = screen.from_world;
    Region region;
    begin_region(&region, screen, depth, blank, x, y);
    for (int block = 0; block < BLOCKS; block++) {
        layers.t[block] = 0.0f;
        layers.beyond[block] = INFINITY;
        layers.beyond_index[block] = -1;
    }
    for (int again = starts[bin] < starts[bin + 1]; again;) {
        for (int block = 0; block < BLOCKS; block++) {
            layers.first[block] = layers.second[block] = EMPTY;
            layers.entered[block] = -1;
        }
        draw_list(&context, &region, list, starts[bin], starts[bin + 1], x, y);
        again = 0;
        for (int block = 0; block < BLOCKS; block += TWINS) {
            intl entered[TWINS], searched[TWINS];
            int any = 0;
            for (int k = 0; k < TWINS; k++) {
                entered[k] = layers.entered[block + k];
                any |= any_lane(entered[k] >= 0);
            }
            if (!any) {
                for (int k = 0; k < TWINS; k++)
                    layers.beyond[block + k] = -INFINITY;
                continue;
            }
            Search searches[TWINS];
            floatl X[TWINS], Y[TWINS], Z[TWINS];
            Direction direction[TWINS];
            for (int k = 0; k < TWINS; k++) {
                const int at = block + k;
                const floatl px = to_floatl(x + at % ROW * BLOCK + block_x), py = to_floatl(y + at / ROW * BLOCK + block_y);
                const floatl n = layers.first[at], inverse = 1.0f / (PIXEL_ROW(m, 3, px, py) + n * m[15]);
                X[k] = (PIXEL_ROW(m, 0, px, py) + n * m[3]) * inverse;
                Y[k] = (PIXEL_ROW(m, 1, px, py) + n * m[7]) * inverse;
                Z[k] = (PIXEL_ROW(m, 2, px, py) + n * m[11]) * inverse;
                direction[k] = towards(screen, X[k], Y[k], Z[k]);
                const intl enters = entered[k] >= 0;
                const Entry e = entry_of(faces, projected, vertices, pick(enters, entered[k], (intl)0), px, py);
                set_ray(&searches[k].ray, &e, direction[k], quadric, scale);
                const floatl distance = screen.perspective ? 1.0f / n : (floatl)1.0f;
                searches[k].ray.level = level_of(&e, levels[0], levels[1], level_count, distance * pixel_size, enters);
#ifdef COUNTED
                searches[k].taken = 0;
#endif
                searches[k].active = searched[k] = enters & is_sound(&searches[k].ray);
                rest(&searches[k].ray, searched[k]);
                set_end(&searches[k].ray);
                searches[k].track = track_of(&searches[k].ray, levels);
            }
            if (search == SAFE)
                safe_search(searches, texels, bounds, levels);
            else
                linear_search(searches, texels, steps, halvings);
            for (int k = 0; k < TWINS; k++) {
                const int at = block + k;
                const ReliefRay *ray = &searches[k].ray;
                const floatl t = searches[k].t;
                const floatl hx = X[k] + t * direction[k].x, hy = Y[k] + t * direction[k].y, hz = Z[k] + t * direction[k].z;
                const floatl hit_w = f[8] * hx + f[9] * hy + f[10] * hz + f[11];
                const floatl hit_q = f[12] * hx + f[13] * hy + f[14] * hz + f[15];
                const floatl nearness = hit_q / hit_w, so_far = region.nearness[at];
                const intl nearer = searched[k] & searches[k].found & (nearness > so_far);
                region.nearness[at] = pick(nearer, nearness, so_far);
                region.owner[at] = pick(nearer, entered[k], region.owner[at]);
                layers.t[at] = pick(nearer, t, layers.t[at]);
                region.u[at] = pick(nearer, ray->u + ray->du * t, region.u[at]);
                region.v[at] = pick(nearer, ray->v + ray->dv * t, region.v[at]);
#ifdef COUNTED
                for (int lane = 0; lane < LANES; lane++) {
                    const int at_x = x + at % ROW * BLOCK + lane % BLOCK, at_y = y + at / ROW * BLOCK + lane / BLOCK;
                    if (INT_OF(entered[k]) >= 0 && at_x < screen.width && at_y < screen.height) {
                        const size_t pixel = 2 * ((size_t)at_y * screen.width + at_x);
                        counts[pixel]++;
                        counts[pixel + 1] += INT_OF(searches[k].taken);
                    }
                }
#endif
                const intl more = (entered[k] >= 0) & (layers.second[at] > region.nearness[at]);
                layers.beyond[at] = pick(more, layers.first[at], (floatl)-INFINITY);
                layers.beyond_index[at] = entered[k];
                again |= any_lane(more);
            }
        }
    }

    for (int block = 0; block < BLOCKS; block++) {
        const intl owner = region.owner[block], mine = owner >= 0;
        if (!blank && !any_lane(mine))
            continue;
        const int first_x = block % ROW * BLOCK, first_y = block / ROW * BLOCK;
        Color shade = {0.0f, 0.0f, 0.0f};
        if (any_lane(mine)) {
            const floatl u = pick(mine, region.u[block], (floatl)0.0f), v = pick(mine, region.v[block], (floatl)0.0f);
            const floatl px = to_floatl(x + first_x + block_x), py = to_floatl(y + first_y + block_y);
            const Entry e = entry_of(faces, projected, vertices, pick(mine, owner, (intl)0), px, py);
            const floatl n = region.nearness[block], distance = screen.perspective ? 1.0f / n : (floatl)1.0f;
            add_level(colors, u, v, level_of(&e, color_width, color_height, color_levels, distance * pixel_size, mine),
                      color_width, color_height, 1.0f / 255.0f, &shade);
#ifdef LIT
            const floatl inverse = 1.0f / (PIXEL_ROW(m, 3, px, py) + n * m[15]);
            const floatl X = (PIXEL_ROW(m, 0, px, py) + n * m[3]) * inverse;
            const floatl Y = (PIXEL_ROW(m, 1, px, py) + n * m[7]) * inverse;
            const floatl Z = (PIXEL_ROW(m, 2, px, py) + n * m[11]) * inverse;
            const Direction ahead = towards(screen, X, Y, Z);
            Direction normal = normal_at(&e, ahead, pick(mine, layers.t[block], (floatl)0.0f), quadric);
            ReliefRay place;
            place.u = u - floor_lanes(u);
            place.v = v - floor_lanes(v);
            place.du = place.dv = 0.0f;
            place.level = level_of(&e, levels[0], levels[1], level_count, distance * pixel_size, mine);
            Direction own = normal; /* of the surface itself: no map decides what hides it from the light */
            tilt_by_slope(&own, &e, texels, track_of(&place, levels), scale);
            if (normal_width > 0)
                tilt_by_map(&normal, &e, normal_map, normal_width, normal_height, place.u, place.v);
            else
                normal = own;
            shine(&shade, light, X, Y, Z, normal.x, normal.y, normal.z, -ahead.x, -ahead.y, -ahead.z,
                  VISIBILITY(X, Y, Z, own.x, own.y, own.z));
#endif
        }
#ifdef TOLD
        for (int lane = 0; lane < LANES; lane++) {
            const int at_x = x + first_x + lane % BLOCK, at_y = y + first_y + lane / BLOCK;
            if (at_x >= screen.width || at_y >= screen.height)
                continue;
            const float2 uv = {((const float *)&region.u[block])[lane], ((const float *)&region.v[block])[lane]};
            vstore2(INT_OF(owner) >= 0 ? uv - floor(uv) : (float2)(NAN), (size_t)at_y * screen.width + at_x, places);
        }
#endif
        write_block(&region, block, screen, depth, color, valid, blank, x + first_x, y + first_y, shade);
    }
}
