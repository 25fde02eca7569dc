#ifndef SLICING_MAP_CELLS_H
#define SLICING_MAP_CELLS_H
/* Rays intersected with the surface without slices, in the cells between texel centres.
 *
 * A ray in a prism is cut into legs. Along a leg u, v and height count as linear, so in a cell the map's height less
 * the ray's is quadratic.
 */
#include "slicing/prism_rays.h"

#define LEG_TEXELS 1024.0f /* most texels that a leg crosses along an axis: more would be rounded too much */
#define PRISM_LEGS_MAX 4096.0f /* most legs of a ray in a prism */

typedef struct {
    intl found;
    floatl z;
    Place place;
} SliceHit;

/* Limits the shares *from to *to of a leg to those where a value, `first` at 0 and `last` at 1, is not negative. */
INLINED void limit_leg(floatl first, floatl last, floatl *from, floatl *to)
{
    const floatl root = first / (first - last);
    *from = select_lanes(first < 0.0f, max_lanes(*from, root), *from);
    *to = select_lanes(last < 0.0f, min_lanes(*to, root), *to);
}

/* Intersects rays with the surface along a leg between the places `first` and `last`, cell by cell. z: the leg's depth
 * at its start; deep: its length in depth; to: the share of the leg at which a ray ends */
OUTLINED void walk_leg(const Context *context, const Prism *t, const Region *region, int block, floatl z, floatl deep,
                       Place first, Place last, floatl to, intl tries, SliceHit *hit)
{
    const intl columns = context->map_width, rows = context->map_height;
    const floatl width = to_floatl(columns), height = to_floatl(rows), per_width = 1.0f / width,
                 per_height = 1.0f / height;
    const HeightMap map = {columns, rows, 0, per_width, per_height};
    const Place by = {last.h - first.h, last.second - first.second, last.third - first.third};
    const floatl u = t->u + first.second * t->u_second + first.third * t->u_third;
    const floatl v = t->v + first.second * t->v_second + first.third * t->v_third;
    /* In texels, from the tile at the leg's start, because small numbers are rounded less */
    const floatl x = WRAPPED_UV(CLAMPED_U, u) * width - 0.5f, y = WRAPPED_UV(CLAMPED_V, v) * height - 0.5f;
    const floatl dx = (by.second * t->u_second + by.third * t->u_third) * width;
    const floatl dy = (by.second * t->v_second + by.third * t->v_third) * height;
    const float rounding = t->share_rounding;
    floatl s = 0.0f;
    to = min_lanes(to, (floatl)1.0f);
    limit_leg(first.second + rounding, last.second + rounding, &s, &to);
    limit_leg(first.third + rounding, last.third + rounding, &s, &to);
    limit_leg(1.0f - first.second - first.third + rounding, 1.0f - last.second - last.third + rounding, &s, &to);
    limit_leg(first.h + rounding, last.h + rounding, &s, &to);
    const intl still_x = fabs(dx) < AXIS_PARALLEL, still_y = fabs(dy) < AXIS_PARALLEL;
    const floatl per_x = 1.0f / dx, per_y = 1.0f / dy;
    const floatl nudge = NUDGE * min_lanes(min_lanes(fabs(per_x), fabs(per_y)), 1.0f);
    const floatl side_x = select_lanes(dx > 0.0f, (floatl)1.0f, (floatl)0.0f) - x,
                 side_y = select_lanes(dy > 0.0f, (floatl)1.0f, (floatl)0.0f) - y;
    for (tries = tries & (s < to); any_lane(tries); tries = tries & !hit->found & (s < to)) {
        const floatl inside = s + nudge, at_x = x + inside * dx, at_y = y + inside * dy;
        FLOOR(at_x, cx, ix)
        FLOOR(at_y, cy, iy)
        const intl tx = WRAPPED(CLAMPED_U, cx, ix, columns, per_width),
                   ty = WRAPPED(CLAMPED_V, cy, iy, rows, per_height);
        const floatl t_x = select_lanes(still_x, to, (cx + side_x) * per_x),
                     t_y = select_lanes(still_y, to, (cy + side_y) * per_y);
        const floatl leaves = max_lanes(min_lanes(t_x, t_y), inside);
        const Patch patch = read_cell(context->heights, map, ix, iy, tx, ty);
        const floatl from = s, h = first.h + s * by.h;
        if (COUNTERS)
            add_to_counters(context->counters, region, block, context->screen, tries & 1);
        s = leaves;
        const floatl highest = max_lanes(max_lanes(patch.aa, patch.ab), max_lanes(patch.ba, patch.bb));
        if (!any_lane(tries & (highest * HEIGHT_UNIT >= min_lanes(h, first.h + leaves * by.h))))
            continue;
        const Quadratic alpha = heights_along(patch, x + from * dx - cx, y + from * dy - cy, dx, dy);
        const Quadratic above = {alpha.fixed - h, alpha.sloped - by.h, alpha.curved};
        const floatl ahead = first_not_negative(above), at = from + ahead;
        intl passed = tries & (ahead >= 0.0f) & (at <= leaves + nudge) & (at <= to);
        if (context->test == INSIDE) /* where alpha is 0 there is nothing */
            passed = passed & (alpha.fixed + ahead * (alpha.sloped + ahead * alpha.curved) > 0.0f);
        hit->z = select_lanes(passed, z + at * deep, hit->z);
        hit->found = hit->found | passed;
    }
}

/* The least number of legs, of equal length in depth, along which u, v and height are linear to 1 / PIXEL_PARTS of a
 * pixel and to 1 / TEXTURE_PARTS of the displacement. entry, exit: depths */
INLINED floatl legs_of(const Context *context, const Prism *t, const PrismRays *rays, floatl entry, floatl exit,
                       Place start, Place end)
{
    const floatl h = end.h - start.h, second = end.second - start.second, third = end.third - start.third;
    const float part = 1.0f / 3.0f; /* not half: there, a curve with a turning point may meet its chord */
    const floatl z = entry + part * (exit - entry);
    const Place between = place_at_depth(&t->bend, rays, z);
    const floatl off = fabs(between.h - start.h - part * h) * t->lengths.rise +
                       fabs(between.second - start.second - part * second) * t->lengths.second +
                       fabs(between.third - start.third - part * third) * t->lengths.third;
    const floatl pixel = t->perspective ? context->pixel * z : (floatl)context->pixel;
    const floatl parts = off * max_lanes(PIXEL_PARTS / pixel, (floatl)(TEXTURE_PARTS / t->lengths.rise));
    const floatl columns = (second * t->u_second + third * t->u_third) * context->map_width,
                 rows = (second * t->v_second + third * t->v_third) * context->map_height;
    const floatl most = max_lanes(fabs(columns), fabs(rows)) * (1.0f / LEG_TEXELS);
    return clamp_lanes(ceil_lanes(max_lanes(sqrt(parts), most)), (floatl)1.0f, (floatl)PRISM_LEGS_MAX);
}

/* Intersects rays with the surface between the depths `entry` and `exit`, in legs. drawn: depths beyond which
 * everything is occluded; tries: rays that enter the prism */
OUTLINED SliceHit walk_cells(const Context *context, const Prism *t, const Region *region, int block,
                             const PrismRays *rays, floatl entry, floatl exit, floatl drawn, intl tries, SliceHit hit)
{
    Place first = place_at_depth(&t->bend, rays, entry);
    const Place end = place_at_depth(&t->bend, rays, exit);
    const floatl legs = legs_of(context, t, rays, entry, exit, first, end), deep = (exit - entry) / legs;
    tries = tries & !hit.found;
    for (int k = 0; any_lane(tries); k++) {
        const floatl z = entry + k * deep;
        const intl more = tries & (k + 1 < legs);
        const Place last = any_lane(more) ? place_at_depth(&t->bend, rays, z + deep) : end;
        walk_leg(context, t, region, block, z, deep, first, last, (drawn - z) / deep, tries, &hit);
        first = last;
        tries = more & !hit.found;
    }
    hit.place = place_at_depth(&t->bend, rays, hit.z); /* exact, so that textures do not flicker */
    return hit;
}
#endif
