#ifndef RELIEF_WALKS_H
#define RELIEF_WALKS_H
/* Walks of a region's pixels: from their entries, or from an eye within the relief. */
#include "relief/entries.h"

#if WALKS
#include "relief/walk.h"

/* Begins the walk of a block's rays from their first entries. */
void begin_walk(const Context *context, const Region *region, int block, MeshWalk *walk)
{
    const Relief *relief = &context->relief;
    const floatl x = BLOCK_X(region, block), y = BLOCK_Y(region, block), n = context->layers->first[block];
    const intl entered = context->layers->entered[block], enters = entered >= 0;
    walk->triangle = select_lanes(enters, entered, (intl)0);
    const OnTriangle pixel = on_triangle(relief->faces, relief->projected, walk->triangle, x, y);
    walk->from = point_at(relief->screen, x, y, n);
    walk->direction = view_direction(relief->screen, walk->from);
    walk->reached = walk->place.depth = 0.0f;
    walk->place.second = pixel.weight[1];
    walk->place.third = pixel.weight[2];
    walk->active = enters;
    walk->is_beyond = walk->ends_at_border = 0;
    walk->pixel_size = PIXEL_SIZE(relief, n);
    walk->tier = FIRST_TIER;
}

/* Follows the rays of INTERLEAVED blocks, leg by leg, and keeps what they meet. */
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
            s->searches = s->active = walk->active & is_finite_ray(&s->ray);
            mask_inactive(&s->ray, s->active);
            s->tier = walk->tier;
            set_end_of_leg(&s->ray, walk, -(leg == LEGS_MAX - 1));
            s->track = track_of(&s->ray, relief->levels);
#if COUNTERS
            s->taken = 0;
#endif
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
            const PrismPlace foot = place_after(walk, s->t);
            layers->foot_second[at] = select_lanes(nearer, foot.second, layers->foot_second[at]);
            layers->foot_third[at] = select_lanes(nearer, foot.third, layers->foot_third[at]);
            walk->active = walk->active & !(s->searches & s->found);
            walk->tier = s->tier;
            end_leg(walk, relief->scale);
#if COUNTERS
            count_steps(context, region, at, s);
#endif
        }
    }
}

/* Walks from the first entries of INTERLEAVED blocks. Returns whether there are further ones. */
static int walk_layer(const Context *context, int block, Region *region)
{
    MeshWalk walks[INTERLEAVED];
    int more = 0;
    for (int k = 0; k < INTERLEAVED; k++)
        begin_walk(context, region, block + k, &walks[k]);
    walk_blocks(context, block, walks, region);
    for (int k = 0; k < INTERLEAVED; k++)
        more |= any_lane(end_layer(context->layers, region, block + k));
    return more;
}

#if WITHIN
/* Walks from the eye. */
static void walk_from_eye(const Context *context, Region *region)
{
    const float *m = context->relief.screen.to_world;
    const Vector eye = {m[3] / m[15], m[7] / m[15], m[11] / m[15]};
    for (int block = 0; block < BLOCKS; block += INTERLEAVED) {
        MeshWalk walks[INTERLEAVED];
        for (int k = 0; k < INTERLEAVED; k++) {
            const PrismPlace place = {context->eye_second, context->eye_third, context->eye_depth};
            MeshWalk *walk = &walks[k];
            walk->from = eye;
            walk->direction = ray_direction(context->relief.screen, BLOCK_X(region, block + k),
                                            BLOCK_Y(region, block + k));
            walk->reached = 0.0f;
            walk->triangle = context->eye_triangle;
            walk->place = place;
            walk->active = walk->ends_at_border = -1;
            walk->is_beyond = 0;
            walk->pixel_size = 0.0f;
            walk->tier = FIRST_TIER;
        }
        walk_blocks(context, block, walks, region);
    }
}
#endif
#endif
#endif
