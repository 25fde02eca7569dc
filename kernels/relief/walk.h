#ifndef RELIEF_WALK_H
#define RELIEF_WALK_H
/* A ray's walk through a relief, below the mesh's own triangles.
 *
 * Below a triangle whose corners lie at P with normals N a point is X = P - h N, with P and N interpolated by the same
 * weights, and h its depth. That is a prism; together they fill the relief without gaps. A ray is followed from prism to
 * prism, a leg in each, up to where it leaves that at the bottom, at the mesh, or by a side. Along a leg weights and
 * depth are parabolas that have the true values at both ends, and the true slope at the first. u and v follow from the
 * weights, so the search (search.h) is that of one prism.
 *
 * Below centres of curvature prisms are inside out, and overlap others. What is above the ray's point changes steadily
 * there, too, if such prisms are crossed backwards: so the ray comes out on the other side of a sharp bend.
 *
 * prisms: (triangles, PRISM_FLOATS) place, normal, u and v of each corner; then, as integers, the side opposite to each
 * in the triangle beside it, 3 * triangle + corner; -1: none, at borders and hard edges. Beyond these u and v change as they
 * did, and the depth as normals turn.
 */
#include "relief/entry.h"

#define PRISM_FLOATS 28
#define LEGS_MAX 128  /* of a ray; one that has not come out then turns between prisms that are inside out: it ends */
#define SIDE_STEPS 3  /* of Newton's method, to where a ray leaves by a side */
#define LATEST 2.0f   /* times as far as where a ray comes to a side by its slope it may do so to others */
#define LEG_ROUNDING 1.00001f
#define LEAST_VOLUME 1e-30f
#define LEAST_WEIGHT -1e-5f /* of a point in a triangle */
#define LEAST_DEPTH -1e-2f /* of the relief's: what is less deep has left it */

/* The corners of triangles, less a point, their normals, u and v */
typedef struct {
    Vector point[3], normal[3];
    floatl u[3], v[3];
    intl beside[3];
} MeshPrism;

/* A point in a prism: weights of the second and the third corner, and its depth, in scene units; or their changes */
typedef struct {
    floatl second, third, depth;
} PrismPlace;

/* Rays on their way */
typedef struct {
    Vector from, direction;
    floatl reached; /* from the entry */
    intl triangle;
    PrismPlace place; /* at that point */
    intl active; /* which of them are to be followed */
    intl is_beyond, ends_at_border; /* which are beyond a border, and which do not go on there */
    floatl leg, way;   /* how long the leg is, and which way it goes: 1, or -1 */
    PrismPlace slope, bend; /* what the place changes by t and t^2 along it */
    PrismPlace end;         /* where it ends, */
    intl side;         /* and by which side; -1: at the bottom, or the mesh; */
    intl beside;       /* and the side that it comes to */
    floatl pixel_size; /* at the entry; 0: the map itself is read */
    intl level, tier;  /* of the map, and the search's (search.h) */
} MeshWalk;

INLINED Vector weighted(const Vector *corners, floatl second, floatl third)
{
    const floatl first = 1.0f - second - third;
    const Vector mean = {first * corners[0].x + second * corners[1].x + third * corners[2].x,
                         first * corners[0].y + second * corners[1].y + third * corners[2].y,
                         first * corners[0].z + second * corners[1].z + third * corners[2].z};
    return mean;
}

INLINED MeshPrism prism_of(const Relief *relief, intl triangle, Vector from)
{
    MeshPrism p;
    floatl row[PRISM_FLOATS];
    const int one = int_lane(triangle, 0), uniform = !any_lane(triangle != one);
    UNROLLED
    for (int i = 0; i < PRISM_FLOATS; i += 4) {
        if (uniform) {
            const float4 part = vload4((PRISM_FLOATS * one + i) / 4, relief->prisms);
            row[i] = part.x;
            row[i + 1] = part.y;
            row[i + 2] = part.z;
            row[i + 3] = part.w;
        } else
            gather_rows(relief->prisms, triangle * (PRISM_FLOATS / 4) + i / 4, row + i);
    }
    UNROLLED
    for (int k = 0; k < 3; k++) {
        const floatl *corner = row + 8 * k;
        const Vector point = {corner[0], corner[1], corner[2]}, normal = {corner[3], corner[4], corner[5]};
        p.point[k] = minus(point, from);
        p.normal[k] = normal;
        p.u[k] = corner[6];
        p.v[k] = corner[7];
        p.beside[k] = as_intl(row[24 + k]);
    }
    return p;
}

/* The level of the map that rays read, by the texels that a pixel of a size in scene units covers of a triangle */
INLINED intl level_on(const Relief *relief, const MeshPrism *p, floatl size)
{
    const Vector second = minus(p->point[1], p->point[0]), third = minus(p->point[2], p->point[0]);
    const floatl E = DOT(second, second), F = DOT(second, third), G = DOT(third, third);
    const floatl u_1 = p->u[1] - p->u[0], u_2 = p->u[2] - p->u[0], v_1 = p->v[1] - p->v[0], v_2 = p->v[2] - p->v[0];
    const floatl u = G * u_1 * u_1 - 2.0f * F * u_1 * u_2 + E * u_2 * u_2,
                 v = G * v_1 * v_1 - 2.0f * F * v_1 * v_2 + E * v_2 * v_2;
    const float width = relief->levels[0], height = relief->levels[1];
    const floatl texels_2 = max_lanes(u * (width * width), v * (height * height)) * size * size / (E * G - F * F);
    return finest_level(relief, level_of_texels(texels_2, relief->level_count), size, -1);
}

/* Sets how a ray's place changes along it; returns whether its prism is inside out. */
INLINED intl set_slope(const MeshPrism *p, const PrismPlace *at, Vector direction, PrismPlace *slope)
{
    const Vector n = weighted(p->normal, at->second, at->third);
    const Vector second = minus(minus(p->point[1], p->point[0]), scaled(minus(p->normal[1], p->normal[0]), at->depth));
    const Vector third = minus(minus(p->point[2], p->point[0]), scaled(minus(p->normal[2], p->normal[0]), at->depth));
    const Vector across = cross_product(second, third), beside = cross_product(direction, n);
    const floatl volume = DOT(across, n);
    const intl turned = volume < 0.0f;
    const floatl some = select_lanes(turned, (floatl)-LEAST_VOLUME, (floatl)LEAST_VOLUME),
                 inverse = 1.0f / select_lanes(fabs(volume) < LEAST_VOLUME, some, volume);
    slope->second = -DOT(third, beside) * inverse;
    slope->third = DOT(second, beside) * inverse;
    slope->depth = -DOT(across, direction) * inverse;
    return turned;
}

/* Where a ray is at a depth: how far from its entry, and its place there */
INLINED floatl reach_depth(const MeshPrism *p, Vector direction, floatl depth, PrismPlace *at)
{
    Vector corner[3];
    UNROLLED
    for (int k = 0; k < 3; k++)
        corner[k] = minus(p->point[k], scaled(p->normal[k], depth));
    const Vector second = minus(corner[1], corner[0]), third = minus(corner[2], corner[0]);
    const Vector across = cross_product(second, third);
    const floatl t = DOT(corner[0], across) / DOT(direction, across), inverse = 1.0f / DOT(across, across);
    const Vector aside = minus(scaled(direction, t), corner[0]);
    at->second = DOT(cross_product(aside, third), across) * inverse;
    at->third = DOT(cross_product(second, aside), across) * inverse;
    at->depth = depth;
    return t;
}

/* Of three values, the one of a number */
INLINED floatl chosen(floatl first, floatl second, floatl third, intl number)
{
    return select_lanes(number == 2, third, select_lanes(number == 1, second, first));
}

INLINED Vector chosen_corner(const Vector *corners, intl number)
{
    const Vector one = {chosen(corners[0].x, corners[1].x, corners[2].x, number),
                        chosen(corners[0].y, corners[1].y, corners[2].y, number),
                        chosen(corners[0].z, corners[1].z, corners[2].z, number)};
    return one;
}

/* Where a ray is at a side, by Newton's method from near there: how far from its entry, and its place there. along_side: the
 * weight of the side's second corner; it, t and the depth are nearby at first */
INLINED floatl reach_side(const MeshPrism *p, Vector direction, intl side, floatl *along_side, floatl t, PrismPlace *at)
{
    const intl next = select_lanes(side == 2, (intl)0, side + 1), last = select_lanes(side == 0, (intl)2, side - 1);
    const Vector from = chosen_corner(p->point, next), from_normal = chosen_corner(p->normal, next);
    const Vector way = minus(chosen_corner(p->point, last), from),
                 turn = minus(chosen_corner(p->normal, last), from_normal);
    floatl depth = at->depth, along = *along_side;
    for (int i = 0; i < SIDE_STEPS; i++) {
        const Vector n = {from_normal.x + along * turn.x, from_normal.y + along * turn.y, from_normal.z + along * turn.z};
        const Vector rest = {t * direction.x - from.x - along * way.x + depth * n.x,
                             t * direction.y - from.y - along * way.y + depth * n.y,
                             t * direction.z - from.z - along * way.z + depth * n.z};
        const Vector edge = minus(way, scaled(turn, depth)), across = cross_product(n, direction);
        const floatl inverse = 1.0f / DOT(edge, across);
        const Vector over = cross_product(rest, edge);
        along += DOT(rest, across) * inverse;
        depth += DOT(direction, over) * inverse;
        t -= DOT(n, over) * inverse;
    }
    at->second = select_lanes(side == 0, 1.0f - along, select_lanes(side == 2, along, (floatl)0.0f));
    at->third = select_lanes(side == 0, along, select_lanes(side == 1, 1.0f - along, (floatl)0.0f));
    at->depth = depth;
    *along_side = along;
    return t;
}

INLINED PrismPlace place_after(const MeshWalk *walk, floatl t)
{
    const PrismPlace at = {walk->place.second + t * (walk->slope.second + t * walk->bend.second),
                      walk->place.third + t * (walk->slope.third + t * walk->bend.third),
                      walk->place.depth + t * (walk->slope.depth + t * walk->bend.depth)};
    return at;
}

INLINED PrismPlace chosen_place(intl which, PrismPlace one, PrismPlace other)
{
    const PrismPlace made = {select_lanes(which, one.second, other.second), select_lanes(which, one.third, other.third),
                        select_lanes(which, one.depth, other.depth)};
    return made;
}

/* How long it takes until a value that changes evenly has come down to 0 */
INLINED floatl time_to_zero(floatl value, floatl change)
{
    return select_lanes(change < 0.0f, max_lanes(value, (floatl)0.0f) / -change, (floatl)NEVER);
}

/* Finds the side by which rays leave their prisms: of those that they come to by their slopes the first that they
 * truly reach. Returns how far from the entry that is. */
INLINED floatl find_side(const MeshPrism *p, MeshWalk *walk, float scale)
{
    const PrismPlace at = walk->place, slope = walk->slope;
    const floatl first = 1.0f - at.second - at.third, first_slope = -slope.second - slope.third;
    floatl by_first = time_to_zero(first, first_slope), by_second = time_to_zero(at.second, slope.second),
           by_third = time_to_zero(at.third, slope.third);
    const floatl latest = LATEST * min_lanes(min_lanes(by_first, by_second), by_third);
    floatl found_t = walk->reached;
    intl searches = walk->active;
    for (int i = 0; i < 3 && any_lane(searches); i++) {
        const floatl soon = min_lanes(by_first, by_second), leg = min_lanes(min_lanes(soon, by_third), latest);
        const intl side = select_lanes(by_third < soon, (intl)2, select_lanes(by_second < by_first, (intl)1, (intl)0));
        floatl along = clamp_lanes(chosen(at.third + leg * slope.third, first + leg * first_slope,
                                          at.second + leg * slope.second, side), (floatl)0.0f, (floatl)1.0f);
        const floatl there_depth = clamp_lanes(at.depth + leg * slope.depth, (floatl)0.0f, (floatl)scale);
        PrismPlace there = {0.0f, 0.0f, there_depth};
        const floatl t = reach_side(p, walk->direction, side, &along, walk->reached + walk->way * leg, &there);
        const intl reaches = searches & (along >= LEAST_WEIGHT) & (along <= 1.0f - LEAST_WEIGHT) &
                             (there.depth >= LEAST_DEPTH * scale) &
                             (walk->way * (t - walk->reached) >= LEAST_WEIGHT * scale);
        const intl takes = i == 0 ? searches : reaches; /* by their slopes, if none is truly reached */
        const PrismPlace by_slope = {at.second + leg * slope.second, at.third + leg * slope.third, there_depth};
        walk->side = select_lanes(takes, side, walk->side);
        walk->end = chosen_place(takes, chosen_place(reaches, there, by_slope), walk->end);
        found_t = select_lanes(takes, select_lanes(reaches, t, walk->reached + walk->way * leg), found_t);
        searches = searches & !reaches;
        by_first = select_lanes(side == 0, (floatl)INFINITY, by_first);
        by_second = select_lanes(side == 1, (floatl)INFINITY, by_second);
        by_third = select_lanes(side == 2, (floatl)INFINITY, by_third);
    }
    return found_t;
}

INLINED floatl of_place(const floatl *corners, floatl second, floatl third)
{
    return second * (corners[1] - corners[0]) + third * (corners[2] - corners[0]);
}

/* By how much normals turn along a ray: the base's curvature */
INLINED floatl turning_along(const MeshPrism *p, Vector direction, const PrismPlace *slope)
{
    const Vector second = minus(p->normal[1], p->normal[0]), third = minus(p->normal[2], p->normal[0]);
    return slope->second * DOT(second, direction) + slope->third * DOT(third, direction);
}

/* How far a ray goes until it is at the bottom, or else at depth 0, if its depth is a parabola */
INLINED floatl way_out(floatl depth, floatl slope, floatl bend, float scale)
{
    const floatl below = scale - depth, discriminant = slope * slope + 4.0f * bend * below;
    const floatl bottom = 2.0f * below / (slope + sqrt(max_lanes(discriminant, (floatl)0.0f)));
    const floatl out = (slope + sqrt(max_lanes(slope * slope - 4.0f * bend * depth, (floatl)0.0f))) / (-2.0f * bend);
    return max_lanes(select_lanes((discriminant >= 0.0f) & (bottom > 0.0f), bottom, out), (floatl)0.0f);
}

/* Sets out a walk's next leg, and the ray that is searched along it. */
static void begin_leg(const Relief *relief, MeshWalk *walk, int is_first, ReliefRay *ray)
{
    const MeshPrism p = prism_of(relief, walk->triangle, walk->from);
    if (is_first)
        walk->level = level_on(relief, &p, walk->pixel_size);
    const PrismPlace at = walk->place;
    const float scale = relief->scale, per_scale = 1.0f / scale;
    PrismPlace slope;
    walk->way = select_lanes(set_slope(&p, &at, walk->direction, &slope), (floatl)-1.0f, (floatl)1.0f);
    slope.second *= walk->way;
    slope.third *= walk->way;
    slope.depth *= walk->way;
    walk->slope = slope;
    /* To the bottom, or the mesh */
    const intl sinks = slope.depth >= 0.0f;
    PrismPlace level;
    const floatl t_level = reach_depth(&p, walk->direction, select_lanes(sinks, (floatl)scale, (floatl)0.0f), &level);
    const floatl least = min_lanes(min_lanes(level.second, level.third), 1.0f - level.second - level.third);
    const intl arrives = (least >= LEAST_WEIGHT) & (walk->way * (t_level - walk->reached) >= 0.0f);
    floatl t = t_level;
    walk->side = -1;
    const intl passes = walk->active & !arrives & !walk->is_beyond;
    if (any_lane(passes)) {
        t = select_lanes(passes, find_side(&p, walk, scale), t_level);
        walk->side = select_lanes(passes, walk->side, (intl)-1);
    }
    walk->end = chosen_place(passes, walk->end, level);
    floatl leg = max_lanes(walk->way * (t - walk->reached), (floatl)0.0f);
    const floatl bends = select_lanes(walk->is_beyond, (floatl)0.0f, 1.0f / max_lanes(leg * leg, (floatl)1e-30f));
    walk->bend.second = bends * (walk->end.second - at.second - leg * slope.second);
    walk->bend.third = bends * (walk->end.third - at.third - leg * slope.third);
    walk->bend.depth = bends * (walk->end.depth - at.depth - leg * slope.depth);
    if (any_lane(walk->is_beyond)) {
        const floatl bend = -0.5f * turning_along(&p, walk->direction, &slope);
        walk->bend.depth = select_lanes(walk->is_beyond, bend, walk->bend.depth);
        leg = select_lanes(walk->is_beyond, way_out(at.depth, slope.depth, bend, scale), leg);
    }
    walk->leg = leg;
    ray->u = WRAPPED_UV(CLAMPED_U, p.u[0] + of_place(p.u, at.second, at.third));
    ray->v = WRAPPED_UV(CLAMPED_V, p.v[0] + of_place(p.v, at.second, at.third));
    /* u and v bend little in a prism. */
    const floatl second = slope.second + leg * walk->bend.second, third = slope.third + leg * walk->bend.third;
    ray->du = of_place(p.u, second, third);
    ray->dv = of_place(p.v, second, third);
    walk->beside = select_lanes(walk->side == 2, p.beside[2], select_lanes(walk->side == 1, p.beside[1], p.beside[0]));
    ray->level = walk->level;
    ray->depth = at.depth * per_scale;
    ray->L = slope.depth * per_scale;
    ray->K = walk->bend.depth * per_scale;
}

/* A ray ends where it reaches the bottom, or at its leg's end; in its last leg it is at the bottom there. */
void set_end_of_leg(ReliefRay *ray, const MeshWalk *walk, int is_last)
{
    const floatl below = 1.0f - ray->depth, discriminant = ray->L * ray->L + 4.0f * ray->K * below;
    const floatl fall = ray->L + sqrt(max_lanes(discriminant, (floatl)0.0f));
    const floatl bottom = select_lanes((discriminant >= 0.0f) & (fall > 0.0f), 2.0f * below / fall, (floatl)NEVER);
    const intl arrives = (walk->side < 0) & !walk->is_beyond & (walk->slope.depth >= 0.0f);
    ray->at_bottom = (intl)is_last | arrives | (bottom <= walk->leg * LEG_ROUNDING);
    ray->end = min_lanes(bottom, walk->leg);
    limit_tiles(ray);
}

/* Goes over to the next prism. */
INLINED void end_leg(MeshWalk *walk, float scale)
{
    const PrismPlace end = walk->end;
    const intl passes = walk->side >= 0, beside = walk->beside;
    const floatl first = 1.0f - end.second - end.third;
    const floatl along = clamp_lanes(chosen(end.third, first, end.second, walk->side), (floatl)0.0f, (floatl)1.0f);
    const intl goes_on = passes & (end.depth > LEAST_DEPTH * scale), crosses = goes_on & (beside >= 0);
    walk->is_beyond = goes_on & (beside < 0) & !walk->ends_at_border;
    walk->active = walk->active & (crosses | walk->is_beyond) & isfinite_lanes(walk->leg + end.depth + along);
    const intl triangle = max(beside, (intl)0) / 3, side = beside - 3 * triangle;
    walk->reached += walk->way * walk->leg;
    walk->triangle = select_lanes(crosses, triangle, walk->triangle);
    walk->place = end;
    walk->place.second = select_lanes(crosses, chosen(along, (floatl)0.0f, 1.0f - along, side), end.second);
    walk->place.third = select_lanes(crosses, chosen(1.0f - along, along, (floatl)0.0f, side), end.third);
}
#endif
