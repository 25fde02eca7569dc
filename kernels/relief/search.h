#ifndef RELIEF_SEARCH_H
#define RELIEF_SEARCH_H
/* Where a ray first meets a height field that follows a quadric (Oliveira & Policarpo 2005, sections 3.1 to 3.4).
 *
 * A ray enters at t = 0, at depth 0, and runs straight: u + du t, v + dv t. The surface lies at depth 1 - height. DISTANCE
 * is how a ray's depth is measured, 1 at the bottom:
 * APPROXIMATE: L t + K t^2, how far its point P lies below the quadric, along z (equation 7).
 * EXACT: how far P lies below circles of the quadric's principal curvatures, the one that bends outwards least first: the
 * true distance to planes, tubes, spheres and tori, and never more than equation 7.
 * PERPENDICULAR: the paper's equation 6, from P to R, on the quadric, at right angles to the ray in the plane of ray and
 * normal; where it has no solution, equation 7. On a plane it is longer than the depth by 1 / sine of the ray and normal.
 * With WITHIN a ray may also start below the mesh, and rise: depth + L t + K t^2, by equation 7 alone.
 *
 * texels: lib/heights.h. bounds: 65535ths, two a word. Tier 0 is the greatest height of each cell between 2x2 texels, the
 * next that of 2x2 cells, and so on; BOUND_AT says where each is. levels: (levels, TABLE) ints: width, height, start in
 * texels; of the bounds number of tiers, start, log2 of the rows' length, and span; last, how far at most the level's
 * heights are from the first's, in 65535ths.
 */
#include "lib/heights.h"
#include "lib/lanes.h"

#define APPROXIMATE 0
#define EXACT 1
#define PERPENDICULAR 2
#ifndef DISTANCE
#define DISTANCE APPROXIMATE /* or EXACT, or PERPENDICULAR: how far below the surface a ray is */
#endif
#ifndef WITHIN
#define WITHIN 0 /* 1: the eye is below the mesh, and its rays start there */
#endif
#define TABLE 8          /* ints of a level */
#define LOST (TABLE - 1) /* of them, where the last one is */
#define STEPS_MOST 4096  /* of a safe search */
#if LANES == 16
#define TWINS 4 /* packets of rays that are searched in turns: one's arithmetic fills the others' waits */
#else
#define TWINS 1
#endif
#define FIRST_TIER 2     /* where a safe search starts */
#define NUDGE 1e-3f      /* texels: into the cell that a ray enters */
#define STILL 1e-4f      /* texels: what moves less along x, or y, stays on its column, or row */
#define NEVER 1e20f       /* scene units */
#define TILES_MOST 1e3f  /* that a ray crosses, so that numbers stay small */
#define CELL_PARTS 4     /* of a cell, in a search by EXACT */
#define BOTTOM_NEAR 1e-5f  /* of the depth: how near the bottom is sought */
#define BOTTOM_SLACK 1e-3f /* of the depth: what a ray that grazes the bottom may lack */

/* What a quadric's principal curvatures are, and how a ray runs along them */
typedef struct {
    floatl k1, k2; /* curvatures, > 0 outwards; k1 <= k2 */
    floatl w1, w2; /* squares of the direction's parts along them */
} Circles;

typedef struct {
    floatl u, v, du, dv; /* du, dv per scene unit */
    floatl L, K;         /* depth by equation 7: L t + K t^2 */
    floatl end;          /* least t > 0 at which the ray is back at depth 0, or at the bottom */
    intl at_bottom;      /* which of the two */
    intl level;          /* of the map */
#if WITHIN
    floatl depth; /* where the ray starts; > 0: below the mesh */
#endif
#if DISTANCE != APPROXIMATE
    floatl vz; /* of the unit direction, along the normal: < 0 */
#endif
#if DISTANCE == EXACT
    floatl per_scale; /* depths per scene unit */
    Circles circles;
#elif DISTANCE == PERPENDICULAR
    floatl scale; /* of depth 1 */
    floatl bend;  /* a x^2 + b y^2 + c x y of the direction */
#endif
} ReliefRay;

/* Equation 7 */
#if WITHIN
#define START_DEPTH(ray) ((ray)->depth)
#define PLAIN_DEPTH(ray, t) ((ray)->depth + (t) * ((ray)->L + (ray)->K * (t)))
#else
#define START_DEPTH(ray) 0.0f
#define PLAIN_DEPTH(ray, t) ((t) * ((ray)->L + (ray)->K * (t)))
#endif

/* How far a circle of curvature k lies before (x, z), along z; x_2: x squared */
INLINED floatl before_circle(floatl k, floatl x_2, floatl z)
{
    const floatl up = 1.0f + k * z;
    return k * x_2 / greater(up + sqrt(up * up + k * k * x_2), (floatl)1e-3f);
}

/* By how much less than by equation 7, in scene units, a point z along the normal lies below circles: one along the
 * first direction is carried around one along the second, as in a torus. */
INLINED floatl beyond_quadric(const Circles *c, floatl z, floatl t)
{
    const floatl t_2 = t * t;
    const floatl first = before_circle(c->k1, c->w1 * t_2, z), second = before_circle(c->k2, c->w2 * t_2, z + first);
    return first + second - 0.5f * t_2 * (c->k1 * c->w1 + c->k2 * c->w2);
}

#if DISTANCE == EXACT
floatl depth_of(const ReliefRay *ray, floatl t)
{
    return PLAIN_DEPTH(ray, t) - beyond_quadric(&ray->circles, ray->vz * t, t) * ray->per_scale;
}
#elif DISTANCE == PERPENDICULAR
/* P = V t; R = P + s U, U at right angles to V in the plane of V and the normal. */
floatl depth_of(const ReliefRay *ray, floatl t)
{
    const floatl depth = PLAIN_DEPTH(ray, t), below = depth * ray->scale;
    const floatl uz = sqrt(greater(1.0f - ray->vz * ray->vz, (floatl)1e-6f)); /* U = (N - vz V) / uz */
    const floatl per = -ray->vz / uz;                                         /* U's tangential part over V's */
    const floatl A = per * per * ray->bend, B = 2.0f * t * per * ray->bend - uz;
    const floatl discriminant = B * B - 4.0f * A * below, root = sqrt(greater(discriminant, (floatl)0.0f));
    return pick((discriminant >= 0.0f) & (root > B), 2.0f * depth / (root - B), depth);
}
#else
#define depth_of PLAIN_DEPTH
#endif

/* The depths of some rays become those of equation 7: without curvatures there is no other. */
INLINED void measure_plainly(ReliefRay *ray, intl which)
{
#if DISTANCE != APPROXIMATE
    ray->vz = pick(which, (floatl)0.0f, ray->vz);
#endif
#if DISTANCE == EXACT
    ray->circles.k1 = pick(which, (floatl)0.0f, ray->circles.k1);
    ray->circles.k2 = pick(which, (floatl)0.0f, ray->circles.k2);
#elif DISTANCE == PERPENDICULAR
    ray->bend = pick(which, (floatl)0.0f, ray->bend);
#endif
}

/* Lanes that do not search get a ray that harms nobody. */
void rest(ReliefRay *ray, intl active)
{
    ray->u = pick(active, ray->u, (floatl)0.0f);
    ray->v = pick(active, ray->v, (floatl)0.0f);
    ray->du = pick(active, ray->du, (floatl)0.0f);
    ray->dv = pick(active, ray->dv, (floatl)0.0f);
    ray->L = pick(active, ray->L, (floatl)1.0f);
    ray->K = pick(active, ray->K, (floatl)0.0f);
#if WITHIN
    ray->depth = pick(active, ray->depth, (floatl)0.0f);
#endif
#if DISTANCE != APPROXIMATE
    ray->vz = pick(active, ray->vz, (floatl)-0.5f);
#endif
#if DISTANCE == EXACT
    Circles *c = &ray->circles;
    c->k1 = pick(active, c->k1, (floatl)0.0f);
    c->k2 = pick(active, c->k2, (floatl)0.0f);
    c->w1 = pick(active, c->w1, (floatl)0.0f);
    c->w2 = pick(active, c->w2, (floatl)0.0f);
#elif DISTANCE == PERPENDICULAR
    ray->bend = pick(active, ray->bend, (floatl)0.0f);
#endif
}

#if WITHIN
/* Where rays leave that start below the mesh, and may rise: by the first of the two ways. What comes out of a hollow by
 * less than the relief's depth and sinks again does not leave: the mesh may be above it all the way. */
void set_end_within(ReliefRay *ray)
{
    const floatl L = ray->L, K = ray->K, depth = ray->depth, below = 1.0f - depth;
    const floatl sinks = L * L + 4.0f * K * below, rises = L * L - 4.0f * K * depth; /* discriminants */
    const floatl to_sink = sqrt(greater(sinks, (floatl)0.0f)) + L, root = sqrt(greater(rises, (floatl)0.0f));
    const floatl out_at = pick(L > 0.0f, -0.5f * (L + root) / K, 2.0f * depth / (root - L));
    const intl comes_out = (rises >= greater(4.0f * K, (floatl)0.0f)) & ((L <= 0.0f) | (K < 0.0f));
    const intl hits = (sinks >= 0.0f) & (to_sink > 0.0f);
    const floatl out = lesser(pick(comes_out, out_at, (floatl)NEVER), (floatl)NEVER);
    const floatl bottom = lesser(pick(hits, 2.0f * below / to_sink, (floatl)NEVER), (floatl)NEVER);
    const intl within = depth > 0.0f;
    ray->end = pick(within, lesser(out, bottom), ray->end);
    ray->at_bottom = pick(within, bottom < out, ray->at_bottom);
}
#endif

/* Where the ray leaves (section 3.3). */
void set_end(ReliefRay *ray)
{
    const floatl discriminant = ray->L * ray->L + 4.0f * ray->K;
    ray->at_bottom = discriminant >= 0.0f;
    ray->end = pick(ray->at_bottom, 2.0f / (ray->L + sqrt(fmax(discriminant, (floatl)0.0f))), -ray->L / ray->K);
#if DISTANCE == EXACT
    /* Depths are less than by equation 7, so the bottom is reached later, or never. Newton's method, along a chord */
    floatl t = pick(ray->at_bottom, ray->end, (floatl)0.0f);
    intl reaches = ray->at_bottom;
    for (int i = 0; i < 8 && any_lane(reaches & (depth_of(ray, t) < 1.0f - BOTTOM_NEAR)); i++) {
        const floatl step = 1e-3f * t, depth = depth_of(ray, t), rise = depth_of(ray, t + step) - depth;
        reaches = reaches & ((rise > 0.0f) | (depth >= 1.0f));
        t = pick(reaches & (rise > 0.0f), t + greater(1.0f - depth, (floatl)0.0f) * step / rise, t);
    }
    reaches = reaches & (depth_of(ray, t) >= 1.0f - BOTTOM_SLACK);
    /* And it is out again earlier. */
    floatl inside = 0.0f, beyond = pick(ray->K < 0.0f, -ray->L / ray->K, ray->end);
    for (int i = 0; i < 20 && any_lane(!reaches); i++) {
        const floatl middle = 0.5f * (inside + beyond);
        const intl in = depth_of(ray, middle) > 0.0f;
        inside = pick(in, middle, inside);
        beyond = pick(in, beyond, middle);
    }
    ray->end = pick(reaches, t, pick(ray->K < 0.0f, beyond, ray->end));
    ray->at_bottom = reaches | (ray->at_bottom & (ray->K >= 0.0f));
#elif DISTANCE == PERPENDICULAR
    /* Before the ray is deepest, if at all */
    floatl before = 0.0f, after = pick(ray->K < 0.0f, -0.5f * ray->L / ray->K, 4.0f * ray->end);
    const intl reaches = depth_of(ray, after) >= 1.0f;
    for (int i = 0; i < 20; i++) {
        const floatl middle = 0.5f * (before + after);
        const intl below = depth_of(ray, middle) >= 1.0f;
        after = pick(below, middle, after);
        before = pick(below, before, middle);
    }
    ray->end = pick(reaches, after, pick(ray->K < 0.0f, -ray->L / ray->K, ray->end));
    ray->at_bottom = reaches | (ray->at_bottom & (ray->K >= 0.0f));
#endif
#if WITHIN
    set_end_within(ray);
#endif
    ray->end = fmin(ray->end, TILES_MOST / fmax(fabs(ray->du) + fabs(ray->dv), (floatl)1e-20f));
}

/* Where a ray runs on its level of the map: (x, y) + (dx, dy) t */
typedef struct {
    HeightMap map;
    floatl x, y, dx, dy;
} Track;

/* A number of the table; most often all lanes are on one level. */
INLINED intl table_at(global const int *levels, intl level, int i)
{
    const int first = int_lane(level, 0);
    if (!any_lane(level != first))
        return levels[first * TABLE + i];
    const intl at = level * TABLE + i;
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

/* Where the bound of a tier's cell is: computed, as looking it up would take as long as reading the bound itself. */
#define BOUND_AT(s, tier, column, row) ((s)->start + (s)->span - ((s)->span >> (tier)) + ((row) << (s)->pitch) + (column))

/* A search on its way */
typedef struct {
    ReliefRay ray;
    Track track;
    intl searches; /* from the start, */
    intl active;   /* and still */
    intl found;
    floatl t; /* so far; in the end, where it is found */
    intl tier, tiers, start, pitch, span; /* safe: of the bounds */
    floatl per_x, per_y, nudge, peak;
    floatl from_x, from_y; /* where the ray starts; a texel before it where it stays on a column, or row */
#if COUNTED
    intl taken; /* steps */
#endif
} Search;

#if COUNTED
#define COUNT_STEP(search, tries) (search)->taken += (tries) & 1;
#else
#define COUNT_STEP(search, tries)
#endif

/* Is the ray at or below the surface? */
intl is_below(const Search *s, global const uint *texels, floatl t)
{
    const Track *k = &s->track;
    return depth_of(&s->ray, t) >= 1.0f - HEIGHT_UNIT * height_in(texels, k->map, k->x + k->dx * t, k->y + k->dy * t);
}

/* The paper's search: `steps` even ones, then `halvings` of the last. What changes is kept in registers, beside the
 * searches; count: how many these are, a constant. */
INLINED void linear_search(Search *searches, int count, global const uint *texels, int steps, int halvings)
{
    floatl step[TWINS], before[TWINS], after[TWINS]; /* after: -INFINITY: of no ray; INFINITY: nothing met yet */
    int any_meets[TWINS];
    UNROLLED
    for (int k = 0; k < count; k++) {
        step[k] = searches[k].ray.end * (1.0f / steps);
        after[k] = pick(searches[k].active, (floatl)INFINITY, (floatl)-INFINITY);
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
            const floatl now = pick(is_below(searches + k, texels, t), t, (floatl)INFINITY);
            after[k] = lesser(now, after[k]);
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
        after[k] = pick(meets, after[k], s->ray.end);
        before[k] = pick(meets, after[k] - step[k], after[k]); /* others stay */
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
            after[k] = pick(below, t, after[k]);
            before[k] = pick(below, before[k], t);
        }
    UNROLLED
    for (int k = 0; k < count; k++)
        searches[k].t = after[k];
}

/* Where in the cell of a patch, which the ray crosses from t to `leaves`, does it meet the surface? (fx, fy): at t, in
 * the cell. Sets t where it does, which it returns. */
intl solve_cell(Search *s, Patch p, floatl fx, floatl fy, floatl leaves, intl tries)
{
    const ReliefRay *ray = &s->ray;
    const floatl t = s->t, dx = s->track.dx, dy = s->track.dy;
    const floatl corner = p.aa * HEIGHT_UNIT, slope_x = (p.ab - p.aa) * HEIGHT_UNIT;
    const floatl slope_y = (p.ba - p.aa) * HEIGHT_UNIT, twist = (p.aa - p.ab - p.ba + p.bb) * HEIGHT_UNIT;
#if DISTANCE != APPROXIMATE
    floatl before = t, after = t;
    intl within = 0;
    for (int part = 0; part <= CELL_PARTS; part++) {
        const floatl z = t + (leaves - t) * (part * (1.0f / CELL_PARTS)), gx = fx + dx * (z - t), gy = fy + dy * (z - t);
        const intl now = !within & (depth_of(ray, z) >= 1.0f - (corner + slope_x * gx + slope_y * gy + twist * gx * gy));
        after = pick(within, after, z);
        within = within | now;
        before = pick(within, before, z);
    }
    for (int part = 0; part < 8; part++) {
        const floatl z = 0.5f * (before + after), gx = fx + dx * (z - t), gy = fy + dy * (z - t);
        const intl now = depth_of(ray, z) >= 1.0f - (corner + slope_x * gx + slope_y * gy + twist * gx * gy);
        after = pick(now, z, after);
        before = pick(now, before, z);
    }
    const intl met = tries & within;
    s->t = pick(met, after, t);
#else
    /* Ray less surface is F0 + F1 ahead + F2 ahead^2, F0 < 0 above the surface. */
    const floatl F0 = depth_of(ray, t) - 1.0f + corner + slope_x * fx + slope_y * fy + twist * fx * fy;
    const floatl F1 = ray->L + 2.0f * ray->K * t + slope_x * dx + slope_y * dy + twist * (fx * dy + fy * dx);
    const floatl F2 = ray->K + twist * dx * dy;
    const floatl discriminant = F1 * F1 - 4.0f * F2 * F0;
    const floatl ahead = 2.0f * F0 / (-F1 - sqrt(greater(discriminant, (floatl)0.0f)));
    const intl crosses = (discriminant >= 0.0f) & (ahead >= 0.0f) & (ahead <= (leaves - t) + s->nudge);
    const intl met = tries & ((F0 >= 0.0f) | crosses);
    s->t = pick(met, lesser(t + pick(F0 >= 0.0f, (floatl)0.0f, ahead), ray->end), t);
#endif
    return met;
}

#if CLAMPED
/* When a ray leaves a cell whose far side is `side`. The bounds of cells at a map's border hold beyond it, too, where
 * nothing changes: there is no side behind the last texel, and before the first one only that towards the map. */
INLINED floatl time_to_side(intl number, intl side, intl count, floatl d, floatl from, floatl per)
{
    const intl before = number < 0, forward = d >= 0.0f;
    const floatl t = (to_floatl(pick(before, (intl)0, side)) - from) * per;
    return pick(pick(forward, side == count, before), (floatl)NEVER, t);
}
#endif

/* One step of a safe search: across a cell that the ray stays above, or down to its quarters. */
void safe_step(Search *s, global const uint *texels, global const uint *bounds)
{
    const ReliefRay *ray = &s->ray;
    const intl width = s->track.map.width, height = s->track.map.height, tier = s->tier;
    const floatl x0 = s->track.x, y0 = s->track.y, dx = s->track.dx, dy = s->track.dy, t = s->t;
    /* The cell just after t, on the map */
    const floatl inside = t + s->nudge, at_x = x0 + dx * inside, at_y = y0 + dy * inside;
    FLOOR(at_x, cx, ix)
    FLOOR(at_y, cy, iy)
    const intl tx = ON_MAP(cx, ix, width, s->track.map.per_width), ty = ON_MAP(cy, iy, height, s->track.map.per_height);
    const intl column = tx >> tier, row = ty >> tier, bound_at = BOUND_AT(s, tier, column, row), pair_at = bound_at >> 1;
    const intl pair = as_intl((uintl)(gather(bounds, pair_at))), bound = (pair >> ((bound_at & 1) << 4)) & 0xffff;
    const floatl highest = to_floatl(bound) * (1.0f / 65535.0f);
    const intl first_x = column << tier, first_y = row << tier, one = (intl)1 << tier;
    const intl side_x = pick(dx >= 0.0f, min(first_x + one, width), first_x);
    const intl side_y = pick(dy >= 0.0f, min(first_y + one, height), first_y);
#if CLAMPED
    const floatl t_x = time_to_side(ix, side_x, width, dx, s->from_x, s->per_x);
    const floatl t_y = time_to_side(iy, side_y, height, dy, s->from_y, s->per_y);
#else
    const floatl t_x = (cx + to_floatl(side_x - tx) - s->from_x) * s->per_x;
    const floatl t_y = (cy + to_floatl(side_y - ty) - s->from_y) * s->per_y;
#endif
    const floatl leaves = lesser(greater(lesser(t_x, t_y), inside), ray->end);
    const floatl turn = lesser(greater(s->peak, t), leaves);
    /* By equation 7, than which nothing is deeper */
    const floatl deepest = greater(greater(PLAIN_DEPTH(ray, t), PLAIN_DEPTH(ray, leaves)), PLAIN_DEPTH(ray, turn));
    const intl is_free = deepest < 1.0f - highest, at_leaf = tier == 0, solves = s->active & !is_free & at_leaf;
    /* Up a tier where the ray leaves the parent, too. */
    const intl by_x = t_x <= t_y, index = pick(by_x, column, row);
    const intl forward = pick(by_x, dx, dy) > 0.0f, odd = (index & 1) != 0;
    const intl ends = pick(by_x, side_x == width, side_y == height);
    const intl up = (forward & (odd | ends)) | (!forward & !odd);
    intl met = 0;
    COUNT_STEP(s, s->active)
    if (any_lane(solves))
        met = solve_cell(s, read_cell(texels, s->track.map, ix, iy, tx, ty), x0 + dx * t - cx, y0 + dy * t - cy, leaves, solves);
    s->found = s->found | met;
    s->active = s->active & !met;
    const intl passes = s->active & (is_free | at_leaf);
    s->t = pick(passes, leaves, s->t);
    s->tier = pick(passes, tier + pick(up, (intl)1, (intl)0), pick(s->active, tier - 1, tier));
    s->tier = min(s->tier, s->tiers - 1);
    s->active = s->active & (s->t < ray->end);
}

/* No step is longer than the bounds allow, so nothing is stepped over: cells whose greatest height stays below the ray
 * are crossed at once, and a cell between 2x2 texels is solved. */
INLINED void safe_search(Search *searches, int count, global const uint *texels, global const uint *bounds,
                         global const int *levels)
{
    UNROLLED
    for (int k = 0; k < count; k++) {
        Search *s = searches + k;
        const floatl K = s->ray.K;
        const intl still_x = !(fabs(s->track.dx) * s->ray.end >= STILL);
        const intl still_y = !(fabs(s->track.dy) * s->ray.end >= STILL);
        s->track.dx = pick(still_x, (floatl)0.0f, s->track.dx);
        s->track.dy = pick(still_y, (floatl)0.0f, s->track.dy);
        s->per_x = pick(still_x, (floatl)NEVER, 1.0f / s->track.dx);
        s->per_y = pick(still_y, (floatl)NEVER, 1.0f / s->track.dy);
        s->from_x = pick(still_x, s->track.x - 1.0f, s->track.x);
        s->from_y = pick(still_y, s->track.y - 1.0f, s->track.y);
        s->nudge = NUDGE * lesser(fabs(s->per_x), fabs(s->per_y));
        s->peak = pick(K < 0.0f, -0.5f * s->ray.L / K, (floatl)INFINITY); /* deepest there */
        s->tiers = table_at(levels, s->ray.level, 3);
        s->start = table_at(levels, s->ray.level, 4);
        s->pitch = table_at(levels, s->ray.level, 5);
        s->span = table_at(levels, s->ray.level, 6);
        s->tier = min(s->tiers - 1, (intl)FIRST_TIER);
        s->t = 0.0f;
        s->found = 0;
        s->active = s->active & (s->ray.end > 0.0f);
    }
    for (int i = 0; i < STEPS_MOST; i++) {
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
    for (int k = 0; k < count; k++) { /* what has met nothing has come to the end */
        searches[k].t = pick(searches[k].found, searches[k].t, searches[k].ray.end);
        searches[k].found = searches[k].found | searches[k].ray.at_bottom;
    }
}
#endif
