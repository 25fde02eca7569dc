#ifndef SLICING_VIEW_COLORS_H
#define SLICING_VIEW_COLORS_H
/* The colour of a point where a ray meets an object: a mean of the colours of the views that see the point. A view
 * weighs more if its direction is closer to the picture's.
 *
 * A view sees a point if the ray meets the view's surface at the point or a little in front of it, because an object's
 * points lie behind the surfaces of all views. Here a view's surface is bilinear, without the creases between samples.
 * The more the depths of a view's samples around a point differ from the point's, the less the view counts. So a view
 * of an oblique surface, with a sample in front and a sample behind, counts little unless no other view sees the point.
 */
#include "lib/color.h"
#include "lib/gbuffer.h"
#include "slicing/object_slices.h"

#define BLENDED_VIEWS 3     /* most views in a pixel's colour */
/* Differences in depth between a view's sample and a point, in sample distances: */
#define LEVEL_SAMPLES 0.5f  /* at this difference, a sample's weight for visibility is a half */
#define TORN_SAMPLES 4.0f   /* at this difference, a sample's weight for colour is a half */
#define HIDDEN_SAMPLES 4.0f /* a point is occluded if all four samples around lie farther in front of the point */
#define BEYOND_OUTLINE 1e6f   /* stands for the distance to a view's surface where the view has no surface */
#define VIEWS_MIN 0.002f    /* number of views: if fewer see a point, the hit is refined before the point is coloured */
#define CLOSER_HALVINGS 6   /* bisections that refine the hit, which matter where a view looks along the surface */
#define STRIDES 4           /* most steps from a hit forward to a view's surface; each step doubles the distance */

/* The sum of weighted colours of at most BLENDED_VIEWS views */
typedef struct {
    Color color, normal;
    floatl weight;
    floatl views; /* number of views; a view that sees a point in part counts as that fraction */
} Blend;

/* Factor from differences in a view's nearness, near `mine`, to sample distances (of the coarsest view) */
INLINED floatl samples_per_nearness(const Views *views, const ViewRay *view, floatl mine)
{
    const intl flat = fabs(view->w.fixed - 1.0f) + fabs(view->w.sloped) == 0.0f; /* orthographic: nearness is -z */
    return 1.0f / (views->sample * select_lanes(flat, (floatl)1.0f, mine * mine));
}

/* The colour of a point from a view's four samples around it */
typedef struct {
    Color color, normal; /* times their weights */
    floatl weight;
    floatl part; /* fraction of the samples' weight that lies near the point's depth: low on an oblique surface */
    intl sees;
} ViewColor;

/* visible: 1: a sample weighs less the more its depth differs from `at`, the point's depth; 0: depths do not count */

INLINED ViewColor view_color(const Views *views, int number, const ViewRay *view, Samples samples, floatl at,
                             int visible)
{
    ViewColor seen_color = {{0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}, 0.0f, 0.0f, samples.on_image};
    global const int *size = views->sizes + 3 * number;
    const floatl mine = AT(view->q, at) / AT(view->w, at), by = samples_per_nearness(views, view, mine);
    for (int k = 0; k < 4; k++) {
        const intl word = texels_at(views->colors + size[2], samples.taps.at[k]);
        floatl weight = samples.weights[k] * to_floatl((word >> 24) & 1);
        if (visible) {
            const floatl off = ((floatl)(gather(SURFACE_OF(views, size), samples.taps.at[k])) - mine) * by,
                         squared = off * off;
            seen_color.part += weight / (1.0f + squared * (1.0f / (LEVEL_SAMPLES * LEVEL_SAMPLES)));
            weight = weight / (1.0f + squared * (1.0f / (TORN_SAMPLES * TORN_SAMPLES)));
        }
        add_color(&seen_color.color, weight, color_of(word));
#if GBUFFER == 2
        add_color(&seen_color.normal, weight, color_of(texels_at(views->normals + size[2], samples.taps.at[k])));
#endif
        seen_color.weight += weight;
    }
    seen_color.sees = seen_color.sees & (seen_color.weight > (visible ? 0.0f : 1e-3f));
    return seen_color;
}

/* How far a view's surface lies in front of the rays' points at depth z, in sample distances; farthest: how far the
 * farthest of the four samples around lies in front, INFINITY if the view has no surface there */
INLINED floatl view_surface_before(const Views *views, int number, const ViewRay *view, floatl z, floatl *farthest)
{
    global const int *size = views->sizes + 3 * number;
    const floatl inverse = 1.0f / AT(view->w, z), mine = AT(view->q, z) * inverse;
    const Samples samples = samples_at(size, AT(view->u, z) * inverse, AT(view->v, z) * inverse);
    const floatl first = (floatl)(gather(SURFACE_OF(views, size), samples.taps.at[0]));
    floatl least = first;
    for (int k = 1; k < 4; k++)
        least = min_lanes(least, (floatl)(gather(SURFACE_OF(views, size), samples.taps.at[k])));
    const floatl per_sample = samples_per_nearness(views, view, mine);
    const SurfaceSample surface = surface_at(SURFACE_OF(views, size), size, samples, views->outline,
                                             views->reaches[number], mine, -1, 0);
    const intl nothing = (as_intl(first) & OUTLINE_CELL) == EMPTY_CELL;
    *farthest = select_lanes(nothing, (floatl)INFINITY, (least - mine) * per_sample);
    return select_lanes(surface.there, (surface.nearness - mine) * per_sample, (floatl)-BEYOND_OUTLINE);
}

/* The depth at which the rays meet a view's surface: at `hit`, or at most STRIDES steps in front of `hit`. If the steps
 * do not reach the surface, or if all samples around lie far in front of the point, the view does not see the point,
 * and the ray is removed from `active`. */
INLINED floatl own_surface_before(const Views *views, int number, const ViewRay *view, floatl hit, intl *active)
{
    floatl farthest, z = hit, from = hit, last = view_surface_before(views, number, view, hit, &farthest);
    *active = *active & (farthest <= HIDDEN_SAMPLES);
    intl open = *active & (last > 0.0f);
    float back = views->stride;
    for (int i = 0; i < STRIDES && any_lane(open); i++, back *= 2.0f) {
        const floatl to = hit - back, before = view_surface_before(views, number, view, to, &farthest);
        const intl met = open & (before <= 0.0f);
        z = select_lanes(met, to + (to - from) * before / (last - before), z);
        open = open & !met;
        from = to;
        last = before;
    }
    *active = *active & !open;
    return z;
}

/* Blends the views' colours of the rays' points at depth `hit`, starting with the closest view. visible: 1: only views
 * that see a point count; 0: all views count */
INLINED Blend blend_views(const Views *views, const WorldRay *ray, floatl hit, intl active, int visible)
{
    Blend blend = {{0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}, 0.0f, 0.0f};
    for (int i = 0; i < views->colored; i++) { /* `order` begins with the closest view */
        intl wanted = active & (blend.views < BLENDED_VIEWS - 0.5f);
        if (!any_lane(wanted))
            break;
        const int number = views->order[i];
        global const int *size = views->sizes + 3 * number;
        const ViewRay view = view_ray(views->matrices + 16 * number, ray);
        const floatl at = visible ? own_surface_before(views, number, &view, hit, &wanted) : hit,
                     inverse = 1.0f / AT(view.w, at);
        const Samples samples = samples_at(size, AT(view.u, at) * inverse, AT(view.v, at) * inverse);
        const ViewColor seen_color = view_color(views, number, &view, samples, at, visible);
        /* Samples without a colour do not reduce a view's weight. */
        const floatl part = visible ? seen_color.part : (floatl)1.0f;
        const floatl share = select_lanes(wanted & seen_color.sees, views->closeness[number] * part / seen_color.weight,
                                          (floatl)0.0f);
        const Color none = {0.0f, 0.0f, 0.0f};
        add_color(&blend.color, share, select_color(seen_color.sees, seen_color.color, none));
#if GBUFFER == 2
        add_color(&blend.normal, share, select_color(seen_color.sees, seen_color.normal, none));
#endif
        blend.weight += share * select_lanes(seen_color.sees, seen_color.weight, (floatl)0.0f);
        blend.views += select_lanes(wanted & seen_color.sees, part, (floatl)0.0f);
    }
    return blend;
}

/* The colours of the rays' points at depth `hit`, from views that see the point, or if there are none, from the closest
 * views */
OUTLINED Blend blend_at(const Views *views, const WorldRay *ray, RaySegment segment, floatl hit, int halvings, intl found,
               intl *tests)
{
    Blend blend = {{0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}, 0.0f, 0.0f};
    if (views->visible) {
        blend = blend_views(views, ray, hit, found, 1);
        const intl doubted = found & (blend.views < VIEWS_MIN);
        if (any_lane(doubted)) {
            ViewRays rays;
            hold_rays(views, ray, &rays);
            const floatl step = fabs(1.0f / segment.number.sloped) / (float)(1 << halvings);
            refine_object_hit(views, &rays, segment, step, CLOSER_HALVINGS, doubted, &hit, tests);
            const Blend closer = blend_views(views, ray, hit, doubted, 1);
            blend.color = select_color(doubted, closer.color, blend.color);
            blend.normal = select_color(doubted, closer.normal, blend.normal);
            blend.weight = select_lanes(doubted, closer.weight, blend.weight);
        }
    }
    const intl unseen = found & !(blend.weight > 0.0f);
    if (any_lane(unseen)) {
        const Blend any = blend_views(views, ray, hit, unseen, 0);
        blend.color = select_color(unseen, any.color, blend.color);
        blend.normal = select_color(unseen, any.normal, blend.normal);
        blend.weight = select_lanes(unseen, any.weight, blend.weight);
    }
    return blend;
}
#endif
