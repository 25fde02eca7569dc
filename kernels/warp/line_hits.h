#ifndef WARP_LINE_HITS_H
#define WARP_LINE_HITS_H
/* Hits of the pixels' own rays, where the lines' hits at a pixel and at its neighbours lie on one smooth surface. Other
 * pixels are marked, to be traced.
 */
#include "warp/hits.h"
#include "warp/trace.h"

#define HITS_OF_LINES 0         /* the hits belong to lines that pass near the pixels */
#define HITS_OF_PIXELS 1        /* the hits belong to the pixels' own rays */
#define HITS_WITHOUT_PARALLAX 2 /* there are no hits: a pixel's place in the source does not depend on depth */

#define IS_ZOOMED (neighbour_offset > 1) /* samples are larger than pixels: hits at this offset are read, too */
#define AT_EPIPOLE 1e-2f /* target pixels: lines have no hits this close to the epipole */
#define TOLERANCE 1e-3f  /* pixels of the source by which a hit may lie outside its triangle by rounding */

/* LANES pixels of a row */
typedef struct {
    floatl n;    /* nearness of the epipolar line's hit, later of the hit on the pixel's own ray */
    floatl u, v; /* where the hit lies in the source */
    intl smooth; /* mask: the pixel's hit and its neighbours' hits lie on one smooth surface */
    intl traced; /* mask: trace the pixel's own ray, unless it meets the triangle at the line's hit */
} Pixels;

/* Finds where the hits of pixels x of row y lie in the source. Returns 1 / w at these places. */
INLINED floatl find_place(Pixels *pixels, PixelMap map, floatl x, int y)
{
    const float *S = map.src_from_dst;
    const floatl n = pixels->n, inverse = 1.0f / MAP_ROW(S, 2, x, y, n);
    pixels->u = MAP_ROW(S, 0, x, y, n) * inverse;
    pixels->v = MAP_ROW(S, 1, x, y, n) * inverse;
    return inverse;
}

/* Reads the hits of LANES pixels, and judges by their neighbours' hits if the surface is smooth there. */
INLINED Pixels read_hits(global const float *hits, PixelMap map, int x0, int y, intl inside, int hit_kind,
                         int neighbour_offset, float density, float typical, float rough)
{
    const float *S = map.src_from_dst, *D = map.dst_from_src;
    global const float *here = hits + (size_t)y * map.dst_pitch + x0;
    const floatl x = to_floatl(x0 + lane_index);
    floatl n = load_lanes(here);
    const intl seen_here = inside & IS_VISIBLE_HIT(n);
    Pixels pixels;
    pixels.smooth = pixels.traced = 0;
    floatl curved = 0.0f;
    intl any_seen = 0;
    if (hit_kind == HITS_OF_LINES) {
        const floatl above = y > 0 ? load_lanes(here - map.dst_pitch) : n;
        const floatl under = y + 1 < map.dst_height ? load_lanes(here + map.dst_pitch) : n;
        floatl left = x0 > 0 ? load_lanes(here - 1) : shifted_lanes(n), right = load_lanes(here + 1);
        right = select_lanes(x0 + lane_index + 1 < map.dst_width, right, n);
        const intl above_met = IS_HIT(above), under_met = IS_HIT(under), left_met = IS_HIT(left),
                   right_met = IS_HIT(right);
        any_seen = seen_here | IS_VISIBLE_HIT(above) | IS_VISIBLE_HIT(under) | IS_VISIBLE_HIT(left) |
                   IS_VISIBLE_HIT(right);
        intl any_met = IS_HIT(n) | above_met | under_met | left_met | right_met;
        if (IS_ZOOMED) {
            any_met = any_met |
                      (y >= neighbour_offset ? IS_HIT(load_lanes(here - neighbour_offset * map.dst_pitch)) : 0);
            any_met = any_met | (y + neighbour_offset < map.dst_height
                                     ? IS_HIT(load_lanes(here + neighbour_offset * map.dst_pitch))
                                     : 0);
            any_met = any_met | (x0 >= neighbour_offset ? IS_HIT(load_lanes(here - neighbour_offset)) : 0) |
                      IS_HIT(load_lanes(here + neighbour_offset));
        }
        curved = max_lanes(fabs(left + right - 2.0f * n), fabs(above + under - 2.0f * n));
        pixels.smooth = inside & IS_HIT(n) & above_met & under_met & left_met & right_met;
        /* If a pixel's line has no hit, the pixel's own ray may meet the same surface as a neighbour's line. */
        pixels.traced = inside & any_met;
    }
    intl in_place = hit_kind == HITS_WITHOUT_PARALLAX ? inside : (intl)0;
    /* Hits from patches.cl do not belong to a line. */
    const intl none = !IS_HIT(n) | (hit_kind == HITS_OF_LINES ? (as_intl(n) & OWN_RAY) != 0 : (intl)0);
    if (fabs(y * D[11] - D[7]) <= AT_EPIPOLE * fabs(D[11])) /* at the epipole, there is no line and no parallax */
        in_place = in_place | ((fabs(x * D[11] - D[3]) <= AT_EPIPOLE * fabs(D[11])) & inside & none);
    n = select_lanes(in_place, (floatl)typical, n);
    pixels.n = hit_kind == HITS_OF_PIXELS ? select_lanes(inside | in_place, n, (floatl)EMPTY) : n;
    const floatl inverse = find_place(&pixels, map, x, y);
    if (hit_kind == HITS_OF_LINES) {
        const floatl moves_by = (fabs(S[3] - pixels.u * S[11]) + fabs(S[7] - pixels.v * S[11])) * fabs(inverse);
        pixels.smooth = pixels.smooth & (curved * moves_by < rough * density);
        /* If all these hits lie on one smooth surface, and on a side that is not shown, the pixel sees nothing. */
        pixels.traced = pixels.traced & (any_seen | !pixels.smooth);
        pixels.smooth = pixels.smooth & seen_here;
    }
    pixels.smooth = pixels.smooth | in_place;
    pixels.traced = pixels.traced & !in_place;
    return pixels;
}

/* Intersects the pixels' own rays with the planes of the triangles at their lines' hits. A pixel whose ray meets the
 * plane within the triangle gets this hit; the hits of other pixels become EMPTY. */
INLINED void intersect_at_hits(Pixels *pixels, Grid grid, PixelMap map, floatl x, int y, int hit_kind, int sides)
{
    const float *S = map.src_from_dst;
    const Rays rays = rays_of(map, x, (floatl)y);
    const floatl u = pixels->u, v = pixels->v;
    const float last_u = grid.width - 1, last_v = grid.height - 1;
    floatl uc = truncated(clamp_lanes(u + 1.0f, (floatl)0.0f, (floatl)(last_u + 1.0f))) - 1.0f;
    floatl vc = truncated(clamp_lanes(v + 1.0f, (floatl)0.0f, (floatl)(last_v + 1.0f))) - 1.0f;
    intl on_column = 0, on_row = 0;
    if (hit_kind == HITS_WITHOUT_PARALLAX) { /* a ray through a sample or an edge sees nothing else */
        const floatl column = floor_lanes(u + 0.5f), row = floor_lanes(v + 0.5f);
        on_column = (fabs(u - column) < ON_SAMPLES) & (column >= 0.0f) & (column <= last_u);
        on_row = (fabs(v - row) < ON_SAMPLES) & (row >= 0.0f) & (row <= last_v);
        uc = select_lanes(on_column, column, uc);
        vc = select_lanes(on_row, row, vc);
    }
    const intl upper = (u - uc) + (v - vc) > 1.0f;
    const intl base = to_intl(vc) * grid.pitch + to_intl(uc);
    floatl corners[4];
    gather_cells(grid.nearness, grid.pitch, base, corners);
    intl open = select_lanes(upper, IS_UPPER_OPEN(corners[0], corners[1], corners[2]), IS_LOWER_OPEN(corners[0]));
    if (any_lane(on_column | on_row)) {
        collapse_cells(corners, on_row, (intl)0, on_column);
        const intl edge = select_lanes(on_row, select_lanes(on_column, (intl)0, (intl)TORN_RIGHT), (intl)TORN_BELOW);
        const intl torn = ((as_intl(corners[0]) & edge) != 0) | (corners[0] <= NO_SURFACE);
        open = select_lanes(on_column | on_row, torn, open);
    }
    const floatl q00 = corners[0], q10 = corners[1], q01 = corners[2], q11 = corners[3];
    const floatl qc = select_lanes(upper, q11, q00);
    Plane plane;
    plane.q = qc;
    plane.gu = select_lanes(upper, qc - q01, q10 - qc);
    plane.gv = select_lanes(upper, qc - q10, q01 - qc);
    plane.x = uc + select_lanes(upper, (floatl)1.0f, (floatl)0.0f);
    plane.y = vc + select_lanes(upper, (floatl)1.0f, (floatl)0.0f);
    floatl per_unit;
    const floatl met = intersect_plane(rays, plane, &per_unit);
    const floatl w_met = rays.w + met * S[11], inverse = 1.0f / w_met;
    const floatl u_met = (rays.u + met * S[3]) * inverse, v_met = (rays.v + met * S[7]) * inverse;

    const floatl du = u_met - uc, dv = v_met - vc, diagonal = du + dv;
    const intl in_lower = (du >= -TOLERANCE) & (dv >= -TOLERANCE) & (diagonal <= 1.0f + TOLERANCE);
    const intl in_upper = (du <= 1.0f + TOLERANCE) & (dv <= 1.0f + TOLERANCE) & (diagonal >= 1.0f - TOLERANCE);
    const intl in_triangle = (upper & in_upper) | ((!upper) & in_lower);
    /* Just in front of each back side lies a front side, which the pixel's ray may meet first. So if both sides are
     * shown, a ray that meets a back side is traced. */
    const int shows_back = hit_kind == HITS_WITHOUT_PARALLAX ? sides & SHOWS_BACK : sides == SHOWS_BACK;
    const intl shows = ((per_unit > 0.0f) & (intl)(sides & SHOWS_FRONT ? -1 : 0)) |
                       ((per_unit < 0.0f) & (intl)(shows_back ? -1 : 0));
    const intl before = IS_BEFORE(map.dst_perspective, met);
    const intl on_pixels = (u_met >= -BORDER - TOLERANCE) & (v_met >= -BORDER - TOLERANCE) & (u_met <= last_u + BORDER + TOLERANCE) &
                           (v_met <= last_v + BORDER + TOLERANCE);
    const intl settles = pixels->smooth & in_triangle & on_pixels & shows & !open & (w_met > 0.0f) & before;
    const intl own = hit_kind == HITS_OF_PIXELS ? !pixels->smooth : (intl)0;
    pixels->n = select_lanes(settles, PACKED_HIT(met, 0), select_lanes(own, pixels->n, (floatl)EMPTY));
    pixels->traced = pixels->traced & !settles;
}
#endif
