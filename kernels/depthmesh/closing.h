#ifndef DEPTHMESH_CLOSING_H
#define DEPTHMESH_CLOSING_H
/* Surface that no view saw, but that must be there (beside Pajarola, Sainz & Meng 2003, section 4.5).
 *
 * Each view knows that there is nothing before what it saw. What no view knows to be empty is solid or unknown. A pixel's
 * ray that meets the back of a mesh before any front has gone into a solid unnoticed: it is inside there, and from there
 * back to the eye up to the first empty point. A ray that goes through a rubber sheet and never comes to a point that is
 * known to be empty again has met something behind it. Both are closed where they leave the empty space; no other ray is.
 *
 * Cost: up to STEPS points a ray, each looked up in all views, for rays that meet backs or sheets first.
 */
#include "depthmesh/tree.h"
#include "lib/color.h"
#include "lib/taps.h"

#ifndef ALL
#define ALL 1 /* views there are, drawn or not */
#endif
#define STEPS 128  /* points along a ray */
#define HALVINGS 7 /* of a step: where a ray leaves the empty space is known to 1/128 of one */

/* What the views saw: limits, their depths, INFINITY for background and 0 where nothing is known; sizes: (ALL, 3) width,
 * height and start; from_target: (ALL, 16) from the target's pixel space to theirs; perspectives: 1 or 0; first_levels:
 * (ALL,) their finest levels; closeness: (ALL,) weights of their positions. */
typedef struct {
    global const float *limits;
    global const int *sizes;
    global const float *from_target;
    global const int *perspectives, *first_levels;
    global const float *closeness;
    float stride;    /* along the target's depth, scene units */
    int perspective; /* the target */
} Seen;

/* Where a view sees the target's pixel (x, y) at a nearness, and at what depth; whether it does. */
INLINED intl seen_by(const Seen *seen, int view, floatl x, floatl y, floatl n, floatl *u, floatl *v, floatl *z)
{
    global const float *m = seen->from_target + 16 * view;
    const float right = seen->sizes[3 * view] - 1, bottom = seen->sizes[3 * view + 1] - 1;
    const floatl inverse = 1.0f / MAP_ROW(m, 2, x, y, n), near = MAP_ROW(m, 3, x, y, n) * inverse;
    *u = MAP_ROW(m, 0, x, y, n) * inverse;
    *v = MAP_ROW(m, 1, x, y, n) * inverse;
    *z = DEPTH_OF(seen->perspectives[view], near);
    return (inverse > 0.0f) & (*z > 0.0f) & (*u >= 0.0f) & (*v >= 0.0f) & (*u < right) & (*v < bottom);
}

/* Has a view seen through the pixel (x, y) at the target's depth, with all four samples around it? */
intl is_empty(const Seen *seen, floatl x, floatl y, floatl depth)
{
    const floatl n = DEPTH_OF(seen->perspective, depth);
    intl empty = (intl)0;
    for (int view = 0; view < ALL; view++) {
        floatl u, v, z;
        const int width = seen->sizes[3 * view];
        intl through = seen_by(seen, view, x, y, n, &u, &v, &z);
        const intl first = seen->sizes[3 * view + 2] + pick(through, to_intl(v) * width + to_intl(u), (intl)0);
        for (int k = 0; k < 4; k++) {
            const intl at = first + (k & 1) + (k >> 1) * width;
            through = through & (z < (floatl)(gather(seen->limits, at)));
        }
        empty = empty | through;
    }
    return empty;
}

/* Of those that ask, which rays come to nothing that is known to be empty, from a depth on? */
intl stays_hidden(const Seen *seen, floatl x, floatl y, floatl depth, intl asks)
{
    for (int k = 0; k < STEPS && any_lane(asks); k++)
        asks = asks & !is_empty(seen, x, y, depth + k * seen->stride);
    return asks;
}

/* Of those that ask, which rays have come out of empty space before they were at a depth, by a step at least? Where they
 * did: what lies between is not known to be empty. */
intl has_entered(const Seen *seen, floatl x, floatl y, floatl depth, intl asks, floatl *entry)
{
    floatl inside = depth, outside = depth;
    intl walking = asks, entered = (intl)0;
    for (int k = 0; k < STEPS && any_lane(walking); k++) {
        const floatl next = inside - seen->stride;
        if (seen->perspective)
            walking = walking & (next > 0.0f);
        const intl empty = is_empty(seen, x, y, next);
        outside = pick(walking & empty, next, outside);
        inside = pick(walking & !empty, next, inside);
        entered = entered | (walking & empty & (inside < depth));
        walking = walking & !empty;
    }
    for (int k = 0; k < HALVINGS && any_lane(entered); k++) {
        const floatl middle = 0.5f * (inside + outside);
        const intl empty = is_empty(seen, x, y, middle);
        outside = pick(entered & empty, middle, outside);
        inside = pick(entered & !empty, middle, inside);
    }
    *entry = inside;
    return entered;
}

/* Of a view's four samples around where it sees the pixel (x, y) at nearness n, how far each is off in depth, INFINITY
 * where there is none; shares: how close they are beside it, at its places. */
INLINED void samples_around(const Seen *seen, int view, floatl x, floatl y, floatl n, floatl off[4], floatl share[4], intl at[4])
{
    floatl u, v, z;
    const intl sees = seen_by(seen, view, x, y, n, &u, &v, &z);
    const int width = seen->sizes[3 * view], height = seen->sizes[3 * view + 1];
    const Taps taps = clamped_taps(width, height, pick(sees, u, (floatl)0.0f), pick(sees, v, (floatl)0.0f));
    tap_weights(taps, share);
    for (int k = 0; k < 4; k++) {
        const intl place = seen->sizes[3 * view + 2] + taps.at[k];
        const floatl limit = (floatl)(gather(seen->limits, place));
        off[k] = pick(sees & (limit > 0.0f), fabs(limit - z), (floatl)INFINITY);
        at[k] = taps.at[k];
    }
}

/* Adds the colours of those samples of all views that lie closest to what the pixels see at a nearness, where `given`;
 * their weights are returned. */
floatl add_closest(const Seen *seen, global const uint *colors, global const int *levels, floatl x, floatl y, floatl n,
                   intl given, Color *sum, intl *views)
{
    floatl least = INFINITY, total = 0.0f, off[4], share[4];
    intl at[4];
    for (int view = 0; view < ALL; view++) {
        samples_around(seen, view, x, y, n, off, share, at);
        for (int k = 0; k < 4; k++)
            least = lesser(off[k], least);
    }
    given = given & (least < INFINITY);
    for (int view = 0; view < ALL && any_lane(given); view++) {
        samples_around(seen, view, x, y, n, off, share, at);
        const int start = levels[3 * seen->first_levels[view] + 2];
        for (int k = 0; k < 4; k++) {
            const intl close = given & (off[k] <= least + seen->stride);
            const floatl weight = pick(close, seen->closeness[view] * (share[k] + 1e-3f), (floatl)0.0f);
            const intl place = start + at[k];
            add_color(sum, weight, color_of(texels_at(colors, place)));
            total += weight;
            *views |= pick(close, (intl)(1 << (view & 31)), (intl)0);
        }
    }
    return total;
}
#endif
