#ifndef WARP_CORNERS_H
#define WARP_CORNERS_H
/* The samples from which depth and colour of pixels are interpolated, at the pixels' hits. */
#include "lib/color.h"
#include "lib/gbuffer.h"
#include "lib/vectors.h"
#include "warp/line_hits.h"

/* The indices y * width + x of a hit's samples, and their weights: the corners of the hit's triangle, or the nearest
 * sample with weight 1 */
typedef struct {
    intl corner, beside, below;
    floatl at_corner, at_beside, at_below;
} Corners;

/* Sample (x, y) alone. Also sets the pixels' nearness to the sample's. */
INLINED Corners one_sample(Pixels *pixels, Grid grid, PixelMap map, intl x, intl y)
{
    const float *D = map.dst_from_src;
    const floatl q = (floatl)(gather(grid.nearness, y * map.src_pitch + x));
    const floatl sample_u = to_floatl(x), sample_v = to_floatl(y);
    const floatl w = MAP_ROW(D, 2, sample_u, sample_v, q);
    pixels->n = select_lanes(IS_HIT(pixels->n) & (w > 0.0f), MAP_ROW(D, 3, sample_u, sample_v, q) / w, pixels->n);
    const intl number = y * map.src_width + x;
    const Corners one = {number, number, number, 1.0f, 0.0f, 0.0f};
    return one;
}

/* The samples of hits on triangles: the corners if `linear`, otherwise the nearest sample, whose nearness the pixels
 * then take, too. */
INLINED Corners corners_of_triangles(Pixels *pixels, Grid grid, PixelMap map, int linear)
{
    const int step_x = min(map.src_width - 1, 1), step_y = min(map.src_height - 1, 1); /* 0 in an image of one column */
    const floatl u = pixels->u, v = pixels->v;
    const floatl uc = truncated(clamp_lanes(u, (floatl)0.0f, (floatl)max(map.src_width - 2, 0)));
    const floatl vc = truncated(clamp_lanes(v, (floatl)0.0f, (floatl)max(map.src_height - 2, 0)));
    const floatl fu = clamp_lanes(u - uc, (floatl)0.0f, (floatl)1.0f);
    const floatl fv = clamp_lanes(v - vc, (floatl)0.0f, (floatl)1.0f);
    const intl cell_x = to_intl(uc), cell_y = to_intl(vc);
    if (!linear)
        return one_sample(pixels, grid, map, cell_x + select_lanes(fu >= 0.5f, (intl)step_x, (intl)0),
                          cell_y + select_lanes(fv >= 0.5f, (intl)step_y, (intl)0));
    const floatl diagonal = fu + fv - 1.0f;
    const intl upper = diagonal > 0.0f;
    const intl cell = cell_y * map.src_width + cell_x, below = cell + step_y * map.src_width;
    const Corners three = {select_lanes(upper, below + step_x, cell), cell + step_x, below,
                         fabs(diagonal), select_lanes(upper, 1.0f - fv, fu), select_lanes(upper, 1.0f - fu, fv)};
    return three;
}

#define BETWEEN_SAMPLES 2e-3f /* pixels: this close to the middle between two samples, a margin may belong to either */

/* The samples to which hits on margins belong: the nearest sample in the image; half-way between samples, the sample
 * whose nearness is closest to the hit's. */
INLINED void margins_samples(Pixels pixels, Grid grid, PixelMap map, floatl column, int row, intl *x, intl *y)
{
    const float *S = map.src_from_dst;
    const floatl last_x = map.src_width - 1, last_y = map.src_height - 1;
    *x = to_intl(clamp_lanes(floor_lanes(pixels.u + (0.5f - BETWEEN_SAMPLES)), (floatl)0.0f, last_x));
    *y = to_intl(clamp_lanes(floor_lanes(pixels.v + (0.5f - BETWEEN_SAMPLES)), (floatl)0.0f, last_y));
    const intl next_x = to_intl(clamp_lanes(floor_lanes(pixels.u + (0.5f + BETWEEN_SAMPLES)), (floatl)0.0f, last_x));
    const intl next_y = to_intl(clamp_lanes(floor_lanes(pixels.v + (0.5f + BETWEEN_SAMPLES)), (floatl)0.0f, last_y));
    if (!any_lane((next_x != *x) | (next_y != *y)))
        return;
    const floatl near = MAP_ROW(S, 3, column, row, pixels.n) / MAP_ROW(S, 2, column, row, pixels.n);
    const intl xs[2] = {*x, next_x}, ys[2] = {*y, next_y};
    floatl least = INFINITY;
    for (int i = 0; i < 4; i++) {
        const floatl q = (floatl)(gather(grid.nearness, ys[i >> 1] * map.src_pitch + xs[i & 1]));
        const intl nearer = fabs(q - near) < least;
        least = select_lanes(nearer, fabs(q - near), least);
        *x = select_lanes(nearer, xs[i & 1], *x);
        *y = select_lanes(nearer, ys[i >> 1], *y);
    }
}

/* The samples of hits on margins: the margin's sample, and its two neighbours on the hit's side if they lie on the same
 * surface */
INLINED Corners corners_of_margins(Pixels *pixels, Grid grid, PixelMap map, int linear, floatl column, int row)
{
    intl x, y;
    margins_samples(*pixels, grid, map, column, row, &x, &y);
    if (!linear)
        return one_sample(pixels, grid, map, x, y);
    const floatl du = clamp_lanes(pixels->u - to_floatl(x), (floatl)-0.5f, (floatl)0.5f);
    const floatl dv = clamp_lanes(pixels->v - to_floatl(y), (floatl)-0.5f, (floatl)0.5f);
    const intl to_x = select_lanes(du < 0.0f, (intl)-1, (intl)1), to_y = select_lanes(dv < 0.0f, (intl)-1, (intl)1);
    const intl at = y * map.src_pitch + x;
    const floatl first = (floatl)(gather(grid.nearness, at + min(to_x, (intl)0)));
    const floatl upper = (floatl)(gather(grid.nearness, at + min(to_y, (intl)0) * map.src_pitch));
    const intl has_beside = ((as_intl(first) & TORN_RIGHT) == 0) & (x + to_x >= 0) & (x + to_x < map.src_width);
    const intl has_below = ((as_intl(upper) & TORN_BELOW) == 0) & (y + to_y >= 0) & (y + to_y < map.src_height);
    Corners corners;
    corners.corner = y * map.src_width + x;
    corners.beside = select_lanes(has_beside, corners.corner + to_x, corners.corner);
    corners.below = select_lanes(has_below, corners.corner + to_y * map.src_width, corners.corner);
    corners.at_beside = select_lanes(has_beside, fabs(du), (floatl)0.0f);
    corners.at_below = select_lanes(has_below, fabs(dv), (floatl)0.0f);
    corners.at_corner = 1.0f - corners.at_beside - corners.at_below;
    return corners;
}

/* The samples of hits. Hits in the mask `on_margins` lie on margins, the others on triangles. */
INLINED Corners corners_at(Pixels *pixels, Grid grid, PixelMap map, int linear, intl on_margins, floatl column, int row)
{
    Pixels beside = *pixels;
    Corners there = corners_of_triangles(pixels, grid, map, linear);
    if (!any_lane(on_margins))
        return there;
    const Corners margins = corners_of_margins(&beside, grid, map, linear, column, row);
    pixels->n = select_lanes(on_margins, beside.n, pixels->n);
    there.corner = select_lanes(on_margins, margins.corner, there.corner);
    there.beside = select_lanes(on_margins, margins.beside, there.beside);
    there.below = select_lanes(on_margins, margins.below, there.below);
    there.at_corner = select_lanes(on_margins, margins.at_corner, there.at_corner);
    there.at_beside = select_lanes(on_margins, margins.at_beside, there.at_beside);
    there.at_below = select_lanes(on_margins, margins.at_below, there.at_below);
    return there;
}

INLINED Color interpolate_color(Corners there, PixelMap map, global const channel *src_color, int linear)
{
    const int count = max(map.src_width * map.src_height, 2); /* at least two pixels: `read_color` reads four bytes */
    const Color c0 = read_color(src_color, there.corner, count);
    if (!linear)
        return c0;
    const Color c1 = read_color(src_color, there.beside, count);
    Color c;
    c.r = there.at_corner * c0.r + there.at_beside * c1.r;
    c.g = there.at_corner * c0.g + there.at_beside * c1.g;
    c.b = there.at_corner * c0.b + there.at_beside * c1.b;
    if (any_lane(there.at_below != 0.0f)) { /* otherwise all hits lie exactly on rows of samples */
        const Color c2 = read_color(src_color, there.below, count);
        c.r += there.at_below * c2.r;
        c.g += there.at_below * c2.g;
        c.b += there.at_below * c2.b;
    }
    return c;
}

/* Writes the G-buffer's entries of a row's pixels x in the mask `written`. depth: the row's; first: the index of the
 * row's first pixel */
INLINED void enter_pixels(GBuffer gbuffer, global const float *normals, global const float *depth, size_t first,
                          Corners there, intl written, intl x)
{
#if GBUFFER
    Color normal = {0.0f, 0.0f, 0.0f};
#if GBUFFER == 2
    const Vector a = vector_at(normals, there.corner), b = vector_at(normals, there.beside);
    const Vector c = vector_at(normals, there.below);
    normal.r = there.at_corner * a.x + there.at_beside * b.x + there.at_below * c.x;
    normal.g = there.at_corner * a.y + there.at_beside * b.y + there.at_below * c.y;
    normal.b = there.at_corner * a.z + there.at_beside * b.z + there.at_below * c.z;
#endif
    for (uint left = lane_bits(written); left; left = WITHOUT_LOWEST(left)) {
        const int at = int_lane(x, LOWEST(left));
        enter_pixel(gbuffer, first + at, depth[at], color_lane(normal, LOWEST(left)));
    }
#endif
}
#endif
