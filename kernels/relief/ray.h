#ifndef RELIEF_RAY_H
#define RELIEF_RAY_H
/* A ray in a relief: its depth below the mesh, and where it leaves (Oliveira & Policarpo 2005, sections 3.2 and 3.3).
 *
 * A ray enters at t = 0, at depth 0. On the map it runs straight: u + du t, v + dv t; with BENT it bends by squares of
 * t, as its foot on a curved surface runs on faster, and gradients change along that; and depths gain a cube of t where
 * circles or the mesh tell them.
 *
 * DISTANCE is how its depth is measured, 1 at the bottom: APPROXIMATE: L t + K t^2, how far its point P lies below the quadric, along z (equation 7). EXACT: how
 * far P lies below circles of the quadric's principal curvatures, the one that bends outwards least first: the true
 * distance to planes, tubes and spheres, to tori at their equators, and never more than equation 7. PERPENDICULAR: the
 * paper's equation 6, from P to R, on the quadric, at right angles to the ray in the plane of ray and normal; where it
 * has no solution, equation 7. On a plane it is longer than the depth by 1 / sine of the ray and normal. With WITHIN a
 * ray may also start below the mesh, and rise: depth + L t + K t^2, by equation 7 alone.
 */
#include "lib/lanes.h"

#define APPROXIMATE 0
#define EXACT 1
#define PERPENDICULAR 2
#ifndef DISTANCE
#define DISTANCE APPROXIMATE /* or EXACT, or PERPENDICULAR: how far below the surface a ray is */
#endif
#define BENT (DISTANCE == EXACT) /* u and v bend along rays, and depths have a cube */
#ifndef WITHIN
#define WITHIN 0 /* 1: the eye is below the mesh, and its rays start there */
#endif
#define NEVER 1e20f        /* scene units */
#define MOST_TURNED 1.0f  /* of u and v: more would be turned round by their bending */
#define TILES_MAX 1e3f    /* that a ray crosses, so that numbers stay small */
#define BOTTOM_PRECISION 1e-5f /* of the depth: within which the bottom is searched */
#define BOTTOM_TOLERANCE 1e-3f /* of the depth: by how much a ray that grazes the bottom may miss it */

/* A quadric's principal curvatures, and a ray's direction along them */
typedef struct {
    floatl k1, k2; /* curvatures, > 0 outwards; k1 <= k2 */
    floatl w1, w2; /* squares of the direction's parts along them */
} PrincipalCurvatures;

typedef struct {
    floatl u, v, du, dv; /* du, dv per scene unit */
#if BENT
    floatl bend_u, bend_v; /* along the ray u is u + du t + bend_u t^2, and so is v */
    floatl M, bottom;      /* its depth is L t + K t^2 + M t^3 up to the bottom; bottom: where that is, if M is not 0 */
#endif
    floatl L, K;         /* depth by equation 7: L t + K t^2 */
    floatl end;          /* least t > 0 at which the ray comes out again, at depth 0, or reaches the bottom */
    intl at_bottom;      /* it reaches the bottom there */
    intl level;          /* of the map */
#if WITHIN
    floatl depth; /* where the ray starts; > 0: below the mesh */
#endif
#if DISTANCE == PERPENDICULAR
    floatl vz;    /* of the unit direction, along the normal: < 0 */
    floatl scale; /* of depth 1 */
    floatl bend;  /* a x^2 + b y^2 + c x y of the direction */
#endif
} ReliefRay;

/* u or v, or x or y on the map, after t; and by how much it changes there */
#if BENT
#define ALONG(from, change, bend, t) ((from) + (t) * ((change) + (bend) * (t)))
#define CHANGE_AT(change, bend, t) ((change) + 2.0f * (bend) * (t))
#define MOST_BENT(bend, end) (fabs(bend) * (end) * (end))
#define CHANGED_K(ray, t) ((ray)->K + (ray)->M * (t))
#else
#define ALONG(from, change, bend, t) ((from) + (t) * (change))
#define CHANGE_AT(change, bend, t) (change)
#define MOST_BENT(bend, end) 0.0f
#define CHANGED_K(ray, t) ((ray)->K)
#endif

/* Equation 7 */
#if WITHIN
#define START_DEPTH(ray) ((ray)->depth)
#define STARTS_AT_MESH(ray) ((ray)->depth <= 0.0f)
#define QUADRIC_DEPTH(ray, t) ((ray)->depth + (t) * ((ray)->L + (t) * CHANGED_K(ray, t)))
#else
#define START_DEPTH(ray) 0.0f
#define STARTS_AT_MESH(ray) ((intl)-1)
#define QUADRIC_DEPTH(ray, t) ((t) * ((ray)->L + (t) * CHANGED_K(ray, t)))
#endif

#if BENT
#define CHANGE_OF_DEPTH(ray, t) ((ray)->L + (t) * (2.0f * (ray)->K + 3.0f * (ray)->M * (t)))
#else
#define CHANGE_OF_DEPTH(ray, t) ((ray)->L + 2.0f * (ray)->K * (t))
#endif

#if BENT
/* The first t > 0 where a + b t + c t^2, a > 0, is 0; NEVER: there is none */
INLINED floatl first_zero(floatl a, floatl b, floatl c)
{
    const floatl discriminant = b * b - 4.0f * c * a, root = sqrt(max_lanes(discriminant, (floatl)0.0f));
    const floatl t = select_lanes(b < 0.0f, 2.0f * a, b + root) / select_lanes(b < 0.0f, root - b, -2.0f * c);
    return select_lanes((discriminant >= 0.0f) & ((b < 0.0f) | (c < 0.0f)), t, (floatl)NEVER);
}
#endif

/* Where a ray is deepest; at least NEVER: nowhere */
INLINED floatl deepest_at(const ReliefRay *ray)
{
#if BENT
    return first_zero(ray->L, 2.0f * ray->K, 3.0f * ray->M);
#else
    return select_lanes(ray->K < 0.0f, -0.5f * ray->L / ray->K, (floatl)INFINITY);
#endif
}

/* How far a circle of curvature k lies before (x, z), along z; x_2: x squared */
INLINED floatl before_circle(floatl k, floatl x_2, floatl z)
{
    const floatl up = 1.0f + k * z;
    return k * x_2 / max_lanes(up + sqrt(up * up + k * k * x_2), (floatl)1e-3f);
}

/* By how much a ray's point, z along the normal, is less deep below the circles than by equation 7, in scene units. A
 * circle along the first principal direction is carried around one along the second, as in a torus. */
INLINED floatl beyond_quadric(const PrincipalCurvatures *c, floatl z, floatl t)
{
    const floatl t_2 = t * t;
    const floatl first = before_circle(c->k1, c->w1 * t_2, z), second = before_circle(c->k2, c->w2 * t_2, z + first);
    return first + second - 0.5f * t_2 * (c->k1 * c->w1 + c->k2 * c->w2);
}

#if DISTANCE == PERPENDICULAR
/* P = V t; R = P + s U, U at right angles to V in the plane of V and the normal. */
floatl depth_of(const ReliefRay *ray, floatl t)
{
    const floatl depth = QUADRIC_DEPTH(ray, t), below = depth * ray->scale;
    const floatl uz = sqrt(max_lanes(1.0f - ray->vz * ray->vz, (floatl)1e-6f)); /* U = (N - vz V) / uz */
    const floatl per = -ray->vz / uz;                                         /* U's tangential part over V's */
    const floatl A = per * per * ray->bend, B = 2.0f * t * per * ray->bend - uz;
    const floatl discriminant = B * B - 4.0f * A * below, root = sqrt(max_lanes(discriminant, (floatl)0.0f));
    return select_lanes((discriminant >= 0.0f) & (root > B), 2.0f * depth / (root - B), depth);
}
#else
#define depth_of QUADRIC_DEPTH
#endif

/* The depths of some rays become those of equation 7: without curvatures there is no other. */
INLINED void use_quadric_depth(ReliefRay *ray, intl which)
{
#if DISTANCE == PERPENDICULAR
    ray->vz = select_lanes(which, (floatl)0.0f, ray->vz);
    ray->bend = select_lanes(which, (floatl)0.0f, ray->bend);
#endif
}

/* Gives inactive lanes a ray that is finite. */
void mask_inactive(ReliefRay *ray, intl active)
{
    ray->u = select_lanes(active, ray->u, (floatl)0.0f);
    ray->v = select_lanes(active, ray->v, (floatl)0.0f);
    ray->du = select_lanes(active, ray->du, (floatl)0.0f);
    ray->dv = select_lanes(active, ray->dv, (floatl)0.0f);
#if BENT
    ray->bend_u = select_lanes(active, ray->bend_u, (floatl)0.0f);
    ray->M = select_lanes(active, ray->M, (floatl)0.0f);
    ray->bend_v = select_lanes(active, ray->bend_v, (floatl)0.0f);
#endif
    ray->L = select_lanes(active, ray->L, (floatl)1.0f);
    ray->K = select_lanes(active, ray->K, (floatl)0.0f);
#if WITHIN
    ray->depth = select_lanes(active, ray->depth, (floatl)0.0f);
#endif
#if DISTANCE == PERPENDICULAR
    ray->vz = select_lanes(active, ray->vz, (floatl)-0.5f);
    ray->bend = select_lanes(active, ray->bend, (floatl)0.0f);
#endif
}

#if WITHIN
/* Where rays end that start below the mesh, and may rise: where they come out or reach the bottom, whichever is first.
 * A ray that comes out by less than the relief's depth and sinks again does not end there: the mesh may be above it all
 * along. */
void set_end_within(ReliefRay *ray)
{
    const floatl L = ray->L, K = ray->K, depth = ray->depth, below = 1.0f - depth;
    const floatl sinks = L * L + 4.0f * K * below, rises = L * L - 4.0f * K * depth; /* discriminants */
    const floatl to_sink = sqrt(max_lanes(sinks, (floatl)0.0f)) + L, root = sqrt(max_lanes(rises, (floatl)0.0f));
    const floatl out_at = select_lanes(L > 0.0f, -0.5f * (L + root) / K, 2.0f * depth / (root - L));
    const intl comes_out = (rises >= max_lanes(4.0f * K, (floatl)0.0f)) & ((L <= 0.0f) | (K < 0.0f));
    const intl hits = (sinks >= 0.0f) & (to_sink > 0.0f);
    const floatl out = min_lanes(select_lanes(comes_out, out_at, (floatl)NEVER), (floatl)NEVER);
    const floatl bottom = min_lanes(select_lanes(hits, 2.0f * below / to_sink, (floatl)NEVER), (floatl)NEVER);
    const intl within = depth > 0.0f;
    ray->end = select_lanes(within, min_lanes(out, bottom), ray->end);
    ray->at_bottom = select_lanes(within, bottom < out, ray->at_bottom);
}
#endif

/* Where the ray ends: comes out again, or reaches the bottom (section 3.3). */
void set_end(ReliefRay *ray)
{
    const floatl discriminant = ray->L * ray->L + 4.0f * ray->K;
    ray->at_bottom = discriminant >= 0.0f;
    ray->end = select_lanes(ray->at_bottom, 2.0f / (ray->L + sqrt(fmax(discriminant, (floatl)0.0f))), -ray->L / ray->K);
#if DISTANCE == PERPENDICULAR
    /* The bottom is reached before the ray is deepest, if at all: bisection */
    floatl before = 0.0f, after = select_lanes(ray->K < 0.0f, -0.5f * ray->L / ray->K, 4.0f * ray->end);
    const intl reaches = depth_of(ray, after) >= 1.0f;
    for (int i = 0; i < 20; i++) {
        const floatl middle = 0.5f * (before + after);
        const intl below = depth_of(ray, middle) >= 1.0f;
        after = select_lanes(below, middle, after);
        before = select_lanes(below, before, middle);
    }
    ray->end = select_lanes(reaches, after, select_lanes(ray->K < 0.0f, -ray->L / ray->K, ray->end));
    ray->at_bottom = reaches | (ray->at_bottom & (ray->K >= 0.0f));
#endif
#if WITHIN
    set_end_within(ray);
#endif
#if BENT
    const intl is_cubic = ray->M != 0.0f, reaches = ray->bottom < NEVER;
    const floatl out = first_zero(ray->L, ray->K, ray->M);
    ray->end = select_lanes(is_cubic, select_lanes(reaches, ray->bottom, out), ray->end);
    ray->at_bottom = select_lanes(is_cubic, reaches, ray->at_bottom);
#endif
    ray->end = fmin(ray->end, TILES_MAX / fmax(fabs(ray->du) + fabs(ray->dv), (floatl)1e-20f));
#if BENT
    const floatl bend = (fabs(ray->bend_u) + fabs(ray->bend_v)) * ray->end,
                 most = MOST_TURNED * (fabs(ray->du) + fabs(ray->dv));
    const floatl share = select_lanes(bend > most, most / bend, (floatl)1.0f);
    ray->bend_u *= share;
    ray->bend_v *= share;
#endif
}
#endif
