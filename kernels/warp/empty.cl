/* Finds holes behind which a view has seen empty space (infinite depth, or depth of `far` and more). They are no holes
 * to fill.
 *
 * The ray of a hole's pixel is followed to its far end: to infinity, or to the border where it leaves the view's image.
 * If the view's sample there is empty, so is the background of the pixel. Such pixels get the value 255 and a very
 * great depth; valid pixels have the value 0. Push and pull (fill.cl) then spread the values into the other holes, so
 * that a hole between an object and empty space is empty, too. clear_empty empties the pixels whose value is at least
 * HALF_EMPTY.
 *
 * valid, depth, color: (dst_height, dst_width) of the picture. nearness: (src_height, src_pitch), nearness.cl.
 * empty_valid, empty_depth, empty_color: the same shapes as the picture's; the colour has three bytes a pixel.
 * Work-item: `strip` times LANES pixels of a row. Cost: O(pixels). Determinism: each pixel is written by
 * one work-item; all views write the same values.
 */
#include "lib/channel.h"
#include "lib/lanes.h"
#include "lib/pixelspace.h"

#define FAR_AWAY 1e9f   /* the greatest length that cameras allow */
#define HALF_EMPTY 128

/* Narrows the interval (low, high) of nearness to where base + slope * nearness is positive. */
float2 narrowed(float2 range, float base, float slope)
{
    const float zero = -base / slope;
    if (slope > 0.0f)
        range.x = fmax(range.x, zero);
    else if (slope < 0.0f)
        range.y = fmin(range.y, zero);
    else if (base <= 0.0f)
        range.y = -INFINITY;
    return range;
}

/* Tells whether the view saw empty space at the far end of pixel (x, y)'s ray. */
int ends_in_empty_space(global const float *nearness, const PixelMap *map, int x, int y)
{
    const float *m = map->src_from_dst;
    const float u = PIXEL_ROW(m, 0, x, y), v = PIXEL_ROW(m, 1, x, y), w = PIXEL_ROW(m, 2, x, y);
    const float right = map->src_width - 0.5f, lower = map->src_height - 0.5f;
    float2 range = map->dst_perspective ? (float2)(0.0f, INFINITY) : (float2)(-FAR_AWAY, 0.0f);
    range = narrowed(range, w, m[11]);
    range = narrowed(range, u + 0.5f * w, m[3] + 0.5f * m[11]);
    range = narrowed(range, v + 0.5f * w, m[7] + 0.5f * m[11]);
    range = narrowed(range, right * w - u, right * m[11] - m[3]);
    range = narrowed(range, lower * w - v, lower * m[11] - m[7]);
    const float n = range.x, end = w + n * m[11];
    if (!(range.x < range.y) || !(end > 0.0f))
        return 0;
    const int column = clamp((u + n * m[3]) / end + 0.5f, 0.0f, map->src_width - 1.0f);
    const int row = clamp((v + n * m[7]) / end + 0.5f, 0.0f, map->src_height - 1.0f);
    return nearness[row * map->src_pitch + column] < NO_SURFACE;
}

kernel void mark_empty(global const float *nearness, PixelMap map, int strip, global uchar *empty_color,
                       global float *empty_depth, global uchar *empty_valid)
{
    const int first = get_global_id(0) * strip * LANES, y = get_global_id(1);
    if (first >= map.dst_width || y >= map.dst_height)
        return;
    for (int x = first; x < min(first + strip * LANES, map.dst_width); x++) {
        const size_t pixel = (size_t)y * map.dst_width + x;
        if (empty_valid[pixel] || !ends_in_empty_space(nearness, &map, x, y))
            continue;
        vstore3((uchar3)(255), pixel, empty_color);
        empty_depth[pixel] = FAR_AWAY;
        empty_valid[pixel] = 1;
    }
}

kernel void clear_empty(global channel *color, global float *depth, global const uchar *valid,
                        global const uchar *empty_color, int width, int height, int strip)
{
    const int first = get_global_id(0) * strip * LANES, y = get_global_id(1);
    if (first >= width || y >= height)
        return;
    for (int x = first; x < min(first + strip * LANES, width); x++) {
        const size_t pixel = (size_t)y * width + x;
        if (valid[pixel] || empty_color[3 * pixel] < HALF_EMPTY)
            continue;
        depth[pixel] = NAN;
#if CHANNELS == 3
        vstore3(to_channels((float4)(0.0f)).xyz, pixel, color);
#endif
    }
}
