/* Antialiasing: averages the `side` x `side` samples of each pixel.
 *
 * The colour is the mean of all samples, and empty samples show the background. The depth is
 * that of the front surface, from the samples' mean nearness (which is affine on a plane). If the samples of a pixel
 * show several surfaces, only the front ones count: their nearness is closer to the greatest than to the least nearness
 * in the pixel. Samples of filled holes have a colour and a depth, but are not valid: their depths only count in pixels
 * without valid samples. sample_depth, sample_color, sample_valid: (side * height, side * width); in empty samples,
 * depth is NaN, and valid is 0. depth, color: (height, width). valid: (height, width) 1 if any sample is
 * valid. alpha: (height, width) fraction of valid samples or, with ALPHA, the mean of the samples' opacities
 * sample_alpha. With GUESSES: sample_guesses: depths of guessed surface; a sample shows it if this depth equals
 * sample_depth. guesses: the depth of each pixel with such a sample, else NaN. Work-item: STRIP * LANES pixels of a
 * row. Cost: O(samples). Determinism: pixels are independent.
 */
#include "lib/color.h"
#include "lib/surface.h"

#ifndef GUESSES
#define GUESSES 0 /* 1: depths of guessed surface are written, too */
#endif

#ifndef ALPHA
#define ALPHA 0 /* 1: samples have opacities */
#endif

/* Nearness of samples; NaN in empty samples and, for lanes in the mask `seen_alone`, in filled holes. */
INLINED floatl nearness_of_samples(global const float *sample_depth, global const uchar *sample_valid, intl at,
                                   int perspective, intl seen_alone)
{
    const floatl z = (floatl)(gather(sample_depth, at));
    const floatl n = DEPTH_OF(perspective, z);
    if (!any_lane(seen_alone))
        return n;
    const intl seen = to_intl((WIDE(uchar))(gather(sample_valid, at))) != 0;
    return select_lanes(seen_alone & !seen, (floatl)NAN, n);
}

/* For the samples that count: their least nearness, greatest nearness, sum of nearness, and number */
typedef struct {
    floatl low, high, sum;
    intl count;
} Depths;

/* These values of the samples whose nearness is at least `least` */
INLINED Depths depths_of(global const float *sample_depth, global const uchar *sample_valid, intl first, int side,
                         int width, int perspective, intl seen_alone, floatl least)
{
    Depths depths = {INFINITY, -INFINITY, 0.0f, 0};
    for (int j = 0; j < side; j++)
        for (int i = 0; i < side; i++) {
            const intl at = first + (j * side * width + i);
            const floatl n = nearness_of_samples(sample_depth, sample_valid, at, perspective, seen_alone);
            const intl counts = n >= least; /* false for NaN */
            depths.low = select_lanes(counts, min_lanes(n, depths.low), depths.low);
            depths.high = select_lanes(counts, max_lanes(n, depths.high), depths.high);
            depths.sum += select_lanes(counts, n, (floatl)0.0f);
            depths.count += select_lanes(counts, (intl)1, (intl)0);
        }
    return depths;
}

void average_packet(global const float *sample_depth, global const channel *sample_color,
                    global const uchar *sample_valid, int side, int width, int height, int perspective,
                    global float *depth, global channel *color, global uchar *valid, global float *alpha,
                    int x0, int y)
{
    const intl first = side * min(x0 + lane_index, (intl)(width - 1)) + y * side * side * width;
    Color sum = {0.0f, 0.0f, 0.0f};
    const floatl all = -INFINITY;
    intl seen = 0, seen_alone = 0;
    Depths depths = depths_of(sample_depth, sample_valid, first, side, width, perspective, seen_alone, all);
    const intl shown = depths.count;
    if (ALPHA || any_lane(shown != 0))
        for (int j = 0; j < side; j++)
            for (int i = 0; i < side; i++) {
                const intl at = first + (j * side * width + i);
                seen += select_lanes(to_intl((WIDE(uchar))(gather(sample_valid, at))) != 0, (intl)1, (intl)0);
                add_color(&sum, 1.0f, read_color(sample_color, at, side * width * side * height));
            }
    else /* as most packets of many pictures: all samples show the background */
        sum = color_times(read_color(sample_color, first, side * width * side * height), side * side);
    seen_alone = (seen != 0) & (seen != shown);
    if (any_lane(seen_alone))
        depths = depths_of(sample_depth, sample_valid, first, side, width, perspective, seen_alone, all);
    const intl several = depths.high - depths.low > ONE_SURFACE * fabs(depths.high);
    if (any_lane(several)) {
        const floatl least = select_lanes(several, 0.5f * (depths.low + depths.high), depths.low);
        depths = depths_of(sample_depth, sample_valid, first, side, width, perspective, seen_alone, least);
    }
    const floatl mean = depths.sum / to_floatl(depths.count);
    const floatl z = select_lanes(shown == 0, (floatl)NAN, perspective ? 1.0f / mean : -mean);
    const floatl share = to_floatl(seen) / (float)(side * side);
    const float each = 1.0f / (side * side);
    const Color c = {sum.r * each, sum.g * each, sum.b * each};
    const size_t out = (size_t)y * width + x0;
    store_first(z, depth + out, width - x0);
    store_first(share, alpha + out, width - x0);
    store_first_bytes(select_lanes(seen != 0, (intl)1, (intl)0), valid + out, width - x0);
    write_first(color + CHANNELS * out, c, width - x0);
}

#if GUESSES
/* For each pixel of a packet, writes its depth if one of its samples shows guessed surface, else NaN. */
INLINED void average_guesses(global const float *sample_depth, global const float *sample_guesses, int side, int width,
                             global const float *depth, global float *guesses, int x0, int y)
{
    for (int x = x0; x < min(x0 + LANES, width); x++) {
        const size_t first = (size_t)side * x + (size_t)y * side * side * width, out = (size_t)y * width + x;
        int guessed = 0;
        for (int j = 0; j < side; j++)
            for (int i = 0; i < side; i++) {
                const size_t at = first + (size_t)j * side * width + i;
                guessed |= sample_guesses[at] == sample_depth[at];
            }
        guesses[out] = guessed ? depth[out] : NAN;
    }
}
#endif

#if ALPHA
/* Writes the mean opacity of each pixel of a packet. */
INLINED void average_alpha(global const float *sample_alpha, int side, int width, global float *alpha, int x0, int y)
{
    const intl first = side * min(x0 + lane_index, (intl)(width - 1)) + y * side * side * width;
    floatl sum = 0.0f;
    for (int j = 0; j < side; j++)
        for (int i = 0; i < side; i++)
            sum += (floatl)(gather(sample_alpha, first + (j * side * width + i)));
    store_first(sum / (float)(side * side), alpha + (size_t)y * width + x0, width - x0);
}
#endif

kernel void average(global const float *sample_depth, global const channel *sample_color,
                    global const uchar *sample_valid, int side, int width, int height, int perspective,
                    global float *depth, global channel *color, global uchar *valid, global float *alpha
#if ALPHA
                    ,
                    global const float *sample_alpha
#endif
#if GUESSES
                    ,
                    global const float *sample_guesses, global float *guesses
#endif
)
{
    const int from = get_global_id(0) * (STRIP * LANES), y = get_global_id(1);
    if (y >= height)
        return;
    for (int x0 = from; x0 < min(from + STRIP * LANES, width); x0 += LANES) {
        average_packet(sample_depth, sample_color, sample_valid, side, width, height, perspective, depth, color, valid,
                       alpha, x0, y);
#if ALPHA
        average_alpha(sample_alpha, side, width, alpha, x0, y);
#endif
#if GUESSES
        average_guesses(sample_depth, sample_guesses, side, width, depth, guesses, x0, y);
#endif
    }
}
