#ifndef SLICING_OBJECT_SLICES_H
#define SLICING_OBJECT_SLICES_H
/* First hits of rays on an object. Points of a ray are tested on the slices of the object's box, from front to back. */
#include "slicing/view_volumes.h"

#define TO_SCREEN 3 /* the axis of slices parallel to the screen; the box's axes are 0, 1 and 2 */

typedef struct {
    float from_world[12]; /* row by row */
    float edges[3];       /* lengths of the box's edges, in scene units */
    float spacing;        /* distance between slices, in scene units */
    float first; /* with TO_SCREEN: slice numbers are depth / spacing - first, so that the middle slice is number 0 */
    int slices;           /* number of slices along the longest edge */
    int alone;            /* 1: only the slice with the number `only` is drawn */
    int only;
} Box;

/* The rays of the pixels (x, y). They start, at depth 0, at a perspective camera's centre or on an orthographic
 * camera's plane. */
WorldRay world_ray(Screen screen, floatl x, floatl y)
{
    const float *m = screen.to_world;
    const floatl across[3] = {PIXEL_ROW(m, 0, x, y), PIXEL_ROW(m, 1, x, y), PIXEL_ROW(m, 2, x, y)};
    Linear axis[3];
    for (int k = 0; k < 3; k++) {
        axis[k].fixed = screen.perspective ? (floatl)m[4 * k + 3] : across[k];
        axis[k].sloped = screen.perspective ? across[k] : (floatl)(-m[4 * k + 3]);
    }
    const WorldRay ray = {axis[0], axis[1], axis[2]};
    return ray;
}

/* The part of a ray in the box, from depth `front` to `back`. The ray meets slices where `number` is an integer. */
typedef struct {
    floatl front, back;
    Linear number;
    int number_max;  /* slice numbers in the box lie between -number_max and number_max */
    int alone, only; /* of Box */
} RaySegment;

/* from: depth of the near plane; slices_axis: an axis of the box, or TO_SCREEN */
RaySegment segment_in_box(Box box, const WorldRay *ray, floatl from, int slices_axis)
{
    /* No ray crosses more slices than the longest edge does. The factor 2 leaves room for rounding errors, unless
     * float32 cannot resolve depths in the box. */
    RaySegment segment = {from, INFINITY, {-box.first, 1.0f / box.spacing}, 2 * (box.slices + 1), box.alone, box.only};
    for (int k = 0; k < 3; k++) {
        const float *r = box.from_world + 4 * k;
        const Linear side = {r[0] * ray->x.fixed + r[1] * ray->y.fixed + r[2] * ray->z.fixed + r[3],
                             r[0] * ray->x.sloped + r[1] * ray->y.sloped + r[2] * ray->z.sloped};
        const floatl sloped = select_lanes(fabs(side.sloped) < 1e-20f, (floatl)1e-20f, side.sloped);
        const floatl at_0 = -side.fixed / sloped, at_1 = (1.0f - side.fixed) / sloped;
        segment.front = max_lanes(min_lanes(at_0, at_1), segment.front);
        segment.back = clamp_lanes(at_0, at_1, segment.back);
        if (k == slices_axis) {
            segment.number.fixed = side.fixed * (box.edges[k] / box.spacing);
            segment.number.sloped = sloped * (box.edges[k] / box.spacing);
        }
    }
    return segment;
}

/* Moves the `found` hits forward to where their rays enter the object: bisects the depths from hit - step to hit. */
void refine_object_hit(const Views *views, const ViewRays *rays, RaySegment segment, floatl step, int halvings,
                       intl found, floatl *hit, intl *tests)
{
    floatl before = max_lanes(*hit - step, segment.front);
    for (int i = 0; i < halvings && any_lane(found); i++) {
        const floatl middle = 0.5f * (before + *hit);
        intl passed = 0;
        const intl inside = inside_all(views, rays, middle, found, &passed, tests);
        *hit = select_lanes(inside, middle, *hit);
        before = select_lanes(inside, before, middle);
    }
}

/* Searches between two slices for parts of the object that are thinner than the slice spacing. The first view that
 * rejects the point at depth z has the number `passed` in the order of testing. On `crossed` rays, another view is the
 * first to reject the point of the previous slice, at depth z - step. Bisection finds the depth where the first
 * rejecting view changes, because points there may pass both views' tests. Sets `hit`, and returns which rays hit. */
intl intersect_between(const Views *views, const ViewRays *rays, RaySegment segment, floatl z, floatl step, int halvings,
                       intl crossed, intl passed, floatl *hit, intl *tests)
{
    floatl before = max_lanes(z - step, segment.front), after = z;
    intl found = 0;
    for (int i = 0; i < halvings && any_lane(crossed & !found); i++) {
        const floatl middle = 0.5f * (before + after);
        intl here = 0;
        const intl inside = inside_all(views, rays, middle, crossed & !found, &here, tests);
        const intl behind = here == passed;
        *hit = select_lanes(inside, middle, *hit);
        found = found | inside;
        after = select_lanes(behind, middle, after);
        before = select_lanes(behind, before, middle);
    }
    return found;
}

/* Returns which rays meet the object in front of `drawn`, the depth that the picture already shows. Sets `hit` to the
 * depth where they meet the object. */
OUTLINED intl intersect_object(const Views *views, const WorldRay *ray, RaySegment segment, floatl drawn, int halvings,
                      floatl *hit, intl *tests)
{
    intl searches = segment.front <= segment.back, found = 0, last = -1;
    if (!any_lane(searches))
        return found;
    ViewRays rays;
    hold_rays(views, ray, &rays);
    const intl rises = segment.number.sloped > 0.0f;
    const floatl step = select_lanes(rises, (floatl)1.0f, (floatl)-1.0f), per_slice = 1.0f / segment.number.sloped;
    const floatl number_max = segment.number_max,
                 s_front = clamp_lanes(AT(segment.number, segment.front), -number_max, number_max);
    /* Bisection may move a hit forward by one slice spacing, so slices one spacing behind `drawn` are tested, too. */
    const floatl back = min_lanes(drawn + fabs(per_slice), segment.back);
    floatl slice = segment.alone ? (floatl)(float)segment.only
                                 : select_lanes(rises, ceil_lanes(s_front), floor_lanes(s_front));
    for (int remaining = segment.alone ? 0 : 2 * segment.number_max; remaining >= 0; remaining--, slice += step) {
        const floatl z = (slice - segment.number.fixed) * per_slice;
        searches = searches & !found & (z <= back);
        if (!any_lane(searches))
            break;
        intl passed = 0;
        const intl active = searches & (z >= segment.front),
                   inside = inside_all(views, &rays, z, active, &passed, tests);
        *hit = select_lanes(inside, z, *hit);
        found = found | inside;
        const intl crossed = active & !inside & (passed != last);
        if (any_lane(crossed))
            found = found |
                    intersect_between(views, &rays, segment, z, fabs(per_slice), halvings, crossed, passed, hit, tests);
        last = select_lanes(active, passed, last);
    }
    refine_object_hit(views, &rays, segment, fabs(per_slice), halvings, found, hit, tests);
    return found;
}
#endif
