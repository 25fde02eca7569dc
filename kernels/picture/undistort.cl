/* Resamples a lens's image to the image of a pinhole camera at the same position (undistortion).
 *
 * If the three samples around a pixel lie on one surface (lib/surface.h), nearness and colour are interpolated between
 * them; nearness is affine over their triangle. At depth edges and in holes, both are taken from the nearest sample, so
 * edges stay sharp. If `linear` is 0, colours are taken from the nearest sample everywhere.
 * places: (2, height, pitch) u and v in the lens's image, NaN outside of it. lens_depth, color: (lens_height,
 * lens_width) the lens's image, with planar z; a depth that is not finite, <= NEAREST or >= far is invalid.
 * undistorted_depth, undistorted_color: (height, width); depth is NaN, and colour black, outside of the lens's image.
 * Work-item: LANES pixels of a row. Cost: O(pixels). Determinism: pixels are independent.
 */
#include "lib/color.h"
#include "lib/surface.h"
#include "lib/taps.h"

kernel void undistort(global const float *places, global const float *lens_depth, global const channel *color,
                      int lens_width, int lens_height, float far, Cut cut, int linear, int width, int height, int pitch,
                      global float *undistorted_depth, global channel *undistorted_color)
{
    const int x0 = get_global_id(0) * LANES, y = get_global_id(1);
    if (x0 >= width || y >= height)
        return;
    global const float *place = places + (size_t)y * pitch + x0;
    const floatl u = load_lanes(place), v = load_lanes(place + (size_t)height * pitch);
    const intl inside = (u == u) & (v == v);
    const Taps taps = clamped_taps(lens_width, lens_height, select_lanes(inside, u, (floatl)0.0f),
                                   select_lanes(inside, v, (floatl)0.0f));

    /* The triangle of samples around the position, and the weights of its corners */
    const intl lower = taps.fx + taps.fy > 1.0f;
    const intl corners[3] = {select_lanes(lower, taps.at[3], taps.at[0]), taps.at[1], taps.at[2]};
    floatl weights[3];
    weights[1] = select_lanes(lower, 1.0f - taps.fy, taps.fx);
    weights[2] = select_lanes(lower, 1.0f - taps.fx, taps.fy);
    weights[0] = 1.0f - weights[1] - weights[2];
    floatl high = NO_SURFACE, low = INFINITY, between = 0.0f;
    for (int i = 0; i < 3; i++) {
        const floatl z = (floatl)(gather(lens_depth, corners[i]));
        const floatl q = select_lanes((z > NEAREST) & (z < far), 1.0f / z, (floatl)NO_SURFACE);
        high = max_lanes(q, high);
        low = min_lanes(q, low);
        between += weights[i] * q;
    }
    const intl whole = inside & !IS_OPEN(cut, high, low);
    const intl nearest = NEAREST_TAP(taps, taps.at);
    const floatl z_nearest = (floatl)(gather(lens_depth, nearest));
    const floatl z = select_lanes(inside, select_lanes(whole, 1.0f / between, z_nearest), (floatl)NAN);

    const int count = lens_width * lens_height;
    const intl mixes = whole & (intl)(linear ? -1 : 0);
    const Color none = {0.0f, 0.0f, 0.0f};
    Color c = select_color(inside, read_color(color, nearest, count), none);
    if (any_lane(mixes)) {
        Color mixed = none;
        for (int i = 0; i < 3; i++)
            add_color(&mixed, weights[i], read_color(color, corners[i], count));
        c = select_color(mixes, mixed, c);
    }
    const size_t at = (size_t)y * width + x0;
    store_first(z, undistorted_depth + at, width - x0);
    write_first(undistorted_color + CHANNELS * at, c, width - x0);
}
