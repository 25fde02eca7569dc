/* Anti-aliasing: each pixel from its samples, which lie on a regular grid of `side` x `side` within it.
 *
 * Colour is the mean of all samples, of which those that show nothing are black: colour times coverage. Depth is of
 * what is in front: the mean nearness (affine on a plane) of all samples if the pixel shows one surface, else of those
 * that lie closer to the nearest one than to the farthest. sample_depth, sample_color, sample_valid: (side * height,
 * side * width), depth NaN, colour and valid 0 where nothing shows. depth, color: (height, width); valid: whether any
 * sample is; alpha: the share of the samples that show something. Work-item: STRIP times LANES pixels of a row. Cost:
 * O(samples). Determinism: every pixel on its own.
 */
#include "lib/color.h"
#include "lib/surface.h"

#ifndef STRIP
#define STRIP 1 /* packets of LANES pixels that a work-item averages */
#endif

/* Nearness of samples, as good a measure of depth in orthographic pictures; NaN: nothing */
INLINED floatl nearness_of_samples(global const float *sample_depth, intl at, int perspective)
{
    const floatl z = (floatl)(gather(sample_depth, at));
    return DEPTH_OF(perspective, z);
}

INLINED void average_packet(global const float *sample_depth, global const channel *sample_color,
                            global const uchar *sample_valid, int side, int width, int height, int perspective,
                            global float *depth, global channel *color, global uchar *valid, global float *alpha,
                            int x0, int y)
{
    const intl first = side * min(x0 + lane_index, (intl)(width - 1)) + y * side * side * width;
    Color sum = {0.0f, 0.0f, 0.0f};
    floatl low = INFINITY, high = -INFINITY, nearness = 0.0f;
    intl count = 0, any = 0;
    for (int j = 0; j < side; j++)
        for (int i = 0; i < side; i++) {
            const floatl n = nearness_of_samples(sample_depth, first + (j * side * width + i), perspective);
            const intl shows = n == n;
            low = min_lanes(n, low);
            high = max_lanes(n, high);
            nearness += select_lanes(shows, n, (floatl)0.0f);
            count += select_lanes(shows, (intl)1, (intl)0);
        }
    if (any_lane(count != 0)) /* most packets of many pictures are empty */
        for (int j = 0; j < side; j++)
            for (int i = 0; i < side; i++) {
                const intl at = first + (j * side * width + i);
                any |= to_intl((WIDE(uchar))(gather(sample_valid, at)));
                add_color(&sum, 1.0f, read_color(sample_color, at, side * width * side * height));
            }
    intl front = count;
    const intl several = high - low > ONE_SURFACE * fabs(high);
    if (any_lane(several)) {
        const floatl least = select_lanes(several, 0.5f * (low + high), low);
        nearness = 0.0f;
        front = 0;
        for (int j = 0; j < side; j++)
            for (int i = 0; i < side; i++) {
                const floatl n = nearness_of_samples(sample_depth, first + (j * side * width + i), perspective);
                const intl in_front = n >= least; /* not of NaN */
                nearness += select_lanes(in_front, n, (floatl)0.0f);
                front += select_lanes(in_front, (intl)1, (intl)0);
            }
    }
    const floatl mean = nearness / to_floatl(front);
    const floatl z = select_lanes(count == 0, (floatl)NAN, perspective ? 1.0f / mean : -mean);
    const floatl share = to_floatl(count) / (float)(side * side);
    const float each = 1.0f / (side * side);
    const Color c = {sum.r * each, sum.g * each, sum.b * each};
    const size_t out = (size_t)y * width + x0;
    if (x0 + LANES <= width) {
        store_lanes(z, depth + out);
        store_lanes(share, alpha + out);
        store_bytes(to_ucharl(any), valid + out);
        write_color(color + CHANNELS * out, c);
        return;
    }
    for (int lane = 0; lane < width - x0; lane++) {
        depth[out + lane] = float_lane(z, lane);
        alpha[out + lane] = float_lane(share, lane);
        valid[out + lane] = int_lane(any, lane);
        write_pixel(color + CHANNELS * (out + lane), rounded_channel(color_lane(c, lane)));
    }
}

kernel void average(global const float *sample_depth, global const channel *sample_color,
                    global const uchar *sample_valid, int side, int width, int height, int perspective,
                    global float *depth, global channel *color, global uchar *valid, global float *alpha)
{
    const int from = get_global_id(0) * (STRIP * LANES), y = get_global_id(1);
    if (y >= height)
        return;
    for (int x0 = from; x0 < min(from + STRIP * LANES, width); x0 += LANES)
        average_packet(sample_depth, sample_color, sample_valid, side, width, height, perspective, depth, color, valid,
                       alpha, x0, y);
}
