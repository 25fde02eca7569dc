/* Displacement mapping by slices (Kautz & Seidel 2001, section 3).
 *
 * Each triangle of the base mesh, extruded along its corners' normals, is a prism. A prism's slice at a height is a
 * triangle with the base triangle's u and v. The height of a ray's point, and the corners' weights there, follow from a
 * cubic (prism_rays.h). Either each slice has one height, and heights are evenly spaced (direction a), or slices are
 * planes at equal distances. A pixel's ray walks the slices that it meets from front to back, and stops where the alpha
 * test passes.
 *
 * With by_view, most rays are intersected with the map's cells instead (map_cells.h).
 *
 * UNCLIPPED: slices parallel to the screen are tested in the whole box of each prism, not only inside the prism.
 *
 * Deviations from the paper: each pixel's ray is intersected with the slices, which are not drawn as polygons. Where a
 * ray enters or leaves through the base, the base is tested like a slice, so that flat parts between two slices have no
 * gaps. Rays are also tested where they leave a prism at a border of the surface. `halvings` bisections move a hit from
 * its slice closer to the surface.
 *
 * corners: (triangles, 6) indices in `projected`: three corners of the base, then the three above them. points: (2
 * vertices, 3) world: vertices of the base, then the points above them. uv: (vertices, 2) u and v, times the number of
 * tiles. frames: (triangles, 3, 3) the slicing directions a (the normal), b, c: unit vectors. tilts: (triangles, 3, 3)
 * each corner's vector to the corner above it, in the prism's frame (prisms.h). ends: (triangles,) 1 at a border of the
 * surface. heights: (map_height, map_width), lib/heights.h. colors: lib/texture.h. normal_map: (normal_height,
 * normal_width, 3) with its mipmaps, if normal_width > 0. Both maps are read by lib/footprint.h. gradients: (triangles,
 * 2, 3) of u and v on the base, per scene unit. normals: (vertices of the base, 3). spacing: distance between slices,
 * scene units. slices: number of slices through the displacement, along direction a; with by_view, for the volume's
 * middle. counters: (height, width) alpha tests, with COUNTERS. The region's u and v are the weights of a triangle's
 * second and third corner. Work-item: a region (raster/region.h). With LANES 16 it is a bin, drawn in blocks of 4 x 4
 * pixels, one pixel to a lane. With LANES 1 it is a pixel, which sets up all prisms in its bin's list. Cost: O(list +
 * pixels * slices met); with LANES 1, O(pixels * (list + slices met)). Determinism: list order.
 */
#define KEEPS_UV 1
#include "lib/footprint.h"
#include "lib/light.h"
#include "raster/fragment.h"
#include "slicing/map_cells.h"
#include "slicing/slice_normals.h"

#ifndef UNCLIPPED
#define UNCLIPPED 0 /* 1: slices are tested outside the prisms, too (see the top of this file) */
#endif

#define END_HALVINGS 4   /* bisections of the interval from the last slice to the end of the surface */
#define Z_ROUNDING 4e-6f /* relative rounding error of depths at slices and where a ray enters or leaves */
#define SLICE_NUMBER_MAX 8388608.0f /* beyond it, adjacent slice numbers would round to one float */

INLINED intl is_in_prism(const Prism *t, Place place)
{
    const floatl shares = min_lanes(min_lanes(place.second, place.third), 1.0f - place.second - place.third);
    return min_lanes(shares, place.h) >= -t->share_rounding;
}

#define RUN (UNCLIPPED ? 2 : 16) /* slices in a run (walk_slices); in runs of two, all depths are exact */

/* Makes the alpha test at depth z on the `tested` rays, and keeps hits. Only points in the prism can pass; on
 * `extended` rays, all points can. Returns which points can pass. */
INLINED intl test_at(const Context *context, const Prism *t, const Region *region, int block, SliceHit *hit, floatl z,
             Place place, intl tested, intl extended)
{
    const intl possible = tested & (extended | is_in_prism(t, place)), asked = UNCLIPPED ? tested : possible;
    if (!any_lane(asked))
        return possible;
    const floatl u = t->u + place.second * t->u_second + place.third * t->u_third;
    const floatl v = t->v + place.second * t->v_second + place.third * t->v_third;
    const floatl alpha = height_at(context->heights, context->map_width, context->map_height, u, v);
    const floatl h = select_lanes(place.h > t->height_rounding, place.h, (floatl)0.0f);
    const intl passed = possible & passes(context->test, alpha, h, t->band);
    hit->z = select_lanes(passed, z, hit->z);
    hit->place.h = select_lanes(passed, place.h, hit->place.h);
    hit->place.second = select_lanes(passed, place.second, hit->place.second);
    hit->place.third = select_lanes(passed, place.third, hit->place.third);
    hit->found = hit->found | passed;
    if (COUNTERS)
        add_to_counters(context->counters, region, block, context->screen, asked & 1);
    return possible;
}

/* For the rays in `passed`, bisects the interval from the depth `before`, where the alpha test fails, to the hit.
 * Beyond the depth `extended`, points outside the prism can pass the test, too. */
void refine_slice_hit(const Context *context, const Prism *t, const Region *region, int block, const PrismRays *rays,
                      SliceHit *hit, int halvings, floatl before, intl passed, floatl extended)
{
    for (int i = 0; i < halvings && any_lane(passed); i++) {
        const floatl middle = 0.5f * (before + hit->z);
        const Place place = place_at_depth(&t->bend, rays, middle);
        test_at(context, t, region, block, hit, middle, place, passed, middle > extended);
        before = select_lanes(hit->z == middle, before, middle);
    }
}

/* The depth at which rays cross the base, clamped to `entry` and `exit`. Sets `crosses` where the point at this depth
 * is on the base */
INLINED floatl depth_of_base(const Prism *t, const PrismRays *rays, floatl entry, floatl exit, intl *crosses)
{
    const floatl z = clamp_lanes(-rays->rise.fixed / rays->rise.sloped, entry, exit);
    const float close = fmax(SLICE_ROUNDING, t->height_rounding) * fabs(t->bend.first.rise);
    *crosses = fabs(AT(rays->rise, z)) < close;
    return z;
}

/* A block's rays in a prism: they are in the prism from depth `entry` to `exit`, and slices are tested from `front` to
 * `back`. inside: rays that enter the prism; meets: rays on which slices are tested */
typedef struct {
    floatl entry, exit, front, back;
    intl inside, meets;
} Passage;

INLINED Passage passage_of(const Prism *t, floatl x, floatl y, floatl so_far)
{
    /* The interval of nearness in which each ray lies inside all bounding planes */
    floatl far = t->first, near = t->last; /* limits, as a flat prism's sides have large rounding errors */
    for (int k = 0; k < PRISM_PLANES; k++) {
        const floatl n = t->sides[k].x * x + (t->sides[k].y * y + t->sides[k].one);
        if (t->leaves[k])
            near = min_lanes(n, near);
        else
            far = max_lanes(n, far);
    }
    Passage p;
    p.inside = p.meets = (far <= near) & (near > so_far);
    p.entry = p.front = DEPTH_OF(t->perspective, near);
    p.exit = p.back = DEPTH_OF(t->perspective, far);
#if UNCLIPPED
    if (!t->crosses) {
        p.front = DEPTH_OF(t->perspective, t->front);
        p.back = DEPTH_OF(t->perspective, t->rear);
        p.meets = t->front > so_far;
    }
#endif
    return p;
}

/* The depths at which a block's rays meet a slice, and their places in the prism there */
typedef struct {
    floatl z;
    Place place;
} Meeting;

INLINED floatl depth_of_slice(const Prism *t, const PrismRays *rays, const Passage *p, Linear number, floatl slice)
{
    if (t->by_height)
        return depth_at_height(&t->bend, rays, slice / t->count);
    return clamp_lanes((slice - number.fixed) / number.sloped, p->front, p->back);
}

INLINED Meeting meeting_of(const Prism *t, const PrismRays *rays, const Passage *p, Linear number, floatl slice)
{
    Meeting met;
    met.z = depth_of_slice(t, rays, p, number, slice);
    met.place = place_at(&t->bend, rays, met.z,
                         t->by_height ? slice / t->count : height_at_depth(&t->bend, rays, met.z));
    return met;
}

/* The value at `part`, 0 to 1, of a parabola with the values `from` at 0, `middle` at 1/2 and `to` at 1 */
#define ON_PARABOLA(from, middle, to, part)                                                                    \
    ((from) + (part) * ((4.0f * (middle) - 3.0f * (from) - (to)) + (part) * (2.0f * ((from) - 2.0f * (middle) + (to)))))

/* Finds the slices that rays meet. Sets the number of the first slice, and the step to the next (1 or -1). Returns how
 * many slices follow the first; < 0: the ray meets none */
INLINED intl slices_of(const Prism *t, const PrismRays *rays, const Passage *p, Linear number, floatl *slice,
                       floatl *step)
{
    floatl front, back;
    if (t->by_height) {
        front = clamp_lanes(height_at_depth(&t->bend, rays, p->front), (floatl)0.0f, (floatl)1.0f) * t->count;
        back = clamp_lanes(height_at_depth(&t->bend, rays, p->back), (floatl)0.0f, (floatl)1.0f) * t->count;
    } else {
        front = clamp_lanes(AT(number, p->front), (floatl)-SLICE_NUMBER_MAX, (floatl)SLICE_NUMBER_MAX);
        back = clamp_lanes(AT(number, p->back), (floatl)-SLICE_NUMBER_MAX, (floatl)SLICE_NUMBER_MAX);
    }
    const float rounding = t->slice_rounding;
    const intl rises = back > front;
    const floatl last = select_lanes(rises, floor_lanes(back + rounding), ceil_lanes(back - rounding));
    *step = select_lanes(rises, (floatl)1.0f, (floatl)-1.0f);
    *slice = select_lanes(rises, ceil_lanes(front - rounding), floor_lanes(front + rounding));
    return to_intl((last - *slice) * *step);
}

/* Tests the slices from front to back until a point passes. Returns the depth of the last point in front of the hit,
 * where the test failed. last: set to the depth of the last slice, or of the entry if the ray meets no slice. The
 * depths of a run of RUN slices come from a parabola that is exact at the run's ends and middle; the parabola's errors
 * are far below the spacing. drawn: depths beyond which everything is occluded */
static floatl walk_slices(const Context *context, const Prism *t, const Region *region, int block, const PrismRays *rays,
                   const Passage *p, Linear number, floatl drawn, SliceHit *hit, floatl *last)
{
    floatl slice, step, before = p->entry, latest = p->front;
    const intl slices = slices_of(t, rays, p, number, &slice, &step);
    *last = select_lanes(slices >= 0, depth_of_slice(t, rays, p, number, slice + step * to_floatl(slices)), p->entry);
    intl left = p->meets & !hit->found & (slices >= 0);
    if (!any_lane(left))
        return before;
    Meeting from = meeting_of(t, rays, p, number, slice);
    for (int first = 0;; first += RUN) {
        const floatl length = clamp_lanes(to_floatl(slices - first), (floatl)1.0f, (floatl)RUN);
        const Meeting middle = meeting_of(t, rays, p, number, slice + 0.5f * step * length);
        const Meeting to = meeting_of(t, rays, p, number, slice + step * length);
        const floatl per_length = 1.0f / length;
        for (int k = 0; k < RUN; k++) {
            const floatl part = k * per_length;
            const floatl z = ON_PARABOLA(from.z, middle.z, to.z, part);
            left = left & !hit->found & (first + k <= slices) & ((t->halvings > 0 ? latest : z) < drawn);
            if (!any_lane(left))
                return before;
            Place place = {ON_PARABOLA(from.place.h, middle.place.h, to.place.h, part),
                           ON_PARABOLA(from.place.second, middle.place.second, to.place.second, part),
                           ON_PARABOLA(from.place.third, middle.place.third, to.place.third, part)};
#if UNCLIPPED
            const intl within = p->inside & (z >= p->entry) & (z <= p->exit);
            place.h = select_lanes(within, place.h, (floatl)-1.0f); /* not in the prism */
#endif
            const intl possible = test_at(context, t, region, block, hit, z, place, left, 0);
            before = select_lanes(possible & !hit->found, z, before);
            latest = z;
        }
        from = to;
        slice += step * length;
    }
}

static void cover(const Context *context, const Primitives *made, int lane, Region *region, int block, int first_x,
           int first_y)
{
    const Prism *t = &made->of[lane];
    if (t->front <= region->farthest[block])
        return;
#if BLOCK > 1 && !UNCLIPPED
    for (int k = 0; k < t->outlines; k++) /* most blocks in a prism's box lie outside the prism's outline */
        if (t->outline[k].x * first_x + (t->outline[k].y * first_y + t->outline[k].one) < 0.0f)
            return;
#endif
    const floatl x = to_floatl(first_x + block_x), y = to_floatl(first_y + block_y);
    const floatl so_far = region->nearness[block];
    const Passage p = passage_of(t, x, y, so_far);
    if (!any_lane(p.meets))
        return;
    const floatl drawn = select_lanes(so_far <= EMPTY, (floatl)INFINITY, DEPTH_OF(t->perspective, so_far));
    const PrismRays rays = {along_ray(t, t->second, x, y), along_ray(t, t->third, x, y), along_ray(t, t->rise, x, y)};
    SliceHit hit = {0, 0.0f, {0.0f, 0.0f, 0.0f}};
    intl at_base = 0;
    floatl base = p.exit;
    const int tests_base = t->by_cells || context->slicing != SURFACE; /* with SURFACE, slice 0 is the base */
    if (tests_base) {
        base = depth_of_base(t, &rays, p.entry, p.exit, &at_base);
        at_base = at_base & p.inside;
        test_at(context, t, region, block, &hit, base, place_at(&t->bend, &rays, base, 0.0f),
                at_base & (rays.rise.sloped > 0.0f), 0);
    }
    const intl at_once = hit.found;
    floatl last = p.entry, before = p.entry;
    if (t->by_cells) {
        const PrismRays same = rays; /* as its address is taken, it lies in memory; `rays` stays in registers */
        hit = walk_cells(context, t, region, block, &same, p.entry, p.exit, drawn, p.inside, hit);
    } else
        before = walk_slices(context, t, region, block, &rays, &p, along_ray(t, t->slice, x, y), drawn, &hit, &last);
    const intl reaches_end = (t->halvings > 0 ? before : last) < drawn;
    if (tests_base)
        test_at(context, t, region, block, &hit, base, place_at(&t->bend, &rays, base, 0.0f),
                at_base & !hit.found & (rays.rise.sloped < 0.0f) & reaches_end, 0);
    /* A ray that leaves through a side is tested at this side, because the slices of the next prism all lie behind it.
     * The bounding planes are a little outside the prism, where heights are extrapolated. */
    const intl in_prism = hit.found;
    if (t->halvings > 0 || t->ends) {
        const Place end = place_at_depth(&t->bend, &rays, p.exit);
        test_at(context, t, region, block, &hit, p.exit, end, p.inside & !hit.found & reaches_end, -1);
        const intl refined = t->halvings > 0 ? hit.found & !at_once : hit.found & !in_prism;
        const floatl behind = select_lanes(before > p.entry, before, 0.5f * (p.entry + p.exit));
        refine_slice_hit(context, t, region, block, &rays, &hit, t->halvings > 0 ? t->halvings : END_HALVINGS, before,
                         refined, select_lanes(in_prism, (floatl)INFINITY, behind));
    }
    const floatl rounding = Z_ROUNDING * (fabs(p.entry) + fabs(p.exit));
    const intl found = hit.found & (hit.z >= p.entry - rounding) & (hit.z <= p.exit + rounding) &
                       (in_prism | is_in_prism(t, hit.place)) &
                       (DEPTH_OF(t->perspective, hit.z) > so_far);
    if (!any_lane(found))
        return;
    region->nearness[block] = select_lanes(found, DEPTH_OF(t->perspective, hit.z), so_far);
    region->farthest[block] = least_lane(region->nearness[block]);
    region->owner[block] = select_lanes(found, (intl)t->index, region->owner[block]);
    region->u[block] = select_lanes(found, hit.place.second, region->u[block]);
    region->v[block] = select_lanes(found, hit.place.third, region->v[block]);
}

#define FRAGMENTS 1
#include "raster/list.h"

kernel void draw_surface(BINS_PARAMETERS, PICTURE_PARAMETERS, global const int *corners, global const float *points,
                         global const float *uv, global const float *frames, global const float *tilts,
                         global const int *ends, global const uint *heights, global const uint *colors,
                         float spacing, int slices, int by_view /* 1: space_slices chooses each prism's spacing */,
                         int halvings, int slicing, int test, float band, int map_width, int map_height,
                         int color_width, int color_height, int color_levels, float pixel_size,
                         global const float *gradients ANISOTROPY_PARAMETER
#if LIT
                         ,
                         global const float *normals, global const float *normal_map, int normal_width,
                         int normal_height, Light light SHADOW_PARAMETERS
#endif
                         COUNTERS_PARAMETER(int)
)
{
    const Picture picture = PICTURE_VALUE;
    const Context context = {corners, projected, points, uv, frames, tilts, ends, heights, gradients, screen, nearest_w,
                             spacing, by_view ? pixel_size : 0.0f, band, slices, slicing, test, halvings, map_width,
                             map_height, COUNTERS_ARGUMENT(int)};
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
            const intl triangle = select_lanes(mine, owner, (intl)0);
            const SlicePoint p = slice_point_of(&context, triangle, select_lanes(mine, region.u[block], (floatl)0.0f),
                                                select_lanes(mine, region.v[block], (floatl)0.0f));
            const floatl n = region.nearness[block];
#if LIT || ANISOTROPIC
            const Vector point = point_at(screen, BLOCK_X(&region, block), BLOCK_Y(&region, block), n);
            const SliceSides sides = sides_of_slice(&context, &p, triangle, point);
            const Vector ahead = view_direction(screen, point);
#endif
#if ANISOTROPIC
            const UvSteps over = slice_uv_steps(&context, ahead, n, &p, &sides, anisotropy);
            const Footprint f = footprint_of(over, color_width, color_height, mine);
#else
            const floatl size = pixel_size * (screen.perspective ? 1.0f / n : (floatl)1.0f);
            const Vector along_u = vector_at(gradients, 2 * triangle), along_v = vector_at(gradients, 2 * triangle + 1);
            const floatl texels_2 = max_lanes(DOT(along_u, along_u) * ((float)color_width * color_width),
                                            DOT(along_v, along_v) * ((float)color_height * color_height));
            const Footprint f = isotropic_footprint(select_lanes(mine, texels_2 * size * size, (floatl)1.0f));
#endif
            add_footprint(colors, p.u, p.v, f, level_of_texels(f.texels_2, color_levels), color_width, color_height,
                          1.0f / 255.0f, &shade);
#if LIT
            const Vector base = normal_below(normals, &p);
            Vector normal;
            if (normal_width > 0) {
#if ANISOTROPIC
                const Vector mapped = mean_normal(normal_map, normal_width, normal_height, p.u, p.v, over, mine);
#else
                const Vector mapped = normal_in(normal_map, normal_width, normal_height, 0, p.u, p.v);
#endif
                normal = slice_normal_by_map(&context, base, triangle, mapped);
            } else
                normal = slice_normal_by_heights(&context, &p, &sides, base);
            floatl visible = VISIBILITY(point, normal);
#if SHADOWED
            const intl on_side = mine & is_on_side(&context, &p, sides.h);
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
