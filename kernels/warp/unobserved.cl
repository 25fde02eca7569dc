/* Fills holes with the colours of the source's samples of unknown depth. A hole's filled depth gives its place in the
 * source.
 *
 * Empty space (infinite depth, or depth of `far` and more) is known, so its colours fill nothing (empty.cl). A black
 * sample without depth is left out: images of registered cameras, and frames with holes, are black where a
 * colour is missing.
 *
 * color, depth, valid: (dst_height, dst_width); the holes' colours are replaced. nearness: (src_height, src_pitch).
 * src_color: (src_height, src_width). Work-item: `strip` times LANES pixels of a row. Cost: O(pixels). Determinism:
 * pixels are independent.
 */
#include "lib/channel.h"
#include "lib/lanes.h"
#include "lib/pixelspace.h"

float4 color_at_sample(global const channel *color, size_t sample)
{
    return (float4)(color[3 * sample], color[3 * sample + 1], color[3 * sample + 2], 0.0f);
}

/* The colour at (u, v), interpolated between the four samples around */
float4 color_between(global const channel *color, int width, int height, float u, float v)
{
    const float in_u = clamp(u, 0.0f, width - 1.0f), in_v = clamp(v, 0.0f, height - 1.0f);
    const int left = in_u, upper = in_v, right = min(left + 1, width - 1), lower = min(upper + 1, height - 1);
    const float4 above = mix(color_at_sample(color, upper * width + left),
                             color_at_sample(color, upper * width + right), in_u - left);
    const float4 below = mix(color_at_sample(color, lower * width + left),
                             color_at_sample(color, lower * width + right), in_u - left);
    return mix(above, below, in_v - upper);
}

/* Replaces the colours of holes, among LANES pixels of row y from x on. */
INLINED void show_pixels(global channel *color, global const float *depth, global const uchar *valid,
                         global const float *nearness, global const channel *src_color, const PixelMap *map, int x,
                         int y)
{
    const float *m = map->src_from_dst;
    const size_t pixel = (size_t)y * map->dst_width + x;
    const intl holes = load_first_bytes(valid + pixel, map->dst_width - x, 1) == 0;
    if (!any_lane(holes))
        return;
    const floatl z = load_first(depth + pixel, map->dst_width - x, 1.0f);
    const floatl n = DEPTH_OF(map->dst_perspective, z), px = to_floatl(x + lane_index);
    const floatl w = MAP_ROW(m, 2, px, y, n);
    const floatl u = MAP_ROW(m, 0, px, y, n) / w, v = MAP_ROW(m, 1, px, y, n) / w;
    const intl inside = holes & (w > 0.0f) & (u >= -0.5f) & (v >= -0.5f) & (u < map->src_width - 0.5f) &
                        (v < map->src_height - 0.5f);
    const intl nearest_u = to_intl(select_lanes(inside, u + 0.5f, (floatl)0.0f)),
               nearest_v = to_intl(select_lanes(inside, v + 0.5f, (floatl)0.0f));
    const intl sample = nearest_v * map->src_pitch + nearest_u;
    for (uint left = lane_bits(inside); left; left = WITHOUT_LOWEST(left)) {
        const int i = LOWEST(left);
        if (nearness[int_lane(sample, i)] != NO_SURFACE)
            continue;
        const float4 nearest = color_at_sample(src_color,
                                               int_lane(nearest_v, i) * map->src_width + int_lane(nearest_u, i));
        if (nearest.x == 0.0f && nearest.y == 0.0f && nearest.z == 0.0f)
            continue;
        const float4 found =
            color_between(src_color, map->src_width, map->src_height, float_lane(u, i), float_lane(v, i));
        vstore3(to_channels(found).xyz, pixel + i, color);
    }
}

kernel void show_unobserved(global channel *color, global const float *depth, global const uchar *valid,
                            global const float *nearness, global const channel *src_color, PixelMap map, int strip)
{
    const int first = get_global_id(0) * strip * LANES, y = get_global_id(1);
    if (first >= map.dst_width || y >= map.dst_height)
        return;
    for (int x = first; x < min(first + strip * LANES, map.dst_width); x += LANES)
        show_pixels(color, depth, valid, nearness, src_color, &map, x, y);
}
