#ifndef RELIEF_SEARCH_H
#define RELIEF_SEARCH_H
/* First hit of a ray (ray.h) on a height field that follows a quadric (Oliveira & Policarpo 2005, sections 3.1 to 3.4).
 * The surface lies at depth 1 - height.
 *
 * texels: lib/heights.h. bounds: a maximum mipmap (Tevs et al. 2008), in units of 1/65535, two in each uint. Tier 0
 * holds the greatest height in each cell between 2x2 texels, tier 1 the greatest height in 2x2 cells, and so on.
 * BOUND_AT gives the index of a bound. levels: (levels, LEVEL_INTS) for each mip level: its width, its height, its
 * start in texels; the number of tiers of its bounds, their start, log2 of their rows' length, their span (for
 * BOUND_AT); last, the largest difference between its heights and the finest level's, in 1/65535.
 */
#include "lib/heights.h"
#include "relief/ray.h"

#define LEVEL_INTS 8          /* ints of a level */
#define HEIGHT_ERROR (LEVEL_INTS - 1) /* index of the last of these ints */
#define SEARCH_STEPS_MAX 4096  /* steps of a safe search */
#if LANES == 16
#define INTERLEAVED 4 /* packets of rays searched in turns: while one waits for memory, another computes */
#else
#define INTERLEAVED 1
#endif
#define FIRST_TIER 2     /* tier where a safe search starts */
#define FAR_SIDE 1e9f    /* texels: stands for the missing side of a cell that extends beyond a clamped map */

/* A ray on its level of the map: (x, y) + (dx, dy) t */
typedef struct {
    HeightMap map;
    floatl x, y, dx, dy;
} Track;

/* Number i of each lane's level in `levels`; usually all lanes have the same level. */
INLINED intl table_at(global const int *levels, intl level, int i)
{
    const int first = int_lane(level, 0);
    if (!any_lane(level != first))
        return levels[first * LEVEL_INTS + i];
    const intl at = level * LEVEL_INTS + i;
    return (intl)(gather(levels, at));
}

INLINED Track track_of(const ReliefRay *ray, global const int *levels)
{
    Track k;
    k.map.width = table_at(levels, ray->level, 0);
    k.map.height = table_at(levels, ray->level, 1);
    k.map.start = table_at(levels, ray->level, 2);
    const floatl width = to_floatl(k.map.width), height = to_floatl(k.map.height);
#if !POWERS_OF_TWO
    k.map.per_width = 1.0f / width;
    k.map.per_height = 1.0f / height;
#endif
    k.x = ray->u * width - 0.5f;
    k.y = ray->v * height - 0.5f;
    k.dx = ray->du * width;
    k.dy = ray->dv * height;
    return k;
}

/* The index of a cell's bound. The index is computed, as reading a tier's start would take as long as reading the
 * bound. */
#define BOUND_AT(s, tier, column, row) ((s)->start + (s)->span - ((s)->span >> (tier)) + ((row) << (s)->pitch) + (column))

typedef struct {
    ReliefRay ray;
    Track track;
    intl searches; /* lanes that search */
    intl active;   /* lanes whose search has not ended */
    intl found;
    floatl t; /* distance so far; finally, the distance to the hit */
    intl tier, tiers, start, pitch, span; /* safe search: the tier, and the bounds' layout */
    floatl nudge, peak;
    floatl per_x, per_y;
    floatl from_x, from_y; /* the ray's start in texels, less 1 along an axis along which the ray hardly moves */
#if COUNTERS
    intl taken; /* steps */
#endif
} Search;

#if COUNTERS
#define COUNT_STEP(search, tries) (search)->taken += (tries) & 1;
#else
#define COUNT_STEP(search, tries)
#endif

/* Begins a search along the rays of the lanes in `searches`, at a tier. */
INLINED void begin_rays(Search *s, intl searches, intl tier)
{
#if COUNTERS
    s->taken = 0;
#endif
    s->tier = tier;
    s->searches = s->active = searches;
    mask_inactive(&s->ray, searches);
}

intl is_below(const Search *s, global const uint *texels, floatl t)
{
    const Track *k = &s->track;
    const floatl x = k->x + t * k->dx, y = k->y + t * k->dy;
    return depth_of(&s->ray, t) >= 1.0f - HEIGHT_UNIT * height_in(texels, k->map, x, y);
}

/* The paper's search: up to `steps` equal steps, then `halvings` bisections of the step that reached the surface. Local
 * arrays keep the loops' variables in registers. count: number of searches, a compile-time constant */
INLINED void linear_search(Search *searches, int count, global const uint *texels, int steps, int halvings)
{
    floatl step[INTERLEAVED], before[INTERLEAVED];
    floatl after[INTERLEAVED]; /* -INFINITY: no ray; INFINITY: no hit yet */
    int any_meets[INTERLEAVED];
    UNROLLED
    for (int k = 0; k < count; k++) {
        step[k] = searches[k].ray.end * (1.0f / steps);
        after[k] = select_lanes(searches[k].active, (floatl)INFINITY, (floatl)-INFINITY);
    }
    for (int i = 1; i <= steps; i++) {
        int going = 0;
        UNROLLED
        for (int k = 0; k < count; k++) {
            const floatl t = step[k] * i;
            const intl above = after[k] > t;
            if (!any_lane(above))
                continue;
            COUNT_STEP(searches + k, above)
            const floatl now = select_lanes(is_below(searches + k, texels, t), t, (floatl)INFINITY);
            after[k] = min_lanes(now, after[k]);
            going = 1;
        }
        if (!going)
            break;
    }
    UNROLLED
    for (int k = 0; k < count; k++) {
        Search *s = searches + k;
        const intl meets = isfinite_lanes(after[k]);
        s->found = s->active & (meets | s->ray.at_bottom);
        after[k] = select_lanes(meets, after[k], s->ray.end);
        before[k] = select_lanes(meets, after[k] - step[k], after[k]); /* lanes without a hit are not bisected */
        any_meets[k] = any_lane(meets);
    }
    for (int i = 0; i < halvings; i++)
        UNROLLED
        for (int k = 0; k < count; k++) {
            if (!any_meets[k])
                continue;
            const floatl t = 0.5f * (before[k] + after[k]);
            COUNT_STEP(searches + k, searches[k].active & (before[k] < after[k]))
            const intl below = is_below(searches + k, texels, t);
            after[k] = select_lanes(below, t, after[k]);
            before[k] = select_lanes(below, before[k], t);
        }
    UNROLLED
    for (int k = 0; k < count; k++)
        searches[k].t = after[k];
}

/* Searches a patch's cell, which the ray crosses from s->t to `leaves`. (fx, fy): the ray's place in the cell at s->t,
 * 0 to 1. Returns which lanes of `tries` meet the surface, and sets their s->t to the hit. */
intl solve_cell(Search *s, Patch p, floatl fx, floatl fy, floatl leaves, intl tries)
{
    const ReliefRay *ray = &s->ray;
    const floatl t = s->t;
    /* The ray's depth minus the surface's: negative above the surface */
    Quadratic below = heights_along(p, fx, fy, s->track.dx, s->track.dy);
    below.fixed += depth_of(ray, t) - 1.0f;
    below.sloped += ray->L + 2.0f * ray->K * t;
    below.curved += ray->K;
    const floatl ahead = first_not_negative(below);
    const intl met = tries & (ahead >= 0.0f) & (ahead <= (leaves - t) + s->nudge);
    s->t = select_lanes(met, min_lanes(t + ahead, ray->end), t);
    return met;
}

#if CLAMPED_U || CLAMPED_V
/* The column, or row, where a ray leaves a cell whose side ahead is at `side`. Heights do not change beyond a clamped
 * map, so the cells at its border extend outwards without end: behind the last texel a cell has no side, and before the
 * first texel only the side towards the map. */
INLINED floatl side_on_map(intl number, intl side, intl count, floatl d)
{
    const intl before = number < 0, forward = d >= 0.0f;
    const floatl to = to_floatl(select_lanes(before, (intl)0, side)),
                 far = select_lanes(forward, (floatl)FAR_SIDE, (floatl)-FAR_SIDE);
    return select_lanes(select_lanes(forward, side == count, before), far, to);
}
#endif

/* One step of a safe search: across a cell if the ray stays above the cell's greatest height, else down one tier, to
 * the cell's quarters. */
void safe_step(Search *s, global const uint *texels, global const uint *bounds)
{
    const ReliefRay *ray = &s->ray;
    const intl width = s->track.map.width, height = s->track.map.height, tier = s->tier;
    const Track *k = &s->track;
    const floatl t = s->t;
    /* The cell of the map that contains the ray's point just behind t */
    const floatl inside = t + s->nudge;
    const floatl at_x = k->x + inside * k->dx, at_y = k->y + inside * k->dy;
    const floatl dx = k->dx, dy = k->dy;
    FLOOR(at_x, cx, ix)
    FLOOR(at_y, cy, iy)
    const intl tx = WRAPPED(CLAMPED_U, cx, ix, width, s->track.map.per_width),
               ty = WRAPPED(CLAMPED_V, cy, iy, height, s->track.map.per_height);
    const intl column = tx >> tier, row = ty >> tier, bound_at = BOUND_AT(s, tier, column, row),
               pair_at = bound_at >> 1;
    const intl pair = as_intl((uintl)(gather(bounds, pair_at))), bound = (pair >> ((bound_at & 1) << 4)) & 0xffff;
    const floatl highest = to_floatl(bound) * (1.0f / 65535.0f);
    const intl first_x = column << tier, first_y = row << tier, one = (intl)1 << tier;
    const intl side_x = select_lanes(dx >= 0.0f, min(first_x + one, width), first_x);
    const intl side_y = select_lanes(dy >= 0.0f, min(first_y + one, height), first_y);
#if CLAMPED_U
    const floatl to_x = side_on_map(ix, side_x, width, dx);
#else
    const floatl to_x = cx + to_floatl(side_x - tx);
#endif
#if CLAMPED_V
    const floatl to_y = side_on_map(iy, side_y, height, dy);
#else
    const floatl to_y = cy + to_floatl(side_y - ty);
#endif
    const floatl t_x = (to_x - s->from_x) * s->per_x, t_y = (to_y - s->from_y) * s->per_y;
    const floatl leaves = clamp_lanes(min_lanes(t_x, t_y), inside, ray->end);
    /* Safe searches measure depths by equation 7. A ray that starts at depth 0 is deepest at `turn`; a leg may also be
     * deepest at an end of the step. */
    const floatl turn = clamp_lanes(s->peak, t, leaves);
#if WALKS
    const floatl deepest = max_lanes(max_lanes(QUADRIC_DEPTH(ray, t), QUADRIC_DEPTH(ray, leaves)),
                                     QUADRIC_DEPTH(ray, turn));
#else
    const floatl deepest = QUADRIC_DEPTH(ray, turn);
#endif
    const intl is_free = deepest < 1.0f - highest, at_leaf = tier == 0, solves = s->active & !is_free & at_leaf;
    /* The search goes up one tier where the ray also leaves the parent cell. */
    const intl by_x = t_x <= t_y, index = select_lanes(by_x, column, row);
    const intl forward = select_lanes(by_x, dx, dy) > 0.0f, odd = (index & 1) != 0;
    const intl ends = select_lanes(by_x, side_x == width, side_y == height);
    const intl up = (forward & (odd | ends)) | (!forward & !odd);
    intl met = 0;
    COUNT_STEP(s, s->active)
    if (any_lane(solves))
        met = solve_cell(s, read_cell(texels, k->map, ix, iy, tx, ty), k->x + t * k->dx - cx,
                         k->y + t * k->dy - cy, leaves, solves);
    s->found = s->found | met;
    s->active = s->active & !met;
    const intl passes = s->active & (is_free | at_leaf);
    s->t = select_lanes(passes, leaves, s->t);
    s->tier = select_lanes(passes, tier + select_lanes(up, (intl)1, (intl)0), select_lanes(s->active, tier - 1, tier));
    s->tier = min(s->tier, s->tiers - 1);
    s->active = s->active & (s->t < ray->end);
}

/* A search that steps over no part of the surface: a step crosses a cell only if the cell's greatest height stays below
 * the ray. Otherwise the search goes down a tier, and solves for the hit in cells between 2x2 texels. */
INLINED void safe_search(Search *searches, int count, global const uint *texels, global const uint *bounds,
                         global const int *levels)
{
    UNROLLED
    for (int k = 0; k < count; k++) {
        Search *s = searches + k;
        if (!any_lane(s->active))
            continue;
        const floatl end = s->ray.end;
        const intl still_x = !(fabs(s->track.dx) * end >= AXIS_PARALLEL);
        const intl still_y = !(fabs(s->track.dy) * end >= AXIS_PARALLEL);
        s->track.dx = select_lanes(still_x, (floatl)0.0f, s->track.dx);
        s->track.dy = select_lanes(still_y, (floatl)0.0f, s->track.dy);
        s->per_x = select_lanes(still_x, (floatl)NEVER, 1.0f / s->track.dx);
        s->per_y = select_lanes(still_y, (floatl)NEVER, 1.0f / s->track.dy);
        s->from_x = select_lanes(still_x, s->track.x - 1.0f, s->track.x);
        s->from_y = select_lanes(still_y, s->track.y - 1.0f, s->track.y);
        /* Rays that move along no axis stay in their cell: no place ahead of them is in another. */
        const floatl per_texel = min_lanes(fabs(s->per_x), fabs(s->per_y));
        s->nudge = NUDGE * select_lanes(still_x & still_y, (floatl)0.0f, per_texel);
        s->peak = select_lanes(s->ray.K < 0.0f, -0.5f * s->ray.L / s->ray.K, (floatl)INFINITY);
        s->tiers = table_at(levels, s->ray.level, 3);
        s->start = table_at(levels, s->ray.level, 4);
        s->pitch = table_at(levels, s->ray.level, 5);
        s->span = table_at(levels, s->ray.level, 6);
        s->tier = min(s->tiers - 1, s->tier);
        s->t = 0.0f;
        s->found = 0;
        s->active = s->active & (s->ray.end > 0.0f);
    }
    for (int i = 0; i < SEARCH_STEPS_MAX; i++) {
        int going = 0;
        UNROLLED
        for (int k = 0; k < count; k++)
            if (any_lane(searches[k].active)) {
                safe_step(searches + k, texels, bounds);
                going = 1;
            }
        if (!going)
            break;
    }
    UNROLLED
    for (int k = 0; k < count; k++) { /* rays without a hit have reached their end */
        searches[k].t = select_lanes(searches[k].found, searches[k].t, searches[k].ray.end);
        searches[k].found = searches[k].found | searches[k].ray.at_bottom;
    }
}
#endif
