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
 * heights: (map_height, map_width), lib/heights.h. colors: lib/texture.h. gradients:
 * (triangles, 2, 3) of u and v in the world, tiled. normals: (vertices of the base, 3). spacing: of the slices,
 * in the world. slices: of direction a. counts: (height, width) alpha tests, with COUNTED.
 * Work-item: a region (raster/region.h): with LANES 16 a bin, in blocks of 4 x 4 pixels, one to a lane; with LANES 1 a
 * pixel, which sets up all tetrahedra of its bin's list by itself and walks the slices of those that it meets.
 * Cost: O(list + pixels * slices met), with LANES 1 O(pixels * list + ...). Determinism: list order.
 */
#define PLACED 1
#include "lib/light.h"
#include "lib/normals.h"
#include "lib/texture.h"
#include "raster/region.h"
#include "slicing/heights.h"
#include "slicing/tetrahedra.h"

#ifndef UNCLIPPED
#define UNCLIPPED 0 /* 1: slices are tested beside the tetrahedra, too, as the file's head says */
#endif

#define NUMBER_MOST 8388608.0f /* slices: beyond, the next one would be the same float */
#define ROUNDED 1e-5f /* of the displacement: what lies no higher is on the base */
#define THIN 1e-4f /* slices: rounding of where a ray enters and leaves a tetrahedron */

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
    const floatl above = AT(search->h, z), h = pick(above > ROUNDED, above, (floatl)0.0f);
    const intl passed = tries & inside & passes(context->test, alpha, h, 1.0f / context->slices);
    search->z = pick(passed, z, search->z);
    search->found = search->found | passed;
#if COUNTED
    for (int lane = 0; lane < LANES; lane++) {
        const int px = context->x + block % ROW * BLOCK + lane % BLOCK, py = context->y + block / ROW * BLOCK + lane / BLOCK;
        if (int_lane(tries, lane) && px < context->screen.width && py < context->screen.height)
            context->counts[(size_t)py * context->screen.width + px]++;
    }
#endif
}

void cover(const Context *context, const Primitives *made, int lane, Region *region, int block, int first_x, int first_y)
{
    const Tetrahedron *t = &made->of[lane];
    if (t->front <= region->farthest[block])
        return;
#if !UNCLIPPED
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
#if UNCLIPPED
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
    const floatl s_front = lesser(greater(AT(number, front), (floatl)-NUMBER_MOST), (floatl)NUMBER_MOST);
    const floatl s_back = lesser(greater(AT(number, back), (floatl)-NUMBER_MOST), (floatl)NUMBER_MOST);
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

#define FRAGMENTS 1
#include "raster/list.h"

#define GATHER(array, i) gather(array, i)

#if LIT
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
#if LIT
                         ,
                         global const float *normals, global const float *normal_map, int normal_width,
                         int normal_height, Light light SHADOW_PARAMETERS
#endif
#if COUNTED
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
#if COUNTED
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
#if LIT
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
#if SHADOWED
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
