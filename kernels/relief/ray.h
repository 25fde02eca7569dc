#ifndef RELIEF_RAY_H
#define RELIEF_RAY_H
/* A ray in a relief: its depth below the mesh, and its end (Oliveira & Policarpo 2005, sections 3.2 and 3.3).
 *
 * A ray enters the relief at t = 0, at depth 0. Its depth at t is L t + K t^2, and depth 1 is the bottom. On the map
 * the ray is straight: at t it is at (u + du t, v + dv t).
 *
 * DISTANCE chooses how depth is measured. APPROXIMATE: along z, from the quadric down to the ray's point P (equation
 * 7). PERPENDICULAR: from P to the quadric, at right angles to the ray and in the plane of ray and normal (equation 6),
 * or equation 7 where equation 6 has no solution. If the quadric is a plane, equation 6 gives the depth divided by the
 * sine of the angle between ray and normal. EXACT: below the mesh itself, in legs (walk.h), which may start at any
 * depth.
 */
#include "lib/lanes.h"

#define APPROXIMATE 0
#define EXACT 1
#define PERPENDICULAR 2
#ifndef DISTANCE
#define DISTANCE APPROXIMATE /* or EXACT, or PERPENDICULAR */
#endif
#define WALKS (DISTANCE == EXACT) /* rays walk from leg to leg */
#define NEVER 1e20f     /* scene units */
#define TILES_MAX 1e3f  /* most tiles of the map that a ray crosses, so that its coordinates stay small */

typedef struct {
    floatl u, v, du, dv; /* du, dv per scene unit */
    floatl L, K;         /* depth: L t + K t^2 */
    floatl end;          /* least t > 0 where the ray comes out again, at depth 0, or reaches the bottom */
    intl at_bottom;      /* whether the ray ends at the bottom */
    intl level;          /* level of the map */
    floatl depth;        /* depth at t = 0, for rays that walk */
#if DISTANCE == PERPENDICULAR
    floatl vz;    /* component of the unit direction along the normal: < 0 */
    floatl scale; /* depth of the bottom, in scene units */
    floatl bend;  /* the quadric's a x^2 + b y^2 + c x y for the unit direction (x, y, vz) */
#endif
} ReliefRay;

#if WALKS
#define START_DEPTH(ray) ((ray)->depth)
#else
#define START_DEPTH(ray) 0.0f
#endif

/* Equation 7 */
#define QUADRIC_DEPTH(ray, t) (START_DEPTH(ray) + (t) * ((ray)->L + (t) * (ray)->K))

#if DISTANCE == PERPENDICULAR
/* Equation 6. P = V t is on the ray, R = P + s U on the quadric; U, in the plane of V and normal N, is at right angles
 * to V. */
floatl depth_of(const ReliefRay *ray, floatl t)
{
    const floatl depth = QUADRIC_DEPTH(ray, t), below = depth * ray->scale;
    const floatl uz = sqrt(max_lanes(1.0f - ray->vz * ray->vz, (floatl)1e-6f)); /* U = (N - vz V) / uz */
    const floatl per = -ray->vz / uz;                                         /* U's tangential part, divided by V's */
    const floatl A = per * per * ray->bend, B = 2.0f * t * per * ray->bend - uz;
    const floatl discriminant = B * B - 4.0f * A * below, root = sqrt(max_lanes(discriminant, (floatl)0.0f));
    return select_lanes((discriminant >= 0.0f) & (root > B), 2.0f * depth / (root - B), depth);
}
#else
#define depth_of QUADRIC_DEPTH
#endif

/* Makes the rays in `which` use equation 7: with vz = 0 and bend = 0, equation 6 gives the same depths. */
INLINED void use_quadric_depth(ReliefRay *ray, intl which)
{
#if DISTANCE == PERPENDICULAR
    ray->vz = select_lanes(which, (floatl)0.0f, ray->vz);
    ray->bend = select_lanes(which, (floatl)0.0f, ray->bend);
#endif
}

/* Gives inactive lanes a finite ray. */
void mask_inactive(ReliefRay *ray, intl active)
{
    ray->u = select_lanes(active, ray->u, (floatl)0.0f);
    ray->v = select_lanes(active, ray->v, (floatl)0.0f);
    ray->du = select_lanes(active, ray->du, (floatl)0.0f);
    ray->dv = select_lanes(active, ray->dv, (floatl)0.0f);
    ray->L = select_lanes(active, ray->L, (floatl)1.0f);
    ray->K = select_lanes(active, ray->K, (floatl)0.0f);
#if WALKS
    ray->depth = select_lanes(active, ray->depth, (floatl)0.0f);
#endif
#if DISTANCE == PERPENDICULAR
    ray->vz = select_lanes(active, ray->vz, (floatl)-0.5f);
    ray->bend = select_lanes(active, ray->bend, (floatl)0.0f);
#endif
}

/* Shortens a ray that would cross more than TILES_MAX tiles. */
INLINED void limit_tiles(ReliefRay *ray)
{
    ray->end = fmin(ray->end, TILES_MAX / fmax(fabs(ray->du) + fabs(ray->dv), (floatl)1e-20f));
}

/* Sets the end of the ray, where it comes out again or reaches the bottom (section 3.3). */
void set_end(ReliefRay *ray)
{
    const floatl discriminant = ray->L * ray->L + 4.0f * ray->K;
    ray->at_bottom = discriminant >= 0.0f;
    ray->end = select_lanes(ray->at_bottom, 2.0f / (ray->L + sqrt(fmax(discriminant, (floatl)0.0f))), -ray->L / ray->K);
#if DISTANCE == PERPENDICULAR
    /* Bisection: a ray that reaches the bottom does so before its deepest point. */
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
    limit_tiles(ray);
}
#endif
