/* Draws a guessed surface into the holes of a picture.
 *
 * The ray of each hole's pixel is traced through the surface, between its nearest and its farthest sample. The pixels
 * are first gathered into full packets, as a trace of a packet costs the same for one pixel as for all.
 *
 * surface: the guessed view's surface (lib/surface.h), connected. depth, color, valid: (dst_height, dst_width) of the
 * picture; pixels that are SEEN stay, others become GUESSED. nearest, farthest: the surface's range of nearness in the
 * target. in_place: 1 if a pixel's place in the view does not depend on depth. Work-item: STRIP * LANES pixels of a row.
 * Cost: O(pixels + holes * columns between the projections of `nearest` and `farthest`). Determinism: each pixel depends
 * on the inputs alone.
 */
#include "lib/valid.h"
#include "warp/corners.h"

#define FIRST_WINDOW 16.0f /* pixels of the guessed view */

/* The hits of the rays of pixels x of row y on a connected surface. Guesses are background, so each ray is searched from
 * its far end, in windows that grow. */
OUTLINED floatl trace_holes(Grid grid, PixelMap map, floatl x, int y, intl wanted, float nearest, float farthest)
{
    const Rays rays = rays_of(map, x, (floatl)y);
    const Epipolar epipolar = epipolar_of(rays, grid);
    const floatl near_end = distance_of(rays, epipolar, (floatl)nearest) - 1.0f;
    Windows windows;
    windows.to = min_lanes(distance_of(rays, epipolar, (floatl)farthest) + 1.0f, epipolar.lines.length);
    windows.next[0] = INFINITY;
    windows.radius = 0.0f;
    floatl n = EMPTY;
    uint cells = 0;
    for (float length = FIRST_WINDOW; any_lane(wanted & (windows.to > near_end) & (windows.to > 0.0f)); length *= 2.0f) {
        windows.from = max_lanes(windows.to - length, near_end);
        n = select_lanes(wanted, trace(grid, rays, epipolar, windows, SHOWS_BOTH, wanted, &cells), n);
        wanted = wanted & !IS_HIT(n);
        windows.to = windows.from;
    }
    return n;
}

/* Writes the pixels x where `hit` is set, unless they show a nearer guess. Returns the written pixels. */
INLINED intl write_hits(Pixels pixels, Color c, PixelMap map, intl hit, intl x, global float *depth,
                           global channel *color, global uchar *valid)
{
    const floatl z = DEPTH_OF(map.dst_perspective, pixels.n);
    intl written = 0;
    for (uint left = lane_bits(hit); left; left = WITHOUT_LOWEST(left)) {
        const int lane = LOWEST(left), at = int_lane(x, lane);
        if (float_lane(z, lane) >= depth[at])
            continue;
        depth[at] = float_lane(z, lane);
        valid[at] = GUESSED;
        write_pixel(color + CHANNELS * at, rounded_channel(color_lane(c, lane)));
        set_int_lane(written, lane, -1);
    }
    return written;
}

kernel void draw_under(global const float *surface, global const channel *src_color, global float *depth,
                       global channel *color, global uchar *valid, PixelMap map, float nearest, float farthest,
                       int in_place, int low_x, int high_x, int low_y,
                       int high_y GBUFFER_PARAMETERS NORMALS_PARAMETER(float))
{
    const int strip_x = low_x + get_global_id(0) * (STRIP * LANES), y = low_y + get_global_id(1);
    if (y >= high_y || strip_x >= high_x)
        return;
    const size_t row = (size_t)y * map.dst_width;
    int holes[(STRIP + 1) * LANES], count = 0;
    for (int x = strip_x; x < min(strip_x + STRIP * LANES, high_x); x += LANES) {
        const intl is_hole = load_first_bytes(valid + row + x, high_x - x, SEEN) != SEEN;
        for (uint left = lane_bits(is_hole); left; left = WITHOUT_LOWEST(left))
            holes[count++] = x + LOWEST(left);
    }
    const Grid grid = GRID_OF(surface, map.src_width, map.src_height, map.src_pitch, NO_CUT);
    for (int first = 0; first < count; first += LANES) {
        const intl wanted = first + lane_index < count;
        const intl at = select_lanes(wanted, (intl)load_lanes(holes + first), (intl)strip_x);
        const floatl x = to_floatl(at);
        Pixels pixels;
        pixels.n = in_place ? (floatl)nearest : trace_holes(grid, map, x, y, wanted, nearest, farthest);
        find_place(&pixels, map, x, y);
        if (in_place) {
            pixels.smooth = wanted;
            intersect_at_hits(&pixels, grid, map, x, y, HITS_WITHOUT_PARALLAX, SHOWS_BOTH);
        }
        const intl hit = wanted & IS_HIT(pixels.n) & IS_BEFORE(map.dst_perspective, pixels.n);
        if (!any_lane(hit))
            continue;
        const Corners there = corners_of_triangles(&pixels, grid, map, 1);
        const intl written = write_hits(pixels, interpolate_color(there, map, src_color, 1), map, hit, at, depth + row,
                                           color + CHANNELS * row, valid + row);
        const GBuffer gbuffer = GBUFFER_VALUE;
        enter_pixels(gbuffer, NORMALS_ARGUMENT(float), depth + row, row, there, written, at);
    }
}
