#ifndef RELIEF_SHADOWS_H
#define RELIEF_SHADOWS_H
/* Shadows on a relief. A second search, between the point and the light, finds occlusion by the relief around the
 * point (Oliveira & Policarpo 2005, figure 4); the light's maps hold all other occluders. */
#include "relief/shading_point.h"

/* Values of hidden_by */
#define MAPPED 0   /* the light's map decides; where it shows shadow on a base that is not flat, the search decides */
#define SEARCHED 1 /* the second search decides, and the map at the place where the light's ray leaves the relief */
#define LIFT 1e-3f /* fraction of the relief's depth by which the point is raised, so that the search misses it */

#if SHADOWED
/* The ray from a point of the relief to the light, within the relief around the point */
typedef struct {
    ReliefRay ray;       /* the light's ray in reverse, from its exit down to the point */
    Vector exit, normal; /* exit from the relief, and the base's normal there */
    intl is_valid, leaves; /* whether the ray can be searched, and whether it leaves the relief */
    floatl distance;   /* from the point to the exit, in scene units */
} LightRay;

/* Depths use equation 7, below the quadric at the entry of the pixel's ray. So the point lies exactly on the relief, or
 * nearly so after follow_mesh, and the light's ray leaves the relief where its depth below this quadric is 0. */
LightRay light_ray(const Relief *relief, const Entry *e, const ShadingPoint *shading, Vector light)
{
    LightRay made;
    ReliefRay *ray = &made.ray;
    Vector x, y;
    tangents_of(e, &x, &y);
    const float scale = relief->scale, per_scale = 1.0f / scale, bends = relief->quadric ? 1.0f : 0.0f;
    const floatl px = DOT(shading->from_entry, x), py = DOT(shading->from_entry, y),
                 pz = DOT(shading->from_entry, e->normal);
    const floatl lx = DOT(light, x), ly = DOT(light, y), lz = DOT(light, e->normal);
    const floatl found = (bends * quadric_form(e, px, py, px, py) - pz) * per_scale;
    const floatl height = HEIGHT_UNIT *
                          height_in(relief->texels, shading->track.map, shading->track.x, shading->track.y);
    const floatl depth = max_lanes(1.0f - height - LIFT, (floatl)0.0f);
    /* At the distance s from the point towards the light, the depth is depth + slope s + K s^2. */
    const floatl slope = (2.0f * bends * quadric_form(e, px, py, lx, ly) - lz) * per_scale;
    const floatl K = bends * quadric_form(e, lx, ly, lx, ly) * per_scale;
    const floatl discriminant = slope * slope - 4.0f * K * depth,
                 divisor = sqrt(max_lanes(discriminant, (floatl)0.0f)) - slope;
    made.leaves = (discriminant >= 0.0f) & (divisor > 0.0f);
    const floatl distance = select_lanes(made.leaves, 2.0f * depth / divisor, (floatl)0.0f),
                 lift = (found - depth) * scale;
    made.distance = distance;
    made.exit.x = shading->point.x + lift * e->normal.x + distance * light.x;
    made.exit.y = shading->point.y + lift * e->normal.y + distance * light.y;
    made.exit.z = shading->point.z + lift * e->normal.z + distance * light.z;
    const floatl qx = px + distance * lx, qy = py + distance * ly; /* position of the exit */
    const floatl across = -2.0f * bends * quadric_form(e, qx, qy, 1.0f, 0.0f),
                 down = -2.0f * bends * quadric_form(e, qx, qy, 0.0f, 1.0f);
    const Vector normal = {e->normal.x + across * x.x + down * y.x, e->normal.y + across * x.y + down * y.y,
                           e->normal.z + across * x.z + down * y.z};
    made.normal = normalized(normal);
    ray->du = -DOT(light, e->along_u);
    ray->dv = -DOT(light, e->along_v);
    const floatl u = shading->place.u - ray->du * distance, v = shading->place.v - ray->dv * distance;
    ray->u = WRAPPED_UV(CLAMPED_U, u);
    ray->v = WRAPPED_UV(CLAMPED_V, v);
#if WALKS
    ray->depth = (floatl)0.0f;
#endif
    ray->L = -slope - 2.0f * K * distance;
    ray->K = K;
    ray->level = shading->place.level;
#if DISTANCE == PERPENDICULAR
    ray->vz = (floatl)0.0f; /* with vz = 0 and bend = 0, equation 6 is equation 7 */
    ray->bend = (floatl)0.0f;
    ray->scale = scale;
#endif
    made.is_valid = (distance > 0.0f) & (ray->L > 0.0f) & is_finite_ray(ray);
    return made;
}

/* Returns whether the relief around the point occludes the light, by the paper's second search (figure 4). */
intl is_shadowed(const Relief *relief, const LightRay *light, intl wanted)
{
    Search search, *s = &search;
    s->ray = light->ray;
    mask_inactive(&s->ray, light->is_valid & wanted);
    set_end(&s->ray);
    s->track = track_of(&s->ray, relief->levels);
    /* The search ends before the point, at a distance that is greater than the search's error. */
    const floatl per_texel = 1.0f / max_lanes(max_lanes(fabs(s->track.dx), fabs(s->track.dy)), (floatl)1e-20f);
    const floatl end = light->distance - 2.0f * NUDGE * per_texel;
    s->ray.at_bottom = s->ray.at_bottom & (s->ray.end < end);
    s->ray.end = min_lanes(s->ray.end, end);
    s->tier = FIRST_TIER;
    s->searches = s->active = light->is_valid & wanted & (end > 0.0f);
#if COUNTERS
    s->taken = 0;
#endif
    search_relief(relief, s, 1);
    return s->searches & s->found;
}

/* The visibility of the light from a point of the relief, 0 to 1. own: the relief's normal there; faces: lanes that
 * face the light; hidden_by: MAPPED or SEARCHED; flat_base: 1 if all rays find the relief in the same place.
 *
 * The light's map is drawn with the normals and quadrics at the entries of the light's rays. Where the base is curved,
 * or has facets, these rays hit the relief at other places than the picture's rays, and the relief would shade itself.
 * The same would happen below an edge that juts out, where the light's rays enter on one side of the edge and the
 * picture's rays on the other. So the second search decides whether the relief around the point occludes the light, and
 * the map decides at the place where the light's ray leaves the relief. For a ray that never leaves the relief below
 * the quadric, as along a saddle, the map alone decides. */
INLINED floatl in_sight(const Relief *relief, const Entry *e, const ShadingPoint *shading, Vector own, Light light,
                        intl faces, int hidden_by, int flat_base SHADOW_PARAMETERS)
{
    intl wanted = faces;
    floatl mapped = 0.0f;
    if (hidden_by == MAPPED) {
        mapped = VISIBILITY(shading->point, own);
        wanted = wanted & (mapped < 1.0f);
        if (flat_base || !any_lane(wanted))
            return mapped;
    }
    const LightRay ray = light_ray(relief, e, shading, to_light(light, shading->point).direction);
    if (hidden_by == SEARCHED && any_lane(wanted & !ray.leaves))
        mapped = VISIBILITY(shading->point, own);
    wanted = wanted & ray.leaves;
    if (!any_lane(wanted))
        return mapped;
    const floatl outside = VISIBILITY(ray.exit, ray.normal);
    if (hidden_by == MAPPED) {
        wanted = wanted & (outside > mapped);
        if (!any_lane(wanted))
            return mapped;
    }
    return select_lanes(wanted, select_lanes(is_shadowed(relief, &ray, wanted), (floatl)0.0f, outside), mapped);
}
#endif
#endif
