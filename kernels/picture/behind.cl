/* Prepares a picture for things that are not opaque. `show_background` writes the background's colour where nothing is
 * drawn, which has depth NaN. `valid_to_alpha` makes opacities: 1 where the picture is valid, else 0. depth, color,
 * valid, alpha: (height, width). Work-item: STRIP * LANES pixels of a row. Cost: O(pixels). Determinism: pixels are
 * independent.
 */
#include "lib/color.h"

kernel void show_background(global const float *depth, global channel *color, float red, float green, float blue,
                            int width, int height)
{
    const int first = get_global_id(0) * STRIP * LANES, y = get_global_id(1);
    const Color around = {red, green, blue};
    for (int x = first; y < height && x < min(first + STRIP * LANES, width); x += LANES) {
        const size_t at = (size_t)y * width + x;
        const floatl z = load_first(depth + at, width - x, 0.0f);
        if (!any_lane(z == z))
            write_color(color + CHANNELS * at, around);
        for (int lane = 0; any_lane(z == z) && any_lane(z != z) && lane < LANES; lane++)
            if (isnan(float_lane(z, lane)))
                write_pixel(color + CHANNELS * (at + lane), (float3)(red, green, blue));
    }
}

kernel void valid_to_alpha(global const uchar *valid, global float *alpha, int width, int height)
{
    const int first = get_global_id(0) * STRIP * LANES, y = get_global_id(1);
    for (int x = first; y < height && x < min(first + STRIP * LANES, width); x += LANES) {
        const size_t at = (size_t)y * width + x;
        store_first(to_floatl(load_first_bytes(valid + at, width - x, 0)), alpha + at, width - x);
    }
}
