#ifndef RELIEF_WALKS_H
#define RELIEF_WALKS_H
/* Walks (walk.h) of the rays of a region's pixels: from their entries, or from an eye within the relief. */
#include "relief/entries.h"

#if WALKS
#include "relief/walk.h"

#define LEAST_SLOPE 1e-4f /* least slope of a ray from the eye against the section (walk.h) that contains the eye */

INLINED void begin_walk(MeshWalk *walk, intl active, intl triangle, floatl depth)
{
    walk->reached = 0.0f;
    walk->triangle = select_lanes(active, triangle, (intl)0);
    walk->depth = depth;
    walk->active = active;
    walk->side = -1;
    walk->is_beyond = 0;
    walk->cut = NEVER;
    walk->enters = active;
    walk->tier = FIRST_TIER;
}

/* Follows the rays of INTERLEAVED blocks, from `block` on, leg by leg, and keeps their hits. */
static void walk_blocks(const Context *context, int block, MeshWalk *walks, Region *region)
{
    const Relief *relief = &context->relief;
    Layers *layers = context->layers;
    for (int leg = 0; leg < LEGS_MAX; leg++) {
        Search searches[INTERLEAVED];
        int any = 0;
        for (int k = 0; k < INTERLEAVED; k++) {
            MeshWalk *walk = &walks[k];
            Search *s = &searches[k];
            s->active = s->searches = 0;
            if (!any_lane(walk->active))
                continue;
            any = 1;
            begin_leg(relief, walk, leg == 0, &s->ray);
            begin_rays(s, walk->active & is_finite_ray(&s->ray), walk->tier);
            limit_tiles(&s->ray);
            s->track = track_of(&s->ray, relief->levels);
        }
        if (!any)
            return;
        search_relief(relief, searches, INTERLEAVED);
        for (int k = 0; k < INTERLEAVED; k++) {
            MeshWalk *walk = &walks[k];
            const Search *s = &searches[k];
            const int at = block + k;
            if (!any_lane(walk->active))
                continue;
            const Vector start = {walk->from.x + walk->reached * walk->direction.x,
                                  walk->from.y + walk->reached * walk->direction.y,
                                  walk->from.z + walk->reached * walk->direction.z};
            const intl nearer = keep_hits(context, at, s, start, scaled(walk->direction, walk->way), walk->triangle,
                                          region);
            const floatl second = walk->second + s->t * walk->by_second, third = walk->third + s->t * walk->by_third;
            layers->foot_second[at] = select_lanes(nearer, second, layers->foot_second[at]);
            layers->foot_third[at] = select_lanes(nearer, third, layers->foot_third[at]);
            walk->active = walk->active & !(s->searches & s->found);
            walk->tier = s->tier;
            end_leg(walk);
#if COUNTERS
            count_steps(context, region, at, s);
#endif
        }
    }
}

/* For INTERLEAVED blocks, walks from each pixel's nearest entry that was not searched yet. Returns whether there are
 * further entries to search. */
static int walk_layer(const Context *context, int block, Region *region)
{
    const Screen screen = context->relief.screen;
    MeshWalk walks[INTERLEAVED];
    int more = 0;
    for (int k = 0; k < INTERLEAVED; k++) {
        const floatl n = context->layers->first[block + k];
        const intl entered = context->layers->entered[block + k];
        MeshWalk *walk = &walks[k];
        walk->from = point_at(screen, BLOCK_X(region, block + k), BLOCK_Y(region, block + k), n);
        walk->direction = view_direction(screen, walk->from);
        walk->pixel_size = PIXEL_SIZE(&context->relief, n);
        walk->ends_at_border = 0;
        begin_walk(walk, entered >= 0, entered, (floatl)0.0f);
    }
    walk_blocks(context, block, walks, region);
    for (int k = 0; k < INTERLEAVED; k++)
        more |= any_lane(end_layer(context->layers, region, block + k));
    return more;
}

#if WITHIN
/* Walks from the eye. A ray within the section that contains the eye would never cross another section, so such rays
 * are turned by at most twice LEAST_SLOPE. */
static void walk_from_eye(const Context *context, Region *region)
{
    const Screen screen = context->relief.screen;
    const float *m = screen.to_world;
    const Vector eye = {m[3] / m[15], m[7] / m[15], m[11] / m[15]};
    float3 corner[3];
    UNROLLED
    for (int k = 0; k < 3; k++) {
        global const float *row = context->relief.prisms + PRISM_FLOATS * context->eye_triangle + 8 * k;
        corner[k] = vload3(0, row) - context->eye_depth * vload3(1, row);
    }
    const float3 up = normalize(cross(corner[1] - corner[0], corner[2] - corner[0]));
    for (int block = 0; block < BLOCKS; block += INTERLEAVED) {
        MeshWalk walks[INTERLEAVED];
        for (int k = 0; k < INTERLEAVED; k++) {
            MeshWalk *walk = &walks[k];
            Vector ahead = ray_direction(screen, BLOCK_X(region, block + k), BLOCK_Y(region, block + k));
            const floatl slope = DOT(ahead, up);
            const floatl turn = select_lanes(fabs(slope) < LEAST_SLOPE, LEAST_SLOPE - slope, (floatl)0.0f);
            ahead.x += turn * up.x;
            ahead.y += turn * up.y;
            ahead.z += turn * up.z;
            walk->from = eye;
            walk->direction = ahead;
            walk->pixel_size = 0.0f;
            walk->ends_at_border = -1;
            begin_walk(walk, (intl)-1, (intl)context->eye_triangle, (floatl)context->eye_depth);
        }
        walk_blocks(context, block, walks, region);
    }
}
#endif
#endif
#endif
