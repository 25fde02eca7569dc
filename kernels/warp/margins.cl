/* The margins of a surface, drawn: each pixel's nearest hit on any of them.
 *
 * margins: (MARGIN_PLANES, pitch) of `count` quarters, picture/margins.cl. margin_hits: (dst_height, dst_pitch) hits of
 * the pixels' own rays, EMPTY before; a side that is not shown hides what lies behind it (hits.h).
 * Work-item: STRIP * LANES quarters. Cost: O(margins + their pixels). Determinism: a maximum does not depend on the
 * order of work-items.
 * Not in the paper, whose samples are all connected.
 */
#include "lib/lanes.h"
#include "lib/margins.h"
#include "lib/surface.h"
#include "warp/hits.h"

#define MARGIN_WIDTH_MAX 256 /* target pixels: a margin is drawn no wider, as one right before the target would be */
#define HAIR 1e-3f /* pixels by which margins and triangles overlap, for rounding */

/* Quarters of samples' pixels, one a lane */
typedef struct {
    floatl x, y, n, slope_x, slope_y; /* the samples, and the planes' slopes */
    floatl to_x, to_y;                /* 1 or -1: where the quarter lies */
    intl lower, upper;                /* its parts that are margins */
} Quarters;

/* The pixels [left, right] x [top, bottom] around the quarters; `drawn` lanes have any. */
typedef struct {
    floatl left, right, top, bottom;
    intl drawn;
} PixelBox;

INLINED Quarters quarters_at(global const float *margins, int pitch)
{
    const intl bits = as_intl(load_lanes(margins + MARGIN_BITS * pitch));
    Quarters quarters;
    quarters.x = load_lanes(margins + MARGIN_X * pitch);
    quarters.y = load_lanes(margins + MARGIN_Y * pitch);
    quarters.n = load_lanes(margins + MARGIN_NEARNESS * pitch);
    quarters.slope_x = load_lanes(margins + MARGIN_SLOPE_X * pitch);
    quarters.slope_y = load_lanes(margins + MARGIN_SLOPE_Y * pitch);
    quarters.to_x = select_lanes((bits & TO_RIGHT) != 0, (floatl)1.0f, (floatl)-1.0f);
    quarters.to_y = select_lanes((bits & TO_BELOW) != 0, (floatl)1.0f, (floatl)-1.0f);
    quarters.lower = (bits & IN_LOWER) != 0;
    quarters.upper = (bits & IN_UPPER) != 0;
    return quarters;
}

INLINED PixelBox box_of(PixelMap map, Quarters at, intl wanted)
{
    const float *D = map.dst_from_src;
    const floatl u = MAP_ROW(D, 0, at.x, at.y, at.n), v = MAP_ROW(D, 1, at.x, at.y, at.n);
    const floatl w = MAP_ROW(D, 2, at.x, at.y, at.n);
    /* Pixel space changes evenly over a plane. */
    const floatl half_x = 0.5f * at.to_x, half_y = 0.5f * at.to_y;
    const floatl u_x = half_x * (D[0] + at.slope_x * D[3]), u_y = half_y * (D[1] + at.slope_y * D[3]);
    const floatl v_x = half_x * (D[4] + at.slope_x * D[7]), v_y = half_y * (D[5] + at.slope_y * D[7]);
    const floatl w_x = half_x * (D[8] + at.slope_x * D[11]), w_y = half_y * (D[9] + at.slope_y * D[11]);
    floatl low_u = INFINITY, low_v = INFINITY, high_u = -INFINITY, high_v = -INFINITY;
    PixelBox box;
    box.drawn = wanted;
    UNROLLED
    for (int i = 0; i < 4; i++) {
        const float j = i & 1, k = i >> 1;
        const floatl corner_w = w + j * w_x + k * w_y, inverse = 1.0f / corner_w;
        const floatl corner_u = (u + j * u_x + k * u_y) * inverse, corner_v = (v + j * v_x + k * v_y) * inverse;
        box.drawn = box.drawn & (corner_w > 0.0f);
        low_u = min_lanes(corner_u, low_u);
        high_u = max_lanes(corner_u, high_u);
        low_v = min_lanes(corner_v, low_v);
        high_v = max_lanes(corner_v, high_v);
    }
    const float last_x = map.dst_width - 1, last_y = map.dst_height - 1;
    box.left = ceil_lanes(clamp_lanes(low_u - HAIR, (floatl)0.0f, (floatl)(last_x + 1.0f)));
    box.top = ceil_lanes(clamp_lanes(low_v - HAIR, (floatl)0.0f, (floatl)(last_y + 1.0f)));
    box.right = floor_lanes(clamp_lanes(high_u + HAIR, (floatl)-1.0f, (floatl)last_x));
    box.right = min_lanes(box.right, box.left + MARGIN_WIDTH_MAX);
    box.bottom = floor_lanes(clamp_lanes(high_v + HAIR, (floatl)-1.0f, (floatl)last_y));
    box.bottom = min_lanes(box.bottom, box.top + MARGIN_WIDTH_MAX);
    box.drawn = box.drawn & (box.left <= box.right) & (box.top <= box.bottom);
    return box;
}

OUTLINED void draw_quarters(PixelMap map, Quarters at, intl wanted, int sides, global float *margin_hits)
{
    const float *S = map.src_from_dst;
    const PixelBox box = box_of(map, at, wanted);
    const floatl per_unit =
        S[15] - at.n * S[11] - at.slope_x * (S[3] - at.x * S[11]) - at.slope_y * (S[7] - at.y * S[11]);
    const intl drawn = box.drawn & (per_unit != 0.0f);
    const intl front_hides = sides & SHOWS_FRONT ? 0 : 1, back_hides = sides & SHOWS_BACK ? 0 : 1;
    const intl hides = select_lanes(per_unit > 0.0f, front_hides, back_hides);
    for (floatl row = box.top; any_lane(drawn & (row <= box.bottom)); row += 1.0f)
        for (floatl column = box.left; any_lane(drawn & (row <= box.bottom) & (column <= box.right)); column += 1.0f) {
            const floatl u = PIXEL_ROW(S, 0, column, row), v = PIXEL_ROW(S, 1, column, row);
            const floatl w = PIXEL_ROW(S, 2, column, row), q = PIXEL_ROW(S, 3, column, row);
            const floatl at_start = q - at.n * w - at.slope_x * (u - at.x * w) - at.slope_y * (v - at.y * w);
            const floatl met = -at_start / per_unit, w_met = w + met * S[11], inverse = 1.0f / w_met;
            const floatl du = (u + met * S[3]) * inverse - at.x, dv = (v + met * S[7]) * inverse - at.y;
            const intl in_quarter =
                (fabs(at.to_x * du - 0.25f) <= 0.25f + HAIR) & (fabs(at.to_y * dv - 0.25f) <= 0.25f + HAIR);
            const intl in_part = (at.lower & (du + dv <= HAIR)) | (at.upper & (du + dv >= -HAIR));
            const intl before = (w_met > 0.0f) & IS_BEFORE(map.dst_perspective, met);
            const intl hit = drawn & (row <= box.bottom) & (column <= box.right) & in_quarter & in_part & before;
            const intl pixel = to_intl(row) * map.dst_pitch + to_intl(column), bits = as_intl(PACKED_HIT(met, hides));
            for (uint left = lane_bits(hit); left; left = WITHOUT_LOWEST(left)) {
                const int lane = LOWEST(left);
                put_nearest(margin_hits + int_lane(pixel, lane), int_lane(bits, lane));
            }
        }
}

kernel void draw_margins(global const float *margins, global float *margin_hits, PixelMap map, int sides, int count,
                         int pitch)
{
    const int first = get_global_id(0) * STRIP * LANES;
    for (int i = first; i < min(first + STRIP * LANES, count); i += LANES)
        draw_quarters(map, quarters_at(margins + i, pitch), i + lane_index < count, sides, margin_hits);
}
