/* Draws a thing into a picture, and marks the parts of its surface that none of the given depth images has seen.
 *
 * An image saw a point if one of the four samples around the point's place in the image is not nearer than the point:
 * on a sloping surface, one of them is farther. So the silhouettes of things in front are accurate to one sample.
 * Normals come from the thing's depths (picture/facing.h): an image taken from behind the surface has seen its back.
 *
 * own_depth, own_color: (height, width) the thing drawn alone. depth, color, valid: (height, width) the picture; blank:
 * 1 if the picture is still empty. maps: the images' depths, one image after the other, 0 where invalid. views, places:
 * for each image, VIEW_FLOATS and VIEW_INTS numbers. bounds: a box: only points inside are marked. fronts: 1 if images
 * that face the surface's front count; backs: the same for its back. red, green, blue: the mark's colour; share: its
 * weight, 0 to 1. Work-item: LANES pixels of a row. Cost: O(pixels * images). Determinism: pixels are independent.
 */
#include "lib/color.h"
#include "lib/taps.h"
#include "picture/facing.h"

/* 16 numbers of the matrix from the world to pixel space; 4 of the row for planar depth; 4 of the camera's centre (w =
 * 1) or the direction to the camera (w = 0); and the side of a sample in scene units, at depth 1 if perspective */
#define VIEW_FLOATS 28
#define VIEW_INTS 3 /* width, height, start in `maps` */
#define SAMPLE_TOLERANCE 1.0f /* sides of a sample: depths may be nearer than points by this, as surfaces are curved */
#define EDGE_ON 0.05f /* cosine: if a surface is more oblique, an image may have seen either of its sides */

typedef struct {
    float low[3], high[3]; /* corners of a box, relative to the points' origin */
} Bounds;

/* Tells from the depths of an image's samples whether the image sees a point, from either side of the surface. */
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
    const Taps taps = clamped_taps(width, height, select_lanes(inside, u, (floatl)0.0f),
                                   select_lanes(inside, v, (floatl)0.0f));
    const floatl near = z - SAMPLE_TOLERANCE * view[24] * w;
    intl seen = 0;
    for (int k = 0; k < 4; k++) {
        const floatl there = (floatl)(gather(maps, taps.at[k] + start));
        seen = seen | ((there > 0.0f) & (there >= near));
    }
    return inside & seen;
}

kernel void draw_marked(global const float *own_depth, global const channel *own_color, global float *depth,
                        global channel *color, global uchar *valid, Screen screen, int blank, global const float *maps,
                        global const float *views, global const int *places, int count, Bounds bounds, int fronts,
                        int backs, float red, float green, float blue, float share)
{
    const int first = get_global_id(0) * LANES, row = get_global_id(1);
    if (first >= screen.width || row >= screen.height)
        return;
    const intl x = min(first + lane_index, (intl)(screen.width - 1)), pixel = row * screen.width + x;
    const floatl z = (floatl)(gather(own_depth, pixel)), there = blank ? (floatl)NAN : (floatl)(gather(depth, pixel));
    const intl drawn = (first + lane_index < screen.width) & (z == z) & !(z >= there);
    if (!blank && !any_lane(drawn))
        return;
    const Shown shown = {own_depth, 0, 0, 0};
    const floatl n = select_lanes(drawn, DEPTH_OF(screen.perspective, z), (floatl)(screen.perspective ? 1.0f : -1.0f));
    const Vector p = point_at(screen, to_floatl(x), (floatl)row, n),
                 facing = facing_at(shown, screen, first, row, 1, n, p);
    intl unseen = drawn & (p.x >= bounds.low[0]) & (p.y >= bounds.low[1]) & (p.z >= bounds.low[2]) &
                  (p.x <= bounds.high[0]) & (p.y <= bounds.high[1]) & (p.z <= bounds.high[2]);
    for (int i = 0; i < count && any_lane(unseen); i++) {
        global const float *view = views + VIEW_FLOATS * i;
        global const int *place = places + VIEW_INTS * i;
        const Vector to = {view[20] - view[23] * p.x, view[21] - view[23] * p.y, view[22] - view[23] * p.z};
        const floatl side = DOT(facing, to) / sqrt(max_lanes(DOT(to, to), (floatl)1e-37f));
        const intl may_see = (fronts ? (intl)(side > -EDGE_ON) : (intl)0) | (backs ? (intl)(side < EDGE_ON) : (intl)0);
        unseen = unseen & !(may_see & sees(maps, view, place, p));
    }
    const float3 mark = (float3)(red, green, blue);
    for (int lane = 0; lane < min(LANES, screen.width - first); lane++) {
        const size_t at = (size_t)row * screen.width + first + lane;
        const int is_drawn = int_lane(drawn, lane) != 0;
        if (!is_drawn && !blank)
            continue;
        const float3 own = read_pixel(own_color + 3 * at), mixed = (1.0f - share) * own + share * mark;
        depth[at] = is_drawn ? float_lane(z, lane) : NAN;
        valid[at] = is_drawn;
        write_pixel(color + 3 * at, !is_drawn ? (float3)(0.0f) : int_lane(unseen, lane) ? mixed : own);
    }
}
