/* Converts images to planes (plane.h): depth, colours, and values of depth on a scale (scale.h).
 *
 * depth: (height, width) planar z; values that are not finite, <= NEAREST or >= 1 / NEAREST are invalid. placed: the
 * plane of depth, 0 where invalid. ranges: (rows, 2) least and greatest depth of each row of the plane, (inf, -inf) for
 * rows without depth. color: (height, width, 3). tint: the plane of colours, each packed into 32 bits (tint.h). values:
 * scale.h. Work-item: a row (place_depth), `strip` packets of a row. Cost: O(pixels). Determinism: pixels are
 * independent.
 */
#include "cleaning/plane.h"
#include "cleaning/scale.h"
#include "cleaning/tint.h"
#include "lib/surface.h"

kernel void place_depth(global const float *depth, global float *placed, global float *ranges, ImagePlane plane)
{
    const int row = get_global_id(0);
    if (row >= plane.height + 2 * ABOVE)
        return;
    floatl low = INFINITY, high = -INFINITY;
    for (int x = 0; x < plane.pitch; x += LANES) {
        floatl d = 0.0f;
        if (IS_PACKET_OF_IMAGE(plane, x, row)) {
            global const float *from = depth + (size_t)(row - ABOVE) * plane.width + x - ASIDE;
            d = load_first(from, ASIDE + plane.width - x, 0.0f);
        }
        const intl is_valid = (d > NEAREST) & (d < 1.0f / NEAREST);
        low = min_lanes(select_lanes(is_valid, d, low), low);
        high = max_lanes(select_lanes(is_valid, d, high), high);
        store_lanes(select_lanes(is_valid, d, (floatl)0.0f), placed + (size_t)row * plane.pitch + x);
    }
    ranges[2 * row] = least_lane(low);
    ranges[2 * row + 1] = -least_lane(-high);
}

kernel void to_scale(global const float *placed, global float *values, global const float *table, Scale scale,
                     ImagePlane plane, int strip)
{
    EACH_PACKET(plane, x, row)
    {
        const size_t at = (size_t)row * plane.pitch + x;
        store_lanes(value_of_depth(table, scale, load_lanes(placed + at)), values + at);
    }
}

#define PLACE_COLORS(scaled)                                                                                   \
    EACH_PACKET(plane, x, row)                                                                                 \
    {                                                                                                          \
        uintl packed = 0;                                                                                      \
        if (IS_PACKET_OF_IMAGE(plane, x, row)) {                                                               \
            global const scaled *from = color + 3 * (size_t)(row - ABOVE) * plane.width;                       \
            const intl at = 3 * min(x - ASIDE + lane_index, (intl)(plane.width - 1));                         \
            const floatl r = (floatl)(gather(from, at)), g = (floatl)(gather(from, at + 1));                   \
            const floatl b = (floatl)(gather(from, at + 2));                                                   \
            packed = PACKED_TINT(r, g, b, full);                                                               \
        }                                                                                                      \
        store_lanes(packed, tint + (size_t)row * plane.pitch + x);                                             \
    }

kernel void place_bytes(global const uchar *color, global uint *tint, ImagePlane plane, int strip)
{
    const float full = 255.0f;
    PLACE_COLORS(uchar)
}

kernel void place_floats(global const float *color, global uint *tint, ImagePlane plane, int strip)
{
    const float full = 1.0f;
    PLACE_COLORS(float)
}
