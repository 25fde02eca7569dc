/* Why a pixel of the target is a hole: what its ray passes through, as far as the source shows.
 *
 * A ray is followed along its epipolar line as it recedes. Where it is nearer than the surface, the source has seen
 * that there is nothing. So the pixel shows something beyond the last such place, and its class is that of what begins
 * there: space behind a surface, samples without depth, or the outside of the image. A ray that comes out of a
 * surface's back ends there.
 *
 * valid: (dst_height, dst_width). classes: the same shape, CLASS_... below; with `first` 0 they hold those of other
 * views, and the least of both stays. nearest, farthest: the source's range of nearness. without_parallax: nothing
 * moves with its depth, each pixel sees its place in the source; typical: some nearness that it has there.
 * Work-item: LANES pixels of a row. Cost: O(samples between the nearest and the farthest place of the ray) a hole.
 * Determinism: every pixel on its own.
 */
#include "warp/trace.h"

/* Of several views' classes the least counts. */
#define CLASS_SEEN 0
#define CLASS_HIDDEN 1     /* by something nearer */
#define CLASS_UNOBSERVED 2 /* no depth there */
#define CLASS_OUTSIDE 3    /* of the source's image */
#define IS_FREE 4          /* nothing there, while the ray is followed */

/* The state of rays of nearness `near` at places of the source's image: IS_FREE or a class. Sets whether the surface is
 * closed there. */
INLINED intl state_at(Grid grid, floatl u, floatl v, floatl near, intl *closed)
{
    const floatl uc = clamp_lanes(floor_lanes(u), (floatl)-1.0f, (floatl)(grid.width - 1));
    const floatl vc = clamp_lanes(floor_lanes(v), (floatl)-1.0f, (floatl)(grid.height - 1));
    const floatl fu = u - uc, fv = v - vc;
    const intl upper = fu + fv > 1.0f;
    floatl corners[4];
    gather_cells(grid.nearness, grid.pitch, to_intl(vc) * grid.pitch + to_intl(uc), corners);
    const floatl q10 = corners[1], q01 = corners[2], qc = select_lanes(upper, corners[3], corners[0]);
    const floatl qn = select_lanes(fv > 0.5f, select_lanes(fu > 0.5f, corners[3], q01), select_lanes(fu > 0.5f, q10, corners[0]));
    *closed = !select_lanes(upper, IS_UPPER_OPEN(corners[0], q10, q01), IS_LOWER_OPEN(corners[0]));
    const floatl gu = select_lanes(upper, qc - q01, q10 - qc), gv = select_lanes(upper, qc - q10, q01 - qc);
    const floatl one = select_lanes(upper, (floatl)1.0f, (floatl)0.0f);
    const floatl surface = select_lanes(*closed, qc + gu * (fu - one) + gv * (fv - one), qn);
    return select_lanes(surface <= NO_SURFACE, (intl)CLASS_UNOBSERVED,
                        select_lanes(surface < near, (intl)IS_FREE, (intl)CLASS_HIDDEN));
}

/* Where nothing moves with its depth, each pixel has one place in the source. */
INLINED intl class_in_place(Grid grid, Rays rays, float typical)
{
    const floatl w = rays.w + typical * rays.centre.z;
    const floatl u = (rays.u + typical * rays.centre.x) / w, v = (rays.v + typical * rays.centre.y) / w;
    const intl inside = (w > 0.0f) & (u >= -BORDER) & (v >= -BORDER) & (u <= grid.width - 1.0f + BORDER) & (v <= grid.height - 1.0f + BORDER);
    intl closed;
    const intl state = state_at(grid, clamp_lanes(u, (floatl)-BORDER, (floatl)grid.width),
                                clamp_lanes(v, (floatl)-BORDER, (floatl)grid.height), (floatl)INFINITY, &closed);
    return select_lanes(inside, select_lanes(state == CLASS_UNOBSERVED, state, (intl)CLASS_HIDDEN), (intl)CLASS_OUTSIDE);
}

INLINED intl class_along(Grid grid, Rays rays, float nearest, float farthest, intl wanted)
{
    const Epipolar epipolar = epipolar_of(rays, grid);
    const Lines lines = epipolar.lines;
    /* A ray that recedes from the source, too, is free before the nearest sample's depth and hidden behind the farthest
     * one's: between these it is followed. One that comes towards the source is followed from the farthest one's depth to
     * the end. */
    const intl falls = epipolar.near_step < 0.0f, rises = epipolar.near_step > 0.0f;
    const floatl to_nearest = (nearest - epipolar.near) / epipolar.near_step;
    const floatl to_farthest = (farthest - epipolar.near) / epipolar.near_step;
    const floatl from = select_lanes(falls, to_nearest, select_lanes(rises, to_farthest, (floatl)0.0f));
    const floatl to = select_lanes(falls, to_farthest, lines.length);
    const floatl start = clamp_lanes(from, (floatl)0.0f, fmax(lines.length, (floatl)0.0f));
    const floatl end = clamp_lanes(to, start, lines.length);
    const intl leaves = !(to < lines.length); /* the image, before it is hidden */
    const intl enters = (lines.u < 0.0f) | (lines.v < 0.0f) | (lines.u > grid.width - 1.0f) | (lines.v > grid.height - 1.0f);
    const intl before = select_lanes(falls, (intl)IS_FREE, (intl)CLASS_HIDDEN);
    intl class_ = select_lanes(from > 0.0f, before, select_lanes(enters, (intl)CLASS_OUTSIDE, (intl)IS_FREE)),
         was_closed = 0;
    intl active = wanted & (lines.length >= 0.0f);
    floatl at = start;
    for (int steps_left = max(grid.width, grid.height) + 2; steps_left > 0 && any_lane(active);
         steps_left--, at += 1.0f) {
        const floatl here = min_lanes(at, end);
        const floatl u = lines.u + lines.du * here, v = lines.v + lines.dv * here;
        intl closed;
        const intl state = state_at(grid, u, v, epipolar.near + epipolar.near_step * here, &closed);
        const intl is_free = state == IS_FREE;
        const intl emerges = active & is_free & (class_ == CLASS_HIDDEN) & was_closed & closed;
        class_ = select_lanes(active & !emerges & (is_free | (class_ == IS_FREE)), state, class_);
        was_closed = closed;
        active = active & !emerges & (at < end);
    }
    class_ = select_lanes(class_ == IS_FREE, select_lanes(leaves, (intl)CLASS_OUTSIDE, (intl)CLASS_HIDDEN), class_);
    return select_lanes(lines.length >= 0.0f, class_, (intl)CLASS_OUTSIDE);
}

kernel void classify(global const float *surface, global const uchar *valid, global uchar *classes, PixelMap map,
                     float nearest, float farthest, float typical, int without_parallax, int first)
{
    const int x = get_global_id(0) * LANES, y = get_global_id(1);
    if (x >= map.dst_width || y >= map.dst_height)
        return;
    const int count = min(LANES, map.dst_width - x);
    const size_t out = (size_t)y * map.dst_width + x;
    intl hole = 0;
    for (int lane = 0; lane < count; lane++)
        set_int_lane(hole, lane, valid[out + lane] ? 0 : -1);
    intl class_ = CLASS_SEEN;
    if (any_lane(hole)) {
        const Grid grid = GRID_OF(surface, map.src_width, map.src_height, map.src_pitch, NO_CUT);
        const Rays rays = rays_of(map, to_floatl(x + lane_index), y);
        const intl found = without_parallax ? class_in_place(grid, rays, typical)
                                            : class_along(grid, rays, nearest, farthest, hole);
        class_ = select_lanes(hole, found, class_);
    }
    for (int lane = 0; lane < count; lane++) {
        const uchar one = int_lane(class_, lane);
        classes[out + lane] = first ? one : min(one, classes[out + lane]);
    }
}
