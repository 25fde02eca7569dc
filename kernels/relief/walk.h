#ifndef RELIEF_WALK_H
#define RELIEF_WALK_H
/* How deep a ray is below the mesh itself, by a walk over its triangles.
 *
 * Below a triangle whose corners lie at P with normals N, a point is X = P - h N, with P and N interpolated by the same
 * weights: h is its depth. Newton's method finds weights and depth; where a weight is negative, the point lies below
 * the neighbour on that side, and the walk goes on there. From the ray's entry on every point is near the one before, so
 * some triangles are passed and few steps are taken in each.
 *
 * points: (vertices, 3). neighbours: (triangles, 3) on the sides opposite to each corner, -1: none, at borders and hard
 * edges, where the walk is at its end.
 */
#include "relief/entry.h"

#define WALK_PARTS 8       /* of the ray, at whose ends its depth is found; they grow by equal steps */
#define WALK_STEPS_MAX 80
#define HOPS_MAX 16        /* in a part: more have lost their way */
#define ALMOST 0.999f      /* of the way to where the ray leaves, where it may be below another side of an edge */
#define ALIKE 0.2f         /* of the greatest depth: by what it may differ between quadric and mesh */
#define SURELY_DEEP 1.1f   /* of a ray that reaches the bottom by its quadric */
#define SURELY 1.05f       /* times as deep as by the quadric */
#define LEAST_WEIGHT -1e-3f     /* weight of a point that is not below a triangle */
#define LOST_DEPTH 4.0f     /* of the relief's: what is deeper has lost its way */

/* What a walk has found: where the ray first reaches the bottom, or else is deepest */
typedef struct {
    floatl t, depth; /* over scale */
    floatl first_slope, slope; /* of the depth: over the first part, and at t; per scene unit */
    intl is_found;          /* it has come to the bottom, or to the ray's end */
    intl at_border;         /* it has come to a border, or a hard edge */
} MeshWalk;

/* The corners of triangles, less a point, and their normals */
typedef struct {
    Vector point[3], normal[3];
} WalkCorners;

INLINED WalkCorners walk_corners_of(const Relief *relief, intl triangle, Vector from)
{
    WalkCorners c;
    UNROLLED
    for (int k = 0; k < 3; k++) {
        const intl side = 3 * triangle + k, corner = (intl)(gather(relief->faces, side));
        c.point[k] = minus(vector_at(relief->points, corner), from);
        const intl row = VERTEX_FLOATS * corner + 2;
        gather_pairs(relief->vertices, row, &c.normal[k].x, &c.normal[k].y);
        c.normal[k].z = (floatl)(gather(relief->vertices, row + 2));
    }
    return c;
}

/* One of Newton's steps towards the weights of the second and the third corner, and the depth, of a point */
INLINED void refine_place(const WalkCorners *c, Vector at, floatl *second, floatl *third, floatl *depth)
{
    Vector side[2], turn[2], along[2];
    UNROLLED
    for (int k = 0; k < 2; k++) {
        side[k] = minus(c->point[k + 1], c->point[0]);
        turn[k] = minus(c->normal[k + 1], c->normal[0]);
        along[k] = minus(side[k], scaled(turn[k], *depth));
    }
    const floatl u = *second, v = *third, h = *depth;
    const Vector n = {c->normal[0].x + u * turn[0].x + v * turn[1].x, c->normal[0].y + u * turn[0].y + v * turn[1].y,
                      c->normal[0].z + u * turn[0].z + v * turn[1].z};
    const Vector rest = {at.x - c->point[0].x - u * side[0].x - v * side[1].x + h * n.x,
                         at.y - c->point[0].y - u * side[0].y - v * side[1].y + h * n.y,
                         at.z - c->point[0].z - u * side[0].z - v * side[1].z + h * n.z};
    const Vector across = cross_product(along[0], along[1]), beside = cross_product(rest, n);
    const floatl determinant = DOT(across, n); /* of the columns along[0], along[1], -n, negated */
    const floatl inverse = select_lanes(determinant != 0.0f, 1.0f / determinant, (floatl)0.0f);
    *second = u - DOT(along[1], beside) * inverse;
    *third = v + DOT(along[0], beside) * inverse;
    *depth = h - DOT(across, rest) * inverse;
}

/* Follows rays from where they enter a triangle, `distance` far at most; wanted: those that are asked for. */
static MeshWalk walk_below(const Relief *relief, Vector from, Vector direction, intl triangle, floatl distance, intl wanted)
{
    MeshWalk made;
    made.t = made.depth = made.first_slope = made.slope = 0.0f;
    made.is_found = made.at_border = 0;
    intl active = wanted, part = 1, hops = 0;
    const floatl first_part = distance * (ALMOST / (WALK_PARTS * WALK_PARTS)), deepest = LOST_DEPTH * relief->scale;
    floatl second = 1.0f / 3.0f, third = 1.0f / 3.0f, depth = 0.0f, before = 0.0f,
           long_before = 0.0f;
    for (int i = 0; i < WALK_STEPS_MAX && any_lane(active); i++) {
        const WalkCorners c = walk_corners_of(relief, triangle, from);
        const floatl so_far = to_floatl(part), t = first_part * so_far * so_far;
        const Vector at = scaled(direction, t);
        refine_place(&c, at, &second, &third, &depth);
        const floatl first = 1.0f - second - third;
        const intl is_second = second < first, least_of_two = select_lanes(is_second, (intl)1, (intl)0);
        const floatl least = min_lanes(select_lanes(is_second, second, first), third);
        const intl side = select_lanes(third <= least, (intl)2, least_of_two);
        const intl is_inside = active & (least >= LEAST_WEIGHT), passes = active & !is_inside;
        /* Where a part ends */
        const floatl now = depth / relief->scale;
        const intl reaches = now >= 1.0f, is_deeper = is_inside & (now > made.depth);
        made.first_slope = select_lanes(is_inside & (part == 1), now / t, made.first_slope);
        /* Between the last three places the depth is the parabola through them: where it reaches the bottom, */
        const floatl last_t = first_part * (so_far - 1.0f) * (so_far - 1.0f),
                     first_t = first_part * (so_far - 2.0f) * (so_far - 2.0f);
        const floatl rise = (before - long_before) / (last_t - first_t), last_rise = (now - before) / (t - last_t),
                     bend = select_lanes(part > 1, (last_rise - rise) / (t - first_t), (floatl)0.0f);
        const floatl by_line = last_t + (1.0f - before) / max_lanes(last_rise, (floatl)1e-20f),
                     slope_there = last_rise + bend * (2.0f * by_line - last_t - t);
        const floatl by_parabola = by_line - bend * (by_line - last_t) * (by_line - t) /
                                             max_lanes(slope_there, 0.5f * last_rise);
        made.t = select_lanes(is_deeper, select_lanes(reaches, clamp_lanes(by_parabola, last_t, t), t), made.t);
        made.slope = select_lanes(is_deeper, select_lanes(reaches, slope_there, (floatl)0.0f), made.slope);
        made.depth = select_lanes(is_deeper, min_lanes(now, (floatl)1.0f), made.depth);
        /* or is deepest */
        const intl turns = is_inside & (part >= 2) & (now <= before) & (before > long_before) & (bend < 0.0f);
        const floatl peak_t = 0.5f * (first_t + last_t) - 0.5f * rise / min_lanes(bend, (floatl)-1e-20f);
        const floatl peak = long_before + (peak_t - first_t) * (rise + bend * (peak_t - last_t));
        const intl is_peak = turns & (peak > made.depth);
        made.t = select_lanes(is_peak, peak_t, made.t);
        made.depth = select_lanes(is_peak, min_lanes(peak, (floatl)1.0f), made.depth);
        long_before = select_lanes(is_inside, before, long_before);
        before = select_lanes(is_inside, now, before);
        part += select_lanes(is_inside, (intl)1, (intl)0);
        made.is_found = made.is_found | (is_inside & (reaches | (part > WALK_PARTS)));
        /* Where it goes on below a neighbour */
        const intl edge = 3 * triangle + side, neighbour = (intl)(gather(relief->neighbours, edge));
        made.at_border = made.at_border | (passes & (neighbour < 0));
        const intl goes_on = passes & (neighbour >= 0);
        triangle = select_lanes(goes_on, neighbour, triangle);
        second = select_lanes(goes_on, (floatl)(1.0f / 3.0f), second);
        third = select_lanes(goes_on, (floatl)(1.0f / 3.0f), third);
        depth = select_lanes(goes_on, clamp_lanes(depth, (floatl)0.0f, deepest), depth);
        hops = select_lanes(is_inside, (intl)0, hops + 1);
        active = active & !made.is_found & !made.at_border & (hops <= HOPS_MAX);
    }
    return made;
}

/* Where a ray leaves the mesh */
typedef struct {
    floatl distance; /* from its entry; INFINITY: it does not */
    Vector normal;   /* there, */
    floatl rise;     /* and the ray's slope along it */
    floatl deepest;  /* how deep, in scene units, the ray is between at most, by the quadric there */
} Exit;

Exit exit_at(const Relief *relief, intl triangle, floatl x, floatl y, Vector direction, floatl distance)
{
    Vector x_axis, y_axis;
    const Entry e = entry_of(relief, triangle, x, y);
    tangents_of(&e, &x_axis, &y_axis);
    const floatl along_x = DOT(direction, x_axis), along_y = DOT(direction, y_axis), rise = DOT(direction, e.normal);
    const floatl bend = quadric_form(&e, along_x, along_y, along_x, along_y);
    const Exit exit = {distance, e.normal, rise, -0.25f * rise * rise / min_lanes(bend, (floatl)-1e-20f)};
    return exit;
}

/* By what the depth between is more than by parabolas, on a circle that goes through entry and exit: half of the angle
 * between both normals is that between the chord and the circle. */
INLINED floatl roundness(const Entry *e, Exit exit)
{
    return 2.0f / (1.0f + sqrt(max_lanes(0.5f + 0.5f * DOT(e->normal, exit.normal), (floatl)0.0f)));
}

/* Are rays as deep, at most, between entry and exit as the quadrics of both say? Nothing more is to be asked of these. */
INLINED intl is_as_mesh(const ReliefRay *ray, const Entry *e, Exit exit, float scale)
{
    const floatl round = roundness(e, exit), leaves = max_lanes(exit.rise, (floatl)0.0f) / scale;
    const floatl between = 0.125f * exit.distance * (ray->L + leaves) * round;
    const floatl turns = deepest_at(ray);
    const floatl deepest = select_lanes(turns < NEVER, depth_of(ray, turns), (floatl)NEVER);
    const floatl tolerance = ALIKE * deepest;
    const intl alike = (fabs(between - deepest) < tolerance) &
                       (fabs(exit.deepest / scale * round - deepest) < 2.0f * tolerance);
    return select_lanes(deepest < 1.0f, alike, between > SURELY_DEEP);
}

/* Gives rays a parabola by what the mesh itself tells of their depth up to their exits: through where a walk has first
 * found them at the bottom, or deepest. Where a walk has not come to its end, the mesh may be thinner there than the
 * relief is deep: then the cubic between entry and exit tells (entry.h), of rays that have escaped, which by their
 * quadrics have come out again, only if it is deeper than these. Where it has come to a border or a hard edge, the
 * quadric holds, unless it is less deep. farthest: to where rays are followed. Returns which rays it has changed;
 * share: of the quadric's curvature that is left. */
intl follow_mesh(const Relief *relief, ReliefRay *ray, const Entry *e, Vector from, Vector direction, intl triangle,
                 Exit exit, floatl farthest, intl escaped, intl wanted, floatl *share)
{
    const intl leaves = isfinite_lanes(exit.distance);
    const floatl slope = exit.rise / relief->scale, K = ray->K,
                 distance = select_lanes(leaves, exit.distance, (floatl)0.0f);
#if DISTANCE == EXACT
    const MeshWalk walk = walk_below(relief, from, direction, triangle, min_lanes(exit.distance, farthest),
                                 wanted & STARTS_AT_MESH(ray));
    const floatl round = select_lanes(escaped, (floatl)1.0f, roundness(e, exit));
    floatl t, last_slope, depth = deepest_between(ray, distance, slope, round, &t, &last_slope);
    const intl is_deep = walk.depth > max_lanes(depth, SURELY * depth_of(ray, walk.t));
    const intl is_known = walk.is_found | is_deep;
    t = select_lanes(is_known, walk.t, t);
    depth = select_lanes(is_known, walk.depth, depth);
    last_slope = select_lanes(is_known, walk.slope, last_slope);
    const intl is_lost = leaves & (escaped | !walk.at_border) & (depth > depth_of(ray, t));
    const intl follows = wanted & (t > 0.0f) & (walk.is_found | is_deep | is_lost);
    const floatl steep = max_lanes(ray->L, walk.first_slope);
#else
    floatl t, last_slope, depth = deepest_between(ray, distance, slope, (floatl)1.0f, &t, &last_slope);
    const intl follows = wanted & leaves & (t > 0.0f) & (depth > depth_of(ray, t));
    const floatl steep = ray->L;
#endif
    const floatl safe_t = max_lanes(t, (floatl)1e-20f), bends = (depth / safe_t - ray->L) / safe_t;
    *share = select_lanes(follows & (K < bends), max_lanes(bends / K, (floatl)0.0f), (floatl)1.0f);
    bend_through(ray, safe_t, depth * (1.0f + BOTTOM_TOLERANCE), steep, last_slope, follows);
    use_quadric_depth(ray, follows);
    return follows;
}
#endif
