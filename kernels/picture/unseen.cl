/* What some depth images have not seen, marked in a picture.
 *
 * A point was seen where one of the four samples around it has a depth that is not nearer: of a surface that slopes, one
 * of them is farther. So images know their silhouettes to a sample. Normals come from the picture's depths
 * (picture/facing.h): an image on the other side of the surface has seen its back.
 *
 * before: (height, width) the depths before the thing was drawn, with `blank` 0; other pixels stay. depth, color: the
 * picture. maps: the images' depths, one after the other, 0 where they have none. views, places: a record of each
 * image, VIEW_FLOATS and VIEW_INTS of them. part: only what lies in it is marked. fronts, backs: which sides count as
 * seen. red, green, blue, and the share of them: the mark. Work-item: LANES pixels of a row. Cost: O(pixels * images). Determinism: every pixel on its own.
 */
#include "lib/color.h"
#include "lib/taps.h"
#include "picture/facing.h"

#define VIEW_FLOATS 28 /* 16: pixel space over points; 4: planar depth; 4: its centre, or (w = 0) where it comes from; a sample at depth 1 */
#define VIEW_INTS 3 /* width, height, first of `maps` */
#define SAMPLE_TOLERANCE 1.0f /* samples, for surfaces that are no planes */
#define EDGE_ON 0.05f /* of the cosine: a surface that is seen along itself has either side */

typedef struct {
    float low[3], high[3]; /* the corners of a box, as points are */
} Bounds;

/* Does an image see a point? Its samples' depths alone count, not from which side. */
INLINED intl sees(global const float *maps, global const float *view, global const int *place, Vector p)
{
    const int width = place[0], height = place[1], start = place[2];
    float m[20];
    for (int i = 0; i < 20; i++)
        m[i] = view[i];
    const floatl z = POINT_ROW(m, 4, p), w = POINT_ROW(m, 2, p), inverse = 1.0f / w;
    const floatl u = POINT_ROW(m, 0, p) * inverse, v = POINT_ROW(m, 1, p) * inverse;
    const intl inside = (w > 0.0f) & (u >= -0.5f) & (u <= width - 0.5f) & (v >= -0.5f) & (v <= height - 0.5f);
    if (!any_lane(inside))
        return inside;
    const Taps taps = clamped_taps(width, height, pick(inside, u, (floatl)0.0f), pick(inside, v, (floatl)0.0f));
    const floatl near = z - SAMPLE_TOLERANCE * view[24] * w;
    intl seen = 0;
    for (int k = 0; k < 4; k++) {
        const floatl there = (floatl)(gather(maps, taps.at[k] + start));
        seen = seen | ((there > 0.0f) & (there >= near));
    }
    return inside & seen;
}

kernel void mark_unseen(global const float *before, global const float *depth, global channel *color, Screen screen,
                        int blank, global const float *maps, global const float *views, global const int *places,
                        int count, Bounds bounds, int fronts, int backs, float red, float green, float blue, float share)
{
    const int first = get_global_id(0) * LANES, row = get_global_id(1);
    if (first >= screen.width || row >= screen.height)
        return;
    const Drawn shown = drawn_at(before, depth, screen, blank, first, row);
    if (!any_lane(shown.drawn))
        return;
    const Vector p = shown.p, facing = facing_at(depth, screen, shown.x, shown.y, 1, shown.n, p);
    intl unseen = shown.drawn & (p.x >= bounds.low[0]) & (p.y >= bounds.low[1]) & (p.z >= bounds.low[2]) & (p.x <= bounds.high[0]) &
                  (p.y <= bounds.high[1]) & (p.z <= bounds.high[2]);
    for (int i = 0; i < count && any_lane(unseen); i++) {
        global const float *view = views + VIEW_FLOATS * i;
        global const int *place = places + VIEW_INTS * i;
        const Vector to = {view[20] - view[23] * p.x, view[21] - view[23] * p.y, view[22] - view[23] * p.z};
        const floatl side = DOT(facing, to) / sqrt(max_lanes(DOT(to, to), (floatl)1e-37f));
        const intl may_see = (fronts ? (intl)(side > -EDGE_ON) : (intl)0) | (backs ? (intl)(side < EDGE_ON) : (intl)0);
        unseen = unseen & !(may_see & sees(maps, view, place, p));
    }
    const float3 mark = (float3)(red, green, blue);
    for (int lane = 0; lane < LANES; lane++) {
        if (!int_lane(unseen, lane))
            continue;
        const size_t pixel = 3 * ((size_t)row * screen.width + first + lane);
        for (int k = 0; k < 3; k++)
            color[pixel + k] = to_channel((1.0f - share) * color[pixel + k] + share * (k == 0 ? mark.x : k == 1 ? mark.y : mark.z));
    }
}
