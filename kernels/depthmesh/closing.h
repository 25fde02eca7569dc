#ifndef DEPTHMESH_CLOSING_H
#define DEPTHMESH_CLOSING_H
/* Closing: draws surface that no view saw, but that must be there (in addition to Pajarola, Sainz & Meng 2003, section
 * 4.5).
 *
 * A point is free if a view saw through it, that is, if it lies in front of the view's sample there. Other points are
 * solid or unknown. If a pixel's ray meets the back of a mesh before any front, it has entered a solid through a
 * surface that no view saw. The surface is drawn where the ray left free space: at the first free point on the way from
 * the back to the eye.
 *
 * A ray may pass through a rubber sheet (a triangle that bridges a depth edge) and reach points that are not free: then
 * it has met a surface. If the ray comes from the front and leaves free space within half a sample of the samples at
 * the sheet's near end, it has met the rim of the near surface. Otherwise no view saw the surface. But the surface on
 * the far side of a depth edge is likely to continue behind the near surface, so space counts as free up to this
 * continued surface (`extended_depths`). Surface is drawn where the ray leaves this space; if the ray never leaves it,
 * the pixel stays empty. A ray may also leave the occluded space behind a sheet and enter occluded space again. Then
 * surface is drawn only if the scene is `enclosed`: beside a single object, such rays may never meet a surface.
 *
 * Cost: at most 6 MARCH_STEPS points on each ray that first meets a back or a sheet; each point is looked up in one
 * view after the other, until a view saw through the point.
 */
#include "depthmesh/tree.h"
#include "lib/color.h"
#include "lib/taps.h"

#define MARCH_STEPS 128   /* most points that a march looks up along a ray */
#define SAMPLE_REACH 0.25f /* in steps: a point is at a sample if their depths differ by at most this */
#define BEFORE_1 (1.0f - 1e-6f) /* factor that moves the last sample's coordinate just into the last cell */
#define HALVINGS 7 /* bisections of a step: where a ray leaves free space is known to 1/128 of a step */

/* Depths up to which each view saw free space. free_depths: the depth of each sample; INFINITY: background, 0: not
 * known. extended_depths: the same, but at a sample on the near side of a depth edge the depth at which the far side's
 * surface continues behind the sample. far_colors: RGBA bytes of the continued surfaces. cell_free_depths,
 * cell_extended_depths: minima of these depths over a cell's four samples, stored at the upper left sample. sizes:
 * (views, 3) width, height and start in these arrays. from_target: (views, 16) maps from the target's pixel space to
 * each view's. perspectives: (views,) 1 or 0. first_levels: (views,) index of the finest level in the `levels` of
 * blend.cl. closeness: (views,) positional weights. */
typedef struct {
    global const float *free_depths, *extended_depths;
    global const uint *far_colors;
    global const float *cell_free_depths, *cell_extended_depths;
    global const int *sizes;
    global const float *from_target;
    global const int *perspectives, *first_levels;
    global const float *closeness;
    float stride;    /* a step along a ray: change of depth in the target, scene units */
    int perspective; /* 1: the target is perspective */
    int views;       /* number of all views, drawn or not */
    int enclosed;    /* 1: no view saw background, as in a room, so every ray meets a surface */
} FreeSpace;

/* Projects the points of the target's pixels (x, y) at nearness n into a view: to (u, v) at depth z. Returns which
 * points lie in the view's image, whole pixels at its border included; (u, v) is clamped to the area between
 * samples. */
INLINED intl project_to_view(const FreeSpace *space, int view, floatl x, floatl y, floatl n, floatl *u, floatl *v,
                             floatl *z)
{
    global const float *m = space->from_target + 16 * view;
    const float right = space->sizes[3 * view] - 1, bottom = space->sizes[3 * view + 1] - 1;
    const floatl inverse = 1.0f / MAP_ROW(m, 2, x, y, n), near = MAP_ROW(m, 3, x, y, n) * inverse;
    const floatl to_u = MAP_ROW(m, 0, x, y, n) * inverse, to_v = MAP_ROW(m, 1, x, y, n) * inverse;
    *u = clamp_lanes(to_u, (floatl)0.0f, (floatl)(right * BEFORE_1));
    *v = clamp_lanes(to_v, (floatl)0.0f, (floatl)(bottom * BEFORE_1));
    *z = DEPTH_OF(space->perspectives[view], near);
    const intl in_columns = (to_u >= -BORDER) & (to_u <= right + BORDER);
    const intl in_rows = (to_v >= -BORDER) & (to_v <= bottom + BORDER);
    return (inverse > 0.0f) & (*z > 0.0f) & in_columns & in_rows;
}

/* Returns which `active` points of the pixels (x, y) at a depth are free. With nearest 0, `depths` belong to cells: a
 * point is free if it lies in front of any view's four samples around it; with nearest 1, to samples: if it lies in
 * front of any view's nearest sample */
intl is_free(const FreeSpace *space, global const float *depths, int nearest, floatl x, floatl y, floatl depth,
             intl active)
{
    const floatl n = DEPTH_OF(space->perspective, depth), rounded = nearest ? 0.5f : 0.0f;
    intl free = (intl)0;
    for (int view = 0; view < space->views && any_lane(active); view++) {
        floatl u, v, z;
        const intl sees = active & project_to_view(space, view, x, y, n, &u, &v, &z);
        if (!any_lane(sees))
            continue;
        const intl place = to_intl(v + rounded) * space->sizes[3 * view] + to_intl(u + rounded);
        const intl at = select_lanes(sees, place, (intl)0) + space->sizes[3 * view + 2];
        const intl through = sees & (z < (floatl)(gather(depths, at)));
        free = free | through;
        active = active & !through;
    }
    return free;
}

/* Bisects the steps from the depths `in_free` to the depths `beyond`, which are not free, on the rays in `which`. */
INLINED void bisect_to_free(const FreeSpace *space, global const float *depths, int nearest, floatl x, floatl y,
                            intl which, floatl *in_free, floatl *beyond)
{
    for (int k = 0; k < HALVINGS && any_lane(which); k++) {
        const floatl middle = 0.5f * (*in_free + *beyond);
        const intl free = is_free(space, depths, nearest, x, y, middle, which);
        *in_free = select_lanes(which & free, middle, *in_free);
        *beyond = select_lanes(which & !free, middle, *beyond);
    }
}

/* Returns which `active` rays left free space at least a step in front of `depth`. Sets `entry` to the depth at which
 * they left free space. */
INLINED intl has_entered(const FreeSpace *space, floatl x, floatl y, floatl depth, intl active, floatl *entry)
{
    floatl inside = depth, outside = depth;
    intl walking = active, entered = (intl)0;
    for (int k = 0; k < MARCH_STEPS && any_lane(walking); k++) {
        const floatl next = inside - space->stride;
        if (space->perspective)
            walking = walking & (next > 0.0f);
        const intl free = is_free(space, space->cell_free_depths, 0, x, y, next, walking);
        outside = select_lanes(walking & free, next, outside);
        inside = select_lanes(walking & !free, next, inside);
        entered = entered | (walking & free & (inside < depth));
        walking = walking & !free;
    }
    bisect_to_free(space, space->cell_free_depths, 0, x, y, entered, &outside, &inside);
    *entry = inside;
    return entered;
}

/* Returns which points of the pixels (x, y) at a depth lie in any view's image, occluded or not. */
INLINED intl is_in_any_view(const FreeSpace *space, floatl x, floatl y, floatl depth)
{
    const floatl n = DEPTH_OF(space->perspective, depth);
    intl found = (intl)0;
    for (int view = 0; view < space->views; view++) {
        floatl u, v, z;
        found = found | project_to_view(space, view, x, y, n, &u, &v, &z);
    }
    return found;
}

/* Returns which `active` rays end in occluded space, behind a surface that a view saw. Such a ray leaves free space in
 * front of `depth` (in an enclosed scene, also behind `depth`) and goes on in a view's image. Sets `last` to the depth
 * of the last free point. Unless the scene is enclosed, rays that have a free point behind `depth` are left out; most
 * reach this point within a few steps. */
INLINED intl ends_hidden(const FreeSpace *space, floatl x, floatl y, floatl depth, intl active, floatl *last)
{
    floatl from = depth;
    intl walking = active, comes_out = (intl)0;
    for (int k = 0; k < MARCH_STEPS && any_lane(walking); k++) {
        const floatl next = depth + (space->enclosed ? MARCH_STEPS - 1 - k : k) * space->stride;
        const intl free = walking & is_free(space, space->cell_free_depths, 0, x, y, next, walking);
        from = select_lanes(free, next, from);
        comes_out = comes_out | free;
        walking = walking & !free;
    }
    floatl entry;
    const intl entered = has_entered(space, x, y, depth + space->stride, active & !comes_out, &entry);
    *last = select_lanes(comes_out, from, entry);
    const intl ends = space->enclosed ? comes_out | entered : entered;
    if (!any_lane(ends))
        return ends;
    return ends & is_in_any_view(space, x, y, *last + space->stride);
}

/* Returns which `active` rays leave free space behind `depth`. Sets `exit` to the depth at which they leave it. depths,
 * nearest: as in `is_free` */
static intl leaves_free_space(const FreeSpace *space, global const float *depths, int nearest, floatl x, floatl y,
                       floatl depth, intl active, floatl *exit)
{
    floatl before = depth, beyond = depth;
    intl walking = active, left = (intl)0;
    for (int k = 1; k <= MARCH_STEPS && any_lane(walking); k++) {
        const floatl next = depth + k * space->stride;
        const intl free = is_free(space, depths, nearest, x, y, next, walking);
        before = select_lanes(walking & free, next, before);
        beyond = select_lanes(walking & !free, next, beyond);
        left = left | (walking & !free);
        walking = walking & free;
    }
    bisect_to_free(space, depths, nearest, x, y, left, &before, &beyond);
    *exit = beyond;
    return left;
}

/* Returns which `active` points of the pixels (x, y) at a depth lie at a sample: in some view, the sample whose pixel
 * contains the point has nearly the point's depth. */
intl is_at_sample(const FreeSpace *space, floatl x, floatl y, floatl depth, intl active)
{
    const floatl n = DEPTH_OF(space->perspective, select_lanes(active, depth, (floatl)1.0f));
    intl found = (intl)0;
    for (int view = 0; view < space->views && any_lane(active); view++) {
        floatl u, v, z;
        const intl sees = active & project_to_view(space, view, x, y, n, &u, &v, &z);
        const intl at = select_lanes(sees, to_intl(v + 0.5f) * space->sizes[3 * view] + to_intl(u + 0.5f), (intl)0);
        const intl sample = space->sizes[3 * view + 2] + at;
        const floatl free_depth = (floatl)(gather(space->free_depths, sample));
        found = found | (sees & (free_depth > 0.0f) & (fabs(free_depth - z) <= SAMPLE_REACH * space->stride));
    }
    return found;
}

/* Returns which `active` rays meet, behind `depth`, the rim of a surface that a view saw: the half sample beyond the
 * surface's last samples. Such a ray comes from the front, and leaves free space at a sample. Free space is first
 * judged by the four samples around a point, then, if this finds no rim, by the nearest sample. Rays from the side pass
 * behind the surface. Sets `rim` to the rim's depth. */
static intl meets_rim(const FreeSpace *space, floatl x, floatl y, floatl depth, intl active, floatl *rim)
{
    const floatl start = depth -
                         space->stride / (1 << (HALVINGS - 1)); /* a free point: bisection errs by less */
    floatl first, later;
    intl leaves = leaves_free_space(space, space->cell_free_depths, 0, x, y, start, active, &first);
    const intl at_once = is_at_sample(space, x, y, first, leaves);
    leaves = leaves_free_space(space, space->free_depths, 1, x, y, start, active & !at_once, &later);
    *rim = select_lanes(at_once, first, later);
    return at_once | is_at_sample(space, x, y, later, leaves);
}

/* Returns which pixels (x, y) show a surface that no view saw. Rays in `within` leave a solid at nearness `back`; rays
 * in `through` pass a sheet at nearness `sheet`. Sets `n` to the surface's nearness. */
static intl is_closed(const FreeSpace *space, floatl x, floatl y, floatl back, intl within, floatl sheet, intl through,
               floatl *n)
{
    floatl depth = DEPTH_OF(space->perspective, select_lanes(within, back, (floatl)1.0f)), entry = depth;
    const intl solid = has_entered(space, x, y, depth, within, &entry);
    depth = DEPTH_OF(space->perspective, select_lanes(through, sheet, (floatl)1.0f)) + space->stride;
    floatl last;
    intl ends = ends_hidden(space, x, y, depth, through & !solid, &last);
    floatl rim, behind;
    const intl on_rim = meets_rim(space, x, y, last, ends, &rim);
    const intl on_far = leaves_free_space(space, space->cell_extended_depths, 0, x, y, last, ends & !on_rim, &behind);
    *n = DEPTH_OF(space->perspective, select_lanes(solid, entry, select_lanes(on_rim, rim, behind)));
    return solid | on_rim | on_far;
}

/* Closes pixels of a block: sets `front` to the nearness of surface that no view saw, and returns for which pixels (x,
 * y). nearest: nearness of the near plane. back, sheet: nearness of the nearest back and sheet; EMPTY for none. */
static intl close_block(const FreeSpace *space, float nearest, float epsilon, floatl x, floatl y, floatl back,
                         floatl sheet, floatl *front)
{
    const floatl deepest = space->perspective ? back / (1.0f + epsilon * back) : back - epsilon;
    const intl within = (back > EMPTY) & (*front < deepest), through = (*front == EMPTY) & (sheet > EMPTY);
    if (!any_lane(within | through))
        return (intl)0;
    floatl n;
    intl closed = is_closed(space, x, y, back, within, sheet, through, &n);
    closed = closed & (n <= nearest);
    *front = select_lanes(closed, n, *front);
    return closed;
}

/* Finds a view's four samples around the points of the pixels (x, y) at nearness n. off: difference in depth between
 * point and sample, INFINITY for no sample; share: the sample's bilinear weight; at: its index; own: the point is
 * closer to the sample itself than to the continued surface behind the sample. */
INLINED void samples_around(const FreeSpace *space, int view, floatl x, floatl y, floatl n, floatl off[4],
                            floatl share[4], intl at[4], intl own[4])
{
    floatl u, v, z;
    const intl sees = project_to_view(space, view, x, y, n, &u, &v, &z);
    const int width = space->sizes[3 * view], height = space->sizes[3 * view + 1];
    const Taps taps = clamped_taps(width, height, select_lanes(sees, u, (floatl)0.0f),
                                   select_lanes(sees, v, (floatl)0.0f));
    tap_weights(taps.fx, taps.fy, share);
    for (int k = 0; k < 4; k++) {
        const intl place = space->sizes[3 * view + 2] + taps.at[k];
        const floatl free_depth = (floatl)(gather(space->free_depths, place));
        const floatl extended_depth = (floatl)(gather(space->extended_depths, place));
        own[k] = !(fabs(extended_depth - z) < fabs(free_depth - z));
        off[k] = select_lanes(sees & (free_depth > 0.0f),
                              select_lanes(own[k], fabs(free_depth - z), fabs(extended_depth - z)), (floatl)INFINITY);
        at[k] = taps.at[k];
    }
}

/* Adds to the `given` pixels (x, y) the weighted colours of the samples that lie closest in depth to the pixels' points
 * at nearness n, from all views. Returns the sums of weights, and sets bit k of `views` where view k gave colour. */
static floatl add_closest(const FreeSpace *space, global const uint *colors, global const int *levels, floatl x, floatl y,
                   floatl n, intl given, Color *sum, intl *views)
{
    floatl least = INFINITY, total = 0.0f, off[4], share[4];
    intl at[4], own[4];
    for (int view = 0; view < space->views; view++) {
        samples_around(space, view, x, y, n, off, share, at, own);
        for (int k = 0; k < 4; k++)
            least = min_lanes(off[k], least);
    }
    given = given & (least < INFINITY);
    for (int view = 0; view < space->views && any_lane(given); view++) {
        samples_around(space, view, x, y, n, off, share, at, own);
        const int start = levels[3 * space->first_levels[view] + 2];
        for (int k = 0; k < 4; k++) {
            const intl close = given & (off[k] <= least + space->stride);
            if (!any_lane(close))
                continue;
            const floatl weight = select_lanes(close, space->closeness[view] * (share[k] + 1e-3f), (floatl)0.0f);
            const intl place = start + at[k];
            const intl beyond = space->sizes[3 * view + 2] + at[k];
            intl word = texels_at(colors, place);
            if (any_lane(close & !own[k]))
                word = select_lanes(own[k], word, texels_at(space->far_colors, beyond));
            add_color(sum, weight, color_of(word));
            total += weight;
            *views |= select_lanes(close, (intl)(1 << (view & 31)), (intl)0);
        }
    }
    return total;
}
#endif
