/* The forward warp: each sample of the source is projected to the target and drawn as a square of pixels; a pixel shows
 * the nearest sample (Schaufler & Priglinger 1999, section 3, but with a depth test instead of their drawing order).
 *
 * Launches: the first finds each pixel's greatest nearness; the second, with `by_index`, the least index of a sample
 * with this nearness; the third writes the pixels. keys, indices: (dst_height, dst_width), keys.h. Work-item: a sample;
 * in the third launch, a pixel. Cost: O(samples * size^2), where size is the squares' side in pixels.
 * Determinism: maximum and minimum do not depend on the order of work-items.
 */
#include "lib/channel.h"
#include "lib/gbuffer.h"
#include "lib/pixelspace.h"
#include "warp/keys.h"

/* The first two launches must compute the same nearness to the last bit. */
#pragma OPENCL FP_CONTRACT OFF

typedef struct {
    float nearness;
    int low_x, high_x, low_y, high_y; /* first and last pixel; none if high < low */
} Splat;

/* The pixels whose centres lie in the square around the projected sample. size: the square's side in pixels. The square
 * contains its left and upper sides, but not the others. */
Splat splat_of(global const float *nearness, PixelMap map, int x, int y, float size)
{
    const float *D = map.dst_from_src;
    const float n = nearness[y * map.src_pitch + x];
    Splat splat = {0.0f, 0, -1, 0, -1};
    const float w = MAP_ROW(D, 2, x, y, n);
    if (n <= NO_SURFACE || w <= 0.0f)
        return splat;
    const float u = MAP_ROW(D, 0, x, y, n) / w, v = MAP_ROW(D, 1, x, y, n) / w;
    splat.nearness = MAP_ROW(D, 3, x, y, n) / w;
    if (!IS_BEFORE(map.dst_perspective, splat.nearness))
        return splat;
    splat.low_x = max(0, convert_int_sat(ceil(u - 0.5f * size)));
    splat.high_x = clamp(convert_int_sat(ceil(u + 0.5f * size)), 0, map.dst_width) - 1;
    splat.low_y = max(0, convert_int_sat(ceil(v - 0.5f * size)));
    splat.high_y = clamp(convert_int_sat(ceil(v + 0.5f * size)), 0, map.dst_height) - 1;
    return splat;
}

kernel void splat_samples(global const float *nearness, global uint *keys, global uint *indices, int by_index,
                          PixelMap map, float size)
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= map.src_width || y >= map.src_height)
        return;
    const Splat splat = splat_of(nearness, map, x, y, size);
    for (int row = splat.low_y; row <= splat.high_y; row++)
        for (int column = splat.low_x; column <= splat.high_x; column++)
            enter_key(keys, indices, by_index, row * map.dst_width + column, key_of(splat.nearness), y * map.src_width + x);
}

kernel void splat_pixels(global const uint *keys, global const uint *indices, global const channel *src_color,
                         global float *depth, global channel *color, global uchar *valid, PixelMap map, int merge
                         GBUFFER_PARAMETERS NORMALS_PARAMETER(float))
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= map.dst_width || y >= map.dst_height)
        return;
    const size_t at = (size_t)y * map.dst_width + x;
    const int landed = keys[at] != 0;
    const float z = landed ? DEPTH_OF(map.dst_perspective, nearness_of_key(keys[at])) : NAN;
    if (merge && !(landed && !(z >= depth[at])))
        return; /* the picture is nearer, or nothing landed */
    depth[at] = z;
    valid[at] = landed;
    for (int c = 0; c < CHANNELS; c++)
        color[CHANNELS * at + c] = landed ? src_color[CHANNELS * (size_t)indices[at] + c] : 0;
    const GBuffer gbuffer = GBUFFER_VALUE;
    float3 normal = 0.0f;
#if GBUFFER == 2
    if (landed)
        normal = vload3(indices[at], normals);
#endif
    enter_pixel(gbuffer, at, z, normal);
}
