#ifndef WARP_TRACE_H
#define WARP_TRACE_H
/* Traces rays of the target through the triangulated grid of the source, exactly, each along its own epipolar line.
 *
 * In the source's pixel space a ray is Y(n) = start + n * centre, where n is the nearness in the target. In the
 * source's image the ray is a straight line, which is walked away from the epipole, cell by cell; in each cell, the
 * line passes one triangle and then the other. The ray sees the first triangle that it crosses. Over a triangle, the
 * surface's nearness minus the ray's nearness is affine: the ray meets the triangle where this difference changes its
 * sign.
 *
 * Cost: for LANES rays, LANES times the cells that the slowest ray passes in its windows.
 */
#include "warp/cells.h"
#include "warp/hits.h"

/* Rays, one for each lane, in the source's pixel space. All pass through the target's centre, the source's epipole. */
typedef struct {
    floatl u, v, w, q; /* the ray's point at target nearness 0 */
    float4 centre;
    int perspective; /* whether the target is perspective */
} Rays;

/* The plane of a triangle: nearness is q + gu (u - x) + gv (v - y). */
typedef struct {
    floatl q, gu, gv, x, y;
} Plane;

/* The epipolar lines of rays, and the nearness of the rays' points along them. Distances are pixels walked along a
 * line's major axis. */
typedef struct {
    Lines lines;
    floatl near, near_step; /* the ray's source nearness at distance 0, and its change per pixel of distance */
    floatl start, centre;   /* homogeneous distances of the ray's point at target nearness 0, and of the epipole */
} Epipolar;

#define END_TOLERANCE 2e-4f /* pixels of the source by which surfaces are extended at their ends, against rounding */
#ifndef WINDOWS
#define WINDOWS 1 /* greatest number of windows of a line after the first */
#endif

/* The windows of a line that are searched, in this order: first from `from` to `to`, then `radius` to either side of
 * each place in `next` (INFINITY: no further window). All are distances along the line. */
typedef struct {
    floatl from, to;
    floatl next[WINDOWS];
    float radius;
} Windows;

INLINED Rays rays_of(PixelMap map, floatl x, floatl y)
{
    const float *S = map.src_from_dst;
    Rays rays;
    rays.u = PIXEL_ROW(S, 0, x, y);
    rays.v = PIXEL_ROW(S, 1, x, y);
    rays.w = PIXEL_ROW(S, 2, x, y);
    rays.q = PIXEL_ROW(S, 3, x, y);
    rays.centre = (float4)(S[3], S[7], S[11], S[15]);
    rays.perspective = map.dst_perspective;
    return rays;
}

/* The target nearness at which the rays meet a plane. Sets `per_unit`, which is positive if they meet the plane's
 * front. */
INLINED floatl intersect_plane(Rays rays, Plane plane, floatl *per_unit)
{
    const float4 c = rays.centre;
    const floatl at_start = rays.q - plane.q * rays.w - plane.gu * (rays.u - plane.x * rays.w) -
                            plane.gv * (rays.v - plane.y * rays.w);
    *per_unit = c.w - plane.q * c.z - plane.gu * (c.x - plane.x * c.z) - plane.gv * (c.y - plane.y * c.z);
    return -at_start / *per_unit;
}

/* The rays' epipolar lines, which begin and end at the image's border or at the epipole */
INLINED Epipolar epipolar_of(Rays rays, Grid grid)
{
    const float4 c = rays.centre;
    const floatl dir_u = rays.u * c.z - c.x * rays.w, dir_v = rays.v * c.z - c.y * rays.w,
                 offset = c.x * rays.v - c.y * rays.u;
    const intl u_major = fabs(dir_u) >= fabs(dir_v);
    const floatl major = select_lanes(u_major, dir_u, dir_v), start = select_lanes(u_major, rays.u, rays.v);
    const floatl centre = select_lanes(u_major, (floatl)c.x, (floatl)c.y);
    const floatl sign = select_lanes(major < 0.0f, (floatl)-1.0f, (floatl)1.0f);
    const floatl per_major = 1.0f / major;
    const floatl tilt = select_lanes(u_major, dir_v, dir_u) * per_major;
    const floatl minor = select_lanes(u_major, -offset, offset) * per_major;
    const floatl slope = (rays.q * c.z - c.w * rays.w) * per_major, level = (c.w * start - rays.q * centre) * per_major;

    /* Clip to the image's pixels, and ON_SAMPLES beyond their edges against rounding. */
    const float last_u = grid.width - 1, last_v = grid.height - 1;
    const floatl last_minor = select_lanes(u_major, (floatl)last_v, (floatl)last_u);
    const floatl per_tilt = 1.0f / select_lanes(fabs(tilt) < 1e-12f, (floatl)1e-12f, tilt);
    const floatl edge_0 = (-BORDER - ON_SAMPLES - minor) * per_tilt;
    const floatl edge_1 = (last_minor + BORDER + ON_SAMPLES - minor) * per_tilt;
    floatl low = fmax((floatl)-BORDER, fmin(edge_0, edge_1));
    floatl high = fmin(select_lanes(u_major, (floatl)last_u, (floatl)last_v) + BORDER, fmax(edge_0, edge_1));
    /* Clip to this side of the epipole. */
    if (c.z != 0.0f) {
        const floatl epipole = centre / c.z;
        const intl after = c.z * sign > 0.0f;
        low = select_lanes(after, fmax(low, epipole), low);
        high = select_lanes(after, high, fmin(high, epipole));
    }
    /* Clip to the part in front of the target. It ends at nearness 0: at infinity, or at an orthographic image
     * plane. */
    const intl ahead = rays.w > 0.0f, rising = sign > 0.0f;
    const floatl border = start / rays.w;
    const intl cuts_high = ahead & (rays.perspective ? rising : !rising);
    const intl cuts_low = ahead & (rays.perspective ? !rising : rising);
    high = select_lanes(cuts_high, fmin(high, border), high);
    low = select_lanes(cuts_low, fmax(low, border), low);

    Epipolar epipolar;
    const floatl from = select_lanes(rising, low, high), at_minor = minor + tilt * from;
    const intl runs = (fabs(major) > 0.0f) & isfinite_lanes(tilt) & isfinite_lanes(at_minor);
    epipolar.lines.u = select_lanes(u_major, from, at_minor);
    epipolar.lines.v = select_lanes(u_major, at_minor, from);
    epipolar.lines.du = sign * select_lanes(u_major, (floatl)1.0f, tilt);
    epipolar.lines.dv = sign * select_lanes(u_major, tilt, (floatl)1.0f);
    epipolar.lines.length = select_lanes(runs, high - low, (floatl)-1.0f);
    epipolar.near = level + slope * from;
    epipolar.near_step = slope * sign;
    epipolar.start = sign * (start - from * rays.w);
    epipolar.centre = sign * (centre - from * c.z);
    snap(&epipolar.lines);
    return epipolar;
}

/* The distance along the lines at which the rays have a target nearness */
INLINED floatl distance_of(Rays rays, Epipolar epipolar, floatl nearness)
{
    return (epipolar.start + nearness * epipolar.centre) / (rays.w + nearness * rays.centre.z);
}

/* Finds the first triangle that each ray crosses within the windows of its line. Returns the hit on it; EMPTY if there
 * is none; BLOCKED if the ray meets a side that is not shown, at a place that is not in front of the target. */
INLINED floatl trace(Grid grid, Rays rays, Epipolar epipolar, Windows windows, int sides, intl wanted, uint *cells)
{
    const Lines lines = epipolar.lines;
    const Traversal traversal = traversal_of(lines, grid);
    /* The change of the ray's nearness over END_TOLERANCE pixels */
    const floatl tolerance = END_TOLERANCE * fabs(epipolar.near_step);
    floatl at = fmax(windows.from, (floatl)0.0f), to = fmin(windows.to, lines.length), difference = 0.0f, x = 0.0f,
           y = 0.0f;
    intl active = wanted & (at <= lines.length), begins = active, connected = 0;
    Plane met_plane = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
    intl is_met = 0, hides = 0;
    /* A line enters each cell by a column or a row, each at most once, and each window may enter one more cell. */
    for (int cells_left = grid.width + grid.height + 6 + 2 * WINDOWS; cells_left > 0; cells_left--) {
        /* At the end of a window, go on to the next one. */
        const intl over = active & !begins & (at >= to);
        if (any_lane(over)) {
            const floatl next = windows.next[0], from = next - windows.radius;
            for (int i = 0; i + 1 < WINDOWS; i++)
                windows.next[i] = select_lanes(over, windows.next[i + 1], windows.next[i]);
            windows.next[WINDOWS - 1] = select_lanes(over, (floatl)INFINITY, windows.next[WINDOWS - 1]);
            to = select_lanes(over, fmin(next + windows.radius, lines.length), to);
            begins = over & (from > at);
            at = select_lanes(begins, from, at);
            active = active & (at < lines.length) & !(over & (next == INFINITY));
        }
        if (!any_lane(active))
            break;
        if (any_lane(begins)) {
            enter_cells(lines, at, begins, &x, &y);
            connected = connected & !begins;
            begins = 0;
        }
        *cells += 1;
        const Cell cell = pass_cells(grid, lines, traversal, x, y, at);

        const floatl near_0 = epipolar.near + epipolar.near_step * at,
                     near_1 = epipolar.near + epipolar.near_step * cell.crossing,
                     near_2 = epipolar.near + epipolar.near_step * cell.out;
        const floatl difference_0 = select_lanes(connected, difference, cell.q_in - near_0), difference_2 = cell.q_out - near_2;
        const floatl difference_1 = select_lanes(cell.has_first, select_lanes(cell.has_second, cell.q_crossing - near_1, difference_2), difference_0);
        /* With the tolerance, rounding leaves no gaps at the ends of triangles. */
        const intl first = cell.has_first & !cell.first_open, second = cell.has_second & !cell.second_open;
        const intl first_front = first & (difference_0 < tolerance) & (difference_1 >= -tolerance) &
                                 (difference_1 > difference_0);
        const intl first_back = first & (difference_0 > 0.0f) & (difference_1 <= 0.0f);
        const intl second_front = second & (difference_1 < tolerance) & (difference_2 >= -tolerance) &
                                  (difference_2 > difference_1);
        const intl second_back = second & (difference_1 > 0.0f) & (difference_2 <= 0.0f);
        const intl in_first = first_front | first_back;
        const intl meets = active & (in_first | second_front | second_back);
        if (any_lane(meets)) {
            const intl front = (in_first & first_front) | ((!in_first) & second_front);
            const intl shows = meets & ((front & (intl)(sides & SHOWS_FRONT ? -1 : 0)) |
                                        ((!front) & (intl)(sides & SHOWS_BACK ? -1 : 0)));
            const intl lower = (in_first & traversal.lower_first) | (!(in_first | traversal.lower_first));
            met_plane.q = select_lanes(meets, select_lanes(lower, cell.q00, cell.q10), met_plane.q);
            met_plane.gu = select_lanes(meets, select_lanes(lower, cell.lower_u, cell.upper_u), met_plane.gu);
            met_plane.gv = select_lanes(meets, select_lanes(lower, cell.lower_v, cell.upper_v), met_plane.gv);
            met_plane.x = select_lanes(meets, select_lanes(lower, cell.x, cell.x + 1.0f), met_plane.x);
            met_plane.y = select_lanes(meets, cell.y, met_plane.y);
            is_met = is_met | meets;
            hides = hides | (meets & !shows);
            active = active & !meets;
        }
        connected = select_lanes(cell.has_second, !cell.second_open,
                                 select_lanes(cell.has_first, !cell.first_open, connected));
        difference = select_lanes(cell.has_first | cell.has_second, difference_2, difference);
        x = cell.next_x;
        y = cell.next_y;
        at = cell.out;
        active = active & (at < lines.length);
    }
    floatl per_unit;
    const floatl met = intersect_plane(rays, met_plane, &per_unit);
    const intl before = IS_BEFORE(rays.perspective, met);
    const floatl hit = PACKED_HIT(met, select_lanes(hides, (intl)1, (intl)0));
    return select_lanes(is_met & before, hit, select_lanes(hides, (floatl)BLOCKED, (floatl)EMPTY));
}
#endif
