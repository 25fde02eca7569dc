#ifndef RELIEF_EXITS_H
#define RELIEF_EXITS_H
/* Depths of rays that came out of their quadrics before they leave the mesh, estimated from their exits. */
#include "relief/entry.h"

#define ARC_PARTS 16 /* equal parts of a ray below the mesh; the ray's deepest point is sought at their ends */
#define BOTTOM_TOLERANCE 1e-3f /* fraction of the depth by which a ray that grazes the bottom may miss it */

/* A ray is below the mesh until it leaves through a back, `distance` after its entry, where its depth falls by `slope`
 * per scene unit. In between, its depth is estimated by the cubic with the depths and slopes of both ends. Finds where
 * the cubic first reaches the bottom, or else is deepest: sets t, and returns the depth there. */
INLINED floatl deepest_between(floatl first_slope, floatl distance, floatl slope, floatl *t)
{
    floatl depth = 0.0f, before = 0.0f;
    *t = 0.0f;
    for (int i = 1; i <= ARC_PARTS; i++) {
        const float part = (float)i / ARC_PARTS, rest = 1.0f - part;
        const floatl now = distance * (part * rest) * (first_slope * rest + slope * part);
        const intl rises = (depth < 1.0f) & (now > depth);
        const floatl reached = select_lanes(now > 1.0f, (1.0f - before) / (now - before), (floatl)1.0f);
        *t = select_lanes(rises, distance * (i - 1 + reached) * (1.0f / ARC_PARTS), *t);
        depth = select_lanes(rises, min_lanes(now, (floatl)1.0f), depth);
        before = now;
    }
    return depth;
}

/* Changes the depths of escaped rays that leave the mesh `distance` after their entry, if the cubic reaches deeper than
 * their quadrics. The new depth is a parabola to the point where the cubic is at the bottom, or deepest. It begins with
 * the ray's own slope, or a lower slope. Returns the changed rays; share: fraction of the quadric's curvature that
 * remains */
intl follow_mesh(const Relief *relief, ReliefRay *ray, const Entry *out, Vector direction, floatl distance, intl escaped,
                 floatl *share)
{
    const floatl K = ray->K, slope = max_lanes(DOT(direction, out->normal), (floatl)0.0f) / relief->scale;
    floatl t;
    const floatl depth = deepest_between(ray->L, distance, slope, &t), safe_t = max_lanes(t, (floatl)1e-20f);
    const intl follows = escaped & (t > 0.0f) & (depth > depth_of(ray, t));
    const floatl bends = (depth / safe_t - ray->L) / safe_t;
    *share = select_lanes(follows & (K < bends), max_lanes(bends / K, (floatl)0.0f), (floatl)1.0f);
    const floatl mean = depth * (1.0f + BOTTOM_TOLERANCE) / safe_t, rise = min_lanes(ray->L, 2.0f * mean);
    ray->L = select_lanes(follows, rise, ray->L);
    ray->K = select_lanes(follows, (mean - rise) / safe_t, K);
    use_quadric_depth(ray, follows);
    return follows;
}
#endif
