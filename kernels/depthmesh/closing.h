#ifndef DEPTHMESH_CLOSING_H
#define DEPTHMESH_CLOSING_H
/* Surface that no view saw, but that must be there (beside Pajarola, Sainz & Meng 2003, section 4.5).
 *
 * Each view knows that there is nothing before what it saw. What no view knows to be empty is solid or unknown. A pixel's
 * ray that meets the back of a mesh before any front has gone into a solid unnoticed: it is inside there, and from there
 * back to the eye up to the first empty point, where it is closed.
 *
 * A ray that goes through a rubber sheet, and comes to points known to be empty no more, has met something. Surfaces reach
 * half a sample beyond their last samples, into the sheet: rays that come there from before end there. What others meet
 * nobody knows, but surfaces on the far sides of depth edges are likely to go on behind the near ones. Each view is taken
 * to be empty up to those (`behind`), and the ray is closed at the first point that no view takes to be so; a ray that comes
 * to none ends in nothing. Rays that come out of hidden space behind a sheet and go into some again are closed only if
 * `enclosed`: beside an object they may go on for ever.
 *
 * Cost: up to 6 MARCH_STEPS points a ray, each looked up in views until one has seen it to be empty, for rays that meet backs
 * or sheets first.
 */
#include "depthmesh/tree.h"
#include "lib/color.h"
#include "lib/taps.h"

#define MARCH_STEPS 128   /* points along a ray */
#define SAMPLE_REACH 0.25f /* of a step: what lies so close to a sample is at it */
#define HALVINGS 7  /* of a step: where a ray leaves the empty space is known to 1/128 of one */

/* What the views saw: limits, their depths, INFINITY for background and 0 where nothing is known; behind: the depths that
 * the far sides of edges go on at, not less; far_colors: RGBA bytes there; clear, open: the least of limits, and of
 * behind, at a cell's four samples, at its upper left one's place; sizes: (views, 3) width, height and start; from_target: (views, 16)
 * from the target's pixel space to theirs; perspectives: 1 or 0; first_levels: (views,) their finest levels; closeness: (views,) weights of their positions. */
typedef struct {
    global const float *limits, *behind;
    global const uint *far_colors;
    global const float *clear, *open;
    global const int *sizes;
    global const float *from_target;
    global const int *perspectives, *first_levels;
    global const float *closeness;
    float stride;    /* along the target's depth, scene units */
    int perspective; /* the target */
    int views;       /* there are, drawn or not */
    int enclosed;    /* no view saw background, as in a room, so that every ray meets something */
} FreeSpace;

/* Where a view sees the target's pixel (x, y) at a nearness, and at what depth; whether it does. */
INLINED intl project_to_view(const FreeSpace *space, int view, floatl x, floatl y, floatl n, floatl *u, floatl *v, floatl *z)
{
    global const float *m = space->from_target + 16 * view;
    const float right = space->sizes[3 * view] - 1, bottom = space->sizes[3 * view + 1] - 1;
    const floatl inverse = 1.0f / MAP_ROW(m, 2, x, y, n), near = MAP_ROW(m, 3, x, y, n) * inverse;
    *u = MAP_ROW(m, 0, x, y, n) * inverse;
    *v = MAP_ROW(m, 1, x, y, n) * inverse;
    *z = DEPTH_OF(space->perspectives[view], near);
    return (inverse > 0.0f) & (*z > 0.0f) & (*u >= 0.0f) & (*v >= 0.0f) & (*u < right) & (*v < bottom);
}

/* Which of the pixels (x, y) that ask has a view seen through at the target's depth? By all four samples around it, where
 * up_to is the least depths of cells (clear, open), or by the `nearest` of them alone, within whose pixel that is, where
 * it is the samples' own. */
intl is_empty(const FreeSpace *space, global const float *up_to, int nearest, floatl x, floatl y, floatl depth, intl active)
{
    const floatl n = DEPTH_OF(space->perspective, depth), rounded = nearest ? 0.5f : 0.0f;
    intl empty = (intl)0;
    for (int view = 0; view < space->views && any_lane(active); view++) {
        floatl u, v, z;
        const intl sees = active & project_to_view(space, view, x, y, n, &u, &v, &z);
        if (!any_lane(sees))
            continue;
        const intl place = to_intl(v + rounded) * space->sizes[3 * view] + to_intl(u + rounded);
        const intl at = pick(sees, place, (intl)0) + space->sizes[3 * view + 2];
        const intl through = sees & (z < (floatl)(gather(up_to, at)));
        empty = empty | through;
        active = active & !through;
    }
    return empty;
}

/* Of those that ask, which rays have come out of empty space before they were at a depth, by a step at least? Where they
 * did: what lies between is not known to be empty. */
intl has_entered(const FreeSpace *space, floatl x, floatl y, floatl depth, intl active, floatl *entry)
{
    floatl inside = depth, outside = depth;
    intl walking = active, entered = (intl)0;
    for (int k = 0; k < MARCH_STEPS && any_lane(walking); k++) {
        const floatl next = inside - space->stride;
        if (space->perspective)
            walking = walking & (next > 0.0f);
        const intl empty = is_empty(space, space->clear, 0, x, y, next, walking);
        outside = pick(walking & empty, next, outside);
        inside = pick(walking & !empty, next, inside);
        entered = entered | (walking & empty & (inside < depth));
        walking = walking & !empty;
    }
    for (int k = 0; k < HALVINGS && any_lane(entered); k++) {
        const floatl middle = 0.5f * (inside + outside);
        const intl empty = is_empty(space, space->clear, 0, x, y, middle, entered);
        outside = pick(entered & empty, middle, outside);
        inside = pick(entered & !empty, middle, inside);
    }
    *entry = inside;
    return entered;
}

/* Does any view look at the pixel (x, y) at the target's depth, hidden or not? */
intl is_in_any_view(const FreeSpace *space, floatl x, floatl y, floatl depth)
{
    const floatl n = DEPTH_OF(space->perspective, depth);
    intl looked = (intl)0;
    for (int view = 0; view < space->views; view++) {
        floatl u, v, z;
        looked = looked | project_to_view(space, view, x, y, n, &u, &v, &z);
    }
    return looked;
}

/* Of those that ask, which rays end behind something that a view saw? From a depth on they come to places known to be
 * empty no more, after the last of which they are before a view still, or they have come out of one there already. That
 * last one. */
intl ends_hidden(const FreeSpace *space, floatl x, floatl y, floatl depth, intl active, floatl *last)
{
    floatl from = depth;
    intl walking = active, comes_out = (intl)0;
    for (int k = MARCH_STEPS - 1; k >= 0 && any_lane(walking); k--) {
        const floatl next = depth + k * space->stride;
        const intl empty = walking & is_empty(space, space->clear, 0, x, y, next, walking);
        from = pick(empty, next, from);
        comes_out = comes_out | empty;
        walking = walking & !empty;
    }
    floatl entry;
    const intl entered = has_entered(space, x, y, depth + space->stride, active & !comes_out, &entry);
    *last = pick(comes_out, from, entry);
    const intl ends = space->enclosed ? comes_out | entered : entered;
    return ends & is_in_any_view(space, x, y, *last + space->stride);
}

/* Of those that ask, which rays leave behind a depth what is empty? There; up_to, nearest: of `is_empty`. */
intl leaves_free_space(const FreeSpace *space, global const float *up_to, int nearest, floatl x, floatl y, floatl depth, intl active,
              floatl *there)
{
    floatl before = depth, beyond = depth;
    intl walking = active, met = (intl)0;
    for (int k = 1; k <= MARCH_STEPS && any_lane(walking); k++) {
        const floatl next = depth + k * space->stride;
        const intl open = is_empty(space, up_to, nearest, x, y, next, walking);
        before = pick(walking & open, next, before);
        beyond = pick(walking & !open, next, beyond);
        met = met | (walking & !open);
        walking = walking & open;
    }
    for (int k = 0; k < HALVINGS && any_lane(met); k++) {
        const floatl middle = 0.5f * (before + beyond);
        const intl open = is_empty(space, up_to, nearest, x, y, middle, met);
        before = pick(met & open, middle, before);
        beyond = pick(met & !open, middle, beyond);
    }
    *there = beyond;
    return met;
}

/* Of those that ask, which rays are at a depth where a sample is, within its pixel? */
intl is_at_sample(const FreeSpace *space, floatl x, floatl y, floatl depth, intl active)
{
    const floatl n = DEPTH_OF(space->perspective, pick(active, depth, (floatl)1.0f));
    intl found = (intl)0;
    for (int view = 0; view < space->views && any_lane(active); view++) {
        floatl u, v, z;
        const intl sees = active & project_to_view(space, view, x, y, n, &u, &v, &z);
        const intl at = pick(sees, to_intl(v + 0.5f) * space->sizes[3 * view] + to_intl(u + 0.5f), (intl)0);
        const intl sample = space->sizes[3 * view + 2] + at;
        const floatl limit = (floatl)(gather(space->limits, sample));
        found = found | (sees & (limit > 0.0f) & (fabs(limit - z) <= SAMPLE_REACH * space->stride));
    }
    return found;
}

/* Of those that ask, which rays come behind a depth to the rim of what a view saw? Where they leave what all samples around
 * tell to be empty, or else what the nearest ones do, they are at a sample: they have come from before it. Those that come
 * from the side go on behind it. */
intl meets_boundary(const FreeSpace *space, floatl x, floatl y, floatl depth, intl active, floatl *there)
{
    const floatl start = depth - space->stride / (1 << (HALVINGS - 1)); /* known to be empty, not nearly so alone */
    floatl first, later;
    intl leaves = leaves_free_space(space, space->clear, 0, x, y, start, active, &first);
    const intl at_once = is_at_sample(space, x, y, first, leaves);
    leaves = leaves_free_space(space, space->limits, 1, x, y, start, active & !at_once, &later);
    *there = pick(at_once, first, later);
    return at_once | is_at_sample(space, x, y, later, leaves);
}

/* Of a view's four samples around where it sees the pixel (x, y) at nearness n, how far each is off in depth, INFINITY
 * where there is none; shares: how close they are beside it, at its places; own: whether it is the sample itself that is so
 * close, and not what is taken to be behind it. */
INLINED void samples_around(const FreeSpace *space, int view, floatl x, floatl y, floatl n, floatl off[4], floatl share[4], intl at[4], intl own[4])
{
    floatl u, v, z;
    const intl sees = project_to_view(space, view, x, y, n, &u, &v, &z);
    const int width = space->sizes[3 * view], height = space->sizes[3 * view + 1];
    const Taps taps = clamped_taps(width, height, pick(sees, u, (floatl)0.0f), pick(sees, v, (floatl)0.0f));
    tap_weights(taps.fx, taps.fy, share);
    for (int k = 0; k < 4; k++) {
        const intl place = space->sizes[3 * view + 2] + taps.at[k];
        const floatl limit = (floatl)(gather(space->limits, place));
        const floatl behind = (floatl)(gather(space->behind, place));
        own[k] = !(fabs(behind - z) < fabs(limit - z));
        off[k] = pick(sees & (limit > 0.0f), pick(own[k], fabs(limit - z), fabs(behind - z)), (floatl)INFINITY);
        at[k] = taps.at[k];
    }
}

/* Adds the colours of those samples of all views that lie closest to what the pixels see at a nearness, where `given`;
 * their weights are returned. */
floatl add_closest(const FreeSpace *space, global const uint *colors, global const int *levels, floatl x, floatl y, floatl n,
                   intl given, Color *sum, intl *views)
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
            const floatl weight = pick(close, space->closeness[view] * (share[k] + 1e-3f), (floatl)0.0f);
            const intl place = start + at[k];
            const intl beyond = space->sizes[3 * view + 2] + at[k];
            add_color(sum, weight, color_of(pick(own[k], texels_at(colors, place), texels_at(space->far_colors, beyond))));
            total += weight;
            *views |= pick(close, (intl)(1 << (view & 31)), (intl)0);
        }
    }
    return total;
}
#endif
