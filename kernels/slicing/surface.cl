/* Displacement mapping by slices (Kautz & Seidel 2001, section 3).
 *
 * Each triangle of the base, extruded along its corners' normals, is a prism, and a prism three tetrahedra. In a
 * tetrahedron texture coordinates and height are affine, hence along a ray linear in its z, and so is the coordinate
 * that numbers the slices: a slice is where it is a whole number. A pixel walks the slices of its part of the ray from
 * front to back and stops at the first that passes the alpha test.
 *
 * UNCLIPPED: slices parallel to the screen are tested all over the box of each tetrahedron, not only inside.
 *
 * Deviations from the paper: slices are met per pixel instead of drawn as polygons; where a ray enters or leaves
 * through the base, the base is tested as a slice is, so that no view sees through flat parts between two slices.
 *
 * corners: (tetrahedra, 4) of projected, three in a row for each triangle. places: (vertices, 3) u, v (tiled) and
 * height. points: (vertices, 3) world. frames: (triangles, 3, 3) the slicing directions a (normal), b, c: unit length.
 * heights: (map_height, map_width), heights.h. colors: lib/texture.h. gradients:
 * (triangles, 2, 3) of u and v in the world, tiled. normals: (vertices of the base, 3). spacing: of the slices,
 * in the world. slices: of direction a. counts: (height, width) alpha tests, with COUNTED.
 * Work-item: a region (raster/region.h). Cost: O(list + pixels * slices met). Determinism: list order.
 */
#define PLACED
#include "lib/light.h"
#include "lib/normals.h"
#include "lib/texture.h"
#include "raster/region.h"
#include "slicing/heights.h"

#define SURFACE 0
#define ORTHOGONAL 1
#define SCREEN 2
#define GROWN 1e-5f /* of a tetrahedron, by which its sides are moved outwards */
#define THIN 1e-4f /* slices: rounding of where a ray enters and leaves a tetrahedron */

typedef struct {
    global const int *corners;
    global const float *projected, *points, *places, *frames;
    global const uint *heights;
    Screen screen;
    float nearest_w, spacing;
    int slices, slicing, test, map_width, map_height;
#ifdef COUNTED
    global int *counts;
    int x, y;
#endif
} Context;

/* Along a ray, a quantity is `fixed` + `sloped` z; in a perspective picture fixed is the same for all pixels, in an
 * orthographic one sloped. Per pixel: x px + y py + one. */
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
Quantity blend(const Quantity *rows, float4 values)
{
    Quantity made;
    made.x = rows[0].x * values.x + rows[1].x * values.y + rows[2].x * values.z + rows[3].x * values.w;
    made.y = rows[0].y * values.x + rows[1].y * values.y + rows[2].y * values.z + rows[3].y * values.w;
    made.one = rows[0].one * values.x + rows[1].one * values.y + rows[2].one * values.z + rows[3].one * values.w;
    made.n = rows[0].n * values.x + rows[1].n * values.y + rows[2].n * values.z + rows[3].n * values.w;
    return made;
}

/* A quantity along a pixel's ray: fixed + sloped z */
typedef struct {
    floatl fixed, sloped;
} Line;

#define AT(line, z) ((line).fixed + (line).sloped * (z))

/* Its box in the region: (low_x, high_x, low_y, high_y); empty if it cannot be seen */
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
        low = clamp(ceil(low - 1e-3f), 0.0f, (float)REGION);
        high = clamp(floor(high + 1e-3f), -1.0f, REGION - 1.0f);
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
    t->u = blend(t->rows, (float4)(place[0].x, place[1].x, place[2].x, place[3].x));
    t->v = blend(t->rows, (float4)(place[0].y, place[1].y, place[2].y, place[3].y));
    t->h = blend(t->rows, (float4)(place[0].z, place[1].z, place[2].z, place[3].z));
    t->perspective = context->screen.perspective;

    int direction = 0; /* a */
    const float3 a = vload3(index / 3 * 3, context->frames);
    float3 d = a;
    if (context->slicing == ORTHOGONAL) { /* the direction that faces the viewer most */
        const float *m = context->screen.to_world;
        const float3 eye = (float3)(m[3], m[7], m[11]);
        const float3 view = t->perspective ? middle - eye / m[15] : eye;
        float most = fabs(dot(a, view));
        for (int k = 1; k < 3; k++) {
            const float3 other = vload3(index / 3 * 3 + k, context->frames);
            if (fabs(dot(other, view)) > most) {
                most = fabs(dot(other, view));
                direction = k;
                d = other;
            }
        }
    }
    if (context->slicing == SCREEN) {
        const float along = 1.0f / context->spacing;
        t->slice = t->perspective ? (Quantity){0.0f, 0.0f, along, 0.0f} : (Quantity){0.0f, 0.0f, 0.0f, -along};
    } else if (direction == 0) {
        t->slice = t->h;
        t->slice.x *= context->slices;
        t->slice.y *= context->slices;
        t->slice.one *= context->slices;
        t->slice.n *= context->slices;
    } else {
        const float4 values = (float4)(dot(point[0], d), dot(point[1], d), dot(point[2], d), dot(point[3], d));
        t->slice = blend(t->rows, values / context->spacing);
    }
    const float grown = crosses ? 0.0f : GROWN / p[0].z; /* no gap between neighbours by rounding */
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
    t->nearest = t->front = context->screen.nearest;
    if (!crosses)
        t->front = fmax(fmax(p[0].w / p[0].z, p[1].w / p[1].z), fmax(p[2].w / p[2].z, p[3].w / p[3].z));
    t->rear = t->perspective ? 0.0f : -INFINITY;
    if (!crosses)
        t->rear = fmin(fmin(p[0].w / p[0].z, p[1].w / p[1].z), fmin(p[2].w / p[2].z, p[3].w / p[3].z));
    t->crosses = crosses;
    const float slack = 1e-4f * (t->front - t->rear) + 2e-6f * fmax(fabs(t->front), fabs(t->rear));
    t->first = crosses ? t->rear : t->rear - slack;
    t->last = crosses ? t->nearest : fmin(t->front + slack, t->nearest);
    t->index = index;
    return box;
}

intl set_up(const Context *context, intl index, int x, int y, Primitives *made)
{
    for (int lane = 0; lane < LANES; lane++) {
        const int4 box = set_up_one(context, ((const int *)&index)[lane], x, y, &made->of[lane]);
        ((int *)&made->low_x)[lane] = box.x;
        ((int *)&made->high_x)[lane] = box.y;
        ((int *)&made->low_y)[lane] = box.z;
        ((int *)&made->high_y)[lane] = box.w;
    }
    return made->low_x <= made->high_x;
}

Line line_of(const Tetrahedron *t, Quantity q, floatl x, floatl y)
{
    const floatl at = q.x * x + (q.y * y + q.one);
    Line line;
    line.fixed = t->perspective ? (floatl)q.n : at;
    line.sloped = t->perspective ? at : (floatl)(-q.n);
    return line;
}

/* What a block's rays have met */
typedef struct {
    Line u, v, h; /* along the rays */
    intl found;
    floatl z;
} Search;

/* The alpha test at z, where `tries`; it cannot pass where not `inside` */
void try_at(const Context *context, int block, Search *search, floatl z, intl tries, intl inside)
{
    if (!any_lane(tries))
        return;
    const floatl alpha = height_at(context->heights, context->map_width, context->map_height, AT(search->u, z), AT(search->v, z));
    const floatl h = greater(AT(search->h, z), (floatl)0.0f);
    const intl passed = tries & inside & passes(context->test, alpha, h, 1.0f / context->slices);
    search->z = pick(passed, z, search->z);
    search->found = search->found | passed;
#ifdef COUNTED
    for (int lane = 0; lane < LANES; lane++) {
        const int px = context->x + block % ROW * BLOCK + lane % BLOCK, py = context->y + block / ROW * BLOCK + lane / BLOCK;
        if (((const int *)&tries)[lane] && px < context->screen.width && py < context->screen.height)
            context->counts[(size_t)py * context->screen.width + px]++;
    }
#endif
}

void cover(const Context *context, const Primitives *made, int lane, Region *region, int block, int first_x, int first_y)
{
    const Tetrahedron *t = &made->of[lane];
    if (t->front <= region->farthest[block])
        return;
#ifndef UNCLIPPED
    for (int k = 0; k < t->outlines; k++) /* most blocks in the box of a tetrahedron lie beside it */
        if (t->outline[k].x * first_x + (t->outline[k].y * first_y + t->outline[k].one) < 0.0f)
            return;
#endif
    const floatl x = to_floatl(first_x + block_x), y = to_floatl(first_y + block_y);
    /* The ray's part inside, and before what is drawn already, in nearness: bounds are planes over the picture. */
    const floatl so_far = region->nearness[block];
    floatl far = t->first, near = t->last; /* so that no rounding of a flat one's sides leads astray */
    for (int k = 0; k < 4; k++) {
        const floatl n = t->sides[k].x * x + (t->sides[k].y * y + t->sides[k].one);
        if (t->leaves[k])
            near = lesser(n, near);
        else
            far = greater(n, far);
    }
    const intl inside = (far <= near) & (near > so_far);
    const floatl entry = t->perspective ? 1.0f / near : -near, exit = t->perspective ? 1.0f / far : -far;
    floatl front = entry, back = exit; /* where slices are tested */
    intl meets = inside;
#ifdef UNCLIPPED
    if (!t->crosses) {
        front = t->perspective ? 1.0f / t->front : -t->front;
        back = t->perspective ? 1.0f / t->rear : -t->rear;
        meets = t->front > so_far;
    }
#endif
    if (!any_lane(meets))
        return;
    const floatl drawn = pick(so_far <= EMPTY, (floatl)INFINITY, t->perspective ? 1.0f / so_far : -so_far);
    Search search = {line_of(t, t->u, x, y), line_of(t, t->v, x, y), line_of(t, t->h, x, y), 0, 0.0f};
    const Line number = line_of(t, t->slice, x, y);
    const int bases = context->slicing != SURFACE; /* there, slice 0 is the base */
    if (bases)
        try_at(context, block, &search, entry, inside & (search.h.sloped > 0.0f) & (AT(search.h, entry) < THIN), inside);

    const intl rises = number.sloped > 0.0f;
    const floatl step = pick(rises, (floatl)1.0f, (floatl)-1.0f), per_slice = 1.0f / number.sloped;
    const floatl s_front = AT(number, front), s_back = AT(number, back);
    const floatl last = pick(rises, floor_lanes(s_back + THIN), ceil_lanes(s_back - THIN));
    for (floatl slice = pick(rises, ceil_lanes(s_front - THIN), floor_lanes(s_front + THIN));; slice += step) {
        const floatl z = lesser(greater((slice - number.fixed) * per_slice, front), back);
        const intl tries = meets & !search.found & ((last - slice) * step >= 0.0f) & (z < drawn);
        if (!any_lane(tries))
            break;
        try_at(context, block, &search, z, tries, inside & (z >= entry) & (z <= exit));
    }
    if (bases)
        try_at(context, block, &search, exit,
               inside & !search.found & (search.h.sloped < 0.0f) & (AT(search.h, exit) < THIN) & (exit < drawn),
               inside);

    const intl found = search.found;
    if (!any_lane(found))
        return;
    region->nearness[block] = pick(found, t->perspective ? 1.0f / search.z : -search.z, so_far);
    region->farthest[block] = least_lane(region->nearness[block]);
    region->owner[block] = pick(found, (intl)t->index, region->owner[block]);
    region->u[block] = pick(found, AT(search.u, search.z), region->u[block]);
    region->v[block] = pick(found, AT(search.v, search.z), region->v[block]);
}

#include "raster/list.h"

#define GATHER(array, i) gather(array, i)

#ifdef LIT
/* The base's normal below a point: interpolated at its foot on the triangle. rise: above the triangle's plane */
Direction normal_below(global const int *corners, global const float *points, global const float *normals, intl triangle,
                       floatl X, floatl Y, floatl Z, floatl *rise)
{
    intl corner[3];
    floatl p[3][3];
    for (int k = 0; k < 3; k++) { /* the first three corners of the first tetrahedron are the triangle's */
        const intl at = 12 * triangle + k;
        corner[k] = (intl)(gather(corners, at));
        for (int axis = 0; axis < 3; axis++)
            p[k][axis] = (floatl)(GATHER(points, (3 * corner[k] + axis)));
    }
    const floatl ax = p[1][0] - p[0][0], ay = p[1][1] - p[0][1], az = p[1][2] - p[0][2];
    const floatl bx = p[2][0] - p[0][0], by = p[2][1] - p[0][1], bz = p[2][2] - p[0][2];
    const floatl x = X - p[0][0], y = Y - p[0][1], z = Z - p[0][2];
    const floatl aa = ax * ax + ay * ay + az * az, ab = ax * bx + ay * by + az * bz, bb = bx * bx + by * by + bz * bz;
    const floatl xa = x * ax + y * ay + z * az, xb = x * bx + y * by + z * bz;
    const floatl inverse = 1.0f / greater(aa * bb - ab * ab, (floatl)1e-30f);
    *rise = fabs(x * (ay * bz - az * by) + y * (az * bx - ax * bz) + z * (ax * by - ay * bx)) * sqrt(inverse);
    const floatl second = lesser(greater((bb * xa - ab * xb) * inverse, (floatl)0.0f), (floatl)1.0f);
    const floatl third = lesser(greater((aa * xb - ab * xa) * inverse, (floatl)0.0f), (floatl)1.0f);
    const floatl weight[3] = {greater(1.0f - second - third, (floatl)0.0f), second, third};
    Direction made = {0.0f, 0.0f, 0.0f};
    for (int k = 0; k < 3; k++) {
        made.x += weight[k] * (floatl)(GATHER(normals, (3 * corner[k])));
        made.y += weight[k] * (floatl)(GATHER(normals, (3 * corner[k] + 1)));
        made.z += weight[k] * (floatl)(GATHER(normals, (3 * corner[k] + 2)));
    }
    return at_unit_length(made);
}
#endif

kernel void draw_surface(global const int *corners, global const float *projected, global const float *points,
                         global const float *places, global const float *frames, global const uint *heights,
                         global const uint *colors, global const int *list, global const int *starts, int bins_x,
                         global float *depth, global channel *color, global uchar *valid, Screen screen,
                         float nearest_w, float spacing, int slices, int slicing, int test, int map_width,
                         int map_height, int color_width, int color_height,
                         int color_levels, float pixel_size, global const float *gradients, int blank
#ifdef LIT
                         ,
                         global const float *normals, global const float *normal_map, int normal_width,
                         int normal_height, Light light SHADOW_PARAMETERS
#endif
#ifdef COUNTED
                         ,
                         global int *counts
#endif
)
{
    const int x = get_global_id(0) * REGION, y = get_global_id(1) * REGION;
    if (x >= screen.width || y >= screen.height)
        return;
    const Context context = {corners, projected, points, places, frames, heights, screen, nearest_w, spacing,
                             slices, slicing, test, map_width, map_height
#ifdef COUNTED
                             ,
                             counts, x, y
#endif
    };
    const int bin = y / BIN * bins_x + x / BIN;
    Region region;
    begin_region(&region, screen, depth, blank, x, y);
    draw_list(&context, &region, list, starts[bin], starts[bin + 1], x, y);

    for (int block = 0; block < BLOCKS; block++) {
        const intl owner = region.owner[block], mine = owner >= 0;
        if (!blank && !any_lane(mine))
            continue;
        const int first_x = block % ROW * BLOCK, first_y = block / ROW * BLOCK;
        Color shade = {0.0f, 0.0f, 0.0f};
        if (any_lane(mine)) {
            const floatl u = pick(mine, region.u[block], (floatl)0.0f), v = pick(mine, region.v[block], (floatl)0.0f);
            const intl triangle = to_intl((to_floatl(pick(mine, owner, (intl)0)) + 0.5f) * (1.0f / 3.0f));
#define SLOPE_AT(k) (floatl)(GATHER(gradients, (slope + k)))
            const intl slope = triangle * 6;
            const Direction along_u = {SLOPE_AT(0), SLOPE_AT(1), SLOPE_AT(2)};
            const Direction along_v = {SLOPE_AT(3), SLOPE_AT(4), SLOPE_AT(5)};
            const floatl n = region.nearness[block], size = pixel_size * (screen.perspective ? 1.0f / n : (floatl)1.0f);
            const floatl u_2 = along_u.x * along_u.x + along_u.y * along_u.y + along_u.z * along_u.z;
            const floatl v_2 = along_v.x * along_v.x + along_v.y * along_v.y + along_v.z * along_v.z;
            const floatl texels_2 = greater(u_2 * ((float)color_width * color_width), v_2 * ((float)color_height * color_height));
            add_level(colors, u, v, level_of_texels(pick(mine, texels_2 * size * size, (floatl)1.0f), color_levels),
                      color_width, color_height, 1.0f / 255.0f, &shade);
#ifdef LIT
            const float *m = screen.to_world;
            const floatl px = to_floatl(x + first_x + block_x), py = to_floatl(y + first_y + block_y);
            const floatl inverse = 1.0f / (PIXEL_ROW(m, 3, px, py) + n * m[15]);
            const floatl X = (PIXEL_ROW(m, 0, px, py) + n * m[3]) * inverse, Y = (PIXEL_ROW(m, 1, px, py) + n * m[7]) * inverse,
                         Z = (PIXEL_ROW(m, 2, px, py) + n * m[11]) * inverse;
            floatl above;
            const Direction base = normal_below(corners, points, normals, triangle, X, Y, Z, &above);
            floatl nx = base.x, ny = base.y, nz = base.z;
            if (normal_width > 0) { /* tangent-space normals: their slopes are per length of the surface */
                const Direction own = normal_in(normal_map, normal_width, normal_height, u, v);
                const floatl steep = 1.0f / greater(own.z, (floatl)1e-3f), mu = own.x * steep, mv = own.y * steep;
#define FRAME_AT(k) (floatl)(GATHER(frames, (triangle * 9 + k)))
                nx += mu * FRAME_AT(3) + mv * FRAME_AT(6);
                ny += mu * FRAME_AT(4) + mv * FRAME_AT(7);
                nz += mu * FRAME_AT(5) + mv * FRAME_AT(8);
            } else { /* the height's gradient */
                const float du = 1.0f / map_width, dv = 1.0f / map_height;
                const float rise = 0.5f * spacing * slices;
                const floatl by_u = (height_at(heights, map_width, map_height, u + du, v) - height_at(heights, map_width, map_height, u - du, v)) * (rise * map_width);
                const floatl by_v = (height_at(heights, map_width, map_height, u, v + dv) - height_at(heights, map_width, map_height, u, v - dv)) * (rise * map_height);
                nx -= by_u * along_u.x + by_v * along_v.x;
                ny -= by_u * along_u.y + by_v * along_v.y;
                nz -= by_u * along_u.z + by_v * along_v.z;
            }
            const floatl inverse_length = 1.0f / sqrt(nx * nx + ny * ny + nz * nz);
            nx *= inverse_length;
            ny *= inverse_length;
            nz *= inverse_length;
            const Direction ahead = towards(screen, X, Y, Z);
            floatl visible = VISIBILITY(X, Y, Z, nx, ny, nz);
#ifdef SHADOWED
            /* Farther than a slice below the heights a point may lie on a side of the volume, whose normal is across the
             * base's. */
            const floatl top = height_at(heights, map_width, map_height, u, v) * (spacing * slices);
            const intl on_side = mine & (top - above > spacing);
            if (any_lane(on_side)) {
                const floatl up = base.x * ahead.x + base.y * ahead.y + base.z * ahead.z;
                const Direction across = {up * base.x - ahead.x, up * base.y - ahead.y, up * base.z - ahead.z};
                const Direction side = at_unit_length(across);
                const floatl from_side = VISIBILITY(X, Y, Z, side.x, side.y, side.z);
                visible = pick(on_side & (from_side > visible), from_side, visible);
            }
#endif
            shine(&shade, light, X, Y, Z, nx, ny, nz, -ahead.x, -ahead.y, -ahead.z, visible);
#endif
        }
        write_block(&region, block, screen, depth, color, valid, blank, x + first_x, y + first_y, shade);
    }
}
