/* Why a pixel of the target is a hole: what its ray passes through, as far as the source shows.
 *
 * A ray is followed along its epipolar line as it recedes. Where it is nearer than the surface, the source has seen
 * that there is nothing. So the pixel shows something beyond the last such place, and its class is that of what begins
 * there: space behind a surface, samples without depth, or the outside of the image. A ray that meets a side of the surface
 * that is not shown ends there; resolve.cl tells that of it.
 *
 * The last such place is looked for from the end. Most of what a ray passes lies wholly before it or wholly behind it: how
 * near and how far the surface is within windows of its samples (lib/bounds.h) tells that, window by window. Samples are
 * looked at in those alone that tell too little.
 *
 * valid: (dst_height, dst_width). classes: the same shape, CLASS_... below; they hold what resolve.cl and other views tell
 * of holes, and the least stays. nearest, farthest: the source's range of nearness. without_parallax: nothing
 * moves with its depth, each pixel sees its place in the source; typical: some nearness that it has there.
 * Work-item: STRIP * LANES pixels of a row. Cost: O(windows between the last free place of the ray and its farthest one) a
 * hole, O(samples) at worst. Determinism: every pixel on its own.
 */
#include "lib/bounds.h"
#include "warp/classes.h"
#include "warp/trace.h"

#define IS_FREE 4 /* nothing there, while the ray is followed */

/* The state of rays of nearness `near` at places of the source's image: IS_FREE or a class. */
INLINED intl state_at(Grid grid, floatl u, floatl v, floatl near)
{
    const floatl uc = clamp_lanes(floor_lanes(u), (floatl)-1.0f, (floatl)(grid.width - 1));
    const floatl vc = clamp_lanes(floor_lanes(v), (floatl)-1.0f, (floatl)(grid.height - 1));
    const floatl fu = u - uc, fv = v - vc;
    const intl upper = fu + fv > 1.0f;
    floatl corners[4];
    gather_cells(grid.nearness, grid.pitch, to_intl(vc) * grid.pitch + to_intl(uc), corners);
    const floatl q10 = corners[1], q01 = corners[2], qc = select_lanes(upper, corners[3], corners[0]);
    const floatl qn = select_lanes(fv > 0.5f, select_lanes(fu > 0.5f, corners[3], q01), select_lanes(fu > 0.5f, q10, corners[0]));
    const intl open = select_lanes(upper, IS_UPPER_OPEN(corners[0], q10, q01), IS_LOWER_OPEN(corners[0]));
    const floatl gu = select_lanes(upper, qc - q01, q10 - qc), gv = select_lanes(upper, qc - q10, q01 - qc);
    const floatl one = select_lanes(upper, (floatl)1.0f, (floatl)0.0f);
    const floatl surface = select_lanes(open, qn, qc + gu * (fu - one) + gv * (fv - one));
    return select_lanes(surface <= NO_SURFACE, (intl)CLASS_UNOBSERVED,
                        select_lanes(surface < near, (intl)IS_FREE, (intl)CLASS_HIDDEN));
}

/* Where nothing moves with its depth, each pixel has one place in the source. */
INLINED intl class_in_place(Grid grid, Rays rays, float typical)
{
    const floatl w = rays.w + typical * rays.centre.z;
    const floatl u = (rays.u + typical * rays.centre.x) / w, v = (rays.v + typical * rays.centre.y) / w;
    const intl inside = (w > 0.0f) & (u >= -BORDER) & (v >= -BORDER) & (u <= grid.width - 1.0f + BORDER) & (v <= grid.height - 1.0f + BORDER);
    const intl state = state_at(grid, clamp_lanes(u, (floatl)-BORDER, (floatl)grid.width),
                                clamp_lanes(v, (floatl)-BORDER, (floatl)grid.height), (floatl)INFINITY);
    return select_lanes(inside, select_lanes(state == CLASS_UNOBSERVED, state, (intl)CLASS_HIDDEN), (intl)CLASS_OUTSIDE);
}

/* Rays along their lines, in steps of a sample */
typedef struct {
    Epipolar epipolar;
    floatl start, end; /* distances along the lines */
    floatl steps;      /* that reach the end; < 0: there are none to take */
    floatl per_near;   /* steps that change nearness by 1 */
    intl class_;       /* before the first one */
    intl leaves;       /* the image, before it is hidden */
} Walk;

INLINED Walk walk_of(Grid grid, Rays rays, float nearest, float farthest, intl wanted)
{
    Walk walk;
    walk.epipolar = epipolar_of(rays, grid);
    const Lines lines = walk.epipolar.lines;
    const floatl near = walk.epipolar.near, near_step = walk.epipolar.near_step;
    /* A ray that recedes from the source, too, is free before the nearest sample's depth and hidden behind the farthest
     * one's: between these it is followed. One that comes towards the source is followed from the farthest one's depth to
     * the end. */
    const intl falls = near_step < 0.0f, rises = near_step > 0.0f;
    const floatl to_nearest = (nearest - near) / near_step, to_farthest = (farthest - near) / near_step;
    const floatl from = select_lanes(falls, to_nearest, select_lanes(rises, to_farthest, (floatl)0.0f));
    const floatl to = select_lanes(falls, to_farthest, lines.length);
    walk.start = clamp_lanes(from, (floatl)0.0f, fmax(lines.length, (floatl)0.0f));
    walk.end = clamp_lanes(to, walk.start, lines.length);
    walk.leaves = !(to < lines.length);
    const intl enters = (lines.u < 0.0f) | (lines.v < 0.0f) | (lines.u > grid.width - 1.0f) | (lines.v > grid.height - 1.0f);
    const intl before = select_lanes(falls, (intl)IS_FREE, (intl)CLASS_HIDDEN);
    const intl at_border = select_lanes(enters, (intl)CLASS_OUTSIDE, (intl)IS_FREE);
    walk.class_ = select_lanes(from > 0.0f, before, at_border);
    const floatl length = clamp_lanes(walk.end - walk.start, (floatl)0.0f, (floatl)(max(grid.width, grid.height) + 2));
    walk.steps = select_lanes(wanted & (lines.length >= 0.0f), ceil_lanes(length), (floatl)-1.0f);
    walk.per_near = 1.0f / near_step;
    return walk;
}

/* The samples around BOUNDS_STEP steps of walks */
typedef struct {
    floatl low, high;    /* nearness of those that are there */
    floatl near;         /* of the rays at the first step */
    intl before, behind; /* the rays pass all of them so; both, if there are none */
    intl whole;          /* none is missing */
} Window;

INLINED Window window_at(Grid grid, global const float *bounds, Walk walk, floatl step)
{
    const Lines lines = walk.epipolar.lines;
    const floatl from = min_lanes(walk.start + step, walk.end);
    const floatl to = min_lanes(walk.start + step + (BOUNDS_STEP - 1.0f), walk.end);
    const floatl u = lines.u + min_lanes(lines.du * from, lines.du * to);
    const floatl v = lines.v + min_lanes(lines.dv * from, lines.dv * to);
    const intl x = to_intl(clamp_lanes(u + FROM_RING, (floatl)0.0f, (floatl)grid.width)) / BOUNDS_STEP;
    const intl y = to_intl(clamp_lanes(v + FROM_RING, (floatl)0.0f, (floatl)grid.height)) / BOUNDS_STEP;
    Window window;
    gather_pairs(bounds, 2 * (y * BOUNDS_ACROSS(grid.width) + x), &window.low, &window.high);
    window.near = walk.epipolar.near + walk.epipolar.near_step * from;
    const floatl near_to = walk.epipolar.near + walk.epipolar.near_step * to;
    window.before = window.high < min_lanes(window.near, near_to);
    window.behind = window.low >= max_lanes(window.near, near_to);
    window.whole = (as_intl(window.high) & SOME_MISSING) == 0;
    return window;
}

/* The states of walks at some of their steps */
INLINED intl state_of(Grid grid, Walk walk, floatl step)
{
    const floatl here = min_lanes(walk.start + max_lanes(step, (floatl)0.0f), walk.end);
    const Lines lines = walk.epipolar.lines;
    return state_at(grid, lines.u + lines.du * here, lines.v + lines.dv * here,
                    walk.epipolar.near + walk.epipolar.near_step * here);
}

/* The classes of rays: what begins after their last free step, which is looked for from the end, window by window. */
INLINED intl class_of(Grid grid, global const float *bounds, Walk walk)
{
    floatl last_free = -1.0f, step = BOUNDS_STEP * truncated(max_lanes(walk.steps, (floatl)0.0f) / (float)BOUNDS_STEP);
    intl found = walk.steps < 0.0f;
    for (; any_lane(!found & (step >= 0.0f)); step -= (float)BOUNDS_STEP) {
        const Window window = window_at(grid, bounds, walk, step);
        const intl looked = !found & (step >= 0.0f) & !window.behind, free = looked & window.before & window.whole;
        last_free = select_lanes(free, min_lanes(step + (BOUNDS_STEP - 1.0f), walk.steps), last_free);
        found = found | free;
        for (int i = BOUNDS_STEP - 1; i >= 0 && any_lane(looked & !found); i--) {
            const floatl at = step + (float)i;
            const intl free_here = looked & !found & (at <= walk.steps) & (state_of(grid, walk, at) == IS_FREE);
            last_free = select_lanes(free_here, at, last_free);
            found = found | free_here;
        }
    }
    const intl begins = (last_free < 0.0f) & (walk.class_ != IS_FREE), ends = last_free >= walk.steps;
    const intl after = state_of(grid, walk, min_lanes(last_free + 1.0f, walk.steps));
    const intl beyond = select_lanes(walk.leaves, (intl)CLASS_OUTSIDE, (intl)CLASS_HIDDEN);
    const intl class_ = select_lanes(begins, walk.class_, select_lanes(ends, beyond, after));
    return select_lanes(walk.steps < 0.0f, (intl)CLASS_OUTSIDE, class_);
}

/* Which of a packet of pixels the view may tell something of: holes whose class may be less. The others are seen. */
INLINED intl holes_at(global const uchar *valid, global uchar *classes, int count)
{
    intl told = CLASS_SEEN;
    if (count >= LANES) {
        told = select_lanes(load_bytes(valid) != 0, (intl)CLASS_SEEN, load_bytes(classes));
        store_bytes(to_ucharl(told), classes);
    } else {
        for (int lane = 0; lane < count; lane++) {
            classes[lane] = valid[lane] ? CLASS_SEEN : classes[lane];
            set_int_lane(told, lane, classes[lane]);
        }
    }
    return told > CLASS_HIDDEN;
}

/* Adds those of LANES pixels that are wanted to `count` others; there is room for LANES more. Returns how many are now. */
INLINED int add_pixels(int *chosen, int count, intl pixels, intl wanted)
{
    if (any_lane(wanted))
        for (int lane = 0; lane < LANES; lane++) {
            chosen[count] = int_lane(pixels, lane);
            count += int_lane(wanted, lane) != 0;
        }
    return count;
}

kernel void classify(global const float *surface, global const float *bounds, global const uchar *valid,
                     global uchar *classes, PixelMap map, float nearest, float farthest, float typical,
                     int without_parallax)
{
    const int low_x = get_global_id(0) * (STRIP * LANES), high_x = min(low_x + STRIP * LANES, map.dst_width);
    const int y = get_global_id(1);
    if (low_x >= map.dst_width || y >= map.dst_height)
        return;
    valid += (size_t)y * map.dst_width;
    classes += (size_t)y * map.dst_width;
    int holes[(STRIP + 1) * LANES], count = 0;
    for (int x = low_x; x < high_x; x += LANES) {
        const intl wanted = holes_at(valid + x, classes + x, min(LANES, high_x - x));
        count = add_pixels(holes, count, x + lane_index, wanted);
    }

    const Grid grid = GRID_OF(surface, map.src_width, map.src_height, map.src_pitch, NO_CUT);
    for (int hole = 0; hole < count; hole += LANES) {
        const intl wanted = hole + lane_index < count;
        const intl x = select_lanes(wanted, (intl)load_lanes(holes + hole), (intl)low_x);
        const Rays rays = rays_of(map, to_floatl(x), y);
        const intl class_ = without_parallax ? class_in_place(grid, rays, typical)
                                             : class_of(grid, bounds, walk_of(grid, rays, nearest, farthest, wanted));
        for (int lane = 0; lane < min(count - hole, LANES); lane++) {
            const uchar one = int_lane(class_, lane);
            classes[holes[hole + lane]] = min(one, classes[holes[hole + lane]]);
        }
    }
}
