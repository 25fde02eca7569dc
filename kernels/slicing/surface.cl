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
 * through the base, the base is tested as a slice is, so that no view sees through flat parts between two slices;
 * `halvings` bring the point that passes closer to the surface than its slice; `by_view` chooses how many
 * there are, for each tetrahedron (space_slices).
 *
 * corners: (tetrahedra, 4) of projected, three in a row for each triangle. places: (vertices, 3) u, v (times tiles) and
 * height. points: (vertices, 3) world. frames: (triangles, 3, 3) the slicing directions a (normal), b, c: unit length.
 * heights: (map_height, map_width), lib/heights.h. colors: lib/texture.h, read by lib/footprint.h, as normal_map.
 * gradients: (triangles, 2, 3) of u and v in the world, times tiles. normals: (vertices of the base, 3). spacing: of
 * the slices, in the world. slices: of direction a, over the displacement; by_view: as in the volume's middle.
 * counters: (height, width) alpha tests, with COUNTERS. Work-item: a region (raster/region.h): with LANES 16 a bin, in
 * blocks of 4 x 4 pixels, one to a lane; with LANES 1 a pixel, which sets up all tetrahedra of its bin's list by itself
 * and walks the slices of those that it meets. Cost: O(list + pixels * slices met), with LANES 1 O(pixels * list +
 * ...).
 * Determinism: list order.
 */
#define KEEPS_UV 1
#include "lib/footprint.h"
#include "lib/light.h"
#include "raster/fragment.h"
#include "slicing/alpha_test.h"
#include "slicing/tetrahedra.h"

#ifndef UNCLIPPED
#define UNCLIPPED 0 /* 1: slices are tested beside the tetrahedra, too, as described at the top */
#endif

#define SLICE_NUMBER_MAX 8388608.0f /* slices: beyond, the next one would be the same float */

/* A block's rays, and what they have met */
typedef struct {
    Linear u, v, h;
    intl found;
    floatl z;
} SliceHit;

/* The alpha test of the points at depth z of the rays that are `tested`; only points `inside` the tetrahedron pass. */
void test_at(const Context *context, const Tetrahedron *t, const Region *region, int block, SliceHit *hit, floatl z,
             intl tested, intl inside)
{
    if (!any_lane(tested))
        return;
    const floatl alpha = height_at(context->heights, context->map_width, context->map_height, AT(hit->u, z),
                                   AT(hit->v, z));
    const floatl above = AT(hit->h, z), h = select_lanes(above > t->height_rounding, above, (floatl)0.0f);
    const intl passed = tested & inside & passes(context->test, alpha, h, t->band);
    hit->z = select_lanes(passed, z, hit->z);
    hit->found = hit->found | passed;
    if (COUNTERS)
        add_to_counters(context->counters, region, block, context->screen, tested & 1);
}

/* Bisects the interval from the depth `before`, whose points do not pass, to the hits that have `passed` at a slice. */
void refine_slice_hit(const Context *context, const Tetrahedron *t, const Region *region, int block, SliceHit *hit,
                      floatl before, intl passed)
{
    for (int i = 0; i < t->halvings && any_lane(passed); i++) {
        const floatl middle = 0.5f * (before + hit->z);
        test_at(context, t, region, block, hit, middle, passed, passed);
        before = select_lanes(hit->z == middle, before, middle);
    }
}

void cover(const Context *context, const Primitives *made, int lane, Region *region, int block, int first_x,
           int first_y)
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
    /* From which nearness to which the ray lies inside: bounds are planes over the picture. */
    const floatl so_far = region->nearness[block];
    floatl far = t->first, near = t->last; /* bounds, lest rounding of a flat tetrahedron's sides leads astray */
    for (int k = 0; k < 4; k++) {
        const floatl n = t->sides[k].x * x + (t->sides[k].y * y + t->sides[k].one);
        if (t->leaves[k])
            near = min_lanes(n, near);
        else
            far = max_lanes(n, far);
    }
    const intl inside = (far <= near) & (near > so_far);
    const floatl entry = DEPTH_OF(t->perspective, near), exit = DEPTH_OF(t->perspective, far);
    floatl front = entry, back = exit; /* where slices are tested */
    intl meets = inside;
#if UNCLIPPED
    if (!t->crosses) {
        front = DEPTH_OF(t->perspective, t->front);
        back = DEPTH_OF(t->perspective, t->rear);
        meets = t->front > so_far;
    }
#endif
    if (!any_lane(meets))
        return;
    floatl drawn = select_lanes(so_far <= EMPTY, (floatl)INFINITY, DEPTH_OF(t->perspective, so_far));
    SliceHit hit = {along_ray(t, t->u, x, y), along_ray(t, t->v, x, y), along_ray(t, t->h, x, y), 0, 0.0f};
    const Linear number = along_ray(t, t->slice, x, y);
    const int bases = context->slicing != SURFACE; /* there, slice 0 is the base */
    if (bases)
        test_at(context, t, region, block, &hit, entry,
                inside & (hit.h.sloped > 0.0f) & (AT(hit.h, entry) < fmax(SLICE_ROUNDING, t->height_rounding)), inside);

    const intl rises = number.sloped > 0.0f;
    const floatl step = select_lanes(rises, (floatl)1.0f, (floatl)-1.0f), per_slice = 1.0f / number.sloped;
    if (t->halvings > 0)
        drawn += fabs(per_slice); /* halvings bring a point forward by up to a slice */
    const intl at_once = hit.found;
    floatl before = entry;
    const floatl s_front = clamp_lanes(AT(number, front), (floatl)-SLICE_NUMBER_MAX, (floatl)SLICE_NUMBER_MAX);
    const floatl s_back = clamp_lanes(AT(number, back), (floatl)-SLICE_NUMBER_MAX, (floatl)SLICE_NUMBER_MAX);
    const floatl last = select_lanes(rises, floor_lanes(s_back + t->slice_rounding),
                                     ceil_lanes(s_back - t->slice_rounding));
    floatl slice = select_lanes(rises, ceil_lanes(s_front - t->slice_rounding),
                                floor_lanes(s_front + t->slice_rounding));
    const intl slices = to_intl((last - slice) * step); /* after the first; < 0: none at all */
    for (int count = 0;; count++, slice += step) {
        const floatl z = clamp_lanes((slice - number.fixed) * per_slice, front, back);
        const intl tested = meets & !hit.found & (count <= slices) & (z < drawn);
        if (!any_lane(tested))
            break;
        test_at(context, t, region, block, &hit, z, tested, inside & (z >= entry) & (z <= exit));
        before = select_lanes(tested & !hit.found & (z >= entry), z, before);
    }
    if (bases) { /* and with halvings any side that a ray leaves by: the next tetrahedron's slices lie beyond it */
        const intl leaves = t->halvings > 0
                                ? inside
                                : (hit.h.sloped < 0.0f) & (AT(hit.h, exit) < fmax(SLICE_ROUNDING, t->height_rounding));
        test_at(context, t, region, block, &hit, exit, inside & !hit.found & leaves & (exit < drawn), inside);
    }
    refine_slice_hit(context, t, region, block, &hit, before, hit.found & !at_once);

    const intl found = hit.found & ((intl)(t->halvings > 0 ? 0 : -1) | (DEPTH_OF(t->perspective, hit.z) > so_far));
    if (!any_lane(found))
        return;
    region->nearness[block] = select_lanes(found, DEPTH_OF(t->perspective, hit.z), so_far);
    region->farthest[block] = least_lane(region->nearness[block]);
    region->owner[block] = select_lanes(found, (intl)t->index, region->owner[block]);
    region->u[block] = select_lanes(found, AT(hit.u, hit.z), region->u[block]);
    region->v[block] = select_lanes(found, AT(hit.v, hit.z), region->v[block]);
}

#define FRAGMENTS 1
#include "raster/list.h"

#if LIT || ANISOTROPIC
#define HEIGHT(u, v) height_at(context->heights, context->map_width, context->map_height, u, v)

/* The base's normal, tilted by how much heights (0 to 1) rise over a unit of u, and of v; along_u, along_v: of u and
 * v in the world */
INLINED Vector slice_normal_by_rises(const Context *context, Vector base, floatl over_u, floatl over_v, Vector along_u,
                                     Vector along_v)
{
    const float rise = context->spacing * context->slices;
    const floatl by_u = over_u * rise, by_v = over_v * rise;
    const Vector tilted = {base.x - (by_u * along_u.x + by_v * along_v.x),
                           base.y - (by_u * along_u.y + by_v * along_v.y),
                           base.z - (by_u * along_u.z + by_v * along_v.z)};
    return normalized(tilted);
}
#endif

#if ANISOTROPIC
/* By how much u and v change over a pixel: on the tangent plane of the heights where it sees them, above the
 * triangle */
INLINED UvSteps slice_uv_steps(const Context *context, Vector ahead, floatl n, floatl u, floatl v, Vector along_u,
                               Vector along_v, int anisotropy)
{
    const Vector across = normalized(cross_product(along_u, along_v));
    const Vector base = scaled(across, select_lanes(DOT(across, ahead) > 0.0f, (floatl)-1.0f, (floatl)1.0f));
    /* Heights are linear along either from a texel's centre to the next: slopes there, and not the lights', which
     * are means of two, decide what the surface shows of its map. */
    const float width = context->map_width, height = context->map_height;
    const floatl left = (floor_lanes(u * width - 0.5f) + 0.5f) / width,
                 upper = (floor_lanes(v * height - 0.5f) + 0.5f) / height;
    const floatl by_u = (HEIGHT(left + 1.0f / width, v) - HEIGHT(left, v)) * width;
    const floatl by_v = (HEIGHT(u, upper + 1.0f / height) - HEIGHT(u, upper)) * height;
    const Vector tilted = slice_normal_by_rises(context, base, by_u, by_v, along_u, along_v);
    return uv_steps(context->screen, n, ahead, tilted, along_u, along_v, anisotropy);
}
#endif

#if LIT
/* The base's normal, tilted by the heights' gradient over two texels */
INLINED Vector slice_normal_by_heights(const Context *context, Vector base, floatl u, floatl v, Vector along_u,
                                       Vector along_v)
{
    const float du = 1.0f / context->map_width, dv = 1.0f / context->map_height;
    const floatl by_u = (HEIGHT(u + du, v) - HEIGHT(u - du, v)) * (0.5f * context->map_width);
    const floatl by_v = (HEIGHT(u, v + dv) - HEIGHT(u, v - dv)) * (0.5f * context->map_height);
    return slice_normal_by_rises(context, base, by_u, by_v, along_u, along_v);
}

/* The base's normal below a point: interpolated at its foot on the triangle. rise: above the triangle's plane */
INLINED Vector normal_below(const Context *context, global const float *normals, intl triangle, Vector point,
                            floatl *rise)
{
    intl corner[3];
    Vector p[3];
    for (int k = 0; k < 3; k++) { /* the first three corners of the first tetrahedron are the triangle's */
        const intl at = 12 * triangle + k;
        corner[k] = (intl)(gather(context->corners, at));
        p[k] = vector_at(context->points, corner[k]);
    }
    const Vector a = minus(p[1], p[0]), b = minus(p[2], p[0]), to = minus(point, p[0]);
    const floatl aa = DOT(a, a), ab = DOT(a, b), bb = DOT(b, b), xa = DOT(to, a), xb = DOT(to, b);
    const floatl inverse = 1.0f / max_lanes(aa * bb - ab * ab, (floatl)1e-30f);
    const Vector normal = cross_product(a, b);
    *rise = fabs(DOT(to, normal)) * sqrt(inverse);
    const floatl second = clamp_lanes((bb * xa - ab * xb) * inverse, (floatl)0.0f, (floatl)1.0f);
    const floatl third = clamp_lanes((aa * xb - ab * xa) * inverse, (floatl)0.0f, (floatl)1.0f);
    const floatl weight[3] = {max_lanes(1.0f - second - third, (floatl)0.0f), second, third};
    Vector made = {0.0f, 0.0f, 0.0f};
    for (int k = 0; k < 3; k++) {
        const Vector n = vector_at(normals, corner[k]);
        made.x += weight[k] * n.x;
        made.y += weight[k] * n.y;
        made.z += weight[k] * n.z;
    }
    return normalized(made);
}

/* The base's normal, tilted by a map of tangent-space normals, whose slopes are per length of the surface */
INLINED Vector slice_normal_by_map(const Context *context, Vector base, intl triangle, Vector own)
{
    const Vector across = vector_at(context->frames, 3 * triangle + 1),
                 down = vector_at(context->frames, 3 * triangle + 2);
    const floatl steep = 1.0f / max_lanes(own.z, (floatl)1e-3f), mu = own.x * steep, mv = own.y * steep;
    const Vector tilted = {base.x + (mu * across.x + mv * down.x), base.y + (mu * across.y + mv * down.y),
                           base.z + (mu * across.z + mv * down.z)};
    return normalized(tilted);
}

#if SHADOWED
/* Is a point farther than a slice below the heights? Then it may lie on a side of the volume. */
INLINED intl is_on_side(const Context *context, floatl u, floatl v, floatl above)
{
    const floatl top = HEIGHT(u, v) * (context->spacing * context->slices);
    return top - above > context->spacing;
}

/* The normal of such a side: at right angles to the base's, towards the viewer */
INLINED Vector side_normal(Vector base, Vector ahead)
{
    const floatl up = DOT(base, ahead);
    const Vector across = {up * base.x - ahead.x, up * base.y - ahead.y, up * base.z - ahead.z};
    return normalized(across);
}
#endif
#endif

kernel void draw_surface(BINS_PARAMETERS, PICTURE_PARAMETERS, global const int *corners, global const float *points,
                         global const float *places, global const float *frames, global const uint *heights,
                         global const uint *colors, float spacing, int slices,
                         int by_view /* 1: each tetrahedron has as many as the picture needs there */,
                         int halvings /* of the interval to the slice before, once one has passed */, int slicing,
                         int test, float band /* of heights that BAND takes; 0: that of a slice */, int map_width,
                         int map_height, int color_width, int color_height,
                         int color_levels, float pixel_size, global const float *gradients ANISOTROPY_PARAMETER
#if LIT
                         ,
                         global const float *normals, global const float *normal_map, int normal_width,
                         int normal_height, Light light SHADOW_PARAMETERS
#endif
                         COUNTERS_PARAMETER(int)
)
{
    const Picture picture = PICTURE_VALUE;
    const Context context = {corners,
                             projected,
                             points,
                             places,
                             frames,
                             heights,
                             gradients,
                             screen,
                             nearest_w,
                             spacing,
                             by_view ? pixel_size : 0.0f,
                             band,
                             slices,
                             slicing,
                             test,
                             halvings,
                             map_width,
                             map_height,
                             COUNTERS_ARGUMENT(int)};
    Region region;
    BinList listed;
    if (!begin_item(&region, &picture, list, starts, bins_x, &listed))
        return;
    draw_list(&context, &region, listed);

    for (int block = 0; block < BLOCKS; block++) {
        const intl owner = region.owner[block], mine = owner >= 0;
        if (!blank && !any_lane(mine))
            continue;
        Color shade = {0.0f, 0.0f, 0.0f};
        if (any_lane(mine)) {
            const floatl u = select_lanes(mine, region.u[block], (floatl)0.0f),
                         v = select_lanes(mine, region.v[block], (floatl)0.0f);
            const intl triangle = select_lanes(mine, owner, (intl)0) / 3;
            const Vector along_u = vector_at(gradients, 2 * triangle), along_v = vector_at(gradients, 2 * triangle + 1);
            const floatl n = region.nearness[block], size = pixel_size * (screen.perspective ? 1.0f / n : (floatl)1.0f);
            const floatl texels_2 = max_lanes(DOT(along_u, along_u) * ((float)color_width * color_width),
                                            DOT(along_v, along_v) * ((float)color_height * color_height));
#if LIT || ANISOTROPIC
            const Vector point = point_at(screen, BLOCK_X(&region, block), BLOCK_Y(&region, block), n);
            const Vector ahead = view_direction(screen, point);
#endif
#if ANISOTROPIC
            const UvSteps over = slice_uv_steps(&context, ahead, n, u, v, along_u, along_v, anisotropy);
            const Footprint f = footprint_of(over, color_width, color_height, mine);
#else
            const Footprint f = isotropic_footprint(select_lanes(mine, texels_2 * size * size, (floatl)1.0f));
#endif
            add_footprint(colors, u, v, f, level_of_texels(f.texels_2, color_levels), color_width, color_height,
                          1.0f / 255.0f, &shade);
#if LIT
            floatl above;
            const Vector base = normal_below(&context, normals, triangle, point, &above);
            Vector normal;
            if (normal_width > 0) {
#if ANISOTROPIC
                const Vector mapped = mean_normal(normal_map, normal_width, normal_height, u, v, over, mine);
#else
                const Vector mapped = normal_in(normal_map, normal_width, normal_height, 0, u, v);
#endif
                normal = slice_normal_by_map(&context, base, triangle, mapped);
            } else
                normal = slice_normal_by_heights(&context, base, u, v, along_u, along_v);
            floatl visible = VISIBILITY(point, normal);
#if SHADOWED
            const intl on_side = mine & is_on_side(&context, u, v, above);
            if (any_lane(on_side)) {
                const floatl from_side = VISIBILITY(point, side_normal(base, ahead));
                visible = select_lanes(on_side & (from_side > visible), from_side, visible);
            }
#endif
            apply_light(&shade, light, point, normal, ahead, visible);
#endif
        }
        write_block(&region, block, &picture, shade);
    }
}
