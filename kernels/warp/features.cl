/* Carries features over to a picture: the values of up to 1,024 channels that a depth image has at each sample.
 *
 * A pixel's features are the weighted mean of the samples from which its colour is interpolated (corners.h). Its place
 * in the source, which resolve.cl writes, determines these samples: the corners of a closed triangle there, or else
 * those of a margin. So features are linear in those of the samples, and `scatter_features` is the transposed map: it
 * gives a loss's gradient for the samples from its gradient for the pixels.
 *
 * source, source_view, depth: the picture's, (dst_height, dst_width). corners: (CORNER_PLANES, dst_height, dst_pitch)
 * the indices of three samples (-1 for pixels that show nothing, or another view than `view`), and their weights.
 * features: (samples, channels). pixel_features: (dst_height, dst_width, channels), whose pixels without corners become
 * 0 if this view is the `first`. ranges: (dst_height, 2) the least and the greatest index of a row's samples. gradient:
 * as pixel_features, float32. sums: (samples, channels) float32.
 * pinhole: 0 if the picture has a lens, for which `map` does not hold.
 * Work-item: STRIP * LANES pixels of a row (find_corners); a row (find_ranges); `each` values of a row
 * (gather_features); `each` channels of one of `bands` parts of the samples (scatter_features). Cost: O(values);
 * scatter_features also reads the corners of all rows that contain a sample of the part.
 * Determinism: a pixel depends on the inputs alone; pixels are added to a sample in their order.
 */
#include "warp/corners.h"

#ifndef FEATURE_BYTES
#define FEATURE_BYTES 4 /* bytes per value: 1 (uchar), 2 (half) or 4 (float) */
#endif
#if FEATURE_BYTES == 1
#define feature uchar
#define FEATURE_AT(from) ((float)*(from))
#define FEATURES_AT(from) to_floatl(load_bytes(from))
#define PUT_FEATURE(value, to) (*(to) = (value) + 0.5f)
#define PUT_FEATURES(values, to) store_bytes(to_ucharl((values) + 0.5f), to)
#elif FEATURE_BYTES == 2
#define feature ushort
#define FEATURE_AT(from) vload_half(0, (global const half *)(from))
#define FEATURES_AT load_halves
#define PUT_FEATURE(value, to) vstore_half(value, 0, (global half *)(to))
#define PUT_FEATURES store_halves
#else
#define feature float
#define FEATURE_AT(from) (*(from))
#define FEATURES_AT(from) load_lanes(from)
#define PUT_FEATURE(value, to) (*(to) = (value))
#define PUT_FEATURES(values, to) store_lanes(values, to)
#endif

#if FEATURE_BYTES == 2 && LANES == 16
/* An access at any address: PoCL's vload_half16 and vstore_half16 need aligned ones. */
typedef struct __attribute__((packed)) {
    ushort16 bits;
} UnalignedHalves;

INLINED float16 load_halves(global const ushort *from)
{
    const ushort16 bits = ((global const UnalignedHalves *)from)->bits;
    return vload_half16(0, (const half *)&bits);
}

INLINED void store_halves(float16 values, global ushort *to)
{
    ushort16 bits;
    vstore_half16(values, 0, (half *)&bits);
    ((global UnalignedHalves *)to)->bits = bits;
}
#endif

#define CORNER_PLANES 6
#define NEAR_DIAGONAL 1e-3f /* pixels: closer to a cell's diagonal, rounding may move a hit to the other triangle */

/* The mask of hits at (u, v) that lie on margins: outside of closed triangles */
INLINED intl on_margins_at(Grid grid, floatl u, floatl v)
{
    const floatl column = truncated(clamp_lanes(u + 1.0f, (floatl)0.0f, (floatl)grid.width)) - 1.0f;
    const floatl row = truncated(clamp_lanes(v + 1.0f, (floatl)0.0f, (floatl)grid.height)) - 1.0f;
    const intl at = to_intl(row) * grid.pitch + to_intl(column);
    const floatl q00 = (floatl)(gather(grid.nearness, at)), q10 = (floatl)(gather(grid.nearness, at + 1));
    const floatl q01 = (floatl)(gather(grid.nearness, at + grid.pitch)), diagonal = u - column + (v - row) - 1.0f;
    const intl in_lower = (diagonal <= NEAR_DIAGONAL) & !IS_LOWER_OPEN(q00);
    const intl in_upper = (diagonal >= -NEAR_DIAGONAL) & !IS_UPPER_OPEN(q00, q10, q01);
    return !(in_lower | in_upper);
}

kernel void find_corners(global const float *surface, global const float *source, global const int *source_view,
                         global const float *depth, global float *corners, PixelMap map, int linear, int pinhole,
                         int view)
{
    const int y = get_global_id(1), strip_x = get_global_id(0) * (STRIP * LANES);
    if (y >= map.dst_height)
        return;
    const Grid grid = GRID_OF(surface, map.src_width, map.src_height, map.src_pitch, NO_CUT);
    const size_t plane = (size_t)map.dst_height * map.dst_pitch, first = (size_t)y * map.dst_width;
    for (int x0 = strip_x; x0 < min(strip_x + STRIP * LANES, map.dst_width); x0 += LANES) {
        const intl x = x0 + lane_index, own = min(x, (intl)(map.dst_width - 1));
        const floatl u = (floatl)(gather(source + 2 * first, 2 * own)), v = (floatl)(gather(source + 2 * first, 2 * own + 1));
        const intl shown = ((intl)(gather(source_view + first, own)) == view) & (u == u) & (x < map.dst_width);
        Pixels pixels;
        pixels.u = select_lanes(shown, u, (floatl)0.0f);
        pixels.v = select_lanes(shown, v, (floatl)0.0f);
        pixels.n = pinhole ? DEPTH_OF(map.dst_perspective, (floatl)(gather(depth + first, own))) : (floatl)NAN;
        const intl on_margins = on_margins_at(grid, pixels.u, pixels.v);
        const Corners there = corners_at(&pixels, grid, map, linear, on_margins, to_floatl(x), y);
        global float *out = corners + (size_t)y * map.dst_pitch + x0;
        store_lanes(as_floatl(select_lanes(shown, there.corner, (intl)-1)), out);
        store_lanes(as_floatl(there.beside), out + plane);
        store_lanes(as_floatl(there.below), out + 2 * plane);
        store_lanes(there.at_corner, out + 3 * plane);
        store_lanes(there.at_beside, out + 4 * plane);
        store_lanes(there.at_below, out + 5 * plane);
    }
}

/* One pixel's corners. Corners of weight 0 are left out, since their features may be infinite. */
typedef struct {
    int samples[3]; /* the first is -1 if there are none */
    float weights[3];
} PixelCorners;

INLINED PixelCorners pixel_corners(global const float *corners, size_t plane)
{
    PixelCorners made;
    UNROLLED
    for (int i = 0; i < 3; i++) {
        made.samples[i] = as_int(corners[i * plane]);
        made.weights[i] = corners[(3 + i) * plane];
    }
    return made;
}

/* Writes `count` values of a pixel. features: at the first value's channel */
INLINED void gather_pixel(PixelCorners there, global const feature *features, int channels, int count, global feature *to)
{
    int i = 0;
#if LANES == 16
    for (; i + LANES <= count; i += LANES) {
        float16 values = 0.0f;
        UNROLLED
        for (int k = 0; k < 3; k++)
            if (there.weights[k] != 0.0f)
                values += there.weights[k] * FEATURES_AT(features + (size_t)there.samples[k] * channels + i);
        PUT_FEATURES(values, to + i);
    }
#endif
    for (; i < count; i++) {
        float value = 0.0f;
        UNROLLED
        for (int k = 0; k < 3; k++)
            if (there.weights[k] != 0.0f)
                value += there.weights[k] * FEATURE_AT(features + (size_t)there.samples[k] * channels + i);
        PUT_FEATURE(value, to + i);
    }
}

kernel void gather_features(global const float *corners, global const feature *features, global feature *pixel_features,
                            int channels, int width, int height, int pitch, int each, int first)
{
    const int y = get_global_id(1);
    const long start = (long)get_global_id(0) * each, end = min(start + each, (long)width * channels);
    if (y >= height)
        return;
    const size_t plane = (size_t)height * pitch;
    for (long at = start; at < end;) {
        const int x = at / channels, begin = at % channels, count = min((long)channels - begin, end - at);
        const PixelCorners there = pixel_corners(corners + (size_t)y * pitch + x, plane);
        global feature *to = pixel_features + ((size_t)y * width + x) * channels + begin;
        if (there.samples[0] >= 0)
            gather_pixel(there, features + begin, channels, count, to);
        else if (first)
            for (int i = 0; i < count; i++)
                to[i] = 0;
        at += count;
    }
}

/* Adds `count` values, times a weight. */
INLINED void add_values(global const float *values, float weight, int count, global float *sums)
{
    int i = 0;
#if LANES == 16
    for (; i + LANES <= count; i += LANES)
        store_lanes(load_lanes(sums + i) + weight * load_lanes(values + i), sums + i);
#endif
    for (; i < count; i++)
        sums[i] += weight * values[i];
}

kernel void find_ranges(global const float *corners, global int *ranges, int width, int height, int pitch)
{
    const int y = get_global_id(0);
    if (y >= height)
        return;
    int low = INT_MAX, high = -1;
    for (int i = 0; i < 3; i++) {
        global const float *row = corners + ((size_t)i * height + y) * pitch;
        for (int x = 0; x < width; x++)
            if (as_int(corners[(size_t)y * pitch + x]) >= 0) {
                low = min(low, as_int(row[x]));
                high = max(high, as_int(row[x]));
            }
    }
    ranges[2 * y] = low;
    ranges[2 * y + 1] = high;
}

kernel void scatter_features(global const float *corners, global const int *ranges, global const float *gradient,
                             global float *sums, int channels, int samples, int width, int height, int pitch, int each,
                             int bands)
{
    const int begin = get_global_id(0) * each, band = get_global_id(1), count = min(each, channels - begin);
    if (begin >= channels || band >= bands)
        return;
    const int low = (long)samples * band / bands, high = (long)samples * (band + 1) / bands;
    const size_t plane = (size_t)height * pitch;
    for (size_t i = low; i < high; i++)
        for (int c = 0; c < count; c++)
            sums[i * channels + begin + c] = 0.0f;
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width && ranges[2 * y] < high && ranges[2 * y + 1] >= low; x++) {
            const PixelCorners there = pixel_corners(corners + (size_t)y * pitch + x, plane);
            for (int i = 0; i < 3 && there.samples[0] >= 0; i++)
                if (there.weights[i] != 0.0f && there.samples[i] >= low && there.samples[i] < high)
                    add_values(gradient + ((size_t)y * width + x) * channels + begin, there.weights[i], count,
                               sums + (size_t)there.samples[i] * channels + begin);
        }
}
