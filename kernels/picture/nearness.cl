/* Converts depth to nearness: 1/z (perspective) or -z (orthographic). Later kernels read nearness alone.
 *
 * to_bridged_nearness also fills single missing samples inside a surface, through which the background would show: they
 * are interpolated between their left and right neighbours, or between the neighbours above and below, if these two lie
 * on one surface.
 *
 * depth: (src_height, src_width) planar z; NaN or <= NEAREST becomes NO_SURFACE, >= far or infinite becomes FREE_RAY,
 * which is less than NO_SURFACE. nearness: (src_height, src_pitch); the pitch is not a power of two, as this would slow
 * down reads along columns. ranges: (pieces, 2) least and greatest nearness of each piece, which limit the part of a
 * picture that the view reaches; (inf, -inf) without samples. Work-item: a piece of a row: `piece` samples, a multiple
 * of LANES, or the whole row. Cost: O(samples). Determinism: each sample depends on depths alone.
 */
#include "lib/lanes.h"
#include "lib/surface.h"

/* Nearness of samples x to x + LANES - 1 of a row; NO_SURFACE outside of the image */
INLINED floatl nearness_from(global const float *row, int x, int width, int perspective, float far)
{
    floatl d = 0.0f;
    if (x >= 0 && x + LANES <= width)
        d = load_lanes(row + x);
    else
        for (int lane = max(-x, 0); lane < min(LANES, width - x); lane++)
            set_float_lane(d, lane, row[x + lane]);
    const floatl none = select_lanes(d >= far, (floatl)FREE_RAY, (floatl)NO_SURFACE);
    return select_lanes((d > NEAREST) & (d < far), DEPTH_OF(perspective, d), none);
}

/* Converts the piece of row y that starts at sample `first`. */
OUTLINED void convert_piece(global const float *depth, global float *nearness, global float *ranges, int first, int y,
                            int src_width, int src_height, int src_pitch, int src_perspective, float far, int piece,
                            int bridged, Cut cut)
{
    if (first >= src_width || y >= src_height)
        return;
    global const float *row = depth + (size_t)y * src_width;
    floatl low = INFINITY, high = -INFINITY;
    for (int x = first; x < min(first + piece, src_width); x += LANES) {
        floatl n = nearness_from(row, x, src_width, src_perspective, far);
        const intl solid = n > NO_SURFACE;
        low = min_lanes(select_lanes(solid, n, low), low);
        high = max_lanes(select_lanes(solid, n, high), high);
        if (bridged && any_lane(!solid)) {
            const floatl none = NO_SURFACE;
            const floatl left = nearness_from(row, x - 1, src_width, src_perspective, far);
            const floatl right = nearness_from(row, x + 1, src_width, src_perspective, far);
            const floatl above = y > 0 ? nearness_from(row - src_width, x, src_width, src_perspective, far) : none;
            const floatl under = y + 1 < src_height ? nearness_from(row + src_width, x, src_width, src_perspective, far)
                                                    : none;
            const intl across = !IS_OPEN(cut, max_lanes(left, right), min_lanes(left, right));
            const intl down = !IS_OPEN(cut, max_lanes(above, under), min_lanes(above, under));
            n = select_lanes((!solid) & (across | down), 0.5f * select_lanes(across, left + right, above + under), n);
        }
        store_lanes(n, nearness + (size_t)y * src_pitch + x); /* rows have room for whole packets */
    }
    vstore2((float2)(least_lane(low), -least_lane(-high)), y * ((src_width + piece - 1) / piece) + first / piece, ranges);
}

kernel void to_nearness(global const float *depth, global float *nearness, global float *ranges, int src_width,
                        int src_height, int src_pitch, int src_perspective, float far, int piece)
{
    const Cut none = {0.0f, 0.0f, 0.0f};
    convert_piece(depth, nearness, ranges, get_global_id(0) * piece, get_global_id(1), src_width, src_height, src_pitch,
                  src_perspective, far, piece, 0, none);
}

kernel void to_bridged_nearness(global const float *depth, global float *nearness, global float *ranges, int src_width,
                                int src_height, int src_pitch, int src_perspective, float far, int piece, Cut cut)
{
    convert_piece(depth, nearness, ranges, get_global_id(0) * piece, get_global_id(1), src_width, src_height, src_pitch,
                  src_perspective, far, piece, 1, cut);
}
